"""Order and contrast of the grey values of fluid, grey and white matter, to recognise a T1."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations

import numpy as np
from scipy import ndimage

from ngbrain.image.preprocess import mni_landmarks
from ngbrain.image.preprocess.registration import downsample
from ngbrain.image.read.template import mni152, template_map
from ngbrain.image.read.volume import Volume

TISSUES = ("fluid", "grey", "white")
_T1 = (0, 1, 2)
_STEP = 3  # voxels between the sampled points of the template
_VOXEL = 2e-3  # m, of the head
_DEEP = 3.0  # mm inside the brain
_LOCAL = 20.0  # mm, standard deviation of the Gaussian over which grey values are normalised
_OUTSIDE_NUCLEI = 1.2  # radii: deep grey matter, too bright in a T1 and too dark in other contrasts, is left out
_BLUR = 4.0  # mm, error of an affine map at folds and ventricles
_FEW = 0.02  # minimum probability of a tissue
_QUANTILES = (0.1, 0.45, 0.8)  # of the grey values, near those of the darkest, the middle and the brightest tissue
_NARROWEST = 0.03  # minimum standard deviation of a tissue, relative to that of all values
_ROUNDS = 30


@dataclass(frozen=True)
class Contrast:
    """Brightness of the tissues of a head.

    Parameters
    ----------
    order : tuple of str
        `TISSUES` from dark to bright.
    step : float
        From grey to white matter, in standard deviations of all grey values; about 1 in a T1.
    """

    order: tuple[str, ...]
    step: float


def measure_contrast(head: Volume, affine: np.ndarray) -> Contrast:
    """Measure the brightness of the tissues of a head, by the template's tissue maps.

    A mixture of three Gaussians, weighted by the template's tissue probabilities, is fitted to the grey values of the cerebrum,
    starting from each of the six orders; the most likely fit is taken. Grey values are normalised locally, within the brain
    only: the dark background in the local mean would make the cortex too bright.

    Parameters
    ----------
    head : Volume
        The scan.
    affine : numpy.ndarray
        (4, 4), from points (m) of the MNI152 template to points (m) of the head.

    Returns
    -------
    Contrast

    Raises
    ------
    MissingExtra
        nilearn is not installed.

    Examples
    --------
    >>> scan = mni152()
    >>> measure_contrast(scan.volume, np.eye(4)).order
    ('fluid', 'grey', 'white')
    >>> measure_contrast(Volume(np.where(scan.volume.data > 0, 1 - scan.volume.data, 0), scan.volume.affine), np.eye(4)).order
    ('white', 'grey', 'fluid')
    """
    brain, points, looked, share = _sample_template()
    values = downsample(head, _VOXEL).interpolate(points @ affine[:3, :3].T + affine[:3, 3])
    values = _clip_outliers(_normalise(_clip_outliers(values), brain)[looked])
    starts = np.quantile(values, _QUANTILES)
    fits = [_fit_mixture(values, share, starts[list(order)]) for order in permutations(_T1)]
    _, means = max(fits, key=lambda fit: fit[0])
    step = float((means[2] - means[1]) / max(values.std(), 1e-12))
    return Contrast(tuple(TISSUES[i] for i in np.argsort(means)), step)


def _clip_outliers(values: np.ndarray) -> np.ndarray:
    return values.clip(*np.quantile(values, [0.01, 0.99]))


def _normalise(values: np.ndarray, brain: np.ndarray) -> np.ndarray:
    """Values (n,) at the n points of a mask minus their local mean over some 20 mm, divided by their local standard deviation."""
    width = _LOCAL / (_STEP * 1e3 * mni152().volume.spacing)
    values = (values - values.mean()) / (values.std() + 1e-12)
    picture = np.zeros((3, *brain.shape), np.float32)
    picture[:, brain] = np.ones_like(values), values, values**2
    share, first, second = (ndimage.gaussian_filter(each, width)[brain] for each in picture)
    mean = first / share
    return np.asarray((values - mean) / np.sqrt(np.maximum(second / share - mean**2, 0) + 1e-12))


def _fit_mixture(values: np.ndarray, share: np.ndarray, means: np.ndarray) -> tuple[float, np.ndarray]:
    """Mean log-likelihood and tissue means (3,) of EM, started from `means`."""
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
def _sample_template() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A subsampled mask of the template's brain, its n points (n, 3) in m, the points used (n,), which lie in the cerebrum, and
    the tissue probabilities (3, ...) at these.
    """
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
    """Shares of fluid, grey and white matter in the voxels of the MNI152 brain, 0 to 1, from the maps that nilearn ships.

    Raises
    ------
    MissingExtra
        nilearn is not installed.
    """
    grey, white = (template_map(name)[0] for name in ("gm", "wm"))
    template = mni152().volume
    fluid = np.where(template.data != 0, 1 - grey - white, 0).clip(0)
    return Volume(fluid, template.affine), Volume(grey, template.affine), Volume(white, template.affine)
