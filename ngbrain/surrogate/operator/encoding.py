"""Input channels and targets of the operator, in dimensionless form.

Lengths are in edges of the square, moduli in ρω²L² (waves) or in their mean (compression), so that one operator
serves all sizes, frequencies and densities that are dynamically similar. Derivatives are those of local polynomials
in windows of a fixed fraction of the edge (`derivatives`), so that they have the same meaning on every grid.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.linalg import solve_triangular

from ngbrain.errors import InputError, nearest
from ngbrain.surrogate.operator.derivatives import DEGREE, derivative_matrix, partial_derivative, partial_derivatives

Array = np.ndarray
SMALL, FINEST = 0.1, 0.04
"""Half widths of the windows of local polynomials, in edges."""
PATCHES, COARSE = 10, 2.8
"""Patches along an edge, see `estimate_jump`; and the power of the distance between points with which it grows on
coarse grids: for 99 % of the waves of the validation the value is below 4.4 % of the rms on 51 × 51 points, 31 %
on 26 × 26.
"""
CURLS = ((0.1, 5, 0.1), (0.1, 5, 0.06), (0.16, 7, 0.06), (0.22, 7, 0.1))
LAPLACIANS = ((0.1, 5, 0.1), (0.16, 5, 0.1))
"""Half window, degree of the polynomial in it, and half window of the sums of the ratio. At 1 % noise the first
serves waves of a third of the edge best, the last those of an edge: the moduli of single points are then off by
3 and 6 %.
"""
OF_SLOPES, OF_CURLS, OF_LAPLACIANS = ((1, 0), (0, 1)), ((1, 0), (3, 0), (1, 2)), ((2, 0), (0, 2))
"""Orders of differentiation along x and y of these quantities, for either component: for u_x with x and y exchanged."""
LEAST, MOST = 1e-4, 1.0
"""Range to which ratios are clipped before the logarithm."""
NOISE = (0.003, 0.03)
"""Range of relative noise in the training; less noisy fields count as the lowest."""
GRAIN, FLAT = 0.03, 0.5
"""Longest correlation length of ultrasound noise across the beam, in edges, and the ratio of that along the beam to
it. Errors of speckle tracking are correlated over the resolution cell, about .87 λ z/D across (Wagner et al.
1983, 10.1109/T-SU.1983.31404): 1.1 mm at 5 MHz and z/D = 4, in a square of 40 mm.
"""
STEEP = 1.5
"""Largest phase angle (rad) of a local modulus estimate; larger ones are clipped."""


@dataclass(frozen=True)
class Modality:
    """Input and output of the operator for one kind of data.

    Parameters
    ----------
    name : str
        "waves" or "compression".
    channels : int
        Number of input channels.
    answers : tuple of str
        Names of the output quantities.
    estimates : tuple of int, default ()
        Input channels that are first estimates of the output, if any.
    grain : float, default 0.0
        Longest correlation length of the noise in the training, in edges.
    """

    name: str
    channels: int
    answers: tuple[str, ...]
    estimates: tuple[int, ...] = ()
    grain: float = 0.0

    def features(self, u: Array, poisson: Array) -> Array:
        """Input channels of displacement fields.

        Parameters
        ----------
        u : numpy.ndarray of shape (batch, n, n, components)
            Displacement, y first.
        poisson : numpy.ndarray of shape (batch)
            Poisson's ratio.

        Returns
        -------
        numpy.ndarray of shape (batch, channels, n, n)
            Input channels, float32.
        """
        n, of = u.shape[1], _wave_channels if self.name == "waves" else _compression_channels
        found = np.empty((len(u), self.channels, n, n), np.float32)
        for channels, each in zip(found, u[:, None], strict=True):  # field by field, which stays in the CPU cache
            channels[:-4] = np.concatenate(of(each))
        found[:, -4] = np.linspace(-1, 1, n)
        found[:, -3] = found[:, -4].swapaxes(1, 2)
        numbers = np.stack([1 - 2 * poisson, np.maximum(estimate_noise(u), NOISE[0])], axis=1)
        found[:, -2:] = np.log10(numbers)[..., None, None]
        return found

    def targets(self, storage: Array, loss: Array, unit: Array) -> Array:
        """Targets: ln of the modulus in its unit, and for waves G″/G′.

        Parameters
        ----------
        storage, loss : numpy.ndarray of shape (batch, n, n)
            Moduli (Pa).
        unit : numpy.ndarray of shape (batch)
            Unit of the modulus, see `unit`.

        Returns
        -------
        numpy.ndarray of shape (batch, answers, n, n)
            Targets.
        """
        first = np.log(storage / unit[:, None, None])
        both = [first, loss / storage] if self.name == "waves" else [first]
        return np.stack(both, axis=1).astype(np.float32)

    def add_noise(self, u: Array, noise: Array, random: np.random.Generator) -> Array:
        """Add noise as in the training: for ultrasound, half of the fields have correlated noise of random correlation length.

        Parameters
        ----------
        u : numpy.ndarray of shape (batch, n, n, components)
            Displacement.
        noise : numpy.ndarray of shape (batch)
            Relative noise.
        random : np.random.Generator
            Random numbers.

        Returns
        -------
        numpy.ndarray
            Noisy displacement.
        """
        grain = self.grain * np.maximum(random.uniform(-1, 1, len(u)), 0) if self.grain else None
        return add_noise(u, noise, random, grain)

    def unit(self, storage: Array, frequency: Array, density: float, side: float) -> Array:
        """Unit of the modulus (Pa): ρω²L², or the mean of E, which compression cannot determine.

        Parameters
        ----------
        storage : numpy.ndarray of shape (batch, n, n)
            Modulus (Pa).
        frequency : numpy.ndarray of shape (batch)
            Frequency (Hz).
        density : float
            Density (kg/m³).
        side : float
            Edge L (m).

        Returns
        -------
        numpy.ndarray of shape (batch,)
            Unit (Pa).
        """
        if self.name == "waves":
            return density * (2 * np.pi * frequency * side) ** 2
        return np.asarray(storage.mean(axis=(1, 2)))


MODALITIES = {
    "waves": Modality("waves", 28, ("storage", "loss"), (12, 13)),
    "compression": Modality("compression", 10, ("youngs",), grain=GRAIN),
}


def modality(name: str) -> Modality:
    """One of `MODALITIES`; raises `InputError` for another name.

    >>> modality("waves").answers
    ('storage', 'loss')
    """
    if name not in MODALITIES:
        raise InputError("modality", repr(name), nearest(name, list(MODALITIES)))
    return MODALITIES[name]


def estimate_noise(u: Array) -> Array:
    """Noise (batch,) of fields (batch, n, n, components): residual of a local cubic fit, relative to the rms
    without the affine part.

    It is a median over the points, so that edges of tissue do not count as noise, scaled to the standard deviation
    of white noise.
    """
    off, n = _cubic_residuals(u), u.shape[1]
    kept = float((((np.eye(n) - derivative_matrix(n, FINEST, 0, 3)) ** 2).sum(axis=1)).mean())
    kept = 2 * kept - kept**2 if kept < 1 else 1.0
    sizes = np.median(np.abs(off), axis=(-2, -1)) / 0.6745
    total = np.sqrt((sizes**2).sum(axis=0) / kept)
    scale = np.sqrt((np.abs(remove_affine(u)) ** 2).mean(axis=(1, 2)))
    return np.asarray((total.T / np.maximum(scale, 1e-300)).mean(axis=-1))


def estimate_jump(u: Array) -> Array:
    """Discontinuity of fields (batch, n, n, components): residual of a local cubic fit in the worst patch, relative to the rms.

    Displacements are continuous, so a cubic fits edges of tissue almost exactly. The seam between two scans, or the
    border of a phase-wrapped patch, leaves a residual of the size of the jump. A cubic needs five points along each
    axis: on grids where these reach farther than `FINEST` it leaves a larger residual of correct data too, for
    which the value is reduced.

    >>> y, x = np.meshgrid(*2 * (np.linspace(0, 1, 51),), indexing="ij")
    >>> wave = np.cos(9 * y)[None, ..., None]
    >>> torn = np.where(x < 0.5, np.cos(9 * y), np.sin(9 * y))[None, ..., None]
    >>> [round(float(estimate_jump(each)[0]), 3) for each in (wave, torn)]
    [0.0, 0.35]
    """
    off, n = _cubic_residuals(u), u.shape[1]
    scale = (np.abs(remove_affine(u)) ** 2).mean(axis=(1, 2, 3))  # of all components: one may hardly move
    squares = (off**2).sum(axis=0).mean(axis=0) / np.maximum(scale, 1e-300)[:, None, None]
    across = max(3, round(n / PATCHES))
    patches = np.lib.stride_tricks.sliding_window_view(squares, (across, across), axis=(1, 2)).mean(axis=(3, 4))
    coarse = min(1.0, FINEST * (n - 1) / 2) ** COARSE
    return np.asarray(coarse * np.sqrt(patches.max(axis=(1, 2))))


def _cubic_residuals(u: Array) -> Array:
    """Residuals of local cubics of fields (batch, n, n, components): (parts, components, batch, n, n), real and
    imaginary parts.
    """
    fields = u.transpose(3, 0, 1, 2)
    parts = np.stack([fields.real, fields.imag] if np.iscomplexobj(u) else [fields])
    return np.asarray(parts - partial_derivative(parts, FINEST, 0, 0, 3))


def remove_affine(u: Array) -> Array:
    """Fields (batch, n, n, components) without their least-squares affine part a + bx + cy."""
    return u - _affine(u)[0]


def add_noise(u: Array, noise: Array, random: np.random.Generator, grain: Array | None = None) -> Array:
    """Add Gaussian noise η = σ · rms(component without its affine part) · (a + ib)/√2 to fields; real data take a alone.

    Parameters
    ----------
    u : numpy.ndarray of shape (batch, n, n, components)
        Fields.
    noise : numpy.ndarray of shape (batch)
        Relative noise σ.
    random : np.random.Generator
        Random numbers.
    grain : numpy.ndarray of shape (batch), optional
        Correlation length g in edges: a has the correlation exp(-(x/g)² - (y/`FLAT` g)²) of speckle; white noise
        where g = 0.

    Returns
    -------
    numpy.ndarray
        Noisy fields.
    """
    rms = np.sqrt((np.abs(remove_affine(u)) ** 2).mean(axis=(1, 2), keepdims=True))
    a = random.standard_normal(u.shape)
    if np.iscomplexobj(u):
        a = (a + 1j * random.standard_normal(u.shape)) / np.sqrt(2)
    if grain is not None:
        along_y, along_x = (_blur(u.shape[1], each)[:, None] for each in (FLAT * grain, grain))
        a = (along_y @ a.transpose(0, 3, 1, 2) @ along_x.swapaxes(-1, -2)).transpose(0, 2, 3, 1)
    return np.asarray(u + noise[:, None, None, None] * rms * a)


def _blur(n: int, reach: Array) -> Array:
    """Gaussian filters (batch, n, n) that preserve the variance of white noise and correlate it over `reach` (batch,)."""
    x = np.linspace(0, 1, n)
    rows = np.exp(-2 * ((x[:, None] - x) / np.maximum(reach, 1e-9)[:, None, None]) ** 2)
    return np.asarray(rows / np.sqrt((rows**2).sum(axis=2, keepdims=True)))


def relative_errors(mean: Array, targets: Array) -> Array:
    """Relative L² error of each modulus of each sample, ‖found - true‖/‖true‖.

    Parameters
    ----------
    mean : numpy.ndarray of shape (batch, answers, n, n)
        Predicted targets.
    targets : numpy.ndarray of shape (batch, answers, n, n)
        True targets.

    Returns
    -------
    numpy.ndarray of shape (batch, answers)
        Errors; that of the loss modulus is relative to the loss modulus, NaN where there is none.
    """
    found, true = np.exp(mean[:, :1]), np.exp(targets[:, :1])
    if targets.shape[1] == 2:
        found, true = (np.concatenate([m, m * t[:, 1:]], axis=1) for m, t in ((found, mean), (true, targets)))
    size = np.sqrt((true**2).sum(axis=(2, 3)))
    off = np.sqrt(((found - true) ** 2).sum(axis=(2, 3)))
    return np.where(size > 0, off / np.where(size > 0, size, 1), np.nan)


def _affine(u: Array) -> tuple[Array, Array]:
    """Least-squares affine part a + bx + cy of fields, and its coefficients (3, batch, components) on the unit square."""
    n = u.shape[1]
    q, r = _planes(n)
    along = q.T @ u.transpose(1, 2, 0, 3).reshape(n * n, -1)
    fitted = (q @ along).reshape(n, n, len(u), -1).transpose(2, 0, 1, 3)
    return fitted, solve_triangular(r, along).reshape(3, len(u), -1)


@cache
def _planes(n: int) -> tuple[Array, Array]:
    """Orthonormal basis of the affine functions (n², 3), and 1, x and y in that basis (3, 3)."""
    y, x = np.meshgrid(*2 * (np.linspace(0, 1, n),), indexing="ij")
    q, r = np.linalg.qr(np.column_stack([np.ones(n * n), x.ravel(), y.ravel()]))
    return q, r


def _wave_channels(u: Array) -> list[Array]:
    """Real and imaginary parts of u and its gradient, and local estimates of the modulus from the Helmholtz
    equation of curl and of u.
    """
    fields = u.transpose(3, 0, 1, 2) / np.sqrt((np.abs(u) ** 2).mean(axis=(1, 2, 3)))[:, None, None]
    parts = np.stack([fields.real, fields.imag])
    found = _derivatives(np.stack([_mirror(parts[:, 0]), parts[:, 1]]))
    plain = found[SMALL, DEGREE]
    slopes = np.stack([*(_mirror(plain[way][0]) for way in OF_SLOPES[::-1]), *(plain[way][1] for way in OF_SLOPES)])
    slopes = slopes / np.sqrt((slopes**2).sum(axis=1).mean(axis=(0, 2, 3)))[:, None, None]
    estimates = []
    for half, degree, _ in CURLS:
        curl, third, mixed = (found[half, degree][way] for way in OF_CURLS)
        bent = third + mixed
        estimates.append(_products(curl[1] - _mirror(curl[0]), bent[1] - _mirror(bent[0])))
    for half, degree, _ in LAPLACIANS:
        along_x, along_y = (found[half, degree][way] for way in OF_LAPLACIANS)
        bent = along_x + along_y
        estimates.append(_products(parts[:, 0], _mirror(bent[0])) + _products(parts[:, 1], bent[1]))
    both = (each for way in (parts.swapaxes(0, 1), slopes) for each in way.reshape(-1, *u.shape[:3]))
    return [*both, *_moduli(estimates)]


def _derivatives(fields: Array) -> dict[tuple[float, int], dict[tuple[int, int], Array]]:
    """Derivatives that `_wave_channels` needs, by half window and degree."""
    ways: dict[tuple[float, int], dict[tuple[int, int], None]] = {(SMALL, DEGREE): dict.fromkeys(OF_SLOPES)}
    for settings, needed in ((CURLS, OF_CURLS), (LAPLACIANS, OF_LAPLACIANS)):
        for half, degree, _ in settings:
            ways.setdefault((half, degree), {}).update(dict.fromkeys(needed))
    return {key: partial_derivatives(fields, key[0], orders, key[1]) for key, orders in ways.items()}


def _mirror(field: Array) -> Array:
    return field.swapaxes(-1, -2)


def _products(q: Array, bent: Array) -> Array:
    """|q|² and real and imaginary part of conj(q) ∇²q, of parts (2, …)."""
    return np.stack([(q**2).sum(axis=0), (q * bent).sum(axis=0), q[0] * bent[1] - q[1] * bent[0]])


def _moduli(estimates: list[Array]) -> list[Array]:
    """ln |r| and arg r of r = -Σ |q|² / Σ conj(q) ∇²q over windows: least squares for 1/r, as the noise is in ∇²q
    rather than in q.
    """
    arounds = [around for *_, around in (*CURLS, *LAPLACIANS)]
    made: dict[int, list[Array]] = {}
    for around in set(arounds):
        own = [i for i, each in enumerate(arounds) if each == around]
        above, real, imaginary = partial_derivative(np.stack([estimates[i] for i in own], axis=1), around, 0, 0, 0)
        size = above / np.maximum(np.sqrt(real**2 + imaginary**2), 1e-300)
        size, angle = np.log(np.clip(size, LEAST, MOST)), np.clip(np.arctan2(imaginary, -real), -STEEP, STEEP)
        made |= {i: [size[k], angle[k]] for k, i in enumerate(own)}
    return [each for i in range(len(estimates)) for each in made[i]]


def _compression_channels(u: Array) -> list[Array]:
    """The axial displacement without its affine part, and its axial and lateral derivatives, all divided by the mean strain."""
    affine, (_, _, strain) = _affine(u)
    mean = strain[:, 0, None, None]
    axial = u[..., 0]
    along = [partial_derivative(axial, half, 0, 1, 3) / mean for half in (FINEST, SMALL)]
    across = partial_derivative(axial, SMALL, 1, 0, 3) / mean
    return [20 * (axial - affine[..., 0]) / mean, *along, *(np.log(np.maximum(each, 0.02)) for each in along), across]
