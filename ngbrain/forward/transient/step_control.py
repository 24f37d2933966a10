"""Time-step control: steps prescribed by the motion, or chosen by an error estimate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.solid.problem import Problem
from ngbrain.look import BriefText
from ngbrain.solvers.record import SolverWork

ORDER = 2
"""Order of accuracy of the internal variables."""
SAFETY, SHRINK, GROW = 0.9, 0.3, 4.0
"""Error control: safety factor, and smallest and largest ratio of successive steps."""
LEAVING = 2
"""Ratio of steps on advance to those on withdrawal."""
OVER = 2.0
"""Error, in tolerances, above which a step is repeated."""


@dataclass
class StepperProgress:
    """Progress of a run: what a checkpoint holds besides the problem's own arrays.

    Parameters
    ----------
    t, dt : float
        Time and last step length (s).
    event : int
        Index of the next event.
    touching, rested, cut : bool
        Whether rigid bodies are in contact, an event was just reached, and the last step was shortened.
    steps, rejected, newton : int
        Accepted and rejected steps, Newton iterations.
    factor : float
        Growth allowed for the next step under error control.
    largest : float
        Largest overstress so far (Pa, rms over quadrature points).
    work : SolverWork
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
    """Time-step controller of a `TimeStepper`."""

    @property
    def touch(self) -> float:
        """First step (s) after first contact."""

    @property
    def shortest(self) -> float:
        """Step (s) below which the run fails."""

    def propose_step(self, at: StepperProgress, travel: Callable[[float], float]) -> float:
        """Length of the next step.

        Parameters
        ----------
        at : StepperProgress
        travel : callable
            Time ahead (s) → travel of the rigid bodies (m).

        Returns
        -------
        float
            In seconds.
        """

    def check_step(self, problem: Problem, before: np.ndarray, at: StepperProgress) -> str:
        """Check a completed step; an estimate of its error is stored in `at`.

        Parameters
        ----------
        problem : Problem
            At the end of the step.
        before : array (n,)
            Unknowns at its start.
        at : StepperProgress

        Returns
        -------
        str
            Reason for rejection; empty if the step is accepted.
        """

    def halve(self) -> Control:
        """Steps of about half the length, for measuring what the step length costs in accuracy."""


@dataclass(frozen=True)
class StepControl:
    """Steps prescribed by the motion; a step that fails is shortened.

    Parameters
    ----------
    contact_dt : float
        Longest step (s) while a body moves in contact.
    first : float
        First step after first contact, as a fraction of contact_dt; it grows by `touch_growth` per step.
    restart : float
        First step when a body at rest in contact moves again, as a fraction of contact_dt.
    touch_growth, release_growth : float
        Growth per step while a body in contact advances, and while it withdraws.
    growth : float
        Growth per step while the tool rests.
    dt_max : float
        Longest step (s) there.
    smallest : float
        Fraction of contact_dt below which the run fails.
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
        """First step (s) after first contact."""
        return self.contact_dt * self.first

    @property
    def shortest(self) -> float:
        """Step (s) below which the run fails."""
        return self.contact_dt * self.smallest

    def propose_step(self, at: StepperProgress, travel: Callable[[float], float]) -> float:
        """Short steps after first contact, uniform ones on advance, growing ones at rest.

        Parameters
        ----------
        at : StepperProgress
        travel : callable
            Time ahead (s) → travel (m).

        Returns
        -------
        float
            In seconds.
        """
        moved = travel(self.contact_dt)
        if at.touching and moved:
            start = self.contact_dt * self.restart
            growth = self.touch_growth if moved > 0 else self.release_growth
            longest = self.contact_dt if moved > 0 else self.contact_dt / LEAVING
        else:
            start, growth, longest = self.contact_dt, self.growth, self.dt_max
        return start if at.rested else min(at.dt * (1.0 if at.cut else growth), longest)

    def check_step(self, problem: Problem, before: np.ndarray, at: StepperProgress) -> str:
        """Always accepted: these steps have no error estimate.

        Parameters
        ----------
        problem : Problem
        before : array (n,)
        at : StepperProgress

        Returns
        -------
        str
        """
        return ""

    def halve(self) -> StepControl:
        """The same steps at half the length."""
        return replace(self, contact_dt=self.contact_dt / 2, dt_max=self.dt_max / 2)


@dataclass(frozen=True)
class ErrorControl:
    """Steps as long as their estimated error allows, from milliseconds to the length of a hold.

    The internal variables are integrated with second order, so a step's error grows with the third power of its length: the next
    step is 0.9 (tolerance/error)^⅓ times as long. Curvature of the path is not estimated; after first contact steps grow from
    `touch` again.

    Parameters
    ----------
    tolerance : float
        Relative error of a step: rms over quadrature points of the difference of its overstress from that of two half steps
        along the same straight path, over the largest rms overstress so far; with `Inertia` also the largest displacement error
        over its `amplitude`.
    touch : float
        First step (s) after first contact, and after each event.
    longest, shortest : float
        Longest step (s), and the one below which the run fails.
    pushing, max_travel : float
        Longest step (s) and largest travel (m) in a step while a body moves in contact; half of both on withdrawal, as the work
        of the step in which it loses contact is inaccurate.

    Raises
    ------
    InputError
        Unless 0 < tolerance < 1 and 0 < shortest ≤ touch ≤ longest and pushing.

    References
    ----------
    Hairer, Nørsett, Wanner 1993, 10.1007/978-3-540-78862-1, II.4 (error per step, factors).

    Examples
    --------
    >>> ErrorControl(1e-3, touch=0.05).halve().tolerance
    0.000125
    """

    tolerance: float
    touch: float
    longest: float = np.inf
    shortest: float = 1e-4
    pushing: float = np.inf
    max_travel: float = np.inf

    def __post_init__(self) -> None:
        if not 0 < self.tolerance < 1:
            raise InputError("ErrorControl.tolerance", self.tolerance, "a relative error between 0 and 1")
        if not 0 < self.shortest <= self.touch <= min(self.longest, self.pushing):
            found = f"shortest {self.shortest:g}, touch {self.touch:g}, longest {self.longest:g}, pushing {self.pushing:g} s"
            raise InputError("ErrorControl", found, "0 < shortest ≤ touch ≤ longest and pushing")
        if not self.max_travel > 0:
            raise InputError("ErrorControl.max_travel", self.max_travel, "a travel > 0 (m)")

    def propose_step(self, at: StepperProgress, travel: Callable[[float], float]) -> float:
        """`touch` after an event, else by the error of the last step; at most `max_travel`.

        Parameters
        ----------
        at : StepperProgress
        travel : callable
            Time ahead (s) → travel (m).

        Returns
        -------
        float
            In seconds.
        """
        moved = travel(self.touch) if at.touching else 0.0
        longest = self.longest
        if moved:
            longest = min(self.pushing, longest, self.touch * self.max_travel / abs(moved)) / (
                LEAVING if moved < 0 else 1
            )
        return min(self.touch if at.rested else at.dt * (1.0 if at.cut else at.factor), longest)

    def check_step(self, problem: Problem, before: np.ndarray, at: StepperProgress) -> str:
        """Rejected if the error exceeds `OVER` times the tolerance.

        Parameters
        ----------
        problem : Problem
        before : array (n,)
        at : StepperProgress

        Returns
        -------
        str
        """
        change, overstress = problem.half_step_error(before)
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
            max_travel=self.max_travel / 2,
        )


@dataclass(frozen=True, repr=False)
class PrescribedSteps(BriefText):
    """Steps between prescribed increasing times (s)."""

    times: np.ndarray

    @property
    def touch(self) -> float:
        """Shortest step (s)."""
        return float(np.min(np.diff(self.times)))

    @property
    def shortest(self) -> float:
        """Step (s) below which the run fails."""
        return self.touch / 64

    def propose_step(self, at: StepperProgress, travel: Callable[[float], float]) -> float:
        """Step to the next time, an event of the load history.

        Parameters
        ----------
        at : StepperProgress
        travel : callable

        Returns
        -------
        float
        """
        return np.inf

    def check_step(self, problem: Problem, before: np.ndarray, at: StepperProgress) -> str:
        """Always accepted: these steps have no error estimate.

        Parameters
        ----------
        problem : Problem
        before : array (n,)
        at : StepperProgress

        Returns
        -------
        str
        """
        return ""

    def halve(self) -> PrescribedSteps:
        """Two steps for each."""
        middles = (self.times[1:] + self.times[:-1]) / 2
        return PrescribedSteps(np.sort(np.concatenate([self.times, middles])))
