"""Phantoms whose truth is drawn from what inversions assume of it: there intervals of 95 % have to hold 95 % of the truth."""

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
    """The phantom with x = x̄ + (αR)^(-½) ξ in place of its truth, ξ white, x̄ where inversions of it start.

    regularised  a space and x̄ → a regulariser, as `Measured.inversion` takes it
    weight       α, of each field

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
