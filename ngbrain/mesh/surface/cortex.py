"""The cortex between the white and the pial surface, with the ventricles inside and the outer surface around."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.segment.topology_correction import NEIGHBOURS, correct_topology, largest_filled_component
from ngbrain.look import BriefText
from ngbrain.mesh.surface.mask_surface import contour
from ngbrain.mesh.surface.smoothing import smooth_surfaces
from ngbrain.mesh.surface.triangle_mesh import SurfaceMesh

WHITE = ("white", "corpus_callosum", "deep_grey", "brain_stem", "ventricles")
"""Regions inside the white surface, and their parts: `white_left`, `deep_grey_right`, …"""
FLUID = "csf"
"""The only region outside the pial surface."""
SPECK = 0.1e-6
"""Volume (m³) below which a component of the ventricles is removed."""
STEPS = 10
"""Smoothing steps of the triangles."""
THICKEST = 5e-3
"""Distance (m) from the pial surface beyond which the white surface does not lie under cortex."""
_CUBE = np.ones((3, 3, 3), bool)


@dataclass(frozen=True, eq=False, repr=False)
class Cortex(BriefText):
    """Nested closed surfaces that do not intersect.

    Parameters
    ----------
    white : SurfaceMesh
        Surface of the regions in `WHITE` (m).
    pial : SurfaceMesh
        Surface of all tissue (m).
    outer : SurfaceMesh
        Surface of everything (m).
    ventricles : SurfaceMesh or None
        Surface of the ventricles inside white matter (m); None where the labels have none.
    thickness : ndarray, shape (n,)
        Cortical thickness (m) at the vertices of `white`: the mean of the distance to `pial` and of the distance back from the
        point reached. It is too large where the labels show no fluid between the two banks of a sulcus, and is not cortical
        thickness at ventricles, brain stem and deep grey matter.
    voxels : dict of str to float
        Surface → volume (m³) of the voxels that it should enclose.
    moved : dict of str to int
        Surface → number of voxels on another side of it than their labels say: islands, cavities, cut handles, and voxels added
        or removed to keep a distance of one voxel to the next surface.

    References
    ----------
    Thickness: Fischl & Dale (2000), doi:10.1073/pnas.200033797.
    """

    white: SurfaceMesh
    pial: SurfaceMesh
    outer: SurfaceMesh
    ventricles: SurfaceMesh | None
    thickness: np.ndarray
    voxels: dict[str, float] = field(default_factory=dict)
    moved: dict[str, int] = field(default_factory=dict)

    @property
    def surfaces(self) -> dict[str, SurfaceMesh]:
        """Name → surface, from inside to outside."""
        named = {"ventricles": self.ventricles, "white": self.white, "pial": self.pial, "outer": self.outer}
        return {name: surface for name, surface in named.items() if surface is not None}

    @property
    def mean_thickness(self) -> float:
        """Mean thickness (m) over the white surface's area, without values above `THICKEST`."""
        area = self.white.vertex_areas() * (self.thickness < THICKEST)
        return float(self.thickness @ area / area.sum()) if area.any() else float("nan")


def cortex(labels: LabelMap) -> Cortex:
    """Extract the cortical surfaces of a label map, with the map's topology: `SurfaceMesh.genus` counts the handles.

    Masks nested with a distance of at least one voxel are triangulated with the same topology (`contour`), so that no two
    surfaces intersect, and smoothed as far as they stay free of intersections (`smooth_surfaces`). Where tissue has no fluid
    around it, the outer surface is moved outwards by one voxel. Where white matter or a ventricle touches the fluid, its surface
    is moved inwards by one voxel.

    Raises
    ------
    InputError
        Labels have no `white` or parts of it (`white_left`, …), or nothing around the white matter.

    Examples
    --------
    >>> from ngbrain.image.read.volume import Volume
    >>> away = np.linalg.norm(np.indices((41, 41, 41)) - 20, axis=0)
    >>> numbers = (away < 18).astype(int) + (away < 15) + (away < 12)
    >>> labels = LabelMap(Volume(numbers, np.diag([1e-3, 1e-3, 1e-3, 1])), {1: "csf", 2: "grey", 3: "white"})
    >>> found = cortex(labels)
    >>> found.white.genus, found.pial.genus, round(1e3 * found.mean_thickness, 1)
    (0, 0, 3.0)
    """
    return _extract(labels, spheres=False)


def spherical_cortex(labels: LabelMap) -> Cortex:
    """Extract the cortical surfaces as spheres: as `cortex`, after handles of the masks are cut (`ball`).

    Raises
    ------
    InputError
        As `cortex` does.

    Examples
    --------
    >>> from ngbrain.image.read.volume import Volume
    >>> away = np.linalg.norm(np.indices((31, 31, 31)) - 15, axis=0)
    >>> numbers = (away < 13).astype(int) + (away < 8)
    >>> numbers[15, 15] = 1  # a channel through the white matter
    >>> labels = LabelMap(Volume(numbers, np.diag([1e-3, 1e-3, 1e-3, 1])), {1: "grey", 2: "white"})
    >>> cortex(labels).white.genus, spherical_cortex(labels).white.genus
    (1, 0)
    """
    return _extract(labels, spheres=True)


def _extract(labels: LabelMap, spheres: bool) -> Cortex:
    voxels = labels.resample_to_ras(float(labels.volume.spacing.min()))
    masks, moved = _masks(voxels, spheres)
    spacing, origin = voxels.volume.spacing, voxels.volume.affine[:3, 3] - voxels.volume.spacing * _ROOM
    rough = []
    for mask in masks.values():
        points, triangles = contour(mask)
        rough.append(SurfaceMesh(origin + spacing * points, triangles))
    wanted = {name: float(mask.sum()) * voxels.volume.voxel_volume for name, mask in masks.items()}
    found = dict(zip(masks, smooth_surfaces(rough, list(wanted.values()), STEPS), strict=True))
    return Cortex(
        found["white"],
        found["pial"],
        found["outer"],
        found.get("ventricles"),
        thickness(found["white"], found["pial"]),
        wanted,
        moved,
    )


_ROOM = 2  # voxels around the labels, for surfaces that move outwards


def _masks(labels: LabelMap, spheres: bool) -> tuple[dict[str, np.ndarray], dict[str, int]]:
    """Nested masks from inside to outside, each with its 26 neighbours in the next one: then no cube holds two surfaces."""
    if not any(part_of(name, "white") for name in labels.regions):
        wanted = "a region called white, or white_left and white_right"
        raise InputError("labels", f"of {', '.join(labels.regions) or 'nothing'}", wanted)
    data, names = np.pad(labels.volume.data, _ROOM), labels.regions

    def region(*which: str) -> np.ndarray:
        return np.isin(data, [names.index(name) + 1 for name in which if name in names])

    shaped = correct_topology if spheres else largest_filled_component
    inside = [name for name in names if any(part_of(name, whole) for whole in WHITE)]
    tissue, white, fluid = region(*set(names) - {FLUID}), region(*inside), region("ventricles")
    pial = shaped(tissue)
    cavities = _remove_specks(fluid, labels.volume.voxel_volume)
    cavities &= ndimage.binary_erosion(pial, _CUBE, 2)
    inner = (white | ndimage.binary_dilation(cavities, _CUBE)) & ndimage.binary_erosion(pial, _CUBE)
    if not inner.any() or not (pial & ~white).any():
        raise InputError("labels", "such that nothing is around the white matter", "white matter inside grey matter")
    inner = shaped(inner)
    cavities = _remove_specks(cavities & ndimage.binary_erosion(inner, _CUBE), labels.volume.voxel_volume)
    outer = shaped((data > 0) | ndimage.binary_dilation(pial, _CUBE))
    masks = {"white": inner, "pial": pial, "outer": outer}
    sample_sizes = {"ventricles": fluid, "white": white, "pial": tissue, "outer": data > 0}
    if cavities.any():
        masks = {"ventricles": cavities, **masks}
    return masks, {name: int((mask != sample_sizes[name]).sum()) for name, mask in masks.items()}


def part_of(name: str, whole: str) -> bool:
    """Whether a region is another or a part of it, as `white_left` is of `white`.

    Parameters
    ----------
    name : str
        Name of the region.
    whole : str
        Name of the other region.

    Returns
    -------
    bool
        True if it is.
    """
    return name == whole or name.startswith(f"{whole}_")


def _remove_specks(mask: np.ndarray, voxel: float) -> np.ndarray:
    pieces, _ = ndimage.label(mask, NEIGHBOURS)
    kept = np.bincount(pieces.ravel()) * voxel >= SPECK
    kept[0] = False
    return np.asarray(ndimage.binary_fill_holes(kept[pieces], NEIGHBOURS))


def thickness(white: SurfaceMesh, pial: SurfaceMesh) -> np.ndarray:
    """Cortical thickness: the mean of the distance from white to pial surface and of the distance back from the point reached.

    Surfaces are sampled at their vertices and at the centres of their triangles.

    Parameters
    ----------
    white, pial : SurfaceMesh
        The surfaces (m).

    Returns
    -------
    ndarray, shape (n,)
        Thickness (m) at the vertices of `white`.

    Examples
    --------
    >>> from ngbrain.mesh.surface.mask_surface import contour
    >>> away = np.linalg.norm(np.indices((31, 31, 31)) - 15, axis=0)
    >>> inner, outer = (SurfaceMesh(*contour(away < r)) for r in (8, 12))
    >>> bool(np.abs(thickness(inner, outer) - 4).max() < 0.5)
    True
    """
    to, back = (np.concatenate([s.points, s.points[s.triangles].mean(axis=1)]) for s in (pial, white))
    there, reached = cKDTree(to).query(white.points)
    home, _ = cKDTree(back).query(to[reached])
    return np.asarray((there + home) / 2)
