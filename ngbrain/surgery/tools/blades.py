"""Tools with an analytic signed distance: spatulas and plates, tubes, balls."""

from __future__ import annotations

from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.mesh.geometry.cleft import Cleft
from ngbrain.surgery.tools.base import INSIDE, RigidTool, SignedDistance, coordinates, maximum, rounded_intersection


@dataclass(frozen=True)
class Spatula(RigidTool):
    """A blade with rounded edges that moves towards `cleft.across`.

    The contact surface extends behind the face, so that tissue cannot penetrate it.

    Parameters
    ----------
    cleft : Cleft
    width : float
        Width (m) along the walls, at the surface.
    edge_radius : float
        Radius (m) of its side edges and tip.
    tip : float
        Height (m) of the tip above the cleft's floor.
    thickness : float
        Front to back (m), for figures and for the space in the cleft: contact uses the front face only.
    tip_width : float, optional
        Width (m) at its tip, increasing linearly to the surface; None: as wide as at the surface.
    bend : float
        Radius (m) of its face, which is convex towards the tissue at mid height of the wall; inf: flat.
    height : float
        Length (m) from the tip to its rounded upper edge (a plate); inf: it extends beyond the surface.

    Examples
    --------
    >>> cleft = Cleft(np.zeros(3), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), 30e-3, 4e-3, 12e-3)
    >>> low, high = Spatula(cleft, 10e-3, 1e-3, 4e-3, 2e-3).bounds(1e-3)
    >>> print(1e3 * high)
    [ 3.  5. 55.]
    """

    cleft: Cleft
    width: float
    edge_radius: float
    tip: float
    thickness: float
    tip_width: float | None = None
    bend: float = np.inf
    height: float = np.inf

    def distance(self, advance: CoefficientFunction) -> SignedDistance:
        """x ↦ signed distance (m) to {across ≤ face, |along| ≤ half the width, height ≥ tip} with rounded edges."""
        r, face = self.edge_radius, self.cleft.opening / 2 + advance

        def signed_distance(x: CoefficientFunction) -> CoefficientFunction:
            a, b, c = coordinates(self.cleft, x)
            inward = [self._before(a - face, c) + r, self._beside(b, c) + r, self.tip + r - c]
            if np.isfinite(self.height):
                inward.append(c - self.tip - self.height + r)
            return rounded_intersection(inward, r)

        return signed_distance

    def body(self, advance: CoefficientFunction) -> SignedDistance:
        """With its thickness, up to the height that is drawn."""
        front, face = self.distance(advance), self.cleft.opening / 2 + advance

        def signed_distance(x: CoefficientFunction) -> CoefficientFunction:
            a, _, c = coordinates(self.cleft, x)
            return maximum(maximum(front(x), -self.thickness - self._before(a - face, c)), c - self.top)

        return signed_distance

    def bounds(self, advance: float) -> tuple[np.ndarray, np.ndarray]:
        """Including the curvature of the face."""
        face, half = self.cleft.opening / 2 + advance, max(self.width, self.tip_width or 0.0) / 2
        off = min(max(self.top - self.middle, self.middle - self.tip), self.bend)
        sag = 0.0 if np.isinf(self.bend) else self.bend - np.sqrt(self.bend**2 - off**2)
        return np.array([face - self.thickness - sag, -half, self.tip]), np.array([face, half, self.top])

    def _before(self, a: CoefficientFunction, c: CoefficientFunction) -> CoefficientFunction:
        """Distance (m) to the plane or cylindrical face, at height c and distance a from its foremost line."""
        if np.isinf(self.bend):
            return a
        return ngs.sqrt((a + self.bend) ** 2 + (c - self.middle) ** 2 + INSIDE**2) - self.bend

    def _beside(self, b: CoefficientFunction, c: CoefficientFunction) -> CoefficientFunction:
        """Distance (m) to the planes of the side edges."""
        along = ngs.sqrt(b * b + INSIDE**2)
        if self.tip_width is None:
            return along - self.width / 2
        slope = (self.width - self.tip_width) / 2 / (self.cleft.depth - self.tip)
        return (along - self.tip_width / 2 - slope * (c - self.tip)) / np.hypot(1, slope)

    @property
    def middle(self) -> float:
        """Height (m) halfway from the tip to the surface or to the upper edge."""
        return (self.tip + min(self.cleft.depth, self.tip + self.height)) / 2


@dataclass(frozen=True)
class Tube(RigidTool):
    """An expanding tubular retractor: a cylinder around the cleft's axis, which first touches both walls at mid width.

    Its advance is the increase of its radius.

    Parameters
    ----------
    cleft : Cleft
    width : float
        Width (m) of the wall over which pressure is evaluated.
    edge_radius : float
        Radius (m) of its lower rim.
    tip : float
        Height (m) of the rim above the cleft's floor.
    """

    cleft: Cleft
    width: float
    edge_radius: float
    tip: float
    single = True

    def distance(self, advance: CoefficientFunction) -> SignedDistance:
        """x ↦ signed distance (m) to {across² + along² ≤ radius², height ≥ tip} with a rounded rim."""
        r, radius = self.edge_radius, self.cleft.opening / 2 + advance

        def signed_distance(x: CoefficientFunction) -> CoefficientFunction:
            a, b, c = coordinates(self.cleft, x)
            return rounded_intersection((ngs.sqrt(a * a + b * b + INSIDE**2) - radius + r, self.tip + r - c), r)

        return signed_distance

    def body(self, advance: CoefficientFunction) -> SignedDistance:
        """Up to the height that is drawn."""
        front = self.distance(advance)
        return lambda x: maximum(front(x), coordinates(self.cleft, x)[2] - self.top)

    def bounds(self, advance: float) -> tuple[np.ndarray, np.ndarray]:
        """Around the cleft's axis."""
        radius = self.cleft.opening / 2 + advance
        return np.array([-radius, -radius, self.tip]), np.array([radius, radius, self.top])

    def moves(self, x: CoefficientFunction, advance: CoefficientFunction) -> CoefficientFunction:
        """Radial displacement away from its axis.

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
        a, b, _ = coordinates(self.cleft, x)
        across, along = (ngs.CF(tuple(map(float, axis))) for axis in (self.cleft.across, self.cleft.along))
        return advance * (a * across + b * along) / ngs.sqrt(a * a + b * b + INSIDE**2)


@dataclass(frozen=True)
class Ball(RigidTool):
    """A ball that moves towards `cleft.across`, at mid width of the walls.

    Parameters
    ----------
    cleft : Cleft
    width : float
        Its diameter (m).
    tip : float
        Height (m) of its lowest point above the cleft's floor.

    Examples
    --------
    >>> cleft = Cleft(np.zeros(3), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), 30e-3, 6e-3, 12e-3)
    >>> print(1e3 * Ball(cleft, 6e-3, 10e-3).signed_distance(2e-3, np.array([[8e-3, 0, 13e-3], [2e-3, 0, 13e-3]])))
    [ 3. -3.]
    """

    cleft: Cleft
    width: float
    tip: float

    def distance(self, advance: CoefficientFunction) -> SignedDistance:
        """x ↦ distance (m) to its centre, minus its radius."""
        radius = self.width / 2
        middle = self.cleft.opening / 2 - radius + advance

        def signed_distance(x: CoefficientFunction) -> CoefficientFunction:
            a, b, c = coordinates(self.cleft, x)
            return ngs.sqrt((a - middle) ** 2 + b * b + (c - self.tip - radius) ** 2 + INSIDE**2) - radius

        return signed_distance

    @property
    def height(self) -> float:  # type: ignore[override]
        """Its diameter (m)."""
        return self.width

    def bounds(self, advance: float) -> tuple[np.ndarray, np.ndarray]:
        """The cube around it."""
        radius = self.width / 2
        middle = np.array([self.cleft.opening / 2 - radius + advance, 0.0, self.tip + radius])
        return middle - radius, middle + radius
