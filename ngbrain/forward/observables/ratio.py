"""Ratio of two observables, such as a mean."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.observables.base import Along, Observable, ProblemObservable
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import Motion, Terms

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Ratio(Observable):
    """Ratio of two observables of one component each.

    Parameters
    ----------
    numerator, denominator : Observable
        Integrals, or others with a `functional`.
    name, unit : str
        Name for reports, and SI unit.

    Raises
    ------
    InputError
        When evaluated on a problem, for observables of several components.

    Examples
    --------
    >>> from ngbrain.forward.observables import Functional
    >>> stretched = Functional(lambda at: ngs.Trace(at.F) / 3 * at.dx(".*"))
    >>> mean = Ratio(stretched, Functional(lambda at: 1.0 * at.dx(".*")), "mean stretch")
    """

    numerator: Observable
    denominator: Observable
    name: str = "ratio"
    unit: str = ""

    def on(self, problem: Problem) -> Quotient:
        """Of one problem."""
        return Quotient(problem, self.numerator, self.denominator)


class Quotient(ProblemObservable):
    """Ratio N/D of one problem; its functional has the first derivatives of N/D at the state at which `set_weights` was called.

    Parameters
    ----------
    problem : Problem
    numerator, denominator : Observable
        Of one number each.

    Raises
    ------
    InputError
        For observables of several numbers.
    """

    size = 1

    def __init__(self, problem: Problem, numerator: Observable, denominator: Observable) -> None:
        super().__init__(problem)
        self._made_of = numerator, denominator
        self._parts = [each.on(problem) for each in self._made_of]
        for part in self._parts:
            if part.size != 1:
                raise InputError("Ratio", f"of {part.size} numbers", "observables of one number")
        self.symbolic = all(part.symbolic and part.matrix is None for part in self._parts)
        self.has_second_derivative = self.symbolic and all(
            part.has_second_derivative and not isinstance(part, Quotient) for part in self._parts
        )
        self.has_shape_derivative = all(part.has_shape_derivative for part in self._parts)
        self._weight, self._changes = 1.0, list[Callable[[], float]]()

    def _values(self) -> tuple[float, float]:
        """N and D."""
        over, under = (float(part.value()[0]) for part in self._parts)
        return over, under

    def _slopes(self) -> tuple[float, float]:
        """∂/∂N and ∂/∂D."""
        over, under = self._values()
        return 1 / under, -over / under**2

    def value(self) -> Array:
        """N/D (1,)."""
        over, under = self._values()
        return np.array([over / under])

    def gradient(self, weights: Array) -> Array:
        """By the quotient rule."""
        return sum(
            (part.gradient(weights * slope) for part, slope in zip(self._parts, self._slopes(), strict=True)),
            np.zeros(self.problem.fes.ndof),
        )

    def set_weights(self, weights: Array) -> None:
        """Set the weights of `functional`."""
        self._weight = float(weights[0])
        for part, slope in zip(self._parts, self._slopes(), strict=True):
            part.set_weights(weights * slope)

    def functional(self, state: Motion, *along: Motion) -> Terms:
        """Integrals of N and D, weighted by the derivatives of the quotient."""
        return [term for part in self._parts for term in part.functional(state, *along)]

    @cached_property
    def _others(self) -> list[ProblemObservable]:
        """Second copies of N and D, weighted by the change of the quotient's derivatives."""
        return [each.on(self.problem) for each in self._made_of]

    def set_direction(self, change: Array, along: Along) -> None:
        """Set the direction of second derivatives: the weights of N and D change along it.

        Parameters
        ----------
        change : array (n,)
            Change of the unknowns.
        along : callable
            From integrals to their change with the parameters.
        """
        if not self._changes:
            self._changes = [along(part.functional(self.problem.gfu)) for part in self._others]
        one, moved = np.ones(1), list[float]()
        for part, by_theta in zip(self._others, self._changes, strict=True):
            part.set_weights(one)
            moved.append(float(part.gradient(one) @ change) + by_theta())
        over, under = self._values()
        (of_over, of_under), w = moved, self._weight
        bends = -of_under / under**2, -of_over / under**2 + 2 * over * of_under / under**3
        for part, bend in zip(self._others, bends, strict=True):
            part.set_weights(np.array([w * bend]))

    def weight_change(self, state: Motion, *along: Motion) -> Terms:
        """Integrals of N and D, weighted by the change of the quotient's derivatives."""
        return [term for part in self._others for term in part.functional(state, *along)]
