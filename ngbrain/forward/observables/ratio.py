"""Means: one integral over another."""

from __future__ import annotations

from dataclasses import dataclass

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.contact.rigid import Contact
from ngbrain.forward.observables.base import Observable, Observed
from ngbrain.forward.observables.integrals import Functional
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import Motion, Seen, Terms
from ngbrain.materials.base import Value

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Ratio(Observable):
    """One observable over another, a number each.

    Parameters
    ----------
    numerator, denominator : Observable
        Integrals, or others with a `functional`.
    name, unit : str
        In words; of SI.

    Raises
    ------
    InputError
        When told of a problem, for observables of more numbers than one.

    Examples
    --------
    >>> stretched = Functional(lambda at: ngs.Trace(at.F) / 3 * at.inside(".*"))
    >>> mean = Ratio(stretched, Functional(lambda at: 1.0 * at.inside(".*")), "mean stretch")
    """

    numerator: Observable
    denominator: Observable
    name: str = "ratio"
    unit: str = ""

    def on(self, problem: Problem) -> Quotient:
        """Of one problem."""
        return Quotient(problem, self.numerator.on(problem), self.denominator.on(problem))


def patch_pressure(contact: Contact, patch: Value = 1.0) -> Ratio:
    """Mean pressure (Pa) of a rigid body on a patch of a wall: the normal force there over the patch's current area.

    Parameters
    ----------
    contact : Contact
        One of the problem's.
    patch : float or CoefficientFunction
        1 on the patch and 0 elsewhere, of places at rest; all of the wall by default.
    """

    def force(at: Seen) -> ngs.comp.SumOfIntegrals:
        return at.kinematics.weight() * patch * contact.pressure(at.u, at.offset) * contact.measure()

    def area(at: Seen) -> ngs.comp.SumOfIntegrals:
        # In the plane the area has no component across it.
        return at.kinematics.weight() * patch * ngs.Norm(at.area(at.u, contact.wall)) * contact.measure()

    return Ratio(Functional(force), Functional(area), f"pressure on {contact.wall}", "Pa")


class Quotient(Observed):
    """N/D of one problem. Its functional has the first derivatives of that, where the problem stands when it is weighed."""

    size, twice = 1, False

    def __init__(self, problem: Problem, numerator: Observed, denominator: Observed) -> None:
        super().__init__(problem)
        self._parts = numerator, denominator
        for part in self._parts:
            if part.size != 1:
                raise InputError("Ratio", f"of {part.size} numbers", "observables of one number")
        self.symbolic = numerator.symbolic and denominator.symbolic and numerator.matrix is denominator.matrix is None

    def _slopes(self) -> tuple[float, float]:
        """∂/∂N and ∂/∂D."""
        over, under = (float(part.value()[0]) for part in self._parts)
        return 1 / under, -over / under**2

    def value(self) -> Array:
        """N/D (1,)."""
        over, under = (part.value() for part in self._parts)
        return np.asarray(over / under)

    def gradient(self, weights: Array) -> Array:
        """By the quotient rule."""
        return sum(
            (part.gradient(weights * slope) for part, slope in zip(self._parts, self._slopes(), strict=True)),
            np.zeros(self.problem.fes.ndof),
        )

    def weigh(self, weights: Array) -> None:
        """Set the weights of `functional`."""
        for part, slope in zip(self._parts, self._slopes(), strict=True):
            part.weigh(weights * slope)

    def functional(self, state: Motion, *along: Motion) -> Terms:
        """Of both, weighed by the quotient's slopes."""
        return [term for part in self._parts for term in part.functional(state, *along)]
