"""Search from the cheapest model up to the first one whose estimated error is within the tolerances."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from ngbrain import parallel
from ngbrain.errors import SolverError
from ngbrain.ladder.axes import ELEMENTS, Axis, axes_of, cheapest, check_levels
from ngbrain.ladder.estimates import ESTIMATORS, LARGE, NOTHING, SOLVED, Estimate, Solved, relative_difference
from ngbrain.ladder.levels import MeshLevel, Model
from ngbrain.ladder.models.hierarchy import ModelHierarchy
from ngbrain.ladder.quantities import Asked, Question
from ngbrain.ladder.solutions import SolutionCache
from ngbrain.result import Result, Status
from ngbrain.scene import Scene

Array = np.ndarray
LOG = logging.getLogger(__name__)
NARROW = 0.8
"""Fraction of the tolerance above which a warning is given: estimates are no bounds."""
LEFT = 0.25
"""Fraction of a refinement step that the next one changes at least; the same is left where only some elements are refined."""
HALF = 0.5
"""Fraction of the change by a higher order that a refinement changes at least: an error proportional to the element size is halved.
"""
TELLING, TURNED = 0.25, "finer elements changed the answer the other way than foretold"
"""Fraction of the tolerance above which a change with the opposite sign of its estimate is reported; and the text."""
LOCKED = "elements lock without pressures of their own, in space more than in the section"
CHEAP = 8.0
"""Growth in cost above which a single refinement step is tried alone, as for waves, which are solved once."""
UNDER_WAY = "a better model is under way, or was when this stopped"
"""Warning of a result that is not final."""
CHANCE = 0.5
"""Fraction of the root of the sum of squares of all changes that is expected at least."""
MOST = 1e3
"""Gain, in tolerances, above which all gains count the same: among the most important steps the cheapest comes first."""


@dataclass(eq=False)
class Rung:
    """A model of the search.

    Parameters
    ----------
    model : dict of str
        Axis → level.
    answers : (n,) array
        SI units.
    ndof : int
        Number of unknowns.
    estimates : dict of Estimate
        Axis → estimated change by its next step.
    missing : (n,) array
        Estimated bound of the relative error of each answer: the sum of all changes.
    taken : tuple of str
        Axes that were enriched next; empty at the end of the search.
    cost_s : float
        Computing time (s) up to and including this model's estimates.
    scales : (n,) array
        Reference size of each answer where it is nearly zero.
    expected : (n,) array
        Expected relative error: changes of different axes may have different signs.
    """

    model: dict[str, str]
    answers: Array
    ndof: int
    estimates: dict[str, Estimate]
    missing: Array
    taken: tuple[str, ...] = ()
    cost_s: float = 0.0
    scales: Array | float = 0.0
    expected: Array = field(default_factory=lambda: np.zeros(0))

    def __str__(self) -> str:
        """A short progress text."""
        return f"{self.ndof} unknowns, {100 * float(self.missing.max()):.3g} % missing"


@dataclass(repr=False, eq=False)
class SearchResult(Result):
    """Result of a search: all models (`history`, the last one chosen), the scene's axes, and `warnings` on the answer's
    reliability.
    """

    axes: dict[str, Axis]

    @property
    def value(self) -> Array:
        """The answers of the chosen model."""
        return self.chosen.answers

    @property
    def statistics(self) -> dict[str, float]:
        """Number of models with estimates, and number of unknowns of the chosen one."""
        return {"rungs": len(self.history), "unknowns": self.chosen.ndof}

    @property
    def error(self) -> Array:
        """Expected relative error of each answer; the search ends by the bound `missing`."""
        return self.chosen.expected

    @property
    def chosen(self) -> Rung:
        """The last model."""
        rung: Rung = self.history[-1]
        return rung


def search_models(
    scene: Scene,
    richest: Model | None = None,
    callback: Callable[[Rung], None] = lambda _: None,
    keeper: SolutionCache | None = None,
    executor: parallel.AnyExecutor = None,
    questions: Sequence[Question] = (),
    watch: Callable[[SearchResult], Any] = lambda _: None,
) -> SearchResult:
    """Search for the cheapest model that is accurate enough.

    Parameters
    ----------
    scene : Scene
    richest : mapping of str, optional
        Axis → its last level.
    callback : callable
        Called with every `Rung`.
    keeper : SolutionCache, optional
        Solutions that are already known.
    executor : int or concurrent.futures.Executor, optional
    questions : sequence of Question
        Observables in addition to the scene's quantities.
    watch : callable
        Called with the unfinished search after every model but the last.

    Returns
    -------
    SearchResult

    Raises
    ------
    SolverError
        The cheapest model has no solution.
    """
    asked: list[Asked] = [*scene.quantities, *questions]
    tolerances = np.array([quantity.tolerance for quantity in asked])
    axes = axes_of(scene, richest, questions)
    return search_along(
        axes, keeper or SolutionCache(ModelHierarchy(scene, questions), executor), tolerances, callback, watch
    )


def search_along(
    axes: Mapping[str, Axis],
    keeper: SolutionCache,
    tolerances: Array,
    callback: Callable[[Rung], None],
    watch: Callable[[SearchResult], Any] = lambda _: None,
) -> SearchResult:
    """Search along given axes.

    Parameters
    ----------
    axes : mapping of Axis
    keeper : SolutionCache
    tolerances : (n,) array
        Relative tolerance of each answer.
    callback, watch : callable
        See `search_models`.

    Returns
    -------
    SearchResult
    """
    model, rungs, begun = cheapest(axes), list[Rung](), keeper.clock()
    refused: dict[str, str] = {}
    while True:
        open_axes = {name: axis for name, axis in axes.items() if axis.next_level(model[name]) and name not in refused}
        rung = _learnt(_rung(keeper, model, open_axes), rungs, axes, tolerances)
        if np.all(rung.missing <= tolerances):
            rung = _confirmed(keeper, rung, axes)
        rung.cost_s = keeper.clock() - begun
        rungs.append(rung)
        LOG.info("%s", rung)
        if np.all(rung.missing <= tolerances) or not open_axes:
            break
        rung.taken = _next(open_axes, rung, tolerances)
        callback(rung)
        watch(
            SearchResult(
                dict(axes), status=Status.STOPPED, history=list(rungs), warnings=[UNDER_WAY, *_doubts(keeper, rung)]
            )
        )
        richer = {**model, **{name: _towards(axes[name], rung, tolerances) for name in rung.taken}}
        try:
            keeper(richer)
            model = richer
            refused.clear()  # what could not be solved in poorer elements may be in these
        except SolverError as error:
            refused |= dict.fromkeys(rung.taken[1:] or rung.taken, str(error))
    unjudged = {name: why for name, why in refused.items() if axes[name].next_level(model[name])}
    for name, why in unjudged.items():  # a judge that failed says nothing: the error is not known
        to = axes[name].estimated_level(model[name])
        rungs[-1].estimates[name] = Estimate(np.full(len(tolerances), np.inf), "not to be solved", why, to)
    more, flags = _at_the_top(axes, rungs, tolerances)
    _judge(rungs[-1], axes, more)
    callback(rungs[-1])
    flags = _doubts(keeper, rungs[-1]) + flags + _nothing(rungs[-1])
    if np.any(rungs[-1].missing > NARROW * tolerances):
        much = "more than" if np.any(rungs[-1].missing > tolerances) else "nearly"
        flags.append(f"what is missing is {much} the tolerance")
    within = bool(np.all(rungs[-1].missing <= tolerances))
    reason = "" if within else f"{_percent(rungs[-1].missing)} may be missing, of {_percent(tolerances)} asked for"
    status = Status.CONVERGED if within else Status.INACCURATE
    return SearchResult(dict(axes), status=status, reason=reason, history=rungs, warnings=flags)


def _percent(errors: Array) -> str:
    return ", ".join(f"{100 * error:.3g} %" for error in errors)


def _rung(keeper: SolutionCache, model: Model, above: Mapping[str, Axis]) -> Rung:
    """A model with the estimated changes by the next step of each axis."""
    found = keeper(model)
    estimates = keeper.run_estimates({name: partial(estimate, keeper, model, axis) for name, axis in above.items()})
    if set(ELEMENTS) <= set(estimates) and not MeshLevel(model["mesh"]).is_partial:
        estimates["mesh"] = _as_order(estimates["mesh"], estimates["order"])
    for name in ELEMENTS if "pressure" in estimates else ():
        if name in estimates and np.any(np.abs(estimates["pressure"].change) > np.abs(estimates[name].change)):
            estimates[name] = _doubted(estimates[name], LOCKED)
    rung = Rung(dict(model), found.answers, found.ndof, estimates, np.zeros(0), scales=found.scales)
    return _judge(rung, above)


def assess(
    scene: Scene, model: Model, executor: parallel.AnyExecutor = None, questions: Sequence[Question] = ()
) -> SearchResult:
    """Estimate the error of a given model, without a search.

    Parameters
    ----------
    scene : Scene
    model : mapping of str
        Axis → level; other axes are at their cheapest level.
    executor : int or concurrent.futures.Executor, optional
    questions : sequence of Question

    Returns
    -------
    SearchResult
        With one model.
    """
    return assess_along(
        axes_of(scene, questions=questions), SolutionCache(ModelHierarchy(scene, questions), executor), model
    )


def assess_along(axes: Mapping[str, Axis], keeper: SolutionCache, model: Model) -> SearchResult:
    """Estimate the error of a given model along given axes.

    Parameters
    ----------
    axes : mapping of Axis
    keeper : SolutionCache
    model : mapping of str
        Axis → level; other axes are at their cheapest level.

    Returns
    -------
    SearchResult

    Raises
    ------
    InputError
        An axis or level that the scene does not have.
    """
    check_levels("model", model, axes)
    model = {**cheapest(axes), **model}
    begun = keeper.clock()
    rung = _rung(keeper, model, {name: axis for name, axis in axes.items() if axis.next_level(model[name])})
    rung.cost_s = keeper.clock() - begun
    return SearchResult(dict(axes), status=Status.CONVERGED, history=[rung], warnings=_doubts(keeper, rung))


def _doubts(keeper: SolutionCache, rung: Rung) -> list[str]:
    """Warnings of the estimates and of the solvers."""
    of_estimates = [f"{name}: {each.doubt}" for name, each in rung.estimates.items() if each.doubt]
    return [*of_estimates, *keeper(rung.model).doubts]


def estimate(keeper: SolutionCache, model: Model, axis: Axis, solved: Solved | None = None) -> Estimate:
    """Estimate the change by the next step of an axis; a large change is unreliable until the richer model has been solved.

    Parameters
    ----------
    keeper : SolutionCache
    model : mapping of str
    axis : Axis
    solved : callable, optional
        Gives solutions of models; by default the cache.

    Returns
    -------
    Estimate
    """
    to = axis.estimated_level(model[axis.name])
    found = ESTIMATORS[axis.by[axis.index(model[axis.name])]](
        keeper.solver, model, {**model, axis.name: to}, solved or keeper
    )
    largest = float(np.max(np.abs(found.change)))
    large = "" if largest <= LARGE or found.how == SOLVED else f"a change of {largest:.0%} is not one of first order"
    return replace(found, to=to, doubt=found.doubt or large)


def _confirmed(keeper: SolutionCache, rung: Rung, axes: Mapping[str, Axis]) -> Rung:
    """The model with unreliable estimates replaced by solutions, where possible: no search ends on an unreliable estimate."""
    for name, each in rung.estimates.items():
        if not each.doubt or each.how == SOLVED:
            continue
        try:
            after = keeper({**rung.model, name: each.to}).answers
        except SolverError:
            continue  # the doubt stays
        rung.estimates[name] = Estimate(relative_difference(rung.answers, after, rung.scales), SOLVED, to=each.to)
    return _judge(replace(rung), axes)


def _judge(rung: Rung, axes: Mapping[str, Axis], more: Array | float = 0.0) -> Rung:
    """Combine the changes of all steps; of higher order and refinement the larger one counts, since both reduce the same error.

    Changes that cancel may do so by chance: at least half of the root of their sum of squares is expected.
    """
    changes = {name: each.change * axes[name].tail for name, each in rung.estimates.items()}
    elements = [changes.pop(name) for name in ELEMENTS if name in changes]
    parts = [*changes.values(), np.zeros(len(rung.answers))]
    if elements:
        parts.append(elements[0] if len(elements) == 1 else _larger(*elements))
    rung.missing = np.sum(np.abs(parts), axis=0) + more
    known = np.isfinite(rung.missing)
    together, apart = np.abs(np.sum(parts, axis=0, where=known)), np.sqrt(np.sum(np.square(parts), axis=0, where=known))
    rung.expected = np.where(known, np.maximum(together, CHANCE * apart) + more, np.inf)
    return rung


def _learnt(rung: Rung, before: list[Rung], axes: Mapping[str, Axis], tolerances: Array) -> Rung:
    """Update the estimates of refinement by the change of the last such step: they are at least a part of it, and unreliable where
    it had the opposite sign of its estimate.

    Plane sections do not contain the corners of bodies in space.
    """
    above = [name for name in ELEMENTS if name in rung.estimates]
    last = next((each for each in reversed(before) if set(each.taken) & set(ELEMENTS)), None)
    if not above or last is None or last.model.get("space") != rung.model.get("space"):
        return rung
    after = before[before.index(last) + 1] if last is not before[-1] else rung
    changed = relative_difference(last.answers, after.answers, last.scales)
    told = sum((last.estimates[name].change for name in last.taken), np.zeros(len(changed)))
    if np.any((told * changed < 0) & (np.minimum(np.abs(told), np.abs(changed)) > TELLING * tolerances)):
        rung.estimates |= {name: _doubted(rung.estimates[name], TURNED) for name in above}
    floor = LEFT ** len(last.taken) * changed
    name = max(above, key=lambda each: float(np.max(np.abs(rung.estimates[each].change))))
    found = rung.estimates[name]
    if found.how == SOLVED or np.all(np.abs(found.change) >= np.abs(floor)):
        return rung
    raised = replace(found, change=_larger(found.change, floor), how="a part of what the last step changed")
    rung.estimates[name] = raised
    return _judge(replace(rung), axes)


def _as_order(mesh: Estimate, order: Estimate) -> Estimate:
    """Estimate of refinement, at least a part of the change by a higher order: both reduce the same error.

    Plane sections of strongly compressed bodies may underestimate it, where errors of both signs cancel.
    """
    least = HALF * np.nan_to_num(order.change, posinf=0.0, neginf=0.0)
    if mesh.how == SOLVED or np.all(np.abs(mesh.change) >= np.abs(least)):
        return mesh
    return replace(mesh, change=_larger(mesh.change, least), how="half of what a higher order would change")


def _doubted(found: Estimate, why: str) -> Estimate:
    return found if found.how == SOLVED or found.doubt else replace(found, doubt=why)


def _larger(one: Array, other: Array) -> Array:
    """Of two changes of each answer the one with the larger magnitude."""
    return np.where(np.abs(other) > np.abs(one), other, one)  # what is not known stays so


def _next(above: Mapping[str, Axis], rung: Rung, tolerances: Array) -> tuple[str, ...]:
    """The axes to enrich next: the discretisation after all physics that cannot be left out, which is cheap on coarse elements.

    Where one refinement step would leave more than the tolerance, size and order are refined together: the model in between would
    not be the last, and is expensive unless it is `CHEAP`.
    """

    def gains(name: str) -> float:
        return float(np.max(np.abs(rung.estimates[name].change) / tolerances))

    must = [name for name in above if gains(name) > 1 and name not in ELEMENTS]
    taken = max(must or above, key=lambda name: _worth(above[name], rung, tolerances))
    if taken not in ELEMENTS or not set(ELEMENTS) <= set(above):
        return (taken,)
    (other,) = (name for name in ELEMENTS if name != taken)
    short = np.any(_left(above, rung, taken) > tolerances) and _growth(above[other], rung) < CHEAP
    return (taken, other) if short else (taken,)


def _left(above: Mapping[str, Axis], rung: Rung, taken: str) -> Array:
    """Remaining change of the discretisation after a step along one of its axes.

    The larger of a part of the step (`LEFT`) and the change of the other axis: half of it if that is the order, as elements got
    smaller, and all of it if it is their size, as large elements stay.
    """
    kept = {name: LEFT if name == taken else HALF if name == "order" else 1.0 for name in ELEMENTS}
    parts = [part * np.abs(rung.estimates[name].change) * above[name].tail for name, part in kept.items()]
    return np.asarray(np.max(parts, axis=0))


def _towards(axis: Axis, rung: Rung, tolerances: Array) -> str:
    """The level of the next step: a partial level, if there is one and the change left after it is tolerable.

    It is counted as in `_learnt`, for all axes that are enriched together: otherwise the next step would follow anyway.
    """
    whole, part = rung.estimates[axis.name].to, axis.next_level(rung.model[axis.name])
    if not part or not part.is_partial:
        return whole
    told = sum(np.abs(rung.estimates[name].change) for name in rung.taken)
    return part if np.all(LEFT ** len(rung.taken) * told * axis.tail <= tolerances) else whole


def _worth(axis: Axis, rung: Rung, tolerances: Array) -> float:
    """Benefit of the next step of an axis, in tolerances, over its cost."""
    gain = np.abs(rung.estimates[axis.name].change) * axis.tail / tolerances
    return float(np.max(np.minimum(gain, MOST))) / _growth(axis, rung)


def _growth(axis: Axis, rung: Rung) -> float:
    """Factor in cost of the next step."""
    return axis.growth[axis.index(rung.model[axis.name])]


def _at_the_top(axes: Mapping[str, Axis], rungs: list[Rung], tolerances: Array) -> tuple[Array, list[str]]:
    """Remaining error of axes at their richest level, from the change of the last step; and warnings where it is too large."""
    more, flags = np.zeros(len(tolerances)), []
    for name in ELEMENTS:
        if name not in axes or axes[name].next_level(rungs[-1].model[name]):
            continue  # it has an estimate
        for before, after in pairwise(rungs):
            if name in before.taken and after.model[name] == axes[name].levels[-1]:
                last = np.abs(relative_difference(before.answers, after.answers, before.scales)) * (axes[name].tail - 1)
                more += last
                if np.any(last > tolerances):
                    flags.append(f"{name}: the last step may leave {100 * np.max(last):.2g} %, and there is none above")
    return more, flags


def _nothing(rung: Rung) -> list[str]:
    """Warnings on answers that are nearly zero, whose errors are relative to their reference size."""
    scales = np.broadcast_to(np.asarray(rung.scales, float), rung.answers.shape)
    return [
        f"answer {i} is nearly nothing: its error is a part of {NOTHING * scale:.3g}, {NOTHING:.0%} of the largest of its kind"
        for i, (value, scale) in enumerate(zip(rung.answers, scales, strict=True), 1)
        if abs(value) < NOTHING * scale
    ]
