"""Meshes of a `Piece`, in space and of the plane y = 0 through its site."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import netgen.meshing as meshing
import netgen.occ as occ
import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.mesh.shapes import Sizes, idealised_head
from ngbrain.reading import check_regular, tried
from ngbrain.scene.loading import Piece
from ngbrain.units import LARGEST_BODY

FINER = 2.0
"""Elements at a plate, a lesion or a slot are finer by this factor."""
FAR = 0.6
"""Growth of elements away from there (Netgen's grading)."""


OF_SECTION = ("left", "right", "bottom", "top", "plate", "wall_minus", "wall_plus")
"""Boundaries that a block's section has too."""
CUT = ("left", "right", "front", "back")
"""Sides of a block that a region of interest is held at."""
REACH = 3.0
"""A region of interest reaches so many times as far from the middle as what is in it does."""
WORTH = 0.8
"""Part of the block's width from which on there is nothing to gain by one."""


def near(piece: Piece) -> Piece | None:
    """The part of a block around its plate, slot or lesion; None where that is nearly all of it.

    >>> near(Piece(size=(0.1, 0.1, 0.04), plate=(0.02, 0.02))).size, near(Piece())
    ((0.06, 0.06, 0.04), None)
    """
    if piece.shape != "block" or not (piece.plate or piece.slot or piece.lesion):
        return None
    x, y, z = piece.size
    plate, slot, ball = piece.plate or (0.0, 0.0), piece.slot or (0.0, 0.0), piece.lesion or 0.0
    # A slot goes through along y, and is as deep as its strains reach.
    half_x = max(plate[0] / 2, slot[1], abs(piece.at[0]) * bool(ball) + ball)
    half_y = y / 2 if piece.slot else max(plate[1] / 2, abs(piece.at[1]) * bool(ball) + ball)
    smaller = (min(x, 2 * REACH * half_x), min(y, 2 * REACH * half_y), z)
    return replace(piece, size=smaller) if smaller[0] * smaller[1] < WORTH * x * y else None


class Meshes:
    """A piece in elements of `cell`/2^level, of second order where it is round; each level halves the elements of the last.

    >>> mesh = Meshes(Piece(plate=(0.02, 0.02))).at(0, plane=True)
    >>> mesh.dim, "plate" in mesh.GetBoundaries()
    (2, True)
    """

    def __init__(self, piece: Piece) -> None:
        self.piece = piece
        self._coarsest: dict[bool, meshing.Mesh] = {}
        self._made: dict[tuple[int, bool], ngs.Mesh] = {}

    def at(self, level: int, plane: bool) -> ngs.Mesh:
        """In space, or its section."""
        if (level, plane) not in self._made:
            self._made[level, plane] = self._head(level) if self.piece.shape == "head" else self._halved(level, plane)
        return self._made[level, plane]

    def cut(self, level: int, plane: bool, marked: np.ndarray) -> ngs.Mesh:
        """A level's mesh with these elements half as large, and what that takes around them."""
        mesh = ngs.Mesh(self.at(level, plane).ngmesh.Copy())
        for element in mesh.Elements(ngs.VOL):
            mesh.SetRefinementFlag(element, bool(marked[element.nr]))
        if not plane:
            for element in mesh.Elements(ngs.BND):
                mesh.SetRefinementFlag(element, False)
        mesh.Refine()
        if self.piece.lesion:
            mesh.Curve(2)
        return mesh

    def _head(self, level: int) -> ngs.Mesh:
        return idealised_head(sizes=Sizes(far=self.piece.cell / 2**level, grading=FAR))

    def _halved(self, level: int, plane: bool) -> ngs.Mesh:
        if plane not in self._coarsest:
            self._coarsest[plane] = _read(self.piece) if self.piece.shape == "mesh" else self._block(plane)
        mesh = ngs.Mesh(self._coarsest[plane].Copy())
        for _ in range(level):
            mesh.Refine()
        if self.piece.lesion:
            mesh.Curve(2)
        return mesh

    def _block(self, plane: bool) -> meshing.Mesh:
        shape = _section(self.piece, self.piece.cell) if plane else _block(self.piece, self.piece.cell)
        # In one thread: where others work too, those that wait take a hundred times as long as the mesh does.
        wanted = meshing.MeshingParameters(maxh=self.piece.cell, grading=FAR, optsteps3d=1, parallel_meshing=False)
        return occ.OCCGeometry(shape, dim=2 if plane else 3).GenerateMesh(wanted)


def _read(piece: Piece) -> meshing.Mesh:
    """The mesh of a file; `InputError` for one that is none in space."""
    file = Path(str(piece.file))
    check_regular(file, "piece.file")
    tried(file, "piece.file", __name__, "read_netgen")  # Netgen crashes on half a file
    try:
        mesh = read_netgen(str(file))
    except Exception as error:
        raise InputError("piece.file", repr(piece.file), "a mesh that Netgen reads") from error
    if mesh.dim != 3 or not len(mesh.Elements3D()):
        raise InputError("piece.file", repr(piece.file), "a mesh in space")
    longest = float(np.ptp(mesh.Coordinates(), axis=0).max())
    if not 0 < longest <= LARGEST_BODY:
        found = f"a body of {longest:.4g} m"
        raise InputError("piece.file", found, f"coordinates in metres, of at most {LARGEST_BODY:g} m in all", file)
    return mesh


def read_netgen(name: str) -> meshing.Mesh:
    """The mesh of a file of Netgen's, whatever is in it."""
    mesh = meshing.Mesh()
    mesh.Load(name)
    ngs.Mesh(mesh)  # crashes too where elements have points that there are none of
    return mesh


def _block(piece: Piece, cell: float) -> occ.TopoDS_Shape:
    x, y, z = piece.size
    body = occ.Box(occ.Pnt(-x / 2, -y / 2, 0), occ.Pnt(x / 2, y / 2, z))
    if piece.slot:
        width, depth = piece.slot
        body -= occ.Box(occ.Pnt(-width / 2, -y, z - depth), occ.Pnt(width / 2, y, 2 * z))
    parts = [body]
    if piece.plate:
        a, b = piece.plate
        under = occ.Box(occ.Pnt(-a / 2, -b / 2, z - min(a, z) / 2), occ.Pnt(a / 2, b / 2, z))
        parts = [body - under, under]
        parts[1].faces.Max(occ.Z).name = "plate"
    for part in parts:
        part.mat("tissue")
    if piece.lesion:
        ball = occ.Sphere(occ.Pnt(*piece.at), piece.lesion)
        parts = _with_lesion(piece, cell, parts, ball, lambda part, name: part.mat(name))
    whole = occ.Glue(parts)
    _sides(piece, cell, whole.faces, lambda c: (c.x, c.y, c.z))
    return whole


def _section(piece: Piece, cell: float) -> occ.TopoDS_Shape:
    x, _, z = piece.size
    body = occ.MoveTo(-x / 2, 0).Rectangle(x, z).Face()
    if piece.slot:
        width, depth = piece.slot
        body -= occ.MoveTo(-width / 2, z - depth).Rectangle(width, 2 * depth).Face()
    parts = [body]
    if piece.plate:
        a = piece.plate[0]
        under = occ.MoveTo(-a / 2, z - min(a, z) / 2).Rectangle(a, min(a, z) / 2).Face()
        parts = [body - under, under]
        parts[1].edges.Max(occ.Y).name = "plate"
    for part in parts:
        part.faces.name = "tissue"
    if piece.lesion and abs(piece.at[1]) < piece.lesion:
        radius = (piece.lesion**2 - piece.at[1] ** 2) ** 0.5
        disc = occ.WorkPlane().MoveTo(piece.at[0], piece.at[2]).Circle(radius).Face()

        def named(part: occ.TopoDS_Shape, name: str) -> None:
            part.faces.name = name

        parts = _with_lesion(piece, cell, parts, disc, named)
    whole = occ.Glue(parts)
    _sides(piece, cell, whole.edges, lambda c: (c.x, None, c.y))
    return whole


def _with_lesion(
    piece: Piece, cell: float, parts: list[occ.TopoDS_Shape], ball: occ.TopoDS_Shape, name: Callable[..., None]
) -> list[occ.TopoDS_Shape]:
    """The parts without the ball, and what of it lies in them."""
    rest, inside = [part - ball for part in parts], [part * ball for part in parts]
    for part in rest:
        name(part, "tissue")
    for part in inside:
        name(part, "lesion")
        part.maxh = min(cell / FINER, piece.lesion or cell)
    return [part for part in (*rest, *inside) if len(part.faces)]


def _sides(piece: Piece, cell: float, sides: occ.ListOfShapes, place: Callable[..., tuple]) -> None:
    """Names by where the middle of a side lies; those of a plate are there already."""
    for side in sides:
        if side.name != "plate":
            side.name = _side(piece, *place(side.center))
        if side.name in ("plate", "wall_minus", "wall_plus"):
            side.maxh = cell / FINER


def _side(piece: Piece, cx: float, cy: float | None, cz: float) -> str:
    x, y, z = piece.size
    near = 1e-6 * max(piece.size)
    if abs(cz) < near:
        return "bottom"
    if abs(cz - z) < near:
        return "top"
    for at, low, high, half in ((cx, "left", "right", x / 2), (cy, "front", "back", y / 2)):
        if at is not None and abs(abs(at) - half) < near:
            return low if at < 0 else high
    if piece.slot and abs(abs(cx) - piece.slot[0] / 2) < near:
        return "wall_minus" if cx < 0 else "wall_plus"
    return "inside"
