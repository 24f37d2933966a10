"""Residuals of the equations of motion for predicted maps, without knowledge of the true ones.

waves        the weak form with test functions v = curl ψ, ψ a bump function of compact support. They are divergence-free, so
             neither the pressure nor the bulk modulus matters, and no system is solved:

                 R(v) = ∫ 2G ε(u):ε(v) - ρω² ∫ u·v = A(v) - M(v),    r² = Σ |R|² / Σ (|A|² + |M|²)

             A bump function that reaches over an edge tests whether that edge is free of traction
compression  one forward solve: the axial displacement is prescribed on the boundary as measured, the misfit taken in the interior

Lengths are in edges of the square, moduli in ρω²L² (waves) or in their mean (compression).
"""

from __future__ import annotations

from functools import cache

import ngsolve as ngs
import numpy as np

from ngbrain.errors import SolverError
from ngbrain.surrogate.data.dataset import SIDES, solve_displacement
from ngbrain.surrogate.operator.derivatives import partial_derivative
from ngbrain.surrogate.operator.encoding import FINEST, NOISE, estimate_noise, remove_affine

Array = np.ndarray
BUMPS = 13
"""Bump functions along an edge, the first and the last at the corners."""
REACH = 2
"""Half width of a bump function, in distances between neighbours: a sixth of the edge. Narrower ones are more
sensitive to noise, wider ones less sensitive to detail.
"""
UNSOLVED = 1e3
"""Upper bound of a residual, also that of a map whose equations cannot be solved."""
SLOPES = 3
"""Degree of the local polynomials whose derivatives are the strains."""


def wave_residual(u: Array, modulus: Array) -> tuple[float, float]:
    """Residual of waves in the interior, and deviation from the boundary conditions of the training data.

    The boundary conditions are one edge moving as a rigid body with the others free. For each candidate edge the
    deviation is the largest of: the deviation of its motion from its mean, relative to the rms; and, for the bump
    functions over each other edge but not over this one, how far A and M are from being proportional, √(1 - |Σ A*
    M|²/Σ |A|² Σ |M|²), as a wrong factor is an error of the modulus there. The result is that of the edge for which
    it is smallest.

    Parameters
    ----------
    u : numpy.ndarray of shape (n, n, 2)
        Displacement, y first, in any unit.
    modulus : numpy.ndarray of shape (n, n)
        Complex modulus G/ρω²L².

    Returns
    -------
    tuple of (float, float)
        Residual r in the interior, and deviation from the boundary conditions.

    Examples
    --------
    >>> y, x = np.meshgrid(*2 * (np.linspace(0, 1, 41),), indexing="ij")
    >>> wave = np.stack([np.cos(9 * y), 0 * y], axis=-1)  # k = 9: G/ρω²L² = 1/81; both edges across it are free at k y = 0 alone
    >>> right, wrong = (wave_residual(wave, np.full((41, 41), g))[0] for g in (1 / 81, 2 / 81))
    >>> right < 0.01, round(wrong, 2)
    (True, 0.45)
    """
    elastic, inertia = virtual_works(u, modulus)
    inner = slice(REACH, -REACH)
    size = (np.abs(u) ** 2).sum(axis=2).mean()
    i, j = np.indices((BUMPS, BUMPS))
    away = [i, BUMPS - 1 - i, j, BUMPS - 1 - j]
    driven = []
    for distance, along in zip(away, (u[0], u[-1], u[:, 0], u[:, -1]), strict=True):
        rigid = np.sqrt((np.abs(along - along.mean(axis=0)) ** 2).sum(axis=1).mean() / size)
        free = [(other == 0) & (distance >= REACH) for other in away if other is not distance]
        driven.append(max(float(rigid), *(_disproportion(elastic[each], inertia[each]) for each in free)))
    return _relative(elastic[inner, inner], inertia[inner, inner]), min(driven)


def virtual_works(u: Array, modulus: Array) -> tuple[Array, Array]:
    """Virtual work of stress and of inertia for all bump functions, with v = (∂ψ/∂y, -∂ψ/∂x).

    Parameters
    ----------
    u : numpy.ndarray of shape (n, n, 2)
        Displacement, y first.
    modulus : numpy.ndarray of shape (n, n)
        Modulus G/ρω²L².

    Returns
    -------
    tuple of (numpy.ndarray, numpy.ndarray)
        A(v) and M(v), each of shape (BUMPS, BUMPS), y first.
    """
    ux, uy = u[..., 0], u[..., 1]
    slope = [[partial_derivative(each, FINEST, *way, SLOPES) for way in ((1, 0), (0, 1))] for each in (ux, uy)]
    (xx, xy), (yx, yy) = slope
    b, db, ddb = _bumps(len(u))
    elastic = 2 * db @ (modulus * (xx - yy)) @ db.T
    elastic += ddb @ (modulus * (xy + yx)) @ b.T - b @ (modulus * (xy + yx)) @ ddb.T
    return elastic, db @ ux @ b.T - b @ uy @ db.T


def compression_residual(u: Array, youngs: Array, poisson: float) -> tuple[float, float]:
    """Misfit of compression in the interior, and deviation of the plates from rigid motion.

    Parameters
    ----------
    u : numpy.ndarray of shape (n, n, 1)
        Axial displacement, y first, in edges of the square.
    youngs : numpy.ndarray of shape (n, n)
        Young's modulus, in any unit.
    poisson : float
        Poisson's ratio.

    Returns
    -------
    tuple of (float, float)
        Misfit relative to the rms of u without its affine part, and the non-uniformity of the motion of the two
        plates relative to the noise (`estimate_noise`, at least the smallest of the training); the latter is 1 for
        rigid plates, whatever the noise.
    """
    n, side = len(u), SIDES["compression"]
    axial = ngs.VoxelCoefficient((0, 0), (side, side), (side * u[..., 0]).astype(complex), linear=True)
    shear = youngs / (2 * (1 + poisson))
    held = {"x": "bottom", "y": ".*"}
    try:
        fitted = solve_displacement(shear, 0.0, poisson, {".*": ngs.CF((0, axial))}, n, held, side)[..., 1].real / side
    except SolverError:  # moduli predicted from noise may be unsolvable
        fitted = np.full((n, n), np.inf)
    size = np.sqrt((remove_affine(u[None]) ** 2).mean())
    plates = np.sqrt(max(float(np.var(u[end])) for end in (0, -1)))
    noise = max(float(estimate_noise(u[None])[0]), NOISE[0])
    left = np.sqrt(((fitted - u[..., 0]) ** 2).mean()) / size
    return float(min(left, UNSOLVED)), float(plates / size / noise)


@cache
def _bumps(n: int) -> tuple[Array, Array, Array]:
    """∫ b f, ∫ b′ f and ∫ b″ f of values f at n points, for each bump function b = (1 - s²)⁴: matrices (BUMPS, n)."""
    half = REACH / (BUMPS - 1)
    s = (np.linspace(0, 1, n) - np.linspace(0, 1, BUMPS)[:, None]) / half
    rest = np.maximum(1 - s**2, 0)
    weight = np.full(n, 1 / (n - 1))
    weight[[0, -1]] /= 2
    b, db, ddb = rest**4, -8 * s * rest**3 / half, (48 * s**2 * rest**2 - 8 * rest**3) / half**2
    return b * weight, db * weight, ddb * weight


def _relative(elastic: Array, inertia: Array) -> float:
    whole = (np.abs(elastic) ** 2).sum() + (np.abs(inertia) ** 2).sum()
    return float(np.sqrt((np.abs(elastic - inertia) ** 2).sum() / max(whole, 1e-300)))


def _disproportion(elastic: Array, inertia: Array) -> float:
    """Deviation of two arrays from being proportional."""
    both = (np.abs(elastic) ** 2).sum() * (np.abs(inertia) ** 2).sum()
    return float(np.sqrt(max(0.0, 1 - np.abs((np.conj(elastic) * inertia).sum()) ** 2 / max(both, 1e-300))))
