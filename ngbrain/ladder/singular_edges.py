"""Edges with a jump of the prescribed displacement, at which forces diverge under refinement."""

from __future__ import annotations

import re
from itertools import combinations

import ngsolve as ngs
import numpy as np

from ngbrain.scene import DisplacementBC, Scene

SAME = 1e-12
"""Distance (m) within round-off."""


def find_singular_edges(scene: Scene, mesh: ngs.Mesh) -> list[str]:
    """Find edges where adjacent faces have different prescribed displacements; forces on these faces diverge under refinement.

    Parameters
    ----------
    scene : Scene
    mesh : ngs.Mesh

    Returns
    -------
    list of str
        A warning for each pair of faces, if a requested force is on one of them.

    Examples
    --------
    >>> from ngbrain.mesh import block
    >>> from ngbrain.scene import DisplacementBC, Geometry, Quantity, Scene, Tissue
    >>> scene = Scene(
    ...     geometry=Geometry(kind="block", size=(1, 1, 1)),
    ...     tissues=[Tissue(mu=1e3)],
    ...     displacement_bcs=[DisplacementBC(boundary="bottom"), DisplacementBC(boundary="left", value=(-1e-3, 0, 0))],
    ...     quantities=[Quantity(name="force", boundary="left")],
    ... )
    >>> len(find_singular_edges(scene, block()))
    1
    """
    asked = [str(quantity.boundary) for quantity in scene.quantities if quantity.name == "force"]
    found = []
    for one, other in combinations([bc for bc in scene.displacement_bcs if bc.contact == "bonded"], 2):
        felt = any(re.fullmatch(pattern, name) for pattern in asked for name in _names(mesh, one) | _names(mesh, other))
        if felt and _apart(one, other, _shared(mesh, one, other), scene.time.end):
            where = f"{one.boundary} and {other.boundary} meet at an edge with different prescribed displacements"
            found.append(f"{where}: forces on them diverge under mesh refinement")
    return found


def _apart(one: DisplacementBC, other: DisplacementBC, points: np.ndarray, end: float) -> bool:
    """Whether two conditions prescribe different displacements at some points (n, 3)."""
    if not len(points):
        return False
    here, there = (bc.displacement(list(points.T), end, 1.0) for bc in (one, other))
    shared = ["xyz".index(axis) for axis in one.components if axis in other.components]
    return any(bool(np.any(np.abs(here[i] - there[i]) > SAME)) for i in shared)


def _names(mesh: ngs.Mesh, bc: DisplacementBC) -> set[str]:
    return {name for name in mesh.GetBoundaries() if re.fullmatch(bc.boundary, name)}


def _shared(mesh: ngs.Mesh, one: DisplacementBC, other: DisplacementBC) -> np.ndarray:
    """Vertices on both boundaries (n, 3)."""
    numbers = sorted(_vertices(mesh, one) & _vertices(mesh, other))
    return np.array([mesh.vertices[number].point for number in numbers]).reshape(-1, 3)


def _vertices(mesh: ngs.Mesh, bc: DisplacementBC) -> set[int]:
    return {vertex.nr for element in mesh.Boundaries(bc.boundary).Elements() for vertex in element.vertices}
