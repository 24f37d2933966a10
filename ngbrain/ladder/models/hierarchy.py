"""A scene's models of every level, and their solutions."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.forward.transient.time_stepper import run_load_history
from ngbrain.ladder.levels import Model
from ngbrain.ladder.models import motions
from ngbrain.ladder.models.bodies import SMALL, SceneBodies, linear_state
from ngbrain.ladder.models.laws import form_of, has_memory
from ngbrain.ladder.models.waves import harmonic_answers
from ngbrain.ladder.quantities import (
    Asked,
    BodyState,
    Question,
    evaluate,
    interpolate_state,
    reference_size,
)
from ngbrain.look import BriefText

Array = np.ndarray
RAMP, HOLD = 6, 8
"""Time steps in a ramp, and in a hold, with increasing lengths."""
CROSSING, LONGER = 12, 1.15
"""Time steps per shear-wave transit of a body with inertia, and the ratio of successive steps in a hold."""


class ModelHierarchy(SceneBodies):
    """A scene's models of every level: their problems, see `SceneBodies`, and their solutions.

    Parameters
    ----------
    scene : Scene
    questions : sequence of Question
        Observables in addition to the scene's quantities.
    """

    def solve(self, model: Model, near: Mapping[str, BodyState] | None = None) -> Solution:
        """Solve a model, see `solve`.

        Parameters
        ----------
        model : mapping of str
        near : mapping of BodyState, optional

        Returns
        -------
        Solution
        """
        return solve(self, model, near)

    def has_states(self, model: Model) -> bool:
        """Whether a model's solution has states: it is an elastic body at rest."""
        through_time = has_memory(model) or model.get("inertia") == "all"
        return self.scene.time.frequency is None and not through_time


@dataclass(frozen=True, eq=False, repr=False)
class Solution(BriefText):
    """Solution of a model.

    Parameters
    ----------
    answers : (n,) array
        One for each question, SI units.
    states : dict of BodyState
        Time of a question → state, of an elastic body.
    ndof : int
        Number of unknowns.
    cost_s : float
        Computing time (s).
    doubts : tuple of str
        Warnings of the solvers, and on quantities that diverge.
    scales : (n,) array or float
        Reference size of each answer where it is nearly zero (`quantities.reference_size`); 0 for the answer itself.
    """

    answers: Array
    states: dict[str, BodyState]
    ndof: int
    cost_s: float
    doubts: tuple[str, ...] = ()
    scales: Array | float = 0.0


def solve(hierarchy: ModelHierarchy, model: Model, near: Mapping[str, BodyState] | None = None) -> Solution:
    """Solve a model.

    Parameters
    ----------
    hierarchy : ModelHierarchy
    model : mapping of str
        Axis → level.
    near : mapping of BodyState, optional
        States of a similar model, as an initial guess.

    Returns
    -------
    Solution

    Raises
    ------
    SolverError
        There is no solution.
    """
    begun, states, scales = time.process_time(), dict[str, BodyState](), np.zeros(len(hierarchy.questions))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        if hierarchy.scene.time.frequency is not None:
            answers, ndof = harmonic_answers(
                hierarchy.scene,
                model,
                hierarchy.mesh(model),
                lambda region: (hierarchy.tissue(region, model), hierarchy.factor(region, model)),
                form_of(model),
                hierarchy.thickness_of(model),
            )
        elif not hierarchy.has_states(model):
            answers, scales, ndof = _through_time(hierarchy, model)
        else:
            states = _at_rest(hierarchy, model, near or {})
            answers = answers_of(hierarchy.questions, states)
            scales = np.array([reference_size(quantity, states[quantity.when]) for quantity in hierarchy.questions])
            ndof = next(iter(states.values())).body.fes.ndof
    doubts = (*hierarchy.singular_edges, *dict.fromkeys(str(warning.message) for warning in caught))
    return Solution(answers, states, ndof, time.process_time() - begun, doubts, scales)


def answers_of(questions: Sequence[Asked], states: Mapping[str, BodyState]) -> Array:
    """Values of all questions.

    Parameters
    ----------
    questions : sequence of Quantity or Question
    states : mapping of BodyState
        By the time of a question.

    Returns
    -------
    (n,) array
    """
    return np.array([evaluate(quantity, states[quantity.when]) for quantity in questions])


def _at_rest(hierarchy: ModelHierarchy, model: Model, near: Mapping[str, BodyState]) -> dict[str, BodyState]:
    found: dict[str, BodyState] = {}
    alike = model.get("time", "instantaneous") == "instantaneous" and not hierarchy.scene.is_timed
    for when in dict.fromkeys(quantity.when for quantity in hierarchy.questions):
        if found and alike:
            found[when] = next(iter(found.values()))
            continue
        body = hierarchy.static(model, hierarchy.time(when))
        if model["strain"] == "linear":
            x = linear_state(body)
        else:
            # Contact problems start from rest, as friction depends on the path.
            close = None if hierarchy.scene.contacts else near.get(when) or next(iter(found.values()), None)
            LoadPath(body, hierarchy.course(body)).solve(
                start=None if close is None else interpolate_state(close, body, 1.0)
            )
            x = body.x
        found[when] = hierarchy.state(model, body, x)
    return found


def _through_time(hierarchy: ModelHierarchy, model: Model) -> tuple[Array, Array, int]:
    """Answers, reference sizes and number of unknowns; quantities are evaluated during the run, since the body does not store its
    history.
    """
    scene = hierarchy.scene
    size = SMALL if model["strain"] == "linear" else 1.0
    asked = hierarchy.questions
    answers, scales, ndof = np.zeros(len(asked)), np.zeros(len(asked)), 0
    moments = dict.fromkeys(hierarchy.time(quantity.when) for quantity in asked)
    for last in moments if model.get("time") == "relaxed" else [max(moments)]:  # otherwise one run serves all questions
        body = hierarchy.relaxing(model, last)
        still = (
            hierarchy.static(model, last)
            if size < 1 and any(isinstance(quantity, Question) for quantity in asked)
            else None
        )

        def seen(t: float, body: Problem = body, still: Problem | None = still) -> None:
            for i, quantity in enumerate(asked):
                if abs(t - hierarchy.time(quantity.when)) < 1e-9 * t:
                    state = replace(hierarchy.state(model, body, body.x), without_memory=still)
                    answers[i], scales[i] = evaluate(quantity, state), reference_size(quantity, state)

        times = _times(hierarchy, model, last)
        factors = size * np.minimum(times / scene.time.ramp, 1.0)
        run_load_history(body, times, factors, seen, motion=hierarchy.course(body))
        ndof = body.fes.ndof
    return answers, scales, ndof


def _times(hierarchy: ModelHierarchy, model: Model, last: float) -> Array:
    """Time steps up to a time (s), uniform during the ramp."""
    ramp = hierarchy.scene.time.ramp
    hold, moving = last - ramp, model.get("inertia") == "all"
    count = max(RAMP, math.ceil(CROSSING * ramp / hierarchy.crossing)) if moving else RAMP
    if hierarchy.scene.is_timed:
        return motions.time_steps(hierarchy.scene, last, RAMP, hierarchy.crossing / CROSSING if moving else math.inf)
    grow = np.linspace(0, ramp, count + 1)
    if hold <= 1e-9 * ramp:
        return grow
    if not moving:
        return np.concatenate([grow, ramp + np.geomspace(min(ramp, hold / HOLD), hold, HOLD)])
    first = min(ramp / count, hold)
    steps = math.ceil(math.log(1 + hold / first * (LONGER - 1)) / math.log(LONGER))
    ends = np.cumsum(LONGER ** np.arange(steps))
    return np.concatenate([grow, ramp + hold * ends / ends[-1]])
