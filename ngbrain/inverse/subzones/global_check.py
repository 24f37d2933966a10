"""Whether maps that were joined hold for the body as a whole: one wave problem of it, driven as fits the data best."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ngbrain.adjoint.reduced import Reduced
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.forward.sensitivity.harmonic.wave_model import BOUNDARY
from ngbrain.inverse.data.quality import Relative, noise_of
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.parameters import Fields, Scaled, Unknown
from ngbrain.inverse.objective.regularisation import smooth
from ngbrain.inverse.optimise.normal_equations import MOST_PROBED, PROBED, Normal
from ngbrain.inverse.optimise.regularisation_weight import Level
from ngbrain.inverse.problem.field_values import fields_at, fitted
from ngbrain.inverse.problem.property_fields import composed, elements_on
from ngbrain.inverse.problem.voxel_lattice import Lattice
from ngbrain.inverse.problem.wave_problem import Experiment
from ngbrain.io.waves import WaveData

Array = np.ndarray
LARGEST = 40_000
"""Displacements of which a factor is made for this: 32 000, two loads, took 1.6 GiB and 89 s of CPU time."""


def level_as_one_body(
    data: WaveData,
    cells: Lattice,
    logarithms: Mapping[str, Array],
    waves: Array,
    noise: Relative,
    labelled: bool,
    solves: Solves,
) -> Level | None:
    """Misfit and where it is expected with given maps, the boundary's displacements alone unknown; None for a body too large.

    cells       the body's
    logarithms  quantity → ln(value - floor) (n,), NaN where there is none
    waves       (loads, n, dim) m, what the boundary starts from; NaN where there are none
    noise       relative, as `noise_of` takes it
    solves      where what it takes is counted

    The problem for the displacements is linear: one factor, and conjugate gradients with it.
    """
    if cells.displacements > LARGEST:
        return None
    elements = elements_on(data, cells, labelled)
    composition = composed(data, elements, labelled)
    start = replace(data, displacement=np.where(np.isnan(waves), data.displacement, waves))
    experiment = Experiment(start, elements, composition=composition)
    experiment.model.solves = solves
    sigma = noise_of(data, noise, experiment.inside)
    both = experiment.unknowns(sigma)
    x = both.start.copy()
    for field, _, at, values in fields_at(experiment, logarithms):
        block = both.blocks[field.name]
        x[block] = fitted(at, values, smooth(experiment.space, both.start[block]), x[block])
    theta, blocks = both.theta(x), experiment.model.blocks
    driven = Unknown(theta[blocks[BOUNDARY]], Scaled(float(np.median(sigma))))
    misfit = LeastSquares(data.displacement[:, experiment.inside], sigma)
    reduced = Reduced(experiment.model, misfit, Fields(theta, blocks, {BOUNDARY: driven}), {}, {})
    with solves.spent_on("checks"):
        point = reduced.evaluate(reduced.unknowns.start)
        normal = Normal(point)
        step = normal.solve(-normal.gradient(), PROBED, MOST_PROBED)
        expected = misfit.count - normal.determined(np.random.default_rng(0))
        return Level(2 * reduced.evaluate(point.x + step).misfit, expected)
