"""Topology of a mesh's boundary: outward normals, adjacency of facets, closedness."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError


def wall(mesh: ngs.Mesh, boundary: str) -> tuple[list[Any], np.ndarray, np.ndarray]:
    """Facets of a boundary, with their centres and outward directions.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    boundary : str
        Name or pattern.

    Returns
    -------
    elements : list
        Boundary elements.
    centres : array (n, dim)
        Their centres (m).
    outward : array (n, dim)
        From the centre of the volume element behind each to its own centre (m).
    """
    corners = np.array([vertex.point for vertex in mesh.vertices])

    def middle(element: Any) -> np.ndarray:
        return corners[[vertex.nr for vertex in element.vertices]].mean(axis=0)

    def facets(element: Any) -> tuple[ngs.NodeId, ...]:
        return element.faces if mesh.dim == 3 else element.edges

    elements = list(mesh.Boundaries(boundary).Elements())
    wanted = {facets(element)[0] for element in elements}
    behind = {facet: middle(e) for e in mesh.Elements() for facet in facets(e) if facet in wanted}
    middles = np.array([middle(element) for element in elements])
    return elements, middles, middles - np.array([behind[facets(element)[0]] for element in elements])


def sides(mesh: ngs.Mesh, elements: Sequence[Any]) -> dict[ngs.NodeId, list[int]]:
    """Boundary elements that share each edge (in the plane: each vertex).

    Parameters
    ----------
    mesh : ngsolve.Mesh
    elements : sequence
        Boundary elements.

    Returns
    -------
    dict
        Edge or vertex → indices in `elements`.
    """
    found: dict[ngs.NodeId, list[int]] = {}
    for i, element in enumerate(elements):
        for side in element.edges if mesh.dim == 3 else element.vertices:
            found.setdefault(side, []).append(i)
    return found


def outward(mesh: ngs.Mesh, boundary: str) -> CoefficientFunction:
    """Outward unit normal of a boundary; the sign of NGSolve's own depends on the orientation of the geometry.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    boundary : str
        Name or pattern.

    Returns
    -------
    CoefficientFunction
    """
    normal = ngs.specialcf.normal(mesh.dim)
    mean = [ngs.Integrate(normal[i], mesh, ngs.BND, element_wise=True).NumPy() for i in range(mesh.dim)]
    sign = ngs.GridFunction(ngs.SurfaceL2(mesh, order=0))
    elements, _, arrows = wall(mesh, boundary)
    for element, arrow in zip(elements, arrows, strict=True):
        sign.vec[element.nr] = np.sign(np.array([m[element.nr] for m in mean]) @ arrow)
    return sign * normal


def surface_normal(mesh: ngs.Mesh) -> CoefficientFunction:
    """Outward unit normal of the whole surface of a mesh; 0 on interfaces between its regions.

    Parameters
    ----------
    mesh : ngsolve.Mesh

    Returns
    -------
    CoefficientFunction
    """
    normal = ngs.specialcf.normal(mesh.dim)
    mean = np.array([ngs.Integrate(normal[i], mesh, ngs.BND, element_wise=True).NumPy() for i in range(mesh.dim)])
    corners = np.array([vertex.point for vertex in mesh.vertices])
    behind: dict[ngs.NodeId, list[np.ndarray]] = {}
    for element in mesh.Elements():
        middle = corners[[vertex.nr for vertex in element.vertices]].mean(axis=0)
        for facet in element.faces if mesh.dim == 3 else element.edges:
            behind.setdefault(facet, []).append(middle)
    sign = ngs.GridFunction(ngs.SurfaceL2(mesh, order=0))
    for element in mesh.Elements(ngs.BND):
        found = behind[(element.faces if mesh.dim == 3 else element.edges)[0]]
        outwards = corners[[vertex.nr for vertex in element.vertices]].mean(axis=0) - found[0]
        sign.vec[element.nr] = np.sign(mean[:, element.nr] @ outwards) if len(found) == 1 else 0.0
    return sign * normal


def check_closed(mesh: ngs.Mesh, boundary: str) -> None:
    """Check that a boundary is closed, by itself or together with the planes x = 0, y = 0 and z = 0.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    boundary : str
        Name or pattern.

    Raises
    ------
    InputError
        If the boundary has a rim off these planes.
    """
    around = sides(mesh, list(mesh.Boundaries(boundary).Elements()))
    nodes = [side for side, having in around.items() if len(having) == 1]
    if mesh.dim == 3:
        nodes = [vertex for edge in nodes for vertex in mesh[edge].vertices]
    rim = np.abs([mesh[node].point for node in nodes]).reshape(-1, mesh.dim)
    size = np.ptp([vertex.point for vertex in mesh.vertices], axis=0).max()
    for point in rim:
        if point.min() > 1e-6 * size:
            found = f"{boundary!r}, open at a distance of {point.min():.3g} from the next"
            raise InputError("cavity", found, "one closed by itself or by the planes x = 0, y = 0, z = 0")
