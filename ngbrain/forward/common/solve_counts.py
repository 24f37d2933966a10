"""What derivatives and inversions take: factorisations, and back-substitutions by what they are for."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import asdict, dataclass


@dataclass
class Solves:
    """What was done. Of waves it is counted where it is done: all back-substitutions are their sum by purpose.

    factorisations  of waves' matrices, and of the optimality conditions of waves and fields
    forward         waves of a θ
    adjoint         gradients
    incremental     steps, products with J and Jᵀ, second derivatives
    traces          probes that tell how many numbers the data determine
    checks          of what was found: the next resonance, the bulk modulus' effect, waves of the truth
    refinements     by the residual that one of the others has left

    Of equilibria (`forward.implicit`) solutions are counted, whatever Newton's method or a refinement takes for one.

    >>> solves = Solves()
    >>> solves.count("forward", 2)
    >>> with solves.spent_on("traces"):
    ...     solves.count("incremental")
    >>> str(solves), solves.back_substitutions
    ('2 forward, 1 traces', 3)
    """

    factorisations: int = 0
    forward: int = 0
    adjoint: int = 0
    incremental: int = 0
    traces: int = 0
    checks: int = 0
    refinements: int = 0

    def __post_init__(self) -> None:
        self._all_for: str | None = None

    def __str__(self) -> str:
        return ", ".join(f"{number} {name}" for name, number in asdict(self).items() if number) or "nothing"

    @property
    def back_substitutions(self) -> int:
        """For all purposes."""
        return sum(asdict(self).values()) - self.factorisations

    def count(self, purpose: str, number: int = 1) -> None:
        """So many more back-substitutions."""
        purpose = self._all_for or purpose
        setattr(self, purpose, getattr(self, purpose) + number)

    @contextmanager
    def spent_on(self, purpose: str) -> Iterator[None]:
        """What is counted inside is for this purpose, refinements too."""
        before, self._all_for = self._all_for, self._all_for or purpose
        try:
            yield
        finally:
            self._all_for = before


def spent_on(model: object, purpose: str) -> AbstractContextManager[None]:
    """`Solves.spent_on` of a model, if it counts its solves."""
    solves = getattr(model, "solves", None)
    return solves.spent_on(purpose) if isinstance(solves, Solves) else nullcontext()
