"""A problem through time: steps that land on touch and events, are as long as their error allows, and can be redone."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ngbrain.errors import Breakdown, ContactError, InputError, solver_error
from ngbrain.forward.common.rigid_motions import check_held
from ngbrain.forward.common.state import State
from ngbrain.forward.contact.force_control import ForceControlledTool, PrescribedForce
from ngbrain.forward.contact.motion import Motion
from ngbrain.forward.solid.advance import LoadHistory, LoadProgram, StepResult, advance, newton_for
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.tangent import Solve
from ngbrain.forward.transient.step_control import Control, PrescribedSteps, StepperProgress
from ngbrain.result import Status
from ngbrain.solvers.newton import Newton
from ngbrain.solvers.record import NewtonRecord, SolverWork

Array = np.ndarray
LOG = logging.getLogger(__name__)
PROBE = 1e-3
"""Part of a step's load over which the residual's derivative is taken."""
WHOLES = 1
"""Factorisations of a focused body's whole tangent in a step; one that needs more is cut, which costs less."""
FORESEEN = 2
"""Tries of a step that begin where it is foreseen to end; later ones begin where it stands."""


Watch = Callable[[Problem, StepperProgress, NewtonRecord], None]


class TimeStepper:
    """Adaptive time stepping of a `Problem`: quasi-static or with inertia, under a `Motion`, a `LoadHistory`, or both.

    `run` raises `ConvergenceError`, `InvertedElementError` or `ContactError` when steps get too short; the problem is then at
    the end of the last accepted step.

    Parameters
    ----------
    problem : Problem
    motion : Motion, optional
        Of the rigid bodies in its contacts; None: they are at rest.
    control : Control
        Time-step controller.
    penetration_limit : float
        Steps that end with a deeper penetration (m) are rejected.
    newton : Newton, optional
        Settings.
    loads : LoadHistory, optional
        Of boundary conditions and loads; None: load factor 1 from the start.

    Raises
    ------
    InputError
        For a body with a free rigid motion, neither motion nor loads, or a `PrescribedForce` in only one of motion and contacts.

    Examples
    --------
    A relaxing block that is stretched by 10 % in a second and held: its force falls towards half.

    >>> from ngbrain.forward import LoadHistory, Material
    >>> from ngbrain.materials import NeoHooke, Prony
    >>> from ngbrain.mesh import block
    >>> law = Prony(NeoHooke(1e3), [0.5], [0.5])
    >>> body = Problem(block((0.01,) * 3, 0.01), {".*": Material(law, bulk=1e5)}, {"bottom": 0, "top": (0, 0, 1e-3)})
    >>> force, times = [], np.linspace(0.0, 4.0, 9)
    >>> stepper = TimeStepper(body, None, PrescribedSteps(times), loads=LoadHistory(times, np.minimum(times, 1.0)))
    >>> stepper.run(lambda problem, progress, record: force.append(problem.force("top")[2]))
    >>> bool(force[1] > 1.2 * force[-1] > 0)  # force on the plate, N
    True
    """

    def __init__(
        self,
        problem: Problem,
        motion: Motion | None,
        control: Control,
        penetration_limit: float = np.inf,
        newton: Newton | None = None,
        loads: LoadHistory | None = None,
    ) -> None:
        if not problem.contacts and problem.inertia is None:
            check_held(problem.supports, problem.loads, problem.kinematics)
        if motion is None and loads is None:
            raise InputError("motion", None, "a motion of rigid bodies, or a history of loads")
        if (None if problem.tool is None else problem.tool.prescribed) is not (motion if _forced(motion) else None):
            raise InputError(
                "motion",
                type(motion).__name__,
                "the PrescribedForce that is among the problem's contacts, or none in both",
            )
        self.problem, self.motion, self.control = problem, motion, control
        self.program = LoadProgram(problem, motion, loads)
        self.penetration_limit = penetration_limit
        self.newton = replace(newton or newton_for(problem), inverse=None, largest=0.0)
        self.progress = StepperProgress(t=0.0 if loads is None else float(loads.times[0]), dt=control.touch)
        self.events = self.program.events
        self.follow = np.zeros(len(problem.x))
        self.drift = np.zeros(len(problem.x))
        self._begun, self._now, self._wholes = self.progress.t, self.progress.t, 0
        self._factored: list[dict[str, Any]] = []
        x = problem.x
        self.program.set(self.progress.t)
        if problem.tool is not None:
            problem.tool.hold_at(x[-1])

    def run(self, observe: Watch, until: float = float("inf")) -> None:
        """Step to the last event.

        Parameters
        ----------
        observe : callable
            Called with problem, progress and Newton's record after every accepted step.
        until : float
            Earlier end (s).
        """
        end = min(until, self.events[-1])
        while self.progress.t < end:
            record = self.step()
            observe(self.problem, self.progress, record)

    def step(self) -> NewtonRecord:
        """One accepted step, shortened as often as needed."""
        at = self.progress
        start, dt = self.problem.state(at.t), self._propose()
        at.cut, tries = False, 0
        while True:
            made = self._attempt(start, dt, tries)
            tries += 1
            self._count(made.record)
            if made.failure is None:
                self._accept(start.x, dt)
                LOG.info("step %d: t = %.6g s, dt = %.3g s, %d iterations", at.steps, at.t, dt, made.record.iterations)
                return made.record
            at.rejected += 1
            LOG.info("step of %.3g s from t = %.6g s rejected: %s", dt, at.t, made.failure)
            at.cut = True
            dt = dt / 3
            if dt < self.control.shortest:
                raise _error(made.failure, made.record, at.t, dt)

    def _propose(self) -> float:
        """Step length from what the control says, landing on touch and events."""
        at = self.progress
        left = self.events[at.event] - at.t
        dt = self.control.propose_step(at, lambda ahead: self.program.travel(at.t, at.t + min(left, ahead)))
        if not at.touching:
            dt = self._up_to_touch(dt)
        # Two even steps rather than a long one and a sliver before an event.
        return left if dt >= left * (1 - 1e-9) else min(dt, left / 2) if dt > left / 2 else dt

    def _up_to_touch(self, dt: float) -> float:
        """Shorten a step of bodies that come nearer so that it ends just after first touch.

        A rigid body that is asked for a force is there at once.
        """
        at, touch_dt = self.progress, self.control.touch
        speed = self.program.travel(at.t, at.t + touch_dt) / touch_dt
        if not speed > 0:
            return dt
        way = 0.0 if self.problem.tool is not None else max(self.problem.min_gap(), 0.0)
        return min(dt, way / speed + touch_dt)

    def _attempt(self, start: State, dt: float, tries: int) -> StepResult:
        self._now, self._wholes = start.t + dt, 0

        def solve() -> tuple[Array, NewtonRecord]:
            return self.newton.solve(self, self._guess(start.x, dt, tries))

        made = advance(self.problem, start, dt, self.program, solve, lambda record: self._judge(start))
        tool = self.problem.tool
        if made.failure is None and tool is not None and tool.travel > tool.prescribed.limit:
            way, force = tool.travel, tool.prescribed.force
            self.program.set(start.t)
            self.problem.set_state(start)
            raise ContactError(
                f"a force of {force:.3g} N at t = {start.t + dt:.3f} s takes the blade {1e3 * way:.2f} mm far, beyond the limit of "
                f"{1e3 * tool.prescribed.limit:.4g} mm; try a smaller force"
            )
        return made

    def _judge(self, start: State) -> Breakdown | None:
        """Whether the end of a step that stands is not to be taken."""
        depth = -self.problem.min_gap()
        if depth > self.penetration_limit:
            limit = f"the limit {1e3 * self.penetration_limit:.2f} mm"
            return Breakdown(f"penetration {1e3 * depth:.2f} mm over {limit}", Status.PENETRATION)
        judged = self.control.check_step(self.problem, start.x, self.progress)
        return Breakdown(judged, Status.INACCURATE) if judged else None

    def _guess(self, start: Array, dt: float, tries: int) -> Array:
        """Where a step from some unknowns may end, after so many tries."""
        at, guess, program, tool = self.progress, start, self.program, self.problem.tool
        loads = program.factor(at.t) != program.factor(at.t + dt)
        if loads:
            start = guess = self._ahead(start, at.t, at.t + dt)
        if tool is not None and not at.touching and tool.prescribed.force:
            return self._landed(start, tool)
        if loads:
            return guess
        start = guess = program.prescribe(start, at.t + dt)
        if tries >= FORESEEN:
            return start
        travel = program.travel(at.t, at.t + dt)
        if at.touching and travel:
            # The tissue follows the body as it did when it was last pushed, or goes back the same way.
            guess = start + self.follow * travel
        elif not travel and not at.rested:
            guess = start + self.drift * self._slowing(at.t, at.t + dt)
        return guess if guess is start or self.problem.min_det(guess) > self.newton.min_det else start

    def _landed(self, start: Array, tool: ForceControlledTool) -> Array:
        """With a rigid body that does not touch led to where it does."""

        def solve(guess: Array) -> tuple[Array, bool]:
            found, record = self.newton.solve(self, guess)
            self._count(record)
            return found, record.converged

        def set_unknowns(x: Array) -> None:
            self.problem.x = x

        guess = tool.establish_contact(start, solve, set_unknowns)
        self.newton.inverse = None  # a tangent of before the touch knows nothing of it
        return guess

    def _count(self, record: NewtonRecord) -> None:
        """Add the work of a solve."""
        self.progress.work += record.work
        self.progress.newton += record.iterations

    def _ahead(self, start: Array, t: float, end: float) -> Array:
        """Along the tangent of a change of load, where there is one."""
        lift = self.program.prescribe
        lifted = lift(start, end)
        guess, inverse = lifted, self.newton.inverse
        if inverse is not None and not np.array_equal(lifted, start):
            r = self.problem.residual(lift(start, t))[0]
            near = lift(start, t + PROBE * (end - t))
            guess = lifted - inverse((self.problem.residual(near)[0] - r) / PROBE)
            lift(start, end)
        return guess if self.problem.min_det(guess) > self.newton.min_det else lifted

    def _slowing(self, start: float, end: float) -> float:
        """How far a hold gets between two times on a scale on which relaxation is nearly even: the logarithm's."""
        event = self.events[self.progress.event - 1] if self.progress.event else self._begun
        return float(np.log1p((end - event) / self.control.touch) - np.log1p((start - event) / self.control.touch))

    def _accept(self, start: Array, dt: float) -> None:
        at = self.progress
        touched = self.problem.min_gap() < 0
        travel, moved = self.program.travel(at.t, at.t + dt), self.problem.x - start
        if touched and travel and (at.touching or at.t == 0):  # a run starts in touch
            self.follow = moved / travel
        if not travel:
            self.drift = moved / self._slowing(at.t, at.t + dt)
        # After first touch the steps start again from a short one.
        at.dt = min(dt, self.control.touch) if touched and not at.touching else dt
        at.touching = touched
        at.steps += 1
        event = self.events[at.event]
        at.rested = abs(at.t + dt - event) < 1e-9 * max(event, 1.0)
        at.t = event if at.rested else at.t + dt
        if at.rested:
            at.event = min(at.event + 1, len(self.events) - 1)

    # What Newton's method asks (solvers.newton.System): the body's answers, with a note of where a factor was made.

    @property
    def weights(self) -> np.ndarray:
        """The body's weights."""
        return self.problem.weights

    def residual(self, x: np.ndarray) -> tuple[np.ndarray, float]:
        """The body's residual."""
        return self.problem.residual(x)

    def min_det(self, x: np.ndarray) -> float:
        """The body's smallest det F."""
        return self.problem.min_det(x)

    def factorise(self, x: np.ndarray, r: np.ndarray) -> Solve:
        """The problem's factorisation; its state is recorded so that a restart reproduces it.

        Parameters
        ----------
        x, r : array (n,)
            Unknowns and residual.

        Returns
        -------
        callable
        """
        solve = self.problem.factorise(x, r)
        self._factored = [*(self._factored[:1] if self.problem.partial else []), self._here(x)]
        self._wholes += not self.problem.partial
        if self.problem.focused and self._wholes > WHOLES:
            raise Breakdown(f"the tangent changes all over the body {self._wholes} times")
        return solve

    def _here(self, x: np.ndarray) -> dict[str, Any]:
        return {"t": self._now, "x": x.copy(), "frozen": self.problem.frozen}

    # Restart.

    def checkpoint(self) -> dict[str, Any]:
        """Everything that decides the steps to come, as arrays and numbers."""
        return {
            "progress": {**self.progress.__dict__, "work": dict(self.progress.work.__dict__)},
            "state": dict(self.problem.state(self.progress.t).__dict__),
            "follow": self.follow,
            "drift": self.drift,
            "largest": self.newton.largest,
            "factors": self._factored if self.newton.inverse is not None else [],
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Go on from a checkpoint, to the same bits on one thread."""
        problem = self.problem
        makes: tuple[Callable[[np.ndarray], Solve | None], ...] = (problem.factorise, problem.refactorise)
        for make, factor in zip(makes, saved["factors"], strict=False):
            problem.freeze(factor["x"], factor["frozen"])
            self._now = factor["t"]
            self.program.set(self._now)
            self.newton.inverse = make(factor["x"])
        self._factored = list(saved["factors"])
        self.progress = StepperProgress(**{**saved["progress"], "work": SolverWork(**saved["progress"]["work"])})
        self.follow, self.drift = np.array(saved["follow"]), np.array(saved["drift"])
        self.newton.largest = saved["largest"]
        self.program.set(self.progress.t)
        problem.set_state(State(**saved["state"]))


def _forced(motion: Motion | None) -> bool:
    return isinstance(motion, PrescribedForce)


def _error(failed: Breakdown, record: NewtonRecord, t: float, dt: float) -> Exception:
    advice = "try a finer mesh where it fails, a slower motion or a smaller one"
    return solver_error(
        f"the time step of {dt:.2g} s at t = {t:.3f} s still fails: {failed}; {advice}", failed.status, record
    )


def run_load_history(
    problem: Problem,
    times: Sequence[float] | Array,
    factors: Sequence[float] | Array,
    observe: Callable[[float], Any],
    newton: Newton | None = None,
    motion: Motion | None = None,
) -> list[Any]:
    """Run a problem through given times with given load factors.

    The steps are between the times, of second order; a step that fails is shortened.

    Parameters
    ----------
    problem : Problem
        At rest at times[0].
    times : array (n,)
        Increasing times (s).
    factors : array (n,)
        Load factor at each.
    observe : callable
        Called with the time after each of them.
    newton : Newton, optional
        Settings.
    motion : Motion, optional
        Of rigid bodies.

    Returns
    -------
    list
        What `observe` gave.

    Raises
    ------
    InputError, ConvergenceError
        As `TimeStepper`.

    Examples
    --------
    >>> from ngbrain.forward.common.material import Material
    >>> from ngbrain.materials import NeoHooke, Prony
    >>> from ngbrain.mesh import block
    >>> tissue = {".*": Material(Prony(NeoHooke(1e3), [0.5], [1.0]), 1e5)}
    >>> body = Problem(block((0.1, 0.1, 0.1), 0.1), tissue, {"bottom": 0, "top": (0, 0, -1e-4)}, element="P2/P1")
    >>> forces = run_load_history(body, [0, 0.01, 10, 30], [0, 1, 1, 1], lambda t: body.force("top")[2])
    >>> round(float(forces[-1] / forces[0]), 2)
    0.5
    """
    found: list[Any] = []
    loads = LoadHistory(times, factors)
    stepper = TimeStepper(problem, motion, PrescribedSteps(loads.times), newton=newton, loads=loads)
    stepper.run(lambda body, at, record: found.append(observe(at.t)) if at.rested else None)
    return found
