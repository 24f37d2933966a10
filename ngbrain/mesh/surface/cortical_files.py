"""Files of the white and pial surface of a subject, with the cortical thickness."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume
from ngbrain.io.surfacefile import write_surface, write_values
from ngbrain.mesh.surface.cortex import THICKEST, Cortex, spherical_cortex
from ngbrain.mesh.surface.cortex_refinement import refine_cortex
from ngbrain.mesh.surface.smoothing import crossings


def write_cortex(labels: LabelMap, t1: Volume | None, folder: Path, stem: str) -> dict[str, Any]:
    """Write STEM_white.surf.gii, STEM_pial.surf.gii and STEM_thickness.shape.gii.

    The surfaces are nested spheres of the whole brain, including stem and cerebellum.

    Parameters
    ----------
    labels : LabelMap
        Labels with `white` and `grey`, or parts of them.
    t1 : Volume or None
        The scan whose grey values place the surfaces between voxels; None: surfaces of the labels alone.
    folder : Path
        An existing folder.
    stem : str
        Stem of the file names.

    Returns
    -------
    dict of str to Any
        For a result: area (cm²), volume (ml) and genus of each surface; number of intersecting pairs of triangles; thickness (mm)
        at the white surface, mean over its area and quartiles, where it is at most 5 mm; the files; and the source of placement.

    Raises
    ------
    InputError
        As `spherical_cortex` does.
    """
    found = spherical_cortex(labels)
    if t1 is not None:
        found = refine_cortex(found, labels, t1)
    files = [f"{stem}_white.surf.gii", f"{stem}_pial.surf.gii", f"{stem}_thickness.shape.gii"]
    both = {"white": found.white, "pial": found.pial}
    for file, surface in zip(files, both.values(), strict=False):
        write_surface(folder / file, surface)
    write_values(folder / files[-1], 1e3 * found.thickness, "thickness_mm")
    return {
        **{
            name: {"area_cm2": 1e4 * surface.area, "volume_ml": 1e6 * surface.volume, "genus": surface.genus}
            for name, surface in both.items()
        },
        "crossings": _crossings(found),
        "thickness_mm": _thickness(found),
        "by": "labels alone" if t1 is None else "grey values of the scan",
        "files": files,
    }


def _crossings(cortex: Cortex) -> int:
    white, pial = cortex.white, cortex.pial
    triangles = np.concatenate([white.triangles, pial.triangles + len(white.points)])
    return len(crossings(np.concatenate([white.points, pial.points]), triangles))


def _thickness(cortex: Cortex) -> Mapping[str, float]:
    near = cortex.thickness < THICKEST
    quartiles = np.percentile(cortex.thickness[near], [25, 50, 75]) if near.any() else np.full(3, np.nan)
    low, middle, high = (1e3 * quartiles).tolist()
    return {"mean": 1e3 * cortex.mean_thickness, "p25": low, "median": middle, "p75": high}
