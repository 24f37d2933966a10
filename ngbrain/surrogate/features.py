"""What the operator sees of a displacement field, and what its answers mean: the way in and the way out, without units.

Lengths are in edges of the square, moduli in ρω²L² (waves) or in their mean (compression), so that one operator serves all
sizes, frequencies and densities that come to the same. Derivatives are those of local polynomials in windows of a fixed part of
the edge (Savitzky and Golay 1964, 10.1021/ac60214a047), so that they mean the same on every grid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.signal import savgol_coeffs

from ngbrain.errors import InputError, nearest

Array = np.ndarray
SMALL, FINEST = 0.1, 0.04
"""Half a window's width, in edges."""
DEGREE = 5
CURLS = ((0.1, 5, 0.1), (0.1, 5, 0.06), (0.16, 7, 0.06), (0.22, 7, 0.1))
LAPLACIANS = ((0.1, 5, 0.1), (0.16, 5, 0.1))
"""Half a window, the polynomial's degree in it, and half the window of the ratio's sums. At 1 % noise the first serves waves of a
third of the edge best, the last those of an edge: the moduli of single points are then off by 3 and 6 %."""
LEAST, MOST = 1e-4, 1.0
"""Of what logarithms are taken."""
NOISE = (0.003, 0.03)
"""What operators are trained with; cleaner fields count as that noisy."""
STEEP = 1.5
"""Most of a phase (rad) that is believed."""


@dataclass(frozen=True)
class Modality:
    """How the operator looks at one kind of data.

    channels   in
    answers    names of what comes out
    estimates  channels that are first estimates of the answers, if there are any
    """

    name: str
    channels: int
    answers: tuple[str, ...]
    estimates: tuple[int, ...] = ()

    def features(self, u: Array, poisson: Array) -> Array:
        """Displacement (batch, n, n, components), first axis y, and ν (batch,) as channels (batch, channels, n, n), float32."""
        made = _of_waves(u) if self.name == "waves" else _of_compression(u)
        n = u.shape[1]
        line = np.broadcast_to(np.linspace(-1, 1, n), (len(u), n, n))
        softness = np.broadcast_to(np.log10(1 - 2 * poisson)[:, None, None], (len(u), n, n))
        noise = np.broadcast_to(np.log10(np.maximum(noise_of(u), NOISE[0]))[:, None, None], (len(u), n, n))
        return np.stack([*made, line, line.transpose(0, 2, 1), softness, noise], axis=1).astype(np.float32)

    def targets(self, storage: Array, loss: Array, unit: Array) -> Array:
        """ln of the modulus in its unit, and for waves G″/G′: (batch, answers, n, n)."""
        first = np.log(storage / unit[:, None, None])
        both = [first, loss / storage] if self.name == "waves" else [first]
        return np.stack(both, axis=1).astype(np.float32)

    def unit(self, storage: Array, frequency: Array, density: float, side: float) -> Array:
        """Of moduli (batch,), Pa: ρω²L², or the mean of E, which compression alone does not know."""
        if self.name == "waves":
            return density * (2 * np.pi * frequency * side) ** 2
        return np.asarray(storage.mean(axis=(1, 2)))


MODALITIES = {
    "waves": Modality("waves", 28, ("storage", "loss"), (12, 13)),
    "compression": Modality("compression", 10, ("youngs",)),
}


def modality(name: str) -> Modality:
    """One of `MODALITIES`; `InputError` for another name.

    >>> modality("waves").answers
    ('storage', 'loss')
    """
    if name not in MODALITIES:
        raise InputError("modality", repr(name), nearest(name, list(MODALITIES)))
    return MODALITIES[name]


@cache
def derivative(n: int, half: float, order: int, degree: int = DEGREE) -> Array:
    """The matrix (n, n) that takes values on a line of length 1 to their derivative of an order; at the ends windows stay inside.

    >>> x = np.linspace(0, 1, 51)
    >>> float(np.abs(derivative(51, 0.1, 2) @ x**4 - 12 * x**2).max()) < 1e-6
    True
    """
    reach = max(round(half * (n - 1)), (degree + 1) // 2)
    width = min(2 * reach + 1, n - 1 + n % 2)
    matrix = np.zeros((n, n))
    for i in range(n):
        first = min(max(i - width // 2, 0), n - width)
        matrix[i, first : first + width] = savgol_coeffs(
            width, degree, order, delta=1 / (n - 1), pos=i - first, use="dot"
        )
    return matrix


def partial(u: Array, half: float, along_x: int, along_y: int, degree: int = DEGREE) -> Array:
    """∂^(along_x + along_y) u of fields (…, n, n), first axis y."""
    if np.iscomplexobj(u):  # real matrices are not made complex for it
        parts = partial(np.stack([u.real, u.imag]), half, along_x, along_y, degree)
        return np.asarray(parts[0] + 1j * parts[1])
    n = u.shape[-1]
    return derivative(n, half, along_y, degree) @ u @ derivative(n, half, along_x, degree).T


def noise_of(u: Array) -> Array:
    """Noise (batch,) of fields (batch, n, n, components), relative to their rms without the affine part: what a local cubic leaves.

    Median over the points, so that edges of tissue do not count as noise; the size of its parts is that of white noise.
    """
    fields = u.transpose(0, 3, 1, 2)
    off = fields - partial(fields, FINEST, 0, 0, 3)
    n = u.shape[1]
    kept = float((((np.eye(n) - derivative(n, FINEST, 0, 3)) ** 2).sum(axis=1)).mean())
    kept = 2 * kept - kept**2 if kept < 1 else 1.0
    parts = np.abs(np.stack([off.real, off.imag]) if np.iscomplexobj(u) else off[None])
    sizes = np.median(parts, axis=(-2, -1)) / 0.6745
    total = np.sqrt((sizes**2).sum(axis=0) / kept)
    scale = np.sqrt((np.abs(without_affine(u)) ** 2).mean(axis=(1, 2)))
    return np.asarray((total / np.maximum(scale, 1e-300)).mean(axis=-1))


def without_affine(u: Array) -> Array:
    """Fields (batch, n, n, components) less their best a + bx + cy."""
    return u - _affine(u)[0]


def spoilt(u: Array, noise: Array, random: np.random.Generator) -> Array:
    """Fields (batch, n, n, components) plus η = σ · rms(component without its affine part) · (a + ib)/√2; real data take a alone.

    noise  σ (batch,)
    """
    rms = np.sqrt((np.abs(without_affine(u)) ** 2).mean(axis=(1, 2), keepdims=True))
    a = random.standard_normal(u.shape)
    if np.iscomplexobj(u):
        a = (a + 1j * random.standard_normal(u.shape)) / np.sqrt(2)
    return np.asarray(u + noise[:, None, None, None] * rms * a)


def errors(mean: Array, targets: Array) -> Array:
    """‖found - true‖/‖true‖ of each modulus of each sample: (batch, answers). Loss is that of its own, NaN where there is none."""
    found, true = np.exp(mean[:, :1]), np.exp(targets[:, :1])
    if targets.shape[1] == 2:
        found, true = (np.concatenate([m, m * t[:, 1:]], axis=1) for m, t in ((found, mean), (true, targets)))
    size = np.sqrt((true**2).sum(axis=(2, 3)))
    off = np.sqrt(((found - true) ** 2).sum(axis=(2, 3)))
    return np.where(size > 0, off / np.where(size > 0, size, 1), np.nan)


def _affine(u: Array) -> tuple[Array, Array]:
    """Best a + bx + cy of fields, and the coefficients (3, batch, components) on the unit square."""
    n = u.shape[1]
    y, x = np.meshgrid(*2 * (np.linspace(0, 1, n),), indexing="ij")
    basis = np.column_stack([np.ones(n * n), x.ravel(), y.ravel()])
    flat = u.transpose(1, 2, 0, 3).reshape(n * n, -1)
    found = np.linalg.lstsq(basis, flat, rcond=None)[0]
    return (basis @ found).reshape(n, n, len(u), -1).transpose(2, 0, 1, 3), found.reshape(3, len(u), -1)


def _of_waves(u: Array) -> list[Array]:
    """Parts of u and its gradient, and the modulus that waves would tell where it was uniform: from their curl, and from all."""
    fields = u.transpose(3, 0, 1, 2) / np.sqrt((np.abs(u) ** 2).mean(axis=(1, 2, 3)))[:, None, None]
    ux, uy = fields
    slopes = np.stack([partial(each, SMALL, *way) for each in fields for way in ((1, 0), (0, 1))])
    slopes = slopes / np.sqrt((np.abs(slopes) ** 2).mean(axis=(0, 2, 3)))[:, None, None]
    made = [part for each in (*fields, *slopes) for part in (each.real, each.imag)]
    for half, degree, around in CURLS:
        curl = partial(uy, half, 1, 0, degree) - partial(ux, half, 0, 1, degree)
        bent = partial(uy, half, 3, 0, degree) + partial(uy, half, 1, 2, degree)
        bent = bent - partial(ux, half, 2, 1, degree) - partial(ux, half, 0, 3, degree)
        made += _modulus([curl], [bent], around)
    for half, degree, around in LAPLACIANS:
        bends = [partial(each, half, 2, 0, degree) + partial(each, half, 0, 2, degree) for each in fields]
        made += _modulus(fields, bends, around)
    return made


def _modulus(fields: Sequence[Array], bends: Sequence[Array], around: float) -> list[Array]:
    """ln |r| and arg r of r = -Σ |q|² / Σ conj(q) ∇²q over a window: least squares for 1/r, as noise is in ∇²q rather than in q."""
    above = sum(_mean(np.abs(q) ** 2, around) for q in fields)
    below = sum(_mean(np.conj(q) * bent, around) for q, bent in zip(fields, bends, strict=True))
    r = -above / np.where(np.abs(below) > 0, below, 1e-300)
    return [np.log(np.clip(np.abs(r), LEAST, MOST)), np.clip(np.angle(r), -STEEP, STEEP)]


def _mean(field: Array, around: float) -> Array:
    return partial(field, around, 0, 0, 0)


def _of_compression(u: Array) -> list[Array]:
    """The axial displacement less its affine part, and axial and lateral slopes, all over the mean strain."""
    affine, (_, _, strain) = _affine(u)
    mean = strain[:, 0, None, None]
    axial = u[..., 0]
    along = [partial(axial, half, 0, 1, 3) / mean for half in (FINEST, SMALL)]
    across = partial(axial, SMALL, 1, 0, 3) / mean
    return [20 * (axial - affine[..., 0]) / mean, *along, *(np.log(np.maximum(each, 0.02)) for each in along), across]
