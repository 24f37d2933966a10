"""A seeded population of heads: no two alike, none a real person's, each with the truth that it was drawn from.

MNI152's maps of grey and white matter are bent into another head: size and shape, ventricles from small to wide with rough
walls, a nodding and turned position. As the average of many has lost its folds, the cortex is folded anew: along sheets, the
zero level of a random field, walls of 2 to 3 mm of grey matter touch or stand up to 3 mm apart. A T1 of it is drawn with
contrast, coil field, noise, voxels, slices, field of view, neck, shoulders, bone, marrow and scalp of its own; label maps are
written in FreeSurfer's numbers, without fluid in the sulci, or as plain tissues.
"""

from dataclasses import dataclass

import numpy as np
from resampled_scans import rotation
from scipy import ndimage

from ngbrain.image.preprocess import mni_landmarks
from ngbrain.image.preprocess.contrast import tissue_maps
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.resampling import resample_to_ras
from ngbrain.image.read.volume import Scan, Volume

TISSUES = {1: "csf", 2: "grey", 3: "white", 4: "ventricle"}
CSF, GREY, WHITE, VENTRICLE = TISSUES
_ALONG = 20.0  # mm, half the correlation length of the large deformation
_FOLDS = 6.5  # mm, that of the field whose zero level is sulci: gyri are some 14 mm wide


@dataclass(frozen=True, eq=False)
class Individual:
    """A head.

    stored   its T1 as its file has it, None where none was asked for
    tissues  the truth on the voxels of the file: TISSUES
    parts    on the same voxels FreeSurfer's numbers, without fluid in the sulci
    affine   (4, 4), where the template lies in it, but for what is bent (m)
    about    what was varied
    """

    stored: Volume | None
    tissues: LabelMap
    parts: Volume
    affine: np.ndarray
    about: dict[str, float]

    def scan(self, spacing=1e-3):
        """Its T1, as `read_scan` would give it, on voxels of 1 mm or others (m)."""
        return Scan(resample_to_ras(self.stored, spacing), self.stored.affine, self.stored.data.shape, "individual")


def individual(seed, voxel=None, picture=True, **given):
    """The head of a number; `voxel` (mm) instead of voxels of its own, and whatever else of `about`; with a T1 or without."""
    rng = np.random.default_rng([49, seed])
    about = {
        "size": rng.uniform(0.86, 0.99),
        "ventricles": rng.uniform(-0.1, 0.6),
        "sulci": rng.uniform(0.2, 1.5),
        "cortex": rng.uniform(2.0, 3.0),
        "nod": rng.uniform(-30, 30),
        "turn": rng.uniform(-15, 15),
        "tilt": rng.uniform(-15, 15),
        "field": rng.uniform(0.05, 0.5),
        "noise": rng.uniform(0.02, 0.05),
        "contrast": rng.uniform(0.2, 0.32),
        "bone": rng.uniform(5, 9),
        "scalp": rng.uniform(4, 10),
        "neck": rng.uniform(0, 110),
        "voxel": rng.choice([0.9, 1.0, 1.0, 1.2, 2.0]),
        "slice": rng.choice([1.0, 1.0, 1.0, 1.5, 2.5]),
    }
    if voxel is not None:
        about |= {"voxel": voxel, "slice": 1.0}
    about |= given
    sides = np.array([about["voxel"], about["voxel"], min(about["voxel"] * about["slice"], 3.0)])
    place = _place(about, rng)
    grid, affine = _field_of_view(place, sides, about["neck"])
    points, shift = _bent(grid, affine, place, about, rng)
    shares, where = _shares(points, grid, sides, about, rng)
    labels = _labelled(shares, where)
    order, flips = rng.permutation(3), rng.choice([-1, 1], 3)
    stored = None
    if picture:
        stored = _reordered(Volume(_pictured(shares, labels, where, sides, about, rng), affine), order, flips)
    tissues = _reordered(Volume(labels, affine), order, flips)
    parts = _reordered(Volume(_freesurfer(labels, where), affine), order, flips)
    about["bent"] = float(1e3 * np.linalg.norm(shift, axis=-1).std())
    return Individual(stored, LabelMap(tissues, TISSUES), parts, place, about)


def _place(about, rng):
    turn = np.eye(3)
    for axis, angle in enumerate((about["nod"], about["tilt"], about["turn"])):
        turn = rotation(angle, np.eye(3)[axis]) @ turn
    place = np.eye(4)
    place[:3, :3] = about["size"] * turn @ np.diag(np.exp(rng.normal(0, 0.03, 3)))
    place[:3, 3] = rng.normal(0, 0.015, 3)
    return place


def _field_of_view(place, sides, neck):
    """Shape and affine of the voxels around the brain."""
    brain, _, _ = tissue_maps()
    corners = brain.to_world(np.array(list(np.ndindex(2, 2, 2))) * np.array(brain.data.shape))
    there = 1e3 * (corners @ place[:3, :3].T + place[:3, 3])
    low, high = there.min(axis=0) - [20, 20, neck], there.max(axis=0) + 20
    affine = np.diag([*(1e-3 * sides), 1.0])
    affine[:3, 3] = 1e-3 * low
    return tuple(np.ceil((high - low) / sides).astype(int)), affine


def _smooth(shape, sides, length, rng):
    """A random field of unit spread with a correlation length (mm), drawn on coarse voxels."""
    step = length / 2.5 / sides
    coarse = tuple(np.ceil(np.array(shape) / step).astype(int) + 2)
    field = ndimage.gaussian_filter(rng.standard_normal(coarse), 1.2)
    field = (field / field.std()).astype(np.float32)
    for axis, (n, s) in enumerate(zip(shape, step, strict=True)):
        hats = (1 - np.abs(np.arange(n)[:, None] / s - np.arange(coarse[axis]))).clip(0).astype(np.float32)
        field = np.moveaxis(np.tensordot(hats, field, (1, axis)), 0, axis)
    return np.ascontiguousarray(field)


def _bent(shape, affine, place, about, rng):
    """Where the voxels are in the template (m), and by how much they are bent."""
    to = (np.linalg.inv(place) @ affine).astype(np.float32)
    index = np.indices(shape, np.float32).reshape(3, -1).T
    at = (index @ to[:3, :3].T + to[:3, 3]).reshape(*shape, 3)
    sides = 1e3 * np.linalg.norm(affine[:3, :3], axis=0)
    shift = np.float32(3.5e-3) * np.stack([_smooth(shape, sides, _ALONG * 2, rng) for _ in range(3)], axis=-1)
    middle = np.array([0.0, -0.012, 0.012], np.float32)  # of the ventricles
    away = at - middle
    near = np.exp(-((away / np.float32([0.03, 0.05, 0.03])) ** 2).sum(axis=-1) / 2)
    shift -= np.float32(about["ventricles"]) * near[..., None] * away
    return at + shift, shift


def _shares(points, shape, sides, about, rng):
    """Shares (3, ...) of fluid, grey and white matter, and the voxels' places in the template (mm)."""
    flat = points.reshape(-1, 3)
    fluid, grey, white = (each.interpolate(flat).reshape(shape).astype(np.float32) for each in tissue_maps())
    inside = fluid + grey + white > 0.5
    fluid = fluid + 0.3 * _smooth(shape, sides, 5.0, rng) * fluid * (1 - fluid)  # rough walls
    drawn = np.stack([fluid, grey, white]).clip(0) ** 2  # sharper: averages are blurred
    drawn = _folded(drawn, inside, 1e3 * points, sides, about, rng)
    return np.where(inside, drawn / np.maximum(drawn.sum(axis=0), 1e-6), 0), np.float32(1e3) * points


def _folded(drawn, inside, where, sides, about, rng):
    """The shares with sulci in the cerebrum, up to some 18 mm deep, and a cortex along them and the hull."""
    depth = ndimage.distance_transform_edt(inside, sampling=sides).astype(np.float32)
    sheets = _smooth(inside.shape, sides, _FOLDS, rng)
    slope = np.linalg.norm(np.stack(np.gradient(sheets, *sides)), axis=0)
    floor = 18 + 4 * _smooth(inside.shape, sides, _ALONG, rng)
    away = np.hypot(np.abs(sheets) / np.maximum(slope, 0.5 * slope.mean()), (depth - floor).clip(0)) - about["sulci"]
    along = np.minimum(away, depth)

    def within(distance, bound):
        return ((bound - distance) / sides.mean() + 0.5).clip(0, 1)

    wet = within(away, 0.0)
    cortex = within(along, about["cortex"]) - wet
    folds = np.stack([wet, cortex.clip(0), 1 - np.maximum(wet, within(along, about["cortex"]))])
    above = where[..., 2] - mni_landmarks.tentorium(where.reshape(-1, 3)).reshape(inside.shape)
    there = (within(depth, floor + about["cortex"]) * (above > 3)).astype(np.float32)
    return (1 - there) * drawn / np.maximum(drawn.sum(axis=0), 1e-6) + there * folds


def _labelled(shares, where):
    """TISSUES: what a voxel has most of; ventricles are the deep fluid that hangs together."""
    inside = shares.sum(axis=0) > 0.5
    labels = np.where(inside, CSF + shares.argmax(axis=0), 0).astype(np.uint8)
    x, y, z = np.moveaxis(where, -1, 0)
    deep = (labels == CSF) & (np.abs(x) < 42) & (z > -12) & (z < 35) & (y > -62) & (y < 42)
    deep &= np.hypot(x / 42, (z - 12) / 30) < 1
    deep &= ~((np.abs(x) < 12) & (y < -28) & (z < 16)) & ~((np.abs(x) < 3) & (z > 12))  # cisterns, the fissure
    deep &= ~((np.abs(x) > 24) & (z > -4) & (y > -28))  # the insula
    deep &= ~((z < 0) & (np.abs(x) < 15))
    pieces, _ = ndimage.label(deep)
    large = np.bincount(pieces.ravel())
    large[0] = 0
    labels[(large > 0.15 * large.max())[pieces]] = VENTRICLE
    return labels


def _pictured(shares, labels, where, sides, about, rng):
    """Grey values: the head's tissues, blurred by the voxels, in a coil's field, with Rician noise."""
    white, grey = 1.0, 1.0 - about["contrast"]
    fluid, bone, marrow, fat = 0.25, 0.08, 0.5, rng.uniform(0.9, 1.6)
    inside = labels > 0
    picture = np.tensordot(np.array([fluid, grey, white], np.float32), shares, 1)
    away = ndimage.distance_transform_edt(~inside, sampling=sides)
    x, y, z = np.moveaxis(where, -1, 0)
    skin = 2 + about["bone"] + about["scalp"]
    layers = [away <= 2, away <= 2 + about["bone"] / 3, away <= 2 + 2 * about["bone"] / 3, away <= 2 + about["bone"]]
    head = np.select([*layers, away <= skin], [fluid, bone, marrow, bone, fat], 0.0)
    face = (y > 20) & (z < -25) & (z > -110) & (np.hypot(x / 70, (y - 40) / 55) < 1) & (away > 8)
    neck = (z < -50) & (np.hypot(x / 62, (y + 35) / 68) < 1) & (away > 8)
    shoulders = (z < -150) & (np.hypot(y + 35, x / 3) < 85)
    rough = 0.15 * _smooth(labels.shape, sides, 15.0, rng)
    head = np.where(face | neck | shoulders, 0.55 + rough, head)
    for side in (-1, 1):  # eyes
        eye = np.linalg.norm((where - [side * 32, 68, -38]) / 12, axis=-1)
        head = np.where((eye < 1.15) & (away > 3), np.where(eye < 1, 0.2, 0.9), head)
    picture = np.where(inside, picture, head)
    picture = ndimage.gaussian_filter(picture, 0.4)
    log = _smooth(labels.shape, sides, 160.0, rng)
    picture = picture * np.exp(about["field"] * (log - log.mean()) / 2)
    noise = about["noise"] * rng.standard_normal((2, *labels.shape))
    return (600 * np.hypot(picture + noise[0], noise[1])).astype(np.float32)


def _freesurfer(labels, where):
    """FreeSurfer's numbers, as in aseg.mgz."""
    there = where.reshape(-1, 3)
    shape = labels.shape
    right = there[:, 0].reshape(shape) > 0
    below = (there[:, 2] < mni_landmarks.tentorium(there)).reshape(shape)
    radius, depth = (each.reshape(shape) for each in mni_landmarks.stem(there))
    found = np.zeros(shape, np.int16)
    for tissue, left, other, cerebellum in (
        (GREY, 3, 42, (8, 47)),
        (WHITE, 2, 41, (7, 46)),
        (VENTRICLE, 4, 43, (4, 43)),
    ):
        numbers = np.where(below, np.where(right, cerebellum[1], cerebellum[0]), np.where(right, other, left))
        found = np.where(labels == tissue, numbers, found)
    matter = (labels == GREY) | (labels == WHITE)
    found[matter & (radius < 1) & (depth > 0)] = 16
    for name, numbers in (("thalamus", (10, 49)), ("caudate", (11, 50)), ("putamen", (12, 51)), ("pallidum", (13, 52))):
        near = (mni_landmarks.NUCLEI[name].radius(there) < 1).reshape(shape) & matter
        found[near] = np.where(right, numbers[1], numbers[0])[near]
    return found.astype(np.int16)


def _reordered(volume, order, flips):
    """The same picture with its axes in another order and direction."""
    data = volume.data.transpose(order)[tuple(slice(None, None, flip) for flip in flips)]
    affine = volume.affine.copy()
    affine[:, :3] = volume.affine[:, order]
    ends = np.array([0 if flip > 0 else n - 1 for flip, n in zip(flips, data.shape, strict=True)])
    affine[:3, 3] = volume.affine[:3, 3] + affine[:3, :3] @ ends
    affine[:3, :3] *= flips
    return Volume(np.ascontiguousarray(data), affine)
