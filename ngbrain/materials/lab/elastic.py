"""Stress and ellipticity of elastic laws in homogeneous tests."""

from __future__ import annotations

import ngsolve as ngs
import numpy as np
from numpy.typing import ArrayLike

from ngbrain.materials.base import Deformation, Law, density
from ngbrain.materials.lab.modes import find_mode
from ngbrain.materials.lab.specimen import Specimen, check_elastic, warn_beyond
from ngbrain.materials.points import Points


def stress(law: Law, mode: str, stretches: ArrayLike) -> np.ndarray:
    """Nominal stress of an incompressible body with free lateral surfaces.

    F = [[λ, a, b], [0, l, c], [0, 0, 1/(λ l)]] in uniaxial tests, where l, a, b, c minimise the energy; so do b and
    c in the equibiaxial [[λ, 0, b], [0, λ, c], [0, 0, 1/λ²]] and the planar [[λ, 0, b], [0, 1, c], [0, 0, 1/λ]]. A
    law of the catalogue warns once beyond the stretches of its data (`RangeWarning`); a shear γ counts as 1 ± γ/2.

    Parameters
    ----------
    law : Law
        Elastic law.
    mode : str
        "uniaxial", "equibiaxial" (P₁₁), "planar" (no strain along 2) or "shear" (P₁₂, of F = 1 + γ e₁⊗e₂).
    stretches : array_like
        λ along 1 (> 0), or the amounts of shear γ.

    Returns
    -------
    numpy.ndarray
        Nominal stress (Pa), of the shape of `stretches`.

    Raises
    ------
    InputError
        An unknown mode, inadmissible stretches, or a stretch at which the law has no finite energy.
    ConvergenceError
        No equilibrium is found.

    Examples
    --------
    >>> from ngbrain.materials import NeoHooke
    >>> stress(NeoHooke(mu=1000.0), "uniaxial", [0.5, 1.0, 2.0])
    array([-3500.,     0.,  1750.])
    """
    test = find_mode(mode)
    values = test.check_stretches(stretches)
    specimen = Specimen.from_law(law, test, values.size)
    warn_beyond(law, test, values)
    specimen.stretch_to(values.ravel())
    return specimen.stress.reshape(values.shape)


def ellipticity(law: Law, mode: str, stretches: ArrayLike) -> np.ndarray:
    """Smallest eigenvalue of the acoustic tensor over all directions, in a homogeneous test.

    Q(n)_ik = A_iJkL (Fᵀn)_J (Fᵀn)_L with A = ∂²W/∂F∂F and |n| = 1, restricted to amplitudes perpendicular to n,
    where the pressure drops out. The value is ρc² of the slowest plane wave: > 0 is strong ellipticity, ≤ 0 its
    loss (shear bands, no convergence under refinement).

    Parameters
    ----------
    law : Law
        Elastic law.
    mode : str
        As for `stress`.
    stretches : array_like
        As for `stress`.

    Returns
    -------
    numpy.ndarray
        Eigenvalue (Pa), of the shape of `stretches`.

    References
    ----------
    Zee & Sternberg 1983, Archive for Rational Mechanics and Analysis 83, 53-90.

    Examples
    --------
    >>> from ngbrain.materials import NeoHooke
    >>> round(float(ellipticity(NeoHooke(1000.0), "planar", 2.0)), 6)
    250.0
    """
    test = find_mode(mode)
    values = test.check_stretches(stretches)
    specimen = Specimen.from_law(law, test, values.size)
    specimen.stretch_to(values.ravel())
    return smallest_acoustic_eigenvalue(law, specimen.deformation_gradient()[0]).reshape(values.shape)


def smallest_acoustic_eigenvalue(law: Law, F: np.ndarray) -> np.ndarray:
    """Smallest eigenvalue of the acoustic tensor over all directions, at any isochoric deformation; see `ellipticity`.

    Parameters
    ----------
    law : Law
        Elastic law.
    F : numpy.ndarray of shape (n, 3, 3)
        Deformation gradients of determinant 1.

    Returns
    -------
    numpy.ndarray of shape (n,)
        Eigenvalue (Pa).

    Examples
    --------
    >>> from ngbrain.materials import NeoHooke
    >>> round(float(smallest_acoustic_eigenvalue(NeoHooke(1000.0), np.diag([2.0, 1.0, 0.5])[None])[0]), 6)
    250.0
    """
    return _slowest(_moduli(law, F), F)


def _moduli(law: Law, F: np.ndarray) -> np.ndarray:
    """A_iJkL (Pa), shape (n, 3, 3, 3, 3), at given F (n, 3, 3)."""
    check_elastic(law)
    points = Points.line(len(F))
    field = points.field(F.reshape(-1, 9).T)
    entries = ngs.CF(tuple(field[i] for i in range(9))).MakeVariable()
    gradient = ngs.CF(tuple(entries[i] for i in range(9)), dims=(3, 3))
    C = gradient.trans * gradient
    # A rank-one change a⊗N with a ⟂ F⁻ᵀN keeps det F: no isochoric split is needed.
    energy = density(law, Deformation(C, C, ngs.CF(1.0), gradient))
    return points(energy.Diff(entries).Diff(entries).Compile()).T.reshape(-1, 3, 3, 3, 3)


def _slowest(A: np.ndarray, F: np.ndarray, directions: int = 400, rounds: int = 24) -> np.ndarray:
    """Minimum over a half sphere: a spiral of directions, then ever smaller rings around the best of them."""
    n = np.broadcast_to(_spiral(directions), (len(F), directions, 3))
    radius = 2 * np.sqrt(2 * np.pi / directions)
    ring = np.array([[np.cos(a), np.sin(a)] for a in np.arange(12) * np.pi / 6])
    ring = np.concatenate([[[0, 0]], ring / 2, ring])
    for _ in range(rounds):
        values = _smallest(A, F, n)
        best = np.take_along_axis(n, values.argmin(axis=1)[:, None, None], axis=1)[:, 0]
        n = best[:, None] + radius * np.einsum("ka,nai->nki", ring, _across(best))
        n = n / np.linalg.norm(n, axis=2, keepdims=True)
        radius /= 2
    return _smallest(A, F, n).min(axis=1)


def _smallest(A: np.ndarray, F: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Smaller eigenvalue of Q(n) across n, shape (points, directions)."""
    m = np.einsum("pji,pdj->pdi", F, n)
    t = _across(n)
    Q = np.einsum("piJkL,pdJ,pdL->pdik", A, m, m, optimize=True)
    q = np.einsum("pdai,pdij,pdbj->pdab", t, Q, t, optimize=True)
    mean, half = (q[..., 0, 0] + q[..., 1, 1]) / 2, (q[..., 0, 0] - q[..., 1, 1]) / 2
    return mean - np.hypot(half, q[..., 0, 1])


def _spiral(count: int) -> np.ndarray:
    """Evenly spread directions on a half sphere, shape (count, 3)."""
    z = (np.arange(count) + 0.5) / count
    angle = np.pi * (1 + 5**0.5) * np.arange(count)
    return np.stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z], axis=1)


def _across(n: np.ndarray) -> np.ndarray:
    """Two unit vectors perpendicular to each n: shape (…, 3) to (…, 2, 3)."""
    axis = np.eye(3)[np.abs(n).argmin(axis=-1)]
    first = np.cross(n, axis)
    first = first / np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(n, first)], axis=-2)
