"""Placement of the white and pial surface between voxels, by the grey values of a scan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage, sparse

from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume
from ngbrain.mesh.surface.cortex import FLUID, Cortex, part_of, thickness
from ngbrain.mesh.surface.smoothing import resolve_intersections
from ngbrain.mesh.surface.triangle_mesh import SurfaceMesh

REACH, STEP = 1.5e-3, 0.1e-3
"""Search range (m) along a vertex normal for the grey value between two tissues, and its step."""
ROUNDS = 3
"""Number of search rounds."""
EVEN = 4
"""Rings of neighbours over which vertex moves are averaged: noise is removed, folds of some millimetres remain."""
AROUND = 8e-3
"""Standard deviation (m) of the window of a tissue's local grey value, which removes the effect of the bias field."""
_FEW = 1e-3
"""Part of the voxels around a place that belong to a tissue, below which the tissue's global grey value dominates."""


def refine_cortex(cortex: Cortex, labels: LabelMap, t1: Volume) -> Cortex:
    """Move the white and pial surfaces to where the scan is halfway between the grey values of the adjacent tissues.

    At a straight edge between two tissues, that is the position of the edge, whatever the partial volumes of the voxels. A vertex
    without such a place within `REACH` of its normal (for example in a sulcus without fluid) moves with its neighbours. Surfaces
    that did not intersect stay free of intersections.

    Parameters
    ----------
    cortex : Cortex
        Surfaces of the labels.
    labels : LabelMap
        Regions as for `ngbrain.mesh.surface.cortex.cortex`, with `grey` or parts of it.
    t1 : Volume
        The scan, on any voxels: white matter brighter than grey matter, and that brighter than fluid.

    Returns
    -------
    Cortex
        The refined surfaces.
    """
    voxels = labels.resample_to_ras(float(labels.volume.spacing.min()))
    names, data = voxels.regions, voxels.volume.data
    matter = [i for i, name in enumerate(names, 1) if part_of(name, "white")]
    grey = [i for i, name in enumerate(names, 1) if part_of(name, "grey")]
    fluid = [i for i, name in enumerate(names, 1) if name == FLUID]
    values = t1.interpolate(voxels.volume.to_world(np.indices(data.shape).reshape(3, -1).T)).reshape(data.shape)
    levels = [_local_grey(values, np.isin(data, numbers), voxels) for numbers in (matter, grey, fluid)]
    moved = {}
    for name, (bright, dark) in (("white", (levels[0], levels[1])), ("pial", (levels[1], levels[2]))):
        surface = cortex.surfaces[name]
        for _ in range(ROUNDS):
            surface = _move(surface, t1, bright, dark)
        moved[name] = surface
    before = list(cortex.surfaces.values())
    after = resolve_intersections(before, [moved.get(name, surface) for name, surface in cortex.surfaces.items()])
    found = dict(zip(cortex.surfaces, after, strict=True))
    white, pial = found["white"], found["pial"]
    return replace(cortex, white=white, pial=pial, thickness=thickness(white, pial))


def _local_grey(values: np.ndarray, mask: np.ndarray, voxels: LabelMap) -> Volume:
    """Local grey value of a tissue everywhere: that of nearby voxels, preferably surrounded by the same tissue."""
    core = ndimage.binary_erosion(mask)
    core = core if core.sum() > 0.02 * mask.sum() else mask
    typical = float(np.median(values[core])) if core.any() else 0.0
    sigma = AROUND / float(voxels.volume.spacing[0])
    weight = ndimage.gaussian_filter(core.astype(np.float32), sigma)
    total = ndimage.gaussian_filter(np.where(core, values - typical, 0).astype(np.float32), sigma)
    return Volume(typical + total / (weight + _FEW), voxels.volume.affine)


def _move(surface: SurfaceMesh, picture: Volume, bright: Volume, dark: Volume) -> SurfaceMesh:
    normals, steps = surface.normals(), np.arange(-REACH, REACH + STEP / 2, STEP)
    half = (bright.interpolate(surface.points) + dark.interpolate(surface.points)) / 2
    at = surface.points[:, None] + steps[:, None] * normals[:, None]
    over = picture.interpolate(at.reshape(-1, 3)).reshape(at.shape[:2]) - half[:, None]
    falls = (over[:, :-1] > 0) & (over[:, 1:] <= 0)
    where = steps[:-1] + STEP * over[:, :-1] / np.where(falls, over[:, :-1] - over[:, 1:], 1.0)
    nearest = np.where(falls, np.abs(where), np.inf).argmin(axis=1)
    met = falls.any(axis=1)
    way = np.where(met, where[np.arange(len(where)), nearest], 0.0)
    joined = surface.adjacency() + sparse.eye_array(len(surface.points))
    weight = met.astype(float)
    way *= weight
    for _ in range(EVEN):
        way, weight = joined @ way, joined @ weight
        scale = np.maximum(weight.max(), 1e-300)
        way, weight = way / scale, weight / scale
    way = np.where(weight > 0, way / np.where(weight > 0, weight, 1.0), 0.0)
    return replace(surface, points=surface.points + way[:, None] * normals)
