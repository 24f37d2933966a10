"""How far a step up would move the answers, without taking it.

With R the richer model's residual where the cheaper solution u lies in its space, and K its tangent there, the answers Q move by

    Q(u - K⁻¹R) - Q(u)  =  -⟨R, K⁻ᵀ Q'⟩ + …

to first order: the residual weighted with an adjoint solution, for all questions at once with one factor instead of an adjoint for
each. A second step with the same factor says how far to trust it. Where the richer neighbour is no body on the same mesh, the
change is that of a cheaper companion, and says so.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ngbrain.errors import Breakdown, SolverError
from ngbrain.forward.solid.problem import Problem
from ngbrain.ladder.levels import Model
from ngbrain.ladder.models.bodies import SMALL
from ngbrain.ladder.models.hierarchy import ModelHierarchy, Solution, answers_of
from ngbrain.ladder.models.laws import has_memory
from ngbrain.ladder.quantities import BodyState, Question, interpolate_state
from ngbrain.solvers.linear import Solve

Array = np.ndarray
Solved = Callable[[Model], Solution]
"""Gives a model's solution, kept from before or made now."""
Estimator = Callable[[Any, Model, Model, Solved], "Estimate"]
"""Estimates a step from a model to a richer one; the first argument is a `ModelHierarchy`, or any other `Solver` of models."""
TRUSTED = 0.3
"""Length of the second step, over the first, up to which the first order is believed."""
SOLVED = "solved"
"""How an estimate was found that is none."""
LARGE, UNSEEN = 0.2, 0.003
"""Changes beyond the first are only believed when they have been solved for; below the second they do not matter."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """What a step would change.

    change   of each answer, relative to the larger of before and after
    how      it was found, in words
    doubt    why it may be far off; empty if it is not expected to
    to       the level that the change leads to
    """

    change: Array
    how: str
    doubt: str = ""
    to: str = ""


NOTHING = 0.05
"""Part of its scale below which an answer counts as of that size: zero by symmetry never is so to any relative accuracy."""


def relative_difference(before: Array, after: Array, scales: Array | float = 0.0) -> Array:
    """(after - before) over the larger size of the two, or over `NOTHING` of the scale where both are less; 0 where all are 0.

    >>> relative_difference(np.array([1.0, 0.0, 0.0]), np.array([2.0, 0.0, 0.01]), np.array([0.0, 0.0, 1.0]))
    array([0.5, 0. , 0.2])
    """
    size = np.maximum(np.maximum(np.abs(before), np.abs(after)), NOTHING * np.asarray(scales))
    return np.where(size > 0, (after - before) / np.where(size > 0, size, 1.0), 0.0)


def relative_change(before: Solution, after: Solution) -> Array:
    """How far answers differ, relative; see `relative`."""
    return relative_difference(before.answers, after.answers, before.scales)


def estimate_by_adjoint(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """By two Newton steps in the richer model with one factor, from the cheaper one's state (see the module)."""
    where = " of the elastic body at rest" if _at_rest(model) else ""
    model, richer = {**model, **_at_rest(model)}, {**richer, **_at_rest(richer)}
    states, doubts = solved(model).states, []
    moved: dict[str, BodyState] = {}
    for when, state in states.items():
        body = hierarchy.static(richer, hierarchy.time(when))
        x = interpolate_state(state, body, SMALL if richer["strain"] == "linear" else 1.0)
        try:
            if not body.min_det(x) > 0:
                raise Breakdown("its strains, taken for finite ones, fold the body")
            with np.errstate(over="raise"):
                first, second, share = _steps(body, x, state)
            if share > TRUSTED:
                doubts.append(f"the second step is {share:.2g} of the first")
            best = x + first + second if share < 1 and body.min_det(x + first + second) > 0 else x + first
        except (FloatingPointError, SolverError) as error:
            return Estimate(np.full(len(hierarchy.questions), np.inf), f"two Newton steps{where}", str(error))
        moved[when] = hierarchy.state(richer, body, best)
    change = relative_difference(solved(model).answers, answers_of(hierarchy.questions, moved), solved(model).scales)
    return Estimate(change, f"residual weighted by adjoints{where}", "; ".join(dict.fromkeys(doubts)))


def estimate_finite_strain(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """Finite strains by `step`; of elements of first order in those of second order too.

    Elements of first order are too stiff in bending, and what finite strains change grows with the square of how far it goes: a
    column under shear was .9 % lower by them, and by those of second order 24 %.
    """
    found = estimate_by_adjoint(hierarchy, model, richer, solved)
    if model.get("order") != "1":
        return found
    other = estimate_by_adjoint(hierarchy, {**model, "order": "2"}, {**richer, "order": "2"}, solved)
    if np.all(np.abs(other.change) <= np.abs(found.change)):
        return found
    return replace(other, how=f"{other.how}, in elements of second order")


def _steps(body: Problem, x: Array, state: BodyState) -> tuple[Array, Array, float]:
    """Two Newton steps from x, and the size of the second over the first.

    With the factor that the state was found with, that of small strains in the same elements, where it can be `TRUSTED`.
    """
    r = body.residual(x)[0]
    old = state.body.kept if state.linear and len(state.x) == len(x) else None
    with suppress(FloatingPointError):
        if old and (found := _both(body, x, r, old))[2] <= TRUSTED:
            return found
    return _both(body, x, r, body.factorise(x, r))


def _both(body: Problem, x: Array, r: Array, inverse: Solve) -> tuple[Array, Array, float]:
    first = -inverse(r)
    if not body.min_det(x + first) > 0:
        raise Breakdown("the step folds the body")
    second = -inverse(body.residual(x + first)[0])
    return first, second, float(np.sqrt((body.weights @ second**2) / max(body.weights @ first**2, 1e-300)))


def linear_elastic_levels(model: Model, **levels: str) -> dict[str, str]:
    """The linear elastic body that stands for a model, relaxed where it remembers; some of its levels replaced."""
    flat = {"strain": "linear"} if "strain" in model else {}
    return {**model, **flat, **_forgetful(model), **levels}


def _forgetful(model: Model) -> dict[str, str]:
    """Levels to replace for a model without memory."""
    return {"time": "relaxed"} if has_memory(model) else {}


def _at_rest(model: Model) -> dict[str, str]:
    """Levels to replace for one that has states: without memory, and without mass."""
    return _forgetful(model) | ({"inertia": "none"} if _moves(model) else {})


def _moves(model: Model) -> bool:
    """Whether it is a body under loads, with mass."""
    return model.get("inertia") == "all" and "strain" in model


def estimate_linear_coarse(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """By the linear body's step on the coarsest elements; doubted where finer ones or finite strains change more than it does."""
    before, after = (solved(linear_elastic_levels(each, mesh="0")) for each in (model, richer))
    change = relative_change(before, after)
    least = np.maximum(np.abs(change), UNSEEN)
    doubts = []
    if model.get("strain") == "finite":
        still = _at_rest(model)
        bent = np.abs(
            estimate_by_solution(
                hierarchy, {**linear_elastic_levels(model), **still}, {**model, **still}, solved
            ).change
        )
        doubts += ["finite strains change more"] * bool(np.any(bent > least))
    if model["mesh"] == "0":
        how = "the linear elastic body's" if "strain" in model else SOLVED
        return Estimate(change, how, "; ".join(doubts))
    finer = np.abs(relative_change(before, solved(linear_elastic_levels(model))))
    doubts += ["finer elements change as much"] * bool(np.any(finer > least))
    return Estimate(change, "on the coarsest elements", "; ".join(doubts))


def estimate_inertia(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """By the linear elastic body's step, of second order on the coarsest elements: of first order all nodes may be held."""
    order = max(model["order"], "2")
    before, after = (solved(linear_elastic_levels(each, mesh="0", order=order)) for each in (model, richer))
    return Estimate(relative_change(before, after), "the linear elastic body's on the coarsest elements")


def estimate_contact(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """By the elastic body at rest on the coarsest elements: what parts is not seen to first order."""
    before, after = ({**each, **_at_rest(each), "mesh": "0"} for each in (model, richer))
    found = estimate_by_solution(hierarchy, before, after, solved)
    return found if before == model else replace(found, how="the elastic body's at rest, on the coarsest elements")


def estimate_linear(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """By the same step of the linear elastic body."""
    change = relative_change(solved(linear_elastic_levels(model)), solved(linear_elastic_levels(richer)))
    return Estimate(change, "the linear elastic body's")


def estimate_refinement(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """By Newton steps in the finer elements, if the coarse ones are their unions; where strains are small, the linear body's.

    That one costs what its step would, and its solution is kept.
    """
    unions = hierarchy.nested or model["mesh"] == richer["mesh"]
    by = estimate_by_adjoint if model["strain"] == "finite" and unions else estimate_linear
    return by(hierarchy, model, richer, solved)


def section_estimator(of: Estimator) -> Estimator:
    """Elements by what they do in the plane, where there is one; what is doubted there is solved for, as the plane is cheap.

    Where there is none, and steps fold the body, by what they do to the linear one; of bodies in motion by that one's.
    """

    def estimate(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
        if _moves(model):
            flat = {"space": "plane"} if "space" in model else {}
            pair = (solved(linear_elastic_levels(each, **flat)) for each in (model, richer))
            return Estimate(relative_change(*pair), "the linear elastic body's" + (", in the section" if flat else ""))
        if "space" not in model:
            found = of(hierarchy, model, richer, solved)
            return found if np.all(np.isfinite(found.change)) else estimate_linear(hierarchy, model, richer, solved)
        flat = {"space": "plane", **_forgetful(model)}
        before, after = {**model, **flat}, {**richer, **flat}
        seen = solved(before)
        if before != model and np.any(np.abs(seen.answers) < NOTHING * np.asarray(seen.scales)):
            found = of(hierarchy, model, richer, solved)  # a section's symmetry is not that of its body's elements
            return found if np.all(np.isfinite(found.change)) else estimate_linear(hierarchy, model, richer, solved)
        found = of(hierarchy, before, after, solved)
        if found.doubt or np.max(np.abs(found.change)) > LARGE:
            found = estimate_by_solution(hierarchy, before, after, solved)
        return found if before == model else replace(found, how="in the section")

    return estimate


def estimate_order(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """In the section, where there is one; strains in space, as they are a ball's there and a cylinder's in the section.

    In a stiff ball those of the least order are 5.2 % off where the section says 1.5.
    """
    strains = any(isinstance(quantity, Question) or quantity.name == "strain" for quantity in hierarchy.questions)
    if strains and model.get("space") == "solid" and not _moves(model):
        return estimate_refinement(hierarchy, model, richer, solved)
    return section_estimator(estimate_refinement)(hierarchy, model, richer, solved)


def estimate_coarse(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """By the same step on the coarsest elements.

    Not in the plane: a plate's strains are higher in space, and what memory changes grows with them (.5 instead of 4.6 %).
    """
    before, after = ({**each, "mesh": "0"} for each in (model, richer))
    how = "on the coarsest elements" if model["mesh"] != "0" else SOLVED
    try:
        change = relative_change(solved(before), solved(after))
    except SolverError as error:
        return Estimate(np.full(len(hierarchy.questions), np.inf), how, str(error))
    return Estimate(change, how)


def estimate_elastic(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """By the same step of the body without memory."""
    before, after = ({**each, **_forgetful(each)} for each in (model, richer))
    found = estimate_by_solution(hierarchy, before, after, solved)
    return found if before == model else replace(found, how="of the elastic body")


def estimate_by_solution(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """By the step itself."""
    try:
        return Estimate(relative_change(solved(model), solved(richer)), SOLVED)
    except SolverError as error:
        return Estimate(np.full(len(hierarchy.questions), np.inf), SOLVED, str(error))


ESTIMATORS: Mapping[str, Estimator] = {
    "step": estimate_by_adjoint,
    "strained": estimate_finite_strain,
    "roughly": estimate_linear_coarse,
    "coarse": estimate_coarse,
    "moving": estimate_inertia,
    "touching": estimate_contact,
    "order": estimate_order,
    "mesh": section_estimator(estimate_refinement),
    "section": section_estimator(estimate_by_solution),
    "solve": estimate_by_solution,
    "forgetful": estimate_elastic,
}
