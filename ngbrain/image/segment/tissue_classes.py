"""Segmentation of fluid, grey and white matter, and ventricles, with the share of white matter in a voxel."""

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
from ngbrain.look import BriefText

OUTSIDE, CSF, GREY, WHITE, VENTRICLE = range(5)
NAMES = ("outside", "csf", "grey", "white", "ventricle")

_WANTED = "a T1, in which white matter is brighter than grey and grey brighter than fluid"
# Shares of the pure tissues (fluid, grey, white) in the five classes; every second class is a mixture.
_SHARES = np.array([[1, 0, 0], [0.5, 0.5, 0], [0, 1, 0], [0, 0.5, 0.5], [0, 0, 1]])
_START = (0.05, 0.45, 0.85)  # quantiles of the grey values in a brain that are near those of the pure tissues
# Relative to the step from grey to white matter, and to the noise: what is brighter than white matter by more is a contrast
# agent or fat. A few ml of it would take the brightest class for itself.
_VESSEL, _NOISES = 0.6, 2.0
_BINS, _ROUNDS_OF_BINS = 512, 200
_COUPLING, _ROUNDS = 0.4, 4
_FIELDS, _BY_PLACE = (
    4,
    2,
)  # corrections of the residual bias field, and how many of them first use the template's tissues
_TISSUE = 0.75  # threshold of tissue, 0 for fluid and 1 for grey matter
_SLOW = 20.0  # mm, standard deviation of the Gaussian that smooths the field
_NEAR = 10.0  # mm, standard deviation of the Gaussian for comparing tissues with the template
_THIN = 2.0  # mm, voxel spacing for smooth quantities
# Maximum standard deviation of smoothing, in voxels of the scan; reached at this noise, relative to the grey-white step.
_WIDEST, _NOISY = 0.6, 0.2
_FLUID_ENDS = 0.5  # upper limit of fluid, 0 for fluid and 1 for grey matter
_VAGUE = 5.0  # mm, smoothing of the template's tissue maps
_TRUST, _RARE = 0.8, 0.02  # exponent of the prior, and the minimum share of a tissue
_SLAB = 8  # layers of voxels per chunk, which fit into the processor's cache
_RIND = 3  # mm, outer layer of the brain
_LEAST_VENTRICLES = 2.0  # ml


@dataclass(frozen=True, eq=False, repr=False)
class Labels(BriefText):
    """Tissue of each voxel.

    Parameters
    ----------
    volume : Volume
        uint8: OUTSIDE, CSF, GREY, WHITE or VENTRICLE, see `NAMES`.
    white : Volume
        float32: share of white matter by the grey value of a voxel alone, 0 to 1; as noisy as the scan.
    contrast : float
        From grey to white matter, in standard deviations of the grey values of one tissue.
    """

    volume: Volume
    white: Volume
    contrast: float

    def volumes_ml(self) -> dict[str, float]:
        """Volume (ml) of each tissue, by name."""
        counts = np.bincount(self.volume.data.ravel(), minlength=len(NAMES)) * self.volume.voxel_volume * 1e6
        return {name: float(counts[label]) for label, name in enumerate(NAMES) if label != OUTSIDE}


def segment(t1: Volume, brain: np.ndarray, place: np.ndarray, voxel: float = 1e-3) -> Labels:
    """Segment the tissues of a T1.

    A mixture of five Gaussians with a common variance: fluid, grey and white matter, and between them voxels of two tissues,
    whose mean is that of the two. It is fitted by EM first to the histogram, then to the image with a Potts prior between face
    neighbours (mean field). The prior of a tissue also follows its share in the template within some mm, the accuracy of an
    affine map. The remaining bias field over 20 mm is removed, and the fit repeated. Noise is smoothed by up to 0.6 voxels of
    the scan. The label of a voxel is its expected position between the three pure tissues. The variance is shared, because
    separate ones shrink onto white matter, the most homogeneous tissue, and lose a quarter of it.

    Grey values may have any scale and offset. A slow bias field must be corrected before
    (`ngbrain.image.preprocess.bias_field`): 20 % of it cost 0.06 of the Dice overlap.

    Parameters
    ----------
    t1 : Volume
        The scan, on voxels of 1 mm.
    brain : numpy.ndarray
        (nx, ny, nz) mask of the brain.
    place : numpy.ndarray
        (4, 4), from points (m) of the MNI152 template to points (m) of the head.
    voxel : float, optional
        Edge (m) of the voxels of the original scan.

    Returns
    -------
    Labels

    Raises
    ------
    InputError
        The image is not a T1 (one grey value in 40 % of the brain; less than 15 % or more than 65 % white; more white near the
        surface than inside), or the ventricles found have less than 2 ml.

    References
    ----------
    Model: Shattuck et al. 2001, doi:10.1006/nimg.2000.0730. Mean field: Zhang 1992, doi:10.1109/78.157297.
    """
    box = ndimage.find_objects(brain.astype(np.uint8))[0]
    inside = np.pad(brain[box], 1)  # a margin, so that all voxels have neighbours
    grey = np.pad(_normalise(t1.data, brain)[box], 1)
    prior = _prior(t1, place, box)
    smooth = _smooth(grey, inside, voxel / t1.spacing)
    field = _residual_field(smooth, inside, prior, 1e3 * float(t1.spacing.mean()))
    grey, smooth = grey / field, smooth / field
    scale, share, contrast = _fit(smooth, inside, prior)
    labels = np.where(inside, CSF + (scale > _FLUID_ENDS) + (scale > 1.5), OUTSIDE).astype(np.uint8, order="C")
    _remove_islands(labels)
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
    _remove_islands(labels)  # components cut off by the edge of the ventricles

    core = (slice(1, -1),) * 3
    whole, white = np.zeros(brain.shape, np.uint8), np.zeros(brain.shape, np.float32)
    whole[box] = labels[core]
    white[box] = np.where(inside, share, 0)[core]
    return Labels(Volume(whole, t1.affine), Volume(white, t1.affine), contrast)


def _normalise(data: np.ndarray, brain: np.ndarray) -> np.ndarray:
    """Grey values, float32, scaled so that nearly all in the brain are in 0..1, and clipped."""
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


def _smooth(grey: np.ndarray, inside: np.ndarray, voxel: np.ndarray) -> np.ndarray:
    """Grey values smoothed within the brain, the more the noisier; `voxel` (3,): voxel size of the scan in voxels of the image."""
    _, matter, white = np.quantile(grey[inside], _START)
    noise = _noise(grey, inside, max(round(float(voxel[0])), 1)) / max(white - matter, 1e-6)
    width = _WIDEST * min(noise / _NOISY, 1.0) * voxel
    share = ndimage.gaussian_filter(inside.astype(np.float32), width)
    smooth = ndimage.gaussian_filter(np.where(inside, grey, 0), width) / np.maximum(share, 1e-3)
    return np.where(inside, smooth, grey).astype(np.float32)


def _prior(t1: Volume, place: np.ndarray, box: tuple[slice, ...]) -> np.ndarray:
    """Log-prior of the five classes by the template, (5, ...), on a box of the image with a margin of one voxel."""
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
    pure += _RARE  # outside the template's brain all are equally likely
    dark, middle, bright = _TRUST * np.log(pure / pure.sum(axis=0))
    return np.array([dark, (dark + middle) / 2, middle, (middle + bright) / 2, bright], np.float32)


def _residual_field(grey: np.ndarray, inside: np.ndarray, prior: np.ndarray, size: float) -> np.ndarray:
    """Residual bias field over some 20 mm, given tissues; voxels of `size` mm.

    It is computed on every other voxel of 1 mm, as it is smooth. Two estimates are compared: from tissues by grey values alone,
    where white matter in a dark region counts as grey and justifies the field; and starting from the tissues of the template,
    which an affine map misplaces by a fold. The one is taken whose white matter is closer to the template's, over `_NEAR`: a
    cerebellum brightened by the field is white matter by its grey values, with as large a contrast.
    """
    every = max(round(_THIN / size), 1)
    thin = (slice(None, None, every),) * 3
    values, within, chances = (
        grey[thin],
        np.pad(inside[thin], 1),
        np.pad(prior[(slice(None), *thin)], ((0, 0), (1, 1), (1, 1), (1, 1))),
    )
    known = np.ptp(chances, axis=0) > 0
    # The template's original shares: by the flattened prior the cerebellum, a fifth white, would be a third white.
    matter, white = np.exp(chances[[2, 4]] / _TRUST)
    expected = (matter + 2 * white) / (matter + white)
    best, least = np.zeros(values.shape, np.float32), np.inf
    for by_place in (0, _BY_PLACE):
        total = np.zeros(values.shape, np.float32)
        for turn in range(by_place + _FIELDS):
            corrected = np.pad(values * np.exp(-total), 1)
            scale, _, _ = _fit(corrected, within, chances, rounds=1)
            if turn < by_place:
                scale = np.where((scale > _TISSUE) & known, expected, scale)
            total += _residual(corrected, scale, within, every * size)[(slice(1, -1),) * 3]
        scale = _fit(np.pad(values * np.exp(-total), 1), within, chances, rounds=1)[0]
        off = _deviation_from_template(scale, expected, within & known & (scale > _TISSUE), every * size)
        if off < least:
            best, least = total, off
    step = np.full(3, 1 / every)
    return np.exp(ndimage.affine_transform(best, step, 0.0, grey.shape, order=1, mode="nearest")).astype(np.float32)


def _deviation_from_template(scale: np.ndarray, expected: np.ndarray, tissue: np.ndarray, size: float) -> float:
    """Deviation (rms) of the smoothed share of white matter in the tissue from the template's; voxels of `size` mm."""
    if not tissue.any():  # where the template has none
        return 0.0
    off = np.where(tissue, (scale - 1).clip(0, 1) - (expected - 1), 0).astype(np.float32)
    slow, share = (ndimage.gaussian_filter(each, _NEAR / size) for each in (off, tissue.astype(np.float32)))
    return float(np.sqrt(np.mean((slow / np.maximum(share, 1e-3))[tissue] ** 2)))


def _residual(grey: np.ndarray, scale: np.ndarray, inside: np.ndarray, size: float) -> np.ndarray:
    """Logarithm of grey values relative to the values expected of the tissues, smoothed over some 20 mm."""
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

    The first two are float32 per voxel, and undefined outside. The share ignores the neighbours, which make voxels pure.
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
        # Weights such that prior and posterior class volumes agree.
        before = weights
        means, sigma, _ = _m_step(moments)
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
        means, sigma, weights = _m_step(share @ np.column_stack([np.ones_like(centres), centres, centres**2]))
    return means, sigma, weights


def _m_step(moments: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """The M-step from Σp, Σpy, Σpy² of the classes (5, 3): least squares for the means of the three pure tissues."""
    count, first, second = moments.T
    means = np.linalg.solve(_SHARES.T @ (count[:, None] * _SHARES), _SHARES.T @ first)
    at = _SHARES @ means
    variance = (second - 2 * at * first + at**2 * count).sum() / count.sum()
    # A floor of half a bin, and of a voxel in a million, for images with few distinct values.
    return means, float(np.sqrt(max(variance, (0.5 / _BINS) ** 2))), np.maximum(count / count.sum(), 1e-6)


def _neighbours(share: np.ndarray, slab: slice) -> np.ndarray:
    """Sum over the six neighbours of the voxels in a slab of layers, (5, layers, ny, nz); zero on the faces."""
    here, total = share[:, slab], share[:, slab.start - 1 : slab.stop - 1] + share[:, slab.start + 1 : slab.stop + 1]
    total[:, :, 1:] += here[:, :, :-1]
    total[:, :, :-1] += here[:, :, 1:]
    total[..., 1:] += here[..., :-1]
    total[..., :-1] += here[..., 1:]
    return total


def _remove_islands(labels: np.ndarray) -> None:
    """Relabel small components of grey or white matter by the majority of their neighbours."""
    for tissue in (WHITE, GREY):
        remove_islands(labels, tissue)


def _check_contrast(labels: np.ndarray) -> None:
    """Refuse labels that cannot be those of a T1: white matter is a third to a half of a brain, and inside."""
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
