"""Tissue and blade of a protocol at one time."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from ngbrain.mesh import Cleft
from ngbrain.report.pictures.tool import ToolDrawing
from ngbrain.report.render.surface import Floats, Ints, faces, triangles

OPENED = re.compile(r"craniotomy|wall_|end_|floor|lid")
"""Boundaries that do not lie on the skull."""
FOLD = 0.2
"""A tetrahedron is folded where its Jacobian at a corner is less than this part of that of the straight one."""
_MIDDLE = {frozenset(pair): 4 + k for k, pair in enumerate([(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)])}


@dataclass(frozen=True, eq=False)
class DeformedHead:
    """Deformed tissue and blade of a protocol at one time.

    Parameters
    ----------
    protocol : str
        Name of the protocol.
    time : float
        Time (s).
    points, rest : ndarray, shape (n, 3)
        Deformed and undeformed nodes (m).
    strain : ndarray, shape (n,)
        Largest principal strain.
    tets : ndarray of int, shape (m, 10)
        Nodes of the tetrahedra in VTK's order.
    region : ndarray of str, shape (m,)
        Region names.
    outer : dict of str to ndarray of int, shape (k, 6)
        Boundary → six-node faces of the outer surface, with outward normals.
    borders : ndarray of int, shape (l, 3)
        Triangles of the outer surface and between regions.
    cleft : Cleft
        The cleft.
    craniotomy : float
        Diameter of the craniotomy (m).
    tool : str
        Name of the tool that opens the cleft.
    blades : tuple of ToolDrawing
        The tools in their current position.
    """

    protocol: str
    time: float
    points: Floats
    rest: Floats
    strain: Floats
    tets: Ints
    region: np.ndarray
    outer: dict[str, Ints]
    borders: Ints
    cleft: Cleft
    craniotomy: float
    tool: str
    blades: tuple[ToolDrawing, ...]

    def surface(self) -> Ints:
        """Triangles of the outer surface."""
        return self._triangles(lambda name: True)

    def skull(self) -> Ints:
        """Triangles of the surface under the skull."""
        return self._triangles(lambda name: not OPENED.match(name))

    def window(self) -> Ints:
        """Triangles of the surface under the craniotomy."""
        return self._triangles(lambda name: name.startswith("craniotomy"))

    def cleft_faces(self) -> dict[str, Ints]:
        """Triangles of the walls, ends and floor of the cleft, by name."""
        return {k: triangles(v) for k, v in self.outer.items() if OPENED.match(k) and not k.startswith("craniotomy")}

    def ventricles(self) -> Ints:
        """Triangles of the ventricles' surface."""
        inside = np.char.startswith(self.region.astype(str), "ventricle")
        return triangles(faces(self.tets[inside])) if inside.any() else np.zeros((0, 3), int)

    def _triangles(self, wanted: Any) -> Ints:
        parts = [six for name, six in self.outer.items() if wanted(name)]
        return triangles(np.concatenate(parts)) if parts else np.zeros((0, 3), int)


def smooth_folded_strain(tets: Ints, rest: Floats, points: Floats, strain: Floats) -> Floats:
    """Replace the strain at nodes of folded tetrahedra by a volume-weighted mean over the adjacent tetrahedra.

    A curved tetrahedron can be nearly flat at a corner, where gradients are meaningless. The mean is that of the strains of the
    tetrahedra's four corners.

    Parameters
    ----------
    tets : ndarray of int, shape (m, 10)
        Tetrahedra in VTK's order.
    rest, points : ndarray, shape (n, 3)
        Undeformed and deformed nodes (m).
    strain : ndarray, shape (n,)
        Largest principal strain.

    Returns
    -------
    ndarray, shape (n,)
        Corrected strain.
    """
    x = rest[tets]
    straight = np.linalg.det(x[:, 1:4] - x[:, :1])
    folded = np.zeros(len(tets), bool)
    for i in range(4):
        others = [j for j in range(4) if j != i]
        middles = [_MIDDLE[frozenset((i, j))] for j in others]
        curved = np.linalg.det(4 * x[:, middles] - 3 * x[:, [i]] - x[:, others])
        folded |= curved * np.linalg.det(x[:, others] - x[:, [i]]) < FOLD * straight**2
    nodes = np.unique(tets[folded])
    if not len(nodes):
        return strain
    near = np.flatnonzero(np.isin(tets, nodes).any(axis=1))
    y = points[tets[near]]
    gradient = np.linalg.solve(x[near, 1:4] - x[near, :1], y[:, 1:4] - y[:, :1])  # F transposed
    largest = (np.linalg.eigvalsh(gradient @ gradient.transpose(0, 2, 1))[:, 2] - 1) / 2
    weight = np.abs(straight[near])[:, None] * np.ones(10)
    flat, n = tets[near].ravel(), len(rest)
    mean = (
        np.bincount(flat, (weight * largest[:, None]).ravel(), n)[nodes] / np.bincount(flat, weight.ravel(), n)[nodes]
    )
    result = strain.copy()
    result[nodes] = mean
    return result
