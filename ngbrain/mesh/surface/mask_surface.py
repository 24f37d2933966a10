"""The surface of a voxel mask as triangles: closed, two at every edge, and with the topology of the mask."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
from scipy import ndimage

_CORNERS = np.array(list(product((0, 1), repeat=3)))
_BITS = 1 << np.arange(8)
_EDGES = [(a, b) for a in range(8) for b in range(a, 8) if a ^ b in (1, 2, 4)]
_MIDDLE = len(_EDGES)  # a vertex inside the cube
_FACES = [(axis, side) for axis in range(3) for side in (0, 1)]
_NEAR = 0.08
"""Smallest distance of smoothed values from 1/2, on the mask's side: the surface passes through no voxel centre."""

Triangles = np.ndarray


def contour(mask: np.ndarray, smoothing: float = 0.75) -> tuple[np.ndarray, Triangles]:
    """Triangulate the surface between the voxels inside and outside a mask, with the topology of the mask.

    The mask is smoothed, and vertices lie where its value is 1/2. Every voxel centre stays on its side, so that thin folds are
    kept. Faces of a cube of eight voxels with two diagonal voxels inside are split as by Kuhn's triangulation
    (`ngbrain.image.segment.topology_correction`): triangles of neighbouring cubes match, and the surface bounds components of
    14-connectivity. With the choices of marching cubes, a ball of voxels need not have a sphere around it.

    Parameters
    ----------
    mask : ndarray of bool, shape (nx, ny, nz)
        The mask.
    smoothing : float
        Standard deviation of the Gaussian (voxels).

    Returns
    -------
    points : ndarray, shape (n, 3)
        Vertices in voxel indices.
    triangles : ndarray of int, shape (m, 3)
        Triangles with outward normals.

    References
    ----------
    Marching cubes: Lorensen & Cline (1987), doi:10.1145/37401.37422.

    Examples
    --------
    >>> points, triangles = contour(np.ones((1, 1, 1), bool))
    >>> len(points), len(triangles)  # a voxel has 6 faces, so that 6 edges of the grid leave it
    (6, 8)
    """
    pad = int(np.ceil(4 * smoothing)) + 1
    inside = np.pad(mask.astype(bool), pad)
    share = ndimage.gaussian_filter(inside.astype(np.float32), smoothing) - 0.5
    share = np.where(inside, np.maximum(share, _NEAR), np.minimum(share, -_NEAR)).ravel()
    size = np.array(inside.strides)
    codes = np.zeros(tuple(n - 1 for n in inside.shape), np.uint8)
    for corner, bit in zip(_CORNERS, _BITS, strict=True):
        codes |= inside[tuple(slice(c, c + n) for c, n in zip(corner, codes.shape, strict=True))] * np.uint8(bit)
    at = np.argwhere((codes > 0) & (codes < 255))
    case = codes[tuple(at.T)]
    table, start, count = _table()
    of = np.repeat(np.arange(len(at)), count[case])
    row = np.arange(len(of)) - np.repeat(np.cumsum(count[case]) - count[case], count[case])
    edges = table[start[case][of] + row]
    first, last = np.array([*_EDGES, (0, 0)]).T
    axis = np.append(np.abs(_CORNERS[last] - _CORNERS[first]).argmax(axis=1)[:_MIDDLE], 3)
    keys = ((at @ size)[of][:, None] + (_CORNERS[first] @ size)[edges]) * 4 + axis[edges]
    unique, triangles = np.unique(keys, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    low, along = unique // 4, unique % 4
    points = np.stack(np.unravel_index(low, inside.shape), axis=1).astype(float)
    on = np.flatnonzero(along < 3)
    a, b = share[low[on]], share[low[on] + size[along[on]]]
    points[on, along[on]] += a / (a - b)
    _centred(points, triangles, along == 3)
    return points - pad, triangles


def _centred(points: np.ndarray, triangles: Triangles, middles: np.ndarray) -> None:
    """Move hub vertices of fans to the centre of their rim."""
    hub, spoke = middles[triangles], np.argmax(middles[triangles], axis=1)
    fans = np.flatnonzero(hub.any(axis=1))
    hubs, rim = triangles[fans, spoke[fans]], triangles[fans, (spoke[fans] + 1) % 3]
    total = np.bincount(hubs, minlength=len(points))[middles]
    points[middles] = np.stack([np.bincount(hubs, x, len(points))[middles] / total for x in points[rim].T], axis=1)


@cache
def _table() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles (k, 3) of edges for all 256 cases in one array, and the start and number of each case's triangles."""
    cases = [_case([bool(code >> k & 1) for k in range(8)]) for code in range(256)]
    count = np.array([len(case) for case in cases])
    return np.array([t for case in cases for t in case]), np.cumsum(count) - count, count


def _case(inside: list[bool]) -> list[tuple[int, ...]]:
    after: dict[int, int] = {}
    for face in _FACES:
        after.update(_segments(inside, _around(*face)))
    loops = []
    while after:
        loop = [next(iter(after))]
        while after[loop[-1]] != loop[0]:
            loop.append(after[loop[-1]])
        for edge in loop:
            del after[edge]
        loops.append(loop)
    if inside[0] == inside[7] and all(inside[k] != inside[0] for k in range(1, 7)):
        return _tube(*loops)  # the diagonal connects its ends through the others
    return [t for loop in loops for t in _disc(loop) or _fan(loop)]


def _around(axis: int, side: int) -> list[int]:
    """Corners of a cube's face, clockwise seen from outside the cube."""
    u, v = (4 >> (axis + 1) % 3), (4 >> (axis + 2) % 3)
    base = side * (4 >> axis)
    path = [base, base + u, base + u + v, base + v]
    return path[::-1] if side else path


def _segments(inside: list[bool], path: list[int]) -> dict[int, int]:
    """Edge where the path around a face leaves the mask → edge where the surface's trace from there ends."""
    edges = [_EDGES.index((min(a, b), max(a, b))) for a, b in zip(path, path[1:] + path[:1], strict=True)]
    now = [inside[k] for k in path]
    leaves = [k for k in range(4) if now[k] and not now[(k + 1) % 4]]
    enters = [k for k in range(4) if not now[k] and now[(k + 1) % 4]]
    if len(leaves) < 2:
        return {edges[a]: edges[b] for a, b in zip(leaves, enters, strict=True)}
    # Of two pairs of diagonal corners, the one with the face's first and last corner is connected; the others are separated.
    joined = inside[min(path)]
    step = 1 if joined else -1
    return {edges[k]: edges[(k + step) % 4] for k in leaves}


def _sides(edge: int) -> set[tuple[int, int]]:
    a, b = _EDGES[edge]
    return {(axis, side) for axis, side in _FACES if _CORNERS[a][axis] == _CORNERS[b][axis] == side}


def _disc(loop: list[int]) -> list[tuple[int, ...]]:
    """Triangulate a polygon without a diagonal in a face of the cube, where the next cube may have the same one; or none."""
    if len(loop) == 3:
        return [(loop[0], loop[1], loop[2])]
    for k in range(len(loop)):
        before, after = loop[k - 1], loop[(k + 1) % len(loop)]
        if not _sides(before) & _sides(after):
            rest = _disc([*loop[:k], *loop[k + 1 :]])
            if rest:
                return [(before, loop[k], after), *rest]
    return []


def _fan(loop: list[int]) -> list[tuple[int, ...]]:
    return [(a, b, _MIDDLE) for a, b in zip(loop, loop[1:] + loop[:1], strict=True)]


def _tube(a: list[int], b: list[int]) -> list[tuple[int, ...]]:
    """Triangles between two opposite loops of three edges."""
    middle = np.array([_CORNERS[list(edge)].mean(axis=0) for edge in _EDGES])
    turn = min(range(3), key=lambda s: sum(np.linalg.norm(middle[a[i]] - middle[b[(s - i) % 3]]) for i in range(3)))
    made: list[tuple[int, ...]] = []
    for i in range(3):
        j = (i + 1) % 3
        to, of = b[(turn - j) % 3], b[(turn - i) % 3]
        made += [(a[i], a[j], to), (a[i], to, of)]
    return made
