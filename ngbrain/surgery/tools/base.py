"""Rigid retractors described by a signed distance, in the frame of a cleft."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.materials.points import Points
from ngbrain.mesh.geometry.cleft import Cleft

INSIDE = 1e-9
"""Length (m) that keeps the derivative of a norm finite at zero."""
HANDLE = 25e-3
"""Length (m) beyond the brain's surface to which a tool without upper end is drawn."""

SignedDistance = Callable[[CoefficientFunction], CoefficientFunction]
"""x ↦ signed distance (m) from the current position x to a rigid body, negative inside."""


class RigidTool(ABC):
    """A rigid body that pushes the wall towards `cleft.across`.

    Contact, figures, pressure patches and size checks follow from `distance`, `body` and `bounds`.

    Attributes
    ----------
    cleft : Cleft
        The frame of its motion.
    width : float
        Width (m) of the wall over which pressure is evaluated.
    tip : float
        Height (m) of its lower end above the cleft's floor.
    height : float
        Length (m) from there to its upper end; inf where it extends beyond the brain's surface.
    single : bool
        Whether both walls touch the same body.
    """

    cleft: Cleft
    width: float
    tip: float
    height: float = np.inf
    single = False

    @abstractmethod
    def distance(self, advance: CoefficientFunction) -> SignedDistance:
        """Signed distance of the contact surface at an `advance` (m) from first contact; unbounded behind the face."""

    def body(self, advance: CoefficientFunction) -> SignedDistance:
        """Signed distance of the complete tool: 0 on its surface, negative inside."""
        return self.distance(advance)

    @abstractmethod
    def bounds(self, advance: float) -> tuple[np.ndarray, np.ndarray]:
        """Bounding box of the body: smallest and largest (across, along, height) in m."""

    def moves(self, x: CoefficientFunction, advance: CoefficientFunction) -> CoefficientFunction:
        """Displacement of the tool's surface; a translation towards `cleft.across` by default.

        Parameters
        ----------
        x : CoefficientFunction
            Position (m).
        advance : CoefficientFunction
            Advance (m).

        Returns
        -------
        CoefficientFunction
            Vector (m).
        """
        return advance * ngs.CF(tuple(map(float, self.cleft.across)))

    def signed_distance(self, advance: float, at: np.ndarray) -> np.ndarray:
        """Signed distances of points to the complete tool.

        Parameters
        ----------
        advance : float
            Advance (m).
        at : (n, 3) array
            Points as (across, along, height) in m.

        Returns
        -------
        (n,) array
            In m.

        Examples
        --------
        >>> from ngbrain.surgery.tools.blades import Tube
        >>> cleft = Cleft(np.zeros(3), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), 30e-3, 4e-3, 12e-3)
        >>> print(1e3 * Tube(cleft, 4e-3, 1e-3, 4e-3).signed_distance(1e-3, np.array([[0, 7e-3, 15e-3], [0, 0, 2e-3]])))
        [4. 2.]
        """
        cleft = self.cleft
        places = cleft.target + np.asarray(at) @ np.stack([cleft.across, cleft.along, cleft.out])
        points = Points.line(len(places))
        return np.asarray(points(self.body(ngs.CF(advance))(ngs.CF(points.field(places.T))))[0])

    @property
    def top(self) -> float:
        """Height (m) of its upper end above the cleft's floor, as drawn."""
        return min(self.tip + self.height, self.cleft.depth + HANDLE)


def patch(tool: RigidTool, margin: float, height: float | None = None) -> CoefficientFunction:
    """Indicator function of the unloaded wall under a tool.

    Parameters
    ----------
    tool : RigidTool
    margin : float
        Distance (m) to the tool's edges.
    height : float, optional
        Only this length (m) from the tip.

    Returns
    -------
    CoefficientFunction
        1 on the patch, 0 elsewhere.
    """
    _, b, c = coordinates(tool.cleft, ngs.CF((ngs.x, ngs.y, ngs.z)))
    half = tool.width / 2 - margin
    inside = ngs.IfPos(half * half - b * b, 1, 0) * ngs.IfPos(c - tool.tip - margin, 1, 0)
    if np.isfinite(tool.height):
        inside = inside * ngs.IfPos(tool.tip + tool.height - margin - c, 1, 0)
    return inside if height is None else inside * ngs.IfPos(tool.tip + height - c, 1, 0)


def coordinates(cleft: Cleft, x: CoefficientFunction) -> tuple[CoefficientFunction, ...]:
    """Coordinates across and along the cleft and above its floor (m), as fields; `Cleft.coordinates` is the same for numbers.

    Parameters
    ----------
    cleft : Cleft
    x : CoefficientFunction
        Position (m).

    Returns
    -------
    tuple of CoefficientFunction
    """
    target, *axes = (ngs.CF(tuple(map(float, v))) for v in (cleft.target, cleft.across, cleft.along, cleft.out))
    return tuple(ngs.InnerProduct(x - target, axis) for axis in axes)


def rounded_intersection(inward: Sequence[CoefficientFunction], r: float) -> CoefficientFunction:
    """Signed distance to an intersection of bodies with rounded edges.

    Parameters
    ----------
    inward : sequence of CoefficientFunction
        Signed distances (m), increased by the radius.
    r : float
        Radius (m) of the edges.

    Returns
    -------
    CoefficientFunction
    """
    beyond = sum((ngs.IfPos(q, q, 0) ** 2 for q in inward), ngs.CF(INSIDE**2))
    deepest = inward[0]
    for q in inward[1:]:
        deepest = maximum(deepest, q)
    return ngs.sqrt(beyond) + ngs.IfPos(deepest, 0, deepest) - r


def maximum(a: CoefficientFunction, b: CoefficientFunction) -> CoefficientFunction:
    """Pointwise maximum.

    Parameters
    ----------
    a, b : CoefficientFunction

    Returns
    -------
    CoefficientFunction
    """
    return ngs.IfPos(a - b, a, b)
