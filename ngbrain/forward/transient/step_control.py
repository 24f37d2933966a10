"""How long time steps are: chosen beforehand from the motion, or by the error that they make."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.solid.problem import Problem
from ngbrain.solvers.record import SolverWork

ORDER = 2
"""Of the history's steps."""
SAFETY, SHRINK, GROW = 0.9, 0.3, 4.0
"""Of steps by their error: part of the step that would just do, and least and largest factor from one to the next."""
LEAVING = 2
"""Steps of a body that withdraws from tissue, in one that pushes."""
OVER = 2.0
"""Tolerances by which the error of a step may be missed; it is taken again beyond."""


@dataclass
class StepperProgress:
    """Where a run stands; what a checkpoint has to hold besides the body's own arrays.

    factor     by which the next step may be longer than the last one, where steps are chosen by their error
    largest    overstress (Pa, rms over quadrature points) of the steps so far
    """

    t: float = 0.0
    dt: float = 0.0
    event: int = 0
    touching: bool = False
    rested: bool = True
    cut: bool = False
    steps: int = 0
    rejected: int = 0
    newton: int = 0
    factor: float = 1.0
    largest: float = 0.0
    work: SolverWork = field(default_factory=SolverWork)


class Control(Protocol):
    """What chooses the steps of a `TimeStepper`."""

    @property
    def touch(self) -> float:
        """First step (s) after touch."""

    @property
    def shortest(self) -> float:
        """Step (s) below which the run gives up."""

    def propose_step(self, at: StepperProgress, travel: Callable[[float], float]) -> float:
        """The next step (s); `travel` says how far (m) bodies come nearer in a time from now."""

    def check_step(self, problem: Problem, before: np.ndarray, at: StepperProgress) -> str:
        """What is wrong with the step from a state to the body's; a note of its error is left in `at`."""

    def halve(self) -> Control:
        """Steps of about half the length, for measuring what the step length costs in accuracy."""


@dataclass(frozen=True)
class StepControl:
    """Time steps, chosen beforehand from the motion; one that fails is cut.

    contact_dt   longest step (s) while a body moves in touch with the tissue
    first        first step after touch, as a fraction of contact_dt; grows from there by `touch_growth` a step
    restart      first step when a body that rested in touch moves again, as a fraction of contact_dt
    release_growth   the same while a body in touch withdraws
    growth       factor from step to step while nothing is pushed (holds, rests)
    dt_max       longest step (s) there
    smallest     fraction of contact_dt below which the run gives up
    """

    contact_dt: float
    first: float = 0.1
    restart: float = 0.1
    touch_growth: float = 2.0
    release_growth: float = 1.5
    growth: float = 2.0
    dt_max: float = 60.0
    smallest: float = 1e-3

    @property
    def touch(self) -> float:
        """First step (s) after touch."""
        return self.contact_dt * self.first

    @property
    def shortest(self) -> float:
        """Step (s) below which the run gives up."""
        return self.contact_dt * self.smallest

    def propose_step(self, at: StepperProgress, travel: Callable[[float], float]) -> float:
        """Touch gently, push evenly, rest with growing steps."""
        moved = travel(self.contact_dt)
        if at.touching and moved:
            start = self.contact_dt * self.restart
            growth = self.touch_growth if moved > 0 else self.release_growth
            longest = self.contact_dt if moved > 0 else self.contact_dt / LEAVING
        else:
            start, growth, longest = self.contact_dt, self.growth, self.dt_max
        return start if at.rested else min(at.dt * (1.0 if at.cut else growth), longest)

    def check_step(self, problem: Problem, before: np.ndarray, at: StepperProgress) -> str:
        """Nothing: these steps do not look at their error."""
        return ""

    def halve(self) -> StepControl:
        """The same steps at half the length."""
        return replace(self, contact_dt=self.contact_dt / 2, dt_max=self.dt_max / 2)


@dataclass(frozen=True)
class ErrorControl:
    """Time steps as long as their error allows, from milliseconds to as long as a hold.

    tolerance   of a step's error: rms over quadrature points of the difference of its overstress from that of two half steps along
                the same straight path, over the largest rms of the overstress so far; with `Inertia` also of the largest
                displacement's error, over its `amplitude`
    touch       first step (s) after touch, and after each event
    longest     step (s)
    shortest    step (s) below which the run gives up
    pushing     longest step (s) while a body moves in touch with the tissue,
    way         and furthest (m) that it goes in one; half of both while it withdraws, as the work of the step in which it
                leaves is wrong by what it loses there

    The history is of second order, so a step's error grows with its third power: the next is 0.9 (tolerance/error)^⅓ times as
    long. That the path is not straight is not seen; after first touch steps grow from `touch` again. Raises `InputError` unless
    0 < tolerance < 1 and 0 < shortest ≤ touch ≤ longest and pushing.

    Source: Hairer, Nørsett, Wanner 1993, 10.1007/978-3-540-78862-1, II.4 (error per step, factors).

    >>> ErrorControl(1e-3, touch=0.05).halved().tolerance
    0.000125
    """

    tolerance: float
    touch: float
    longest: float = np.inf
    shortest: float = 1e-4
    pushing: float = np.inf
    way: float = np.inf

    def __post_init__(self) -> None:
        if not 0 < self.tolerance < 1:
            raise InputError("ErrorControl.tolerance", self.tolerance, "a relative error between 0 and 1")
        if not 0 < self.shortest <= self.touch <= min(self.longest, self.pushing):
            found = f"shortest {self.shortest:g}, touch {self.touch:g}, longest {self.longest:g}, pushing {self.pushing:g} s"
            raise InputError("ErrorControl", found, "0 < shortest ≤ touch ≤ longest and pushing")
        if not self.way > 0:
            raise InputError("ErrorControl.way", self.way, "a way > 0 (m)")

    def propose_step(self, at: StepperProgress, travel: Callable[[float], float]) -> float:
        """`touch` after an event, else by the error of the last step; no further than `way`."""
        moved = travel(self.touch) if at.touching else 0.0
        longest = self.longest
        if moved:
            longest = min(self.pushing, longest, self.touch * self.way / abs(moved)) / (LEAVING if moved < 0 else 1)
        return min(self.touch if at.rested else at.dt * (1.0 if at.cut else at.factor), longest)

    def check_step(self, problem: Problem, before: np.ndarray, at: StepperProgress) -> str:
        """Whether the error is over `OVER` times the tolerance."""
        change, overstress = problem.halving(before)
        largest = max(at.largest, overstress)
        error = max(change / largest if largest else 0.0, problem.path_error())
        if error > OVER * self.tolerance:
            return f"an error of {error:.1e} in a step, tolerance {self.tolerance:.1e}"
        at.largest = largest
        allowed = SAFETY * (self.tolerance / error) ** (1 / (ORDER + 1)) if error else GROW
        at.factor = float(np.clip(allowed, SHRINK, GROW))
        return ""

    def halve(self) -> ErrorControl:
        """Steps of about half the length, by their order."""
        return replace(
            self,
            tolerance=self.tolerance / 2 ** (ORDER + 1),
            touch=self.touch / 2,
            longest=self.longest / 2,
            shortest=self.shortest / 2,
            pushing=self.pushing / 2,
            way=self.way / 2,
        )


@dataclass(frozen=True)
class GivenSteps:
    """From each of some increasing times (s) to the next."""

    times: np.ndarray

    @property
    def touch(self) -> float:
        """The shortest of them (s)."""
        return float(np.min(np.diff(self.times)))

    @property
    def shortest(self) -> float:
        """Step (s) below which the run gives up."""
        return self.touch / 64

    def propose_step(self, at: StepperProgress, travel: Callable[[float], float]) -> float:
        """To the next time, which is an event of the load history's."""
        return np.inf

    def check_step(self, problem: Problem, before: np.ndarray, at: StepperProgress) -> str:
        """Nothing: these steps do not look at their error."""
        return ""

    def halve(self) -> GivenSteps:
        """Two for each."""
        middles = (self.times[1:] + self.times[:-1]) / 2
        return GivenSteps(np.sort(np.concatenate([self.times, middles])))
