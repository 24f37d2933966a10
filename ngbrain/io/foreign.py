"""Read tetrahedral meshes of other programs: Gmsh, Abaqus, VTK, FEBio, Netgen, Medit, XDMF."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import netgen.meshing as meshing
import numpy as np

from ngbrain.errors import InputError
from ngbrain.io.abaqus import read_abaqus
from ngbrain.io.exchange import STATEMENT
from ngbrain.mesh.tet_mesh import Elements, named_elements
from ngbrain.units import UNITS_OF_LENGTH

if TYPE_CHECKING:
    import meshio

WIDTHS = (5e-3, 3.0)
"""Smallest and largest plausible extent (m) of a body."""
_CORNERS = {"tetra": 4, "tetra10": 4, "triangle": 3, "triangle6": 3}
_MESHIO = {".msh": "gmsh", ".vtu": "vtu", ".vtk": "vtk", ".mesh": "medit", ".xdmf": "xdmf"}
"""Modules of meshio by suffix."""
SUFFIXES = (*_MESHIO, ".inp", ".feb", ".vol", ".vol.gz")
_OTHER_SOLIDS = ("hexahedron", "wedge", "pyramid")
_NUMBERS = (
    "region",
    "gmsh:physical",
    "gmsh:geometrical",
    "medit:ref",
    "cell_tags",
    "CellEntityIds",
    "MaterialIds",
    "material",
    "label",
)
"""Names of cell data with the region number of a cell."""
_MOST = 255
"""Maximum number of regions of a mesh."""
_FLAT = 1e-12
"""A tetrahedron is flat if its volume, relative to the cube of its longest edge, is below this."""


@dataclass(frozen=True, eq=False)
class _Cells:
    """Cells (n, k) of one type, and the cells of each group, by name."""

    cells: np.ndarray
    groups: Mapping[str, np.ndarray]

    def once(self) -> _Cells:
        """Each cell once; some formats write cells of two groups twice."""
        if not len(self.cells):
            return self
        _, first, number = np.unique(np.sort(self.cells, axis=1), axis=0, return_index=True, return_inverse=True)
        number = number.reshape(-1)
        return _Cells(self.cells[first], {name: np.unique(number[mine]) for name, mine in self.groups.items()})

    def named(self, without: str) -> tuple[np.ndarray, tuple[str, ...]]:
        """Group number of each cell, and the group names; a cell of several groups belongs to the smallest, which is the most
        specific.
        """
        names = sorted(self.groups, key=lambda name: (-len(self.groups[name]), name))
        owner = np.full(len(self.cells), -1)
        for i, name in enumerate(names):
            owner[self.groups[name]] = i
        kept = sorted((names[i] if i >= 0 else without, i) for i in np.unique(owner).tolist())
        table = np.zeros(len(names) + 1, np.int32)
        for place, (_, i) in enumerate(kept):
            table[i] = place  # -1 is the last
        return table[owner], tuple(name for name, _ in kept)


def is_mesh(path: str | os.PathLike[str]) -> bool:
    """Whether a file name is that of a volume mesh.

    >>> is_mesh("head.MSH"), is_mesh("head.nii.gz")
    (True, False)
    """
    return Path(path).name.lower().endswith(SUFFIXES)


def read_mesh(path: str | os.PathLike[str], unit: str | None = None) -> Elements:
    """Read a mesh of straight-edged tetrahedra, each cell once, in m.

    Parameters
    ----------
    path : str or Path
        Gmsh (.msh 2.2 or 4.1), Abaqus (.inp), VTK (.vtu, .vtk), FEBio (.feb), Netgen (.vol, .vol.gz), Medit (.mesh), XDMF
        (.xdmf).
    unit : str, optional
        Unit of length of the file: m, cm, mm or um. By default what the file states (`stated_unit`), otherwise m.

    Returns
    -------
    Elements
        Regions are physical groups (by dimension and number), element sets, parts or materials; numbers without a name become
        `region_1`, …. A cell of several groups belongs to the smallest. Boundaries have the names of the file's groups of
        triangles; other faces between regions and towards the outside are called `outer_REGION` and `REGION_REGION`. Only the
        corners of quadratic elements are kept.

    Raises
    ------
    InputError
        The file cannot be read, holds no tetrahedra, other solids, or flat tetrahedra; it has more than 255 regions; the body
        has an implausible size in this unit, or the file states another.

    Examples
    --------
    >>> read_mesh("head.msh", "inch")
    Traceback (most recent call last):
    ngbrain.errors.InputError: head.msh: unit is 'inch'; wanted: m, cm, mm or um
    """
    path, stated = Path(path), stated_unit(path)
    unit = unit or stated or "m"
    scale = unit_scale(unit, path)
    if not path.is_file():
        raise InputError("mesh file", "missing", "a file", path)
    if stated not in (None, unit):
        raise InputError("unit", repr(unit), f"{stated}, as the file states", path)
    if not is_mesh(path):
        raise InputError("mesh file", f"called {path.name}", f"a name that ends in {', '.join(SUFFIXES)}", path)
    own: dict[str, Callable[[Path], tuple[np.ndarray, _Cells, _Cells]]] = {
        ".inp": _abaqus,
        ".feb": _febio,
        ".vol": _netgen,
        ".gz": _netgen,
    }
    points, solid, flat = own.get(path.suffix.lower(), _meshio)(path)
    if not len(solid.cells):
        raise InputError("mesh file", "without tetrahedra", "tetrahedra with four nodes", path)
    solid, flat = solid.once(), flat.once()
    points = scale * np.asarray(points, float)
    corners = points[solid.cells]
    if not np.isfinite(corners).all():
        raise InputError("mesh file", "with nodes that are not finite", "numbers", path)
    check_width(np.concatenate(corners), unit, path)
    volume = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6
    longest = np.linalg.norm(corners[:, [0, 0, 0, 1, 1, 2]] - corners[:, [1, 2, 3, 2, 3, 3]], axis=2).max(axis=1)
    if bad := int((np.abs(volume) <= _FLAT * longest**3).sum()):
        raise InputError("mesh file", f"with {bad} flat tetrahedra", "a volume above 0 in each", path)
    tets = np.where((volume > 0)[:, None], solid.cells[:, [1, 0, 2, 3]], solid.cells)  # Netgen's orientation
    region, regions = solid.named("region_1" if not solid.groups else "ungrouped")
    if len(regions) > _MOST:
        raise InputError("mesh file", f"with {len(regions)} regions", f"at most {_MOST}", path)
    return _with_boundaries(named_elements(points, tets, region, regions), np.unique(tets), flat)


def stated_unit(path: str | os.PathLike[str]) -> str | None:
    """The unit of length that a mesh file states in its head, as those of `ngbrain.io.exchange` do; None if it does not."""
    try:
        with open(path, "rb") as file:
            found = re.search(rf"{STATEMENT} (\w+)".encode(), file.read(400))
    except OSError:
        return None
    return found.group(1).decode() if found else None


def unit_scale(unit: str, path: Path) -> float:
    """A unit of length in m.

    Parameters
    ----------
    unit : str
        m, cm, mm or um.
    path : Path
        The file, for messages.

    Returns
    -------
    float

    Raises
    ------
    InputError
        The unit is unknown.
    """
    if unit not in UNITS_OF_LENGTH:
        *most, last = UNITS_OF_LENGTH
        raise InputError("unit", repr(unit), f"{', '.join(most)} or {last}", path)
    return UNITS_OF_LENGTH[unit]


def check_width(points: np.ndarray, unit: str, path: Path) -> None:
    """Check that a body has a plausible size; the message names the units in which it would have.

    Parameters
    ----------
    points : numpy.ndarray
        (n, 3) m.
    unit : str
        Unit of length of the file.
    path : Path
        The file, for messages.

    Raises
    ------
    InputError
        The largest extent is outside `WIDTHS`.
    """
    width = float(np.ptp(points, axis=0).max())
    if not WIDTHS[0] <= width <= WIDTHS[1]:
        number = width / UNITS_OF_LENGTH[unit]
        others = [name for name, m in UNITS_OF_LENGTH.items() if WIDTHS[0] <= number * m <= WIDTHS[1]]
        wanted = f"{1e3 * WIDTHS[0]:g} mm to {WIDTHS[1]:g} m" + (
            f", as it is in {' or '.join(others)}" if others else ""
        )
        raise InputError("unit", f"{unit}, in which the body is {width:.3g} m wide", wanted, path)


def _with_boundaries(made: Elements, used: np.ndarray, flat: _Cells) -> Elements:
    """The mesh with the file's boundary names; triangles inside a region are kept if they are faces of tetrahedra."""
    number, names = flat.named("boundary_1" if not flat.groups else "ungrouped_boundary")
    at = np.minimum(np.searchsorted(used, flat.cells), len(used) - 1)
    known = (used[at] == flat.cells).all(axis=1)
    triangles, number = at[known].astype(np.int32), number[known]
    place = {tuple(three): i for i, three in enumerate(np.sort(made.triangles, axis=1).tolist())}
    rows = np.array([place.get(tuple(three), -1) for three in np.sort(triangles, axis=1).tolist()], int)
    called = np.array(made.boundaries, object)[made.boundary]
    called[rows[rows >= 0]] = np.array(names, object)[number[rows >= 0]]
    faces = np.sort(made.tets[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    inner = np.flatnonzero(rows < 0)
    if len(inner):
        every = set(map(tuple, faces.tolist()))
        inner = inner[[tuple(three) in every for three in np.sort(triangles[inner], axis=1).tolist()]]
    called = np.concatenate([called, np.array(names, object)[number[inner]]]).astype(str)
    boundaries, boundary = np.unique(called, return_inverse=True)
    return Elements(
        made.points,
        made.tets,
        made.region,
        np.concatenate([made.triangles, triangles[inner]]),
        boundary.reshape(-1).astype(np.int32),
        made.regions,
        tuple(boundaries.tolist()),
    )


def _meshio(path: Path) -> tuple[np.ndarray, _Cells, _Cells]:
    try:
        kind = _MESHIO[path.suffix.lower()]
        mesh = _vtk(path) if kind == "vtk" else read_format(kind, path)
    except Exception as error:  # damaged files make meshio raise many kinds of exception
        if path.suffix.lower() == ".mesh" and b"P2" in path.read_bytes():
            wanted = "straight ones (in Gmsh: Mesh.ElementOrder = 1), or another format"
            raise InputError("mesh file", "Medit's with elements of second order", wanted, path) from error
        if "'gmsh:physical'" in str(error):
            wanted = "elements of groups alone (in Gmsh: Mesh.SaveAll = 0)"
            raise InputError("mesh file", "with elements in no physical group", wanted, path) from error
        raise InputError("mesh file", f"unreadable ({type(error).__name__} {error})", "a whole file", path) from error
    found = {block.type: len(block.data) for block in mesh.cells}
    _check_tetrahedra_only({kind: n for kind, n in found.items() if kind.startswith(_OTHER_SOLIDS)}, path)
    return (
        mesh.points,
        _group(mesh, ("tetra", "tetra10"), 3, "region"),
        _group(mesh, ("triangle", "triangle6"), 2, "boundary"),
    )


def read_format(kind: str, path: Path) -> meshio.Mesh:
    """Read a file by a module of meshio, which is slow to import (`meshio.read` itself ends the program on errors).

    Parameters
    ----------
    kind : str
        Name of the module, such as "stl".
    path : Path
        The file.

    Returns
    -------
    meshio.Mesh

    Raises
    ------
    ValueError
        meshio does not read the file; other errors of it pass.
    """
    import meshio

    try:
        return getattr(meshio, kind).read(path)
    except meshio.ReadError as error:
        raise ValueError(str(error)) from error


def _vtk(path: Path) -> meshio.Mesh:
    """Read VTK by meshio, which needs a line end after the last binary data, where Gmsh writes none."""
    with tempfile.NamedTemporaryFile(suffix=".vtk") as ended:
        ended.write(path.read_bytes() + b"\n")
        ended.flush()
        return read_format("vtk", Path(ended.name))


def _check_tetrahedra_only(others: Mapping[str, int], path: Path) -> None:
    if others:
        found = ", ".join(f"{n} of type {kind}" for kind, n in others.items())
        raise InputError("mesh file", f"with other elements ({found})", "tetrahedra alone", path)


def _group(mesh: meshio.Mesh, kinds: tuple[str, ...], dimension: int, word: str) -> _Cells:
    """Cells of a dimension, with the groups of this dimension."""
    cells, groups, count = [np.zeros((0, dimension + 1), np.int64)], dict[str, list[np.ndarray]](), 0
    key = _numbering(mesh)
    tagged = mesh.field_data.items() if key == "gmsh:physical" else ()
    names = {(int(tag), int(of)): name for name, (tag, of) in tagged}
    for i, block in enumerate(mesh.cells):
        if block.type not in kinds:
            continue
        data = np.asarray(block.data, np.int64)[:, : _CORNERS[block.type]]
        free = np.ones(len(data), bool)
        for name, members in mesh.cell_sets.items():
            if not name.startswith("gmsh:") and members[i] is not None and len(members[i]):
                mine = np.asarray(members[i], int)
                groups.setdefault(name, []).append(count + mine)
                free[mine] = False
        if key:
            numbers = np.asarray(mesh.cell_data[key][i]).astype(int).ravel()
            for tag in np.unique(numbers[free]).tolist():
                name = names.get((tag, dimension), f"{word}_{tag}")
                groups.setdefault(name, []).append(count + np.flatnonzero(free & (numbers == tag)))
        cells.append(data)
        count += len(data)
    return _Cells(np.concatenate(cells), {name: np.concatenate(mine) for name, mine in groups.items()})


def _numbering(mesh: meshio.Mesh) -> str | None:
    """Name of the cell data that numbers the regions: a known name, or the only data with few integer values."""

    def whole(key: str) -> bool:
        values = np.concatenate([np.asarray(part).reshape(len(part), -1) for part in mesh.cell_data[key]])
        return values.shape[1] == 1 and bool((values == np.rint(values)).all()) and len(np.unique(values)) <= _MOST

    for key in _NUMBERS:
        if key in mesh.cell_data and any(np.any(part) for part in mesh.cell_data[key]):
            return key
    found = [key for key in mesh.cell_data if not key.startswith("gmsh:") and whole(key)]
    return found[0] if len(found) == 1 else None


def _febio(path: Path) -> tuple[np.ndarray, _Cells, _Cells]:
    """FEBio 2.5 to 4: nodes by their ids, parts, surfaces."""
    try:
        root = ElementTree.parse(path).getroot()
        mesh = root.find("Mesh") if root.find("Mesh") is not None else root.find("Geometry")
        if mesh is None:
            raise ValueError("neither Mesh nor Geometry in it")
        nodes = [node for part in mesh.findall("Nodes") for node in part.findall("node")]
        points = np.array([[float(x) for x in (node.text or "").split(",")] for node in nodes]).reshape(-1, 3)
        index = {node.get("id"): i for i, node in enumerate(nodes)}
        solid, flat, others = dict[str, list[list[int]]](), dict[str, list[list[int]]](), dict[str, int]()
        for part in mesh.findall("Elements"):
            kind = part.get("type", "")
            name = part.get("name") or part.get("part") or f"region_{part.get('mat', '1')}"
            if kind.startswith("tet"):
                solid.setdefault(name, []).extend(_nodes(cell, index, 4) for cell in part.findall("elem"))
            elif kind.startswith(("hex", "penta", "pyra")):
                others[kind] = others.get(kind, 0) + len(part)
            elif kind.startswith("tri"):
                flat.setdefault(name, []).extend(_nodes(cell, index, 3) for cell in part.findall("elem"))
        for surface in mesh.findall("Surface"):
            name = surface.get("name", "boundary_1")
            flat.setdefault(name, []).extend(_nodes(cell, index, 3) for cell in surface if cell.tag.startswith("tri"))
    except (ElementTree.ParseError, ValueError, KeyError, OSError) as error:
        raise InputError("mesh file", f"unreadable ({error})", "a mesh of FEBio's", path) from error
    _check_tetrahedra_only(others, path)
    return points, _stack(solid, 4), _stack(flat, 3)


def _abaqus(path: Path) -> tuple[np.ndarray, _Cells, _Cells]:
    found = read_abaqus(path)
    _check_tetrahedra_only(found.others, path)
    if "" in found.solid:
        found.solid["ungrouped" if len(found.solid) > 1 else "region_1"] = found.solid.pop("")
    if "" in found.flat:
        found.flat["ungrouped_boundary" if len(found.flat) > 1 else "boundary_1"] = found.flat.pop("")
    return found.points, _stack(found.solid, 4), _stack(found.flat, 3)


def _nodes(cell: ElementTree.Element, index: Mapping[str | None, int], count: int) -> list[int]:
    return [index[node.strip()] for node in (cell.text or "").split(",")[:count]]


def _stack(parts: Mapping[str, Sequence[Sequence[int]] | np.ndarray], corners: int) -> _Cells:
    ends = np.cumsum([0, *map(len, parts.values())])
    rows = [np.asarray(part, np.int64).reshape(-1, corners) for part in parts.values()]
    cells = np.concatenate([np.zeros((0, corners), np.int64), *rows])
    groups = {name: np.arange(a, b) for name, a, b in zip(parts, ends[:-1].tolist(), ends[1:].tolist(), strict=True)}
    return _Cells(cells, {name: mine for name, mine in groups.items() if len(mine)})


def _netgen(path: Path) -> tuple[np.ndarray, _Cells, _Cells]:
    mesh = meshing.Mesh()
    try:
        mesh.Load(str(path))
    except Exception as error:  # Netgen raises its own exceptions
        raise InputError("mesh file", f"unreadable ({error})", "a mesh of Netgen's", path) from error
    solid, flat = mesh.Elements3D().NumPy(), mesh.Elements2D().NumPy()
    regions = {mesh.GetMaterial(i) or f"region_{i}": solid["index"] == i for i in np.unique(solid["index"]).tolist()}
    faces = {i: mesh.FaceDescriptor(i).bcname for i in np.unique(flat["index"]).tolist()}
    walls = {
        name: np.isin(flat["index"], [i for i, other in faces.items() if other == name]) for name in faces.values()
    }
    parts = ((solid["nodes"][:, :4], regions), (flat["nodes"][:, :3], walls))
    first, second = (
        _Cells(nodes.astype(np.int64) - 1, {name: np.flatnonzero(mine) for name, mine in groups.items()})
        for nodes, groups in parts
    )
    return mesh.Coordinates().copy(), first, second
