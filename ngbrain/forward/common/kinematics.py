"""How a displacement of the mesh is a deformation in space: solids, plane strain, anti-plane shear, bodies of revolution."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import ngsolve as ngs
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.tensors import tensor

AXIS = 1e-12
"""Distance (m) up to which a point is on the axis."""


@dataclass(frozen=True)
class SolidKinematics:
    """A mesh in space."""

    dim = 3

    def gradient(self, u: CoefficientFunction, grad: CoefficientFunction) -> CoefficientFunction:
        """F, 3×3, of a displacement and its gradient (on a boundary, the tangential one)."""
        return ngs.Id(3) + grad

    def change(self, v: CoefficientFunction, grad: CoefficientFunction) -> CoefficientFunction:
        """How F changes with a displacement, 3×3."""
        return grad

    def weight(self) -> CoefficientFunction | float:
        """Volume in space for a volume of the mesh, and area for an area."""
        return 1.0

    def position(self, u: CoefficientFunction) -> CoefficientFunction:
        """x = X + u in the mesh's coordinates."""
        return ngs.CF((ngs.x, ngs.y, ngs.z)[: self.dim]) + u


@dataclass(frozen=True)
class PlaneStrain(SolidKinematics):
    """A mesh in the plane, a metre thick, that stays as thick: forces are per metre."""

    dim = 2

    def gradient(self, u: CoefficientFunction, grad: CoefficientFunction) -> CoefficientFunction:
        """F with F₃₃ = 1."""
        return _plane(grad, 0.0)

    def change(self, v: CoefficientFunction, grad: CoefficientFunction) -> CoefficientFunction:
        """How F changes with a displacement."""
        return _in_plane(grad, 0.0)


@dataclass(frozen=True)
class Axisymmetric(SolidKinematics):
    """A mesh in the half plane (r, z) = (x, y), x ≥ 0, that is turned around the y axis."""

    dim = 2

    def gradient(self, u: CoefficientFunction, grad: CoefficientFunction) -> CoefficientFunction:
        """F with F₃₃ = 1 + u_r/r, the stretch of circles."""
        return _plane(grad, _around(u, grad))

    def change(self, v: CoefficientFunction, grad: CoefficientFunction) -> CoefficientFunction:
        """How F changes with a displacement."""
        return _in_plane(grad, _around(v, grad))

    def weight(self) -> CoefficientFunction:
        """2πr."""
        return 2 * pi * ngs.x


@dataclass(frozen=True)
class AntiPlane(SolidKinematics):
    """A mesh in the plane, a metre thick, whose displacement is one number: motion along z, through the plane.

    Volume does not change, so that neither bulk modulus nor pressure matters: of `Shearing`, W = G/2 |∇u|².
    """

    dim = 2

    def gradient(self, u: CoefficientFunction, grad: CoefficientFunction) -> CoefficientFunction:
        """F with F₃₁ = ∂u/∂x and F₃₂ = ∂u/∂y."""
        return tensor(1, 0, 0, 0, 1, 0, grad[0], grad[1], 1)

    def position(self, u: CoefficientFunction) -> CoefficientFunction:
        """In the mesh's coordinates nothing moves."""
        return ngs.CF((ngs.x, ngs.y))


def _around(u: CoefficientFunction, grad: CoefficientFunction) -> CoefficientFunction:
    """u_r/r; on the axis, where some rules of quadrature have points, its limit ∂u_r/∂r."""
    return ngs.IfPos(ngs.x - AXIS, u[0] / ngs.x, grad[0, 0])


def _in_plane(grad: CoefficientFunction, third: CoefficientFunction | float) -> CoefficientFunction:
    return tensor(grad[0, 0], grad[0, 1], 0, grad[1, 0], grad[1, 1], 0, 0, 0, third)


def _plane(grad: CoefficientFunction, third: CoefficientFunction | float) -> CoefficientFunction:
    return tensor(1 + grad[0, 0], grad[0, 1], 0, grad[1, 0], 1 + grad[1, 1], 0, 0, 0, 1 + third)


def kinematics_of(mesh: ngs.Mesh, asked: SolidKinematics | None) -> SolidKinematics:
    """What was asked for if the mesh fits it; unasked a solid in space and plane strain in the plane."""
    found = asked or (SolidKinematics() if mesh.dim == 3 else PlaneStrain())
    if found.dim != mesh.dim:
        raise InputError("mesh", f"{mesh.dim}-dimensional", f"{found.dim} dimensions for {type(found).__name__}")
    return found
