"""Write tetrahedral meshes in the formats of other programs (`ngbrain.io.foreign` reads them): names, unit of length."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError
from ngbrain.mesh.tet_mesh import Elements
from ngbrain.units import UNITS_OF_LENGTH

_FORMATS = {".vtu": "vtu", ".vtk": "vtk", ".msh": "gmsh22", ".inp": "abaqus"}
SUFFIXES = (".vtu", ".vtk", ".msh", ".inp", ".feb", ".vol.gz", ".vol")
"""Suffixes of ParaView (two), Gmsh 2.2, Abaqus, FEBio 4, and Netgen (two)."""
UNITS = ("m", "mm")
"""Units of length of a written mesh."""
STATEMENT = "unit of length:"
"""What precedes the unit in a file: in a comment, of VTK in the title, where 3D Slicer looks for the orientation of the axes."""
_LINE, _ZEROS = 120, bytes(1 << 16)
"""Maximum size (bytes) of a point or an element in Netgen's files, and a block that tests whether the disk has room."""
_POSITIVE = [1, 0, 2, 3]
"""Other programs use tetrahedra with det(b - a, c - a, d - a) > 0, Netgen the opposite."""


def write_mesh(path: str | os.PathLike[str], elements: Elements, unit: str = "m") -> None:
    """Write a mesh atomically, in the format of the file suffix.

    Tetrahedra and boundary triangles keep their names: as physical groups (Gmsh), element sets (Abaqus), parts and surfaces
    (FEBio), materials and boundary conditions (Netgen). VTK has only numbers, `region`: indices into `elements.regions`,
    followed by `elements.boundaries`.

    Parameters
    ----------
    path : str or Path
        Output file with one of `SUFFIXES`, in an existing folder.
    elements : Elements
        The mesh.
    unit : {"m", "mm"}
        Unit of length in the file, which says so; Netgen's files, of which NGSolve computes, are in m.

    Raises
    ------
    InputError
        The suffix or the unit is unknown, or the folder does not exist.

    Examples
    --------
    >>> write_mesh("head.stl", None)
    Traceback (most recent call last):
    ngbrain.errors.InputError: mesh file is 'head.stl'; wanted: .vtu, .vtk, .msh, .inp, .feb, .vol.gz, .vol
    """
    path, suffix = Path(path), mesh_suffix(path)
    check_unit(path, unit)
    if not path.parent.is_dir():
        raise InputError("mesh file", str(path), "a file in a folder that exists")
    write: Callable[[Path, Elements], None] = _write_meshio
    if suffix == ".feb":
        write = _write_febio
    elif suffix in (".vol", ".vol.gz"):
        write = _write_netgen
    if unit != "m":
        elements = replace(elements, points=elements.points / UNITS_OF_LENGTH[unit])

    def write_stated(part: Path) -> None:
        write(part, elements)
        if write is not _write_netgen:
            part.write_bytes(_stated(part.read_bytes(), suffix, f"{STATEMENT} {unit}".encode()))

    atomic_write(path, write_stated)


def check_unit(path: str | os.PathLike[str], unit: str) -> None:
    """Check that a file of this name can be written in a unit of length.

    Parameters
    ----------
    path : str or Path
        Output file.
    unit : str
        Unit of length.

    Raises
    ------
    InputError
        The unit is unknown, or another than m for Netgen's files and `.vtkhdf`.
    """
    allowed = ("m",) if Path(path).name.lower().endswith((".vol", ".vol.gz", ".vtkhdf")) else UNITS
    if unit not in allowed:
        raise InputError("unit of the mesh", repr(unit), f"{' or '.join(allowed)} in {Path(path).name}")


def _stated(data: bytes, suffix: str, statement: bytes) -> bytes:
    """The content of a file with a statement in its head."""
    if suffix == ".msh":
        return b"$Comments\n%s\n$EndComments\n%s" % (statement, data)
    if suffix == ".inp":
        return b"** %s\n%s" % (statement, data)
    first, rest = data.split(b"\n", 1)
    if suffix == ".vtk":
        return b"%s\n%s; SPACE=RAS\n%s" % (first, statement, rest.split(b"\n", 1)[1])
    return b"%s\n<!-- %s -->\n%s" % (first, statement, rest)


def mesh_suffix(path: str | os.PathLike[str]) -> str:
    """The known suffix of a mesh file; `InputError` for others."""
    name = Path(path).name.lower()
    for suffix in SUFFIXES:
        if name.endswith(suffix):
            return suffix
    raise InputError("mesh file", repr(Path(path).name), ", ".join(SUFFIXES))


def _write_meshio(path: Path, elements: Elements) -> None:
    import meshio  # slow to import

    kind = _FORMATS[path.suffix]
    blocks, numbers, sets, groups = [], [], {}, {}
    names = [*elements.regions, *elements.boundaries]
    for i, name in enumerate(names):
        solid = i < len(elements.regions)
        mine = elements.tets[elements.region == i][:, _POSITIVE]
        if not solid:
            mine = elements.triangles[elements.boundary == i - len(elements.regions)]
        if len(mine):
            blocks.append(("tetra" if solid else "triangle", mine))
            numbers.append(np.full(len(mine), i if kind != "gmsh22" else i + 1, np.int32))
            sets[name] = len(blocks) - 1
            groups[name] = np.array([i + 1, 3 if solid else 2])
    mesh = meshio.Mesh(elements.points, blocks)
    if kind == "gmsh22":
        mesh.cell_data = {"gmsh:physical": numbers, "gmsh:geometrical": numbers}
        mesh.field_data = groups
    elif kind == "abaqus":
        mesh.cell_sets = {
            name: [np.arange(len(block.data)) if j == at else np.zeros(0, int) for j, block in enumerate(mesh.cells)]
            for name, at in sets.items()
        }
    else:
        mesh.cell_data = {"region": numbers}
    options = {"binary": False} if kind == "gmsh22" else {}
    meshio.write(path, mesh, file_format=kind, **options)


def _write_netgen(path: Path, elements: Elements) -> None:
    room = _LINE * (len(elements.points) + len(elements.tets) + len(elements.triangles))
    with path.open("wb") as part:  # Netgen does not report a full disk
        for _ in range(0, room, len(_ZEROS)):
            part.write(_ZEROS)
        os.fsync(part.fileno())
    elements.mesh().ngmesh.Save(str(path))


def _write_febio(path: Path, elements: Elements) -> None:
    """FEBio 4: nodes, an element part per region and a surface per boundary; materials and loads are left to the user."""
    with path.open("w", encoding="utf-8") as out:
        out.write(
            '<?xml version="1.0" encoding="UTF-8"?>\n<febio_spec version="4.0">\n\t<Mesh>\n\t\t<Nodes name="all">\n'
        )
        out.writelines(
            f'\t\t\t<node id="{i}">{x:.9g},{y:.9g},{z:.9g}</node>\n'
            for i, (x, y, z) in enumerate(elements.points.tolist(), 1)
        )
        out.write("\t\t</Nodes>\n")
        first = 1
        for i, name in enumerate(elements.regions):
            tets = elements.tets[elements.region == i][:, _POSITIVE] + 1
            out.write(f'\t\t<Elements type="tet4" name={quoteattr(name)}>\n')
            out.writelines(_rows("elem", tets, first, "\t\t\t"))
            out.write("\t\t</Elements>\n")
            first += len(tets)
        for i, name in enumerate(elements.boundaries):
            out.write(f"\t\t<Surface name={quoteattr(name)}>\n")
            out.writelines(_rows("tri3", elements.triangles[elements.boundary == i] + 1, 1, "\t\t\t"))
            out.write("\t\t</Surface>\n")
        out.write("\t</Mesh>\n\t<MeshDomains>\n")
        out.writelines(f'\t\t<SolidDomain name={quoteattr(name)} mat=""/>\n' for name in elements.regions)
        out.write("\t</MeshDomains>\n</febio_spec>\n")


def _rows(tag: str, cells: np.ndarray, first: int, indent: str) -> Iterator[str]:
    for number, nodes in enumerate(cells.tolist(), first):
        yield f'{indent}<{tag} id="{number}">{",".join(map(str, nodes))}</{tag}>\n'
