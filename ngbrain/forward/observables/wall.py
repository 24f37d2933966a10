"""Observables of walls in contact: forces, areas, pressures and displacements of patches, in one pass over each wall."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.contact.rigid import RULES, SURFACE_ORDER, RigidContact
from ngbrain.forward.observables.base import Observable, SymbolicObservable
from ngbrain.forward.observables.points import along_axis, axis
from ngbrain.forward.observables.ratio import Ratio
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import FieldState, Motion, StateView, Terms
from ngbrain.materials.base import Value

Array = np.ndarray
Density: TypeAlias = Callable[[FieldState], ngs.CoefficientFunction]
"""Of a state, per area at rest."""


@dataclass(frozen=True, eq=False)
class Patch:
    """A part of a wall that a rigid body presses.

    Parameters
    ----------
    contact : RigidContact
        One of the problem's.
    where : float or CoefficientFunction
        1 on the patch and 0 elsewhere, of places at rest; all of the wall by default.
    name : str
        Name for reports; the wall's by default.
    """

    contact: RigidContact
    where: Value = 1.0
    name: str = ""

    @property
    def wall(self) -> str:
        """The contact's."""
        return self.contact.wall


class WallIntegral(Observable):
    """A number that is an integral over walls, by the quadrature of their contacts; `WallPass` evaluates many at once.

    A user's own has `name`, `unit` and `densities`.

    Attributes
    ----------
    jumps : str
        Reason why it has no gradient; empty where it has one.
    """

    jumps = ""

    @abstractmethod
    def densities(self, problem: Problem) -> Mapping[str, Density]:
        """Wall → what is integrated over it."""

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
        self.symbolic = not asked.jumps
        self._view, self._weight = StateView(problem), ngs.Parameter(0.0)
        self._pass = WallPass(problem, [asked])

    def value(self) -> Array:
        """The sum over the walls (1,)."""
        return self._pass()

    def gradient(self, weights: Array) -> Array:
        """By symbolic differentiation; `InputError` for a discontinuous observable."""
        if self._asked.jumps:
            raise InputError(type(self._asked).__name__, "asked for its gradient", self._asked.jumps)
        return super().gradient(weights)

    def weigh(self, weights: Array) -> None:
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
    """The integral over a wall, of a state or its derivative."""
    return view.functional(
        lambda at: at.kinematics.weight() * density(at) * ngs.ds(wall, intrules=RULES), state, *along
    )


class WallPass:
    """Values of several observables of walls, of one problem, with one pass over each wall for all of them.

    Parameters
    ----------
    problem : Problem
    asked : sequence of WallIntegral or Ratio
        Ratios are of two wall integrals; over nothing they count as 0.

    Raises
    ------
    InputError
        For what is no integral over walls, nor a ratio of two.

    Examples
    --------
    >>> from ngbrain.forward.common.material import Material
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
        """Where the problem stands, a number each."""
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


@dataclass(frozen=True, eq=False)
class PatchIntegral(WallIntegral):
    """Integral over patches.

    Parameters
    ----------
    patches : sequence of Patch
        Of different walls.
    """

    patches: Sequence[Patch]

    def __post_init__(self) -> None:
        walls = self.walls
        if not walls or len(set(walls)) < len(walls):
            raise InputError(f"{type(self).__name__}.patches", f"on {walls}", "one or more, each on a wall of its own")

    @property
    def walls(self) -> list[str]:
        """Of the patches."""
        return [patch.wall for patch in self.patches]

    def _named(self, what: str) -> str:
        return f"{what} on {_words(self.patches)}"

    @staticmethod
    def _along(direction: Sequence[float] | Sequence[Sequence[float]]) -> str:
        return along_axis(np.ravel(direction).tolist()) if np.ndim(direction) == 1 else ""

    def _direction(
        self, given: Sequence[float] | Sequence[Sequence[float]], problem: Problem, patch: Patch
    ) -> ngs.CoefficientFunction:
        """That of one patch; `InputError` for one that is zero or does not fit the mesh."""
        own = given if np.ndim(given) == 1 else given[self.walls.index(patch.wall)]
        return ngs.CF(tuple(axis(np.ravel(own).tolist(), problem.mesh.dim).tolist()))

    def densities(self, problem: Problem) -> Mapping[str, Density]:
        """One for each wall."""
        return {patch.wall: self.density(problem, patch) for patch in self.patches}

    @abstractmethod
    def density(self, problem: Problem, patch: Patch) -> Density:
        """Density per reference area.

        Parameters
        ----------
        problem : Problem
        patch : Patch

        Returns
        -------
        callable
            From a `FieldState` to a CoefficientFunction.
        """


class NormalForce(PatchIntegral):
    """Normal force (N) of rigid bodies on patches, whatever its direction: ∫ p dA."""

    unit = "N"

    @property
    def name(self) -> str:
        """Name for reports."""
        return self._named("normal force")

    def density(self, problem: Problem, patch: Patch) -> Density:
        """The contact pressure (Pa).

        Parameters
        ----------
        problem : Problem
        patch : Patch
        """
        return lambda at: patch.where * patch.contact.pressure(at.u, at.offset)


class CurrentArea(PatchIntegral):
    """Current area (m²) of patches."""

    unit = "m²"

    @property
    def name(self) -> str:
        """Name for reports."""
        return self._named("current area")

    def density(self, problem: Problem, patch: Patch) -> Density:
        """Area ratio |cof F N|.

        Parameters
        ----------
        problem : Problem
        patch : Patch
        """
        return lambda at: patch.where * at.area_ratio(at.u)


class PenetrationWork(PatchIntegral):
    """∫ p d dA (N m) over patches, of the depth d (m) that tissue is inside a rigid body where it presses."""

    unit = "N m"

    @property
    def name(self) -> str:
        """Name for reports."""
        return self._named("work of the depth")

    def density(self, problem: Problem, patch: Patch) -> Density:
        """Pressure times penetration (N/m).

        Parameters
        ----------
        problem : Problem
        patch : Patch
        """
        return lambda at: patch.where * patch.contact.pressure(at.u, at.offset) * -patch.contact.gap(at.u)


@dataclass(frozen=True, eq=False)
class ContactForce(PatchIntegral):
    """Force (N) that rigid bodies exert on patches along a direction, without friction; the mean over the patches.

    `Force` is what contacts, supports and loads exert on a boundary together, read off the tissue's own forces there.

    Parameters
    ----------
    direction : sequence of float
        The component along it, times its length; of all patches, or one of each.
    """

    direction: Sequence[float] | Sequence[Sequence[float]] = (0.0, 0.0, 1.0)
    unit = "N"

    @property
    def name(self) -> str:
        """Name for reports."""
        return self._named("contact force") + self._along(self.direction)

    def density(self, problem: Problem, patch: Patch) -> Density:
        """Pressure times the derivative of the distance along the direction (Pa).

        Parameters
        ----------
        problem : Problem
        patch : Patch

        Returns
        -------
        callable
        """
        along = self._direction(self.direction, problem, patch) / len(self.patches)

        def pushed(at: FieldState) -> ngs.CoefficientFunction:
            x = (ngs.CF((ngs.x, ngs.y, ngs.z)[: problem.mesh.dim]) + at.u).MakeVariable()
            slope = patch.contact.distance(x).Diff(x)
            return patch.where * patch.contact.pressure(at.u, at.offset) * ngs.InnerProduct(slope, along)

        return pushed


class DrivingForce(PatchIntegral):
    """Driving force (N) of rigid bodies: derivative of the contact energy with respect to their travel."""

    unit = "N"

    @property
    def name(self) -> str:
        """Name for reports."""
        return self._named("driving force")

    def density(self, problem: Problem, patch: Patch) -> Density:
        """Derivative of the contact energy with respect to the travel.

        Parameters
        ----------
        problem : Problem
        patch : Patch

        Returns
        -------
        callable
        """
        return lambda at: patch.where * patch.contact.driving(at.u, at.offset)


@dataclass(frozen=True, eq=False)
class PatchDisplacement(PatchIntegral):
    """Mean displacement (m) of patches along a direction, summed over them: what their walls open a cleft by.

    Parameters
    ----------
    direction : sequence of float
        A unit vector, of all patches or one of each.
    """

    direction: Sequence[float] | Sequence[Sequence[float]] = (0.0, 0.0, 1.0)
    unit = "m"

    @property
    def name(self) -> str:
        """Name for reports."""
        return self._named("mean displacement") + self._along(self.direction)

    def density(self, problem: Problem, patch: Patch) -> Density:
        """Displacement along the direction over the patch's area.

        Parameters
        ----------
        problem : Problem
        patch : Patch

        Returns
        -------
        callable
        """
        along = self._direction(self.direction, problem, patch)
        boundary, weight = problem.mesh.Boundaries(patch.wall), problem.kinematics.weight()
        size = ngs.Integrate(weight * patch.where, problem.mesh, definedon=boundary, order=SURFACE_ORDER)
        return lambda at: patch.where * ngs.InnerProduct(at.u, along) / size


@dataclass(frozen=True, eq=False)
class ContactArea(PatchIntegral):
    """Current area (m²) of patches in touch.

    A point is in touch or it is not: the area under quadrature points jumps, and has no gradient. Smoothed, points count by the
    slope of their pressure, from nothing at no depth to all at the contact's softness; that has one.

    Parameters
    ----------
    smoothed : bool
    """

    smoothed: bool = False
    unit = "m²"

    @property
    def name(self) -> str:
        """Name for reports."""
        return self._named("area in touch" + (" (smoothed)" if self.smoothed else ""))

    @property
    def jumps(self) -> str:  # type: ignore[override]
        """Why it has no gradient."""
        return "" if self.smoothed else "smoothed=True: a point is in touch or it is not"

    def density(self, problem: Problem, patch: Patch) -> Density:
        """Area ratio where the pressure is positive, or its smoothed form.

        Parameters
        ----------
        problem : Problem
        patch : Patch

        Returns
        -------
        callable
        """
        contact = patch.contact

        def sharp(at: FieldState) -> ngs.CoefficientFunction:
            return patch.where * ngs.IfPos(contact.pressure(at.u, at.offset), at.area_ratio(at.u), 0)

        def soft(at: FieldState) -> ngs.CoefficientFunction:
            depth = (at.offset - contact.gap(at.u)) / contact.softness
            return patch.where * ngs.IfPos(depth, ngs.IfPos(depth - 1, 1, depth), 0) * at.area_ratio(at.u)

        return soft if self.smoothed else sharp


def patch_pressure(of: RigidContact | Sequence[Patch], where: Value = 1.0) -> Ratio:
    """Mean pressure (Pa) of rigid bodies on patches: the normal force on all of them over their current area.

    Parameters
    ----------
    of : RigidContact or sequence of Patch
        One of the problem's contacts, or patches of several.
    where : float or CoefficientFunction
        Of one contact: 1 on the patch and 0 elsewhere, of places at rest; all of the wall by default.
    """
    patches = [Patch(of, where)] if isinstance(of, RigidContact) else of
    return Ratio(NormalForce(patches), CurrentArea(patches), f"pressure on {_words(patches)}", "Pa")


def mean_depth(patches: Sequence[Patch]) -> Ratio:
    """How far (m) tissue is inside rigid bodies where it presses, in the mean ∫ p d / ∫ p; not a number where nothing does."""
    return Ratio(PenetrationWork(patches), NormalForce(patches), f"depth in what presses {_words(patches)}", "m")


def _words(patches: Sequence[Patch]) -> str:
    return ", ".join(patch.name or patch.wall for patch in patches)
