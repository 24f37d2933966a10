"""Structures of a brain from its tissues: hemispheres, cerebellum, brain stem, deep grey matter and corpus callosum.

No atlas is used: markers at known positions of the MNI152 template (`ngbrain.image.preprocess.mni_landmarks`) are mapped to the
head by an affine map, and the grey values of the scan give the boundaries.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError, require
from ngbrain.image.preprocess import mni_landmarks
from ngbrain.image.preprocess.registration import ALIKE, INSIDE, Alignment, align, correlation_inside
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.template import mni152
from ngbrain.image.read.volume import Volume
from ngbrain.image.segment.nuclei import segment_nuclei
from ngbrain.image.segment.tissue_classes import CSF, GREY, VENTRICLE, WHITE
from ngbrain.image.structures.midsurface import MidSurface
from ngbrain.look import BriefText

LEFT, RIGHT, CEREBELLUM, STEM = range(1, 5)
PARTS = {LEFT: "cerebrum_left", RIGHT: "cerebrum_right", CEREBELLUM: "cerebellum", STEM: "brain_stem"}
"""Names of the parts of a brain."""
NAMES = {
    1: "csf",
    2: "ventricles",
    3: "grey_left",
    4: "grey_right",
    5: "white_left",
    6: "white_right",
    7: "grey_cerebellum",
    8: "white_cerebellum",
    9: "brain_stem",
    10: "deep_grey_left",
    11: "deep_grey_right",
    12: "corpus_callosum",
}
"""Names of the regions."""
_NUMBERS = {name: number for number, name in NAMES.items()}

_BAND = 7.0  # mm on both sides of the expected tentorium in which the scan decides
_CORE, _RIM, _AROUND = 0.8, 1.25, 1.6  # radii of the brain stem: all stem inside, none outside, and the search range
_SMOOTH = 0.6  # mm, smoothing of the grey values
_TRUNK = 8.0  # mm, extent of the corpus callosum on both sides of the mid surface
_NEAR = 8.0  # mm, range around its expected centre line
_BACK_BELOW = (120.0, 90.0)  # mm: no brain extends further back or below


@dataclass(frozen=True, eq=False, repr=False)
class Structures(BriefText):
    """Structures of a brain.

    Parameters
    ----------
    labels : LabelMap
        Regions by `NAMES`, tissue and structure in one: `grey.*` is all cortex, `.*_left` one side.
    parts : Volume
        uint8, the part (`PARTS`) of every voxel of the brain, fluid included; 0 is outside.
    affine : numpy.ndarray
        (4, 4), from points (m) of the MNI152 template to points (m) of the head.
    middle : MidSurface
        Surface between the hemispheres, in the template.
    """

    labels: LabelMap
    parts: Volume
    affine: np.ndarray
    middle: MidSurface


def segment_structures(t1: Volume, tissues: Volume, place: Alignment | None = None) -> Structures:
    """Split the tissues of a T1 into structures.

    Watersheds from markers, bright voxels first, meet in the dark between folds (Beucher & Meyer 1993): cerebrum and cerebellum
    are separated along the tentorium. The stem is cut from the cerebrum above the colliculi and behind the mammillary bodies,
    where a T1 shows no boundary. Left and right are separated by the surface in the fissure (`MidSurface`). Thalamus, caudate,
    putamen and pallidum grow from their centres to the edges of the grey values. The corpus callosum is the white matter within
    8 mm of the mid surface that lies in its cross-section there. Left and right are those of the affine.

    Parameters
    ----------
    t1 : Volume
        T1 after bias-field correction; axes right, front, up, voxels of 1 mm (2 mm are possible, but lose thin boundaries).
    tissues : Volume
        On the same voxels: CSF, GREY, WHITE, VENTRICLE of `ngbrain.image.segment.tissue_classes`, 0 outside.
    place : Alignment, optional
        Alignment of the MNI152 template; computed by default.

    Returns
    -------
    Structures

    Raises
    ------
    InputError
        The two volumes have different voxels, there is no tissue, or the brain is unlike the template (likeness below 0.4).
    MissingExtra
        nilearn or scikit-image is not installed.

    Examples
    --------
    >>> from ngbrain.image.labelling import label_structures  # segments the tissues first, or takes them from the cache
    >>> ml = label_structures(mni152()).labels.volumes_ml()
    >>> f"{ml['brain_stem']:.0f} ml of stem, {ml['white_left'] / ml['white_right']:.2f} times as much white left as right"
    '30 ml of stem, 1.00 times as much white left as right'
    """
    if t1.data.shape != tissues.data.shape or not np.allclose(t1.affine, tissues.affine, atol=1e-6):
        raise InputError("tissues", f"on {tissues.data.shape} voxels", f"the voxels of the scan, {t1.data.shape}")
    brain = tissues.data > 0
    if not np.isin(tissues.data, (GREY, WHITE)).any():
        raise InputError("tissues", "without grey and white matter", "labels of a whole brain")
    head = mask_background(t1, brain)
    place = place or align(head, mni152().volume)
    inside = correlation_inside(head, mni152().volume, place.affine)
    if place.likeness < ALIKE or inside < INSIDE:
        what = f"a brain unlike the MNI152 template (correlation {place.likeness:.2f}, inside {inside:.2f})"
        raise InputError("image", what, "a T1 of a whole brain")
    middle = MidSurface.fit(head, place.affine)
    box = tuple(slice(max(s.start - 1, 0), s.stop + 1) for s in ndimage.find_objects(brain.astype(np.uint8))[0])
    case = _BrainBox.of(head, tissues, place.affine, middle, box)
    parts = case.parts()
    labels = case.regions(parts)
    whole, regions = np.zeros(brain.shape, np.uint8), np.zeros(brain.shape, np.uint8)
    whole[box], regions[box] = parts, labels
    return Structures(
        LabelMap(Volume(regions, tissues.affine), NAMES), Volume(whole, tissues.affine), place.affine, middle
    )


def mask_background(t1: Volume, brain: np.ndarray) -> Volume:
    """Set everything outside the brain to 0, and shift the grey values so that none is negative.

    Parameters
    ----------
    t1 : Volume
        The scan.
    brain : numpy.ndarray
        (nx, ny, nz) mask of the brain.

    Returns
    -------
    Volume
        float32.
    """
    dark = min(float(t1.data[brain].min()), 0.0)
    return Volume(np.where(brain, t1.data - dark, 0).astype(np.float32), t1.affine)


@dataclass(frozen=True, eq=False)
class _BrainBox:
    """A box of a head: grey values and tissues on voxels of `size` (3,) in mm, and for the n brain voxels their position (n, 3) in
    the template (mm) and their distance (n,) to the right of the mid surface (mm); `to` (4, 4) maps indices to positions.
    """

    grey: np.ndarray
    tissues: np.ndarray
    size: np.ndarray
    to: np.ndarray
    points: np.ndarray
    right: np.ndarray

    @classmethod
    def of(
        cls, head: Volume, tissues: Volume, affine: np.ndarray, middle: MidSurface, box: tuple[slice, ...]
    ) -> _BrainBox:
        brain = tissues.data[box] > 0
        to = np.diag([1e3, 1e3, 1e3, 1.0]) @ np.linalg.inv(affine) @ head.affine
        to[:3, 3] += to[:3, :3] @ [axis.start for axis in box]
        points = np.argwhere(brain) @ to[:3, :3].T + to[:3, 3]
        return cls(head.data[box], tissues.data[box], 1e3 * head.spacing, to, points, middle.right_of(points))

    def on_grid(self, values: np.ndarray, outside: float = 0) -> np.ndarray:
        """Scatter values of the brain voxels to the box."""
        grid = np.full(self.tissues.shape, outside, values.dtype)
        grid[self.tissues > 0] = values
        return grid

    def parts(self) -> np.ndarray:
        """Part (`PARTS`) of all voxels."""
        flood = require("skimage.segmentation", "mri").watershed
        above = self.points[:, 2] - mni_landmarks.tentorium(self.points)
        radius, below = mni_landmarks.stem(self.points)
        around = radius < _AROUND
        marks = np.zeros(len(above), np.uint8)
        marks[above > _BAND] = LEFT  # both sides of the cerebrum, split below
        marks[(above < -_BAND) & (radius > _RIM)] = CEREBELLUM
        marks[around] = 0
        marks[around & (below < 0)] = LEFT
        marks[(radius < _CORE) & (below > 0)] = STEM
        matter = np.isin(self.tissues, (GREY, WHITE))
        valleys = -ndimage.gaussian_filter(self.grey, _SMOOTH / self.size)
        found = _keep_largest_parts(flood(valleys, np.where(matter, self.on_grid(marks), 0), mask=matter))
        found = np.where(self.tissues > 0, _nearest(found), 0)
        return _keep_largest_parts(
            np.where((found == LEFT) & (self.on_grid(self.right) >= 0), RIGHT, found).astype(np.uint8)
        )

    def regions(self, parts: np.ndarray) -> np.ndarray:
        """Region (`NAMES`) of all voxels."""
        regions = np.zeros_like(parts)
        for tissue, name in ((CSF, "csf"), (VENTRICLE, "ventricles")):
            regions[self.tissues == tissue] = _NUMBERS[name]
        for part, ending in ((LEFT, "left"), (RIGHT, "right"), (CEREBELLUM, "cerebellum")):
            for tissue, name in ((GREY, "grey"), (WHITE, "white")):
                regions[(parts == part) & (self.tissues == tissue)] = _NUMBERS[f"{name}_{ending}"]
        matter = np.isin(self.tissues, (GREY, WHITE))
        regions[(parts == STEM) & matter] = _NUMBERS["brain_stem"]
        regions[self.callosum(parts)] = _NUMBERS["corpus_callosum"]
        deep = segment_nuclei(self.grey, np.isin(self.tissues, (GREY, WHITE)), self.to, self.size)
        regions[deep & (parts == LEFT)] = _NUMBERS["deep_grey_left"]
        regions[deep & (parts == RIGHT)] = _NUMBERS["deep_grey_right"]
        return regions

    def callosum(self, parts: np.ndarray) -> np.ndarray:
        """Mask of the corpus callosum."""
        near = (np.abs(self.right) <= _TRUNK) & (self._distance_from_callosum() <= _NEAR)
        white = (self.tissues == WHITE) & np.isin(parts, (LEFT, RIGHT))
        middle = near & (np.abs(self.right) <= 1.5 * self.size.max()) & white[self.tissues > 0]
        cell = np.rint((self.points[:, 1:] + _BACK_BELOW) / self.size.max()).astype(int).clip(0)
        section = np.zeros(cell.max(axis=0) + 3, bool)
        section[tuple(cell[middle].T)] = True
        section = ndimage.binary_opening(ndimage.binary_closing(section))
        section = ndimage.binary_dilation(_largest(section))
        return _largest(white & self.on_grid(near & section[tuple(cell.T)]))

    def _distance_from_callosum(self) -> np.ndarray:
        """Distance (n,) in mm of positions from the centre line of the corpus callosum, in the y-z plane."""
        best = np.full(len(self.points), np.inf)
        for a, b in zip(mni_landmarks.CALLOSUM, mni_landmarks.CALLOSUM[1:], strict=False):
            along = ((self.points[:, 1:] - a) @ (b - a) / ((b - a) @ (b - a))).clip(0, 1)
            best = np.minimum(best, np.linalg.norm(self.points[:, 1:] - a - along[:, None] * (b - a), axis=1))
        return best


def _keep_largest_parts(parts: np.ndarray) -> np.ndarray:
    """Keep the largest component of each part; smaller components take the nearest label."""
    kept = np.zeros_like(parts)
    for part in np.setdiff1d(np.unique(parts), [0]):
        kept[_largest(parts == part)] = part
    return np.where(parts > 0, _nearest(kept), 0)


def _nearest(parts: np.ndarray) -> np.ndarray:
    """Labels everywhere: those of the nearest labelled voxel."""
    where = ndimage.distance_transform_edt(parts == 0, return_distances=False, return_indices=True)
    return np.asarray(parts[tuple(where)])


def _largest(mask: np.ndarray) -> np.ndarray:
    pieces, count = ndimage.label(mask)
    return np.asarray(pieces == np.bincount(pieces.ravel())[1:].argmax() + 1) if count else mask
