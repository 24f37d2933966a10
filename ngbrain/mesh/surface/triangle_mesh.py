"""A closed triangle surface: area, enclosed volume, components and genus."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from ngbrain.look import BriefText


@dataclass(frozen=True, eq=False, repr=False)
class SurfaceMesh(BriefText):
    """A closed triangle surface with two triangles at every edge.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Vertices (m).
    triangles : ndarray of int, shape (m, 3)
        Triangles, counter-clockwise seen from outside.

    Examples
    --------
    >>> points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    >>> corner = SurfaceMesh(points, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    >>> round(corner.volume, 4), round(corner.area, 4), corner.pieces, corner.euler, corner.genus
    (0.1667, 2.366, 1, 2, 0)
    """

    points: np.ndarray
    triangles: np.ndarray

    @property
    def area(self) -> float:
        """Area (m²)."""
        return float(np.linalg.norm(self._normals(), axis=1).sum() / 2)

    @property
    def volume(self) -> float:
        """Enclosed volume (m³): Σ a·(b × c)/6, a sum of signed tetrahedra."""
        if not len(self.triangles):
            return 0.0
        a, b, c = np.moveaxis(self.points[self.triangles] - self.points[self.triangles[0, 0]], 1, 0)
        return float(np.einsum("ij,ij", a, np.cross(b, c)) / 6)

    @property
    def pieces(self) -> int:
        """Number of connected components."""
        used, corners = np.unique(self.triangles, return_inverse=True)
        return int(sparse.csgraph.connected_components(self._graph(corners.reshape(-1, 3), len(used)))[0])

    @property
    def euler(self) -> int:
        """Euler characteristic χ = vertices - edges + triangles, of the vertices in use."""
        return len(np.unique(self.triangles)) - 3 * len(self.triangles) // 2 + len(self.triangles)

    @property
    def genus(self) -> int:
        """Number of handles: components - χ/2, the sum of the components' genera; 0 for spheres."""
        return self.pieces - self.euler // 2

    def normals(self) -> np.ndarray:
        """Outward unit normals (n, 3) at the vertices, weighted by the triangles' areas."""
        total = np.zeros_like(self.points)
        for k in range(3):
            np.add.at(total, self.triangles[:, k], self._normals())
        return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None])

    def adjacency(self) -> sparse.csr_matrix:
        """Adjacency matrix (n, n) of the vertices, with ones where an edge connects two."""
        graph = self._graph(self.triangles, len(self.points))
        graph.data[:] = 1
        return graph

    def vertex_areas(self) -> np.ndarray:
        """Area of each vertex (n,) in m²: a third of the triangles around it."""
        share = np.repeat(np.linalg.norm(self._normals(), axis=1) / 6, 3)
        return np.bincount(self.triangles.ravel(), share, len(self.points))

    def _normals(self) -> np.ndarray:
        a, b, c = np.moveaxis(self.points[self.triangles], 1, 0)
        return np.cross(b - a, c - a)

    @staticmethod
    def _graph(triangles: np.ndarray, n: int) -> sparse.csr_matrix:
        edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        both = np.concatenate([edges, edges[:, ::-1]])
        return sparse.csr_matrix((np.ones(len(both)), tuple(both.T)), (n, n))
