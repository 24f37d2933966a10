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
"""From a state to a density per reference area."""


@dataclass(frozen=True, eq=False)
class Patch:
    """Part of a wall in contact with a rigid body.

    Parameters
    ----------
    contact : RigidContact
        One of the problem's.
    where : float or CoefficientFunction
        Indicator function of the reference position: 1 on the patch, 0 elsewhere; by default the whole wall.
    name : str
        Name for reports; the wall's by default.
    """

    contact: RigidContact
    where: Value = 1.0
    name: str = ""

    @property
    def wall(self) -> str:
        """Wall of the contact."""
        return self.contact.wall


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


@dataclass(frozen=True, eq=False)
class PatchIntegral(WallIntegral):
    """Integral over patches.

    Parameters
    ----------
    patches : sequence of Patch
        Patches of different walls.
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
        """Direction of one patch; `InputError` for one that is zero or has another dimension than the mesh."""
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
    """Normal contact force (N) on patches, summed over their orientations: ∫ p dA."""

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
    """∫ p d dA (N m) over patches, with contact pressure p and penetration d (m)."""

    unit = "N m"

    @property
    def name(self) -> str:
        """Name for reports."""
        return self._named("penetration work")

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

    `Force`, in contrast, is the total of contacts, supports and loads on a boundary, from the tissue's nodal forces.

    Parameters
    ----------
    direction : sequence of float
        Direction of the component, which is multiplied by its length: one for all patches, or one for each.
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
        return lambda at: patch.where * patch.contact.driving_force(at.u, at.offset)


@dataclass(frozen=True, eq=False)
class PatchDisplacement(PatchIntegral):
    """Mean displacement (m) of patches along a direction, summed over the patches: with one patch on each wall of a cleft, its
    opening.

    Parameters
    ----------
    direction : sequence of float
        A unit vector: one for all patches, or one for each.
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
    """Current area (m²) of patches in contact.

    The sharp area changes in jumps, one quadrature point after the other, and has no gradient. The smoothed one has: each point
    is weighted by the slope of its pressure, from 0 at zero penetration to 1 at the contact's softness.

    Parameters
    ----------
    smoothed : bool
    """

    smoothed: bool = False
    unit = "m²"

    @property
    def name(self) -> str:
        """Name for reports."""
        return self._named("contact area" + (" (smoothed)" if self.smoothed else ""))

    @property
    def discontinuity(self) -> str:  # type: ignore[override]
        """Why it has no gradient."""
        return "" if self.smoothed else "smoothed=True: the sharp area is discontinuous"

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
    """Mean contact pressure (Pa) on patches: total normal force over total current area.

    Parameters
    ----------
    of : RigidContact or sequence of Patch
        One of the problem's contacts, or patches of several.
    where : float or CoefficientFunction
        For a single contact, indicator function of the reference position: 1 on the patch, 0 elsewhere; by default the whole
        wall.
    """
    patches = [Patch(of, where)] if isinstance(of, RigidContact) else of
    return Ratio(NormalForce(patches), CurrentArea(patches), f"pressure on {_words(patches)}", "Pa")


def mean_depth(patches: Sequence[Patch]) -> Ratio:
    """Mean penetration (m), weighted by pressure: ∫ p d / ∫ p; NaN without contact."""
    return Ratio(PenetrationWork(patches), NormalForce(patches), f"mean penetration on {_words(patches)}", "m")


def _words(patches: Sequence[Patch]) -> str:
    return ", ".join(patch.name or patch.wall for patch in patches)
