"""Wavelet neural operator: from displacement to property maps, on any grid.

Each block is x ← x + act(M x + W x). W mixes the channels of a point. M = synthesis ∘ K ∘ analysis mixes them in
wavelet space, where the details of each level are convolved with a kernel of that level, and the coarsest means
with two wide kernels that reach across the whole field. The finest details are left to W: with kernels for them,
which cost as much as the rest of M, the error was higher after the same training time. Weights belong to physical
lengths: M acts on 51 points across whatever the grid.

References
----------
Tripura & Chakraborty 2023, doi:10.1016/j.cma.2022.115783, where weights belong to single
coefficients of one grid, and blocks are not residual.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ngbrain.errors import InputError
from ngbrain.surrogate.operator.wavelets import Wavelet, WaveletLevel

NATIVE = 50
"""Intervals across the native grid, to whose spacing the levels belong."""


def count_weights(module: nn.Module) -> int:
    """Number of trainable weights of a network.

    >>> count_weights(nn.Linear(3, 2))
    8
    """
    return sum(p.numel() for p in module.parameters() if p.requires_grad)


def initialise_weights(net: nn.Module) -> None:
    """Initialise weights at random with variance 1/inputs and zero bias: M x + W x has twice the variance of x, of
    which act keeps half.

    PyTorch's defaults, a third of that variance, attenuate the field from block to block, which costs the first
    epochs of the training. The output begins near 0: the weights of the last layer are divided by ten.
    """
    layers = [part for part in net.modules() if isinstance(part, nn.Linear | nn.Conv2d)]
    for layer in layers:
        nn.init.kaiming_normal_(layer.weight, nonlinearity="linear")
        if layer.bias is not None:
            nn.init.zeros_(layer.bias)
    with torch.no_grad():
        layers[-1].weight *= 0.1


def native_grid(ny: int, nx: int) -> tuple[int, int]:
    """Points along y and x of the native grid over the field that ny × nx points cover.

    Parameters
    ----------
    ny, nx : int
        Points along y and x.

    Returns
    -------
    tuple of (int, int)
        Points of the native grid along y and x.

    Examples
    --------
    >>> native_grid(101, 101), native_grid(64, 33)
    ((51, 51), (51, 26))
    """
    longer = (ny + nx + abs(ny - nx)) // 2 - 1  # max is not traced
    return (2 * NATIVE * (ny - 1) + longer) // (2 * longer) + 1, (2 * NATIVE * (nx - 1) + longer) // (2 * longer) + 1


class WaveletMix(nn.Module):
    """M of a block: a kernel for the details of each level, the finest first, and two for the coarsest means.

    Parameters
    ----------
    width : int
        Channels.
    levels : int
        Levels with kernels.
    reach : int
        Points across the kernels of the details.
    coarse_reach : int
        Points across the kernels of the means.
    """

    def __init__(self, width: int, levels: int, reach: int, coarse_reach: int) -> None:
        super().__init__()

        def kernel(points: int, bands: int = 1) -> nn.Conv2d:
            channels = bands * width
            return nn.Conv2d(channels, channels, points, padding=points // 2, groups=bands, bias=bands == 1)

        self.details = nn.ModuleList(kernel(reach, bands=3) for _ in range(levels))
        self.means = nn.Sequential(kernel(coarse_reach), nn.GELU(), kernel(coarse_reach))

    def forward(self, x: Tensor, levels: list[tuple[WaveletLevel, WaveletLevel]]) -> Tensor:  # noqa: D102
        """Apply the kernels in wavelet space.

        Parameters
        ----------
        x : torch.Tensor
            Field, of shape (ny, nx, batch, width).
        levels : list of tuple of (WaveletLevel, WaveletLevel)
            Transform matrices along y and x of each level.

        Returns
        -------
        torch.Tensor
            Field of the same shape.
        """
        mean, details = Wavelet.decompose(x, levels)
        mixed = [kernel(d) for kernel, d in zip(self.details, details, strict=True)]
        mean = self.means(mean.permute(2, 3, 0, 1).contiguous(memory_format=torch.channels_last)).permute(2, 3, 0, 1)
        return Wavelet.compose(mean, mixed, levels)


class WaveletBlock(nn.Module):
    """Residual block x ↦ x + act(M x + W x) of (ny, nx, batch, width).

    Parameters
    ----------
    width : int
        Channels.
    mix : WaveletMix
        M.
    """

    def __init__(self, width: int, mix: WaveletMix) -> None:
        super().__init__()
        self.mix, self.point = mix, nn.Linear(width, width)

    def forward(self, x: Tensor, levels: list[tuple[WaveletLevel, WaveletLevel]]) -> Tensor:  # noqa: D102
        """Apply the block.

        Parameters
        ----------
        x : torch.Tensor
            Field, of shape (ny, nx, batch, width).
        levels : list of tuple of (WaveletLevel, WaveletLevel)
            Transform matrices along y and x of each level.

        Returns
        -------
        torch.Tensor
            Field of the same shape.
        """
        return x + nn.functional.gelu(self.mix(x, levels) + self.point(x))


class WaveletOperator(nn.Module):
    """The network: (batch, channels_in, ny, nx) to (batch, channels_out, ny, nx), float32, on any grid of square
    cells over one field.

    The levels are those of 51 points along the longer side, which is the grid to train on. From other grids M takes
    the cubic interpolation there, and its result is interpolated back, while W and act apply at the given points.
    On grids that contain the native points the result at these is the same. `forward` raises `InputError` for other
    shapes.

    Parameters
    ----------
    channels_in : int
        Input channels.
    channels_out : int
        Output channels.
    width : int, default 32
        Channels inside.
    blocks : int, default 4
        Number of blocks.
    levels : int, default 3
        Wavelet levels, at least 2.
    wavelet : str, default 'db2'
        Name of PyWavelets.
    reach : int, default 3
        Points across the kernels of the details.
    coarse_reach : int, default 5
        Points across the kernels of the coarsest means.

    Examples
    --------
    >>> net = WaveletOperator(6, 2)
    >>> net(torch.zeros(1, 6, 51, 64)).shape
    torch.Size([1, 2, 51, 64])
    """

    def __init__(
        self,
        channels_in: int,
        channels_out: int,
        width: int = 32,
        blocks: int = 4,
        levels: int = 3,
        wavelet: str = "db2",
        reach: int = 3,
        coarse_reach: int = 5,
    ) -> None:
        super().__init__()
        self.channels_in = channels_in
        self.wavelet, self.levels = Wavelet(wavelet), levels
        self.lift = nn.Sequential(nn.Linear(channels_in, width), nn.GELU(), nn.Linear(width, width))
        self.blocks = nn.ModuleList(
            WaveletBlock(width, WaveletMix(width, levels - 1, reach, coarse_reach)) for _ in range(blocks)
        )
        self.project = nn.Sequential(nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, channels_out))
        initialise_weights(self)

    def forward(self, x: Tensor) -> Tensor:  # noqa: D102
        if not torch.jit.is_tracing() and (x.ndim != 4 or x.shape[1] != self.channels_in or min(x.shape[2:]) < 4):
            raise InputError("x.shape", tuple(x.shape), f"(batch, {self.channels_in}, ny, nx), ny and nx at least 4")
        ny, nx = x.shape[2], x.shape[3]
        levels = self.wavelet.levels(*native_grid(ny, nx), self.levels)
        (finest_y, finest_x), (y_level, x_level), *coarser = levels
        levels = [(y_level.chain(finest_y).resample(ny), x_level.chain(finest_x).resample(nx)), *coarser]
        y = self.lift(x.permute(2, 3, 0, 1).contiguous())
        for block in self.blocks:
            y = block(y, levels)
        return self.project(y).permute(2, 3, 0, 1)
