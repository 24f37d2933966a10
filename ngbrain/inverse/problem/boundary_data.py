"""Dirichlet and traction-free parts of the boundary, from the data's `dirichlet` flags.

A side of an element is traction-free where at least half of it is nearest to border points without the flag. All other sides
are driven by measured displacements. So are sides away from the border points, such as those that reach out of the tissue by
more than a voxel in space: no surface of tissue is there. To drive a side takes no assumption, because its displacements are
unknowns within their noise. To set a side free assumes zero traction.
"""

from __future__ import annotations

from typing import Any

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ngbrain.errors import InputError
from ngbrain.inverse.problem.voxel_lattice import NEAR, voxel_axes
from ngbrain.io.waves import WaveData
from ngbrain.mesh.geometry.structured import with_boundaries

Array = np.ndarray
FREE = "free"
"""Name of traction-free boundaries."""
ALL, BUT_FREE = ".*", f"(?!{FREE}$).*"
"""Patterns of all boundaries, and of all but the traction-free ones."""
SAMPLES = {2: 12, 3: 6}
"""Sample points along a side (an even number), by dimension. Their nearest data points decide whether the side is driven."""
ON = 1e-9
"""Tolerance for equal points, relative to the size of the body."""


def mark_driven_boundary(data: WaveData, mesh: ngs.Mesh) -> tuple[ngs.Mesh, str]:
    """Give traction-free sides a boundary region of their own.

    Parameters
    ----------
    data : WaveData
        Its `dirichlet` flags say which border points are driven.
    mesh : ngsolve.Mesh
        Mesh with straight sides over the points of the mask.

    Returns
    -------
    mesh : ngsolve.Mesh
        The mesh with a region `FREE`; the mesh itself where no side is free.
    driven : str
        Pattern of the driven boundaries.

    Raises
    ------
    InputError
        There are flags at points outside the mask (such as those of another mask) or inside the body; a flagged point has too
        few flagged neighbours to drive half of a side; or no border point is flagged.
    """
    corners, flags = _corners(mesh), data.dirichlet
    if np.any(outside := flags & ~data.mask):
        found = f"true at {int(outside.sum())} points outside of the mask, the first at {_point_text(data.points[outside][0])}"
        raise InputError("dirichlet", found, "true at points of the mask's border alone, or None for all of them")
    inside = flags & ~data.border
    if data.grid is None and inside.any():  # borders of holes are not part of the hull
        vertices, size = KDTree(corners.reshape(-1, data.dim)), float(np.ptp(data.points))
        inside &= vertices.query(data.points)[0] > ON * size
    if inside.any():
        found = f"true at {int(inside.sum())} points inside, the first at {_point_text(data.points[inside][0])}"
        raise InputError("dirichlet", found, "true at points of the border alone: none inside can drive the body")
    border = data.border | flags
    if flags[border].all():
        return mesh, ALL
    near, close = _nearest(data, corners, np.flatnonzero(border))
    free = close & ~flags[near]
    driven = free.mean(axis=1) < 0.5
    if np.any(lost := _isolated_flags(near, flags, driven)):
        found = f"true at {int(lost.sum())} points with too few beside them, the first at {_point_text(data.points[lost][0])}"
        raise InputError("dirichlet", found, "true at points that are nearest to most of an element's side, or more")
    if not driven.any():
        raise InputError("dirichlet", "false at all the border", "some part of it that is driven as measured")
    if driven.all():
        return mesh, ALL
    names = mesh.GetBoundaries()
    sides = mesh.Elements(ngs.BND)
    return with_boundaries(mesh, [names[s.index] if h else FREE for s, h in zip(sides, driven, strict=True)]), BUT_FREE


def free_boundary(mesh: ngs.Mesh) -> dict[str, Any]:
    """Describe the traction-free part of a mesh's boundary: its share and its bounding box (mm).

    Empty where no boundary is free. The mesh is one of `mark_driven_boundary`.
    """
    if FREE not in mesh.GetBoundaries():
        return {}
    corners = _corners(mesh)
    names = np.array(mesh.GetBoundaries())[[side.index for side in mesh.Elements(ngs.BND)]]
    free = corners[names == FREE].reshape(-1, mesh.dim)
    share = ngs.Integrate(1, mesh.Boundaries(FREE)) / ngs.Integrate(1, mesh.Boundaries(ALL))
    return {"share": share, "from_mm": (1e3 * free.min(axis=0)).tolist(), "to_mm": (1e3 * free.max(axis=0)).tolist()}


def _corners(mesh: ngs.Mesh) -> Array:
    """Corners of the boundary elements, (sides, 2 or 4, dim) m."""
    at = np.array([v.point for v in mesh.vertices])
    return at[[[v.nr for v in side.vertices] for side in mesh.Elements(ngs.BND)]]


def _nearest(data: WaveData, corners: Array, among: Array) -> tuple[Array, Array]:
    """Nearest data points of samples (sides, k) on the sides, and whether they are near enough to decide."""
    line = (np.arange(SAMPLES[data.dim]) + 0.5) / SAMPLES[data.dim]
    if data.dim == 2:
        samples = np.einsum("kc,sci->ski", np.stack([1 - line, line], axis=1), corners)
        distance, near = KDTree(data.points[among]).query(samples)
        length = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1, keepdims=True)
        return among[near], distance < 0.5 * length * (1 + ON)
    a, b = (each.ravel() for each in np.meshgrid(line, line))
    shapes = np.stack([(1 - a) * (1 - b), a * (1 - b), a * b, (1 - a) * b], axis=1)
    axes, spacing = voxel_axes(data)
    tree = KDTree(data.points[among] @ axes.T / spacing)
    distance, near = tree.query(np.einsum("kc,sci->ski", shapes, corners) @ axes.T / spacing)
    return among[near], distance < NEAR


def _isolated_flags(near: Array, flags: Array, driven: Array) -> Array:
    """Flagged points (n,) on free sides that no other flagged points connect with a driven side."""
    sides, n = len(near), len(flags)
    i, k = np.nonzero(flags[near])
    points = near[i, k]
    links = sp.coo_array((np.ones(len(i)), (i, sides + points)), shape=(sides + n,) * 2)
    piece = connected_components(links, directed=False)[1]
    lost = np.zeros(n, bool)
    lost[points] = ~np.isin(piece[sides + points], piece[:sides][driven])
    return lost


def _point_text(point: Array) -> str:
    return "(" + ", ".join(f"{1e3 * x:.4g}" for x in point) + ") mm"
