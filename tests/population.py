"""A seeded population of heads: no two alike, none a real person's, each with the truth that it was drawn from.

MNI152's maps of grey and white matter are bent into another head: size and shape, ventricles from small to wide, sulci
from closed to open, folds of its own, a nodding and turned position. A T1 of it is drawn with contrast, coil field, noise,
voxels, field of view, bone, marrow and scalp of its own; label maps are written in FreeSurfer's numbers, without fluid in
the sulci, or as plain tissues.
"""

from dataclasses import dataclass

import numpy as np
from regridded import rotation
from scipy import ndimage

from ngbrain.image import places
from ngbrain.image.contrast import tissue_maps
from ngbrain.image.labelmap import LabelMap
from ngbrain.image.volume import Scan, Volume, straightened

TISSUES = {1: "csf", 2: "grey", 3: "white", 4: "ventricle"}
CSF, GREY, WHITE, VENTRICLE = TISSUES
_ALONG = 20.0  # mm, correlation length of the large deformation


@dataclass(frozen=True, eq=False)
class Individual:
    """A head.

    scan     its T1, as `read_scan` would give it
    stored   the same as its file has it
    tissues  the truth on the voxels of the file: TISSUES
    parts    on the same voxels FreeSurfer's numbers, without fluid in the sulci
    affine   (4, 4), where the template lies in it, but for what is bent (m)
    about    what was varied
    """

    scan: Scan
    stored: Volume
    tissues: LabelMap
    parts: Volume
    affine: np.ndarray
    about: dict[str, float]


def individual(seed, voxel=None):
    """The head of a number; `voxel` (mm) instead of voxels of its own."""
    rng = np.random.default_rng([49, seed])
    about = {
        "size": rng.uniform(0.86, 0.99),
        "ventricles": rng.uniform(-0.1, 0.5),
        "sulci": rng.uniform(-0.05, 0.2),
        "nod": rng.uniform(-20, 20),
        "turn": rng.uniform(-8, 8),
        "tilt": rng.uniform(-8, 8),
        "field": rng.uniform(0.05, 0.35),
        "noise": rng.uniform(0.02, 0.05),
        "contrast": rng.uniform(0.2, 0.32),
        "bone": rng.uniform(5, 9),
        "scalp": rng.uniform(4, 10),
        "neck": rng.uniform(0, 60),
        "voxel": rng.choice([0.9, 1.0, 1.2, 2.0]),
        "slice": rng.choice([1.0, 1.0, 1.0, 1.5]),
    }
    if voxel is not None:
        about |= {"voxel": voxel, "slice": 1.0}
    sides = np.array([about["voxel"], about["voxel"], min(about["voxel"] * about["slice"], 3.0)])
    place = _place(about, rng)
    grid, affine = _field_of_view(place, sides, about["neck"])
    points, shift = _bent(grid, affine, place, about, rng)
    shares, where = _shares(points, grid, sides, about, rng)
    labels = _labelled(shares, where)
    picture = _pictured(shares, labels, where, sides, about, rng)
    order, flips = rng.permutation(3), rng.choice([-1, 1], 3)
    stored = _reordered(Volume(picture, affine), order, flips)
    tissues = _reordered(Volume(labels, affine), order, flips)
    parts = _reordered(Volume(_freesurfer(labels, where), affine), order, flips)
    scan = Scan(straightened(stored), stored.affine, stored.data.shape, f"individual {seed}")
    about["bent"] = float(1e3 * np.linalg.norm(shift, axis=-1).std())
    return Individual(scan, stored, LabelMap(tissues, TISSUES), parts, place, about)


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
    where = np.meshgrid(*[np.arange(n) / s for n, s in zip(shape, step, strict=True)], indexing="ij")
    return ndimage.map_coordinates(field / field.std(), where, order=1, mode="nearest").astype(np.float32)


def _bent(shape, affine, place, about, rng):
    """Where the voxels are in the template (m), and by how much they are bent."""
    to = np.linalg.inv(place) @ affine
    index = np.indices(shape, np.float32).reshape(3, -1).T
    at = (index @ to[:3, :3].T + to[:3, 3]).reshape(*shape, 3)
    sides = 1e3 * np.linalg.norm(affine[:3, :3], axis=0)
    shift = 2.5e-3 * np.stack([_smooth(shape, sides, _ALONG * 2, rng) for _ in range(3)], axis=-1)
    middle = np.array([0.0, -0.012, 0.012])  # of the ventricles
    away = at - middle
    near = np.exp(-((away / [0.03, 0.05, 0.03]) ** 2).sum(axis=-1) / 2)
    shift -= about["ventricles"] * near[..., None] * away
    return at + shift, shift


def _shares(points, shape, sides, about, rng):
    """Shares (3, ...) of fluid, grey and white matter, and the voxels' places in the template (mm)."""
    flat = points.reshape(-1, 3)
    fluid, grey, white = (each.at(flat).reshape(shape).astype(np.float32) for each in tissue_maps())
    inside = fluid + grey + white > 0.5
    folds = _smooth(shape, sides, 7.0, rng)  # an average has no folds of its own
    rim = ndimage.gaussian_filter(grey, 1.5 / sides).clip(0, 1)
    gain = about["sulci"] + 0.22 * folds * rim
    drawn = np.stack([fluid + gain * (grey + fluid), grey, white + 0.1 * folds * rim]).clip(0)
    drawn = np.where(inside, drawn**2, 0)  # sharper: averages are blurred
    return drawn / np.maximum(drawn.sum(axis=0), 1e-6), 1e3 * points


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
    rough = 0.15 * _smooth(labels.shape, sides, 15.0, rng)
    head = np.where(face | neck, 0.55 + rough, head)
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
    below = (there[:, 2] < places.tentorium(there)).reshape(shape)
    radius, depth = (each.reshape(shape) for each in places.stem(there))
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
        near = (places.NUCLEI[name].radius(there) < 1).reshape(shape) & matter
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
