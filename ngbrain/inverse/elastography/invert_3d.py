"""The inversion of wave data in space from one call.

As in the plane with these differences: the start is uniform fields of the modulus that the waves suggest and the measured
waves, from where the weight falls while fields and waves find each other; then it is what the data say
(`weights.EvidenceOfNoise`). Steps are those of `iterative`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain import parallel
from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import ConvergenceError, InputError
from ngbrain.forward.common.elements import ElementPair
from ngbrain.forward.sensitivity.harmonic.wave_model import BOUNDARY
from ngbrain.inverse.data.outliers import screen_outliers
from ngbrain.inverse.data.quality import RelativeNoise, noise_deviation, noise_level, rms_noise, total_noise
from ngbrain.inverse.data.subset import WaveSubset
from ngbrain.inverse.data.time_convention import check_passive
from ngbrain.inverse.elastography.initial_guess import (
    assumed_start_notes,
    check_iterations,
    check_levels,
    run_starts,
    select_start,
)
from ngbrain.inverse.elastography.result import Inversion, build_inversion, start_result
from ngbrain.inverse.objective.misfit import LeastSquares, MisfitKind, resolve_misfit
from ngbrain.inverse.objective.regularisers import PRIORS, Prior, resolve_priors
from ngbrain.inverse.optimise.gauss_newton_cg import GaussNewtonCG
from ngbrain.inverse.optimise.regularisation_weight import EvidenceWithModelError, MisfitLevel
from ngbrain.inverse.optimise.result import Iteration, OptimisationResult
from ngbrain.inverse.problem.discretisation import Discretisation
from ngbrain.inverse.problem.properties import select_properties
from ngbrain.inverse.problem.property_fields import build_composition, discretise_volume
from ngbrain.inverse.problem.wave_problem import ElastographyProblem
from ngbrain.io.waves import WaveData
from ngbrain.progress import log_progress, reporting
from ngbrain.solvers.device import Device

Array = np.ndarray
FIRST, APPROACH = 1.0, 8
"""Weight to begin with, for each real datum, and how many iterations at most from the measured waves."""
FALL = 10.0
"""Factor by which an iteration may change it."""
MAX_ITERATIONS = 16
"""Iterations at most, those from the measured waves apart."""
LEAST = 2e-3
"""Noise, relative to the waves' rms, that is assumed at least: about what the error of elements is."""


@reporting()
def invert_in_space(
    data: WaveData,
    elements: Discretisation | None = None,
    *,
    noise: float | None = None,
    model_error: float = 0.0,
    regulariser: str | Prior = "smooth",
    labelled: bool = False,
    unknowns: str = "moduli",
    misfit: str | MisfitKind = "squares",
    levels: Sequence[float] = (),
    max_iterations: int = MAX_ITERATIONS,
    checkpoint: str | os.PathLike[str] | None = None,
    drop_outliers: bool = True,
    device: str = "cpu",
    callback: Callable[[Iteration], None] = log_progress,
    executor: parallel.AnyExecutor = None,
) -> Inversion:
    """Property maps of wave data in space.

    elements     see `discretise`; by default hexahedra over the points, as large as the waves allow
    noise        relative to the rms of each component, one number; by default what the data say, or what a smooth fit leaves over
    model_error  of the same kind: what the model cannot fit
    regulariser  one of `priors.PRIORS`, or a prior of one's own
    labelled     whether each label of the data has fields of its own, which jump where labels meet
    unknowns     one of `quantities.UNKNOWNS`: moduli (ln storage and ln loss), or polar, ln G* with its phase
    misfit       one of `misfit.MISFITS`, or one of one's own: squares, or huber for what `remove_outliers` misses
    levels       uniform fields to start from too, as multiples of the modulus that the waves suggest: each takes about as long as
                 the start from measured waves. The lowest J at equal weights is kept
    rounds       iterations of a start at most, those from the measured waves apart
    checkpoint   .npz that is written after each iteration; where it is there, the inversion goes on from it. Uniform fields
                 have files of their own beside it
    drop_outliers  as for `invert`
    device       as for `invert`; a checkpoint may go on on another one
    executor     who goes down from each start, on one thread (`parallel.run`): by default this process; the answer does not depend
                 on it. Workers elsewhere have to see the folder of `checkpoint`

    `rows` are "waves", where the way from measured waves ended, "both", down in J from there, and "uniform".

    Raises `InputError` for data in the plane, negative noise, no rounds, a regulariser, unknowns or misfit that are none, labels or
    a device that are not there.

    >>> line = np.linspace(0, 0.021, 8)
    >>> grid = np.array([[x, y, z] for z in line for y in line for x in line])
    >>> k = 2 * np.pi * 80 * np.sqrt(1000 / (2500 + 800j))
    >>> u = 1e-5 * np.stack([np.exp(-1j * k * grid[:, i]) for i in (1, 2, 0)], axis=1)[None]
    >>> data = WaveData(grid, u, [80.0], 1000.0, "isotropic", "viscoelastic", bulk=2e5).with_noise(0.02, seed=0)
    >>> found = invert_in_space(data, max_iterations=5)
    >>> bool(abs(np.median(found.maps["storage"]) / 2500 - 1) < 0.03)
    True
    """
    if data.dim != 3:
        raise InputError("points", "in the plane", "points in space; `invert` takes those in the plane")
    if regulariser == "auto":
        raise InputError("regulariser", "'auto'", f"one of {', '.join(PRIORS)}: in space one is tried")
    check_iterations(max_iterations)
    ((kind, prior),) = resolve_priors(regulariser).items()
    for name, value in (("noise", noise), ("model_error", model_error)):
        if value is not None and not 0 <= value < np.inf:
            raise InputError(name, value, "a relative level of at least 0")
    multiples, made, where = check_levels(levels), resolve_misfit(misfit), Device.from_name(device)
    if not isinstance(data, WaveSubset):  # a zone alone need not show its loss; the body was asked
        check_passive(data)
    data, notes = screen_outliers(data) if drop_outliers else (data, [])
    sought, elements = select_properties(data, unknowns), elements or discretise_volume(data, labelled)
    found_noise, note = noise_level(data, noise)
    notes += assumed_start_notes(data) + ([note] if note else [])
    sure = total_noise(found_noise, LEAST, model_error)
    problem = ElastographyProblem(data, elements, sought, build_composition(data, elements, labelled), where)
    notes += [problem.body.device_note] if problem.body.device_note else []
    reduced = _reduced(problem, made, sure, prior)
    kept_in = None if checkpoint is None else Path(checkpoint).absolute()  # workers elsewhere stand in another folder
    common = made, sure, prior, max_iterations
    ways: dict[str, Any] = {"from waves": (_from_waves, (*common, kept_in))}
    ways |= {f"from {level:g} times": (_uniform, (*common, _beside(kept_in, level), level)) for level in multiples}
    memory = memory_in_space(problem.elements.form, problem.body.mesh.ne, data.frequency)
    (start, both, reduced.weights), *others = run_starts(problem, ways, executor, callback, memory)
    history, rows = [*start.history, *both.history], [start_result("waves", problem, reduced, start)]
    ends = {level: _judged(reduced, end) for level, end in zip(multiples, others, strict=True)}
    kept = select_start(both, ends)
    notes += kept.notes
    if kept.uniform:
        history += [each for end in ends.values() if end for each in end.history]
        rows.append(start_result("uniform", problem, reduced, kept.uniform))
    rows.append(start_result("both", problem, reduced, both))
    return build_inversion(
        problem,
        reduced,
        kept.best,
        rows,
        kept.chosen,
        noise=sure,
        stated=rms_noise(data, sure),
        floor=LEAST,
        regulariser=kind,
        weight="evidence",
        history=history,
        notes=notes,
    )


def memory_in_space(form: str, elements: int, frequency: Array) -> float:
    """Bytes that so many elements will take, where those of their order were measured; else 0."""
    cubic = ElementPair.named(form).order == 3
    return parallel.predicted_memory("zone", elements, len(np.unique(frequency))) if cubic else 0.0


def _from_waves(
    problem: ElastographyProblem,
    made: MisfitKind,
    noise: RelativeNoise,
    prior: Prior,
    max_iterations: int,
    checkpoint: Path | None,
    *,
    callback: Callable[[Iteration], None],
) -> tuple[OptimisationResult, OptimisationResult, dict[str, float]]:
    """Where the way from measured waves ended, where that down from there did, and the weights by then."""
    way = _way(problem, made, noise, prior, checkpoint, callback)
    both = way.from_measured_waves(way.unknowns.start, problem.waves, APPROACH, max_iterations)
    assert way.approach_result is not None  # from measured waves there is no other way
    return way.approach_result, both, way.reduced.weights


def _uniform(
    problem: ElastographyProblem,
    made: MisfitKind,
    noise: RelativeNoise,
    prior: Prior,
    max_iterations: int,
    checkpoint: Path | None,
    level: float,
    *,
    callback: Callable[[Iteration], None],
) -> OptimisationResult | None:
    """Where the way from uniform fields ended; None where no step is lower."""
    way = _way(problem, made, noise, prior, checkpoint, callback)
    try:
        return (
            way.resume(max_iterations)
            if way.has_checkpoint
            else way.descend(problem.uniform(way.unknowns, level), max_iterations)
        )
    except ConvergenceError:
        return None


def _way(
    problem: ElastographyProblem,
    made: MisfitKind,
    noise: RelativeNoise,
    prior: Prior,
    checkpoint: Path | None,
    callback: Callable[[Iteration], None],
) -> GaussNewtonCG:
    reduced = _reduced(problem, made, noise, prior)
    return GaussNewtonCG(
        reduced, EvidenceWithModelError(FALL, _shared(problem)), checkpoint=checkpoint, callback=callback
    )


def _judged(judge: Reduced, found: OptimisationResult | None) -> OptimisationResult | None:
    """With misfit and J as `judge` has them."""
    if found is None:
        return None
    point, misfit = judge.evaluate(found.x), judge.misfit
    assert isinstance(misfit, LeastSquares)
    return replace(
        found, objective=point.value, level=MisfitLevel(misfit.weighted_squares(point.state.data), found.level.expected)
    )


def _beside(path: Path | None, level: float) -> Path | None:
    """The checkpoint of uniform fields, next to that of measured waves."""
    return path and path.with_name(f"{path.stem}-uniform-{level:g}{path.suffix}")


def _shared(problem: ElastographyProblem) -> float:
    """Points for each node of the elements."""
    body = problem.body
    return len(problem.model.points) * body.mesh.dim / body.displacement.ndof


def _reduced(problem: ElastographyProblem, made: MisfitKind, noise: RelativeNoise, prior: Prior) -> Reduced:
    sigma = noise_deviation(problem.data, noise, problem.inside)
    unknowns, misfit = problem.unknowns(sigma), made(problem.measured, sigma)
    blocks = {name: block for name, block in unknowns.blocks.items() if name != BOUNDARY}
    regularisers = {name: prior(problem.space, unknowns.start[block]) for name, block in blocks.items()}
    return Reduced(problem.model, misfit, unknowns, regularisers, dict.fromkeys(blocks, FIRST * misfit.count))
