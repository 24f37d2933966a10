"""Motion of a relaxing body against moving rigid bodies: time steps that land on events and can be redone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from ngbrain.errors import Breakdown, ContactError, ConvergenceError, InvertedElementError
from ngbrain.forward.body import Body
from ngbrain.forward.steps import Control, Progress
from ngbrain.forward.tangent import Solve
from ngbrain.solvers.newton import Newton
from ngbrain.solvers.record import NewtonRecord, Work

WHOLES = 1
"""Factorisations of a focused body's whole tangent in a step; one that needs more is cut, which costs less."""
FORESEEN = 2
"""Tries of a step that begin where it is foreseen to end; later ones begin where it stands."""


class Motion(Protocol):
    """How the rigid bodies move."""

    @property
    def events(self) -> Sequence[float]:
        """Times (s) at which the motion changes; steps land on them exactly. The last one ends the run."""

    def set(self, t: float) -> None:
        """Put the bodies where they are at time t."""

    def travel(self, start: float, end: float) -> float:
        """How far (m) they move towards the tissue between two times; negative when they withdraw."""


Watch = Callable[[Body, Progress, NewtonRecord], None]


class Transient:
    """Time stepping of a `Body` under a `Motion`: quasi-static, or with the inertia of a `DynamicBody`.

    penetration_limit   a step that ends with tissue further (m) inside a body is rejected

    `run` raises `ConvergenceError`, `InvertedElementError` or `ContactError` when steps get too short; the body then
    holds the last accepted state.
    """

    def __init__(
        self, body: Body, motion: Motion, control: Control, penetration_limit: float, newton: Newton | None = None
    ) -> None:
        self.body, self.motion, self.control = body, motion, control
        self.penetration_limit = penetration_limit
        self.newton = newton or Newton()
        self.progress = Progress(dt=control.touch)
        self.follow = np.zeros_like(body.weights)
        self.drift = np.zeros_like(body.weights)
        self._now, self._wholes = 0.0, 0
        self._factored: list[dict[str, Any]] = []
        self.motion.set(0.0)

    def run(self, observe: Watch, until: float = float("inf")) -> None:
        """Step to the last event (or to `until`, s), calling `observe` after every accepted step."""
        end = min(until, self.motion.events[-1])
        while self.progress.t < end:
            record = self.step()
            observe(self.body, self.progress, record)

    def step(self) -> NewtonRecord:
        """One accepted step, cut as often as needed."""
        at = self.progress
        start = self.body.state
        dt = self._propose()
        at.cut, tries = False, 0
        while True:
            record, problem = self._attempt(start, dt, tries)
            tries += 1
            at.work += record.work
            at.newton += record.iterations
            if not problem:
                self._accept(start, dt)
                return record
            at.rejected += 1
            self._stand(start)
            at.cut = True
            dt = dt / 3
            if dt < self.control.shortest:
                raise _error(problem, at.t, dt)

    def _stand(self, x: np.ndarray) -> None:
        """Go to a state of the present time."""
        self.motion.set(self.progress.t)
        self.body.state = x

    def _propose(self) -> float:
        """Step length from what the control says, landing on touch and events."""
        at = self.progress
        left = self.motion.events[at.event] - at.t
        dt = self.control.proposed(at, lambda ahead: self.motion.travel(at.t, at.t + min(left, ahead)))
        if not at.touching:
            dt = self._up_to_touch(dt)
        # Two even steps rather than a long one and a sliver before an event.
        return left if dt >= left * (1 - 1e-9) else min(dt, left / 2) if dt > left / 2 else dt

    def _up_to_touch(self, dt: float) -> float:
        """Shorten a step of bodies that come nearer so that it ends just after first touch."""
        at, touch_dt = self.progress, self.control.touch
        speed = self.motion.travel(at.t, at.t + touch_dt) / touch_dt
        return min(dt, max(self.body.min_gap(), 0.0) / speed + touch_dt) if speed > 0 else dt

    def _attempt(self, start: np.ndarray, dt: float, tries: int) -> tuple[NewtonRecord, str]:
        at, body = self.progress, self.body
        body.begin(dt)
        self._now, self._wholes = at.t + dt, 0
        self.motion.set(self._now)
        body.state, record = self.newton.solve(self, self._guess(start, dt, tries))
        if not record.converged:
            return record, record.reason
        depth = -body.min_gap()
        if depth > self.penetration_limit:
            return record, f"penetration {1e3 * depth:.2f} mm over the limit {1e3 * self.penetration_limit:.2f} mm"
        return record, self.control.judged(body, start, at)

    def _guess(self, start: np.ndarray, dt: float, tries: int) -> np.ndarray:
        """Where a step from a state may end, after so many tries."""
        at, guess = self.progress, start
        if tries >= FORESEEN:
            return start
        travel = self.motion.travel(at.t, at.t + dt)
        if at.touching and travel:
            # The tissue follows the body as it did when it was last pushed, or goes back the same way.
            guess = start + self.follow * travel
        elif not travel and not at.rested:
            guess = start + self.drift * self._slowing(at.t, at.t + dt)
        return guess if guess is start or self.body.min_det(guess) > self.newton.min_det else start

    def _slowing(self, start: float, end: float) -> float:
        """How far a hold gets between two times on a scale on which relaxation is nearly even: the logarithm's."""
        event = self.motion.events[self.progress.event - 1] if self.progress.event else 0.0
        return float(np.log1p((end - event) / self.control.touch) - np.log1p((start - event) / self.control.touch))

    def _accept(self, start: np.ndarray, dt: float) -> None:
        at = self.progress
        self.body.finish()
        touched = self.body.min_gap() < 0
        travel = self.motion.travel(at.t, at.t + dt)
        if touched and travel and (at.touching or at.t == 0):  # a run starts in touch
            self.follow = (self.body.state - start) / travel
        if not travel:
            self.drift = (self.body.state - start) / self._slowing(at.t, at.t + dt)
        # After first touch the steps start again from a short one.
        at.dt = min(dt, self.control.touch) if touched and not at.touching else dt
        at.touching = touched
        at.steps += 1
        event = self.motion.events[at.event]
        at.rested = abs(at.t + dt - event) < 1e-9 * max(event, 1.0)
        at.t = event if at.rested else at.t + dt
        if at.rested:
            at.event = min(at.event + 1, len(self.motion.events) - 1)

    # What Newton's method asks (solvers.newton.System): the body's answers, with a note of where a factor was made.

    @property
    def weights(self) -> np.ndarray:
        """The body's weights."""
        return self.body.weights

    def residual(self, x: np.ndarray) -> tuple[np.ndarray, float]:
        """The body's residual."""
        return self.body.residual(x)

    def min_det(self, x: np.ndarray) -> float:
        """The body's smallest det F."""
        return self.body.min_det(x)

    def factorise(self, x: np.ndarray, r: np.ndarray) -> Solve:
        """The body's factorisation; where it was made is kept so that a restart makes the same one."""
        solve = self.body.factorise(x, r)
        self._factored = [*(self._factored[:1] if self.body.partial else []), self._here(x)]
        self._wholes += not self.body.partial
        if self.body.focused and self._wholes > WHOLES:
            raise Breakdown(f"the tangent changes all over the body {self._wholes} times")
        return solve

    def _here(self, x: np.ndarray) -> dict[str, Any]:
        return {"t": self._now, "x": x.copy(), "history": self.body.frozen}

    # Restart.

    def checkpoint(self) -> dict[str, Any]:
        """Everything that decides the steps to come, as arrays and numbers."""
        return {
            "progress": {**self.progress.__dict__, "work": dict(self.progress.work.__dict__)},
            "x": self.body.state,
            "follow": self.follow,
            "drift": self.drift,
            "largest": self.newton.largest,
            "history": self.body.memory,
            "factors": self._factored if self.newton.inverse is not None else [],
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Go on from a checkpoint, to the same bits on one thread."""
        body = self.body
        makes: tuple[Callable[[np.ndarray], Solve | None], ...] = (body.factorise, body.refactorise)
        for make, factor in zip(makes, saved["factors"], strict=False):
            body.freeze(factor["x"], factor["history"])
            self._now = factor["t"]
            self.motion.set(self._now)
            self.newton.inverse = make(factor["x"])
        self._factored = list(saved["factors"])
        self.progress = Progress(**{**saved["progress"], "work": Work(**saved["progress"]["work"])})
        body.memory = saved["history"]
        self.follow, self.drift = np.array(saved["follow"]), np.array(saved["drift"])
        self.newton.largest = saved["largest"]
        self._stand(saved["x"])


def _error(problem: str, t: float, dt: float) -> Exception:
    kind = (
        InvertedElementError
        if "inverted" in problem
        else ContactError
        if "penetration" in problem
        else ConvergenceError
    )
    return kind(
        f"the time step of {dt:.2g} s at t = {t:.3f} s still fails: {problem}; "
        "try a finer mesh at the site, a slower blade or a smaller opening"
    )
