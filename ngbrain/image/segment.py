"""From grey values to tissue: fluid, grey and white matter, ventricles, and the share of white matter in a voxel."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image.topology import drown
from ngbrain.image.ventricles import at_half_height, find_ventricles
from ngbrain.image.volume import Volume

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
_COUPLING, _ROUNDS = 0.75, 4
_SLAB = 8  # layers of voxels at a time, so that they stay in the cache
_RIND = 3  # mm
_LEAST_VENTRICLES = 2.0  # ml


@dataclass(frozen=True, eq=False)
class Labels:
    """Tissue in each voxel.

    volume  uint8: OUTSIDE, CSF, GREY, WHITE or VENTRICLE, named in NAMES
    white   float32: share of white matter that the grey value of a voxel speaks for, 0 to 1; as noisy as the scan
    """

    volume: Volume
    white: Volume

    def volumes_ml(self) -> dict[str, float]:
        """Millilitres of each tissue by name."""
        counts = np.bincount(self.volume.data.ravel(), minlength=len(NAMES)) * self.volume.voxel_volume * 1e6
        return {name: float(counts[label]) for label, name in enumerate(NAMES) if label != OUTSIDE}


def segment(t1: Volume, brain: np.ndarray) -> Labels:
    """Label the tissue in a T1, given the mask `brain` (nx, ny, nz), on voxels of 1 mm.

    A mixture of five Gaussians of one variance: fluid, grey, white, and between them voxels of two tissues, whose mean
    is the mean of the two. Fitted by EM first to the histogram, then to the picture with a Potts prior between voxels
    with a common face (mean field). A voxel is labelled by its expected position between the three pure tissues.
    The variance is shared: free ones shrink onto white matter, the most uniform tissue, and lose a quarter of it.

    Any scale and offset of the grey values will do. A slow field over the picture is for `ngbrain.image.bias` to take
    out first: 20 % of it cost 0.06 of the Dice overlap.
    The model: Shattuck et al. 2001, doi:10.1006/nimg.2000.0730; mean field: Zhang 1992, doi:10.1109/78.157297.

    Raises:
        InputError: not a T1 (one grey value in 40 % of the brain; less than 15 % or more than 65 % of it white; more
            of it white near the surface than inside), or ventricles of less than 2 ml found.
    """
    box = ndimage.find_objects(brain.astype(np.uint8))[0]
    inside = np.pad(brain[box], 1)  # a layer of outside, so that neighbours need no cases
    grey = np.pad(_normalised(t1.data, brain)[box], 1)
    scale, share = _fit(grey, inside)
    labels = np.where(inside, CSF + (scale > 0.5) + (scale > 1.5), OUTSIDE).astype(np.uint8, order="C")
    _drown_islands(labels)
    _check_contrast(labels)
    ventricles = find_ventricles(inside, labels == CSF, labels == WHITE)
    if ventricles.any():
        ventricles = at_half_height(ventricles, grey, (labels == GREY) | (labels == WHITE))
    size = ventricles.sum() * t1.voxel_volume * 1e6
    if size < _LEAST_VENTRICLES:
        raise InputError("image", f"a brain with ventricles of {size:.1f} ml", f"at least {_LEAST_VENTRICLES:g} ml")
    labels[ventricles] = VENTRICLE
    _drown_islands(labels)  # what the edge of the ventricles has cut off

    core = (slice(1, -1),) * 3
    whole, white = np.zeros(brain.shape, np.uint8), np.zeros(brain.shape, np.float32)
    whole[box] = labels[core]
    white[box] = np.where(inside, share, 0)[core]
    return Labels(Volume(whole, t1.affine), Volume(white, t1.affine))


def _normalised(data: np.ndarray, brain: np.ndarray) -> np.ndarray:
    """Grey values, float32, such that nearly all in the brain are in 0..1; the others become 0 or 1."""
    low, *start, high = np.quantile(data[brain], [0.001, *_START, 0.999])
    for one, other in pairwise(start):
        if one == other:
            raise InputError("image", f"a brain of which 40 % or more have the grey value {one:g}", _WANTED)
    high = min(high, start[2] + _VESSEL * (start[2] - start[1]) + _NOISES * _noise(data, brain))
    return ((data - low) / (high - low)).clip(0, 1).astype(np.float32)


def _noise(data: np.ndarray, brain: np.ndarray) -> float:
    """Standard deviation of the noise, from the median difference of neighbours; anatomy adds a little."""
    steps = np.abs(np.diff(data, axis=0))[brain[1:] & brain[:-1]]
    return float(np.median(steps)) / (0.6745 * 2**0.5)


def _fit(grey: np.ndarray, inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Expected position between the pure tissues, 0 fluid, 1 grey, 2 white, and most likely share of white matter.

    Both float32 for each voxel, and meaningless outside. The share knows no neighbours: these make voxels pure.
    """
    means, sigma, weights = _fit_histogram(grey[inside])
    new = np.zeros((len(_SHARES), *grey.shape), np.float32)
    old = np.zeros_like(new)
    for sweep in range(_ROUNDS + 1):
        moments = np.zeros((len(_SHARES), 3))
        for i in range(1, len(grey) - 1, _SLAB):
            slab = slice(i, min(i + _SLAB, len(grey) - 1))
            z = (grey[slab] - (_SHARES @ means).astype(np.float32)[:, None, None, None]) / np.float32(sigma)
            energy = -0.5 * z**2 + np.log(weights).astype(np.float32)[:, None, None, None]
            if sweep:
                energy += np.float32(_COUPLING) * _neighbours(old, slab)
            energy -= energy.max(axis=0)
            share = np.exp(energy, out=energy)
            share *= inside[slab] / share.sum(axis=0)
            new[:, slab] = share
            flat = grey[slab].ravel()
            moments += share.reshape(len(share), -1) @ np.column_stack([np.ones_like(flat), flat, flat**2])
        means, sigma, weights = _maximised(moments)
        old, new = new, old
    fluid, matter, white = means.astype(np.float32)
    grey_share = np.clip((grey - fluid) / (matter - fluid), 0, 1)
    white_share = np.clip((grey - matter) / (white - matter), 0, 1)
    return old[1] * grey_share + old[2] + old[3] * (1 + white_share) + 2 * old[4], white_share


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
        drown(labels, tissue)


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
