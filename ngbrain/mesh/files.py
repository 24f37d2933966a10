"""Mesh files: the format of this package, which keeps every bit, and the formats of other programs."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import ngsolve as ngs

from ngbrain.errors import InputError
from ngbrain.io import QuadraticGrid, save, versions, write_json
from ngbrain.io.exchange import SUFFIXES, check_unit, write_mesh
from ngbrain.mesh.tet_mesh import Elements

OWN = ".vtkhdf"


def write(path: Path, elements: Elements, route: str, mesh: ngs.Mesh | None = None, unit: str = "m") -> None:
    """Write a mesh in the format of the path's suffix; missing folders are made.

    Parameters
    ----------
    path : Path
        File, `.vtkhdf` or a suffix of `ngbrain.io.exchange`.
    elements : Elements
        The mesh with straight edges.
    route : str
        Name of the meshing route; it is stored in a `.vtkhdf` file.
    mesh : ngsolve.Mesh, optional
        The same mesh with curved elements, for a `.vtkhdf` file.
    unit : str, default "m"
        Unit of length in a file of another program.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.name.lower().endswith(OWN):
        save(path, QuadraticGrid(mesh or elements.mesh()), state={"route": route})
    else:
        write_mesh(path, elements, unit)


def write_result(
    path: Path, source: str, route: str, elements: Elements, started: float, **rest: Any
) -> dict[str, Any]:
    """Write `result.json` beside a mesh.

    Parameters
    ----------
    path : Path
        File of the mesh.
    source : str
        What the mesh was made from.
    route : str
        Name of the meshing route.
    elements : Elements
        The mesh.
    started : float
        Start of the computation, by `time.monotonic` (s).
    **rest
        Further entries; they replace the default ones of the same name.

    Returns
    -------
    dict of str to Any
        The result as written.
    """
    result = {
        "verb": "mesh",
        "source": source,
        "route": route,
        "notes": [],
        "repairs": [],
        "boundaries": sorted(elements.boundaries),
        "files": [path.name, "result.json"],
        "checks": {"volume_errors": {}, "changed_ml": {}},
        **rest,
        "versions": versions(),
        "seed": 0,
        "threads": 1,
        "time_s": time.monotonic() - started,
    }
    write_json(path.with_name("result.json"), result)
    return result


def check_writable(path: Path, unit: str = "m") -> None:
    """Check that a mesh can be written.

    Parameters
    ----------
    path : Path
        Output file.
    unit : str, default "m"
        Unit of length in it.

    Raises
    ------
    InputError
        The path is a folder, or a file of this name cannot be in this unit.
    OSError
        Nothing can be written there.
    """
    try:
        check_unit(path, unit)
    except InputError as wrong:
        raise InputError("--mesh-unit", wrong.value, wrong.wanted) from wrong
    if path.is_dir():
        raise InputError("-o", repr(str(path)), "a file, not a folder")
    there = next(folder for folder in path.absolute().parents if folder.exists())
    with tempfile.TemporaryFile(dir=there):
        pass


def stem(path: Path) -> str:
    """File name without its suffix; raises `InputError` for a suffix without a writer."""
    for suffix in (OWN, *SUFFIXES):
        if path.name.lower().endswith(suffix):
            return path.name[: -len(suffix)]
    raise InputError("-o", repr(path.name), "a name that ends in " + ", ".join((OWN, *SUFFIXES)))
