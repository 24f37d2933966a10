"""Which elements wave data are inverted in: those they were made in, or our own over the same points.

Our own are, in the plane, quadrilaterals of an order p on cells of p × p data points, so that elements have as many unknowns as
there are data (of many tracked displacements at rest half as many along each axis), and triangles between scattered points; over a
mask on a grid, and in space, quadrilaterals or hexahedra as large as the waves allow, over the points of the mask. A field is
looked for in half that order, in those larger elements in order 1. What drives their boundary is up to the data
(`mark_driven_boundary`).
"""

from __future__ import annotations

from dataclasses import dataclass

import netgen.meshing as meshing
import ngsolve as ngs
import numpy as np
from scipy.spatial import Delaunay

from ngbrain.errors import InputError
from ngbrain.forward.common.elements import ElementPair
from ngbrain.forward.common.interpolation import points_in_mesh as in_mesh
from ngbrain.inverse.data.direct_inversion import uniform_shear
from ngbrain.inverse.data.ultrasound import COARSER, FEWEST, is_tracked
from ngbrain.inverse.problem.boundary_data import ALL, mark_driven_boundary
from ngbrain.inverse.problem.voxel_lattice import VoxelLattice, build_lattice, lattice_of_shape
from ngbrain.io.waves import WaveData
from ngbrain.mesh.geometry.structured import rectangles

Array = np.ndarray
NEARLY = 100.0
"""K/G from which the pressure becomes an unknown."""
LOCKING, LOW = 8.0, 2
"""The same of this order, whose elements stiffen without pressures: in a block of 64 hexahedra of order 2 G' comes out .5 %
lower at K/G = 8, 1.3 % at 19, 4 % at 76 and 5 % at 150, of order 3 by less than .2 % at any. K/G rests on a guess of G, so the
choice has to be made where both forms agree, or the answer hangs on the guess."""
LONGEST = 3.0
SHARP = 0.05
"""Triangles between scattered points are left out at the border when longer than this many median edges, or sharper (rad)."""
LARGEST = 95_000
"""Displacements that elements in space may have, shared ones counted once: 89 424 of a head (101 193 in all) take 9.8 GiB."""


@dataclass(frozen=True)
class Discretisation:
    """Elements for wave data.

    mesh        in m
    form        as `HarmonicProblem` takes it
    fields      order of the fields that are looked for
    quadrature  as `HarmonicProblem` takes it
    inside      (n,) bool, the points in the mesh
    nodal       whether the points are the mesh's vertices, one by one and in their order
    held        pattern of the boundaries that measured displacements drive; others are free of forces
    """

    mesh: ngs.Mesh
    form: str
    field_order: int
    quadrature: int | None
    inside: Array
    nodal: bool = False
    driven_boundaries: str = ALL

    @property
    def degree(self) -> int:
        """Half the degree of the rules of integrals over elements."""
        return ElementPair.named(self.form).order + 1 if self.quadrature is None else self.quadrature


def original_discretisation(data: WaveData) -> Discretisation:
    """The elements `data.element` of the grid that the data were computed on: bilinear, with a 2×2 rule; q4p0 with pressures.

    Raises `InputError` when the data name none, and for a boundary that cannot be driven so, see `mark_driven_boundary`.
    """
    if data.element is None:
        raise InputError("element", "not given", "q4 or q4p0, or a discretisation of our own (fe)")
    grid = data.grid
    assert grid is not None  # WaveData has seen to it
    lines = [start + step * np.arange(n) for start, step, n in zip(grid.origin, grid.spacing, grid.shape, strict=True)]
    form = {"q4": "Q1", "q4p0": "Q1/L2(0)"}[data.element]
    mesh, driven = mark_driven_boundary(data, rectangles(*lines))
    return Discretisation(mesh, form, 1, 1, np.ones(len(data.points), bool), nodal=True, driven_boundaries=driven)


def discretise(data: WaveData, order: int = 3) -> Discretisation:
    """Elements of our own, of an order; one with pressures for nearly incompressible tissue.

    Raises `InputError` for points that are too scattered, and for a boundary that cannot be driven so, see `mark_driven_boundary`.
    """
    form = element_form(data, order)
    if data.dim == 3:
        return lattice_discretisation(data, build_lattice(data, form, LARGEST))
    grid = data.grid
    if grid is not None and grid.is_axis_aligned and not data.mask.all() and data.frequency.any():
        return lattice_discretisation(data, build_lattice(data, form))
    if grid is not None and grid.is_axis_aligned:
        steps = np.rint(np.ptp(data.points[data.mask], axis=0) / grid.spacing)
        number = [max(1, round(n / order)) for n in steps]
        fewer = [min(n, max(FEWEST, round(n / COARSER))) for n in number]
        if is_tracked(data) and fewer != number:
            return lattice_discretisation(data, lattice_of_shape(data, fewer, form), 1)
        return lattice_discretisation(data, lattice_of_shape(data, number, form))
    mesh, inside = _between(data.points, data.mask)
    mesh, driven = mark_driven_boundary(data, mesh)
    return Discretisation(mesh, element_form(data, LOW), 1, None, inside, driven_boundaries=driven)


def element_form(data: WaveData, order: int = 3) -> str:
    """Elements of an order in words, with pressures for nearly incompressible tissue; motion through a plane has none."""
    mixed = data.motion != "anti_plane" and bulk_ratio(data) > (LOCKING if order == LOW else NEARLY)
    return f"P{order}/P{order - 1}" if mixed else f"P{order}"


def lattice_discretisation(data: WaveData, cells: VoxelLattice, fields: int | None = None) -> Discretisation:
    """The elements of a lattice, which may be of more points than these; fields by default of half their order."""
    (mesh, driven), inside = mark_driven_boundary(data, cells.mesh), data.mask.copy()
    inside[data.mask] = in_mesh(mesh, data.points[data.mask])
    fields = _fields(ElementPair.named(cells.form).order) if fields is None else fields
    return Discretisation(mesh, cells.form, fields, None, inside, driven_boundaries=driven)


def _fields(order: int) -> int:
    return max(1, (order + 1) // 2)


def bulk_ratio(data: WaveData) -> float:
    """K/G as far as the data say: by Poisson's ratio, or a bulk modulus over the one shear modulus that fits the waves."""
    if data.bulk is None:
        nu = float(data.poisson or 0)
        return 2 * (1 + nu) / (3 * (1 - 2 * nu))
    return abs(data.bulk) / uniform_shear(data)


def has_unknown_scale(data: WaveData) -> bool:
    """Whether all moduli times any number move the body alike, as far as data tell.

    So at rest with nothing but displacements known, unless all components of them are and a known bulk modulus is compressed.
    """
    if data.frequency.any():
        return False
    return data.bulk is None or bulk_ratio(data) > NEARLY or not measures_all_components(data)


def measures_all_components(data: WaveData) -> bool:
    """Whether every component of every load is measured somewhere, not along the axis of ultrasound alone."""
    return bool(np.isfinite(data.displacement[:, data.mask]).any(axis=1).all())


def _between(points: Array, mask: Array) -> tuple[ngs.Mesh, Array]:
    """Triangles between the points of a mask, without the long and sharp ones, and which points are on them."""
    chosen = np.flatnonzero(mask)
    at = points[chosen]
    triangles = Delaunay(at).simplices
    corners = at[triangles]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    double = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    longest = edges.max(axis=1)
    kept = (longest < LONGEST * np.median(edges)) & (np.abs(double) > SHARP * longest**2)
    triangles, turned = triangles[kept], double[kept] < 0
    triangles[turned] = triangles[turned][:, ::-1]
    used = np.unique(triangles)
    if len(used) < 3:
        raise InputError("points", "too scattered", "points of which neighbours are about equally far apart")
    made = meshing.Mesh(dim=2)
    node = {int(i): made.Add(meshing.MeshPoint(meshing.Pnt(*at[i], 0))) for i in used}
    tissue = made.AddRegion("tissue", 2)
    for triangle in triangles:
        made.Add(meshing.Element2D(tissue, [node[int(i)] for i in triangle]))
    sides = np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    _, first, count = np.unique(np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True)
    edge = made.AddRegion("hull", 1)
    for a, b in sides[first[count == 1]]:
        made.Add(meshing.Element1D([node[int(a)], node[int(b)]], index=edge))
    inside = np.zeros(len(points), bool)
    inside[chosen[used]] = True
    return ngs.Mesh(made), inside
