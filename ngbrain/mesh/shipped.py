"""The meshes that come with the package, by name."""

from __future__ import annotations

from importlib import resources

import netgen.meshing as meshing
import ngsolve as ngs

from ngbrain.errors import InputError, nearest


def load(name: str) -> ngs.Mesh:
    """Load a shipped mesh: "block" (a box of tissue) or "idealised_head" (see `idealised_head`), curved where it was made so.

    Raises `InputError` for another name.

    Examples
    --------
    >>> load("block").GetMaterials()
    ('tissue',)
    """
    folder = resources.files("ngbrain.meshes")
    known = {entry.name.removesuffix(".vol.gz") for entry in folder.iterdir() if entry.name.endswith(".vol.gz")}
    if name not in known:
        raise InputError("mesh", repr(name), nearest(name, known))
    with resources.as_file(folder / f"{name}.vol.gz") as path:
        mesh = meshing.Mesh()
        mesh.Load(str(path))
    mesh.UpdateTopology()  # without it the middle nodes of edges count as vertices
    return ngs.Mesh(mesh)
