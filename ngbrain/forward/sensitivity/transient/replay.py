"""A run repeated on a fixed time grid, tightly converged, with checkpoints.

Of N steps every `every`-th history of internal variables is kept; those between are recomputed from there. With √N, the default,
at most 2√N are in memory. States, each a small part of a history, are all kept by default: nothing is solved twice, and a run at
other parameters starts from the known states. Without them, √N states are kept too and the run is solved once more.

References
----------
Griewank 1992, https://doi.org/10.1080/10556789208805505 (checkpointing).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ngbrain.errors import InputError, solver_error
from ngbrain.forward.common.state import State
from ngbrain.forward.contact.motion import Motion
from ngbrain.forward.solid.advance import LoadHistory, LoadProgram, advance
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.look import BriefText
from ngbrain.result import Status
from ngbrain.solvers.newton import Newton, System
from ngbrain.solvers.record import NewtonRecord

Array = np.ndarray
TIGHT = Newton(rtol=1e-10, xtol=1e-10, max_iter=80)
"""Derivatives are those of the converged step: the remaining residual is an error in them."""
SHORTEST = 1e-2
"""Smallest substep of the rigid bodies' motion, as a fraction of the step, where Newton's method does not converge at once."""


@dataclass(frozen=True, repr=False)
class ReplayStep(BriefText):
    """The n-th time step.

    Parameters
    ----------
    n : int
        It goes from grid[n] to grid[n + 1].
    start : State
        State at its start.
    x : array (ndof,)
        Degrees of freedom at its end.
    """

    n: int
    start: State
    x: Array


@dataclass(frozen=True, repr=False)
class RunCheckpoint(BriefText):
    """The run at grid[n].

    Parameters
    ----------
    n : int
        Index of the time.
    state : State
        The state.
    before : array (ndof,)
        Degrees of freedom one step earlier.
    """

    n: int
    state: State
    before: Array


def accepted_times(transient: TimeStepper) -> Array:
    """Run a time stepper to its end and return the times (s) of its accepted steps, a grid for `Replay`."""
    grid = [transient.progress.t]
    transient.run(lambda body, at, record: grid.append(at.t))
    return np.array(grid)


class Replay:
    """Time steps of a body on a fixed time grid.

    Steps are never cut when Newton's method fails, as the grid would then depend on the parameters.

    Parameters
    ----------
    body : Problem
        The body.
    motion : Motion
        Motion of its rigid bodies.
    grid : array
        Times (s) from 0.
    newton : Newton
        Tight settings.
    every : int, optional
        Steps between stored histories. None: √N; 1: all are stored.
    states : bool
        Whether the states of all steps are stored.
    system : System, optional
        What Newton's method solves, with its own tangent; by default the body.
    loads : LoadHistory, optional
        Load factors of supports and loads; None: 1 from the first step.

    Attributes
    ----------
    solved : int
        Steps solved by Newton's method so far.

    Raises
    ------
    InputError
        For a motion, a grid or an interval that does not fit.
    ConvergenceError, InvertedElementError
        By `run`, where a step fails.
    """

    def __init__(
        self,
        body: Problem,
        motion: Motion,
        grid: Array,
        newton: Newton = TIGHT,
        every: int | None = None,
        states: bool = True,
        system: System | None = None,
        loads: LoadHistory | None = None,
    ) -> None:
        if body.tool is not None and motion is not body.tool.prescribed:
            raise InputError("motion", type(motion).__name__, "the PrescribedForce among the body's contacts")
        grid = np.asarray(grid, float)
        if grid.ndim != 1 or len(grid) < 2 or grid[0] != 0 or not np.all(np.diff(grid) > 0):
            raise InputError("grid", f"of shape {grid.shape}", "two or more increasing times (s) from 0 on")
        self.body, self.motion, self.grid, self.newton = body, motion, grid, newton
        self._system = system or body
        self.every = max(1, round(np.sqrt(len(grid) - 1))) if every is None else every
        if self.every < 1:
            raise InputError("every", self.every, "a number of steps, at least 1")
        self.solved = 0
        self._program = LoadProgram(body, motion, loads)
        self._program.set(0.0)
        self.checkpoints: list[RunCheckpoint] = []
        self._last: list[ReplayStep] = []
        self._store_states, self._states, self._known_states = states, list[Array](), list[Array]()

    @property
    def stored_histories(self) -> int:
        """Number of histories in memory."""
        return len(self.checkpoints) + len(self._last)

    def run(self, callback: Callable[[ReplayStep], None]) -> None:
        """Run from rest to the end; `callback` is called at the end of each step, before the history is updated."""
        self._program.set(0.0)  # a force-controlled tool at its rest position
        start = self.body.reset()
        self._newton = replace(self.newton, inverse=None, largest=0.0)
        rtol, xtol = max(self.newton.rtol, Newton.rtol), max(self.newton.xtol, Newton.xtol)
        self._loose_newton = replace(self._newton, rtol=rtol, xtol=xtol)
        self.checkpoints, self._last = [], []
        if len(self._states) == len(self.grid) - 1:
            self._known_states = self._states
        self._states = []
        here = RunCheckpoint(0, start, start.x)
        while here.n < len(self.grid) - 1:
            self.checkpoints.append(here)
            here = self._segment(here, callback)

    def load_factor(self, step: ReplayStep) -> float:
        """Load factor at the end of a step."""
        return self._program.factor(self.grid[step.n + 1])

    def forwards(self) -> Iterator[ReplayStep]:
        """All steps, with the body at the end of each and its history not yet updated."""
        for start in self.checkpoints:
            for step in self._steps(start):
                yield self.restore(step)

    def backwards(self) -> Iterator[ReplayStep]:
        """As `forwards`, from the last step to the first."""
        for steps in self.segments():
            yield from map(self.restore, reversed(steps))

    def segments(self) -> Iterator[list[ReplayStep]]:
        """Steps between checkpoints, last segment first."""
        return map(self._steps, reversed(self.checkpoints))

    def _steps(self, start: RunCheckpoint) -> list[ReplayStep]:
        if not self._last or self._last[0].n != start.n:
            self._segment(start, lambda step: None)
        return self._last

    def _segment(self, start: RunCheckpoint, callback: Callable[[ReplayStep], None]) -> RunCheckpoint:
        """Steps from one checkpoint to the next."""
        steps, state, before = list[ReplayStep](), start.state, start.before
        self._last = []
        for n in range(start.n, min(start.n + self.every, len(self.grid) - 1)):
            state, before = self._step(n, state, before, steps, callback), state.x
        self._last = steps
        return RunCheckpoint(steps[-1].n + 1, state, before)

    def _step(
        self, n: int, start: State, before: Array, steps: list[ReplayStep], callback: Callable[[ReplayStep], None]
    ) -> State:
        end = np.empty(0)

        def solve() -> tuple[Array, NewtonRecord]:
            nonlocal end
            end, record = self._solve_end(n, start.x, before)
            return end, record

        def look(record: NewtonRecord) -> None:
            self._set_end(end)
            steps.append(ReplayStep(n, start, end))
            callback(steps[-1])

        dt = self.grid[n + 1] - self.grid[n]
        result = advance(self.body, start, dt, self._program, solve, look)
        if result.failure is not None:
            said = f"the step from {self.grid[n]:.3g} to {self.grid[n + 1]:.3g} s of the replayed run fails: {result.failure}"
            raise solver_error(said, result.failure.status, result.record)
        if self.body.tool is not None and self.body.tool.prescribed.fixed_travel is not None:
            end = result.state.x  # the tool is again just clear of the tissue
        return replace(result.state, t=self.grid[n + 1], x=end)  # one array, shared by all references

    def _solve_end(self, n: int, x: Array, before: Array) -> tuple[Array, NewtonRecord]:
        """End of a step from x: known, or solved for."""
        if n < len(self._states):
            return self._states[n], NewtonRecord(status=Status.CONVERGED)
        guess = self._guess(n, x, before)
        if self._out_of_contact(x):
            self._loose_newton.inverse = None  # that tangent does not contain the contact
            if self._out_of_contact(guess):
                x = guess = self._in_contact(x)
        new, record = self._solve_in_substeps(n, x, guess, before)
        self.solved += 1
        if self._store_states:
            self._states.append(new)
        return new, record

    def _guess(self, n: int, x: Array, before: Array) -> Array:
        """Initial guess from the run at other parameters, or extrapolated from the previous step."""
        if not self._known_states:
            return self._extrapolated((self.grid[max(n - 1, 0)], before), (self.grid[n], x), self.grid[n + 1])
        moved = x - self._known_states[n - 1] if n else np.zeros_like(x)
        if n and self.body.tool is not None and not self.body.tool.prescribed.prescribed_force(self.grid[n]):
            moved[-1] = 0.0  # it has been withdrawn since
        guess = self._known_states[n] + moved
        return guess if self.body.min_det(guess) > self.newton.min_det else x

    def _extrapolated(self, before: tuple[float, Array], last: tuple[float, Array], t: float) -> Array:
        """Guess at time t from the two previous states, each with its time, in proportion to the rigid bodies' travel."""
        travel, previous = self.motion.travel(last[0], t), self.motion.travel(before[0], last[0])
        guess = last[1] + (travel / previous if previous * travel > 0 else 0.0) * (last[1] - before[1])
        return guess if self.body.min_det(guess) > self.newton.min_det else last[1]

    def _out_of_contact(self, guess: Array) -> bool:
        """Whether a force-controlled tool that should press is not in contact."""
        tool = self.body.tool
        if tool is None or tool.prescribed.fixed_travel is not None:
            return False
        self.body.x = guess
        return not self.body.min_gap() < 0

    def _in_contact(self, x: Array) -> Array:
        """State with a force-controlled tool moved into contact."""
        assert self.body.tool is not None

        def solve(guess: Array) -> tuple[Array, bool]:
            found, record = self._loose_newton.solve(self._system, guess)
            return found, record.converged

        def set_unknowns(x: Array) -> None:
            self.body.x = x

        guess = self.body.tool.establish_contact(x, solve, set_unknowns)
        self._loose_newton.inverse = None
        return guess

    def _solve_in_substeps(self, n: int, x: Array, guess: Array, before: Array) -> tuple[Array, NewtonRecord]:
        """End of a step, by substeps of the rigid bodies' motion where Newton's method does not converge at once."""
        start, end = self.grid[n], self.grid[n + 1]
        previous, last, t = (self.grid[max(n - 1, 0)], before), (start, x), end
        while True:
            reached, record = self._solve_at(t, guess)
            part = t - last[0]
            if record.converged:
                previous, last = last, (t, reached)
                if t == end:
                    return reached, record
                part = 2 * part
            elif part > SHORTEST * (end - start):
                part = part / 4
                if self._out_of_contact(last[1]):
                    last = (last[0], self._in_contact(last[1]))
            else:
                return last[1], record
            t = last[0] + part if part < (1 - 1e-9) * (end - last[0]) else end
            guess = self._extrapolated(previous, last, t) if record.converged else last[1]

    def _solve_at(self, t: float, guess: Array) -> tuple[Array, NewtonRecord]:
        """Newton's method with loose tolerances, under which contact may open and close, then with tight ones."""
        x, record = self._loose_newton.solve(self._system, self._program.prescribe(guess, t))
        if record.converged:
            self._newton.inverse = self._loose_newton.inverse
            x, record = self._newton.solve(self._system, x)
        return x, record

    def restore(self, step: ReplayStep) -> ReplayStep:
        """Put the body at the end of a step, with its internal variables not yet updated."""
        body = self.body
        self._program.set(self.grid[step.n])
        body.set_state(step.start)
        body.begin(self.grid[step.n + 1] - self.grid[step.n])
        self._program.set(self.grid[step.n + 1])
        self._set_end(step.x)
        return step

    def _set_end(self, x: Array) -> None:
        """Set the degrees of freedom, and update the Maxwell branches there."""
        self.body.x = x
        if self.body.history.maxwell:
            self.body.residual(x)
