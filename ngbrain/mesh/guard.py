"""Moves of a mesh's points that never make a tetrahedron bad."""

from __future__ import annotations

from itertools import combinations

import numpy as np

Points = np.ndarray
ANGLE = 10.0
"""Degrees: no move may make a dihedral angle smaller."""
_HALVINGS = 2


def guarded(points: Points, tets: np.ndarray, target: Points, angle: float = ANGLE) -> tuple[Points, np.ndarray]:
    """Points (n, 3) moved to their targets, or a half or a quarter of the way, or not; and which (n,) have arrived."""
    moving = (target != points).any(axis=1)
    moved = np.where(moving[:, None], target, points)
    length = np.linalg.norm(moved - points, axis=1)
    tries = np.zeros(len(points), np.int8)
    touched = np.flatnonzero(moving[tets].any(axis=1))
    limit = np.cos(np.radians(angle))
    while len(touched):
        corners = tets[touched]
        bad = corners[worst_cosines(moved, corners) > limit]
        if not len(bad):
            break
        far = length[bad] * moving[bad]
        back = np.unique(bad[np.arange(len(bad)), far.argmax(axis=1)])
        tries[back] += 1
        stop = tries[back] > _HALVINGS
        moved[back] = np.where(stop[:, None], points[back], (points[back] + moved[back]) / 2)
        length[back] /= 2
        moving[back[stop]] = False
        mask = np.zeros(len(points), bool)
        mask[back] = True
        touched = np.flatnonzero(mask[tets].any(axis=1))
    return moved, tries == 0


def worst_cosines(points: Points, tets: np.ndarray) -> np.ndarray:
    """Cosine (n,) of the smallest angle between two faces; 2 where a tetrahedron is inside out."""
    found = np.empty(len(tets))
    for start in range(0, len(tets), 1 << 15):
        x = points.T[:, tets[start : start + (1 << 15)].T]
        a, b, c = (x[:, k] - x[:, 0] for k in (1, 2, 3))
        normals = [_cross(b, c), _cross(c, a), _cross(a, b)]
        volume = -(a * normals[0]).sum(axis=0)
        normals.append(-(normals[0] + normals[1] + normals[2]))
        for n in normals:
            n /= np.sqrt((n * n).sum(axis=0)) + 1e-300
        worst = np.maximum.reduce([-(n * m).sum(axis=0) for n, m in combinations(normals, 2)])
        found[start : start + (1 << 15)] = np.where(volume > 0, worst, 2.0)
    return found


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
