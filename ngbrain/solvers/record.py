"""What a nonlinear solve did, as plain data."""

from __future__ import annotations

import time
from collections import defaultdict
from dataclasses import dataclass, field
from typing import Any

from ngbrain.look import descent
from ngbrain.result import Result


@dataclass
class SolverWork:
    """Counts of the expensive operations, added up over a run."""

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
    """Outcome of one nonlinear solve.

    `reason` is empty when converged, `status` its kind. `history` has the norms of residual and correction at each iterate, in
    the units of the problem's own scaling; `min_det_F` is the smallest over all quadrature points of the accepted state.
    """

    iterations: int = 0
    min_det_F: float = float("nan")  # noqa: N815
    work: SolverWork = field(default_factory=SolverWork)

    def plot(self) -> Any:
        """Residuals of the iterations."""
        return descent(self.residuals, "residual")

    @property
    def value(self) -> float:
        """The last correction's norm."""
        return self.history[-1][1] if self.history else 0.0

    @property
    def residuals(self) -> list[float]:
        """Norms at each iterate."""
        return [residual for residual, _ in self.history]

    @property
    def statistics(self) -> dict[str, float]:
        """Of the method."""
        return {"iterations": self.iterations, **vars(self.work)}


@dataclass(repr=False)
class PathRecord(Result):
    """Outcome of a solve in load steps.

    factor   load factor that was reached; converged if it is 1, else `reason` says why not, and `status` of what kind it is
    history  (load factor, record) of each step that succeeded
    cuts     steps that failed and were halved: why, at which factor
    tried    Newton iterations of all steps, failed ones too
    seconds  CPU time by phase: assemble, factor, solve, residual, check
    element, solver   what was chosen, and why
    pressed, creased  shares of the body's volume, and of its free surface along itself, compressed by more than 35 %
    softest  the tangent's smallest eigenvalue (Pa/m²), asked for when a share is large; else NaN
    eigenvalues  (load factor, smallest eigenvalue) of each step, where they were asked for
    guard    what was added to the body to get there; empty if nothing was
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
    softest: float = float("nan")
    eigenvalues: list[tuple[float, float]] = field(default_factory=list)
    guard: str = ""

    @property
    def value(self) -> float:
        """The load factor."""
        return self.factor

    @property
    def statistics(self) -> dict[str, float]:
        """Of all steps."""
        return {"load_steps": len(self.history), "cuts": len(self.cuts), "iterations": self.tried, **vars(self.work)}

    def plot(self) -> Any:
        """Residuals of all Newton iterations."""
        return descent(self.residuals, "residual")

    @property
    def min_det_F(self) -> float:  # noqa: N802
        """Smallest det F over all quadrature points of the last state."""
        return self.history[-1][1].min_det_F if self.history else float("nan")

    @property
    def residuals(self) -> list[float]:
        """Norms of the residual at all iterates of the steps that succeeded."""
        return [norm for _, step in self.history for norm in step.residuals]


class Clock:
    """CPU seconds by phase.

    >>> clock = Clock()
    >>> with clock("assemble"):
    ...     pass
    >>> list(clock.seconds)
    ['assemble']
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)

    def __call__(self, phase: str) -> SolveStage:
        """Count what is done inside."""
        return SolveStage(self.seconds, phase)


class SolveStage:
    """One of a `Clock`: a context, made lean, for a run of a small body enters thousands."""

    __slots__ = ("_name", "_seconds", "_start")

    def __init__(self, seconds: dict[str, float], name: str) -> None:
        self._seconds, self._name = seconds, name

    def __enter__(self) -> None:
        self._start = time.process_time()

    def __exit__(self, *_: object) -> None:
        self._seconds[self._name] += time.process_time() - self._start
