"""Structured meshes: quadrilaterals on a grid of points (as in published wave data) or of cells, and hexahedra.

Boundaries of such meshes with straight sides can be renamed.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import netgen.meshing as meshing
import ngsolve as ngs
import numpy as np

from ngbrain.arguments import numbers
from ngbrain.errors import InputError


def rectangles(x: np.ndarray, y: np.ndarray, cells: np.ndarray | None = None) -> ngs.Mesh:
    """Quadrilaterals between grid lines: region `tissue`, boundaries `left`, `right`, `bottom`, `top`.

    Vertices are numbered along x first, so that a nodal field is `values.ravel()` of an array (y, x).

    Parameters
    ----------
    x, y : ndarray, shape (n,) and (m,)
        Increasing coordinates of the grid lines (m).
    cells : ndarray of bool, shape (n - 1, m - 1), optional
        Cells to keep; their boundary is then `hull`. None: all cells.

    Returns
    -------
    ngsolve.Mesh
        The mesh.

    Raises
    ------
    InputError
        Coordinates do not increase or are fewer than two, or no cell is chosen.

    Examples
    --------
    >>> mesh = rectangles(np.linspace(0, 0.12, 4), np.linspace(0, 0.12, 3))
    >>> mesh.nv, mesh.ne, mesh.GetBoundaries()
    (12, 6, ('bottom', 'right', 'top', 'left'))
    """
    x, y = (numbers(f"rectangles.{name}", lines, (None,)) for name, lines in (("x", x), ("y", y)))
    for name, lines in (("x", x), ("y", y)):
        if len(lines) < 2 or not np.all(np.diff(lines) > 0):
            raise InputError(f"rectangles.{name}", lines, "two growing coordinates or more")
    if cells is not None:
        return _mesh_cells(_check_cells("rectangles", cells, (len(x), len(y))), (x, y))
    made = meshing.Mesh(dim=2)
    node = [[made.Add(meshing.MeshPoint(meshing.Pnt(a, b, 0))) for a in x] for b in y]
    tissue = made.AddRegion("tissue", 2)
    for low, high in pairwise(node):
        for i in range(len(x) - 1):
            made.Add(meshing.Element2D(tissue, [low[i], low[i + 1], high[i + 1], high[i]]))
    left, right = [row[0] for row in node], [row[-1] for row in node]
    for name, line in (("bottom", node[0]), ("right", right), ("top", node[-1][::-1]), ("left", left[::-1])):
        edge = made.AddRegion(name, 1)
        for a, b in pairwise(line):
            made.Add(meshing.Element1D([a, b], index=edge))
    return ngs.Mesh(made)


_CORNERS = {
    2: np.array([(0, 0), (1, 0), (1, 1), (0, 1)]),
    3: np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]),
}
_SIDES = {
    2: ((0, 1), (1, 2), (2, 3), (3, 0)),
    3: ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}


def boxes(cells: np.ndarray, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> ngs.Mesh:
    """Hexahedra in chosen cells of a grid: region `tissue`, boundary `hull`.

    Parameters
    ----------
    cells : ndarray of bool, shape (nx - 1, ny - 1, nz - 1)
        Cells to keep.
    x, y, z : ndarray
        Increasing coordinates of the grid planes (m).

    Returns
    -------
    ngsolve.Mesh
        The mesh.

    Raises
    ------
    InputError
        Coordinates do not increase or are fewer than two, or no cell is chosen.

    Examples
    --------
    >>> cells = np.ones((3, 2, 2), bool); cells[0, 0, 0] = False
    >>> mesh = boxes(cells, np.arange(4.0), np.arange(3.0), np.arange(3.0))
    >>> mesh.ne, mesh.nv, round(ngs.Integrate(1, mesh), 9)
    (11, 35, 11.0)
    """
    planes = [numbers(f"boxes.{name}", lines, (None,)) for name, lines in zip("xyz", (x, y, z), strict=True)]
    for name, lines in zip("xyz", planes, strict=True):
        if len(lines) < 2 or not np.all(np.diff(lines) > 0):
            raise InputError(f"boxes.{name}", lines, "two growing coordinates or more")
    return _mesh_cells(_check_cells("boxes", cells, tuple(len(lines) for lines in planes)), planes)


def _check_cells(name: str, cells: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Cells as bool, one fewer along each axis than planes."""
    wanted = f"some of {tuple(n - 1 for n in shape)}"
    try:
        cells = np.asarray(cells, bool)
    except ValueError as error:  # sequences of several lengths
        raise InputError(f"{name}.cells", "of uneven lengths", wanted) from error
    if cells.shape != tuple(n - 1 for n in shape) or not cells.any():
        raise InputError(f"{name}.cells", f"{int(cells.sum())} of {cells.shape}", wanted)
    return cells


def _mesh_cells(cells: np.ndarray, planes: Sequence[np.ndarray]) -> ngs.Mesh:
    """Quadrilaterals or hexahedra in the chosen cells; vertices are numbered along the last axis first."""
    d, shape = cells.ndim, tuple(n + 1 for n in cells.shape)
    corners = np.argwhere(cells)[:, None] + _CORNERS[d]
    used, elements = np.unique(np.ravel_multi_index(tuple(corners.reshape(-1, d).T), shape), return_inverse=True)
    elements = elements.reshape(len(corners), -1)
    made = meshing.Mesh(dim=d)
    at = np.zeros((len(used), 3))
    at[:, :d] = np.column_stack([lines[i] for lines, i in zip(planes, np.unravel_index(used, shape), strict=True)])
    node = [made.Add(meshing.MeshPoint(meshing.Pnt(*point))) for point in at]
    tissue, hull = made.AddRegion("tissue", d), made.AddRegion("hull", d - 1)
    for each in elements:
        corner = [node[i] for i in each]
        made.Add(meshing.Element3D(tissue, corner) if d == 3 else meshing.Element2D(tissue, corner))
    sides = np.concatenate([elements[:, side] for side in _SIDES[d]])
    _, first, count = np.unique(np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True)
    for side in sides[first[count == 1]]:
        corner = [node[i] for i in side]
        made.Add(meshing.Element2D(hull, corner) if d == 3 else meshing.Element1D(corner, index=hull))
    return ngs.Mesh(made)


def with_boundaries(mesh: ngs.Mesh, names: Sequence[str]) -> ngs.Mesh:
    """Copy a mesh with straight sides under other boundary names.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        The mesh.
    names : sequence of str
        One name for each boundary element, in their order.

    Returns
    -------
    ngsolve.Mesh
        The copy.

    Raises
    ------
    InputError
        The number of names is another.

    Examples
    --------
    >>> mesh = rectangles(np.arange(3.0), np.arange(2.0))
    >>> again = with_boundaries(mesh, ["a", "a", "b", "a", "a", "a"])
    >>> again.GetBoundaries(), again.nv, ngs.Integrate(1, again.Boundaries("b"))
    (('a', 'b'), 6, 1.0)
    """
    old, d = mesh.ngmesh, mesh.dim
    sides, cells = (old.Elements1D(), old.Elements2D()) if d == 2 else (old.Elements2D(), old.Elements3D())
    if len(names) != len(sides):
        raise InputError("names", f"{len(names)} of them", f"{len(sides)}, one for each element of the boundary")
    made = meshing.Mesh(dim=d)
    node = [made.Add(meshing.MeshPoint(meshing.Pnt(*point.p))) for point in old.Points()]
    cell, side = (meshing.Element2D, meshing.Element1D) if d == 2 else (meshing.Element3D, meshing.Element2D)
    regions = [made.AddRegion(name, d) for name in mesh.GetMaterials()]
    for element in cells:
        made.Add(cell(regions[element.index - 1], [node[v.nr - 1] for v in element.vertices]))
    edges = {name: made.AddRegion(name, d - 1) for name in dict.fromkeys(names)}
    for name, element in zip(names, sides, strict=True):
        corners = [node[v.nr - 1] for v in element.vertices]
        made.Add(side(corners, index=edges[name]) if d == 2 else side(edges[name], corners))
    return ngs.Mesh(made)
