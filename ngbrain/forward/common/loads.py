"""Loads: each contributes an energy or, where it has none, virtual work.

All loads but springs are proportional to the load factor t, from 0 to 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import ngsolve as ngs
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.forward.common.boundaries import check_closed, outward, surface_normal
from ngbrain.forward.common.kinematics import SolidKinematics
from ngbrain.forward.common.penalty import soft_penalty
from ngbrain.materials.base import Value
from ngbrain.tensors import tensor

Vector: TypeAlias = tuple[Value, ...] | CoefficientFunction
Terms: TypeAlias = ngs.comp.SumOfIntegrals

TOUCHING = 1e-12
"""Gap (m) up to which a face is in contact, so that its stiffness is active in the reference configuration."""
BONUS = 2
"""Orders of quadrature on a boundary beyond twice the displacements' order: follower loads are products of many factors."""


@dataclass(frozen=True)
class LoadContext:
    """Context in which a load is evaluated: mesh, kinematics, load factor, trial and test displacement.

    The same quadrature serves forces, tangents and derivatives with respect to parameters.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    kinematics : SolidKinematics
    factor : ngsolve.Parameter
        Load factor t.
    u : CoefficientFunction
        Displacement (m).
    v : CoefficientFunction, optional
        Test function.
    order : int
        Order of the displacements.
    """

    mesh: ngs.Mesh
    kinematics: SolidKinematics
    factor: ngs.Parameter
    u: CoefficientFunction
    v: CoefficientFunction | None
    order: int = 2

    def ds(self, boundary: str, bonus: int = BONUS) -> ngs.comp.DifferentialSymbol:
        """Surface measure of the reference configuration on a boundary.

        Parameters
        ----------
        boundary : str
            Name or pattern.
        bonus : int
            Orders of quadrature beyond twice that of the displacements.

        Returns
        -------
        DifferentialSymbol
        """
        shapes = (ngs.SEGM,) if self.mesh.dim == 2 else (ngs.TRIG, ngs.QUAD)
        return ngs.ds(boundary, intrules=_rules(shapes, 2 * self.order + bonus))

    def dx(self, region: str) -> ngs.comp.DifferentialSymbol:
        """Volume measure of the reference configuration in a region."""
        shapes = (ngs.TRIG, ngs.QUAD) if self.mesh.dim == 2 else (ngs.TET, ngs.HEX, ngs.PRISM, ngs.PYRAMID)
        return ngs.dx(definedon=self.mesh.Materials(region), intrules=_rules(shapes, 2 * self.order))

    def gradient(self, u: CoefficientFunction) -> CoefficientFunction:
        """Tangential gradient of a displacement on a boundary."""
        return ngs.Grad(u).Trace()

    def area(self, u: CoefficientFunction, boundary: str) -> CoefficientFunction:
        """Nanson's formula cof F N, in the mesh's dimensions: outward normal times current over reference area.

        Parameters
        ----------
        u : CoefficientFunction
            Displacement (m).
        boundary : str
            Name or pattern.

        Returns
        -------
        CoefficientFunction (dim,)
        """
        return self._area(u, outward(self.mesh, boundary))

    def surface_area(self, u: CoefficientFunction) -> CoefficientFunction:
        """As `area`, of the body's whole surface; 0 on interfaces between its regions."""
        return self._area(u, surface_normal(self.mesh))

    def area_ratio(self, u: CoefficientFunction) -> CoefficientFunction:
        """Current over reference area |cof F N|, on any boundary."""
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
    """Dead traction: a force per reference area with fixed direction; potential -∫ t·u dA.

    Parameters
    ----------
    boundary : str
        Name or pattern.
    value : vector
        Traction t (Pa).
    """

    boundary: str
    value: Vector

    def energy(self, at: LoadContext) -> Terms:
        """Potential (J)."""
        return -at.factor * at.kinematics.weight() * ngs.InnerProduct(_vector(self.value), at.u) * at.ds(self.boundary)


@dataclass(frozen=True)
class BodyForce:
    """Body force per reference volume, such as gravity ρg; potential -∫ f·u dV.

    Parameters
    ----------
    value : vector
        Force density f (N/m³).
    region : str
        Name or pattern.
    """

    value: Vector
    region: str = ".*"

    def energy(self, at: LoadContext) -> Terms:
        """Potential (J)."""
        work = at.factor * at.kinematics.weight() * ngs.InnerProduct(_vector(self.value), at.u)
        return -work * at.dx(self.region)


@dataclass(frozen=True)
class FluidPressure:
    """Pressure of a fluid at rest around a body, P = ρ_f |g| d at a depth d; potential ∫ P dv over the body's current volume.

    As P = div A with A = ρ_f d² g/2, that is ∫ A·n da over its surface. The variation is the pressure's work ∫ P n·δu da, so that
    a body is lifted by the weight of the fluid that it displaces. With a level there is no pressure above it; without one the
    fluid fills a closed space, and only the differences of its pressure matter. The fluid also reaches between a body and its
    supports: reactions do not contain its pressure there. The potential follows the surface and its tangent is symmetric, which
    that of `PressureLoad` is not.

    Parameters
    ----------
    weight : vector
        ρ_f g (N/m³), of the fluid: two or three components, as of the mesh.
    level : float, Parameter or CoefficientFunction
        Height (m) of its surface, the coordinate opposite to g: z where g points along -z.
    drained : bool
        Whether there is no fluid above the level.
    density : float, Parameter or CoefficientFunction
        Factor of the weight, such as a density (kg/m³) where `weight` is g.

    Raises
    ------
    InputError
        A weight that is 0 or not finite.

    Examples
    --------
    A cube on the bottom of a basin presses on it with its weight less that of the water which it displaces:

    >>> from ngbrain.forward import LoadPath, Material, Problem
    >>> from ngbrain.materials import NeoHooke
    >>> from ngbrain.mesh import block
    >>> loads = [BodyForce((0, 0, -1040 * 9.81)), FluidPressure((0, 0, -1000 * 9.81), 0.2)]
    >>> body = Problem(block((0.1,) * 3, 0.1), {".*": Material(NeoHooke(1e3), 1e9)}, {"bottom": 0}, loads, element="P2/P1")
    >>> _ = LoadPath(body).solve()
    >>> round(float(body.force("bottom")[2]), 2)  # 40 kg/m³ × 9.81 m/s² × 1 l
    0.39
    """

    weight: tuple[float, ...]
    level: Value
    drained: bool = True
    density: Value = 1.0

    def __post_init__(self) -> None:
        if not 0 < math.hypot(*self.weight) < math.inf:
            raise InputError("FluidPressure.weight", repr(self.weight), "a vector ρg in N/m³, not 0")

    def energy(self, at: LoadContext) -> Terms:
        """Potential (J)."""
        heavy = math.hypot(*self.weight)
        down = ngs.CF(tuple(component / heavy for component in self.weight))
        deep = self.level + ngs.InnerProduct(down, at.kinematics.position(at.u))
        wet = ngs.IfPos(deep, deep, 0.0) if self.drained else deep
        along = ngs.InnerProduct(down, at.surface_area(at.u))
        stored = at.factor * at.kinematics.weight() * self.density * (heavy / 2) * wet * wet * along
        return stored * at.ds(".*", 2 * at.order - 2)  # exact for affine elements: 2 of P², 2 of n da


@dataclass(frozen=True)
class RigidFace:
    """Rigid plane face, in contact with a boundary at rest, that pushes it: ∫ k/2 ⟨t|by| - u·n⟩² dA, n along `by`.

    ⟨x⟩ = max(x, 0): frictionless, unilateral contact. The penetration is the pressure over k.

    Parameters
    ----------
    boundary : str
        Name or pattern.
    by : tuple of float
        Displacement of the face at load factor 1 (m).
    stiffness : float
        Penalty k (Pa/m).
    """

    boundary: str
    by: tuple[float, ...]
    stiffness: float

    def energy(self, at: LoadContext) -> Terms:
        """Penalty energy (J)."""
        far = math.hypot(*self.by)
        way = ngs.CF(tuple(component / far for component in self.by))
        deep = at.factor * far - ngs.InnerProduct(way, at.u)
        stored = ngs.IfPos(deep + TOUCHING, self.stiffness / 2 * deep**2, 0.0)
        return at.kinematics.weight() * stored * at.ds(self.boundary)


@dataclass(frozen=True)
class RigidBody:
    """Frictionless rigid body of any shape, such as an indenter; penalty energy ∫ ψ(-φ(X + u; t)) dA.

    ψ is that of `common.penalty`: the pressure on the reference area is k d²/(2s) up to a depth d = s, k (d - s/2) beyond, and
    zero where there is a gap.

    Parameters
    ----------
    boundary : str
        Name or pattern.
    distance : callable
        x, t ↦ φ(x; t): signed distance (m) from the body to a point at load factor t, negative inside.
    stiffness : float or Parameter
        Penalty k (Pa/m).
    softness : float
        Depth s (m) up to which the penalty is regularised.

    Examples
    --------
    >>> ball = RigidBody("top", lambda x, t: ngs.Norm(x - ngs.CF((0, 0, 0.11 - 0.001 * t))) - 0.01, 1e8, 1e-5)
    """

    boundary: str
    distance: Callable[[CoefficientFunction, ngs.Parameter], CoefficientFunction]
    stiffness: Value
    softness: float

    def energy(self, at: LoadContext) -> Terms:
        """Penalty energy (J)."""
        depth = -self.distance(at.kinematics.position(at.u), at.factor)
        return at.kinematics.weight() * soft_penalty(depth, self.stiffness, self.softness) * at.ds(self.boundary)


@dataclass(frozen=True)
class Spring:
    """Elastic foundation: springs between a boundary and its reference position, or a displaced one; energy ∫ k/2 |u - to|² dA.

    Parameters
    ----------
    boundary : str
        Name or pattern.
    stiffness : float, Parameter or CoefficientFunction
        k (Pa/m).
    to : vector, optional
        Displacement of the foundation (m), such as that of a bonded plate.
    """

    boundary: str
    stiffness: Value
    to: Vector | None = None

    def energy(self, at: LoadContext) -> Terms:
        """Stored energy (J)."""
        stretch = at.u if self.to is None else at.u - _vector(self.to)
        stored = self.stiffness / 2 * ngs.InnerProduct(stretch, stretch)
        return at.kinematics.weight() * stored * at.ds(self.boundary)


@dataclass(frozen=True)
class PressureLoad:
    """Follower pressure on the current area of a boundary; virtual work -∫ P n·δu da.

    It has an energy only where the boundary's rim is constrained (or encloses a volume, see `CavityPressure`), so that the
    tangent is not symmetric.

    Parameters
    ----------
    boundary : str
        Name or pattern.
    value : float, Parameter or CoefficientFunction
        P (Pa).
    """

    boundary: str
    value: Value

    def work(self, at: LoadContext) -> Terms:
        """Contribution to the residual, internal less external virtual work (J)."""
        pushed = ngs.InnerProduct(at.area(at.u, self.boundary), at.v)
        return at.factor * at.kinematics.weight() * self.value * pushed * at.ds(self.boundary)


@dataclass(frozen=True)
class CavityPressure:
    """Pressure in a cavity that a boundary encloses, alone or with the planes x = 0, y = 0, z = 0; potential -P V.

    Parameters
    ----------
    boundary : str
        Name or pattern.
    value : float, Parameter or CoefficientFunction
        P (Pa).
    """

    boundary: str
    value: Value

    def energy(self, at: LoadContext) -> Terms:
        """-P V (J), V the enclosed volume."""
        return -at.factor * self.value * enclosed_volume_density(at, at.u, self.boundary) * at.ds(self.boundary)


@dataclass(frozen=True)
class CavityVolume:
    """Prescribed change of a cavity's volume; the cavity's pressure P is an additional unknown.

    Energy -P (V - V₀ - t change): a limit point under prescribed pressure is a regular point under prescribed volume.

    Parameters
    ----------
    boundary : str
        Name or pattern.
    change : float or Parameter
        Volume change at load factor 1 (m³, of the part that is meshed).
    """

    boundary: str
    change: Value

    def energy(self, at: LoadContext, pressure: CoefficientFunction) -> Terms:
        """Energy (J) of displacement and cavity pressure.

        Parameters
        ----------
        at : LoadContext
        pressure : CoefficientFunction
            P (Pa).

        Returns
        -------
        SumOfIntegrals
        """
        area = ngs.Integrate(ngs.CF(1) * at.ds(self.boundary), at.mesh)
        wanted = (volume(at, None, self.boundary) + at.factor * self.change) / area
        return -pressure * (enclosed_volume_density(at, at.u, self.boundary) - wanted) * at.ds(self.boundary)


class CustomLoad(Protocol):
    """User-defined load with an energy."""

    def energy(self, at: LoadContext) -> Terms:
        """Energy (J)."""


EnergyLoad: TypeAlias = (
    TractionLoad | BodyForce | FluidPressure | RigidFace | RigidBody | Spring | CavityPressure | CustomLoad
)
"""Loads with an energy of the displacement."""
Load: TypeAlias = EnergyLoad | PressureLoad | CavityVolume


def enclosed_volume_density(at: LoadContext, u: CoefficientFunction, boundary: str) -> CoefficientFunction:
    """Density on a cavity's wall whose integral is the volume between the wall and the origin: -x·n da/3, in the plane area.

    Parameters
    ----------
    at : LoadContext
    u : CoefficientFunction
        Displacement (m).
    boundary : str
        Name or pattern.

    Returns
    -------
    CoefficientFunction
    """
    check_closed(at.mesh, boundary)
    dims = 2 if at.mesh.dim == 2 and at.kinematics.weight() == 1.0 else 3
    x = at.kinematics.position(u)
    return -at.kinematics.weight() * ngs.InnerProduct(x, at.area(u, boundary)) / dims


def volume(at: LoadContext, gfu: ngs.GridFunction | None, boundary: str) -> float:
    """Volume that a boundary encloses.

    Parameters
    ----------
    at : LoadContext
    gfu : GridFunction, optional
        Displacement (m); None: at rest.
    boundary : str
        Name or pattern.

    Returns
    -------
    float
        m³; in plane strain m².
    """
    u = gfu or ngs.GridFunction(ngs.VectorH1(at.mesh, order=1))
    return float(ngs.Integrate(enclosed_volume_density(at, u, boundary) * at.ds(boundary), at.mesh))


def _rules(shapes: tuple[ngs.ET, ...], order: int) -> dict[ngs.ET, ngs.IntegrationRule]:
    return {shape: ngs.IntegrationRule(shape, order) for shape in shapes}


def _vector(value: Vector) -> CoefficientFunction:
    return value if isinstance(value, CoefficientFunction) else tensor(*value)
