"""A mesh's boundary seen from the body: which way is out, what lies side by side, whether it encloses something."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError


def wall(mesh: ngs.Mesh, boundary: str) -> tuple[list[Any], np.ndarray, np.ndarray]:
    """Elements of a boundary, their middles, and for each an arrow from the middle of the body's element behind it."""
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
    """For each edge (in the plane: vertex) of boundary elements the numbers, in their list, of those that have it."""
    found: dict[ngs.NodeId, list[int]] = {}
    for i, element in enumerate(elements):
        for side in element.edges if mesh.dim == 3 else element.vertices:
            found.setdefault(side, []).append(i)
    return found


def outward(mesh: ngs.Mesh, boundary: str) -> CoefficientFunction:
    """Unit normal of a boundary out of the body; NGSolve's own points as its geometry happens to be oriented."""
    normal = ngs.specialcf.normal(mesh.dim)
    mean = [ngs.Integrate(normal[i], mesh, ngs.BND, element_wise=True).NumPy() for i in range(mesh.dim)]
    sign = ngs.GridFunction(ngs.SurfaceL2(mesh, order=0))
    elements, _, arrows = wall(mesh, boundary)
    for element, arrow in zip(elements, arrows, strict=True):
        sign.vec[element.nr] = np.sign(np.array([m[element.nr] for m in mean]) @ arrow)
    return sign * normal


def check_closed(mesh: ngs.Mesh, boundary: str) -> None:
    """Raise `InputError` unless a boundary's rim, if it has one, is on planes x = 0, y = 0 or z = 0."""
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
