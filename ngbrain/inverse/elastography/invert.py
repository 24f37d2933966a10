"""The inversion of wave data by one call, which chooses noise, elements, starts, regularisers and weights.

start        Fields from measured waves (`GaussNewton.from_waves`), or from maps and measured waves. Each iteration is a linear
             least-squares problem. Large grids start from an inversion in coarser elements (`coarse_discretisation`), which
             chooses the regulariser too and compares the starts.
regulariser  Smooth fields, or fields with edges: the one with the smaller generalised cross-validation score (`regularisers`).
weight       Converges together with the fields, or is the corner of an L-curve (`weight_selection`).
descent      Gauss-Newton on J from there, and from uniform fields of one or several levels. The result
             with the lower J at equal weights is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ngbrain import parallel
from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import ConvergenceError, InputError, SolverError, nearest
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.forward.sensitivity.harmonic.wave_model import BOUNDARY
from ngbrain.inverse.data.dispersion import contradiction
from ngbrain.inverse.data.outliers import Screened, screen_outliers
from ngbrain.inverse.data.quality import (
    RelativeNoise,
    noise_deviation,
    noise_for_misfit,
    noise_level,
    rms_noise,
    total_noise,
)
from ngbrain.inverse.data.time_convention import check_passive
from ngbrain.inverse.data.ultrasound import error_note, is_tracked, minimum_model_error
from ngbrain.inverse.elastography.assembly import build_inversion, start_result
from ngbrain.inverse.elastography.initial_guess import (
    assumed_start_notes,
    check_iterations,
    check_levels,
    run_starts,
    select_start,
    unknowns_from_maps,
)
from ngbrain.inverse.elastography.invert_3d import MAX_ITERATIONS, invert_in_space
from ngbrain.inverse.elastography.invert_slices import invert_slices, moving_axis
from ngbrain.inverse.elastography.result import Inversion
from ngbrain.inverse.elastography.usability import torn_patches
from ngbrain.inverse.objective.misfit import MisfitKind, resolve_misfit
from ngbrain.inverse.objective.regularisers import Prior, resolve_priors
from ngbrain.inverse.optimise.regularisation_weight import MisfitLevel
from ngbrain.inverse.optimise.result import Iteration, OptimisationResult
from ngbrain.inverse.optimise.weight_selection import WeightSelection, weight_selection
from ngbrain.inverse.problem.discretisation import (
    Discretisation,
    coarse_discretisation,
    discretise,
    original_discretisation,
)
from ngbrain.inverse.problem.properties import EXPONENT, frequency_exponent, select_properties
from ngbrain.inverse.problem.property_fields import build_composition
from ngbrain.inverse.problem.wave_problem import ElastographyProblem
from ngbrain.io.waves import WaveData
from ngbrain.progress import log_progress, reporting
from ngbrain.result import Status
from ngbrain.solvers.device import Device

Array = np.ndarray
DISPERSIONS = ("auto", "power", "none")
FIRST = 1e3
"""Initial regularisation weight; it converges to what the data imply."""
FAR = 1e4
"""The same from uniform fields: larger, so that large structures come first."""
FLOOR = 1e-5
"""Least noise, relative to the waves' rms, for data in their own elements."""
NEW_ELEMENTS_FLOOR = 2e-3
"""The same in new elements: below it fields fit the discretisation error, by wiggles at edges. At 41 points across two waves
that error is .02 to .05 % of the waves. A modulus without noise is .4 % off with .2 % assumed, .7 % with .1 %."""
LEVELS = 8
CLOSE = 0.15
BEYOND = 1.3
"""Most corrections of the noise level by the misfit; the change (in ln) at which it has converged; and the ratio from which a
given level is corrected. An estimated level is always corrected. A given level is raised where the misfit says so, and
lowered again later, but not below the given value. The floors do not count as given."""
LARGE_MISFIT = 100.0
"""Misfit over its expected value beyond which the noise level is corrected before any descent. So nearly exact data are first
fitted as data of ten times the noise, then more and more closely."""
DECISIVE = 4.0
"""Difference by which the score of edges has to be lower than that of smooth fields: a likelihood ratio of e². Far from edges
both regularisers are the same, and chance would decide."""
SHORT = 12
"""Most iterations from uniform fields: enough to converge or to stall."""
UNIFORM_NOISE = 1e-4
"""Least noise assumed there: with less, the linearisation holds for short steps only."""


@reporting()
def invert(
    data: WaveData,
    elements: Discretisation | None = None,
    *,
    noise: float | None = None,
    model_error: float | None = None,
    regulariser: str | Prior = "auto",
    weight: str = "evidence",
    uniform: bool = True,
    levels: Sequence[float] | None = None,
    labelled: bool = False,
    unknowns: str = "moduli",
    misfit: str | MisfitKind = "squares",
    start: Mapping[str, Array] | None = None,
    max_iterations: int | None = None,
    dispersion: str = "auto",
    drop_outliers: bool = True,
    device: str = "cpu",
    callback: Callable[[Iteration], None] = log_progress,
    executor: parallel.AnyExecutor = None,
) -> Inversion:
    """Invert wave data for property maps.

    Data in space go to `invert_in_space`, which chooses starts and weights itself. Slabs with motion through their slices
    alone go to `invert_slices`.

    Parameters
    ----------
    data : WaveData
        Waves or quasi-static displacements.
    elements : Discretisation, optional
        See `discretise`; by default the elements that the data were computed in, where they name some, else new ones.
    noise : float, optional
        Noise relative to the rms of each component; by default the noise of the data, or the residual of a smooth fit.
    model_error : float, optional
        Error of the model in the same unit, such as discretisation error; by default none. For tracked quasi-static
        displacements by default `ultrasound.minimum_model_error`.
    regulariser : str or Prior
        One of `regularisers.PRIORS`, a prior, or auto: smooth or edges, by cross-validation. For tracked quasi-static
        displacements auto means steps (see `ultrasound`).
    weight : str
        How regularisation weights are chosen: evidence, discrepancy or l-curve.
    uniform : bool
        Whether to start from uniform fields too.
    levels : sequence of float, optional
        Uniform start fields, as multiples of the modulus that the waves suggest; the lowest J is kept. By default 1 in the
        plane, and none in space, where each takes as long as the rest.
    labelled : bool
        Whether each label of the data has fields of its own, which may jump where labels meet.
    unknowns : str
        One of `properties.UNKNOWNS`: moduli (ln storage and ln loss), or polar (ln G* and its phase).
    misfit : str or MisfitKind
        One of `misfit.MISFITS`, or a misfit: squares, or huber for outliers that `remove_outliers` misses.
    start : mapping of str to numpy.ndarray, optional
        Property → (n,) start maps, see `unknowns_from_maps`. They are the only start then. In the plane only.
    max_iterations : int, optional
        Most iterations of a descent, those from measured waves apart; by default 96 in the plane and 16 in space.
    dispersion : str
        power: G*(x, ω) = G*₀(x) (ω/ω₀)^a with one unknown exponent a; maps are those at the lowest frequency ω₀. none: the
        same G* at all frequencies, refused where these contradict each other (`dispersion.contradiction`). auto: power for
        anti-plane waves of several frequencies and where frequencies contradict each other, else none.
    drop_outliers : bool
        Whether gross errors are removed first (`remove_outliers`).
    device : str
        One of `solvers.device.DEVICES`: cpu; cuda for factorisations and solves on a GPU; ngsolve for solves alone; or auto:
        the CPU below the size at which a GPU was measured to be faster (`Device.for_unknowns`).
    callback : callable
        Is called with each `Iteration`.
    executor : int or executor, optional
        Runs the slices of a slab, and the starts and regularisers, each on one thread (`parallel.run`); by default this
        process. The result does not depend on it.

    Returns
    -------
    Inversion
        Maps with their checks, noise and warnings.

    Raises
    ------
    InputError
        The waves gain energy (`check_passive`); a regulariser, parametrisation, misfit, weight or device does not exist or is
        not available; the noise is negative; no iterations are allowed; or the data cannot be inverted.
    MissingExtra
        cuda is asked for, and nvmath-python is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> grid = np.array([[x, y] for y in range(12) for x in range(12)]) * 4e-3
    >>> k = 2 * np.pi * 60 * np.sqrt(1000 / (2500 + 500j))
    >>> u = 1e-5 * np.stack([np.exp(-1j * k * grid[:, 1]), np.exp(-1j * k * grid[:, 0])], axis=1)[None]
    >>> data = WaveData(grid, u, [60.0], 1000.0, "isotropic", "viscoelastic", poisson=0.4).with_noise(0.01, seed=0)
    >>> found = invert(data, uniform=False)
    >>> bool(abs(np.median(found.maps["storage"]) / 2500 - 1) < 0.03)
    True
    """
    where = Device.from_name(device)
    tracked = is_tracked(data)
    kinds = resolve_priors("steps" if tracked and regulariser == "auto" else regulariser)
    selection, misfit_kind = weight_selection(weight), resolve_misfit(misfit)
    for name, value in (("noise", noise), ("model_error", model_error)):
        if value is not None and not 0 <= value < np.inf:
            raise InputError(name, value, "a relative level of at least 0")
    if max_iterations is not None:
        check_iterations(max_iterations)
        selection = replace(selection, max_iterations=max_iterations)
    if dispersion not in DISPERSIONS:
        raise InputError("dispersion", repr(dispersion), nearest(dispersion, DISPERSIONS))
    common: dict[str, Any] = {
        "noise": noise,
        "model_error": model_error,
        "weight": weight,
        "levels": levels,
        "labelled": labelled,
        "unknowns": unknowns,
        "misfit": misfit,
        "max_iterations": max_iterations,
        "dispersion": dispersion,
        "device": device,
    }
    axis = moving_axis(data) if data.dim == 3 and elements is None else None
    if axis is not None and start is None:
        of_slice = partial(
            invert,
            **common,
            regulariser="smooth" if regulariser == "auto" else regulariser,
            uniform=uniform and bool(levels),
            drop_outliers=drop_outliers,
        )
        return invert_slices(data, axis, of_slice, executor, callback)
    if data.dim == 3 and dispersion == "power":
        raise InputError("dispersion", "'power'", "none: the exponent is an unknown in the plane only")
    check_passive(data)
    screened = (
        screen_outliers(data) if drop_outliers else Screened(data, [])
    )  # gross errors hide a difference of moduli
    data, notes, patches = screened
    differ = contradiction(data)
    if differ and (dispersion == "none" or data.dim == 3 or not _may_disperse(data)):
        wanted = "one frequency at a time: the moduli are not the same at all"
        if dispersion == "none" and data.dim == 2 and _may_disperse(data):
            wanted = "'power': the moduli are not the same at all frequencies"
        raise InputError("dispersion", f"none, while waves suggest {differ}", wanted)
    if data.dim == 3:
        if start is not None:
            raise InputError("start", "given", "nothing in space: there measured waves are the only start")
        if weight != "evidence":
            raise InputError("weight", repr(weight), "evidence: in space there is no other")
        in_space = invert_in_space(
            data,
            elements,
            noise=noise,
            model_error=model_error or 0.0,
            regulariser="smooth" if regulariser == "auto" else regulariser,
            labelled=labelled,
            unknowns=unknowns,
            misfit=misfit,
            levels=(levels or ()) if uniform else (),
            max_iterations=MAX_ITERATIONS if max_iterations is None else max_iterations,
            drop_outliers=False,
            device=device,
            callback=callback,
            executor=executor,
        )
        in_space.warnings += notes
        in_space.checks |= torn_patches(patches)
        return in_space
    multiples = check_levels(((1.0,) if levels is None else levels) if uniform and start is None else ())
    properties = select_properties(data, unknowns)
    if dispersion == "power" or (dispersion == "auto" and (differ or _disperses(data))):
        properties = *properties, frequency_exponent(data)
        notes += [f"waves suggest {differ}: an exponent of frequency is an unknown"] if differ else []
    notes += assumed_start_notes(data)
    rough: Inversion | None = None
    if elements is None:
        coarser = None if data.element or start is not None else coarse_discretisation(data)
        if coarser is not None and EXPONENT not in {each.name for each in properties}:
            rough = invert(
                data,
                coarser,
                **common,
                regulariser=regulariser,
                uniform=uniform,
                drop_outliers=False,
                callback=callback,
                executor=executor,
            )
            multiples = ()
        elements = original_discretisation(data) if data.element else discretise(data)
    level, note = noise_level(data, noise)
    notes += [note] if note else []
    floor = FLOOR if elements.nodal else NEW_ELEMENTS_FLOOR
    if tracked and model_error is None:
        floor = max(floor, minimum_model_error(data))
        notes.append(error_note())
    assumed = total_noise(level, floor, model_error or 0.0)
    problem = ElastographyProblem(data, elements, properties, build_composition(data, elements, labelled), where)
    notes += [problem.body.device_note] if problem.body.device_note else []
    search = _Search(problem, misfit_kind, assumed, selection, callback)
    if rough is None:
        from_waves = {
            f"from waves, {name}": (_from_waves, (*search.made_from, prior, start)) for name, prior in kinds.items()
        }
        tried = dict(zip(kinds, search.run(from_waves, executor), strict=True))
        kind = min(tried, key=lambda name: tried[name][0].score - (DECISIVE if name == next(iter(tried)) else 0.0))
        reduced, first = search.reduced(kinds[kind]), tried[kind][0]
        reduced.weights = tried[kind][1]
        both = search.descend(reduced, first)
    else:
        kind = rough.regulariser
        reduced, first = search.refine(
            kinds[kind], rough.weights, unknowns_from_maps(problem, search.unknowns, rough.maps)
        )
        both = first
    guessed = bool(note) or bool(np.all(assumed == floor))
    stated = floor if guessed else assumed
    for _ in range(LEVELS):
        found = noise_for_misfit(data, assumed, both.level.ratio, stated)
        more = rms_noise(data, found / assumed)
        if abs(np.log(more)) < CLOSE or (not guessed and np.all(assumed == stated) and more < BEYOND):
            break
        if not note:
            percent = 100 * rms_noise(data, assumed)
            note = f"the misfit is {both.level.ratio:.3g} times its expected value for noise of {percent:.3g} %"
            notes.append(f"{note}: the rest counts as model error")
        before = both.x if more < 1 else None  # an overfit is not a good start
        assumed = found
        search = _Search(problem, misfit_kind, assumed, selection, callback, search)
        if rough is None:
            reduced, first = search.from_waves(kinds[kind], start, before)
            both = search.descend(reduced, first)
        else:
            reduced, both = search.refine(kinds[kind], rough.weights, both.x)
    if rough is None:
        starts = [start_result("waves" if start is None else "given", problem, reduced, first)]
    else:
        starts = [replace(each, name=f"coarse {each.name}") for each in rough.starts]
    lower = {f"from {level:g} times": (_uniform, (*search.made_from, kinds[kind], level)) for level in multiples}
    ends = zip(multiples, search.run(lower, executor), strict=True)
    kept = select_start(both, {level: search.evaluate(reduced, end) for level, end in ends})
    notes += kept.notes
    if kept.uniform:
        starts.append(start_result("uniform", problem, reduced, kept.uniform))
    chosen = kept.chosen if rough is None else "fine"
    starts.append(start_result("both" if rough is None else "fine", problem, reduced, both))
    inversion = build_inversion(
        problem,
        reduced,
        kept.best,
        starts,
        chosen,
        noise=assumed,
        stated=rms_noise(data, total_noise(level, floor, model_error or 0.0)),
        floor=floor,
        regulariser=kind,
        weight=weight,
        history=search.history,
        notes=notes,
    )
    if rough is not None:
        inversion.solves = Solves.sum([rough.solves, inversion.solves])
    inversion.checks |= torn_patches(patches)
    return inversion


def _may_disperse(data: WaveData) -> bool:
    return data.symmetry == "isotropic" and data.rheology == "viscoelastic" and bool(np.all(data.frequency > 0))


def _disperses(data: WaveData) -> bool:
    return data.motion == "anti_plane" and _may_disperse(data) and len(np.unique(data.frequency)) > 1


class _Search:
    """Runs of one problem from several starts and with several regularisers."""

    def __init__(
        self,
        problem: ElastographyProblem,
        misfit_kind: MisfitKind,
        noise: RelativeNoise,
        selection: WeightSelection,
        callback: Callable[[Iteration], None],
        before: _Search | None = None,
    ) -> None:
        self.problem, self.noise, self.selection = problem, noise, selection
        self.history: list[Iteration] = before.history if before else []
        self._made, self._told = misfit_kind, callback
        self.made_from = misfit_kind, noise, selection
        self.sigma = noise_deviation(problem.data, noise, problem.inside)
        self.unknowns = problem.unknowns(self.sigma)
        self.misfit = misfit_kind(problem.measured, self.sigma)

    def reduced(self, prior: Prior) -> Reduced:
        """The objective with a regulariser, at the first weight."""
        space, regularisers = self.problem.space, {}
        for name, block in self.unknowns.blocks.items():
            if name not in (BOUNDARY, EXPONENT):
                regularisers[name] = prior(space, self.unknowns.start[block])
        weights = dict.fromkeys(regularisers, FIRST)
        return Reduced(self.problem.model, self.misfit, self.unknowns, regularisers, weights)

    def from_waves(
        self, prior: Prior, maps: Mapping[str, Array] | None = None, x: Array | None = None
    ) -> tuple[Reduced, OptimisationResult]:
        """Start from measured waves, and from the fields of x, of maps, or the default ones."""
        reduced, start = self.reduced(prior), self.unknowns.start.copy()
        if x is not None:
            fields = self.unknowns.blocks[BOUNDARY].start
            start[:fields] = x[:fields]
        elif maps is not None:
            start = unknowns_from_maps(self.problem, self.unknowns, maps)
        return reduced, self.selection.from_waves(reduced, start, self.problem.waves, self._report_iteration)

    def refine(self, prior: Prior, weights: Mapping[str, float], x: Array) -> tuple[Reduced, OptimisationResult]:
        """Descend from the fields and weights of an inversion in coarser elements; where no step lowers J, as from waves."""
        reduced = self.reduced(prior)
        reduced.weights = dict(weights)
        try:
            return reduced, self.selection.descend(reduced, x, self._report_iteration)
        except ConvergenceError:
            return reduced, self.selection.from_waves(reduced, x, self.problem.waves, self._report_iteration)

    def descend(self, reduced: Reduced, start: OptimisationResult) -> OptimisationResult:
        """Minimise J from a start; return the start where no step lowers J, or where its misfit is `LARGE_MISFIT`."""
        point = reduced.evaluate(start.x)
        level = MisfitLevel(self.misfit.weighted_squares(point.state.data), start.level.expected)
        if level.ratio < LARGE_MISFIT:
            try:
                return self.selection.descend(reduced, start.x, self._report_iteration)
            except ConvergenceError:
                pass
        status = start.status if level.ratio < LARGE_MISFIT else Status.STOPPED
        return replace(start, objective=point.value, level=level, status=status)

    def run(
        self, runs: Mapping[str, tuple[Callable[..., Any], tuple[Any, ...]]], executor: parallel.AnyExecutor
    ) -> list[Any]:
        """Run several starts side by side; each returns its history too."""
        found = run_starts(self.problem, runs, executor, self._told)
        for _, history in found:
            self.history += history
        return [end for end, _ in found]

    def uniform(self, prior: Prior, level: float) -> OptimisationResult | None:
        """Descend from uniform fields, with its own weights and noise of at least `UNIFORM_NOISE`; None where no step lowers J."""
        easy = self
        if np.any((noise := total_noise(self.noise, UNIFORM_NOISE)) != self.noise):
            easy = _Search(self.problem, self._made, noise, self.selection, self._told, self)
        reduced = easy.reduced(prior)
        reduced.weights = dict.fromkeys(reduced.weights, FAR)
        try:
            selection = WeightSelection(max_iterations=min(SHORT, self.selection.max_iterations))
            found = selection.descend(reduced, self.problem.uniform(easy.unknowns, level), self._report_iteration)
        except SolverError:
            return None
        held = easy.unknowns.theta(found.x)[self.problem.model.blocks[BOUNDARY]]
        x = found.x.copy()
        x[self.unknowns.blocks[BOUNDARY]] = self.unknowns.unknowns[BOUNDARY].transform.inverse(held)
        return replace(found, x=x)

    def evaluate(self, judge: Reduced, found: OptimisationResult | None) -> OptimisationResult | None:
        """The result with misfit and J of another objective."""
        if found is None:
            return None
        point = judge.evaluate(found.x)
        end = MisfitLevel(self.misfit.weighted_squares(point.state.data), found.level.expected)
        return replace(found, objective=point.value, level=end)

    def _report_iteration(self, iteration: Iteration) -> None:
        self.history.append(iteration)
        self._told(iteration)


def _from_waves(
    problem: ElastographyProblem,
    misfit_kind: MisfitKind,
    noise: RelativeNoise,
    selection: WeightSelection,
    prior: Prior,
    maps: Mapping[str, Array] | None,
    *,
    callback: Callable[[Iteration], None],
) -> tuple[tuple[OptimisationResult, dict[str, float]], list[Iteration]]:
    """The result from measured waves, and its weights."""
    search = _Search(problem, misfit_kind, noise, selection, callback)
    reduced, found = search.from_waves(prior, maps)
    return (found, reduced.weights), search.history


def _uniform(
    problem: ElastographyProblem,
    misfit_kind: MisfitKind,
    noise: RelativeNoise,
    selection: WeightSelection,
    prior: Prior,
    level: float,
    *,
    callback: Callable[[Iteration], None],
) -> tuple[OptimisationResult | None, list[Iteration]]:
    search = _Search(problem, misfit_kind, noise, selection, callback)
    return search.uniform(prior, level), search.history
