"""Volume meshes of other programs: reading, checking, conversion and summary."""

from __future__ import annotations

import os
import time
from pathlib import Path

from ngbrain.io.foreign import read_mesh, stated_unit
from ngbrain.mesh import files
from ngbrain.mesh.head_mesh import HeadMesh
from ngbrain.mesh.quality import Quality, volumes_ml
from ngbrain.mesh.routes.registry import min_jacobian

ROUTE = "imported"


def write_imported(
    source: str | os.PathLike[str], path: str | os.PathLike[str], unit: str | None = None, mesh_unit: str = "m"
) -> HeadMesh:
    """Read a mesh of another program and write it in the format of the path's suffix, with `result.json` beside it.

    Parameters
    ----------
    source : str or path-like
        A file that `ngbrain.io.foreign.read_mesh` reads.
    path : str or path-like
        Output file: `.vtkhdf` or a suffix of `ngbrain.io.exchange`.
    unit : str, optional
        Unit of the source's lengths. By default what the source states, otherwise mm.
    mesh_unit : {"m", "mm"}
        Unit of the written mesh.

    Returns
    -------
    HeadMesh
        The mesh with the content of `result.json`.

    Raises
    ------
    InputError
        As `read_mesh` does, and for another suffix.
    """
    path, started = Path(path), time.monotonic()
    files.stem(path)
    files.check_writable(path, mesh_unit)
    unit = unit or stated_unit(source) or "mm"
    made = read_mesh(source, unit)
    low, high = made.points.min(axis=0), made.points.max(axis=0)
    wide = " by ".join(f"{1e3 * side:.0f}" for side in high - low)
    files.write(path, made, ROUTE, unit=mesh_unit)
    result = files.write_result(
        path,
        str(source),
        ROUTE,
        made,
        started,
        notes=[f"lengths are in {unit}: a body of {wide} mm"],
        regions={name: {"volume_ml": ml} for name, ml in volumes_ml(made).items()},
        quality={**Quality.of(made).summary(), "min_jacobian": min_jacobian(made.mesh())},
        shown_mm=(500 * (low + high)).round(2).tolist(),
    )
    return HeadMesh.of(result, made)
