"""What a retractor is to the wall that it pushes: a rigid body with a signed distance, in the frame of a cleft."""

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
"""How far (m) beyond the brain's surface a tool is drawn that goes on there."""

SignedDistance = Callable[[CoefficientFunction], CoefficientFunction]
"""x ↦ signed distance (m) to a rigid body at the current position x, negative inside."""


class RigidTool(ABC):
    """A rigid body that pushes the wall towards `cleft.across`.

    Contact, pictures, patches of pressure and checks of its size follow from `distance`, `body` and `bounds`.

    Attributes
    ----------
    cleft : Cleft
        The frame it moves in.
    width : float
        Of the wall (m) over which pressure is read.
    tip : float
        Height (m) of its lower end above the cleft's floor.
    height : float
        From there to its upper end (m); inf where it goes on beyond the brain's surface.
    single : bool
        Whether it is the same body that both walls see.
    """

    cleft: Cleft
    width: float
    tip: float
    height: float = np.inf
    single = False

    @abstractmethod
    def distance(self, advance: CoefficientFunction) -> SignedDistance:
        """Its signed distance when it has gone `advance` (m) from where it touches the unloaded wall, without an end behind."""

    def body(self, advance: CoefficientFunction) -> SignedDistance:
        """The same of the tool as it is: 0 on its surface, negative inside."""
        return self.distance(advance)

    @abstractmethod
    def bounds(self, advance: float) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest (across, along, height) in m of the body."""

    def moves(self, x: CoefficientFunction, advance: CoefficientFunction) -> CoefficientFunction:
        """How far its surface at x has gone (m), a vector; as one towards `cleft.across`."""
        return advance * ngs.CF(tuple(map(float, self.cleft.across)))

    def signed_distance(self, advance: float, at: np.ndarray) -> np.ndarray:
        """Signed distances (n,) m of points given as (across, along, height), (n, 3) in m, to the tool as it is.

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
        """Height (m) of its upper end above the cleft's floor, as it is drawn."""
        return min(self.tip + self.height, self.cleft.depth + HANDLE)


def patch(tool: RigidTool, margin: float, height: float | None = None) -> CoefficientFunction:
    """1 on the unloaded wall under a tool, `margin` (m) inside its edges; `height` keeps only that much from the tip."""
    _, b, c = coordinates(tool.cleft, ngs.CF((ngs.x, ngs.y, ngs.z)))
    half = tool.width / 2 - margin
    inside = ngs.IfPos(half * half - b * b, 1, 0) * ngs.IfPos(c - tool.tip - margin, 1, 0)
    if np.isfinite(tool.height):
        inside = inside * ngs.IfPos(tool.tip + tool.height - margin - c, 1, 0)
    return inside if height is None else inside * ngs.IfPos(tool.tip + height - c, 1, 0)


def coordinates(cleft: Cleft, x: CoefficientFunction) -> tuple[CoefficientFunction, ...]:
    """Across and along the cleft and up from its floor (m), as `Cleft.coordinates` of numbers."""
    target, *axes = (ngs.CF(tuple(map(float, v))) for v in (cleft.target, cleft.across, cleft.along, cleft.out))
    return tuple(ngs.InnerProduct(x - target, axis) for axis in axes)


def rounded_intersection(inward: Sequence[CoefficientFunction], r: float) -> CoefficientFunction:
    """Signed distance (m) to where several others are at most r, with edges of radius r where they meet."""
    beyond = sum((ngs.IfPos(q, q, 0) ** 2 for q in inward), ngs.CF(INSIDE**2))
    deepest = inward[0]
    for q in inward[1:]:
        deepest = maximum(deepest, q)
    return ngs.sqrt(beyond) + ngs.IfPos(deepest, 0, deepest) - r


def maximum(a: CoefficientFunction, b: CoefficientFunction) -> CoefficientFunction:
    """The larger of two."""
    return ngs.IfPos(a - b, a, b)
