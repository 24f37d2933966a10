"""Vertex moves that never make a bad tetrahedron."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from ngbrain.mesh.quality import radius_ratios

Points = np.ndarray
ANGLE = 12.0
"""Smallest dihedral angle (degrees) that a move may lead to."""
RATIO = 0.11
"""Smallest radius ratio 3 r_in/r_circ that a move may lead to."""
_HALVINGS = 2
_CHUNK = 1 << 15


def apply_guarded_moves(points: Points, tets: np.ndarray, target: Points) -> tuple[Points, np.ndarray]:
    """Move points to their targets, or a half or a quarter of the way, or not at all, so that no tetrahedron becomes bad.

    All points move at once. In each tetrahedron that is then bad, the point with the longest move goes half the way back, until
    no tetrahedron is bad. This terminates, since a tetrahedron whose points have not moved counts as good.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Points (m).
    tets : ndarray of int, shape (m, 4)
        Tetrahedra in Netgen's orientation.
    target : ndarray, shape (n, 3)
        Target positions (m).

    Returns
    -------
    points : ndarray, shape (n, 3)
        New positions (m).
    arrived : ndarray of bool, shape (n,)
        Which points have reached their target.

    Examples
    --------
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
    """Whether tetrahedra are not inverted and have no dihedral angle below `ANGLE` and no radius ratio below `RATIO`.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Points (m).
    tets : ndarray of int, shape (m, 4)
        Tetrahedra in Netgen's orientation.

    Returns
    -------
    ndarray of bool, shape (m,)
        True for a good tetrahedron.
    """
    found = worst_cosines(points, tets) <= np.cos(np.radians(ANGLE))
    rest = np.flatnonzero(found)
    for part in np.array_split(rest, 1 + len(rest) // _CHUNK):
        found[part] = radius_ratios(points[tets[part]]) >= RATIO
    return np.asarray(found)


def worst_cosines(points: Points, tets: np.ndarray) -> np.ndarray:
    """Cosine of the smallest dihedral angle of each tetrahedron; 2 for an inverted one.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Points.
    tets : ndarray of int, shape (m, 4)
        Tetrahedra.

    Returns
    -------
    ndarray, shape (m,)
        Cosines.

    Examples
    --------
    >>> corner = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1.0]])
    >>> worst_cosines(corner, np.array([[0, 1, 2, 3], [1, 0, 2, 3]])) ** 2
    array([0.33333333, 4. ])
    """
    found = np.empty(len(tets))
    for start in range(0, len(tets), _CHUNK):
        x = points.T[:, tets[start : start + _CHUNK].T]  # components as separate arrays: several times as fast
        a, b, c = (x[:, k] - x[:, 0] for k in (1, 2, 3))
        normals = [_cross(b, c), _cross(c, a), _cross(a, b)]
        right = (a * normals[0]).sum(axis=0) < 0
        normals.append(-(normals[0] + normals[1] + normals[2]))
        normals = [n / np.sqrt(np.maximum((n * n).sum(axis=0), 1e-300)) for n in normals]
        worst = np.maximum.reduce([-(n * m).sum(axis=0) for n, m in combinations(normals, 2)])
        found[start : start + _CHUNK] = np.where(right, worst, 2.0)
    return found


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product of vectors (3, n)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
