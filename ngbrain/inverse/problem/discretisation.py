"""The finite elements in which wave data are inverted: those of the data, or new ones over the same points.

New elements depend on the data:

- In the plane on a full grid: quadrilaterals of order p on cells of p × p data points, so that there are as many unknowns as
  data. For tracked quasi-static displacements with many points: half as many along each axis.
  Large grids of waves are first inverted in larger ones (`coarse_discretisation`).
- Scattered points in the plane: triangles between the points.
- A mask on a grid, and all data in space: quadrilaterals or hexahedra as large as the wavelength allows, over the points of
  the mask.

Property fields have half the order of the displacements; in triangles, and for tracked displacements, order 1.
`mark_driven_boundary` decides which boundaries are driven.
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
from ngbrain.look import BriefText
from ngbrain.mesh.geometry.structured import rectangles

Array = np.ndarray
NEARLY = 100.0
"""K/G from which the pressure is an unknown of its own."""
LOCKING, LOW = 8.0, 2
"""The same for elements of order `LOW`, which lock without pressures. In a block of 64 hexahedra of order 2, G' is lower by .5 %
at K/G = 8, 1.3 % at 19, 4 % at 76 and 5 % at 150; with order 3 by less than .2 % at any K/G. K/G rests on an estimate of G. So the
choice is made where both forms agree; else the result would depend on the estimate."""
LONGEST = 3.0
SHARP = 0.05
"""Border triangles between scattered points are left out where a side is longer than this many median sides, or where they are
sharper than this (rad)."""
LARGEST = 95_000
"""Most displacement unknowns of elements in space, shared ones counted once. 89 424 of a head (101 193 in all) take 9.8 GiB."""


LARGE = 45_000
"""Unknowns and equations of a plane inversion (see `optimise.kkt`) from which coarser elements are inverted in first. With
55 000 a factorisation takes 5 s."""


@dataclass(frozen=True, repr=False)
class Discretisation(BriefText):
    """Finite elements for wave data.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        Mesh in m.
    form : str
        Element pair, as `HarmonicProblem` takes it.
    field_order : int
        Polynomial order of the property fields.
    quadrature : int or None
        Quadrature degree, as `HarmonicProblem` takes it.
    inside : numpy.ndarray
        (n,) bool, which points of the data lie in the mesh.
    nodal : bool
        Whether the points of the data are the vertices of the mesh, in the same order.
    driven_boundaries : str
        Pattern of the boundaries that measured displacements drive. Others are traction-free.
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
        """Half the degree of the quadrature rules over elements."""
        return ElementPair.named(self.form).order + 1 if self.quadrature is None else self.quadrature


def original_discretisation(data: WaveData) -> Discretisation:
    """Return the elements that the data were computed in, as `data.element` says.

    These are bilinear quadrilaterals with a 2 × 2 rule (q4), or the same with constant pressures (q4p0).

    Raises
    ------
    InputError
        The data name no element, or their boundary cannot be driven (see `mark_driven_boundary`).
    """
    if data.element is None:
        raise InputError("element", "not given", "q4 or q4p0, or new elements (fe)")
    grid = data.grid
    assert grid is not None  # WaveData checks it
    lines = [start + step * np.arange(n) for start, step, n in zip(grid.origin, grid.spacing, grid.shape, strict=True)]
    form = {"q4": "Q1", "q4p0": "Q1/L2(0)"}[data.element]
    mesh, driven = mark_driven_boundary(data, rectangles(*lines))
    return Discretisation(mesh, form, 1, 1, np.ones(len(data.points), bool), nodal=True, driven_boundaries=driven)


def discretise(data: WaveData, order: int = 3) -> Discretisation:
    """Build elements over the points of wave data.

    Parameters
    ----------
    data : WaveData
        Waves, or quasi-static displacements.
    order : int
        Polynomial order of the displacements. Pressures are added for nearly incompressible tissue.

    Returns
    -------
    Discretisation
        Elements as the module's description has them.

    Raises
    ------
    InputError
        The points are too scattered, or their boundary cannot be driven (see `mark_driven_boundary`).
    """
    form = element_form(data, order)
    if data.dim == 3:
        return lattice_discretisation(data, build_lattice(data, form, LARGEST))
    grid = data.grid
    if grid is not None and grid.is_axis_aligned and not data.mask.all() and data.frequency.any():
        return lattice_discretisation(data, build_lattice(data, form))
    if grid is not None and grid.is_axis_aligned:
        number = _cells_of_points(data, order)
        fewer = [min(n, max(FEWEST, round(n / COARSER))) for n in number]
        if is_tracked(data) and fewer != number:
            return lattice_discretisation(data, lattice_of_shape(data, fewer, form), 1)
        return lattice_discretisation(data, lattice_of_shape(data, number, form))
    mesh, inside = _triangulate(data.points, data.mask)
    mesh, driven = mark_driven_boundary(data, mesh)
    return Discretisation(mesh, element_form(data, LOW), 1, None, inside, driven_boundaries=driven)


def coarse_discretisation(data: WaveData, order: int = 3) -> Discretisation | None:
    """Build coarser elements for waves in the plane on a large full grid, in which an inversion takes a fraction of the time.

    Its result is a start for the elements of `discretise`.

    Parameters
    ----------
    data : WaveData
        Waves.
    order : int
        Polynomial order of the displacements.

    Returns
    -------
    Discretisation or None
        Elements twice as large, or as large as the wavelength allows where that is less. None for other data, and where
        `discretise` has fewer than `LARGE` unknowns and equations.
    """
    grid = data.grid
    if data.dim == 3 or grid is None or not grid.is_axis_aligned or not data.mask.all() or not data.frequency.any():
        return None
    form, number = element_form(data, order), _cells_of_points(data, order)
    pair = ElementPair.named(form)
    in_cell = data.displacement.shape[2] * pair.order**2 + (0 if pair.pressure is None else (pair.order - 1) ** 2)
    if 4 * len(data.displacement) * in_cell * np.prod(number) < LARGE:
        return None
    least = build_lattice(data, form).cells.shape
    fewer = [min(n, max(round(n / 2), low)) for n, low in zip(number, least, strict=True)]
    return lattice_discretisation(data, lattice_of_shape(data, fewer, form)) if fewer != number else None


def _cells_of_points(data: WaveData, order: int) -> list[int]:
    """Cells along each axis of a full grid, each of order × order points."""
    assert data.grid is not None
    steps = np.rint(np.ptp(data.points[data.mask], axis=0) / data.grid.spacing)
    return [max(1, round(n / order)) for n in steps]


def element_form(data: WaveData, order: int = 3) -> str:
    """Return the element pair for an order, with pressures for nearly incompressible tissue.

    Parameters
    ----------
    data : WaveData
        Their K/G decides (`bulk_ratio`). Anti-plane motion has no pressures.
    order : int
        Polynomial order of the displacements.

    Returns
    -------
    str
        Such as "P3" or "P3/P2".
    """
    mixed = data.motion != "anti_plane" and bulk_ratio(data) > (LOCKING if order == LOW else NEARLY)
    return f"P{order}/P{order - 1}" if mixed else f"P{order}"


def lattice_discretisation(data: WaveData, cells: VoxelLattice, field_order: int | None = None) -> Discretisation:
    """Return the elements of a voxel lattice.

    Parameters
    ----------
    data : WaveData
        Data whose points lie in the lattice. The lattice may cover more points than these.
    cells : VoxelLattice
        The cells.
    field_order : int, optional
        Order of the property fields; by default half the order of the elements.

    Returns
    -------
    Discretisation
        The elements.
    """
    (mesh, driven), inside = mark_driven_boundary(data, cells.mesh), data.mask.copy()
    inside[data.mask] = in_mesh(mesh, data.points[data.mask])
    order = _field_order(ElementPair.named(cells.form).order) if field_order is None else field_order
    return Discretisation(mesh, cells.form, order, None, inside, driven_boundaries=driven)


def _field_order(order: int) -> int:
    return max(1, (order + 1) // 2)


def bulk_ratio(data: WaveData) -> float:
    """Return K/G as far as it is known.

    It follows from Poisson's ratio, or from the bulk modulus over the uniform shear modulus that fits the waves.
    """
    if data.bulk is None:
        nu = float(data.poisson or 0)
        return 2 * (1 + nu) / (3 * (1 - 2 * nu))
    return abs(data.bulk) / uniform_shear(data)


def has_unknown_scale(data: WaveData) -> bool:
    """Whether the data fit all moduli times any common factor alike.

    So it is for quasi-static data of displacements alone. The exception: all components are measured, and a known bulk
    modulus is compressed.
    """
    if data.frequency.any():
        return False
    return data.bulk is None or bulk_ratio(data) > NEARLY or not measures_all_components(data)


def measures_all_components(data: WaveData) -> bool:
    """Whether every component of every load is measured somewhere, not only one along an ultrasound beam."""
    return bool(np.isfinite(data.displacement[:, data.mask]).any(axis=1).all())


def _triangulate(points: Array, mask: Array) -> tuple[ngs.Mesh, Array]:
    """Triangulate the points of a mask without long and sharp triangles; also return which points are in the mesh."""
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
