"""Moves of a mesh's points that never make a bad tetrahedron."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from ngbrain.mesh.quality import radius_ratios

Points = np.ndarray
ANGLE = 12.0
"""No move makes a dihedral angle smaller (degrees),"""
RATIO = 0.11
"""nor a radius ratio 3 r_in/r_circ."""
_HALVINGS = 2
_CHUNK = 1 << 15


def apply_guarded_moves(points: Points, tets: np.ndarray, target: Points) -> tuple[Points, np.ndarray]:
    """Points (n, 3) moved to their targets, or a half or a quarter of the way, or not at all; and which (n,) have arrived.

    All move at once; of each tetrahedron (in Netgen's orientation) that is then bad, the point that went farthest goes half
    the way back, until none is bad. That ends, as every tetrahedron whose points have not moved is taken for good.

    >>> points, tets = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1.0]]), np.array([[0, 1, 2, 3]])
    >>> moved, arrived = apply_guarded_moves(points, tets, np.array([[0, 0, 0.1], [0, 1, 0], [1, 0, 0], [0, 0, -1.0]]))
    >>> moved[:, 2].tolist(), arrived.tolist()
    ([0.1, 0.0, 0.0, 0.5], [True, True, True, False])
    """
    moving = (target != points).any(axis=1)
    moved = np.where(moving[:, None], target, points)
    length = np.linalg.norm(moved - points, axis=1)
    tries = np.zeros(len(points), np.int8)
    touched = tets[moving[tets].any(axis=1)]
    while len(touched):
        bad = touched[~good(moved, touched) & (length[touched] > 0).any(axis=1)]
        back = np.unique(bad[np.arange(len(bad)), length[bad].argmax(axis=1)])
        tries[back] += 1
        share = np.where(tries[back] > _HALVINGS, 0, 0.5)
        moved[back] = points[back] + share[:, None] * (moved[back] - points[back])
        length[back] *= share
        changed = np.zeros(len(points), bool)
        changed[back] = True
        touched = tets[changed[tets].any(axis=1)]
    return moved, tries == 0


def good(points: Points, tets: np.ndarray) -> np.ndarray:
    """Which tetrahedra (m,) have no angle below ANGLE and no radius ratio below RATIO, and are not inside out."""
    found = worst_cosines(points, tets) <= np.cos(np.radians(ANGLE))
    rest = np.flatnonzero(found)
    for part in np.array_split(rest, 1 + len(rest) // _CHUNK):
        found[part] = radius_ratios(points[tets[part]]) >= RATIO
    return np.asarray(found)


def worst_cosines(points: Points, tets: np.ndarray) -> np.ndarray:
    """Cosine (n,) of the smallest angle between two faces of each tetrahedron; 2 where one is inside out.

    >>> corner = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1.0]])
    >>> worst_cosines(corner, np.array([[0, 1, 2, 3], [1, 0, 2, 3]])) ** 2
    array([0.33333333, 4. ])
    """
    found = np.empty(len(tets))
    for start in range(0, len(tets), _CHUNK):
        x = points.T[:, tets[start : start + _CHUNK].T]  # components apart: several times as fast
        a, b, c = (x[:, k] - x[:, 0] for k in (1, 2, 3))
        normals = [_cross(b, c), _cross(c, a), _cross(a, b)]
        right = (a * normals[0]).sum(axis=0) < 0
        normals.append(-(normals[0] + normals[1] + normals[2]))
        normals = [n / np.sqrt(np.maximum((n * n).sum(axis=0), 1e-300)) for n in normals]
        worst = np.maximum.reduce([-(n * m).sum(axis=0) for n, m in combinations(normals, 2)])
        found[start : start + _CHUNK] = np.where(right, worst, 2.0)
    return found


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of (3, n)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
