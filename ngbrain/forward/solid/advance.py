"""One step of a problem under prescribed motion and loads: the basis of load paths, time stepping and replays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ngbrain.errors import Breakdown, InputError
from ngbrain.forward.common.state import State
from ngbrain.forward.contact.motion import Motion
from ngbrain.forward.solid.problem import Problem
from ngbrain.solvers.newton import Newton
from ngbrain.solvers.record import NewtonRecord

Array = np.ndarray
UPHILL, RUBBING = 4, 1
"""`Newton.max_climbs` of displacement elements, and with friction: its tangent omits the dependence on pressure, so that a
correction of the pressure is followed by a larger one along the wall."""


class LoadHistory:
    """Piecewise linear load factor over time, of boundary conditions and loads.

    Parameters
    ----------
    times : array (n,)
        Increasing times (s).
    factors : array (n,)
        Load factors.

    Raises
    ------
    InputError
        Unless times increase and there is a factor for each.
    """

    def __init__(self, times: Sequence[float] | Array, factors: Sequence[float] | Array) -> None:
        self.times, self.factors = np.asarray(times, float), np.asarray(factors, float)
        increasing = self.times.ndim == 1 and len(self.times) > 1 and np.all(np.diff(self.times) > 0)
        if not increasing or self.times.shape != self.factors.shape:
            raise InputError("times", np.array2string(self.times, threshold=4), "increasing, with a factor for each")

    def factor(self, t: float) -> float:
        """Load factor at a time (s)."""
        return float(np.interp(t, self.times, self.factors))


@dataclass(frozen=True)
class LoadProgram:
    """Prescribed motion of rigid bodies and load factor of a problem over time.

    Parameters
    ----------
    problem : Problem
    motion : Motion, optional
        Motion of rigid bodies; by default they are at rest.
    loads : LoadHistory, optional
        Load factor of boundary conditions and loads; by default 1.
    """

    problem: Problem
    motion: Motion | None = None
    loads: LoadHistory | None = None

    def factor(self, t: float) -> float:
        """Load factor at a time (s)."""
        return 1.0 if self.loads is None else self.loads.factor(t)

    def set(self, t: float) -> None:
        """Set the load factor, and move rigid bodies, to a time (s)."""
        if self.motion is not None:
            self.motion.set(t)
        self.problem.factor.Set(self.factor(t))

    def prescribe(self, x: Array, t: float) -> Array:
        """Unknowns with the displacements prescribed at a time; moves rigid bodies and sets the loads.

        Parameters
        ----------
        x : array (n,)
            Unknowns.
        t : float
            Time (s) or load factor.

        Returns
        -------
        array (n,)
        """
        if self.motion is not None:
            self.motion.set(t)
        return self.problem.load(x, self.factor(t))

    def travel(self, start: float, end: float) -> float:
        """Travel of rigid bodies towards the tissue between two times.

        Parameters
        ----------
        start, end : float
            Times (s).

        Returns
        -------
        float
            In metres.
        """
        return 0.0 if self.motion is None else self.motion.travel(start, end)

    @property
    def events(self) -> tuple[float, ...]:
        """Times (s) at which motion or loads change, in order; the last one is the end."""
        motion = () if self.motion is None else self.motion.events
        return tuple(sorted({*motion, *(() if self.loads is None else self.loads.times[1:].tolist())}))


@dataclass(frozen=True)
class StepResult:
    """Result of a time step.

    Parameters
    ----------
    state : State
        State at the end of the step; at its start if it failed.
    record : NewtonRecord
    failure : Breakdown, optional
        Reason of a failure.
    """

    state: State
    record: NewtonRecord
    failure: Breakdown | None


def advance(
    problem: Problem,
    state: State,
    dt: float,
    program: LoadProgram,
    solve: Callable[[], tuple[Array, NewtonRecord]],
    judge: Callable[[NewtonRecord], Breakdown | None] | None = None,
) -> StepResult:
    """Make one step of `dt` from a state; the problem is left at its end, or at its start if the step fails.

    Parameters
    ----------
    problem : Problem
    state : State
        Start of the step.
    dt : float
        Length of the step (s, or load factor).
    program : LoadProgram
        Prescribed motion and loads.
    solve : callable
        Solves for the unknowns at the end of the step, where prescribed values are already set.
    judge : callable, optional
        Checks the solution before internal variables are updated: returns the reason for rejection, or None.

    Returns
    -------
    StepResult

    Examples
    --------
    Relaxation of a suddenly compressed block; a state is a value from which several continuations can start.

    >>> from ngbrain.forward import Material, Problem
    >>> from ngbrain.materials import NeoHooke, Prony
    >>> from ngbrain.mesh import block
    >>> tissue, conditions = {".*": Material(Prony(NeoHooke(1e3), [0.5], [1.0]), 1e5)}, {"bottom": 0, "top": (0, 0, -1e-4)}
    >>> body = Problem(block((0.1, 0.1, 0.1), 0.1), tissue, conditions, element="P2/P1")
    >>> program, newton = LoadProgram(body), newton_for(body)
    >>> def step(state, dt):
    ...     return advance(body, state, dt, program, lambda: newton.solve(body, body.load(state.x, 1.0))).state
    >>> pressed = step(body.reset(), 1e-3)
    >>> forces = [body.force("top")[2] for dt in (0.1, 30.0) if step(pressed, dt)]
    >>> bool(forces[0] < forces[1] < 0)
    True
    """
    program.set(state.t)
    problem.set_state(state)
    problem.begin(dt)
    program.set(state.t + dt)
    problem.x, record = solve()
    if not record.converged:
        failure: Breakdown | None = Breakdown(record.reason, record.status)
    else:
        failure = judge(record) if judge else None
    if failure is not None:
        program.set(state.t)
        problem.set_state(state)
        return StepResult(state, record, failure)
    problem.finish()
    return StepResult(problem.state(state.t + dt), record, None)


def newton_for(problem: Problem, **settings: Any) -> Newton:
    """Newton's method with the settings that the problem's element needs, and further ones such as rtol=1e-10."""
    rubs = RUBBING if problem.friction.frictions else 0
    return Newton(**{"max_climbs": UPHILL if problem.element.pressure is None else rubs, **settings})
