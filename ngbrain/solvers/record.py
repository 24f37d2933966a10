"""Records of nonlinear solves, as plain data."""

from __future__ import annotations

import time
from collections import defaultdict
from dataclasses import dataclass, field
from typing import Any

from ngbrain.look import descent
from ngbrain.result import Result


@dataclass
class SolverWork:
    """Counts of the expensive operations, added up over a run.

    Parameters
    ----------
    residuals : int
        Residual evaluations.
    factorisations : int
        Factorisations of the tangent.
    solves : int
        Linear solves.
    """

    residuals: int = 0
    factorisations: int = 0
    solves: int = 0

    def __iadd__(self, other: SolverWork) -> SolverWork:
        self.residuals += other.residuals
        self.factorisations += other.factorisations
        self.solves += other.solves
        return self


@dataclass(repr=False)
class NewtonRecord(Result):
    """Outcome of one Newton solve.

    Parameters
    ----------
    status : Status
        How it ended.
    reason : str
        Why it failed; empty if it converged.
    history : list of (float, float)
        Norms of residual and correction at each iterate, in the problem's own scaling.
    iterations : int
        Newton iterations.
    min_det_F : float
        Smallest det F over all quadrature points of the accepted state.
    work : SolverWork
        Operation counts.
    """

    iterations: int = 0
    min_det_F: float = float("nan")  # noqa: N815
    work: SolverWork = field(default_factory=SolverWork)

    def plot(self) -> Any:
        """Plot the residuals of the iterations."""
        return descent(self.residuals, "residual")

    @property
    def value(self) -> float:
        """Norm of the last correction."""
        return self.history[-1][1] if self.history else 0.0

    @property
    def residuals(self) -> list[float]:
        """Residual norm at each iterate."""
        return [residual for residual, _ in self.history]

    @property
    def statistics(self) -> dict[str, float]:
        """Iterations and operation counts."""
        return {"iterations": self.iterations, **vars(self.work)}


@dataclass(repr=False)
class PathRecord(Result):
    """Outcome of a solve in load steps.

    Parameters
    ----------
    status : Status
        How it ended.
    reason : str
        Why it failed; empty if load factor 1 was reached.
    history : list of (float, NewtonRecord)
        Load factor and record of each successful step.
    factor : float
        Load factor that was reached.
    cuts : list of str
        Steps that failed and were halved: load factor and reason.
    tried : int
        Newton iterations of all steps, failed ones included.
    work : SolverWork
        Operation counts.
    seconds : dict of str to float
        CPU time (s) of each stage: assemble, factor, solve, residual, check.
    ndof : int
        Degrees of freedom.
    element, solver : str
        What was chosen, and why.
    pressed, creased : float
        Fractions of the body's volume, and of its free surface, compressed by more than 35 %.
    smallest_eigenvalue : float
        Smallest eigenvalue of the tangent (Pa/m²), computed where one of these is large; else NaN.
    eigenvalues : list of (float, float)
        Load factor and smallest eigenvalue of each step, if requested.
    guard : str
        What was added to the body to reach the end; empty if nothing.
    """

    factor: float = 0.0
    cuts: list[str] = field(default_factory=list)
    tried: int = 0
    work: SolverWork = field(default_factory=SolverWork)
    seconds: dict[str, float] = field(default_factory=dict)
    ndof: int = 0
    element: str = ""
    solver: str = ""
    pressed: float = 0.0
    creased: float = 0.0
    smallest_eigenvalue: float = float("nan")
    eigenvalues: list[tuple[float, float]] = field(default_factory=list)
    guard: str = ""

    @property
    def value(self) -> float:
        """Load factor that was reached."""
        return self.factor

    @property
    def statistics(self) -> dict[str, float]:
        """Counts over all steps."""
        return {"load_steps": len(self.history), "cuts": len(self.cuts), "iterations": self.tried, **vars(self.work)}

    def plot(self) -> Any:
        """Plot the residuals of all Newton iterations."""
        return descent(self.residuals, "residual")

    @property
    def min_det_F(self) -> float:  # noqa: N802
        """Smallest det F over all quadrature points of the last state."""
        return self.history[-1][1].min_det_F if self.history else float("nan")

    @property
    def residuals(self) -> list[float]:
        """Residual norm at all iterates of the successful steps."""
        return [norm for _, step in self.history for norm in step.residuals]


class Clock:
    """CPU time (s) by stage.

    >>> clock = Clock()
    >>> with clock("assemble"):
    ...     pass
    >>> list(clock.seconds)
    ['assemble']
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)

    def __call__(self, phase: str) -> SolveStage:
        """Context that counts the CPU time of its body."""
        return SolveStage(self.seconds, phase)


class SolveStage:
    """Context that adds CPU time to one stage of a `Clock`. It is light-weight, as a run of a small body enters thousands.

    Parameters
    ----------
    seconds : dict of str to float
        Times (s), added to.
    name : str
        The stage.
    """

    __slots__ = ("_name", "_seconds", "_start")

    def __init__(self, seconds: dict[str, float], name: str) -> None:
        self._seconds, self._name = seconds, name

    def __enter__(self) -> None:
        self._start = time.process_time()

    def __exit__(self, *_: object) -> None:
        self._seconds[self._name] += time.process_time() - self._start
