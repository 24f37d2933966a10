"""Integrals of the state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np

from ngbrain.forward.observables.base import Observable, SymbolicObservable
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import FieldState, Integrand, Motion, StateView, Terms
from ngbrain.materials.base import Deformation

Array = np.ndarray


class Functional(Observable):
    """Integrals of the state, one component each.

    Parameters
    ----------
    *integrands : callable
        From a `virtual_work.FieldState` (u, F, p, …) to an integral over `dx(region)` or `ds(boundary)`.
    name, unit : str
        Name for reports, and SI unit.

    Examples
    --------
    >>> volume = Functional(lambda at: ngs.Det(at.F) * at.dx(".*"), name="volume", unit="m³")
    """

    def __init__(self, *integrands: Integrand, name: str = "integral", unit: str = "") -> None:
        self.integrands, self._name, self.unit = integrands, name, unit

    @property
    def name(self) -> str:
        """Name for reports."""
        return self._name

    def on(self, problem: Problem) -> ProblemIntegrals:
        """By quadrature."""
        return ProblemIntegrals(problem, self.integrands)


def region_volume(region: str = ".*") -> Functional:
    """Current volume (m³; in plane strain m²) of the regions that match a pattern."""
    return Functional(
        lambda at: at.kinematics.weight() * ngs.Det(at.F) * at.dx(region), name=f"volume of {region}", unit="m³"
    )


@dataclass(frozen=True)
class StrainEnergy(Observable):
    """Elastic strain energy (J).

    Parameters
    ----------
    region : str
        A pattern.

    Raises
    ------
    InputError
        When evaluated on a problem, for viscoelastic tissue, which has no unique free energy.
    """

    region: str = ".*"
    unit = "J"

    @property
    def name(self) -> str:
        """Name for reports."""
        return f"strain energy of {self.region}"

    def on(self, problem: Problem) -> ProblemIntegrals:
        """With the quadrature of the problem's energy."""
        within = problem.mesh.Materials(self.region)

        def stored(at: FieldState) -> ngs.comp.SumOfIntegrals:
            parts = [
                at.kinematics.weight()
                * material.energy(Deformation.from_gradient(at.F), at.p, at.factor)
                * ngs.dx(definedon=problem.mesh.Materials(pattern) * within, intrules=problem.tissue.rules)
                for pattern, material in problem.materials.items()
            ]
            return sum(parts[1:], parts[0])

        return ProblemIntegrals(problem, [stored])


class ProblemIntegrals(SymbolicObservable):
    """Integrals over one problem's mesh.

    Parameters
    ----------
    problem : Problem
    integrands : sequence of callable
        See `Functional`.
    """

    def __init__(self, problem: Problem, integrands: Sequence[Integrand]) -> None:
        super().__init__(problem)
        self._integrands, self.size = integrands, len(integrands)
        self._work = StateView(problem)
        self._weights = [ngs.Parameter(0.0) for _ in integrands]
        self._now = [[term.integral for term in self._work.functional(q, problem.gfu)] for q in integrands]

    def value(self) -> Array:
        """Each."""
        return np.array([sum(ngs.Integrate(part, self.problem.mesh) for part in parts) for parts in self._now])

    def set_weights(self, weights: Array) -> None:
        """Set the weights of `functional`."""
        for weight, value in zip(self._weights, weights, strict=True):
            weight.Set(float(value))

    def functional(self, state: Motion, *along: Motion) -> Terms:
        """Weighted integrals."""
        weighed = zip(self._weights, self._integrands, strict=True)
        return [part.times(weight) for weight, q in weighed for part in self._work.functional(q, state, *along)]
