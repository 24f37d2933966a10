"""Integrals over walls in contact, evaluated in one pass over each wall."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.contact.rigid import RULES, SURFACE_ORDER
from ngbrain.forward.observables.base import Observable, SymbolicObservable
from ngbrain.forward.observables.ratio import Ratio
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import FieldState, Motion, StateView, Terms

Array = np.ndarray
Density: TypeAlias = Callable[[FieldState], ngs.CoefficientFunction]
"""From a state to a density per reference area."""


class WallIntegral(Observable):
    """Integral over walls, by the quadrature of their contacts; `WallPass` evaluates many at once.

    A user-defined one has `name`, `unit` and `densities`.

    Attributes
    ----------
    jumps : str
        Reason why it has no gradient; empty where it has one.
    """

    discontinuity = ""

    @abstractmethod
    def densities(self, problem: Problem) -> Mapping[str, Density]:
        """Wall → density that is integrated over it."""

    def on(self, problem: Problem) -> ProblemWallIntegral:
        """By quadrature of order 8."""
        return ProblemWallIntegral(problem, self)


class ProblemWallIntegral(SymbolicObservable):
    """A `WallIntegral` of one problem.

    Parameters
    ----------
    problem : Problem
    asked : WallIntegral
    """

    size = 1

    def __init__(self, problem: Problem, asked: WallIntegral) -> None:
        super().__init__(problem)
        self._asked, self._densities = asked, asked.densities(problem)
        self.symbolic = not asked.discontinuity
        self._view, self._weight = StateView(problem), ngs.Parameter(0.0)
        self._pass = WallPass(problem, [asked])

    def value(self) -> Array:
        """The sum over the walls (1,)."""
        return self._pass()

    def gradient(self, weights: Array) -> Array:
        """By symbolic differentiation; `InputError` for a discontinuous observable."""
        if self._asked.discontinuity:
            raise InputError(type(self._asked).__name__, "asked for its gradient", self._asked.discontinuity)
        return super().gradient(weights)

    def set_weights(self, weights: Array) -> None:
        """Set the weight of `functional`."""
        self._weight.Set(float(weights[0]))

    def functional(self, state: Motion, *along: Motion) -> Terms:
        """Weighted integrals."""
        return [
            term.times(self._weight)
            for wall, density in self._densities.items()
            for term in _on(self._view, wall, density, state, *along)
        ]


def _on(view: StateView, wall: str, density: Density, state: Motion, *along: Motion) -> Terms:
    """Integral over a wall at a state, or its derivative."""
    return view.functional(
        lambda at: at.kinematics.weight() * density(at) * ngs.ds(wall, intrules=RULES), state, *along
    )


class WallPass:
    """Values of several wall observables of one problem, in one pass over each wall.

    Parameters
    ----------
    problem : Problem
    asked : sequence of WallIntegral or Ratio
        Ratios are of two wall integrals; with a denominator of 0 they count as 0.

    Raises
    ------
    InputError
        For an observable that is neither an integral over walls nor a ratio of two.

    Examples
    --------
    >>> from ngbrain.forward.common.material import Material
    >>> from ngbrain.forward.contact.rigid import RigidContact
    >>> from ngbrain.forward.observables.patches import CurrentArea, NormalForce, Patch
    >>> from ngbrain.materials import NeoHooke
    >>> from ngbrain.mesh import block
    >>> plate = RigidContact("top", lambda x: 0.0199 - x[2], 1e6, 1e-9)
    >>> cube = Problem(block((0.02,) * 3, 0.02), {".*": Material(NeoHooke(1e3), 1e4)}, {"bottom": 0}, contacts=[plate])
    >>> seen = WallPass(cube, [NormalForce([Patch(plate)]), CurrentArea([Patch(plate)])])
    >>> [f"{value:.3g}" for value in seen()]  # 1e-4 m deep at 1e6 Pa/m on 4 cm²
    ['0.04', '0.0004']
    """

    def __init__(self, problem: Problem, asked: Sequence[Observable]) -> None:
        self.mesh, integrals = problem.mesh, dict[WallIntegral, int]()
        self._places = [[integrals.setdefault(part, len(integrals)) for part in _parts(each)] for each in asked]
        densities = [each.densities(problem) for each in integrals]
        view = StateView(problem)
        self._walls: list[tuple[ngs.Region, ngs.CoefficientFunction, Array]] = []
        for wall in dict.fromkeys(wall for each in densities for wall in each):
            mine = [i for i, each in enumerate(densities) if wall in each]
            terms = [_on(view, wall, densities[i][wall], problem.gfu) for i in mine]
            values = ngs.CF(tuple(term.coef for (term,) in terms)).Compile()
            self._walls.append((self.mesh.Boundaries(wall), values, np.array(mine)))
        self._size = len(integrals)

    def __call__(self) -> Array:
        """Values at the current state of the problem."""
        sums = np.zeros(self._size)
        for wall, values, mine in self._walls:
            sums[mine] += np.ravel(ngs.Integrate(values, self.mesh, definedon=wall, order=SURFACE_ORDER))
        return np.array([_over_each_other(*sums[places].tolist()) for places in self._places])


def _parts(asked: Observable) -> Sequence[WallIntegral]:
    parts = (asked.numerator, asked.denominator) if isinstance(asked, Ratio) else (asked,)
    found = [part for part in parts if isinstance(part, WallIntegral)]
    if len(found) < len(parts):
        raise InputError("WallPass", asked.name, "an integral over walls, or a ratio of two")
    return found


def _over_each_other(value: float, under: float = 1.0) -> float:
    return value / under if under else 0.0
