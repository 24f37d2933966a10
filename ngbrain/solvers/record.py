"""What a nonlinear solve did, as plain data."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Work:
    """Counts of the expensive operations, added up over a run."""

    residuals: int = 0
    factorisations: int = 0
    solves: int = 0

    def __iadd__(self, other: Work) -> Work:
        self.residuals += other.residuals
        self.factorisations += other.factorisations
        self.solves += other.solves
        return self


@dataclass
class NewtonRecord:
    """Outcome of one nonlinear solve.

    `reason` is empty when converged. `residuals` and `corrections` are the norms at each iterate, in the units of
    the problem's own scaling; `min_det_F` is the smallest over all quadrature points of the accepted state.
    """

    converged: bool = False
    reason: str = ""
    iterations: int = 0
    residuals: list[float] = field(default_factory=list)
    corrections: list[float] = field(default_factory=list)
    min_det_F: float = float("nan")  # noqa: N815
    work: Work = field(default_factory=Work)
