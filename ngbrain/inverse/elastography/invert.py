"""The inversion of wave data from one call: noise, elements, starts, regularisers and weights are chosen and told.

start      fields from measured waves (`GaussNewton.from_waves`), or from maps and these: every round a linear least-squares problem
regulariser  smooth fields, or fields with edges: the one with the smaller generalised cross-validation score (`priors`)
weight     settles as the fields do, or is the corner of an L-curve (`weighting`)
polish     down in J from there; and from uniform fields of one level or several. The lower J at equal weights is kept
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
from ngbrain.forward.sensitivity.harmonic.wave_model import BOUNDARY
from ngbrain.inverse.data.dispersion import contradiction
from ngbrain.inverse.data.outliers import screen_outliers
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
from ngbrain.inverse.elastography.result import Inversion, build_inversion, start_result
from ngbrain.inverse.objective.misfit import MisfitKind, resolve_misfit
from ngbrain.inverse.objective.regularisers import PRIORS, Prior, resolve_priors
from ngbrain.inverse.optimise.regularisation_weight import MisfitLevel
from ngbrain.inverse.optimise.result import Iteration, OptimisationResult
from ngbrain.inverse.optimise.weight_selection import WeightSelection, weight_selection
from ngbrain.inverse.problem.discretisation import Discretisation, discretise, original_discretisation
from ngbrain.inverse.problem.properties import EXPONENT, frequency_exponent, select_properties
from ngbrain.inverse.problem.property_fields import build_composition
from ngbrain.inverse.problem.wave_problem import ElastographyProblem
from ngbrain.io.waves import WaveData
from ngbrain.progress import log_progress, reporting
from ngbrain.result import Status
from ngbrain.solvers.device import Device

Array = np.ndarray
DISPERSIONS = ("auto", "power", "none")
REGULARISERS = tuple(PRIORS)
FIRST = 1e3
"""Weight to begin with; it settles where the data say."""
FAR = 1e4
"""The same from uniform fields: larger, as a far start has to see the whole first."""
FLOOR = 1e-5
"""Noise, relative to the waves' rms, below which data count as exact."""
OURS = 2e-3
"""The same in elements of our own: below it fields fit the error of the elements, by wiggles at the edges. At 41 points across
two waves that error is .02 to .05 % of the waves; a modulus without noise is .4 % off with .2 % assumed, .7 % with .1 %."""
LEVELS = 8
CLOSE = 0.15
BEYOND = 1.3
"""How often a level of noise that was not given is corrected by what the misfit says, and when (in ln) it agrees; one that was
given is raised when the misfit says this many times more, and then lowered again, but not below. The floors are no levels that
were given."""
ASTRAY = 100.0
"""Times its expected level that the misfit of a start's fields is, beyond which its level of noise is corrected before any way
down: nearly exact data are seen from afar first, as those of ten times the noise are, then closer and closer."""
DECISIVE = 4.0
"""By how much the score of edges has to be lower than that of smooth fields: a likelihood ratio of e². Far from edges both are
the same regulariser, and chance would choose."""
SHORT = 12
"""Rounds from uniform fields: enough to arrive, or to be stuck."""
EASY = 1e-4
"""Noise that is assumed at least from there: with less, linear theory sees little of the way."""


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
    """Property maps of wave data in the plane; those in space go to `invert_in_space`, which chooses starts and weights itself.

    Slabs of which one component alone was measured, the one through their slices, go slice by slice (`slab`).

    elements     see `discretise`; by default those that the data were made in, if they say so, else our own
    noise        relative to the rms of each component, one number; by default what the data say, or what a smooth fit leaves over
    model_error  of the same kind: what the model cannot fit, such as another discretisation; by default none, and of displacements
                 that are tracked at rest `tracked.least_error`
    regulariser  one of `priors.PRIORS`, a prior of one's own, or auto: smooth or edges, the better by cross-validation;
                 of displacements that are tracked at rest steps, see `tracked`
    weight       one of `weighting.WEIGHTINGS`: evidence, discrepancy or l-curve
    uniform      whether to try uniform fields as a start too
    levels       where these start, as multiples of the modulus that the waves suggest; the lowest J is kept. By default at 1 in the
                 plane, and nowhere in space, where each takes as long as the rest
    labelled     whether each label of the data has fields of its own, which jump where labels meet
    unknowns     one of `quantities.UNKNOWNS`: moduli (ln storage and ln loss), or polar, ln G* with its phase
    misfit       one of `misfit.MISFITS`, or one of one's own: squares, or huber for what `remove_outliers` misses
    start        name → (n,), maps that measured waves start with, see `starts.at_maps`, and nothing else then. In the plane alone
    rounds       iterations down from a start at most, those from measured waves apart; by default 96 in the plane and 16 in space
    dispersion   power: G*(x, ω) = G*₀(x) (ω/ω₀)^a with one exponent a that is found, ω₀ the lowest frequency, at which maps are;
                 none: the same G* at all frequencies, refused where these contradict each other (`dispersion.contradiction`); auto:
                 power for anti-plane waves of several frequencies and where these contradict each other, none otherwise
    drop_outliers  whether gross errors are looked for before anything else and left out, see `remove_outliers`
    device       one of `solvers.device.DEVICES`: cpu, cuda for factors and solves on a GPU, ngsolve for solves alone, or auto: the
                 processor below the size at which a GPU was measured to be faster, see `Device.for_unknowns`
    executor     who inverts the slices of a slab, and goes down from several starts or with several regularisers, each on one
                 thread (`parallel.run`): by default this process; the answer does not depend on it

    Raises `InputError` for waves that gain energy (`check_passive`), a regulariser, unknowns, misfit or weight that is none,
    negative noise, no rounds, data that cannot be inverted, a device that is none or not there; `MissingExtra` for cuda without
    nvmath-python.

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
    settling, made = weight_selection(weight), resolve_misfit(misfit)
    for name, value in (("noise", noise), ("model_error", model_error)):
        if value is not None and not 0 <= value < np.inf:
            raise InputError(name, value, "a relative level of at least 0")
    if max_iterations is not None:
        check_iterations(max_iterations)
        settling = replace(settling, max_iterations=max_iterations)
    if dispersion not in DISPERSIONS:
        raise InputError("dispersion", repr(dispersion), nearest(dispersion, DISPERSIONS))
    axis = moving_axis(data) if data.dim == 3 and elements is None else None
    if axis is not None and start is None:
        of_slice = partial(
            invert,
            noise=noise,
            model_error=model_error,
            regulariser="smooth" if regulariser == "auto" else regulariser,
            weight=weight,
            uniform=uniform and bool(levels),
            levels=levels,
            labelled=labelled,
            unknowns=unknowns,
            misfit=misfit,
            max_iterations=max_iterations,
            dispersion=dispersion,
            drop_outliers=drop_outliers,
            device=device,
        )

        return invert_slices(data, axis, of_slice, executor, callback)
    if data.dim == 3 and dispersion == "power":
        raise InputError("dispersion", "'power'", "none: it is looked for in the plane alone")
    check_passive(data)
    data, notes = screen_outliers(data) if drop_outliers else (data, [])  # gross errors hide that moduli differ
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
        return in_space
    multiples = check_levels(((1.0,) if levels is None else levels) if uniform and start is None else ())
    sought = select_properties(data, unknowns)
    if dispersion == "power" or (dispersion == "auto" and (differ or _disperses(data))):
        sought = *sought, frequency_exponent(data)
        notes += [f"waves suggest {differ}: an exponent of frequency is looked for"] if differ else []
    notes += assumed_start_notes(data)
    if elements is None:
        elements = original_discretisation(data) if data.element else discretise(data)
    level, note = noise_level(data, noise)
    notes += [note] if note else []
    floor = FLOOR if elements.nodal else OURS
    if tracked and model_error is None:
        floor = max(floor, minimum_model_error(data))
        notes.append(error_note())
    sure = total_noise(level, floor, model_error or 0.0)
    problem = ElastographyProblem(data, elements, sought, build_composition(data, elements, labelled), where)
    notes += [problem.body.device_note] if problem.body.device_note else []
    search = _Search(problem, made, sure, settling, callback)
    from_waves = {
        f"from waves, {name}": (_from_waves, (*search.made_from, prior, start)) for name, prior in kinds.items()
    }
    tried = dict(zip(kinds, search.gone(from_waves, executor), strict=True))
    kind = min(tried, key=lambda name: tried[name][0].score - (DECISIVE if name == next(iter(tried)) else 0.0))
    reduced, first = search.reduced(kinds[kind]), tried[kind][0]
    reduced.weights = tried[kind][1]
    both = search.descend(reduced, first)
    guessed = bool(note) or bool(np.all(sure == floor))
    stated = floor if guessed else sure
    for _ in range(LEVELS):
        found = noise_for_misfit(data, sure, both.level.ratio, stated)
        more = rms_noise(data, found / sure)
        if abs(np.log(more)) < CLOSE or (not guessed and np.all(sure == stated) and more < BEYOND):
            break
        if not note:
            note = (
                f"the misfit is {both.level.ratio:.3g} times what noise of {100 * rms_noise(data, sure):.3g} % leaves"
            )
            notes.append(f"{note}: the rest counts as model error")
        before = both.x if more < 1 else None  # what was fitted too closely is no start
        sure = found
        search = _Search(problem, made, sure, settling, callback, search)
        reduced, first = search.from_waves(kinds[kind], start, before)
        both = search.descend(reduced, first)
    rows = [start_result("waves" if start is None else "given", problem, reduced, first)]
    lower = {f"from {level:g} times": (_uniform, (*search.made_from, kinds[kind], level)) for level in multiples}
    ends = zip(multiples, search.gone(lower, executor), strict=True)
    kept = select_start(both, {level: search.judged(reduced, end) for level, end in ends})
    notes += kept.notes
    if kept.uniform:
        rows.append(start_result("uniform", problem, reduced, kept.uniform))
    rows.append(start_result("both", problem, reduced, both))
    return build_inversion(
        problem,
        reduced,
        kept.best,
        rows,
        kept.chosen,
        noise=sure,
        stated=rms_noise(data, total_noise(level, floor, model_error or 0.0)),
        floor=floor,
        regulariser=kind,
        weight=weight,
        history=search.history,
        notes=notes,
    )


def _may_disperse(data: WaveData) -> bool:
    return data.symmetry == "isotropic" and data.rheology == "viscoelastic" and bool(np.all(data.frequency > 0))


def _disperses(data: WaveData) -> bool:
    return data.motion == "anti_plane" and _may_disperse(data) and len(np.unique(data.frequency)) > 1


class _Search:
    """Runs of one experiment from several starts and with several regularisers."""

    def __init__(
        self,
        problem: ElastographyProblem,
        made: MisfitKind,
        noise: RelativeNoise,
        settling: WeightSelection,
        callback: Callable[[Iteration], None],
        before: _Search | None = None,
    ) -> None:
        self.problem, self.noise, self.settling = problem, noise, settling
        self.history: list[Iteration] = before.history if before else []
        self._made, self._told = made, callback
        self.made_from = made, noise, settling
        self.sigma = noise_deviation(problem.data, noise, problem.inside)
        self.unknowns = problem.unknowns(self.sigma)
        self.misfit = made(problem.measured, self.sigma)

    def reduced(self, prior: Prior) -> Reduced:
        """With a regulariser, at the first weight."""
        space, regularisers = self.problem.space, {}
        for name, block in self.unknowns.blocks.items():
            if name not in (BOUNDARY, EXPONENT):
                regularisers[name] = prior(space, self.unknowns.start[block])
        weights = dict.fromkeys(regularisers, FIRST)
        return Reduced(self.problem.model, self.misfit, self.unknowns, regularisers, weights)

    def from_waves(
        self, prior: Prior, maps: Mapping[str, Array] | None = None, x: Array | None = None
    ) -> tuple[Reduced, OptimisationResult]:
        """From measured waves, and the fields of other unknowns x if there are any, or else those of maps."""
        reduced, start = self.reduced(prior), self.unknowns.start.copy()
        if x is not None:
            fields = self.unknowns.blocks[BOUNDARY].start
            start[:fields] = x[:fields]
        elif maps is not None:
            start = unknowns_from_maps(self.problem, self.unknowns, maps)
        return reduced, self.settling.from_waves(reduced, start, self.problem.waves, self._tell)

    def descend(self, reduced: Reduced, start: OptimisationResult) -> OptimisationResult:
        """Down in J from a start, or the start itself where nothing is lower or it is `ASTRAY`."""
        point = reduced.evaluate(start.x)
        level = MisfitLevel(self.misfit.weighted_squares(point.state.data), start.level.expected)
        if level.ratio < ASTRAY:
            try:
                return self.settling.descend(reduced, start.x, self._tell)
            except ConvergenceError:
                pass
        status = start.status if level.ratio < ASTRAY else Status.STOPPED
        return replace(start, objective=point.value, level=level, status=status)

    def gone(
        self, ways: Mapping[str, tuple[Callable[..., Any], tuple[Any, ...]]], executor: parallel.AnyExecutor
    ) -> list[Any]:
        """Where ways end, side by side; each returns its history too."""
        found = run_starts(self.problem, ways, executor, self._told)
        for _, history in found:
            self.history += history
        return [end for end, _ in found]

    def uniform(self, prior: Prior, level: float) -> OptimisationResult | None:
        """From uniform fields, at weights of its own and noise of `EASY` at least; None where no step is lower."""
        easy = self
        if np.any((noise := total_noise(self.noise, EASY)) != self.noise):
            easy = _Search(self.problem, self._made, noise, self.settling, self._told, self)
        reduced = easy.reduced(prior)
        reduced.weights = dict.fromkeys(reduced.weights, FAR)
        try:
            settling = WeightSelection(max_iterations=min(SHORT, self.settling.max_iterations))
            found = settling.descend(reduced, self.problem.uniform(easy.unknowns, level), self._tell)
        except SolverError:
            return None
        held = easy.unknowns.theta(found.x)[self.problem.model.blocks[BOUNDARY]]
        x = found.x.copy()
        x[self.unknowns.blocks[BOUNDARY]] = self.unknowns.unknowns[BOUNDARY].transform.inverse(held)
        return replace(found, x=x)

    def judged(self, judge: Reduced, found: OptimisationResult | None) -> OptimisationResult | None:
        """With misfit and J as `judge` has them."""
        if found is None:
            return None
        point = judge.evaluate(found.x)
        end = MisfitLevel(self.misfit.weighted_squares(point.state.data), found.level.expected)
        return replace(found, objective=point.value, level=end)

    def _tell(self, iteration: Iteration) -> None:
        self.history.append(iteration)
        self._told(iteration)


def _from_waves(
    problem: ElastographyProblem,
    made: MisfitKind,
    noise: RelativeNoise,
    settling: WeightSelection,
    prior: Prior,
    maps: Mapping[str, Array] | None,
    *,
    callback: Callable[[Iteration], None],
) -> tuple[tuple[OptimisationResult, dict[str, float]], list[Iteration]]:
    """Where measured waves lead to, and the weights by then."""
    search = _Search(problem, made, noise, settling, callback)
    reduced, found = search.from_waves(prior, maps)
    return (found, reduced.weights), search.history


def _uniform(
    problem: ElastographyProblem,
    made: MisfitKind,
    noise: RelativeNoise,
    settling: WeightSelection,
    prior: Prior,
    level: float,
    *,
    callback: Callable[[Iteration], None],
) -> tuple[OptimisationResult | None, list[Iteration]]:
    search = _Search(problem, made, noise, settling, callback)
    return search.uniform(prior, level), search.history
