"""Adaptive time stepping: steps end on first contact and on events, are controlled by their error, and can be repeated."""

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
"""Fraction of a step's load for the difference quotient of the residual."""
MAX_FULL_FACTORISATIONS = 1
"""Full factorisations per step with a partially renewed tangent; a step that needs more is shortened, which costs less."""
PREDICTED_ATTEMPTS = 2
"""Attempts of a step that start from a predictor; later ones start from the current state."""


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
    A viscoelastic block is stretched by 10 % within a second and held: its force relaxes towards half.

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
        if (None if problem.tool is None else problem.tool.prescribed) is not (
            motion if _is_force_controlled(motion) else None
        ):
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
        self._begun, self._now, self._full_factorisations = self.progress.t, self.progress.t, 0
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
        """Make one accepted step, shortened as often as needed."""
        at = self.progress
        start, dt = self.problem.state(at.t), self._propose()
        at.cut, tries = False, 0
        while True:
            result = self._attempt(start, dt, tries)
            tries += 1
            self._count(result.record)
            if result.failure is None:
                self._accept(start.x, dt)
                LOG.info(
                    "step %d: t = %.6g s, dt = %.3g s, %d iterations", at.steps, at.t, dt, result.record.iterations
                )
                return result.record
            at.rejected += 1
            LOG.info("step of %.3g s from t = %.6g s rejected: %s", dt, at.t, result.failure)
            at.cut = True
            dt = dt / 3
            if dt < self.control.shortest:
                raise _error(result.failure, result.record, at.t, dt)

    def _propose(self) -> float:
        """Step length by the controller, limited to end on first contact and on events."""
        at = self.progress
        remaining = self.events[at.event] - at.t
        dt = self.control.propose_step(at, lambda ahead: self.program.travel(at.t, at.t + min(remaining, ahead)))
        if not at.touching:
            dt = self._up_to_contact(dt)
        # Two equal steps rather than a long and a very short one before an event.
        return remaining if dt >= remaining * (1 - 1e-9) else min(dt, remaining / 2) if dt > remaining / 2 else dt

    def _up_to_contact(self, dt: float) -> float:
        """Shorten a step of approaching bodies so that it ends just after first contact.

        A force-controlled body is in contact at once.
        """
        at, touch_dt = self.progress, self.control.touch
        speed = self.program.travel(at.t, at.t + touch_dt) / touch_dt
        if not speed > 0:
            return dt
        gap = 0.0 if self.problem.tool is not None else max(self.problem.min_gap(), 0.0)
        return min(dt, gap / speed + touch_dt)

    def _attempt(self, start: State, dt: float, tries: int) -> StepResult:
        self._now, self._full_factorisations = start.t + dt, 0

        def solve() -> tuple[Array, NewtonRecord]:
            return self.newton.solve(self, self._guess(start.x, dt, tries))

        result = advance(self.problem, start, dt, self.program, solve, lambda record: self._judge(start))
        tool = self.problem.tool
        if result.failure is None and tool is not None and tool.travel > tool.prescribed.limit:
            travel, force = tool.travel, tool.prescribed.force
            self.program.set(start.t)
            self.problem.set_state(start)
            raise ContactError(
                f"a force of {force:.3g} N at t = {start.t + dt:.3f} s moves the tool by {1e3 * travel:.2f} mm, beyond the limit "
                f"of {1e3 * tool.prescribed.limit:.4g} mm; try a smaller force"
            )
        return result

    def _judge(self, start: State) -> Breakdown | None:
        """Reason to reject the end of a step, or None."""
        depth = -self.problem.min_gap()
        if depth > self.penetration_limit:
            limit = f"the limit {1e3 * self.penetration_limit:.2f} mm"
            return Breakdown(f"penetration {1e3 * depth:.2f} mm over {limit}", Status.PENETRATION)
        reason = self.control.check_step(self.problem, start.x, self.progress)
        return Breakdown(reason, Status.INACCURATE) if reason else None

    def _guess(self, start: Array, dt: float, tries: int) -> Array:
        """Initial guess for the end of a step, by the number of failed attempts."""
        at, guess, program, tool = self.progress, start, self.program, self.problem.tool
        loads = program.factor(at.t) != program.factor(at.t + dt)
        if loads:
            start = guess = self._tangent_predictor(start, at.t, at.t + dt)
        if tool is not None and not at.touching and tool.prescribed.force:
            return self._in_contact(start, tool)
        if loads:
            return guess
        start = guess = program.prescribe(start, at.t + dt)
        if tries >= PREDICTED_ATTEMPTS:
            return start
        travel = program.travel(at.t, at.t + dt)
        if at.touching and travel:
            # The tissue moves with the body as in the last step of advance, in either direction.
            guess = start + self.follow * travel
        elif not travel and not at.rested:
            guess = start + self.drift * self._log_time_increment(at.t, at.t + dt)
        return guess if guess is start or self.problem.min_det(guess) > self.newton.min_det else start

    def _in_contact(self, start: Array, tool: ForceControlledTool) -> Array:
        """State with a force-controlled tool moved into contact."""

        def solve(guess: Array) -> tuple[Array, bool]:
            found, record = self.newton.solve(self, guess)
            self._count(record)
            return found, record.converged

        def set_unknowns(x: Array) -> None:
            self.problem.x = x

        guess = tool.establish_contact(start, solve, set_unknowns)
        self.newton.inverse = None  # the old tangent does not contain the contact
        return guess

    def _count(self, record: NewtonRecord) -> None:
        """Add the work of a solve."""
        self.progress.work += record.work
        self.progress.newton += record.iterations

    def _tangent_predictor(self, start: Array, t: float, end: float) -> Array:
        """Tangent predictor for a change of load, where there is a factorisation."""
        prescribe = self.program.prescribe
        prescribed = prescribe(start, end)
        guess, inverse = prescribed, self.newton.inverse
        if inverse is not None and not np.array_equal(prescribed, start):
            r = self.problem.residual(prescribe(start, t))[0]
            near = prescribe(start, t + PROBE * (end - t))
            guess = prescribed - inverse((self.problem.residual(near)[0] - r) / PROBE)
            prescribe(start, end)
        return guess if self.problem.min_det(guess) > self.newton.min_det else prescribed

    def _log_time_increment(self, start: float, end: float) -> float:
        """Difference of logarithmic time since the last event, on which relaxation is nearly linear."""
        event = self.events[self.progress.event - 1] if self.progress.event else self._begun
        return float(np.log1p((end - event) / self.control.touch) - np.log1p((start - event) / self.control.touch))

    def _accept(self, start: Array, dt: float) -> None:
        at = self.progress
        touched = self.problem.min_gap() < 0
        travel, moved = self.program.travel(at.t, at.t + dt), self.problem.x - start
        if touched and travel and (at.touching or at.t == 0):  # a run may start in contact
            self.follow = moved / travel
        if not travel:
            self.drift = moved / self._log_time_increment(at.t, at.t + dt)
        # After first contact steps grow again from a short one.
        at.dt = min(dt, self.control.touch) if touched and not at.touching else dt
        at.touching = touched
        at.steps += 1
        event = self.events[at.event]
        at.rested = abs(at.t + dt - event) < 1e-9 * max(event, 1.0)
        at.t = event if at.rested else at.t + dt
        if at.rested:
            at.event = min(at.event + 1, len(self.events) - 1)

    # Interface of Newton's method (solvers.newton.System): that of the body, with a record of the states of factorisations.

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
        self._factored = [*(self._factored[:1] if self.problem.partial else []), self._factor_state(x)]
        self._full_factorisations += not self.problem.partial
        if self.problem.focused and self._full_factorisations > MAX_FULL_FACTORISATIONS:
            raise Breakdown(f"more than {MAX_FULL_FACTORISATIONS} full factorisations of the tangent in a step")
        return solve

    def _factor_state(self, x: np.ndarray) -> dict[str, Any]:
        return {"t": self._now, "x": x.copy(), "frozen": self.problem.frozen}

    # Restart.

    def checkpoint(self) -> dict[str, Any]:
        """Everything that determines later steps, as arrays and numbers."""
        return {
            "progress": {**self.progress.__dict__, "work": dict(self.progress.work.__dict__)},
            "state": dict(self.problem.state(self.progress.t).__dict__),
            "follow": self.follow,
            "drift": self.drift,
            "largest": self.newton.largest,
            "factors": self._factored if self.newton.inverse is not None else [],
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Continue from a checkpoint; on one thread the results are identical to the last bit."""
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


def _is_force_controlled(motion: Motion | None) -> bool:
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

    Time steps are those between the times, of second order; a step that fails is shortened.

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
        Motion of rigid bodies.

    Returns
    -------
    list
        Results of `observe`.

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
