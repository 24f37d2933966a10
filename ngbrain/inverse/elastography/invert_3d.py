"""The inversion of wave data in space by one call.

It differs from the plane in three ways. The start is uniform fields of the modulus that the waves suggest, with the measured
waves; from there the weight falls while fields and waves converge. Then the weight follows from the evidence
(`EvidenceWithModelError`). Steps are inexact (`gauss_newton_cg`).
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
from ngbrain.inverse.data.outliers import Screened, screen_outliers
from ngbrain.inverse.data.quality import RelativeNoise, noise_deviation, noise_level, rms_noise, total_noise
from ngbrain.inverse.data.subset import WaveSubset
from ngbrain.inverse.data.time_convention import check_passive
from ngbrain.inverse.elastography.assembly import build_inversion, start_result
from ngbrain.inverse.elastography.initial_guess import (
    assumed_start_notes,
    check_iterations,
    check_levels,
    run_starts,
    select_start,
)
from ngbrain.inverse.elastography.result import Inversion
from ngbrain.inverse.elastography.usability import torn_patches
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
"""Initial weight for each real datum, and most iterations from the measured waves."""
FALL = 10.0
"""Largest factor by which an iteration changes the weight."""
MAX_ITERATIONS = 16
"""Most iterations, those from the measured waves apart."""
LEAST = 2e-3
"""Least noise that is assumed, relative to the waves' rms: about the discretisation error."""


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
    """Invert wave data in space for property maps.

    Parameters
    ----------
    data : WaveData
        Data in space.
    elements : Discretisation, optional
        See `discretise`; by default hexahedra over the points, as large as the wavelength allows.
    noise : float, optional
        Noise relative to the rms of each component; by default the noise of the data, or the residual of a smooth fit.
    model_error : float
        Error of the model in the same unit.
    regulariser : str or Prior
        One of `regularisers.PRIORS`, or a prior.
    labelled : bool
        Whether each label of the data has fields of its own, which may jump where labels meet.
    unknowns : str
        One of `properties.UNKNOWNS`: moduli (ln storage and ln loss), or polar (ln G* and its phase).
    misfit : str or MisfitKind
        One of `misfit.MISFITS`, or a misfit: squares, or huber for outliers that `remove_outliers` misses.
    levels : sequence of float
        Uniform fields to start from too, as multiples of the modulus that the waves suggest. Each takes about as long as the
        start from measured waves. The lowest J at equal weights is kept.
    max_iterations : int
        Most iterations of a start, those from the measured waves apart.
    checkpoint : path, optional
        .npz file that is written after each iteration. If it exists, the inversion goes on from it. Uniform fields have files
        of their own beside it.
    drop_outliers : bool
        As for `invert`.
    device : str
        As for `invert`. A checkpoint may go on on another device.
    callback : callable
        Is called with each `Iteration`.
    executor : int or executor, optional
        Runs the starts, each on one thread (`parallel.run`); by default this process. The result does not depend on it.
        Workers on other machines need access to the folder of `checkpoint`.

    Returns
    -------
    Inversion
        Its `starts` are "waves" (the result of the start from measured waves), "both" (the descent in J from there) and
        "uniform".

    Raises
    ------
    InputError
        The data are plane, the noise is negative, no iterations are allowed, or a regulariser, parametrisation, misfit, label
        or device does not exist.

    Examples
    --------
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
    multiples, misfit_kind, where = check_levels(levels), resolve_misfit(misfit), Device.from_name(device)
    if not isinstance(data, WaveSubset):  # a zone alone may not show its loss; the whole body was checked
        check_passive(data)
    data, notes, patches = screen_outliers(data) if drop_outliers else Screened(data, [])
    properties, elements = select_properties(data, unknowns), elements or discretise_volume(data, labelled)
    found_noise, note = noise_level(data, noise)
    notes += assumed_start_notes(data) + ([note] if note else [])
    assumed = total_noise(found_noise, LEAST, model_error)
    problem = ElastographyProblem(data, elements, properties, build_composition(data, elements, labelled), where)
    notes += [problem.body.device_note] if problem.body.device_note else []
    reduced = _reduced(problem, misfit_kind, assumed, prior)
    kept_in = (
        None if checkpoint is None else Path(checkpoint).absolute()
    )  # other processes may have another working directory
    common = misfit_kind, assumed, prior, max_iterations
    runs: dict[str, Any] = {"from waves": (_from_waves, (*common, kept_in))}
    runs |= {
        f"from {level:g} times": (_uniform, (*common, _checkpoint_of_level(kept_in, level), level))
        for level in multiples
    }
    memory = memory_in_space(problem.elements.form, problem.body.mesh.ne, data.frequency)
    (start, both, reduced.weights), *others = run_starts(problem, runs, executor, callback, memory)
    history, starts = [*start.history, *both.history], [start_result("waves", problem, reduced, start)]
    ends = {level: _evaluate(reduced, end) for level, end in zip(multiples, others, strict=True)}
    kept = select_start(both, ends)
    notes += kept.notes
    if kept.uniform:
        history += [each for end in ends.values() if end for each in end.history]
        starts.append(start_result("uniform", problem, reduced, kept.uniform))
    starts.append(start_result("both", problem, reduced, both))
    inversion = build_inversion(
        problem,
        reduced,
        kept.best,
        starts,
        kept.chosen,
        noise=assumed,
        stated=rms_noise(data, assumed),
        floor=LEAST,
        regulariser=kind,
        weight="evidence",
        history=history,
        notes=notes,
    )
    inversion.checks |= torn_patches(patches)
    return inversion


def memory_in_space(form: str, elements: int, frequency: Array) -> float:
    """Return the memory that an inversion will take.

    Parameters
    ----------
    form : str
        Element pair.
    elements : int
        Number of elements.
    frequency : numpy.ndarray
        (loads,) Hz.

    Returns
    -------
    float
        Bytes; 0 where elements of this order were not measured.
    """
    cubic = ElementPair.named(form).order == 3
    return parallel.predicted_memory("zone", elements, len(np.unique(frequency))) if cubic else 0.0


def _from_waves(
    problem: ElastographyProblem,
    misfit_kind: MisfitKind,
    noise: RelativeNoise,
    prior: Prior,
    max_iterations: int,
    checkpoint: Path | None,
    *,
    callback: Callable[[Iteration], None],
) -> tuple[OptimisationResult, OptimisationResult, dict[str, float]]:
    """The result of the start from measured waves, that of the descent from there, and its weights."""
    optimiser = _optimiser(problem, misfit_kind, noise, prior, checkpoint, callback)
    both = optimiser.from_measured_waves(optimiser.unknowns.start, problem.waves, APPROACH, max_iterations)
    assert optimiser.approach_result is not None  # the start from measured waves sets it
    return optimiser.approach_result, both, optimiser.reduced.weights


def _uniform(
    problem: ElastographyProblem,
    misfit_kind: MisfitKind,
    noise: RelativeNoise,
    prior: Prior,
    max_iterations: int,
    checkpoint: Path | None,
    level: float,
    *,
    callback: Callable[[Iteration], None],
) -> OptimisationResult | None:
    """The result from uniform fields; None where no step lowers J."""
    optimiser = _optimiser(problem, misfit_kind, noise, prior, checkpoint, callback)
    try:
        return (
            optimiser.resume(max_iterations)
            if optimiser.has_checkpoint
            else optimiser.descend(problem.uniform(optimiser.unknowns, level), max_iterations)
        )
    except ConvergenceError:
        return None


def _optimiser(
    problem: ElastographyProblem,
    misfit_kind: MisfitKind,
    noise: RelativeNoise,
    prior: Prior,
    checkpoint: Path | None,
    callback: Callable[[Iteration], None],
) -> GaussNewtonCG:
    reduced = _reduced(problem, misfit_kind, noise, prior)
    return GaussNewtonCG(
        reduced, EvidenceWithModelError(FALL, _points_per_node(problem)), checkpoint=checkpoint, callback=callback
    )


def _evaluate(judge: Reduced, found: OptimisationResult | None) -> OptimisationResult | None:
    """The result with misfit and J of another objective."""
    if found is None:
        return None
    point, misfit = judge.evaluate(found.x), judge.misfit
    assert isinstance(misfit, LeastSquares)
    return replace(
        found, objective=point.value, level=MisfitLevel(misfit.weighted_squares(point.state.data), found.level.expected)
    )


def _checkpoint_of_level(path: Path | None, level: float) -> Path | None:
    """Checkpoint of uniform fields, next to that of measured waves."""
    return path and path.with_name(f"{path.stem}-uniform-{level:g}{path.suffix}")


def _points_per_node(problem: ElastographyProblem) -> float:
    """Data points for each node of the elements."""
    body = problem.body
    return len(problem.model.points) * body.mesh.dim / body.displacement.ndof


def _reduced(problem: ElastographyProblem, misfit_kind: MisfitKind, noise: RelativeNoise, prior: Prior) -> Reduced:
    sigma = noise_deviation(problem.data, noise, problem.inside)
    unknowns, misfit = problem.unknowns(sigma), misfit_kind(problem.measured, sigma)
    blocks = {name: block for name, block in unknowns.blocks.items() if name != BOUNDARY}
    regularisers = {name: prior(problem.space, unknowns.start[block]) for name, block in blocks.items()}
    return Reduced(problem.model, misfit, unknowns, regularisers, dict.fromkeys(blocks, FIRST * misfit.count))
