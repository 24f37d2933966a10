"""How far a step up would move the answers, without taking it.

With R the richer model's residual where the cheaper solution u lies in its space, and K its tangent there, the answers Q move by

    Q(u - K⁻¹R) - Q(u)  =  -⟨R, K⁻ᵀ Q'⟩ + …

to first order: the residual weighted with an adjoint solution, for all questions at once with one factor instead of an adjoint for
each. A second step with the same factor says how far to trust it. Where the richer neighbour is no body on the same mesh, the
change is that of a cheaper companion, and says so.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np

from ngbrain.errors import SolverError
from ngbrain.forward.static import Static
from ngbrain.ladder.bodies import REMEMBERS, SMALL, Bench, Model, Solution, answers_of
from ngbrain.ladder.quantities import State

Array = np.ndarray
Solved = Callable[[Model], Solution]
"""Gives a model's solution, kept from before or made now."""
TRUSTED = 0.3
"""Length of the second step, over the first, up to which the first order is believed."""
SOLVED = "solved"
"""How an estimate was found that is none."""
LARGE = 0.2
"""A change beyond this is only believed when it has been solved for."""


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


def relative(before: Array, after: Array) -> Array:
    """(after - before) over the larger size of the two, 0 where both are 0.

    >>> relative(np.array([1.0, 0.0]), np.array([2.0, 0.0]))
    array([0.5, 0. ])
    """
    size = np.maximum(np.abs(before), np.abs(after))
    return np.where(size > 0, (after - before) / np.where(size > 0, size, 1.0), 0.0)


def step(bench: Bench, model: Model, richer: Model, solved: Solved) -> Estimate:
    """By two Newton steps in the richer model with one factor, from the cheaper one's state (see the module)."""
    where = "" if model.get("time") not in REMEMBERS else " of the elastic body with moduli as relaxed"
    if where:
        model, richer = {**model, "time": "relaxed"}, {**richer, "time": "relaxed"}
    states, doubts = solved(model).states, []
    moved: dict[str, State] = {}
    for when, state in states.items():
        body = bench.static(richer, bench.time(when))
        x = embedded(state, body, SMALL if richer["strain"] == "linear" else 1.0)
        try:
            if not body.min_det(x) > 0:
                raise FloatingPointError("its strains, taken for finite ones, fold the body")
            r = body.residual(x)[0]
            inverse = body.factorise(x, r)
            first = -inverse(r)
            if not body.min_det(x + first) > 0:
                raise FloatingPointError("the step folds the body")
            second = -inverse(body.residual(x + first)[0])
            share = float(np.sqrt((body.weights @ second**2) / max(body.weights @ first**2, 1e-300)))
            if share > TRUSTED:
                doubts.append(f"the second step is {share:.2g} of the first")
            best = x + first + second if share < 1 and body.min_det(x + first + second) > 0 else x + first
        except (FloatingPointError, SolverError) as error:
            return Estimate(np.full(len(bench.scene.ask), np.inf), f"two Newton steps{where}", str(error))
        moved[when] = bench.state(richer, body, best)
    change = relative(solved(model).answers, answers_of(bench.scene, moved))
    return Estimate(change, f"residual weighted by adjoints{where}", "; ".join(dict.fromkeys(doubts)))


def embedded(state: State, body: Static, factor: float) -> Array:
    """A state's displacements, and the pressures that go with them, as unknowns of another body on the same mesh."""
    state.stand()
    u = state.displacement() * factor
    body.u.Set(u)
    if body.p is not None:
        J = ngs.Det(body.kinematics.gradient(body.u, ngs.Grad(body.u)))
        bulk = body.mesh.MaterialCF({name: material.bulk for name, material in body.materials.items()})
        body.p.Set(bulk * (J - 1))
    return body.load(body.state, factor)


def linear(bench: Bench, model: Model, richer: Model, solved: Solved) -> Estimate:
    """By the same step of the linear elastic body."""
    flat = {"strain": "linear"} | ({"time": "relaxed"} if model.get("time") in REMEMBERS else {})
    before, after = ({**each, **flat} for each in (model, richer))
    change = relative(solved(before).answers, solved(after).answers)
    return Estimate(change, "the linear elastic body's")


def halved(bench: Bench, model: Model, richer: Model, solved: Solved) -> Estimate:
    """On elements half as large: by Newton steps, if coarse ones are their unions; where strains are small, the linear body's."""
    if model["strain"] == "linear":
        return linear(bench, model, richer, solved)
    if bench.nested:
        return step(bench, model, richer, solved)
    found = linear(bench, model, richer, solved)
    return Estimate(found.change, found.how, "strains are finite")


def coarse(bench: Bench, model: Model, richer: Model, solved: Solved) -> Estimate:
    """By the same step on the coarsest elements.

    Not in the plane: a plate's strains are higher in space, and what memory changes grows with them (.5 instead of 4.6 %).
    """
    before, after = ({**each, "mesh": "0"} for each in (model, richer))
    how = "on the coarsest elements" if model["mesh"] != "0" else SOLVED
    try:
        change = relative(solved(before).answers, solved(after).answers)
    except SolverError as error:
        return Estimate(np.full(len(bench.scene.ask), np.inf), how, str(error))
    return Estimate(change, how)


def neighbour(bench: Bench, model: Model, richer: Model, solved: Solved) -> Estimate:
    """By the step itself."""
    return Estimate(relative(solved(model).answers, solved(richer).answers), SOLVED)


def section(bench: Bench, model: Model, richer: Model, solved: Solved) -> Estimate:
    """By the same step in the plane, if there is one: in space it would be the dearest of all."""
    plane = {"space": "plane"} if "space" in model else {}
    found = neighbour(bench, {**model, **plane}, {**richer, **plane}, solved)
    return found if plane.get("space") == model.get("space") else Estimate(found.change, "the section's")


BY: Mapping[str, Callable[[Bench, Model, Model, Solved], Estimate]] = {
    "step": step,
    "linear": linear,
    "halved": halved,
    "coarse": coarse,
    "section": section,
    "solve": neighbour,
}
