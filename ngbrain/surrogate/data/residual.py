"""Whether maps hold for the displacements they were made of: the equations of motion, asked without knowing the truth.

waves        the weak form with test functions v = curl ψ, ψ a bump of compact support. They have no divergence, so neither the
             pressure nor the bulk modulus matters, and no equation is solved:

                 R(v) = ∫ 2G ε(u):ε(v) - ρω² ∫ u·v = A(v) - M(v),    r² = Σ |R|² / Σ (|A|² + |M|²)

             A bump that reaches over an edge asks whether that edge is free of traction
compression  one forward solve: the axial displacement held at the hull as measured, and what is left of it inside

Lengths are in edges of the square, moduli in ρω²L² (waves) or in their mean (compression).
"""

from __future__ import annotations

from functools import cache

import ngsolve as ngs
import numpy as np

from ngbrain.errors import SolverError
from ngbrain.surrogate.data.dataset import SIDES, solve_displacement
from ngbrain.surrogate.operator.encoding import FINEST, NOISE, estimate_noise, partial_derivative, remove_affine

Array = np.ndarray
BUMPS = 13
"""Along an edge, the first and the last on the corners."""
REACH = 2
"""Half a bump's width, in distances between neighbours: a sixth of the edge. Narrower ones see more of the noise, wider ones
less of the detail."""
UNSOLVED = 1e3
"""The most that is left over: of a map, too, whose equations cannot be solved."""
SLOPES = 3
"""Degree of the polynomials that strains are the slopes of."""


def wave_residual(u: Array, modulus: Array) -> tuple[float, float]:
    """r inside, and how far the square is from one edge shaken as a whole with the others free.

    u        (n, n, 2), first axis y, in any unit
    modulus  (n, n) complex, G/ρω²L²

    The second asks of each edge how unlike its mean its motion is, relative to the rms, and of the bumps over each other edge, but
    not over this one, how far A and M are from being proportional, √(1 - |Σ A* M|²/Σ |A|² Σ |M|²): what is off by a factor is the
    modulus found there. It is the largest of these of the edge for which that is least.

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
        driven.append(max(float(rigid), *(_unlike(elastic[each], inertia[each]) for each in free)))
    return _relative(elastic[inner, inner], inertia[inner, inner]), min(driven)


def virtual_works(u: Array, modulus: Array) -> tuple[Array, Array]:
    """A(v) and M(v) of all bumps, (BUMPS, BUMPS), first axis y: v = (∂ψ/∂y, -∂ψ/∂x)."""
    ux, uy = u[..., 0], u[..., 1]
    slope = [[partial_derivative(each, FINEST, *way, SLOPES) for way in ((1, 0), (0, 1))] for each in (ux, uy)]
    (xx, xy), (yx, yy) = slope
    b, db, ddb = _bumps(len(u))
    elastic = 2 * db @ (modulus * (xx - yy)) @ db.T
    elastic += ddb @ (modulus * (xy + yx)) @ b.T - b @ (modulus * (xy + yx)) @ ddb.T
    return elastic, db @ ux @ b.T - b @ uy @ db.T


def compression_residual(u: Array, youngs: Array, poisson: float) -> tuple[float, float]:
    """The misfit inside, relative to the rms of u less its affine part; and how uneven the motion of the two plates is, over noise.

    u       (n, n, 1), axial, first axis y, in edges
    youngs  (n, n), any unit

    The second is 1 for plates that move as a whole, whatever the noise (`estimate_noise`, at least the least of the training).
    """
    n, side = len(u), SIDES["compression"]
    axial = ngs.VoxelCoefficient((0, 0), (side, side), (side * u[..., 0]).astype(complex), linear=True)
    shear = youngs / (2 * (1 + poisson))
    held = {"x": "bottom", "y": ".*"}
    try:
        fitted = solve_displacement(shear, 0.0, poisson, {".*": ngs.CF((0, axial))}, n, held, side)[..., 1].real / side
    except SolverError:  # moduli of noise may be beyond what can be solved with
        fitted = np.full((n, n), np.inf)
    size = np.sqrt((remove_affine(u[None]) ** 2).mean())
    plates = np.sqrt(max(float(np.var(u[end])) for end in (0, -1)))
    noise = max(float(estimate_noise(u[None])[0]), NOISE[0])
    left = np.sqrt(((fitted - u[..., 0]) ** 2).mean()) / size
    return float(min(left, UNSOLVED)), float(plates / size / noise)


@cache
def _bumps(n: int) -> tuple[Array, Array, Array]:
    """∫ b f, ∫ b′ f and ∫ b″ f of a function's values f at n points, for each bump b = (1 - s²)⁴: matrices (BUMPS, n)."""
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


def _unlike(elastic: Array, inertia: Array) -> float:
    """How far two are from being proportional."""
    both = (np.abs(elastic) ** 2).sum() * (np.abs(inertia) ** 2).sum()
    return float(np.sqrt(max(0.0, 1 - np.abs((np.conj(elastic) * inertia).sum()) ** 2 / max(both, 1e-300))))
