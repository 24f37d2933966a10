"""Phantoms whose properties are drawn from the prior, for which 95 % intervals must cover 95 % of the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import ngsolve as ngs
import numpy as np

from ngbrain.adjoint.reduced import Regulariser
from ngbrain.inverse.objective.parameters import LogTransform
from ngbrain.inverse.optimise.gauss_newton_hessian import Metric
from ngbrain.inverse.phantoms.benchmark import LOGS, SIDE, Phantom
from ngbrain.mesh.geometry.structured import rectangles

Array = np.ndarray


def draw_phantom(
    phantom: Phantom, regularised: Callable[[ngs.FESpace, Array], Regulariser], weight: float, seed: int
) -> Phantom:
    """Draw the properties of a phantom from the prior: x = x̄ + (αR)^(-½) ξ with white ξ, around the initial guess x̄.

    Parameters
    ----------
    phantom : Phantom
        Phantom whose properties are replaced.
    regularised : callable
        Constructor of a regulariser from a space and x̄, as for `PhantomData.inversion`.
    weight : float
        Weight α of each field.
    seed : int
        Seed.

    Returns
    -------
    Phantom

    Examples
    --------
    >>> from ngbrain.inverse.objective.regularisation import matern
    >>> phantom = draw_phantom(Phantom.from_name("CV-G", 9), lambda space, x: matern(space, x, 0.03), 5.0, seed=0)
    >>> log = np.log(phantom.simulate_measurements().truth["storage"] / 1e4)
    >>> bool(0.1 < log.std() < 0.3)
    True
    """
    line = np.linspace(0, SIDE, phantom.nodes)
    space = ngs.H1(rectangles(line, line), order=1)
    regular = regularised(space, np.zeros(space.ndof)).matrix(np.zeros(space.ndof))
    metric, truth = Metric(weight * regular), {}
    random = np.random.default_rng((seed, space.ndof))  # no numbers that noise has too
    for name, start in phantom.start.items():
        transform = LOGS.get(name, LogTransform())
        truth[name] = transform.value(
            transform.inverse(np.array(start)) + metric.unwhiten(random.normal(size=space.ndof))
        )
    return replace(phantom, truth=lambda x, y: dict(truth))
