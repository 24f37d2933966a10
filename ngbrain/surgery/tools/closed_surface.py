"""A tool of arbitrary shape, given as a closed surface: its signed distance on a grid, with first and second derivatives.

NGSolve cannot interpolate a grid at a trial function, nor differentiate the interpolated value. The distance near the current
position y₀ of a wall point is therefore the quadratic φ + g·(y - y₀) + (y - y₀)·H(y - y₀)/2, with φ, g, H interpolated at y₀
whenever the body moves: value, gradient and Hessian at y = y₀ are those of the grid, which is all that Newton's method needs.
"""

from __future__ import annotations

from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction
from scipy import ndimage
from scipy.spatial import cKDTree

from ngbrain.errors import InputError
from ngbrain.image.segment.from_surfaces import inside_surface
from ngbrain.look import BriefText
from ngbrain.mesh.geometry.cleft import Cleft
from ngbrain.mesh.surface.triangle_mesh import SurfaceMesh
from ngbrain.surgery.tools.base import RigidTool, SignedDistance, coordinates

STEP, AROUND = 0.5e-3, 5e-3
"""Grid spacing (m), over which edges are rounded, and the margin (m) of the grid around the surface."""
RIM = 3
"""Grid layers at the boundary that are not used for interpolation."""
NEAREST = 6
"""Number of candidate triangles for the distance of a point."""
LOOSE = 0.1e-3
"""Length (m) by which a tool may exceed the cleft."""


PAIRS = [(i, j) for i in range(3) for j in range(i, 3)]


@dataclass(frozen=True, eq=False, repr=False)
class DistanceGrid(BriefText):
    """Signed distances on a grid in the tool's own axes, with a cubic spline through them.

    Parameters
    ----------
    low, high : (3,) array
        Corners (m).
    spline : (nx + 2, ny + 2, nz + 2) array
        Spline coefficients, with one more on each side than grid points.
    """

    low: np.ndarray
    high: np.ndarray
    spline: np.ndarray

    @classmethod
    def from_mesh(cls, surface: SurfaceMesh) -> DistanceGrid:
        """Grid around a surface."""
        low = surface.points.min(axis=0) - AROUND
        n = np.ceil((surface.points.max(axis=0) + AROUND - low) / STEP).astype(int) + 1
        shape = (int(n[0]), int(n[1]), int(n[2]))
        axes = [low[i] + STEP * np.arange(many) for i, many in enumerate(shape)]
        at = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        distance = _distance(surface, at.reshape(-1, 3)).reshape(shape)
        distance = np.where(inside_surface(surface, low, STEP, shape), -distance, distance)
        spline = ndimage.spline_filter(distance, order=3, mode="mirror")
        return cls(low, low + STEP * (np.array(shape) - 1), np.pad(spline, 1, mode="reflect"))

    def translate(self, x: float) -> DistanceGrid:
        """Translate by x (m) along the first axis; a spline overshoots slightly beyond a flat face with edges."""
        by = np.array([x, 0.0, 0.0])
        return DistanceGrid(self.low + by, self.high + by, self.spline)

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Interpolate at points (n, 3) m.

        Returns (13, n): the points clamped to the grid (3), the distance, its gradient (3) and Hessian (6); beyond the grid the
        Hessian is 0.
        """
        inside = np.clip(points, self.low + RIM * STEP, self.high - RIM * STEP)  # the spline is flat at its ends
        place = (inside - self.low) / STEP
        first = np.minimum(place.astype(int), np.array(self.spline.shape) - 4)
        around = first[:, :, None] + np.arange(4)
        near = self.spline[around[:, 0, :, None, None], around[:, 1, None, :, None], around[:, 2, None, None, :]]
        basis = _basis(place - first)

        def along(*orders: int) -> np.ndarray:
            weights = [basis[order][:, i] for i, order in enumerate(orders)]
            return np.asarray(np.einsum("nabc,na,nb,nc->n", near, *weights, optimize=True)) / STEP ** sum(orders)

        unit, bent = np.eye(3, dtype=int), np.all(inside == points, axis=1)
        slopes = [along(*unit[i]) for i in range(3)]
        return np.stack([*inside.T, along(0, 0, 0), *slopes, *(bent * along(*unit[i] + unit[j]) for i, j in PAIRS)])

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Signed distances (m) of points (n, 3)."""
        found = self.evaluate(points)
        return np.asarray(found[3] + np.einsum("in,in->n", found[4:7], np.transpose(points) - found[:3]))


class GridDistance:
    """x ↦ signed distance to a moving tool, interpolated from its grid at the quadrature points of a wall.

    Parameters
    ----------
    tool : ClosedSurface
    advance : CoefficientFunction
        Advance (m) of the tool.
    """

    def __init__(self, tool: ClosedSurface, advance: CoefficientFunction) -> None:
        self._tool = tool
        self._found: ngs.GridFunction | None = None
        self._own = ngs.CF((tool.cleft.opening / 2 + advance, 0.0, tool.tip))

    def follow(self, x: CoefficientFunction, points: ngs.FESpace, wall: ngs.Region) -> None:
        """Define the wall points at which the grid is interpolated; `look` updates the interpolation when they have moved.

        Parameters
        ----------
        x : CoefficientFunction
            Current position (m) of the wall.
        points : ngs.FESpace
            Space of values at the quadrature points.
        wall : ngs.Region
        """
        self._place = ngs.GridFunction(ngs.VectorValued(points, 3))
        self._found = ngs.GridFunction(ngs.VectorValued(points, 13))
        self._there, self._wall = self._in_own_axes(x).Compile(), wall

    def look(self) -> None:
        """Interpolate the grid at the current positions."""
        assert self._found is not None
        self._place.Interpolate(self._there, definedon=self._wall)
        at = self._place.vec.FV().NumPy().reshape(3, -1)
        self._found.vec.FV().NumPy().reshape(13, -1)[:] = self._tool.grid.evaluate(at.T)

    def __call__(self, x: CoefficientFunction) -> CoefficientFunction:
        """Signed distance (m)."""
        if self._found is None:
            raise InputError("distance", "asked of a closed surface", "a problem first, whose contact it is")
        at, known = self._in_own_axes(x), self._found
        off = [at[i] - known[i] for i in range(3)]
        value = known[3]
        for i in range(3):
            value = value + known[4 + i] * off[i]
        for k, (i, j) in enumerate(PAIRS):
            value = value + (0.5 if i == j else 1.0) * known[7 + k] * off[i] * off[j]
        return value

    def _in_own_axes(self, x: CoefficientFunction) -> CoefficientFunction:
        return ngs.CF(coordinates(self._tool.cleft, x)) - self._own


@dataclass(frozen=True, eq=False)
class ClosedSurface(RigidTool):
    """A tool given by a closed surface: x is the pushing direction, y along the wall, z out of the cleft.

    Its foremost point is placed at the unloaded wall, its lowest point at the height `tip`, its centre at mid width of the wall.

    Parameters
    ----------
    cleft : Cleft
    width : float
        Size (m) along the wall.
    tip : float
        Height (m) of its lowest point.
    depth : float
        Size (m) from its back to its foremost point.
    grid : DistanceGrid
        Its signed distance.
    height : float
        Size (m) from its lowest to its highest point.

    Examples
    --------
    >>> cleft = Cleft(np.zeros(3), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), 30e-3, 4e-3, 12e-3)
    >>> x = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) * [4e-3, 8e-3, 2e-2]
    >>> faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
    ...          [1, 5, 7], [1, 7, 3]]
    >>> box = ClosedSurface.from_mesh(SurfaceMesh(x, np.array(faces)), cleft, 4e-3)
    >>> low, high = box.bounds(1e-3)
    >>> print(1e3 * low, 1e3 * high)
    [-1. -4.  4.] [ 3.  4. 24.]
    """

    cleft: Cleft
    width: float
    tip: float
    depth: float
    grid: DistanceGrid
    height: float

    @classmethod
    def from_mesh(cls, surface: SurfaceMesh, cleft: Cleft, tip: float, name: str = "surface") -> ClosedSurface:
        """From a surface (m) in its own axes; raises `InputError` where it does not fit into the cleft."""
        low, high = surface.points.min(axis=0), surface.points.max(axis=0)
        depth, width, height = high - low
        for size, most, said in (
            (depth, cleft.opening, "cleft.gap_mm, along x"),
            (width, cleft.width, "cleft.width_mm, along y"),
        ):
            if size > most + LOOSE:
                raise InputError("tool.file", f"{name}, {1e3 * size:.3g} mm", f"at most {1e3 * most:.3g}: {said}")
        origin = np.array([high[0], (low[1] + high[1]) / 2, low[2]])
        grid = DistanceGrid.from_mesh(SurfaceMesh(surface.points - origin, surface.triangles))
        face = np.stack(
            np.meshgrid(
                0.0, *(np.arange(a, b, STEP / 3) for a, b in ((-width / 2, width / 2), (0, height))), indexing="ij"
            )
        )
        grid = grid.translate(min(0.0, float(grid.distances(face.reshape(3, -1).T).min())))
        return cls(cleft, float(width), tip, float(depth), grid, float(height))

    def distance(self, advance: CoefficientFunction) -> SignedDistance:
        """Interpolated from the grid; a problem defines its points (`RigidContact.follow`)."""
        return GridDistance(self, advance)

    def signed_distance(self, advance: float, at: np.ndarray) -> np.ndarray:
        """Interpolated from the grid.

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
        """
        return self.grid.distances(np.asarray(at) - [self.cleft.opening / 2 + advance, 0.0, self.tip])

    def bounds(self, advance: float) -> tuple[np.ndarray, np.ndarray]:
        """Of the surface."""
        face = self.cleft.opening / 2 + advance
        return np.array([face - self.depth, -self.width / 2, self.tip]), np.array(
            [face, self.width / 2, self.tip + self.height]
        )


def _basis(t: np.ndarray) -> list[np.ndarray]:
    """The four non-zero cubic B-splines at fractions t (n, 3) of a grid step, (n, 3, 4), with first and second derivatives."""
    s = 1 - t
    return [
        np.stack([s**3, 3 * t**3 - 6 * t**2 + 4, 3 * s**3 - 6 * s**2 + 4, t**3], axis=-1) / 6,
        np.stack([-(s**2), 3 * t**2 - 4 * t, 4 * s - 3 * s**2, t**2], axis=-1) / 2,
        np.stack([s, 3 * t - 2, 3 * s - 2, t], axis=-1),
    ]


def _distance(surface: SurfaceMesh, at: np.ndarray) -> np.ndarray:
    """Distance of points (n, 3) to a surface, from the triangles whose sample points are nearest."""
    spread, triangle = _sample_points(surface)
    found = np.full(len(at), np.inf)
    corners = surface.points[surface.triangles]
    _, near = cKDTree(spread).query(at, NEAREST)
    for k in range(NEAREST):
        found = np.minimum(found, _to_triangles(at, corners[triangle[near[:, k]]]))
    return found


def _sample_points(surface: SurfaceMesh) -> tuple[np.ndarray, np.ndarray]:
    """Sample points on a surface, no farther apart than a grid step, and their triangles."""
    corners = surface.points[surface.triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    parts = np.ceil(longest / STEP).astype(int) + 1
    points, owner = [], []
    for n in np.unique(parts):
        mine = np.flatnonzero(parts == n)
        i, j = (each.ravel() for each in np.meshgrid(np.arange(n + 1), np.arange(n + 1)))
        weights = np.stack([i, j, n - i - j], axis=1)[i + j <= n] / n
        points.append((weights @ corners[mine]).reshape(-1, 3))
        owner.append(np.repeat(mine, len(weights)))
    return np.concatenate(points), np.concatenate(owner)


def _to_triangles(at: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Distance of each point (n, 3) to its triangle (n, 3, 3): to its plane where the foot lies inside, else to an edge."""
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = np.cross(b - a, c - a)
    size = np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    foot = np.ones(len(at), bool)
    edges = np.full(len(at), np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        along = q - p
        share = np.clip(_dot(at - p, along) / np.maximum(_dot(along, along), 1e-300), 0, 1)
        edges = np.minimum(edges, np.linalg.norm(at - p - share[:, None] * along, axis=1))
        foot &= _dot(np.cross(along, at - p), normal) >= 0
    return np.where(foot, np.abs(_dot(at - a, normal)) / size, edges)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", a, b)
