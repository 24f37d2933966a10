"""Meshes of a `Geometry` in several sizes, in space and of the plane y = 0 through its site."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import netgen.meshing as meshing
import netgen.occ as occ
import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.image import mni152, read_scan
from ngbrain.image.labelling import label_tissues
from ngbrain.image.segment.tissue_classes import WHITE
from ngbrain.mesh.geometry.primitives import Sizes, idealised_head
from ngbrain.mesh.routes.heads import GREY_MATTER, WHITE_MATTER, mesh_head_of_tissues
from ngbrain.mesh.surface.head_outlines import BRAIN
from ngbrain.mesh.tet_mesh import centres
from ngbrain.reading import check_regular
from ngbrain.reading.hdf5 import check_in_subprocess
from ngbrain.scene import Geometry
from ngbrain.units import LARGEST_BODY

FINER = 2.0
"""Refinement factor of elements at a plate, a lesion or a slot."""
FAR = 0.6
"""Grading of elements away from there (Netgen's)."""


OF_SECTION = ("left", "right", "bottom", "top", "plate", "wall_minus", "wall_plus")
"""Boundaries that a block's section has too."""
CUT = ("left", "right", "front", "back")
"""Sides of a block at which a region of interest is fixed."""
REACH = 3.0
"""Size of a region of interest relative to its contents."""
WORTH = 0.8
"""Fraction of the block's area above which a region of interest has no benefit."""


def region_of_interest(geometry: Geometry) -> Geometry | None:
    """The part of a block around its plate, slot or lesion; None where that would be nearly the whole block.

    Examples
    --------
    >>> region_of_interest(Geometry(kind="block", size=(0.1, 0.1, 0.04), plate=(0.02, 0.02))).size
    (0.06, 0.06, 0.04)
    """
    if geometry.size is None or not (geometry.plate or geometry.slot or geometry.lesion_radius):
        return None
    x, y, z = geometry.size
    plate, slot, ball = geometry.plate or (0.0, 0.0), geometry.slot or (0.0, 0.0), geometry.lesion_radius or 0.0
    # A slot extends through the block along y; its strains reach as far as its depth.
    half_x = max(plate[0] / 2, slot[1], abs(geometry.centre[0]) * bool(ball) + ball)
    half_y = y / 2 if geometry.slot else max(plate[1] / 2, abs(geometry.centre[1]) * bool(ball) + ball)
    smaller = (min(x, 2 * REACH * half_x), min(y, 2 * REACH * half_y), z)
    return replace(geometry, size=smaller) if smaller[0] * smaller[1] < WORTH * x * y else None


class Meshes:
    """Meshes of a geometry; each level halves the elements of the previous one. Round geometries have second order.

    Parameters
    ----------
    geometry : Geometry
    size : float
        Element size (m) at level 0.
    route : str
        Meshing route of a scanned head.

    Examples
    --------
    >>> mesh = Meshes(Geometry(kind="block", size=(0.06, 0.06, 0.04), plate=(0.02, 0.02)), 0.015).mesh(0, plane=True)
    >>> mesh.dim, "plate" in mesh.GetBoundaries()
    (2, True)
    """

    def __init__(self, geometry: Geometry, size: float, route: str = "hull") -> None:
        self.geometry, self.size, self.route = geometry, size, route
        self._coarsest: dict[bool, meshing.Mesh] = {}
        self._made: dict[tuple[int, bool], ngs.Mesh] = {}

    def mesh(self, level: int, plane: bool) -> ngs.Mesh:
        """The mesh of a level.

        Parameters
        ----------
        level : int
            Number of uniform refinements.
        plane : bool
            The section instead of the body in space.

        Returns
        -------
        ngs.Mesh
        """
        if (level, plane) not in self._made:
            self._made[level, plane] = (
                self._head(level) if self.geometry.kind == "idealised" else self._halved(level, plane)
            )
        return self._made[level, plane]

    def refine_elements(self, level: int, plane: bool, marked: np.ndarray) -> ngs.Mesh:
        """A mesh with marked elements halved, and those that conformity requires.

        Parameters
        ----------
        level : int
            Number of uniform refinements.
        plane : bool
            The section instead of the body in space.
        marked : (ne,) bool array

        Returns
        -------
        ngs.Mesh
        """
        mesh = ngs.Mesh(self.mesh(level, plane).ngmesh.Copy())
        for element in mesh.Elements(ngs.VOL):
            mesh.SetRefinementFlag(element, bool(marked[element.nr]))
        if not plane:
            for element in mesh.Elements(ngs.BND):
                mesh.SetRefinementFlag(element, False)
        mesh.Refine()
        if self.geometry.lesion_radius:
            mesh.Curve(2)
        return mesh

    def _head(self, level: int) -> ngs.Mesh:
        return idealised_head(sizes=Sizes(far=self.size / 2**level, grading=FAR))

    def _halved(self, level: int, plane: bool) -> ngs.Mesh:
        if plane not in self._coarsest:
            makers = {"mesh": lambda: _read(self.geometry), "block": lambda: self._block(plane)}
            self._coarsest[plane] = makers.get(
                self.geometry.kind, lambda: scanned_head_mesh(self.geometry, self.size, self.route)
            )()
        mesh = ngs.Mesh(self._coarsest[plane].Copy())
        for _ in range(level):
            mesh.Refine()
        if self.geometry.lesion_radius:
            mesh.Curve(2)
        return mesh

    def _block(self, plane: bool) -> meshing.Mesh:
        shape = _section(self.geometry, self.size) if plane else _block(self.geometry, self.size)
        # On one thread: on a busy machine waiting threads take a hundred times as long as the meshing.
        wanted = meshing.MeshingParameters(maxh=self.size, grading=FAR, optsteps3d=1, parallel_meshing=False)
        return occ.OCCGeometry(shape, dim=2 if plane else 3).GenerateMesh(wanted)


def scanned_head_mesh(geometry: Geometry, size: float, route: str = "hull") -> meshing.Mesh:
    """The head of a scan inside its skull: regions grey, white and ventricles.

    By a route that does not conform to tissues, an element of the brain takes the label at its centre. Sulcal fluid counts as grey
    matter, as in an operation. Refined meshes have the same regions, because their
    elements are parts of these.

    Parameters
    ----------
    geometry : Geometry
    size : float
        Element size (m).
    route : str
        Meshing route.

    Returns
    -------
    netgen.meshing.Mesh
    """
    scan = mni152() if geometry.kind == "mni152" else read_scan(str(geometry.image))
    labels = label_tissues(scan).volume
    mesh = mesh_head_of_tissues(labels, route, size).mesh()
    made = mesh.ngmesh.Copy()
    if BRAIN not in mesh.GetMaterials():
        return made
    numbers = {name: i for i, name in enumerate((GREY_MATTER, WHITE_MATTER, *mesh.GetMaterials()[1:]), 1)}
    white = labels.interpolate(centres(mesh), order=0) == WHITE
    old = [mesh.GetMaterials()[index - 1] for index in np.asarray(made.Elements3D().NumPy()["index"]).tolist()]
    for name, number in numbers.items():
        made.SetMaterial(number, name)
    for element, name, inside in zip(made.Elements3D(), old, white.tolist(), strict=True):
        element.index = numbers[name if name != BRAIN else WHITE_MATTER if inside else GREY_MATTER]
    return made


def _read(geometry: Geometry) -> meshing.Mesh:
    """The mesh of a file; `InputError` for one that is not a mesh in space."""
    file = Path(str(geometry.file))
    check_regular(file, "geometry.file")
    check_in_subprocess(file, "geometry.file", __name__, "read_netgen")  # Netgen crashes on a truncated file
    try:
        mesh = read_netgen(str(file))
    except Exception as error:
        raise InputError("geometry.file", repr(geometry.file), "a mesh that Netgen reads") from error
    if mesh.dim != 3 or not len(mesh.Elements3D()):
        raise InputError("geometry.file", repr(geometry.file), "a mesh in space")
    if geometry.unit == "mm":
        mesh.Scale(1e-3)
    longest = float(np.ptp(mesh.Coordinates(), axis=0).max())
    if not 0 < longest <= LARGEST_BODY:
        found = f"a body of {longest:.4g} m"
        raise InputError(
            "geometry.file", found, f"at most {LARGEST_BODY:g} m in geometry.unit = {geometry.unit!r}", file
        )
    return mesh


def read_netgen(name: str) -> meshing.Mesh:
    """Read a file that Netgen can read."""
    mesh = meshing.Mesh()
    mesh.Load(name)
    ngs.Mesh(mesh)  # crashes too where elements refer to missing points
    return mesh


def _block(geometry: Geometry, cell: float) -> occ.TopoDS_Shape:
    x, y, z = geometry.sides
    body = occ.Box(occ.Pnt(-x / 2, -y / 2, 0), occ.Pnt(x / 2, y / 2, z))
    if geometry.slot:
        width, depth = geometry.slot
        body -= occ.Box(occ.Pnt(-width / 2, -y, z - depth), occ.Pnt(width / 2, y, 2 * z))
    parts = [body]
    if geometry.plate:
        a, b = geometry.plate
        under = occ.Box(occ.Pnt(-a / 2, -b / 2, z - min(a, z) / 2), occ.Pnt(a / 2, b / 2, z))
        parts = [body - under, under]
        parts[1].faces.Max(occ.Z).name = "plate"
    for part in parts:
        part.mat("tissue")
    if geometry.lesion_radius:
        ball = occ.Sphere(occ.Pnt(*geometry.centre), geometry.lesion_radius)
        parts = _with_lesion(geometry, cell, parts, ball, lambda part, name: part.mat(name))
    whole = occ.Glue(parts)
    _sides(geometry, cell, whole.faces, lambda c: (c.x, c.y, c.z))
    return whole


def _section(geometry: Geometry, cell: float) -> occ.TopoDS_Shape:
    x, _, z = geometry.sides
    body = occ.MoveTo(-x / 2, 0).Rectangle(x, z).Face()
    if geometry.slot:
        width, depth = geometry.slot
        body -= occ.MoveTo(-width / 2, z - depth).Rectangle(width, 2 * depth).Face()
    parts = [body]
    if geometry.plate:
        a = geometry.plate[0]
        under = occ.MoveTo(-a / 2, z - min(a, z) / 2).Rectangle(a, min(a, z) / 2).Face()
        parts = [body - under, under]
        parts[1].edges.Max(occ.Y).name = "plate"
    for part in parts:
        part.faces.name = "tissue"
    if geometry.lesion_radius and abs(geometry.centre[1]) < geometry.lesion_radius:
        radius = (geometry.lesion_radius**2 - geometry.centre[1] ** 2) ** 0.5
        disc = occ.WorkPlane().MoveTo(geometry.centre[0], geometry.centre[2]).Circle(radius).Face()

        def named(part: occ.TopoDS_Shape, name: str) -> None:
            part.faces.name = name

        parts = _with_lesion(geometry, cell, parts, disc, named)
    whole = occ.Glue(parts)
    _sides(geometry, cell, whole.edges, lambda c: (c.x, None, c.y))
    return whole


def _with_lesion(
    geometry: Geometry, cell: float, parts: list[occ.TopoDS_Shape], ball: occ.TopoDS_Shape, name: Callable[..., None]
) -> list[occ.TopoDS_Shape]:
    """The parts outside and inside the lesion."""
    rest, inside = [part - ball for part in parts], [part * ball for part in parts]
    for part in rest:
        name(part, "tissue")
    for part in inside:
        name(part, "lesion")
        part.maxh = min(cell / FINER, geometry.lesion_radius or cell)
    return [part for part in (*rest, *inside) if len(part.faces)]


def _sides(geometry: Geometry, cell: float, sides: occ.ListOfShapes, place: Callable[..., tuple]) -> None:
    """Name boundaries by the position of their centre; those of a plate have a name already."""
    for side in sides:
        if side.name != "plate":
            side.name = _side(geometry, *place(side.center))
        if side.name in ("plate", "wall_minus", "wall_plus"):
            side.maxh = cell / FINER


def _side(geometry: Geometry, cx: float, cy: float | None, cz: float) -> str:
    x, y, z = geometry.sides
    rounding = 1e-6 * max(geometry.sides)
    if abs(cz) < rounding:
        return "bottom"
    if abs(cz - z) < rounding:
        return "top"
    for at, low, high, half in ((cx, "left", "right", x / 2), (cy, "front", "back", y / 2)):
        if at is not None and abs(abs(at) - half) < rounding:
            return low if at < 0 else high
    if geometry.slot and abs(abs(cx) - geometry.slot[0] / 2) < rounding:
        return "wall_minus" if cx < 0 else "wall_plus"
    return "inside"
