"""From grey values to tissue: fluid, grey and white matter, ventricles, and the share of white matter in a voxel."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image.preprocess import mni_landmarks
from ngbrain.image.preprocess.contrast import tissue_maps
from ngbrain.image.preprocess.registration import downsample
from ngbrain.image.read.volume import Volume
from ngbrain.image.segment.nuclei import segment_nuclei
from ngbrain.image.segment.topology import remove_islands
from ngbrain.image.segment.ventricles import FAR, find_ventricles, refine_ventricle_edges, ventricle_distance

OUTSIDE, CSF, GREY, WHITE, VENTRICLE = range(5)
NAMES = ("outside", "csf", "grey", "white", "ventricle")

_WANTED = "a T1, in which white matter is brighter than grey and grey brighter than fluid"
# Shares of three pure tissues (fluid, grey, white) in the five classes; every other class is a mixture.
_SHARES = np.array([[1, 0, 0], [0.5, 0.5, 0], [0, 1, 0], [0, 0.5, 0.5], [0, 0, 1]])
_START = (0.05, 0.45, 0.85)  # quantiles of the grey values in a brain that are near those of the pure tissues
# Of the step from grey to white matter, and of the noise: what is brighter than white matter by more is a contrast agent or
# fat. With a few ml of it the brightest class is theirs, and all of the brain's tissue in the others.
_VESSEL, _NOISES = 0.6, 2.0
_BINS, _ROUNDS_OF_BINS = 512, 200
_COUPLING, _ROUNDS = 0.4, 4
_FIELDS, _BY_PLACE = (
    4,
    2,
)  # times that what is left of a field is taken out; so many of them first by the template's tissues
_TISSUE = 0.75  # on the way from fluid (0) to grey matter (1)
_SLOW = 20.0  # mm: standard deviation of the Gaussian that field is smoothed by
_NEAR = 10.0  # mm: the same of the Gaussian over which tissues are compared with the template's
_THIN = 2.0  # mm between the voxels that what is smooth is found on
# Standard deviation of smoothing, in voxels of the scan; reached where noise is this much of the step from grey to white matter.
_WIDEST, _NOISY = 0.6, 0.2
_FLUID_ENDS = 0.5  # on the way from fluid (0) to grey matter (1)
_VAGUE = 5.0  # mm, over which the template's maps of tissues are smoothed
_TRUST, _RARE = 0.8, 0.02  # power to which they are believed, and the least share of a tissue
_SLAB = 8  # layers of voxels at a time, so that they stay in the cache
_RIND = 3  # mm
_LEAST_VENTRICLES = 2.0  # ml


@dataclass(frozen=True, eq=False)
class Labels:
    """Tissue in each voxel.

    volume    uint8: OUTSIDE, CSF, GREY, WHITE or VENTRICLE, named in NAMES
    white     float32: share of white matter that the grey value of a voxel speaks for, 0 to 1; as noisy as the scan
    contrast  from grey to white matter, in standard deviations of the grey values of one tissue
    """

    volume: Volume
    white: Volume
    contrast: float

    def volumes_ml(self) -> dict[str, float]:
        """Millilitres of each tissue by name."""
        counts = np.bincount(self.volume.data.ravel(), minlength=len(NAMES)) * self.volume.voxel_volume * 1e6
        return {name: float(counts[label]) for label, name in enumerate(NAMES) if label != OUTSIDE}


def segment(t1: Volume, brain: np.ndarray, place: np.ndarray, voxel: float = 1e-3) -> Labels:
    """Label the tissue in a T1, given the mask `brain` (nx, ny, nz), on voxels of 1 mm.

    place   (4, 4), takes points of the MNI152 template (m) to points of the head (m)
    voxel   edge (m) of the voxels that the scan was taken with

    A mixture of five Gaussians of one variance: fluid, grey, white, and between them voxels of two tissues, whose mean
    is the mean of the two. Fitted by EM first to the histogram, then to the picture with a Potts prior between voxels
    with a common face (mean field). Beside that a tissue is the likelier the more of it the template has within some mm, as
    far as an affine map tells; what field that leaves over 20 mm is taken out, and the fit repeated. Noise is smoothed
    by up to 0.6 of the scan's voxels. A voxel is labelled by its expected position between the three pure tissues.
    The variance is shared: free ones shrink onto white matter, the most uniform tissue, and lose a quarter of it.

    Any scale and offset of the grey values will do. A slow field over the picture is for
    `ngbrain.image.preprocess.bias_field` to take out first: 20 % of it cost 0.06 of the Dice overlap.
    The model: Shattuck et al. 2001, doi:10.1006/nimg.2000.0730; mean field: Zhang 1992, doi:10.1109/78.157297.

    Raises:
        InputError: not a T1 (one grey value in 40 % of the brain; less than 15 % or more than 65 % of it white; more
            of it white near the surface than inside), or ventricles of less than 2 ml found.
    """
    box = ndimage.find_objects(brain.astype(np.uint8))[0]
    inside = np.pad(brain[box], 1)  # a layer of outside, so that neighbours need no cases
    grey = np.pad(_normalised(t1.data, brain)[box], 1)
    prior = _prior(t1, place, box)
    smooth = _smoothed(grey, inside, voxel / t1.spacing)
    field = _left_over(smooth, inside, prior, 1e3 * float(t1.spacing.mean()))
    grey, smooth = grey / field, smooth / field
    scale, share, contrast = _fit(smooth, inside, prior)
    labels = np.where(inside, CSF + (scale > _FLUID_ENDS) + (scale > 1.5), OUTSIDE).astype(np.uint8, order="C")
    _drown_islands(labels)
    _check_contrast(labels)
    near = np.pad(ventricle_distance(t1.affine, place, brain.shape)[box], 1, constant_values=FAR)
    ventricles = find_ventricles(inside, labels == CSF, labels == WHITE, near)
    if ventricles.any():
        ventricles = refine_ventricle_edges(ventricles, grey, (labels == GREY) | (labels == WHITE))
    size = ventricles.sum() * t1.voxel_volume * 1e6
    if size < _LEAST_VENTRICLES:
        raise InputError("image", f"a brain with ventricles of {size:.1f} ml", f"at least {_LEAST_VENTRICLES:g} ml")
    labels[ventricles] = VENTRICLE
    to = np.diag([1e3, 1e3, 1e3, 1.0]) @ np.linalg.inv(place) @ t1.affine
    to[:3, 3] += to[:3, :3] @ [axis.start - 1 for axis in box]
    labels[segment_nuclei(grey, np.isin(labels, (GREY, WHITE)), to, 1e3 * t1.spacing)] = GREY
    _drown_islands(labels)  # what the edge of the ventricles has cut off

    core = (slice(1, -1),) * 3
    whole, white = np.zeros(brain.shape, np.uint8), np.zeros(brain.shape, np.float32)
    whole[box] = labels[core]
    white[box] = np.where(inside, share, 0)[core]
    return Labels(Volume(whole, t1.affine), Volume(white, t1.affine), contrast)


def _normalised(data: np.ndarray, brain: np.ndarray) -> np.ndarray:
    """Grey values, float32, such that nearly all in the brain are in 0..1; the others become 0 or 1."""
    low, *start, high = np.quantile(data[brain], [0.001, *_START, 0.999])
    for one, other in pairwise(start):
        if one == other:
            raise InputError("image", f"a brain of which 40 % or more have the grey value {one:g}", _WANTED)
    high = min(high, start[2] + _VESSEL * (start[2] - start[1]) + _NOISES * _noise(data, brain))
    return ((data - low) / (high - low)).clip(0, 1).astype(np.float32)


def _noise(data: np.ndarray, brain: np.ndarray, apart: int = 1) -> float:
    """Standard deviation of the noise, from the median difference of voxels some `apart`; anatomy adds a little."""
    steps = np.abs(data[apart:] - data[:-apart])[brain[apart:] & brain[:-apart]]
    return float(np.median(steps)) / (0.6745 * 2**0.5)


def _smoothed(grey: np.ndarray, inside: np.ndarray, voxel: np.ndarray) -> np.ndarray:
    """Smoothed within the brain the more the noisier it is; `voxel` (3,) of the scan in voxels of the picture."""
    _, matter, white = np.quantile(grey[inside], _START)
    noise = _noise(grey, inside, max(round(float(voxel[0])), 1)) / max(white - matter, 1e-6)
    width = _WIDEST * min(noise / _NOISY, 1.0) * voxel
    share = ndimage.gaussian_filter(inside.astype(np.float32), width)
    smooth = ndimage.gaussian_filter(np.where(inside, grey, 0), width) / np.maximum(share, 1e-3)
    return np.where(inside, smooth, grey).astype(np.float32)


def _prior(t1: Volume, place: np.ndarray, box: tuple[slice, ...]) -> np.ndarray:
    """Logarithm of how likely the five classes are by the template, (5, ...) on a box of the picture and a layer more."""
    fluid, grey, white = (downsample(each, 1e-3 * _THIN) for each in tissue_maps())
    there = 1e3 * grey.to_world(np.argwhere(np.ones(grey.data.shape, bool)))
    near = np.flatnonzero((np.abs(there) < [45, 60, 45]).all(axis=1))
    radius = np.min([nucleus.radius(there[near]) for nucleus in mni_landmarks.NUCLEI.values()], axis=0)
    deep = np.zeros(grey.data.shape, np.float32)
    deep.reshape(-1)[near] = ((1.2 - radius) / 0.3).clip(0, 1)
    matter = grey.data + white.data
    shares = [fluid.data, grey.data + deep * (matter - grey.data), white.data * (1 - deep)]
    to = np.linalg.inv(grey.affine) @ np.linalg.inv(place) @ t1.affine
    start = to[:3, 3] + to[:3, :3] @ [axis.start - 1 for axis in box]
    shape = tuple(axis.stop - axis.start + 2 for axis in box)
    pure = np.array(
        [
            ndimage.affine_transform(
                ndimage.gaussian_filter(each, 1e-3 * _VAGUE / grey.spacing), to[:3, :3], start, shape, order=1
            )
            for each in shares
        ]
    )
    pure += _RARE  # where the template has no brain, all are as likely
    dark, middle, bright = _TRUST * np.log(pure / pure.sum(axis=0))
    return np.array([dark, (dark + middle) / 2, middle, (middle + bright) / 2, bright], np.float32)


def _left_over(grey: np.ndarray, inside: np.ndarray, prior: np.ndarray, size: float) -> np.ndarray:
    """The factor by which grey values are too bright over some 20 mm, given tissues; voxels of `size` mm.

    It is found on every other voxel of 1 mm, where it is as smooth, and tissues are told apart as well. Twice: from tissues by
    grey values alone, where white matter in a dark region counts as grey and justifies the field, and first from those that the
    template has there, which an affine map misses by a fold. The one is taken that leaves white matter where the template has it,
    over `_NEAR`: a cerebellum that a field makes bright is white matter by its grey values, and its contrast is as large.
    """
    every = max(round(_THIN / size), 1)
    thin = (slice(None, None, every),) * 3
    values, within, chances = (
        grey[thin],
        np.pad(inside[thin], 1),
        np.pad(prior[(slice(None), *thin)], ((0, 0), (1, 1), (1, 1), (1, 1))),
    )
    known = np.ptp(chances, axis=0) > 0
    # The template's own shares: the cerebellum, a fifth white, would be a third by the chances, which are flattened.
    matter, white = np.exp(chances[[2, 4]] / _TRUST)
    expected = (matter + 2 * white) / (matter + white)
    best, least = np.zeros(values.shape, np.float32), np.inf
    for by_place in (0, _BY_PLACE):
        total = np.zeros(values.shape, np.float32)
        for turn in range(by_place + _FIELDS):
            even = np.pad(values * np.exp(-total), 1)
            scale, _, _ = _fit(even, within, chances, rounds=1)
            if turn < by_place:
                scale = np.where((scale > _TISSUE) & known, expected, scale)
            total += _residual(even, scale, within, every * size)[(slice(1, -1),) * 3]
        scale = _fit(np.pad(values * np.exp(-total), 1), within, chances, rounds=1)[0]
        off = _off_template(scale, expected, within & known & (scale > _TISSUE), every * size)
        if off < least:
            best, least = total, off
    step = np.full(3, 1 / every)
    return np.exp(ndimage.affine_transform(best, step, 0.0, grey.shape, order=1, mode="nearest")).astype(np.float32)


def _off_template(scale: np.ndarray, expected: np.ndarray, tissue: np.ndarray, size: float) -> float:
    """By how much the share of white matter in the tissue, smoothed, is off the template's (rms); voxels of `size` mm."""
    if not tissue.any():  # where the template has none
        return 0.0
    off = np.where(tissue, (scale - 1).clip(0, 1) - (expected - 1), 0).astype(np.float32)
    slow, share = (ndimage.gaussian_filter(each, _NEAR / size) for each in (off, tissue.astype(np.float32)))
    return float(np.sqrt(np.mean((slow / np.maximum(share, 1e-3))[tissue] ** 2)))


def _residual(grey: np.ndarray, scale: np.ndarray, inside: np.ndarray, size: float) -> np.ndarray:
    """The logarithm of grey values over what tissues should have, smoothed over some 20 mm."""
    tissue = inside & (scale > _TISSUE)
    of_grey = np.median(grey[inside & (np.abs(scale - 1) < 0.25)])
    of_white = np.median(grey[inside & (scale > 1.75)])
    expected = of_grey + (scale - 1).clip(0, 1) * (of_white - of_grey)
    logs = np.where(tissue, np.log(np.maximum(grey, 1e-3) / expected).clip(-0.3, 0.3), 0).astype(np.float32)
    slow, share = (ndimage.gaussian_filter(each, _SLOW / size) for each in (logs, tissue.astype(np.float32)))
    return np.asarray(slow / np.maximum(share, 1e-3))


def _fit(
    grey: np.ndarray, inside: np.ndarray, prior: np.ndarray, rounds: int = _ROUNDS
) -> tuple[np.ndarray, np.ndarray, float]:
    """Expected position between the pure tissues, 0 fluid, 1 grey, 2 white; most likely share of white matter; contrast.

    The first two float32 for each voxel, and meaningless outside. The share knows no neighbours: these make voxels pure.
    """
    means, sigma, weights = _fit_histogram(grey[inside])
    new = np.zeros((len(_SHARES), *grey.shape), np.float32)
    old = np.zeros_like(new)
    for sweep in range(rounds + 1):
        moments, expected = np.zeros((len(_SHARES), 3)), np.zeros(len(_SHARES))
        for i in range(1, len(grey) - 1, _SLAB):
            slab = slice(i, min(i + _SLAB, len(grey) - 1))
            z = (grey[slab] - (_SHARES @ means).astype(np.float32)[:, None, None, None]) / np.float32(sigma)
            energy = -0.5 * z**2 + np.log(weights).astype(np.float32)[:, None, None, None] + prior[:, slab]
            if sweep:
                energy += np.float32(_COUPLING) * _neighbours(old, slab)
            energy -= energy.max(axis=0)
            share = np.exp(energy, out=energy)
            share *= inside[slab] / share.sum(axis=0)
            new[:, slab] = share
            by_place = weights.astype(np.float32)[:, None, None, None] * np.exp(prior[:, slab])
            expected += (by_place * (inside[slab] / by_place.sum(axis=0))).reshape(len(share), -1).sum(axis=1)
            flat = grey[slab].ravel()
            moments += share.reshape(len(share), -1) @ np.column_stack([np.ones_like(flat), flat, flat**2])
        # Weights such that the classes have as many voxels by place as by grey value.
        before = weights
        means, sigma, _ = _maximised(moments)
        weights = np.maximum(before * moments[:, 0] / np.maximum(expected, 1e-6), 1e-6)
        weights /= weights.sum()
        old, new = new, old
    fluid, matter, white = means.astype(np.float32)
    grey_share = np.clip((grey - fluid) / (matter - fluid), 0, 1)
    white_share = np.clip((grey - matter) / (white - matter), 0, 1)
    return (
        old[1] * grey_share + old[2] + old[3] * (1 + white_share) + 2 * old[4],
        white_share,
        float((means[2] - means[1]) / sigma),
    )


def _fit_histogram(values: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """Means of the three pure tissues, the common standard deviation and the weights of the five classes."""
    means = np.quantile(values, _START)
    sigma, weights = (means[2] - means[0]) / 8, np.full(len(_SHARES), 1 / len(_SHARES))
    counts, edges = np.histogram(values, _BINS, (0, 1))
    centres = (edges[1:] + edges[:-1]) / 2
    for _ in range(_ROUNDS_OF_BINS):
        energy = -0.5 * ((centres - (_SHARES @ means)[:, None]) / sigma) ** 2 + np.log(weights)[:, None]
        share = np.exp(energy - energy.max(axis=0))
        share *= counts / share.sum(axis=0)
        means, sigma, weights = _maximised(share @ np.column_stack([np.ones_like(centres), centres, centres**2]))
    return means, sigma, weights


def _maximised(moments: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """The M-step from Σp, Σpy, Σpy² of the classes (5, 3): least squares for the means of the three pure tissues."""
    count, first, second = moments.T
    means = np.linalg.solve(_SHARES.T @ (count[:, None] * _SHARES), _SHARES.T @ first)
    at = _SHARES @ means
    variance = (second - 2 * at * first + at**2 * count).sum() / count.sum()
    # A floor of half a bin, and of a voxel in a million, for pictures made of few values.
    return means, float(np.sqrt(max(variance, (0.5 / _BINS) ** 2))), np.maximum(count / count.sum(), 1e-6)


def _neighbours(share: np.ndarray, slab: slice) -> np.ndarray:
    """Sum over the six neighbours of the voxels in a slab of layers, (5, layers, ny, nz); zero on the faces."""
    here, total = share[:, slab], share[:, slab.start - 1 : slab.stop - 1] + share[:, slab.start + 1 : slab.stop + 1]
    total[:, :, 1:] += here[:, :, :-1]
    total[:, :, :-1] += here[:, :, 1:]
    total[..., 1:] += here[..., :-1]
    total[..., :-1] += here[..., 1:]
    return total


def _drown_islands(labels: np.ndarray) -> None:
    """Small pieces of grey or white matter take the label that most of their faces look at."""
    for tissue in (WHITE, GREY):
        remove_islands(labels, tissue)


def _check_contrast(labels: np.ndarray) -> None:
    """Refuse what cannot be the labels of a T1: white matter is a third to a half of a brain, and inside."""
    inside = labels != OUTSIDE
    white = labels == WHITE
    share = white.sum() / inside.sum()
    if not 0.15 <= share <= 0.65:
        raise InputError("image", f"a brain of which {100 * share:.0f} % is bright", f"15 to 65 %: {_WANTED}")
    rind = inside & ~ndimage.binary_erosion(inside, iterations=_RIND)
    outer = white[rind].sum() / rind.sum()
    if outer > share:
        found = f"bright in {100 * outer:.0f} % of its outer {_RIND} mm and {100 * share:.0f} % of the whole"
        raise InputError("image", f"a brain {found}", _WANTED)
