"""A body-centred cubic lattice of tetrahedra on an octree whose cubes are as large as a size field asks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ngbrain.errors import InputError
from ngbrain.mesh.geometry.sizing import SizeField

Points = np.ndarray
Cells = np.ndarray
COARSER = 2**0.5
"""Largest ratio of a cube's edge to the size asked for; half of a larger cube would be as much too small."""
PER_CUBE = 12
"""Tetrahedra for each cube of a uniform lattice."""
FINEST = 12
"""Largest number of times a cube is halved."""
MOST = 5_000_000
"""Largest number of tetrahedra."""
_BITS = 20
_AXES = np.eye(3, dtype=np.int64)
_TURNS = [(i, (i + 1) % 3, (i + 2) % 3) for i in range(3)]
_BESIDE = np.array([s for s in np.ndindex(3, 3, 3) if 0 < np.abs(np.array(s) - 1).sum() < 3]) - 1
_CHILDREN = np.array(list(np.ndindex(2, 2, 2)))


def body_centred_lattice(
    low: Points, high: Points, size: SizeField, finest: float, inside: Callable[[Points], np.ndarray]
) -> tuple[Points, np.ndarray]:
    """Tetrahedra of a body-centred cubic lattice on an octree, in a box around a shape.

    The cubes' edges are `finest` · 2^k with k ≥ 0 (or below where `size` is smaller). They are 0.7 to 1.4 times `size`, unless a
    neighbour is smaller: cubes with a common edge differ by a factor of two at most. Two cubes of one size and an edge between
    them make a tetrahedron with dihedral angles of 60° and 90°, or two where smaller cubes halve the edge. A quarter of a large
    cube's face makes two with each cube's centre. All dihedral angles are 45° or more.

    Parameters
    ----------
    low, high : ndarray, shape (3,)
        Corners of the box (m).
    size : SizeField
        Element size (m).
    finest : float
        Edge of the smallest cubes (m).
    inside : callable
        Points (n, 3) → mask (n,). Cubes with a corner or the centre inside are kept, and those that touch one.

    Returns
    -------
    points : ndarray, shape (n, 3)
        Vertices (m).
    tets : ndarray of int, shape (m, 4)
        Tetrahedra in Netgen's orientation.

    Raises
    ------
    InputError
        Sizes are not positive, need more than `MOST` tetrahedra, or differ by more than 2^`FINEST`.

    References
    ----------
    Labelle & Shewchuk (2007), doi:10.1145/1276377.1276448.

    Examples
    --------
    >>> half, every = lambda x: np.full(len(x), 0.5), lambda x: np.ones(len(x), bool)
    >>> points, tets = body_centred_lattice(np.zeros(3), np.ones(3), half, 0.5, every)
    >>> points.min(axis=0).tolist(), points.max(axis=0).tolist(), len(tets)
    ([-0.5, -0.5, -0.5], [1.5, 1.5, 1.5], 576)
    """
    sizes = size(_grid(low, high, 24))
    if not (sizes > 0).all():
        raise InputError("size", f"{sizes.min():g} m somewhere", "more than 0 everywhere")
    depth = int(np.clip(np.floor(np.log2(COARSER * sizes.max() / finest)), 0, FINEST))
    root = finest * 2**depth
    # A layer of cubes all around, since the outermost ones lack the tetrahedra of their outer faces.
    count = np.ceil((high - low) / root - 1e-9).astype(int) + 2
    origin = (low + high) / 2 - count * root / 2
    leaves = _leaves(count, origin, root, size)
    unit = root / 2 ** len(leaves)  # half the edge of the smallest cubes
    nodes, tets = _stencils(leaves, lambda nodes: inside(origin + unit * nodes))
    if len(tets) > MOST:
        raise InputError("size", f"so small that {len(tets):.2g} tetrahedra result", f"at most {MOST:.2g} of them")
    points = origin + unit * _unpack(nodes)
    x = points[tets]
    flipped = np.linalg.det(x[:, 1:] - x[:, :1]) > 0
    tets[flipped] = tets[flipped][:, [1, 0, 2, 3]]
    return points, tets


def _grid(low: Points, high: Points, n: int) -> Points:
    axes = [np.linspace(a, b, n) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _pack(cells: Cells) -> np.ndarray:
    """Integers (n, 3), -1 at least, packed into one (n,)."""
    cells = cells + 1
    return np.asarray((cells[:, 0] << 2 * _BITS) | (cells[:, 1] << _BITS) | cells[:, 2])


def _unpack(keys: np.ndarray) -> Cells:
    mask = (1 << _BITS) - 1
    return np.stack([keys >> 2 * _BITS, (keys >> _BITS) & mask, keys & mask], axis=1) - 1


def _is_in(keys: np.ndarray, ordered: np.ndarray) -> np.ndarray:
    """Which keys (any shape) occur in a sorted array."""
    if not len(ordered):
        return np.zeros(keys.shape, bool)
    at = np.searchsorted(ordered, keys)
    return np.asarray(ordered[np.minimum(at, len(ordered) - 1)] == keys)


def _leaves(count: np.ndarray, origin: Points, root: float, size: SizeField) -> list[np.ndarray]:
    """Packed leaf cubes, from the largest to the smallest; neighbours differ by a factor of 2 at most."""
    cells = np.stack(np.meshgrid(*(np.arange(n) for n in count), indexing="ij"), axis=-1).reshape(-1, 3)
    halved: list[np.ndarray] = []
    edge = root
    while len(cells):
        if len(halved) > FINEST or count.max() * 2 ** len(halved) > 2 ** (_BITS - 3):
            raise InputError("size", "too different from place to place", f"sizes within a factor of {2**FINEST}")
        middles = origin + edge * (cells[:, None] + 0.25 + 0.5 * _CHILDREN)
        smallest = size(middles.reshape(-1, 3)).reshape(-1, 8).min(axis=1)
        if not (smallest > 0).all():
            raise InputError("size", f"{smallest.min():g} m somewhere", "more than 0 everywhere")
        cells = cells[edge > COARSER * smallest * (1 + 1e-9)]
        if PER_CUBE * 8 * len(cells) > 4 * MOST:  # half of a box may be outside
            raise InputError("size", "so small that too many tetrahedra would result", f"at most {MOST:.2g} of them")
        halved.append(np.sort(_pack(cells)))
        cells = (2 * cells[:, None] + _CHILDREN).reshape(-1, 3)
        edge /= 2
    for k in range(len(halved) - 1, 0, -1):
        cells = _unpack(halved[k])
        near = np.concatenate([cells[:, None], cells[:, None] + _BESIDE], axis=1).reshape(-1, 3)
        near = near[((near >= 0) & (near < count * 2**k)).all(axis=1)]
        halved[k - 1] = np.union1d(halved[k - 1], _pack(near // 2))
    every = np.sort(_pack(np.stack(np.meshgrid(*(np.arange(n) for n in count), indexing="ij"), axis=-1).reshape(-1, 3)))
    leaves = []
    for inner in halved:
        leaves.append(every[~_is_in(every, inner)])
        every = np.sort(_pack((2 * _unpack(inner)[:, None] + _CHILDREN).reshape(-1, 3)))
    return leaves


def _stencils(leaves: list[np.ndarray], inside: Callable[[Cells], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Packed nodes, in halves of the smallest cubes' edges, and tetrahedra of any orientation."""
    deepest = len(leaves) - 1
    steps = [2 ** (deepest - k) for k in range(len(leaves))]  # half an edge, in units of half the smallest
    cells = [_unpack(keys) for keys in leaves]
    own = [
        _pack((2 * s * (c[:, None] + _CHILDREN)).reshape(-1, 3)).reshape(-1, 8)
        for c, s in zip(cells, steps, strict=True)
    ]
    corners, numbers = np.unique(np.concatenate(own), return_inverse=True)
    numbers = numbers.reshape(-1, 8)
    found = inside(np.concatenate([_unpack(corners), *(2 * s * c + s for c, s in zip(cells, steps, strict=True))]))
    near = np.zeros(len(corners), bool)
    near[numbers[found[len(corners) :] | found[numbers].any(axis=1)]] = True
    kept = np.split(near[numbers].any(axis=1), np.cumsum([len(c) for c in cells])[:-1])
    leaves = [keys[keep] for keys, keep in zip(leaves, kept, strict=True)]
    cells = [c[keep] for c, keep in zip(cells, kept, strict=True)]
    tets = []
    for k, (cubes, step) in enumerate(zip(cells, steps, strict=True)):
        middle = 2 * step * cubes + step
        for i, j, m in _TURNS:
            has = _is_in(_pack(cubes + _AXES[i]), leaves[k])
            tets += _between_equals(middle[has], step * _AXES[[i, j, m]], corners)
        if k:
            for i, j, m in _TURNS:
                for way in (-1, 1):
                    beyond = (cubes + way * _AXES[i]) // 2
                    has = _is_in(_pack(beyond), leaves[k - 1]) & (beyond != cubes // 2).any(axis=1)
                    tets += _to_larger(cubes[has], beyond[has], step, (i, j, m), way)
    nodes, numbers = np.unique(np.concatenate(tets), return_inverse=True)
    return nodes, numbers.reshape(-1, 4).astype(np.int32)


def _between_equals(middle: Cells, axes: np.ndarray, corners: np.ndarray) -> list[np.ndarray]:
    """Packed tetrahedra around the line between the centres of neighbouring cubes along the first of `axes`."""
    a, b = _pack(middle), _pack(middle + 2 * axes[0])
    tets = []
    for u, v in ((axes[1], axes[2]), (axes[2], -axes[1]), (-axes[1], -axes[2]), (-axes[2], axes[1])):
        half = middle + axes[0] + u
        p, q, between = _pack(half - v), _pack(half + v), _pack(half)
        split = _is_in(between, corners)
        tets.append(np.stack([a, b, p, q], axis=1)[~split])
        tets += [np.stack([a, b, end, between], axis=1)[split] for end in (p, q)]
    return tets


def _to_larger(cubes: Cells, larger: Cells, step: int, axes: tuple[int, int, int], way: int) -> list[np.ndarray]:
    """Packed tetrahedra between small cubes and the large ones with which they share a quarter of a face."""
    middle, far = 2 * step * cubes + step, 4 * step * larger + 2 * step
    square = middle + way * step * _AXES[axes[0]]
    # From the middle of the large face to its corner: the diagonal that all quarters of the face share with their mirror images.
    out = np.sign(square - far)
    j, m = (step * out * _AXES[axis] for axis in axes[1:])
    inner, outer = _pack(square - j - m), _pack(square + j + m)
    apexes = (_pack(middle), _pack(far))
    return [np.stack([a, inner, outer, _pack(square + s * (j - m))], axis=1) for a in apexes for s in (-1, 1)]
