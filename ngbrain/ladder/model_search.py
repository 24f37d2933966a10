"""Search from the cheapest model up to the first one whose estimated error is within the tolerances."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
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
from ngbrain.ladder.next_step import HALF_OF_ORDER, REMAINING_FRACTION, next_axes, target_level
from ngbrain.ladder.quantities import Asked, Question
from ngbrain.ladder.search_result import Rung, SearchResult
from ngbrain.ladder.solutions import SolutionCache
from ngbrain.result import Status
from ngbrain.scene import Scene

Array = np.ndarray
LOG = logging.getLogger(__name__)
WARNING_FRACTION = 0.8
"""Fraction of the tolerance above which a warning is given: estimates are no bounds."""
REPORTED, OPPOSITE_SIGN = 0.25, "refinement changed the answer in the direction opposite to its estimate"
"""Fraction of the tolerance above which a change with the opposite sign of its estimate is reported; and the text."""
LOCKING = "elements without pressure unknowns lock, in 3-D more than in the section"
NOT_FINAL = "not final: the search was still running when this was written, or was interrupted"
"""Warning of a result that is not final."""
MIN_ROOT_SQUARES = 0.5
"""Fraction of the root of the sum of squares of all changes that is expected at least."""


def search_models(
    scene: Scene,
    richest: Model | None = None,
    callback: Callable[[Rung], None] = lambda _: None,
    cache: SolutionCache | None = None,
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
    cache : SolutionCache, optional
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
        axes, cache or SolutionCache(ModelHierarchy(scene, questions), executor), tolerances, callback, watch
    )


def search_along(
    axes: Mapping[str, Axis],
    cache: SolutionCache,
    tolerances: Array,
    callback: Callable[[Rung], None],
    watch: Callable[[SearchResult], Any] = lambda _: None,
) -> SearchResult:
    """Search along given axes.

    Parameters
    ----------
    axes : mapping of Axis
    cache : SolutionCache
    tolerances : (n,) array
        Relative tolerance of each answer.
    callback, watch : callable
        See `search_models`.

    Returns
    -------
    SearchResult
    """
    model, rungs, begun = cheapest(axes), list[Rung](), cache.clock()
    refused: dict[str, str] = {}
    while True:
        open_axes = {name: axis for name, axis in axes.items() if axis.next_level(model[name]) and name not in refused}
        rung = _update_from_last_step(_rung(cache, model, open_axes), rungs, axes, tolerances)
        if np.all(rung.error_bound <= tolerances):
            rung = _solve_unreliable(cache, rung, axes)
        rung.cost_s = cache.clock() - begun
        rungs.append(rung)
        LOG.info("%s", rung)
        if np.all(rung.error_bound <= tolerances) or not open_axes:
            break
        rung.next_axes = next_axes(open_axes, rung, tolerances)
        callback(rung)
        watch(
            SearchResult(
                dict(axes),
                status=Status.STOPPED,
                history=list(rungs),
                warnings=[NOT_FINAL, *_collect_warnings(cache, rung)],
            )
        )
        richer = {**model, **{name: target_level(axes[name], rung, tolerances) for name in rung.next_axes}}
        try:
            cache(richer)
            model = richer
            refused.clear()  # a step that failed on coarser elements may succeed on these
        except SolverError as error:
            refused |= dict.fromkeys(rung.next_axes[1:] or rung.next_axes, str(error))
    unjudged = {name: why for name, why in refused.items() if axes[name].next_level(model[name])}
    for name, why in unjudged.items():  # without an estimate the error is unknown
        to = axes[name].estimated_level(model[name])
        rungs[-1].estimates[name] = Estimate(np.full(len(tolerances), np.inf), "no solution", why, to)
    more, flags = _richest_level_errors(axes, rungs, tolerances)
    _combine_changes(rungs[-1], axes, more)
    callback(rungs[-1])
    flags = _collect_warnings(cache, rungs[-1]) + flags + _near_zero_warnings(rungs[-1])
    if np.any(rungs[-1].error_bound > WARNING_FRACTION * tolerances):
        much = "above" if np.any(rungs[-1].error_bound > tolerances) else "close to"
        flags.append(f"the estimated error is {much} the tolerance")
    within = bool(np.all(rungs[-1].error_bound <= tolerances))
    reason = "" if within else f"estimated error {_percent(rungs[-1].error_bound)}, tolerance {_percent(tolerances)}"
    status = Status.CONVERGED if within else Status.INACCURATE
    states = cache(rungs[-1].model).states
    return SearchResult(dict(axes), status=status, reason=reason, history=rungs, warnings=flags, states=states)


def _percent(errors: Array) -> str:
    return ", ".join(f"{100 * error:.3g} %" for error in errors)


def _rung(cache: SolutionCache, model: Model, above: Mapping[str, Axis]) -> Rung:
    """A model with the estimated changes by the next step of each axis."""
    found = cache(model)
    estimates = cache.run_estimates({name: partial(estimate, cache, model, axis) for name, axis in above.items()})
    if set(ELEMENTS) <= set(estimates) and not MeshLevel(model["mesh"]).is_partial:
        estimates["mesh"] = _at_least_half_of_order(estimates["mesh"], estimates["order"])
    for name in ELEMENTS if "pressure" in estimates else ():
        if name in estimates and np.any(np.abs(estimates["pressure"].change) > np.abs(estimates[name].change)):
            estimates[name] = _mark_unreliable(estimates[name], LOCKING)
    rung = Rung(dict(model), found.answers, found.ndof, estimates, np.zeros(0), scales=found.scales)
    return _combine_changes(rung, above)


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


def assess_along(axes: Mapping[str, Axis], cache: SolutionCache, model: Model) -> SearchResult:
    """Estimate the error of a given model along given axes.

    Parameters
    ----------
    axes : mapping of Axis
    cache : SolutionCache
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
    begun = cache.clock()
    rung = _rung(cache, model, {name: axis for name, axis in axes.items() if axis.next_level(model[name])})
    rung.cost_s = cache.clock() - begun
    found, doubts = cache(rung.model), _collect_warnings(cache, rung)
    return SearchResult(dict(axes), status=Status.CONVERGED, history=[rung], warnings=doubts, states=found.states)


def _collect_warnings(cache: SolutionCache, rung: Rung) -> list[str]:
    """Warnings of the estimates and of the solvers."""
    of_estimates = [f"{name}: {each.caution}" for name, each in rung.estimates.items() if each.caution]
    return [*of_estimates, *cache(rung.model).doubts]


def estimate(cache: SolutionCache, model: Model, axis: Axis, solved: Solved | None = None) -> Estimate:
    """Estimate the change by the next step of an axis; a large change is unreliable until the richer model has been solved.

    Parameters
    ----------
    cache : SolutionCache
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
        cache.solver, model, {**model, axis.name: to}, solved or cache
    )
    largest = float(np.max(np.abs(found.change)))
    large = (
        ""
        if largest <= LARGE or found.method == SOLVED
        else f"a change of {largest:.0%} is too large for a first-order estimate"
    )
    return replace(found, to=to, caution=found.caution or large)


def _solve_unreliable(cache: SolutionCache, rung: Rung, axes: Mapping[str, Axis]) -> Rung:
    """The model with unreliable estimates replaced by solutions, where possible: no search ends on an unreliable estimate."""
    for name, each in rung.estimates.items():
        if not each.caution or each.method == SOLVED:
            continue
        try:
            after = cache({**rung.model, name: each.to}).answers
        except SolverError:
            continue  # remains unreliable
        rung.estimates[name] = Estimate(relative_difference(rung.answers, after, rung.scales), SOLVED, to=each.to)
    return _combine_changes(replace(rung), axes)


def _combine_changes(rung: Rung, axes: Mapping[str, Axis], more: Array | float = 0.0) -> Rung:
    """Combine the changes of all steps; of order and refinement only the larger one, since both reduce the same error.

    Changes may cancel by chance: the expected error is at least half of the root of their sum of squares.
    """
    changes = {name: each.change * axes[name].tail for name, each in rung.estimates.items()}
    elements = [changes.pop(name) for name in ELEMENTS if name in changes]
    parts = [*changes.values(), np.zeros(len(rung.answers))]
    if elements:
        parts.append(elements[0] if len(elements) == 1 else _larger_change(*elements))
    rung.error_bound = np.sum(np.abs(parts), axis=0) + more
    known = np.isfinite(rung.error_bound)
    together, apart = np.abs(np.sum(parts, axis=0, where=known)), np.sqrt(np.sum(np.square(parts), axis=0, where=known))
    rung.expected = np.where(known, np.maximum(together, MIN_ROOT_SQUARES * apart) + more, np.inf)
    return rung


def _update_from_last_step(rung: Rung, before: list[Rung], axes: Mapping[str, Axis], tolerances: Array) -> Rung:
    """Update the estimates of refinement by the change of the last such step.

    They are at least a fraction of it, and unreliable where it had the opposite sign of its estimate. Estimates in plane sections
    miss the corners of 3-D bodies.
    """
    above = [name for name in ELEMENTS if name in rung.estimates]
    last = next((each for each in reversed(before) if set(each.next_axes) & set(ELEMENTS)), None)
    if not above or last is None or last.model.get("space") != rung.model.get("space"):
        return rung
    after = before[before.index(last) + 1] if last is not before[-1] else rung
    changed = relative_difference(last.answers, after.answers, last.scales)
    told = sum((last.estimates[name].change for name in last.next_axes), np.zeros(len(changed)))
    if np.any((told * changed < 0) & (np.minimum(np.abs(told), np.abs(changed)) > REPORTED * tolerances)):
        rung.estimates |= {name: _mark_unreliable(rung.estimates[name], OPPOSITE_SIGN) for name in above}
    floor = REMAINING_FRACTION ** len(last.next_axes) * changed
    name = max(above, key=lambda each: float(np.max(np.abs(rung.estimates[each].change))))
    found = rung.estimates[name]
    if found.method == SOLVED or np.all(np.abs(found.change) >= np.abs(floor)):
        return rung
    raised = replace(found, change=_larger_change(found.change, floor), method="a fraction of the last step's change")
    rung.estimates[name] = raised
    return _combine_changes(replace(rung), axes)


def _at_least_half_of_order(mesh: Estimate, order: Estimate) -> Estimate:
    """Estimate of refinement, at least a part of the change by a higher order: both reduce the same error.

    Plane sections of strongly compressed bodies may underestimate it, where errors of both signs cancel.
    """
    least = HALF_OF_ORDER * np.nan_to_num(order.change, posinf=0.0, neginf=0.0)
    if mesh.method == SOLVED or np.all(np.abs(mesh.change) >= np.abs(least)):
        return mesh
    return replace(mesh, change=_larger_change(mesh.change, least), method="half of the change by a higher order")


def _mark_unreliable(found: Estimate, why: str) -> Estimate:
    return found if found.method == SOLVED or found.caution else replace(found, caution=why)


def _larger_change(one: Array, other: Array) -> Array:
    """For each answer, the change with the larger magnitude."""
    return np.where(np.abs(other) > np.abs(one), other, one)  # unknown changes stay unknown


def _richest_level_errors(axes: Mapping[str, Axis], rungs: list[Rung], tolerances: Array) -> tuple[Array, list[str]]:
    """Remaining error of axes at their richest level, from the change of the last step; and warnings where it is too large."""
    more, flags = np.zeros(len(tolerances)), []
    for name in ELEMENTS:
        if name not in axes or axes[name].next_level(rungs[-1].model[name]):
            continue  # not at its richest level
        for before, after in pairwise(rungs):
            if name in before.next_axes and after.model[name] == axes[name].levels[-1]:
                last = np.abs(relative_difference(before.answers, after.answers, before.scales)) * (axes[name].tail - 1)
                more += last
                if np.any(last > tolerances):
                    flags.append(
                        f"{name}: an error of {100 * np.max(last):.2g} % may remain after the last step, at the richest level"
                    )
    return more, flags


def _near_zero_warnings(rung: Rung) -> list[str]:
    """Warnings on answers that are nearly zero, whose errors are relative to their reference size."""
    scales = np.broadcast_to(np.asarray(rung.scales, float), rung.answers.shape)
    return [
        f"answer {i} is nearly zero: its error is relative to {NOTHING * scale:.3g}, {NOTHING:.0%} of the largest value of its kind"
        for i, (value, scale) in enumerate(zip(rung.answers, scales, strict=True), 1)
        if abs(value) < NOTHING * scale
    ]
