"""Estimates of the change in the answers by a model enrichment, without solving the richer model.

With the residual R of the richer model at the cheaper solution u, embedded in its space, and its tangent K, the answers Q change by

    Q(u - K⁻¹R) - Q(u)  =  -⟨R, K⁻ᵀ Q'⟩ + …

to first order: the dual-weighted residual, for all questions with one factorisation instead of one adjoint problem each. A second
Newton step with the same factorisation measures the reliability. Where the richer model is not a body on the same mesh, the
estimate is the change of a cheaper companion problem, and says so.
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
from ngbrain.look import BriefText
from ngbrain.solvers.linear import Solve

Array = np.ndarray
Solved = Callable[[Model], Solution]
"""Gives a model's solution, from the cache or computed now."""
Estimator = Callable[[Any, Model, Model, Solved], "Estimate"]
"""Estimates a step from a model to a richer one; the first argument is a `ModelHierarchy`, or another `ModelSolver`."""
TRUSTED = 0.3
"""Length of the second Newton step, relative to the first, up to which the first-order estimate is accepted."""
SOLVED = "solved"
"""Description of an estimate that was obtained by solving the richer model."""
LARGE, UNSEEN = 0.2, 0.003
"""Changes above the first value are accepted only if they were solved for; below the second they are negligible."""


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(BriefText):
    """Estimated change by one step along an axis.

    Parameters
    ----------
    change : (n,) array
        Relative change of each answer, see `relative_difference`.
    method : str
        Method, in words.
    caution : str
        Why it may be unreliable; empty otherwise.
    to : str
        The level that the step leads to.
    """

    change: Array
    method: str
    caution: str = ""
    to: str = ""


NOTHING = 0.05
"""Fraction of its reference size below which an answer counts as of that size: zeros by symmetry have no relative accuracy."""


def relative_difference(before: Array, after: Array, scales: Array | float = 0.0) -> Array:
    """(after - before) relative to the larger of the two, or to `NOTHING` times the reference size where both are smaller.

    Parameters
    ----------
    before, after : (n,) array
    scales : (n,) array, optional
        Reference sizes.

    Returns
    -------
    (n,) array
        0 where all are 0.

    Examples
    --------
    >>> relative_difference(np.array([1.0, 0.0, 0.0]), np.array([2.0, 0.0, 0.01]), np.array([0.0, 0.0, 1.0]))
    array([0.5, 0. , 0.2])
    """
    size = np.maximum(np.maximum(np.abs(before), np.abs(after)), NOTHING * np.asarray(scales))
    return np.where(size > 0, (after - before) / np.where(size > 0, size, 1.0), 0.0)


def relative_change(before: Solution, after: Solution) -> Array:
    """Relative difference between the answers of two solutions, see `relative_difference`.

    Parameters
    ----------
    before, after : Solution

    Returns
    -------
    (n,) array
    """
    return relative_difference(before.answers, after.answers, before.scales)


def estimate_by_adjoint(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """Dual-weighted residual estimate, by two Newton steps in the richer model from the cheaper state with one factorisation.

    Parameters
    ----------
    hierarchy : ModelHierarchy
    model, richer : mapping of str
        Axis → level before and after the step.
    solved : callable
        Gives solutions of models.

    Returns
    -------
    Estimate
    """
    where = " of the elastic body at rest" if _static_elastic_levels(model) else ""
    model, richer = {**model, **_static_elastic_levels(model)}, {**richer, **_static_elastic_levels(richer)}
    states, doubts = solved(model).states, []
    moved: dict[str, BodyState] = {}
    for when, state in states.items():
        body = hierarchy.static(richer, hierarchy.time(when))
        x = interpolate_state(state, body, SMALL if richer["strain"] == "linear" else 1.0)
        try:
            if not body.min_det(x) > 0:
                raise Breakdown("the linear solution, interpreted as finite strain, inverts elements")
            with np.errstate(over="raise"):
                first, second, share = _newton_steps(body, x, state)
            if share > TRUSTED:
                doubts.append(f"the second step is {share:.2g} of the first")
            best = x + first + second if share < 1 and body.min_det(x + first + second) > 0 else x + first
        except (FloatingPointError, SolverError) as error:
            return Estimate(np.full(len(hierarchy.questions), np.inf), f"two Newton steps{where}", str(error))
        moved[when] = hierarchy.state(richer, body, best)
    change = relative_difference(solved(model).answers, answers_of(hierarchy.questions, moved), solved(model).scales)
    return Estimate(change, f"residual weighted by adjoints{where}", "; ".join(dict.fromkeys(doubts)))


def estimate_finite_strain(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """Effect of finite strain by `estimate_by_adjoint`; for first-order elements in second-order elements too.

    First-order elements are too stiff in bending, and the effect of finite strain increases with the square of the
    displacement: a column under shear changed by .9 % on them, and by 24 % with second order.

    Parameters
    ----------
    hierarchy, model, richer, solved
        See `estimate_by_adjoint`.

    Returns
    -------
    Estimate
    """
    found = estimate_by_adjoint(hierarchy, model, richer, solved)
    if model.get("order") != "1":
        return found
    other = estimate_by_adjoint(hierarchy, {**model, "order": "2"}, {**richer, "order": "2"}, solved)
    if np.all(np.abs(other.change) <= np.abs(found.change)):
        return found
    return replace(other, method=f"{other.method}, in elements of second order")


def _newton_steps(body: Problem, x: Array, state: BodyState) -> tuple[Array, Array, float]:
    """Two Newton steps from x, and the size of the second relative to the first.

    They use the factorisation of the given state (small strain, same elements) where it is reliable (`TRUSTED`).
    """
    r = body.residual(x)[0]
    old = state.body.last_factor if state.linear and len(state.x) == len(x) else None
    with suppress(FloatingPointError):
        if old and (found := _two_newton_steps(body, x, r, old))[2] <= TRUSTED:
            return found
    return _two_newton_steps(body, x, r, body.factorise(x, r))


def _two_newton_steps(body: Problem, x: Array, r: Array, inverse: Solve) -> tuple[Array, Array, float]:
    first = -inverse(r)
    if not body.min_det(x + first) > 0:
        raise Breakdown("the Newton step inverts elements")
    second = -inverse(body.residual(x + first)[0])
    return first, second, float(np.sqrt((body.weights @ second**2) / max(body.weights @ first**2, 1e-300)))


def linear_elastic_levels(model: Model, **levels: str) -> dict[str, str]:
    """The linear elastic approximation of a model, relaxed where it is viscoelastic; some of its levels replaced."""
    flat = {"strain": "linear"} if "strain" in model else {}
    return {**model, **flat, **_elastic_levels(model), **levels}


def _elastic_levels(model: Model) -> dict[str, str]:
    """Levels to replace for an elastic model."""
    return {"time": "relaxed"} if has_memory(model) else {}


def _static_elastic_levels(model: Model) -> dict[str, str]:
    """Levels to replace for a model with states: elastic and without mass."""
    return _elastic_levels(model) | ({"inertia": "none"} if _has_inertia(model) else {})


def _has_inertia(model: Model) -> bool:
    """Whether it is a body under loads with inertia."""
    return model.get("inertia") == "all" and "strain" in model


def estimate_linear_coarse(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """Change of the linear body on the coarsest elements; unreliable where refinement or finite strain change more than it does.

    Parameters
    ----------
    hierarchy, model, richer, solved
        See `estimate_by_adjoint`.

    Returns
    -------
    Estimate
    """
    before, after = (solved(linear_elastic_levels(each, mesh="0")) for each in (model, richer))
    change = relative_change(before, after)
    least = np.maximum(np.abs(change), UNSEEN)
    doubts = []
    if model.get("strain") == "finite":
        still = _static_elastic_levels(model)
        bending = np.abs(
            estimate_by_solution(
                hierarchy, {**linear_elastic_levels(model), **still}, {**model, **still}, solved
            ).change
        )
        doubts += ["finite strains change more"] * bool(np.any(bending > least))
    if model["mesh"] == "0":
        how = "the linear elastic body's" if "strain" in model else SOLVED
        return Estimate(change, how, "; ".join(doubts))
    finer = np.abs(relative_change(before, solved(linear_elastic_levels(model))))
    doubts += ["finer elements change as much"] * bool(np.any(finer > least))
    return Estimate(change, "on the coarsest elements", "; ".join(doubts))


def estimate_inertia(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """Change of the linear elastic body with second order on the coarsest elements: with first order all nodes may be fixed.

    Parameters
    ----------
    hierarchy, model, richer, solved
        See `estimate_by_adjoint`.

    Returns
    -------
    Estimate
    """
    order = max(model["order"], "2")
    before, after = (solved(linear_elastic_levels(each, mesh="0", order=order)) for each in (model, richer))
    return Estimate(relative_change(before, after), "the linear elastic body's on the coarsest elements")


def estimate_contact(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """Change of the elastic body at rest on the coarsest elements: separation cannot be estimated to first order.

    Parameters
    ----------
    hierarchy, model, richer, solved
        See `estimate_by_adjoint`.

    Returns
    -------
    Estimate
    """
    before, after = ({**each, **_static_elastic_levels(each), "mesh": "0"} for each in (model, richer))
    found = estimate_by_solution(hierarchy, before, after, solved)
    return found if before == model else replace(found, method="the elastic body's at rest, on the coarsest elements")


def estimate_linear(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """Change of the linear elastic body by the same step.

    Parameters
    ----------
    hierarchy, model, richer, solved
        See `estimate_by_adjoint`.

    Returns
    -------
    Estimate
    """
    change = relative_change(solved(linear_elastic_levels(model)), solved(linear_elastic_levels(richer)))
    return Estimate(change, "the linear elastic body's")


def estimate_refinement(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """Change by refinement: Newton steps on nested finer elements, and the linear body's change for small strain.

    The latter costs as much as the step itself, and its solution is kept.

    Parameters
    ----------
    hierarchy, model, richer, solved
        See `estimate_by_adjoint`.

    Returns
    -------
    Estimate
    """
    unions = hierarchy.nested or model["mesh"] == richer["mesh"]
    by = estimate_by_adjoint if model["strain"] == "finite" and unions else estimate_linear
    return by(hierarchy, model, richer, solved)


def section_estimator(of: Estimator) -> Estimator:
    """An estimator applied to the plane section, where there is one; unreliable estimates are replaced by solutions, which are
    cheap there.

    Without a section, and where steps invert elements, it is the linear body's change; likewise for bodies with inertia.
    """

    def estimate(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
        if _has_inertia(model):
            flat = {"space": "plane"} if "space" in model else {}
            pair = (solved(linear_elastic_levels(each, **flat)) for each in (model, richer))
            return Estimate(relative_change(*pair), "the linear elastic body's" + (", in the section" if flat else ""))
        if "space" not in model:
            found = of(hierarchy, model, richer, solved)
            return found if np.all(np.isfinite(found.change)) else estimate_linear(hierarchy, model, richer, solved)
        flat = {"space": "plane", **_elastic_levels(model)}
        before, after = {**model, **flat}, {**richer, **flat}
        seen = solved(before)
        if before != model and np.any(np.abs(seen.answers) < NOTHING * np.asarray(seen.scales)):
            found = of(hierarchy, model, richer, solved)  # a section's symmetry is not that of its body's elements
            return found if np.all(np.isfinite(found.change)) else estimate_linear(hierarchy, model, richer, solved)
        found = of(hierarchy, before, after, solved)
        if found.caution or np.max(np.abs(found.change)) > LARGE:
            found = estimate_by_solution(hierarchy, before, after, solved)
        return found if before == model else replace(found, method="in the section")

    return estimate


def estimate_order(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """Change by a higher order, in the section if there is one; strain in space, since a ball in space is a cylinder in the
    section.

    In a stiff ball, the error of strains at the lowest order is 5.2 %; the section estimates 1.5 %.

    Parameters
    ----------
    hierarchy, model, richer, solved
        See `estimate_by_adjoint`.

    Returns
    -------
    Estimate
    """
    strains = any(isinstance(quantity, Question) or quantity.name == "strain" for quantity in hierarchy.questions)
    if strains and model.get("space") == "solid" and not _has_inertia(model):
        return estimate_refinement(hierarchy, model, richer, solved)
    return section_estimator(estimate_refinement)(hierarchy, model, richer, solved)


def estimate_coarse(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """Change by the same step on the coarsest elements.

    Not in the plane: strains of a plate are higher in space, and the effect of viscoelasticity grows with them (.5 instead of 4.6
    %).

    Parameters
    ----------
    hierarchy, model, richer, solved
        See `estimate_by_adjoint`.

    Returns
    -------
    Estimate
    """
    before, after = ({**each, "mesh": "0"} for each in (model, richer))
    how = "on the coarsest elements" if model["mesh"] != "0" else SOLVED
    try:
        change = relative_change(solved(before), solved(after))
    except SolverError as error:
        return Estimate(np.full(len(hierarchy.questions), np.inf), how, str(error))
    return Estimate(change, how)


def estimate_elastic(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """Change by the same step of the elastic body.

    Parameters
    ----------
    hierarchy, model, richer, solved
        See `estimate_by_adjoint`.

    Returns
    -------
    Estimate
    """
    before, after = ({**each, **_elastic_levels(each)} for each in (model, richer))
    found = estimate_by_solution(hierarchy, before, after, solved)
    return found if before == model else replace(found, method="of the elastic body")


def estimate_by_solution(hierarchy: ModelHierarchy, model: Model, richer: Model, solved: Solved) -> Estimate:
    """Change between the solutions of both models.

    Parameters
    ----------
    hierarchy, model, richer, solved
        See `estimate_by_adjoint`.

    Returns
    -------
    Estimate
    """
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
"""Estimators by name, see `Axis.by`."""
