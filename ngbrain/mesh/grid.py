"""Structured meshes of quadrilaterals on the points of a grid: the discretisation that published wave data were made in."""

from __future__ import annotations

from itertools import pairwise

import netgen.meshing as meshing
import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError


def rectangles(x: np.ndarray, y: np.ndarray) -> ngs.Mesh:
    """Quadrilaterals between the lines x and y (m), region `tissue`, boundaries `left`, `right`, `bottom`, `top`.

    Vertices count along x first, so that a nodal field is `values.ravel()` of an array (y, x).
    Raises `InputError` unless both grow and have two values or more.

    >>> mesh = rectangles(np.linspace(0, 0.12, 4), np.linspace(0, 0.12, 3))
    >>> mesh.nv, mesh.ne, mesh.GetBoundaries()
    (12, 6, ('bottom', 'right', 'top', 'left'))
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    for name, lines in (("x", x), ("y", y)):
        if lines.ndim != 1 or len(lines) < 2 or not np.all(np.diff(lines) > 0):
            raise InputError(f"rectangles.{name}", lines, "two growing coordinates or more")
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
