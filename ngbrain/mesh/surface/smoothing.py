"""Intersecting triangles of surfaces, and smoothing that avoids intersections."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ngbrain.mesh.surface.triangle_mesh import SurfaceMesh

_SHRINK, _GROW = 0.5, -0.53
_CHUNK = 2_000_000
_ROUNDS = 12


def crossings(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Pairs of triangles of which an edge of one passes through the interior of the other.

    Pairs with a common corner count if their other edges intersect. Pairs with a common edge, coplanar triangles and touching
    triangles do not count. The test uses signs of tetrahedra in double precision. It covers pairs whose centres are as near as
    the largest two triangles can be, so it suits triangles of similar sizes.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Vertices (m).
    triangles : ndarray of int, shape (m, 3)
        Triangles.

    Returns
    -------
    ndarray of int, shape (k, 2)
        Pairs of triangles, the smaller number first.

    References
    ----------
    Guigue & Devillers (2003), doi:10.1080/10867651.2003.10487580.

    Examples
    --------
    >>> points = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0.5, 0.5, -1], [0.5, 0.5, 1], [3, 3, 0.0]])
    >>> crossings(points, np.array([[0, 1, 2], [3, 4, 5]])).tolist()
    [[0, 1]]
    """
    corners = points[triangles]
    centres = corners.mean(axis=1)
    reach = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    pairs = cKDTree(centres).query_pairs(2 * reach.max(initial=0.0), output_type="ndarray")
    low, high = corners.min(axis=1), corners.max(axis=1)
    found = [np.zeros((0, 2), int)]
    for k in range(0, len(pairs), _CHUNK):
        a, b = pairs[k : k + _CHUNK].T
        near = (low[a] <= high[b]).all(axis=1) & (low[b] <= high[a]).all(axis=1)
        a, b = a[near], b[near]
        common = (triangles[a][:, :, None] == triangles[b][:, None]).any(axis=2).sum(axis=1)
        a, b = a[common < 2], b[common < 2]
        astride = _astride(corners[a], corners[b]) & _astride(corners[b], corners[a])
        a, b = a[astride], b[astride]
        cross = _pierces(points, triangles[a], triangles[b]) | _pierces(points, triangles[b], triangles[a])
        found.append(np.stack([a[cross], b[cross]], axis=1))
    every = np.sort(np.concatenate(found), axis=1)
    return every[np.lexsort(every.T[::-1])]


def _astride(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Whether triangles b (n, 3, 3) have corners on both sides of the planes of triangles a."""
    normal = np.cross(a[:, 1] - a[:, 0], a[:, 2] - a[:, 0])
    side = np.einsum("nkj,nj->nk", b - a[:, :1], normal)
    return np.asarray((side.min(axis=1) < 0) & (side.max(axis=1) > 0))


def _pierces(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Whether an edge of triangles a (n, 3) passes through triangles b (n, 3)."""
    found = np.zeros(len(a), bool)
    x, y, z = (points[b[:, k]] for k in range(3))
    for i, j in ((0, 1), (1, 2), (2, 0)):
        p, q = points[a[:, i]], points[a[:, j]]
        apart = ~((a[:, [i, j]][:, :, None] == b[:, None]).any(axis=(1, 2)))
        sides = np.stack([_volume(p, q, x, y), _volume(p, q, y, z), _volume(p, q, z, x)])
        through = (sides > 0).all(axis=0) | (sides < 0).all(axis=0)
        found |= apart & through & (_volume(p, x, y, z) * _volume(q, x, y, z) < 0)
    return found


def _volume(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", b - a, np.cross(c - a, d - a))


def smooth_surfaces(surfaces: list[SurfaceMesh], volumes: list[float], steps: int) -> list[SurfaceMesh]:
    """Smooth surfaces that enclose given volumes; they do not intersect themselves or each other if they did not before.

    Taubin smoothing: a vertex moves half of the way to the centre of its neighbours, then slightly more than that back. At last
    all vertices of a surface move by one distance along their normals to match the volume; then `resolve_intersections`.

    Parameters
    ----------
    surfaces : list of SurfaceMesh
        The surfaces.
    volumes : list of float
        Enclosed volume of each (m³).
    steps : int
        Number of smoothing steps.

    Returns
    -------
    list of SurfaceMesh
        The smoothed surfaces.

    References
    ----------
    Taubin (1995), doi:10.1145/218380.218473.

    Examples
    --------
    >>> from ngbrain.mesh.surface.mask_surface import contour
    >>> rough = SurfaceMesh(*contour(np.linalg.norm(np.indices((15, 15, 15)) - 7, axis=0) < 5))
    >>> smooth = smooth_surfaces([rough], [rough.volume], 10)[0]
    >>> bool(smooth.area < rough.area), round(smooth.volume / rough.volume, 3), smooth.genus
    (True, 1.0, 0)
    """
    smooth = [SurfaceMesh(_smooth(s, v, steps), s.triangles) for s, v in zip(surfaces, volumes, strict=True)]
    return resolve_intersections(surfaces, smooth)


def resolve_intersections(surfaces: list[SurfaceMesh], moved: list[SurfaceMesh]) -> list[SurfaceMesh]:
    """Undo the moves of vertices whose triangles would intersect, and of more and more vertices around them.

    This takes 12 rounds at most; `crossings` finds what is left.

    Parameters
    ----------
    surfaces : list of SurfaceMesh
        Surfaces without intersections.
    moved : list of SurfaceMesh
        The same surfaces with moved vertices.

    Returns
    -------
    list of SurfaceMesh
        The moved surfaces without intersections.
    """
    first = np.cumsum([0, *(len(s.points) for s in surfaces)])
    rough, smooth = (np.concatenate([s.points for s in every]) for every in (surfaces, moved))
    triangles = np.concatenate([s.triangles + k for s, k in zip(surfaces, first, strict=False)])
    joined = SurfaceMesh(rough, triangles).adjacency()
    looked_at = triangles
    for rings in range(1, _ROUNDS + 1):
        pairs = crossings(smooth, looked_at)
        if not len(pairs):
            break
        back = np.zeros(len(rough), bool)
        back[looked_at[pairs]] = True
        for _ in range(rings):
            back |= joined @ back > 0
        smooth[back] = rough[back]
        looked_at = _close(smooth, triangles, back)
    return [SurfaceMesh(smooth[a:b], s.triangles) for s, a, b in zip(surfaces, first[:-1], first[1:], strict=True)]


def _smooth(surface: SurfaceMesh, volume: float, steps: int) -> np.ndarray:
    joined = surface.adjacency()
    degree = np.maximum(np.asarray(joined.sum(axis=1)), 1)
    points = surface.points.copy()
    for _ in range(steps):
        for share in (_SHRINK, _GROW):
            points += share * (joined @ points / degree - points)
    for _ in range(3):  # volumes are nearly, but not exactly, linear in the distance
        now = SurfaceMesh(points, surface.triangles)
        points = points + (volume - now.volume) / now.area * now.normals()
    return points


def _close(points: np.ndarray, triangles: np.ndarray, changed: np.ndarray) -> np.ndarray:
    """Triangles that may intersect one with a changed corner."""
    corners = points[triangles]
    centres = corners.mean(axis=1)
    reach = np.linalg.norm(corners - centres[:, None], axis=2).max()
    mine = changed[triangles].any(axis=1)
    away, _ = cKDTree(centres[mine]).query(centres, distance_upper_bound=2.01 * reach)
    return np.asarray(triangles[np.isfinite(away)])
