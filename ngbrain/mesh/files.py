"""Where a mesh goes: a file of our own that keeps every bit, or one of another program's."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import ngsolve as ngs

from ngbrain.errors import InputError
from ngbrain.io import QuadraticGrid, save, versions, write_json
from ngbrain.io.exchange import SUFFIXES, write_mesh
from ngbrain.mesh.tet_mesh import Elements

OWN = ".vtkhdf"


def write(path: Path, elements: Elements, route: str, mesh: ngs.Mesh | None = None) -> None:
    """Write a mesh in the format of the path's suffix, in a folder that is made if need be.

    mesh   the same, curved, for a file of our own
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.name.lower().endswith(OWN):
        save(path, QuadraticGrid(mesh or elements.mesh()), state={"route": route})
    else:
        write_mesh(path, elements)


def write_result(
    path: Path, source: str, route: str, elements: Elements, started: float, **rest: Any
) -> dict[str, Any]:
    """Write result.json beside a mesh: what each has, and the `rest` of this one, which goes before; returns it.

    started   when its making began, by `time.monotonic`
    """
    result = {
        "verb": "mesh",
        "source": source,
        "route": route,
        "notes": [],
        "repairs": [],
        "boundaries": sorted(elements.boundaries),
        "files": [path.name, "result.json"],
        "checks": {"regions_off": {}, "changed_ml": {}},
        **rest,
        "versions": versions(),
        "seed": 0,
        "threads": 1,
        "time_s": time.monotonic() - started,
    }
    write_json(path.with_name("result.json"), result)
    return result


def check_writable(path: Path) -> None:
    """Try the folder, or the one that it would be made in; raises `InputError` for a folder and `OSError` where nothing can be."""
    if path.is_dir():
        raise InputError("-o", repr(str(path)), "a file, not a folder")
    there = next(folder for folder in path.absolute().parents if folder.exists())
    with tempfile.TemporaryFile(dir=there):
        pass


def stem(path: Path) -> str:
    """The name without its suffix; raises `InputError` for one that no mesh is written to."""
    for suffix in (OWN, *SUFFIXES):
        if path.name.lower().endswith(suffix):
            return path.name[: -len(suffix)]
    raise InputError("-o", repr(path.name), "a name that ends in " + ", ".join((OWN, *SUFFIXES)))
