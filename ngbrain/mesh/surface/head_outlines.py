"""Smooth outlines of a head, its ventricles and lesions, and the repairs that make them surfaces."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.look import BriefText
from ngbrain.mesh.geometry.level_set import LevelSet
from ngbrain.mesh.surface.remeshing import SPECK, RemeshedSurface

BRAIN, VENTRICLES = "brain", "ventricles"
SMOOTHING = 2e-3
"""Standard deviation (m) of the Gaussian that smooths the voxel steps; it removes sulci."""
MARGIN = 8e-3 + 4 * SMOOTHING
AROUND = 4e-3
"""Standard deviation (m) of the window in which ventricles and lesions keep their volume, so that horns remain."""
WALL = 2e-3
"""Smallest tissue thickness (m) between a ventricle and the surface, also where the labels have less."""
LEFT = 0.5
"""Smallest part of a lesion that must remain when it is separated from ventricles and other lesions."""
MOST_CHANGED, MOST_CHANGED_ML = 0.01, 0.2
"""Change of an outline, as a part of the region and, for inner regions, in ml, above which the mesh is not to be used."""
LESION = re.compile("(lesion|tumou?r|metastas[ie]s|cyst|h(a)?ematoma|cavity|resection).*", re.IGNORECASE)
"""Regions with such names get a surface of their own."""


@dataclass(frozen=True)
class Repair:
    """A place where an outline differs from the labels, so that it is a surface.

    Parameters
    ----------
    region : str
        Region of the outline: `brain`, `ventricles` or a lesion.
    kind : str
        "closed" (added to the region), "cut" (removed) or "left out" (a separate component).
    ml : float
        Changed volume (ml).
    at : tuple of float
        Its centre (m).
    """

    region: str
    kind: str
    ml: float
    at: tuple[float, float, float]


def excessive(repairs: Iterable[Repair], volumes_ml: Mapping[str, float]) -> dict[str, float]:
    """Regions whose outline changed too much: by more than 1 % of a region, or by more than 0.2 ml of ventricles or a lesion.

    Parameters
    ----------
    repairs : iterable of Repair
        Repairs of any regions.
    volumes_ml : mapping of str to float
        Region → volume of its labels (ml).

    Returns
    -------
    dict of str to float
        Region → changed volume (ml).

    Examples
    --------
    >>> found = [Repair("ventricles", "cut", 0.15, (0.0, 0.0, 0.0)), Repair("brain", "closed", 0.3, (0.0, 0.0, 0.0))]
    >>> excessive(found, {"ventricles": 20.0, "brain": 1200.0}), excessive(found, {"ventricles": 12.0, "brain": 1200.0})
    ({}, {'ventricles': 0.15})
    """
    total: dict[str, float] = {}
    for repair in repairs:
        total[repair.region] = total.get(repair.region, 0.0) + repair.ml
    return {
        region: ml
        for region, ml in total.items()
        if ml > MOST_CHANGED * volumes_ml.get(region, 0.0) or (region != BRAIN and ml > MOST_CHANGED_ML)
    }


@dataclass(frozen=True, eq=False, repr=False)
class Outlines(BriefText):
    """Smooth signed distances of a head and of the regions inside it.

    Parameters
    ----------
    brain : LevelSet
        The head.
    inner : mapping of str to LevelSet
        Ventricles first, then lesions by name.
    repairs : tuple of Repair
        Where the outlines differ from the labels.
    """

    brain: LevelSet
    inner: Mapping[str, LevelSet]
    repairs: tuple[Repair, ...]

    @property
    def ventricles(self) -> LevelSet | None:
        """Outline of the ventricles; None if there are none."""
        return self.inner.get(VENTRICLES)


def outlines(labels: LabelMap) -> Outlines:
    """Outlines of the largest component of the labelled voxels, with its holes filled, and of the ventricles and lesions in it.

    Ventricles and lesions lie at least `WALL` inside the head and apart from each other. Volumes are those of the labels on
    their own voxels, whatever the resampling to 1 mm makes of them.

    Raises `InputError` where labels contain no head, and for a lesion that is too thin or touches another surface.
    """
    voxels = labels.crop().resample_to_ras()
    own, upright = labels.volumes_ml(), voxels.volumes_ml()
    head, repairs = _head(voxels)
    origin, spacing = voxels.volume.affine[:3, 3], float(voxels.volume.spacing[0])
    volume = head.sum() * spacing**3 * sum(own.values()) / sum(upright.values())
    brain = LevelSet.of(head, origin, spacing, SMOOTHING, MARGIN, volume=volume).solid()
    inner: dict[str, LevelSet] = {}
    lesions = [name for name in voxels.regions if LESION.fullmatch(name)]
    for name in [VENTRICLES] * (VENTRICLES in voxels.regions) + lesions:
        mask = voxels.volume.data == voxels.regions.index(name) + 1
        kept = _remove_specks(mask, voxels.volume.voxel_volume)
        repairs += _repairs(name, "left out", mask & ~kept, voxels.volume.affine)
        if not kept.any():
            continue
        volume = kept.sum() * spacing**3 * own[name] / upright[name]
        plain = LevelSet.of(kept, origin, spacing, SMOOTHING, MARGIN, AROUND, volume)
        grid = plain.origin + spacing * np.indices(plain.values.shape).reshape(3, -1).T
        values = np.maximum(plain.values.ravel(), brain(grid) + WALL)
        for other in inner.values():
            values = np.maximum(values, WALL - other(grid))
        outline = replace(plain, values=values.reshape(plain.values.shape).astype(np.float32))
        if (outline.values < 0).sum() > LEFT * kept.sum():
            inner[name] = outline
            place = np.diag([spacing, spacing, spacing, 1.0])
            place[:3, 3] = plain.origin
            repairs += _repairs(name, "cut", (plain.values < 0) & (outline.values >= 0), place)
        elif name == VENTRICLES:
            repairs += _repairs(name, "left out", kept, voxels.volume.affine)
        else:
            wanted = f"{1e3 * WALL:g} mm between them, one label for both, or the route lattice or conforming"
            raise InputError("labels", f"such that {name} is too thin, or too close to {_others(inner)}", wanted)
    return Outlines(brain, inner, tuple(repairs))


def changes(region: str, surface: RemeshedSurface) -> Iterator[Repair]:
    """Repairs that made a region's outline a surface.

    Parameters
    ----------
    region : str
        Name of the region.
    surface : RemeshedSurface
        The surface.

    Returns
    -------
    iterator of Repair
        One for each changed place.
    """
    for x, y, z, volume in surface.changed.tolist():
        yield Repair(region, "closed" if volume > 0 else "cut", 1e6 * abs(volume), (x, y, z))


def _others(inner: Mapping[str, LevelSet]) -> str:
    return " or ".join([*inner, "the surface"])


def _head(voxels: LabelMap) -> tuple[np.ndarray, list[Repair]]:
    """The largest component of the labelled voxels with its holes; other components are left out."""
    labelled = voxels.volume.data > 0
    pieces, _ = ndimage.label(labelled)
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    largest = pieces == sizes.argmax() if len(sizes) > 1 else labelled
    if largest.sum() * voxels.volume.voxel_volume < 1e-6:
        raise InputError("labels", "less than a millilitre", "a head")
    return ndimage.binary_fill_holes(largest), _repairs(BRAIN, "left out", labelled & ~largest, voxels.volume.affine)


def _remove_specks(mask: np.ndarray, voxel: float) -> np.ndarray:
    pieces, _ = ndimage.label(mask)
    kept = np.bincount(pieces.ravel()) * voxel >= SPECK
    kept[0] = False
    return kept[pieces]


def _repairs(region: str, kind: str, mask: np.ndarray, affine: np.ndarray) -> list[Repair]:
    """One repair for each component of a mask."""
    pieces, count = ndimage.label(mask)
    if not count:
        return []
    ml = np.bincount(pieces.ravel())[1:] * 1e6 * abs(np.linalg.det(affine[:3, :3]))
    middles = np.array(ndimage.center_of_mass(mask, pieces, range(1, count + 1))) @ affine[:3, :3].T + affine[:3, 3]
    return [Repair(region, kind, v, (x, y, z)) for v, (x, y, z) in zip(ml.tolist(), middles.tolist(), strict=True)]
