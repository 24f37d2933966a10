"""Two-dimensional wavelet transform as products with small matrices, one for each level and axis.

A level with filters of length L maps n samples to m = ⌊(n + L − 1)/2⌋ means and as many details, with symmetric
extension at the ends (…b a | a b…). On grids of up to some hundred points these dense products, which need no
padded copy and whose derivative is the transposed product, are faster than strided convolutions, above all in the
backward pass. Points come first and samples last, so that each is one product of two matrices. Batched products are
avoided: where NGSolve was imported before PyTorch its OpenBLAS replaces PyTorch's and crashes on them
(pytorch/pytorch#182263). The matrices are built from the size by operations that an ONNX graph repeats for other
sizes.

References
----------
Mallat, A Wavelet Tour of Signal Processing, 3rd ed., 7.3 and 7.5,
doi:10.1016/B978-0-12-374370-1.X0001-8; the order of the coefficients is that of PyWavelets,
doi:10.21105/joss.01237.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from ngbrain.errors import InputError, nearest, require


class WaveletLevel(NamedTuple):
    """Matrices of one level along one axis of n points.

    Parameters
    ----------
    analysis : torch.Tensor
        (2m, n), means above details.
    synthesis : torch.Tensor
        (n, 2m).
    """

    analysis: Tensor
    synthesis: Tensor

    def chain(self, finer: WaveletLevel) -> WaveletLevel:
        """Matrices of this level for a field on the next finer level, without details there."""
        m = self.synthesis.shape[0]
        return WaveletLevel(self.analysis @ finer.analysis[:m], finer.synthesis[:, :m] @ self.synthesis)

    def resample(self, n: int) -> WaveletLevel:
        """Matrices for a field given at n points over the same length, by interpolation."""
        own = self.synthesis.shape[0]
        there, back = interpolation(n, own, self.analysis), interpolation(own, n, self.analysis)
        return WaveletLevel(self.analysis @ there, back @ self.synthesis)


def interpolation(n: int, to: int, like: Tensor) -> Tensor:
    """Matrix of cubic interpolation between uniform grids of an interval, through the nearest four points.

    Points that both grids share keep their values.

    Parameters
    ----------
    n : int
        Points of the given grid, at least 4.
    to : int
        Points of the new grid.
    like : torch.Tensor
        Tensor whose type and device are used.

    Returns
    -------
    torch.Tensor
        Matrix of shape (to, n).

    Examples
    --------
    >>> interpolation(5, 9, torch.zeros(1))[3] @ torch.arange(5.0) ** 3  # at 1.5
    tensor(3.3750)
    """
    nodes, points = torch.arange(4, device=like.device), torch.arange(n, device=like.device)
    at = torch.arange(to, device=like.device).to(like) * (n - 1) / (to - 1)
    first = torch.clamp(at.floor().long() - 1, min=0)
    first = torch.minimum(first, points[-1] - 3)
    distance = (at - first)[:, None] - nodes.to(like)
    others = nodes[:, None] != nodes
    factor = distance[:, None, :] / (nodes[:, None] - nodes + ~others).to(like)
    weight = torch.where(others, factor, torch.ones_like(factor)).prod(-1)
    hit = first[:, None, None] + nodes[:, None] == points
    return (weight[..., None] * hit.to(like)).sum(1)


class Wavelet(nn.Module):
    """Filters of an orthogonal or biorthogonal wavelet, scaled so that coarse values are local means (Σ lo = 1).

    Coefficients of level j are 2^−j times PyWavelets', j = 1 the finest. `name` is one of PyWavelets' discrete
    wavelets. Raises `InputError` for another, `MissingExtra` without PyWavelets.

    >>> wavelet = Wavelet("db2")
    >>> x = torch.sin(torch.arange(51.0))[:, None] * torch.cos(torch.arange(64.0))
    >>> mean, details = wavelet.decompose(x[..., None, None], wavelet.levels(51, 64, 2))
    >>> tuple(mean.shape), [tuple(d.shape) for d in details]
    ((15, 18, 1, 1), [(1, 3, 27, 33), (1, 3, 15, 18)])
    """

    decomposing: Tensor
    composing: Tensor

    def __init__(self, name: str = "db2") -> None:
        super().__init__()
        pywt = require("pywt", "train")
        known = pywt.wavelist(kind="discrete")
        if name not in known:
            raise InputError("wavelet", repr(name), nearest(name, known))
        bank = torch.tensor(pywt.Wavelet(name).filter_bank, dtype=torch.float64)
        self.register_buffer("decomposing", (bank[:2] / 2**0.5).float(), persistent=False)
        self.register_buffer("composing", (bank[2:] * 2**0.5).float(), persistent=False)

    def axis(self, n: int) -> WaveletLevel:
        """Matrices for n points along an axis.

        Mean i is Σ_k lo_k x(2i + 1 − k); sample j is Σ_i lo′_(j − 2i + L − 2) mean_i, and the same of the details.
        """
        length, device = self.decomposing.shape[1], self.decomposing.device
        taps, samples = torch.arange(length, device=device), torch.arange(n, device=device)
        coarse = torch.arange((n + length - 1) // 2, device=device)
        seen = (2 * coarse[:, None] + 1 - taps) % (2 * n)
        seen = torch.minimum(seen, 2 * n - 1 - seen)
        hit = (seen[..., None] == samples).to(self.decomposing)  # mean, tap, sample
        tap = samples[:, None] - 2 * coarse + length - 2
        used = (tap[..., None] == taps).to(self.composing)  # sample, mean, tap
        return WaveletLevel(
            torch.cat([(f[:, None] * hit).sum(1) for f in self.decomposing.unbind()]),
            torch.cat([(f * used).sum(2) for f in self.composing.unbind()], 1),
        )

    def levels(self, ny: int, nx: int, count: int) -> list[tuple[WaveletLevel, WaveletLevel]]:
        """Matrices along y and x of the levels 1 … count.

        Parameters
        ----------
        ny, nx : int
            Points of the grid along y and x.
        count : int
            Number of levels.

        Returns
        -------
        list of tuple of (WaveletLevel, WaveletLevel)
            Matrices along y and x of each level.
        """
        found = []
        for _ in range(count):
            y, x = self.axis(ny), self.axis(nx)
            found.append((y, x))
            ny, nx = y.synthesis.shape[1] // 2, x.synthesis.shape[1] // 2
        return found

    @staticmethod
    def split(x: Tensor, level: tuple[WaveletLevel, WaveletLevel]) -> tuple[Tensor, Tensor]:
        """One level of the transform.

        Parameters
        ----------
        x : torch.Tensor
            Field, of shape (ny, nx, batch, c).
        level : tuple of (WaveletLevel, WaveletLevel)
            Matrices along y and x.

        Returns
        -------
        tuple of (torch.Tensor, torch.Tensor)
            Means (my, mx, batch, c), and details (batch, 3c, my, mx) along y, x and both.
        """
        along_y, along_x = level
        my, mx = along_y.analysis.shape[0] // 2, along_x.analysis.shape[0] // 2
        ny, nx, batch, c = x.shape
        half = (along_y.analysis @ x.reshape(ny, -1)).reshape(2 * my, nx, -1)
        low, high = (along_x.analysis @ half.transpose(0, 1).reshape(nx, -1)).reshape(2, mx, 2, my, batch, c).unbind(0)
        (mean, y_detail), (x_detail, both) = low.unbind(1), high.unbind(1)
        details = torch.cat([d.permute(2, 1, 0, 3) for d in (y_detail, x_detail, both)], -1)
        return mean.transpose(0, 1), details.permute(0, 3, 1, 2)

    @staticmethod
    def join(mean: Tensor, details: Tensor, level: tuple[WaveletLevel, WaveletLevel]) -> Tensor:
        """Inverse of `split`.

        Parameters
        ----------
        mean : torch.Tensor
            Means, of shape (my, mx, batch, c).
        details : torch.Tensor
            Details, of shape (batch, 3c, my, mx).
        level : tuple of (WaveletLevel, WaveletLevel)
            Matrices along y and x.

        Returns
        -------
        torch.Tensor
            Field, of shape (ny, nx, batch, c).
        """
        along_y, along_x = level
        my, mx, batch, c = mean.shape
        y_detail, x_detail, both = (d.permute(3, 2, 0, 1) for d in details.chunk(3, 1))
        low, high = torch.cat([mean.transpose(0, 1), y_detail], 1), torch.cat([x_detail, both], 1)
        half = (along_x.synthesis @ torch.cat([low, high]).reshape(2 * mx, -1)).reshape(-1, 2 * my, batch * c)
        return (along_y.synthesis @ half.transpose(0, 1).reshape(2 * my, -1)).reshape(-1, half.shape[0], batch, c)

    @classmethod
    def decompose(cls, x: Tensor, levels: list[tuple[WaveletLevel, WaveletLevel]]) -> tuple[Tensor, list[Tensor]]:
        """Transform of (ny, nx, batch, c): coarsest means, and details of the levels, the finest first."""
        details = []
        for level in levels:
            x, d = cls.split(x, level)
            details.append(d)
        return x, details

    @classmethod
    def compose(cls, mean: Tensor, details: list[Tensor], levels: list[tuple[WaveletLevel, WaveletLevel]]) -> Tensor:
        """Inverse of `decompose`."""
        for d, level in zip(reversed(details), reversed(levels), strict=True):
            mean = cls.join(mean, d, level)
        return mean
