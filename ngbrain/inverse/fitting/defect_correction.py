"""What a better model's data at the point found would change of it, without an inversion by that model."""

from __future__ import annotations

import numpy as np

from ngbrain.adjoint.reduced import Point
from ngbrain.inverse.uncertainty.posterior import Posterior

Array = np.ndarray


def defect_correction_step(point: Point, posterior: Posterior, better: Array) -> tuple[Array, Array]:
    """One step of Gauss and Newton from where an inversion ended, with data of a better model there: x - C Jᵀ W (d_better - d).

    The model's own derivatives stand for the better one's, so that this costs one run of it. Of errors that go with the square of
    the elements' size, elements 1/√2 as large have half: as much again is left as this moves.

    Parameters
    ----------
    point : Point
        Where an inversion ended, the objective's slope being 0; with `jacobian` ∂θ/∂x of few unknowns.
    posterior : Posterior
        Of that point, for the covariance C.
    better : array
        What the better model's data are there, of the shape of `point.state.data`.

    Returns
    -------
    moved : array (n,)
        By how much x changes.
    data : array
        The better model's data then, to first order.

    References
    ----------
    Defect correction: Stetter 1978, 10.1007/BF01432879. Errors of the model as a part of the covariance: Kaipio and Somersalo 2007,
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
