"""Correction of an estimate by the data of a more accurate model, without an inversion by that model."""

from __future__ import annotations

import numpy as np

from ngbrain.adjoint.reduced import Point
from ngbrain.inverse.uncertainty.posterior import Posterior

Array = np.ndarray


def defect_correction_step(point: Point, posterior: Posterior, better: Array) -> tuple[Array, Array]:
    """Take one Gauss-Newton step with the data of a more accurate model: x - C Jᵀ W (d_better - d).

    The derivatives are those of the original model, so that one run of the more accurate model suffices. For errors that are
    quadratic in the element size, elements 1/√2 as large have half the error: the remaining error equals the correction.

    Parameters
    ----------
    point : Point
        Minimum of the objective, with `jacobian` ∂θ/∂x of few unknowns.
    posterior : Posterior
        Posterior at that point, for the covariance C.
    better : array
        Data of the more accurate model at the point, of the shape of `point.state.data`.

    Returns
    -------
    moved : array (n,)
        Change of x.
    data : array
        Data of the more accurate model after the change, to first order.

    References
    ----------
    Defect correction: Stetter 1978, 10.1007/BF01432879. Model error as a part of the covariance: Kaipio and Somersalo 2007,
    10.1016/j.cam.2005.09.027.

    Examples
    --------
    >>> from ngbrain.inverse.phantoms.benchmark import Phantom
    >>> inversion = Phantom.from_name("CV-G", 5).simulate_measurements(0.02).inversion()
    >>> point = inversion.reduced.evaluate(inversion.start)
    >>> moved, _ = defect_correction_step(point, Posterior(point), point.state.data)
    >>> float(np.abs(moved).max())
    0.0
    """
    state = point.state
    change = np.asarray(better) - state.data
    slope = point.jacobian.T @ state.vjp(point.reduced.misfit.gauss_newton_product(state.data, change))
    moved = -posterior.covariance() @ slope
    return moved, state.data + change + state.jvp(point.jacobian @ moved)
