"""A window that is cut out of a larger body at rest, as an ultrasound probe sees it, for the operator of compression.

The operator has learnt blocks that are pressed between two plates. In a window strain falls with depth and varies across, the more
so as the probe is small, and none of its rim moves as a plate does. So it looks at what the displacement would be under plates, to
first order: the axial strain over its smooth trend, a quadratic in x and y that strains of a lesion hardly bend, added up along the
beam. A trend of the stiffness goes with it and is not seen.
"""

from __future__ import annotations

import ngsolve as ngs
import numpy as np

from ngbrain.errors import SolverError
from ngbrain.surrogate.data.dataset import SIDES, solve_displacement
from ngbrain.surrogate.data.residual import UNSOLVED
from ngbrain.surrogate.operator.encoding import GRAIN, partial_derivative, remove_affine

Array = np.ndarray
HALF, DEGREE = 4 * GRAIN, 3
"""Half a window (edges) and degree of the local polynomials that smooth what was tracked before strains are divided: four of the
longest grains of speckle either way. Chosen with one phantom and three made windows in view."""
TREND, ROUNDS, LEAST = 2, 30, 0.1
"""Degree of the trend, and of its fit by least absolute differences: reweighted rounds, least difference over the median one."""


def remove_strain_trend(u: Array) -> Array:
    """The displacement as under plates.

    Parameters
    ----------
    u : numpy.ndarray
        (n, n) axial displacement, y along the beam, in any unit.

    Returns
    -------
    numpy.ndarray
        (n, n), 0 at the first row and of the same mean strain; u itself where its trend of strain changes sign, which is no
        compression.

    Examples
    --------
    >>> y, x = np.meshgrid(*2 * (np.linspace(0, 1, 51),), indexing="ij")
    >>> found = remove_strain_trend(y + 0.2 * y**2 + 0.1 * x * y)  # uniform tissue under a bent plate
    >>> bool(np.ptp(found, axis=1).max() < 1e-9)
    True
    """
    strain = np.diff(_smooth(u), axis=0)
    trend = _trend(strain)
    if not trend.min() * trend.max() > 0:
        return u
    even = np.cumsum(strain / trend, axis=0) * strain.mean()
    return np.concatenate([np.zeros((1, u.shape[1])), even])


def misfit(u: Array, youngs: Array, poisson: float) -> float:
    """What a map leaves unexplained inside of a window, relative to the rms of the smooth u less its affine part.

    u       (n, n) as measured, in edges; youngs  (n, n), any unit

    All of the rim is held where it was measured; across the beam, where nothing was, it is where tissue goes that gives way
    sideways: ∂u_x/∂x = -ν/(1 - ν) ∂u_y/∂y, with no motion in the mean over a row.
    """
    n, side = len(u), SIDES["compression"]
    smooth = _smooth(u)
    slope = -poisson / (1 - poisson) * np.gradient(smooth, 1 / (n - 1), axis=0)
    across = np.pad(np.cumsum((slope[:, 1:] + slope[:, :-1]) / 2, axis=1), ((0, 0), (1, 0))) / (n - 1)
    across -= across.mean(axis=1, keepdims=True)
    x, y = (
        ngs.VoxelCoefficient((0, 0), (side, side), (side * part).astype(complex), linear=True)
        for part in (across, smooth)
    )
    shear = youngs / (2 * (1 + poisson))
    try:
        fitted = solve_displacement(shear, 0.0, poisson, {".*": ngs.CF((x, y))}, n, ".*", side)[..., 1].real / side
    except SolverError:  # moduli of noise may be beyond what can be solved with
        return UNSOLVED
    size = np.sqrt((remove_affine(smooth[None, ..., None]) ** 2).mean())
    return float(np.sqrt(((fitted - smooth) ** 2).mean()) / size)


def _smooth(u: Array) -> Array:
    return np.asarray(partial_derivative(u[None], HALF, 0, 0, DEGREE)[0])


def _trend(strain: Array) -> Array:
    """A quadratic through most of it."""
    y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in strain.shape), indexing="ij")
    powers = [(i, j) for i in range(TREND + 1) for j in range(TREND + 1 - i)]
    terms = np.stack([(x**i * y**j).ravel() for i, j in powers], axis=1)
    weight, values = np.ones(strain.size), strain.ravel()
    for _ in range(ROUNDS):
        fitted = terms @ np.linalg.lstsq(terms * weight[:, None], values * weight, rcond=None)[0]
        off = np.abs(values - fitted)
        weight = 1 / np.sqrt(np.maximum(off, max(LEAST * np.median(off), 1e-300)))
    return fitted.reshape(strain.shape)
