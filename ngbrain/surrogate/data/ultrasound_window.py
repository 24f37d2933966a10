"""Windows of larger bodies at rest, as seen by an ultrasound probe, for the operator of compression.

The operator is trained with blocks compressed between two plates. In a window the strain decreases with depth and
varies across, the more so the smaller the probe, and no part of its boundary moves as a plate does. So the
displacement is converted, to first order, to that between plates: the axial strain is divided by its smooth trend,
a quadratic in x and y that lesions hardly affect, and integrated along the beam. A trend of the stiffness is
removed with it and cannot be recovered.
"""

from __future__ import annotations

import ngsolve as ngs
import numpy as np

from ngbrain.errors import SolverError
from ngbrain.surrogate.data.dataset import SIDES, solve_displacement
from ngbrain.surrogate.data.residual import UNSOLVED
from ngbrain.surrogate.operator.derivatives import partial_derivative
from ngbrain.surrogate.operator.encoding import GRAIN, remove_affine

Array = np.ndarray
HALF, DEGREE = 4 * GRAIN, 3
"""Half window (edges) and degree of the local polynomials that smooth tracked displacements before strains are
divided: four of the longest correlation lengths of speckle on either side. Chosen with one phantom and three
computed windows in view.
"""
TREND, ROUNDS, LEAST = 2, 30, 0.1
"""Degree of the trend, and of its fit by least absolute deviations: reweighting rounds, smallest deviation relative
to the median one.
"""


def remove_strain_trend(u: Array) -> Array:
    """The displacement as it would be between plates, to first order.

    Parameters
    ----------
    u : numpy.ndarray of shape (n, n)
        Axial displacement, y along the beam, in any unit.

    Returns
    -------
    numpy.ndarray of shape (n, n)
        Displacement with 0 in the first row and the same mean strain; u itself where its strain trend changes sign,
        which is no compression.

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
    """Misfit of a map in the interior of a window, relative to the rms of the smoothed u without its affine part.

    The axial displacement is prescribed on the whole boundary as measured. The unmeasured lateral displacement is
    prescribed as that of tissue free to expand sideways, ∂u_x/∂x = -ν/(1 - ν) ∂u_y/∂y, with zero mean over each
    row.

    Parameters
    ----------
    u : numpy.ndarray of shape (n, n)
        Axial displacement as measured, in edges.
    youngs : numpy.ndarray of shape (n, n)
        Young's modulus, in any unit.
    poisson : float
        Poisson's ratio.

    Returns
    -------
    float
        Relative misfit.
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
    except SolverError:  # moduli predicted from noise may be unsolvable
        return UNSOLVED
    size = np.sqrt((remove_affine(smooth[None, ..., None]) ** 2).mean())
    return float(np.sqrt(((fitted - smooth) ** 2).mean()) / size)


def _smooth(u: Array) -> Array:
    return np.asarray(partial_derivative(u[None], HALF, 0, 0, DEGREE)[0])


def _trend(strain: Array) -> Array:
    """Robust quadratic fit."""
    y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in strain.shape), indexing="ij")
    powers = [(i, j) for i in range(TREND + 1) for j in range(TREND + 1 - i)]
    terms = np.stack([(x**i * y**j).ravel() for i, j in powers], axis=1)
    weight, values = np.ones(strain.size), strain.ravel()
    for _ in range(ROUNDS):
        fitted = terms @ np.linalg.lstsq(terms * weight[:, None], values * weight, rcond=None)[0]
        off = np.abs(values - fitted)
        weight = 1 / np.sqrt(np.maximum(off, max(LEAST * np.median(off), 1e-300)))
    return fitted.reshape(strain.shape)
