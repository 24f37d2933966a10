"""Automatic choice of the finite element: the cheapest adequate one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.forward.common.boundaries import sides, wall
from ngbrain.forward.common.elements import ElementPair

COMPRESSIBLE = 20.0
"""K/μ up to which a displacement element is adequate."""
LARGE = 20_000
"""Number of elements above which P4/L2(2) is too expensive: 700 000 unknowns in 3-D."""
STEEP = 220.0
"""Interior angle (degrees) above which an edge counts as re-entrant and not as part of a faceted curve."""


def choose_element(mesh: ngs.Mesh, ratio: float, fixed: Mapping[str, Any]) -> tuple[ElementPair, str]:
    """Cheapest adequate element, chosen by K/μ and by the regularity of the solution on this mesh.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    ratio : float
        Largest K/μ.
    fixed : dict
        Boundary pattern → constrained components.

    Returns
    -------
    element : ElementPair
    reason : str
    """
    if ratio <= COMPRESSIBLE:
        return ElementPair(2), f"K/μ is {ratio:.3g}, which does not lock quadratic displacements"
    reason = nonsmooth_reason(mesh, fixed)
    if reason:
        return ElementPair(2, 1), f"{reason}: order 4 would gain little on it for its cost"
    return ElementPair(
        4, 2, False
    ), "one region, no re-entrant edges, no clamped boundary that meets a free one: smooth"


def nonsmooth_reason(mesh: ngs.Mesh, fixed: Mapping[str, Any]) -> str:
    """Reason why the solution on a mesh is not smooth.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    fixed : dict
        Boundary pattern → constrained components.

    Returns
    -------
    str
        Empty if the solution can be smooth.
    """
    regions = set(mesh.GetMaterials())
    if len(regions) > 1:
        return f"{len(regions)} regions"
    if mesh.ne > LARGE:
        return f"{mesh.ne} elements"
    faces, meeting, angles = _edges(mesh)
    if np.any(angles > STEEP):
        return f"{np.sum(angles > STEEP)} re-entrant edges"
    names = mesh.GetBoundaries()
    count = [0] * len(names)
    for pattern, components in fixed.items():
        for i, match in enumerate(mesh.Boundaries(pattern).Mask()):
            count[i] |= sum(1 << c for c in components) if match else 0
    bits = np.array(count)[faces]
    full = (1 << mesh.dim) - 1
    first, second = bits[meeting[:, 0]], bits[meeting[:, 1]]
    if np.any(((first == full) & (second == 0)) | ((second == full) & (first == 0))):
        return "a clamped boundary meets a free one"
    return ""


def _edges(mesh: ngs.Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Boundary number of each surface element, pairs of adjacent ones, and the interior angle (°) between each pair."""
    elements, middles, outwards = wall(mesh, ".*")
    corners = np.array([vertex.point for vertex in mesh.vertices])
    normals = np.array([_normal(corners[[v.nr for v in e.vertices]]) for e in elements])
    normals *= np.sign(np.sum(normals * outwards, axis=1))[:, None]
    pairs = np.array([both for both in sides(mesh, elements).values() if len(both) == 2])
    a, b = pairs.T
    turn = np.degrees(np.arccos(np.clip(np.sum(normals[a] * normals[b], axis=1), -1, 1)))
    convex = np.sum((middles[b] - middles[a]) * (normals[b] - normals[a]), axis=1) >= 0
    return np.array([e.index for e in elements]), pairs, 180 + np.where(convex, -turn, turn)


def _normal(points: np.ndarray) -> np.ndarray:
    along = points[1] - points[0]
    normal = np.array([along[1], -along[0]]) if points.shape[1] == 2 else np.cross(along, points[2] - points[0])
    return normal / np.linalg.norm(normal)
