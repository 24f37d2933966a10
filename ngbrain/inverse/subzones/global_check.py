"""The misfit of joined maps in one wave problem of the whole body, driven as fits the data best."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ngbrain.adjoint.reduced import Reduced
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.forward.sensitivity.harmonic.wave_model import BOUNDARY
from ngbrain.inverse.data.quality import RelativeNoise, noise_deviation
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.parameters import ParameterFields, ScaledTransform, Unknown
from ngbrain.inverse.objective.regularisation import smooth
from ngbrain.inverse.optimise.normal_equations import MAX_PROBE_ITERATIONS, PROBE_RTOL, NormalEquations
from ngbrain.inverse.optimise.regularisation_weight import MisfitLevel
from ngbrain.inverse.problem.field_values import field_observations, fit_field
from ngbrain.inverse.problem.property_fields import build_composition, discretise_lattice
from ngbrain.inverse.problem.voxel_lattice import VoxelLattice
from ngbrain.inverse.problem.wave_problem import ElastographyProblem
from ngbrain.io.waves import WaveData

Array = np.ndarray
LARGEST = 40_000
"""Most displacement unknowns for this check: 32 000 with two loads took 1.6 GiB and 89 s of CPU time."""


def global_misfit(
    data: WaveData,
    cells: VoxelLattice,
    logarithms: Mapping[str, Array],
    waves: Array,
    noise: RelativeNoise,
    labelled: bool,
    solves: Solves,
) -> MisfitLevel | None:
    """Return the misfit of given maps in one wave problem; only the displacements of the boundary are unknown.

    This problem is linear: one factorisation, and conjugate gradients with it.

    Parameters
    ----------
    data : WaveData
        All data.
    cells : VoxelLattice
        The body's lattice.
    logarithms : mapping of str to numpy.ndarray
        Property → ln(value - lower bound) (n,), NaN where there is none.
    waves : numpy.ndarray
        (loads, n, dim) initial guess for the boundary, m; NaN where there is none.
    noise : RelativeNoise
        As `noise_deviation` takes it.
    labelled : bool
        Whether each label has fields of its own.
    solves : Solves
        Counts the linear solves.

    Returns
    -------
    MisfitLevel or None
        Misfit and its expected value; None for a body of more than `LARGEST` unknowns.
    """
    if cells.n_displacements > LARGEST:
        return None
    elements = discretise_lattice(data, cells, labelled)
    composition = build_composition(data, elements, labelled)
    start = replace(data, displacement=np.where(np.isnan(waves), data.displacement, waves))
    problem = ElastographyProblem(start, elements, composition=composition)
    problem.model.solves = solves
    sigma = noise_deviation(data, noise, problem.inside)
    both = problem.unknowns(sigma)
    x = both.start.copy()
    for field, _, at, values in field_observations(problem, logarithms):
        block = both.blocks[field.name]
        x[block] = fit_field(at, values, smooth(problem.space, both.start[block]), x[block])
    theta, blocks = both.theta(x), problem.model.blocks
    driven = Unknown(theta[blocks[BOUNDARY]], ScaledTransform(float(np.median(sigma))))
    misfit = LeastSquares(data.displacement[:, problem.inside], sigma)
    reduced = Reduced(problem.model, misfit, ParameterFields(theta, blocks, {BOUNDARY: driven}), {}, {})
    with solves.spent_on("checks"):
        point = reduced.evaluate(reduced.unknowns.start)
        normal = NormalEquations(point)
        step = normal.solve(-normal.gradient(), PROBE_RTOL, MAX_PROBE_ITERATIONS)
        expected = misfit.count - normal.effective_parameters(np.random.default_rng(0))
        return MisfitLevel(2 * reduced.evaluate(point.x + step).misfit, expected)
