"""Cost of derivatives and inversions: factorisations, and back-substitutions by purpose."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import asdict, dataclass, fields


@dataclass
class Solves:
    """Counts of linear solves, by purpose.

    For waves these are back-substitutions. For equilibria (`forward.sensitivity`) they are solutions, however many linear solves
    Newton's method or a refinement takes.

    Parameters
    ----------
    factorisations : int
        Factorisations of the matrices of waves, and of optimality systems of waves and fields.
    forward : int
        Forward solves at a θ.
    adjoint : int
        Gradients.
    incremental : int
        Steps, products with J and Jᵀ, second derivatives.
    traces : int
        Random probes that estimate the number of parameters determined by the data.
    checks : int
        Checks of a result: the next resonance, the effect of the bulk modulus, waves of the truth.
    refinements : int
        Iterative refinement by the residual of another solve.

    Examples
    --------
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
        """Total over all purposes."""
        return sum(asdict(self).values()) - self.factorisations

    @classmethod
    def sum(cls, each: Iterable[Solves]) -> Solves:
        """Return the counts of several inversions together."""
        every = [asdict(counts) for counts in each]
        return cls(**{entry.name: sum(counts[entry.name] for counts in every) for entry in fields(cls)})

    def count(self, purpose: str, number: int = 1) -> None:
        """Add back-substitutions.

        Parameters
        ----------
        purpose : str
            A field of this class.
        number : int
        """
        purpose = self._all_for or purpose
        setattr(self, purpose, getattr(self, purpose) + number)

    @contextmanager
    def spent_on(self, purpose: str) -> Iterator[None]:
        """Context in which everything counts for one purpose, refinements included."""
        before, self._all_for = self._all_for, self._all_for or purpose
        try:
            yield
        finally:
            self._all_for = before


def spent_on(model: object, purpose: str) -> AbstractContextManager[None]:
    """`Solves.spent_on` of a model, if it counts its solves.

    Parameters
    ----------
    model : object
        With or without `solves`.
    purpose : str
        A field of `Solves`.

    Returns
    -------
    context manager
    """
    solves = getattr(model, "solves", None)
    return solves.spent_on(purpose) if isinstance(solves, Solves) else nullcontext()
