"""What acts on a body: each load says its part of the energy, or, where it has none, of the virtual work.

All loads but springs grow with the load factor t from 0 to 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import ngsolve as ngs
from ngsolve import CoefficientFunction

from ngbrain.forward.common.boundaries import check_closed, outward
from ngbrain.forward.common.kinematics import SolidKinematics
from ngbrain.forward.common.penalty import soft_penalty
from ngbrain.materials.base import Value
from ngbrain.tensors import tensor

Vector: TypeAlias = tuple[Value, ...] | CoefficientFunction
Terms: TypeAlias = ngs.comp.SumOfIntegrals

TOUCHING = 1e-12
"""Distance (m) up to which a face touches: at rest its stiffness counts."""
BONUS = 2
"""Orders of quadrature on a boundary beyond twice the displacements' order: follower loads are products of many factors."""


@dataclass(frozen=True)
class Place:
    """Where loads act: the mesh, how it deforms, the load factor t, trial and test displacement, and their order.

    One rule of quadrature serves forces, tangents and derivatives by parameters, whatever these are made of.
    """

    mesh: ngs.Mesh
    kinematics: SolidKinematics
    factor: ngs.Parameter
    u: CoefficientFunction
    v: CoefficientFunction | None
    order: int = 2

    def ds(self, boundary: str) -> ngs.comp.DifferentialSymbol:
        """Reference area."""
        shapes = (ngs.SEGM,) if self.mesh.dim == 2 else (ngs.TRIG, ngs.QUAD)
        return ngs.ds(boundary, intrules=_rules(shapes, 2 * self.order + BONUS))

    def dx(self, region: str) -> ngs.comp.DifferentialSymbol:
        """Reference volume."""
        shapes = (ngs.TRIG, ngs.QUAD) if self.mesh.dim == 2 else (ngs.TET, ngs.HEX, ngs.PRISM, ngs.PYRAMID)
        return ngs.dx(definedon=self.mesh.Materials(region), intrules=_rules(shapes, 2 * self.order))

    def gradient(self, u: CoefficientFunction) -> CoefficientFunction:
        """Gradient of a displacement along a boundary."""
        return ngs.Grad(u).Trace()

    def area(self, u: CoefficientFunction, boundary: str) -> CoefficientFunction:
        """cof F N, in the mesh's dimensions: current outward normal times current over reference area."""
        return self._area(u, outward(self.mesh, boundary))

    def area_ratio(self, u: CoefficientFunction) -> CoefficientFunction:
        """|cof F N|: current over reference area, of whatever boundary it is integrated over."""
        return ngs.Norm(self._area(u, ngs.specialcf.normal(self.mesh.dim)))

    def _area(self, u: CoefficientFunction, normal: CoefficientFunction) -> CoefficientFunction:
        F = self.kinematics.gradient(u, self.gradient(u))
        if self.mesh.dim == 3:
            # The cofactor's normal column holds tangential derivatives only, which is all that a boundary knows.
            return ngs.Cof(F) * normal
        flat = ngs.CF((F[0, 0], F[0, 1], F[1, 0], F[1, 1]), dims=(2, 2))
        return F[2, 2] * ngs.Cof(flat) * normal


@dataclass(frozen=True)
class TractionLoad:
    """A dead load: a force (Pa, per reference area) that keeps its direction; -∫ t·u dA."""

    boundary: str
    value: Vector

    def energy(self, at: Place) -> Terms:
        """Its potential (J)."""
        return -at.factor * at.kinematics.weight() * ngs.InnerProduct(_vector(self.value), at.u) * at.ds(self.boundary)


@dataclass(frozen=True)
class Weight:
    """A force per reference volume (N/m³), such as ρg; -∫ f·u dV."""

    value: Vector
    region: str = ".*"

    def energy(self, at: Place) -> Terms:
        """Its potential (J)."""
        work = at.factor * at.kinematics.weight() * ngs.InnerProduct(_vector(self.value), at.u)
        return -work * at.dx(self.region)


@dataclass(frozen=True)
class RigidFace:
    """A rigid face that a boundary lies against at rest, and that pushes it by `by` (m): ∫ k/2 ⟨t|by| - u·n⟩² dA, n along `by`.

    ⟨x⟩ is x where it is positive, else 0: the boundary slides along the face without friction, and parts from it where it would
    have to be pulled. The face is as deep in the body as its pressure over k (Pa/m).
    """

    boundary: str
    by: tuple[float, ...]
    stiffness: float

    def energy(self, at: Place) -> Terms:
        """What overlaps (J)."""
        far = math.hypot(*self.by)
        way = ngs.CF(tuple(component / far for component in self.by))
        deep = at.factor * far - ngs.InnerProduct(way, at.u)
        stored = ngs.IfPos(deep + TOUCHING, self.stiffness / 2 * deep**2, 0.0)
        return at.kinematics.weight() * stored * at.ds(self.boundary)


@dataclass(frozen=True)
class RigidBody:
    """A rigid body of any shape that a boundary meets without friction, such as an indenter; ∫ ψ(-φ(X + u; t)) dA.

    ψ is that of `common.penalty`: the pressure on the reference area is k d²/(2s) up to a depth d = s, k (d - s/2) beyond, and
    none where there is a gap.

    distance   x, t ↦ φ(x; t), signed distance (m) from the body to a point, negative inside, when the load factor is t
    stiffness  k (Pa/m): the boundary is as deep in the body as its pressure over k
    softness   s (m)

    >>> ball = RigidBody("top", lambda x, t: ngs.Norm(x - ngs.CF((0, 0, 0.11 - 0.001 * t))) - 0.01, 1e8, 1e-5)
    """

    boundary: str
    distance: Callable[[CoefficientFunction, ngs.Parameter], CoefficientFunction]
    stiffness: Value
    softness: float

    def energy(self, at: Place) -> Terms:
        """What overlaps (J)."""
        depth = -self.distance(at.kinematics.position(at.u), at.factor)
        return at.kinematics.weight() * soft_penalty(depth, self.stiffness, self.softness) * at.ds(self.boundary)


@dataclass(frozen=True)
class Spring:
    """Springs (Pa/m) that hold a boundary where it was, or at `to` (m) from there, as a plate does that it sticks to.

    ∫ k/2 |u - to|² dA
    """

    boundary: str
    stiffness: Value
    to: Vector | None = None

    def energy(self, at: Place) -> Terms:
        """What they store (J)."""
        stretch = at.u if self.to is None else at.u - _vector(self.to)
        stored = self.stiffness / 2 * ngs.InnerProduct(stretch, stretch)
        return at.kinematics.weight() * stored * at.ds(self.boundary)


@dataclass(frozen=True)
class PressureLoad:
    """A follower load: a pressure (Pa) on the current area of any boundary; virtual work -∫ P n·δu da.

    It has an energy only where the boundary's rim is held (or encloses a volume, see `CavityPressure`), so the tangent is
    not symmetric.
    """

    boundary: str
    value: Value

    def work(self, at: Place) -> Terms:
        """Its part of the residual, internal less external virtual work (J)."""
        pushed = ngs.InnerProduct(at.area(at.u, self.boundary), at.v)
        return at.factor * at.kinematics.weight() * self.value * pushed * at.ds(self.boundary)


@dataclass(frozen=True)
class CavityPressure:
    """A pressure (Pa) in a cavity, which a boundary encloses alone or with the planes x = 0, y = 0, z = 0; -P V."""

    boundary: str
    value: Value

    def energy(self, at: Place) -> Terms:
        """-P V (J), V the enclosed volume."""
        return -at.factor * self.value * enclosed_volume_density(at, at.u, self.boundary) * at.ds(self.boundary)


@dataclass(frozen=True)
class CavityVolume:
    """A cavity whose volume grows by `change` (m³, as far as the mesh goes); its pressure P is one more unknown.

    Energy -P (V - V₀ - t change): a limit point of the pressure is none of the volume.
    """

    boundary: str
    change: Value

    def energy(self, at: Place, pressure: CoefficientFunction) -> Terms:
        """Of u and the pressure (J)."""
        area = ngs.Integrate(ngs.CF(1) * at.ds(self.boundary), at.mesh)
        wanted = (volume(at, None, self.boundary) + at.factor * self.change) / area
        return -pressure * (enclosed_volume_density(at, at.u, self.boundary) - wanted) * at.ds(self.boundary)


class Own(Protocol):
    """One of a user's, or of another module's."""

    def energy(self, at: Place) -> Terms:
        """Its part of the energy (J)."""


Stored: TypeAlias = TractionLoad | Weight | RigidFace | RigidBody | Spring | CavityPressure | Own
"""Loads with an energy of the displacement."""
Load: TypeAlias = Stored | PressureLoad | CavityVolume


def enclosed_volume_density(at: Place, u: CoefficientFunction, boundary: str) -> CoefficientFunction:
    """Density on a cavity's wall whose integral is the volume between it and the origin: -x·n da/3, in the plane area."""
    check_closed(at.mesh, boundary)
    dims = 2 if at.mesh.dim == 2 and at.kinematics.weight() == 1.0 else 3
    x = at.kinematics.position(u)
    return -at.kinematics.weight() * ngs.InnerProduct(x, at.area(u, boundary)) / dims


def volume(at: Place, gfu: ngs.GridFunction | None, boundary: str) -> float:
    """Volume (m³; in plane strain m²) that a boundary encloses now, or at rest."""
    u = gfu or ngs.GridFunction(ngs.VectorH1(at.mesh, order=1))
    return float(ngs.Integrate(enclosed_volume_density(at, u, boundary) * at.ds(boundary), at.mesh))


def _rules(shapes: tuple[ngs.ET, ...], order: int) -> dict[ngs.ET, ngs.IntegrationRule]:
    return {shape: ngs.IntegrationRule(shape, order) for shape in shapes}


def _vector(value: Vector) -> CoefficientFunction:
    return value if isinstance(value, CoefficientFunction) else tensor(*value)
