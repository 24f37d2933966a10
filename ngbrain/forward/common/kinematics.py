"""Kinematics: from a displacement to the 3×3 deformation gradient, in space, plane strain, anti-plane shear or axisymmetric."""

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
    """Three-dimensional solid."""

    dim = 3

    def gradient(self, u: CoefficientFunction, grad: CoefficientFunction) -> CoefficientFunction:
        """Deformation gradient F.

        Parameters
        ----------
        u : CoefficientFunction
            Displacement (m).
        grad : CoefficientFunction
            Its gradient; on a boundary the tangential one.

        Returns
        -------
        CoefficientFunction (3, 3)
        """
        return ngs.Id(3) + grad

    def change(self, v: CoefficientFunction, grad: CoefficientFunction) -> CoefficientFunction:
        """Derivative of F in the direction of a displacement.

        Parameters
        ----------
        v, grad : CoefficientFunction
            Displacement (m) and its gradient.

        Returns
        -------
        CoefficientFunction (3, 3)
        """
        return grad

    def weight(self) -> CoefficientFunction | float:
        """Integration weight: volume in space per volume (or area) of the mesh."""
        return 1.0

    def position(self, u: CoefficientFunction) -> CoefficientFunction:
        """Current position x = X + u in the mesh's coordinates."""
        return ngs.CF((ngs.x, ngs.y, ngs.z)[: self.dim]) + u


@dataclass(frozen=True)
class PlaneStrain(SolidKinematics):
    """Plane strain of unit thickness (1 m): forces are per metre."""

    dim = 2

    def gradient(self, u: CoefficientFunction, grad: CoefficientFunction) -> CoefficientFunction:
        """F with F₃₃ = 1.

        Parameters
        ----------
        u, grad : CoefficientFunction
            Displacement (m) and its gradient.

        Returns
        -------
        CoefficientFunction (3, 3)
        """
        return _plane(grad, 0.0)

    def change(self, v: CoefficientFunction, grad: CoefficientFunction) -> CoefficientFunction:
        """Derivative of F in the direction of a displacement.

        Parameters
        ----------
        v, grad : CoefficientFunction
            Displacement (m) and its gradient.

        Returns
        -------
        CoefficientFunction (3, 3)
        """
        return _in_plane(grad, 0.0)


@dataclass(frozen=True)
class Axisymmetric(SolidKinematics):
    """Body of revolution: a mesh in the half plane (r, z) = (x, y), x ≥ 0, rotated about the y axis."""

    dim = 2

    def gradient(self, u: CoefficientFunction, grad: CoefficientFunction) -> CoefficientFunction:
        """F with F₃₃ = 1 + u_r/r, the circumferential stretch.

        Parameters
        ----------
        u, grad : CoefficientFunction
            Displacement (m) and its gradient.

        Returns
        -------
        CoefficientFunction (3, 3)
        """
        return _plane(grad, _around(u, grad))

    def change(self, v: CoefficientFunction, grad: CoefficientFunction) -> CoefficientFunction:
        """Derivative of F in the direction of a displacement.

        Parameters
        ----------
        v, grad : CoefficientFunction
            Displacement (m) and its gradient.

        Returns
        -------
        CoefficientFunction (3, 3)
        """
        return _in_plane(grad, _around(v, grad))

    def weight(self) -> CoefficientFunction:
        """2πr."""
        return 2 * pi * ngs.x


@dataclass(frozen=True)
class AntiPlane(SolidKinematics):
    """Anti-plane shear of unit thickness (1 m): the displacement is one number, along z.

    Volume does not change, so neither bulk modulus nor pressure matters: with `Shearing`, W = G/2 |∇u|².
    """

    dim = 2

    def gradient(self, u: CoefficientFunction, grad: CoefficientFunction) -> CoefficientFunction:
        """F with F₃₁ = ∂u/∂x and F₃₂ = ∂u/∂y.

        Parameters
        ----------
        u, grad : CoefficientFunction
            Displacement (m) and its gradient.

        Returns
        -------
        CoefficientFunction (3, 3)
        """
        return tensor(1, 0, 0, 0, 1, 0, grad[0], grad[1], 1)

    def position(self, u: CoefficientFunction) -> CoefficientFunction:
        """The in-plane position, which does not change."""
        return ngs.CF((ngs.x, ngs.y))


def _around(u: CoefficientFunction, grad: CoefficientFunction) -> CoefficientFunction:
    """u_r/r; on the axis, where some rules of quadrature have points, its limit ∂u_r/∂r."""
    return ngs.IfPos(ngs.x - AXIS, u[0] / ngs.x, grad[0, 0])


def _in_plane(grad: CoefficientFunction, third: CoefficientFunction | float) -> CoefficientFunction:
    return tensor(grad[0, 0], grad[0, 1], 0, grad[1, 0], grad[1, 1], 0, 0, 0, third)


def _plane(grad: CoefficientFunction, third: CoefficientFunction | float) -> CoefficientFunction:
    return tensor(1 + grad[0, 0], grad[0, 1], 0, grad[1, 0], 1 + grad[1, 1], 0, 0, 0, 1 + third)


def kinematics_of(mesh: ngs.Mesh, asked: SolidKinematics | None) -> SolidKinematics:
    """Kinematics of a mesh: the given ones, or by default a solid in space and plane strain in the plane.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    asked : SolidKinematics, optional

    Returns
    -------
    SolidKinematics

    Raises
    ------
    InputError
        For kinematics of another dimension than the mesh.
    """
    found = asked or (SolidKinematics() if mesh.dim == 3 else PlaneStrain())
    if found.dim != mesh.dim:
        raise InputError("mesh", f"{mesh.dim}-dimensional", f"{found.dim} dimensions for {type(found).__name__}")
    return found
