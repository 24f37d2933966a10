"""Two common networks with as many weights as the default wavelet operator, as baselines."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from ngbrain.surrogate.operator.wavelet_operator import initialise_weights


class UNet(nn.Module):
    """U-Net: convolutions on three grids, each half as fine as the last, with skip connections.

    Maps (batch, channels_in, ny, nx) to channels_out. Its kernels span points, not lengths, so it is valid only on
    the training grid.

    Parameters
    ----------
    channels_in : int
        Input channels.
    channels_out : int
        Output channels.
    width : int, default 31
        Channels on the finest grid.

    References
    ----------
    Ronneberger, Fischer & Brox 2015, doi:10.1007/978-3-319-24574-4_28.

    Examples
    --------
    >>> UNet(6, 2)(torch.zeros(1, 6, 51, 64)).shape
    torch.Size([1, 2, 51, 64])
    """

    def __init__(self, channels_in: int, channels_out: int, width: int = 31) -> None:
        super().__init__()

        def pair(before: int, after: int) -> nn.Sequential:
            first, second = (nn.Conv2d(c, after, 3, padding=1) for c in (before, after))
            return nn.Sequential(first, nn.GELU(), second, nn.GELU())

        self.down = nn.ModuleList([pair(channels_in, width), pair(width, 2 * width), pair(2 * width, 4 * width)])
        self.up = nn.ModuleList([pair(6 * width, 2 * width), pair(3 * width, width)])
        self.project = nn.Conv2d(width, channels_out, 1)
        initialise_weights(self)

    def forward(self, x: Tensor) -> Tensor:  # noqa: D102
        skips: list[Tensor] = []
        for convolve in self.down:
            x = convolve(functional.avg_pool2d(x, 2, ceil_mode=True) if skips else x)
            skips.append(x)
        for convolve, skip in zip(self.up, skips[-2::-1], strict=True):
            wide = functional.interpolate(x, size=skip.shape[2:], mode="bilinear")
            x = convolve(torch.cat([wide, skip], 1))
        return self.project(x)


class FourierLayer(nn.Module):
    """Linear map of the channels of each Fourier mode: the lowest `modes` of x and, of either sign, of y; the
    others are dropped.

    Parameters
    ----------
    width : int
        Channels.
    modes : int
        Number of modes.
    """

    def __init__(self, width: int, modes: int) -> None:
        super().__init__()
        self.modes = modes
        self.weight = nn.Parameter(torch.randn(width, width, 2 * modes, modes, 2) / (2 * width) ** 0.5)

    def forward(self, x: Tensor) -> Tensor:  # noqa: D102
        k, (ny, nx) = self.modes, x.shape[2:]
        found = torch.fft.rfft2(x, norm="forward")[..., :k]
        low = torch.cat([found[:, :, :k], found[:, :, -k:]], 2)
        # not einsum: see wavelets.py on products in batches
        mixed = (low[:, :, None] * torch.view_as_complex(self.weight)).sum(1)
        gap = mixed.new_zeros(*mixed.shape[:2], ny - 2 * k, k)
        return torch.fft.irfft2(torch.cat([mixed[:, :, :k], gap, mixed[:, :, k:]], 2), s=(ny, nx), norm="forward")


class FourierOperator(nn.Module):
    """Fourier neural operator: x ← act(F⁻¹ R F x + W x), on any grid with 2 `modes` points.

    Maps (batch, channels_in, ny, nx) to channels_out. The field, which is not periodic, is padded with zeros over a
    fourth of its length.

    Parameters
    ----------
    channels_in : int
        Input channels.
    channels_out : int
        Output channels.
    width : int, default 20
        Channels inside.
    blocks : int, default 4
        Number of blocks.
    modes : int, default 8
        Number of Fourier modes.

    References
    ----------
    Li et al. 2021, arXiv:2010.08895.

    Examples
    --------
    >>> FourierOperator(6, 2)(torch.zeros(1, 6, 51, 64)).shape
    torch.Size([1, 2, 51, 64])
    """

    def __init__(self, channels_in: int, channels_out: int, width: int = 20, blocks: int = 4, modes: int = 8) -> None:
        super().__init__()

        def point(before: int, after: int) -> nn.Conv2d:
            return nn.Conv2d(before, after, 1)

        self.lift = nn.Sequential(point(channels_in, width), nn.GELU(), point(width, width))
        self.spectra = nn.ModuleList(FourierLayer(width, modes) for _ in range(blocks))
        self.points = nn.ModuleList(point(width, width) for _ in range(blocks))
        self.project = nn.Sequential(point(width, 4 * width), nn.GELU(), point(4 * width, channels_out))
        initialise_weights(self)

    def forward(self, x: Tensor) -> Tensor:  # noqa: D102
        ny, nx = x.shape[2:]
        y = functional.pad(self.lift(x), (0, nx // 4, 0, ny // 4))
        for spectrum, point in zip(self.spectra, self.points, strict=True):
            y = functional.gelu(spectrum(y) + point(y))
        return self.project(y[..., :ny, :nx])
