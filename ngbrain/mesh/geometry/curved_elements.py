"""Second-order tetrahedra that follow the geometry as far as they can without folding."""

from __future__ import annotations

from itertools import combinations, combinations_with_replacement
from math import factorial

import netgen.meshing as meshing
import numpy as np

from ngbrain.errors import InputError

LOWEST = 0.1
"""Smallest Jacobian determinant anywhere in an element, as a part of the element's largest."""
STEP = 1 / 16
"""Step in which the curvature of an edge is reduced."""

_CHUNK = 1 << 12
_EDGES = np.array(list(combinations(range(4), 2)))
"""Netgen's order of the six mid-edge nodes, by the vertices of the edge."""


def curve(mesh: meshing.Mesh) -> int:
    """Place a node on the middle of every edge, on the geometry that the mesh was made from; the mesh is changed in place.

    Where a coarse element would fold, for instance one with two faces on the same smooth surface, the edge that helps most is
    straightened step by step. Neighbours stay conforming, and all other edges keep to the geometry. Call it once, before
    `ngsolve.Mesh(mesh)` and instead of its `Curve`.

    Returns the number of edges that were straightened. Raises `InputError` when an element is inverted while still straight.
    """
    mesh.SecondOrder()
    points = mesh.Coordinates()  # a view of the mesh's memory: writing here moves its nodes
    nodes = mesh.Elements3D().NumPy()["nodes"] - 1
    straight = points.copy()
    straight[nodes[:, 4:]] = points[nodes[:, _EDGES]].mean(axis=2)
    if not (np.linalg.det(straight[nodes[:, 1:4]] - straight[nodes[:, :1]]) < 0).all():  # Netgen's orientation
        raise InputError("mesh sizes", "such that Netgen turns an element inside out", "smaller elements")
    bow, kept = points - straight, np.ones(len(points))
    kept[np.abs(bow).max(axis=1) < 1e-9 * np.ptp(straight, axis=0).max()] = 0  # straight up to rounding
    bowed = kept > 0
    suspects = nodes[bowed[nodes].any(axis=1)]
    while len(folded := suspects[folds(determinants(points[suspects]))]):
        trials = np.repeat(points[folded][None], 6, axis=0)
        for k in range(6):
            trials[k, :, 4 + k] -= STEP * bow[folded[:, 4 + k]]
        gain = determinants(trials.reshape(-1, 10, 3)).min(axis=1).reshape(6, -1).T
        gain[kept[folded[:, 4:]] == 0] = -np.inf
        pulled = np.unique(folded[np.arange(len(folded)), 4 + gain.argmax(axis=1)])
        kept[pulled] -= STEP
        points[pulled] = straight[pulled] + kept[pulled, None] * bow[pulled]
        suspects = nodes[np.isin(nodes, pulled).any(axis=1)]
    return int(np.sum(bowed & (kept < 1)))


def determinants(elements: np.ndarray) -> np.ndarray:
    """Bernstein coefficients (n, 20) of the Jacobian determinant, a cubic polynomial, of ten-node tetrahedra (n, 10, 3).

    The determinant lies between the smallest and the largest coefficient everywhere, so that no fold is missed.
    """
    found = np.empty((len(elements), len(_COEFFICIENTS)))
    for start in range(0, len(elements), _CHUNK):
        x = elements[start : start + _CHUNK].transpose(2, 0, 1)
        a, b, c = (x @ _SLOPES[:, :, j].T for j in range(3))  # (3, n, 20)
        value = (
            a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0])
        )
        found[start : start + _CHUNK] = -value @ _COEFFICIENTS.T
    return found


def folds(coefficients: np.ndarray, lowest: float = LOWEST) -> np.ndarray:
    """Which elements fold or nearly fold.

    Parameters
    ----------
    coefficients : ndarray, shape (n, 20)
        Bernstein coefficients from `determinants`.
    lowest : float
        Smallest coefficient allowed, as a part of the largest.

    Returns
    -------
    ndarray of bool, shape (n,)
        True for a folded element.
    """
    return ~(coefficients.min(axis=1) > lowest * coefficients.max(axis=1))


def _bernstein() -> tuple[np.ndarray, np.ndarray]:
    """Gradients of the shape functions (20, 10, 3) on a lattice; matrix (20, 20) from values to Bernstein coefficients."""
    powers = np.array([np.bincount(c, minlength=4) for c in combinations_with_replacement(range(4), 3)])
    at = powers / 3  # barycentric coordinates
    slopes = np.zeros((20, 10, 4))
    for i in range(4):
        slopes[:, i, i] = 4 * at[:, i] - 1
    for k, (i, j) in enumerate(_EDGES, start=4):
        slopes[:, k, i], slopes[:, k, j] = 4 * at[:, j], 4 * at[:, i]
    weights = [6 / np.prod([factorial(p) for p in row]) for row in powers]
    basis = np.prod(at[:, None] ** powers, axis=2) * weights
    return slopes[:, :, 1:] - slopes[:, :, :1], np.linalg.inv(basis)


_SLOPES, _COEFFICIENTS = _bernstein()
