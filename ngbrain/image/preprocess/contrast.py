"""Is a picture of a head a T1? Which of fluid, grey and white matter is dark in it, and which is bright."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations

import numpy as np
from scipy import ndimage

from ngbrain.image.preprocess import mni_landmarks
from ngbrain.image.preprocess.registration import downsample
from ngbrain.image.read.volume import Volume, mni152, template_map

TISSUES = ("fluid", "grey", "white")
_T1 = (0, 1, 2)
_STEP = 3  # voxels between the points of the template that are looked at
_VOXEL = 2e-3  # m, of the head
_DEEP = 3.0  # mm inside the brain
_LOCAL = 20.0  # mm, standard deviation of the Gaussian over which grey values are normalised
_OUTSIDE_NUCLEI = 1.2  # radii: deep grey matter is too bright in a T1 and too dark in others to tell them apart
_BLUR = 4.0  # mm, over which an affine map misses folds and ventricles
_FEW = 0.02  # least share of a tissue anywhere
_QUANTILES = (0.1, 0.45, 0.8)  # of the grey values, near those of the darkest, the middle and the brightest tissue
_NARROWEST = 0.03  # of the spread of all values, below which no tissue's spread goes
_ROUNDS = 30


@dataclass(frozen=True)
class Contrast:
    """How bright the tissues of a head are.

    order  TISSUES from dark to bright
    step   from grey to white matter, in standard deviations of all grey values; about 1 in a T1
    """

    order: tuple[str, ...]
    step: float


def measure_contrast(head: Volume, affine: np.ndarray) -> Contrast:
    """Measure which tissue is how bright where the template's maps of tissues lie in a head.

    affine  (4, 4), takes points of the MNI152 template (m) to points of the head (m)

    A mixture of three Gaussians, each weighed by where its tissue is in the template, is fitted to the grey values of the
    cerebrum from each of the six orders; the one that explains them best is taken. Values are normalised locally, by the brain
    alone: with the dark around it in the mean, the cortex would be too bright.

    Raises:
        MissingExtra: nilearn is not installed.

    >>> scan = mni152()
    >>> measure_contrast(scan.volume, np.eye(4)).order
    ('fluid', 'grey', 'white')
    >>> measure_contrast(Volume(np.where(scan.volume.data > 0, 1 - scan.volume.data, 0), scan.volume.affine), np.eye(4)).order
    ('white', 'grey', 'fluid')
    """
    brain, points, looked, share = _sampled()
    values = downsample(head, _VOXEL).interpolate(points @ affine[:3, :3].T + affine[:3, 3])
    values = _clipped(_normalised(_clipped(values), brain)[looked])
    starts = np.quantile(values, _QUANTILES)
    fits = [_fitted(values, share, starts[list(order)]) for order in permutations(_T1)]
    _, means = max(fits, key=lambda fit: fit[0])
    step = float((means[2] - means[1]) / max(values.std(), 1e-12))
    return Contrast(tuple(TISSUES[i] for i in np.argsort(means)), step)


def _clipped(values: np.ndarray) -> np.ndarray:
    return values.clip(*np.quantile(values, [0.01, 0.99]))


def _normalised(values: np.ndarray, brain: np.ndarray) -> np.ndarray:
    """Values (n,) at the n points of a mask less their mean in the mask over some 20 mm, divided by their spread there."""
    width = _LOCAL / (_STEP * 1e3 * mni152().volume.spacing)
    values = (values - values.mean()) / (values.std() + 1e-12)
    picture = np.zeros((3, *brain.shape), np.float32)
    picture[:, brain] = np.ones_like(values), values, values**2
    share, first, second = (ndimage.gaussian_filter(each, width)[brain] for each in picture)
    mean = first / share
    return np.asarray((values - mean) / np.sqrt(np.maximum(second / share - mean**2, 0) + 1e-12))


def _fitted(values: np.ndarray, share: np.ndarray, means: np.ndarray) -> tuple[float, np.ndarray]:
    """The mean log-likelihood and the means (3,) of the tissues that EM from some `means` leads to."""
    least = _NARROWEST * values.std() + 1e-12
    spreads, likelihood = np.full(3, values.std() / 3 + 1e-12), -np.inf
    for _ in range(_ROUNDS):
        energy = np.log(share) - 0.5 * ((values - means[:, None]) / spreads[:, None]) ** 2 - np.log(spreads)[:, None]
        most = energy.max(axis=0)
        belongs = np.exp(energy - most)
        total = belongs.sum(axis=0)
        likelihood = float((most + np.log(total)).mean())
        belongs /= total
        count = belongs.sum(axis=1) + 1e-12
        means = belongs @ values / count
        spreads = np.sqrt((belongs * (values - means[:, None]) ** 2).sum(axis=1) / count).clip(least)
    return likelihood, means


@lru_cache(maxsize=1)
def _sampled() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A thinned mask of the template's brain, its n points (n, 3) in m, which (n,) of them are looked at, as they lie in the
    cerebrum, and the shares (3, ...) of TISSUES around these."""
    template = mni152().volume
    brain = template.data[::_STEP, ::_STEP, ::_STEP] != 0
    points = template.to_world(_STEP * np.argwhere(brain))
    there = 1e3 * points
    deep = ndimage.distance_transform_edt(brain, sampling=_STEP * 1e3 * template.spacing)[brain] > _DEEP
    nuclei = np.min([nucleus.radius(there) for nucleus in mni_landmarks.NUCLEI.values()], axis=0)
    looked = deep & (there[:, 2] > mni_landmarks.tentorium(there)) & (nuclei > _OUTSIDE_NUCLEI)
    maps = [downsample(each, _VOXEL) for each in tissue_maps()]
    blurred = [Volume(ndimage.gaussian_filter(m.data, 1e-3 * _BLUR / m.spacing), m.affine) for m in maps]
    share = np.array([each.interpolate(points[looked]) for each in blurred]).clip(_FEW)
    return brain, points, looked, share / share.sum(axis=0)


@lru_cache(maxsize=1)
def tissue_maps() -> tuple[Volume, Volume, Volume]:
    """Shares of fluid, grey and white matter in the voxels of MNI152's brain, 0 to 1, by the maps that nilearn brings along.

    Raises:
        MissingExtra: nilearn is not installed.
    """
    grey, white = (template_map(name)[0] for name in ("gm", "wm"))
    template = mni152().volume
    fluid = np.where(template.data != 0, 1 - grey - white, 0).clip(0)
    return Volume(fluid, template.affine), Volume(grey, template.affine), Volume(white, template.affine)
