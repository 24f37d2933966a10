"""Observables of patches of walls in contact: forces, areas, pressures and displacements."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.contact.rigid import SURFACE_ORDER, RigidContact
from ngbrain.forward.observables.points import along_axis, axis
from ngbrain.forward.observables.ratio import Ratio
from ngbrain.forward.observables.wall import Density, WallIntegral
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import FieldState
from ngbrain.materials.base import Value

Array = np.ndarray


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
