"""Affine registration of the template brain to a head, without an initial guess."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import fft, ndimage

from ngbrain.errors import InputError
from ngbrain.image.read.volume import Volume
from ngbrain.look import BriefText

ALIKE = 0.4
"""Minimum likeness of two brains. Measured: T1s of heads 0.49 and more, stripped ones 0.7 and more, T2s 0.35 to 0.5."""
INSIDE = 0.2
"""Minimum correlation inside two brains. Measured: T1s 0.34 and more, noise in the shape of a brain 0.07."""

_COARSE, _FINE, _FINEST = 8e-3, 4e-3, 2e-3  # m, voxels of the search, of the fit and of its end
_LOCAL = 20e-3  # m, standard deviation of the Gaussian over which grey values are normalised
_FLOOR = 0.05  # relative to a bright voxel: smaller local deviations are background noise, which is not amplified
_BRIGHT = 0.95  # quantile of the grey values of a head at which they are clipped, as fat carries no information
_FLUID = 8e-3  # m, width of the dark layer around the brain: fluid and bone
_SCALP = (9e-3, 17e-3)  # m, distance range of the bright scalp from the brain
_FOREHEAD = -5e-3  # m, height in the template above which a scalp is added; faces and necks vary too much
_SIZES = (0.82, 0.90, 0.98, 1.07)
_STARTS, _APART = 3, 25e-3  # candidates per search and size, and the minimum distance (m) between their corners
_PATCH = 44  # voxels, edge of the cube that contains the template at any rotation and size
_ROUNDS = 30
_NEAR, _SETTLED = 0.05, 1e-4  # gain in log-likelihood at which the iteration stops, and in the last one
_ARM = 0.07  # m: a rotation by 1 moves the brain's surface about as much as a translation by this
# Adult brains relative to MNI152, which is larger than most: logarithm of the mean stretch, and of its deviations by axis.
_SIZE, _SIZE_SPREAD, _SHAPE_SPREAD = -0.06, 0.08, 0.035
_SPREADS = np.array([_SIZE_SPREAD] + 5 * [_SHAPE_SPREAD])
_INDEPENDENT = 12e-3  # m between points whose errors are independent
_ENOUGH, _ENOUGH_BARE = (
    0.45,
    0.65,
)  # likeness below which larger rotations are searched too; the second for stripped heads
_BARE = 0.3  # share of a stripped image that is exactly 0
_LEAST = 0.5  # litres
_DEPTH, _SMOOTH = 8e-3, 3e-3  # m, for `correlation_inside`
# Degrees about the axes right, front and up.
_TURNS = [(nod, 0, 0) for nod in (-40, -20, 0, 20, 40)]
_TURNS += [(nod, side, 0) for nod in (-25, 0, 25) for side in (-20, 20)]
_TURNS += [(nod, 0, side) for nod in (-25, 0, 25) for side in (-20, 20)]
_FAR_TURNS = list(product((-60, -30, 0, 30, 60), (-50, -25, 0, 25, 50), (-50, -25, 0, 25, 50)))


@dataclass(frozen=True, eq=False, repr=False)
class Alignment(BriefText):
    """Alignment of the template with a head.

    Parameters
    ----------
    affine : numpy.ndarray
        (4, 4), from points (m) of the template to points (m) of the head.
    likeness : float
        Correlation of the locally normalised grey values of the two, over the brain and its surroundings, -1 to 1.
    """

    affine: np.ndarray
    likeness: float


def align(head: Volume, template: Volume, start: np.ndarray | None = None, far: bool = True) -> Alignment:
    """Register the template to a head by an affine map.

    Grey values are normalised by their local mean and standard deviation over some 20 mm, which removes bias fields and
    differences between scanners. All translations of the template are searched by Fourier transforms, at 17 rotations (125 more
    if none fits) and four sizes, on voxels of 8 mm, with the bare template and with a scalp added to it. The best candidates
    are refine by damped Gauss-Newton steps (Levenberg) on the log-likelihood of the grey values plus a prior of the stretches
    among adults; the candidate that explains both images best is returned.

    Parameters
    ----------
    head : Volume
        A head with or without skull.
    template : Volume
        A brain on an exact background of 0.
    start : numpy.ndarray, optional
        (4, 4), initial guess, from another image of the same head; the search is only run if it does not fit.
    far : bool, optional
        Whether more rotations are searched if none of the first ones fits.

    Returns
    -------
    Alignment

    Raises
    ------
    InputError
        The bright part of `head` has less than half a litre.

    Examples
    --------
    >>> from ngbrain.image.read.template import mni152
    >>> template = mni152().volume
    >>> np.abs(align(template, template).affine[:3, 3]).max() < 1e-3
    np.True_
    """
    _check_bright(head)
    fine = downsample(head, _FINE)
    coarse = normalise_locally(downsample(fine, _COARSE))
    fine = normalise_locally(fine)
    finest = normalise_locally(downsample(head, _FINEST))
    variants = _template_variants(template)
    enough = _ENOUGH_BARE if (head.data == 0).mean() > _BARE else _ENOUGH
    if start is not None:
        best = _refine_starts(fine, finest, variants, [start])
        if best.likeness >= enough:
            return best
    best = _best_alignment(coarse, fine, finest, variants, _TURNS)
    if best.likeness < enough and far:
        best = max(best, _best_alignment(coarse, fine, finest, variants, _FAR_TURNS), key=lambda place: place.likeness)
    return best


def correlation_inside(head: Volume, template: Volume, affine: np.ndarray) -> float:
    """Correlation of the smoothed grey values deep in a brain with those of the template.

    The likeness of an alignment also includes the outline of the brain, which any image in the shape of a brain has.

    Parameters
    ----------
    head, template : Volume
        The two brains.
    affine : numpy.ndarray
        (4, 4), from points (m) of the template to points (m) of the head.

    Returns
    -------
    float
        -1 to 1.
    """
    deep = ndimage.distance_transform_edt(template.data > 0, sampling=template.spacing) > _DEPTH
    lattice = np.zeros(deep.shape, bool)
    lattice[::4, ::4, ::4] = True
    points = template.to_world(np.argwhere(deep & lattice))
    theirs, ours = (
        Volume(ndimage.gaussian_filter(each.data.astype(np.float32), _SMOOTH / each.spacing), each.affine)
        for each in (head, template)
    )
    return float(
        np.corrcoef(theirs.interpolate(points @ affine[:3, :3].T + affine[:3, 3]), ours.interpolate(points))[0, 1]
    )


def _best_alignment(
    coarse: Volume, fine: Volume, finest: Volume, variants: list[Volume], turns: Iterable[tuple[float, ...]]
) -> Alignment:
    """The best alignment found by the searches with each variant of the template."""
    turns, places = list(turns), []
    for variant in variants:
        pair = _Pair.of(coarse, variant, _COARSE)
        places.append(max((pair.refine(start) for start in _search_candidates(coarse, variant, turns)), key=pair.score))
    return _refine_starts(fine, finest, variants, places)


def _refine_starts(fine: Volume, finest: Volume, variants: list[Volume], starts: list[np.ndarray]) -> Alignment:
    """The best alignment after refinement of the starts, one per variant of the template or one for all."""
    at_4 = [_Pair.of(fine, variant, _COARSE) for variant in variants]
    if len(starts) < len(variants):
        starts = starts * len(variants)
    places = [pair.refine(start) for pair, start in zip(at_4, starts, strict=True)]
    best = max(places, key=lambda place: sum(pair.score(place) for pair in at_4))
    variant = variants[int(np.argmax([pair.correlation(best) for pair in at_4]))]
    best = _Pair.of(finest, variant, _FINE).refine(best, _SETTLED)
    return Alignment(best, max(pair.correlation(best) for pair in at_4))


def _search_candidates(head: Volume, variant: Volume, turns: list[tuple[float, ...]]) -> list[np.ndarray]:
    """Candidate affines (4, 4) of high correlation with a head on voxels of 8 mm, with a minimum distance from each other.

    Some of each size: a larger template covers more of the head, scalp included, which alone makes its products larger.
    """
    shape = [fft.next_fast_len(n + _PATCH, real=True) for n in head.data.shape]
    margin = _PATCH // 2
    spectrum = fft.rfftn(np.pad(head.data, margin), shape)
    inside = (~np.isnan(variant.data)).astype(np.float32)
    values = np.nan_to_num(variant.data)
    middle = variant.to_world(ndimage.center_of_mass(inside * (np.abs(values) > 0)))
    grid = (np.indices((_PATCH,) * 3).reshape(3, -1).T - margin) * head.spacing
    ends = np.array(list(product(*zip(*_ends(variant), strict=True))))
    found: dict[float, list[tuple[float, np.ndarray]]] = {size: [] for size in _SIZES}
    for angles, size in product(turns, _SIZES):
        turn = _rotation_matrix(angles)
        where = variant.to_voxels(grid @ turn / size + middle).T
        weight = ndimage.map_coordinates(inside, where, order=1) > 0.5
        patch = np.where(weight, ndimage.map_coordinates(values, where, order=1), 0)
        patch = np.where(weight, patch - patch[weight].mean(), 0).astype(np.float32)
        patch /= np.linalg.norm(patch)
        alike = fft.irfftn(spectrum * np.conj(fft.rfftn(patch.reshape((_PATCH,) * 3), shape)), shape)
        alike = alike[tuple(slice(n) for n in head.data.shape)]
        for _ in range(_STARTS):
            at = np.unravel_index(alike.argmax(), alike.shape)
            place = np.eye(4)
            place[:3, :3] = size * turn
            place[:3, 3] = head.to_world(np.array(at)) - size * turn @ middle
            found[size].append((alike[at], place))
            alike[tuple(slice(max(i - 2, 0), i + 3) for i in at)] = -np.inf
    kept: list[np.ndarray] = []
    for number, places in enumerate(found.values(), 1):
        for _, place in sorted(places, key=lambda each: -each[0]):
            here = ends @ place[:3, :3].T + place[:3, 3]
            if all(np.abs(here - (ends @ k[:3, :3].T + k[:3, 3])).max() > _APART for k in kept):
                kept.append(place)
            if len(kept) == number * _STARTS:
                break
    return kept


@dataclass(frozen=True, eq=False)
class _Pair:
    """A normalised head, its gradient (per m), and points (n, 3) in m of the template with their values minus the mean.

    `count` is the effective number of independent points.
    """

    head: Volume
    slope: list[np.ndarray]
    points: np.ndarray
    values: np.ndarray
    count: float

    @classmethod
    def of(cls, head: Volume, variant: Volume, step: float) -> _Pair:
        lattice = np.zeros(variant.data.shape, bool)
        lattice[tuple(slice(None, None, max(round(step / each), 1)) for each in variant.spacing)] = True
        where = np.argwhere(lattice & ~np.isnan(variant.data))
        values = variant.data[tuple(where.T)]
        count = len(where) * min(1.0, (step / _INDEPENDENT) ** 3)
        # Chain rule: gradient along the world axes.
        slope = np.tensordot(np.linalg.inv(head.affine[:3, :3]).T, np.array(np.gradient(head.data)), 1)
        return cls(head, list(slope), variant.to_world(where), values - values.mean(), count)

    def seen(self, affine: np.ndarray, picture: np.ndarray) -> np.ndarray:
        """Values (n,) of an image of the head at the points of the template; 0 outside."""
        to = np.linalg.inv(self.head.affine) @ affine
        return ndimage.map_coordinates(picture, to[:3, :3] @ self.points.T + to[:3, 3:], order=1)

    def correlation(self, affine: np.ndarray) -> float:
        """Correlation of the values, -1 to 1."""
        seen = self.seen(affine, self.head.data)
        seen = seen - seen.mean()
        both = float(np.sqrt((seen @ seen) * (self.values @ self.values)))
        return float(seen @ self.values) / both if both > 0 else -1.0

    def score(self, affine: np.ndarray) -> float:
        """Log-likelihood of the head's values plus log-prior of the stretches, up to a constant."""
        if np.linalg.det(affine[:3, :3]) < 0.1:
            return -np.inf
        alike = self.correlation(affine)
        unusual = float(((_deviation(affine) / _SPREADS) ** 2).sum())
        # Residuals of a linear fit with correlation c have the variance 1 - c²; negative correlations are penalised.
        return self.count * (-0.5 * np.log1p(-(min(max(alike, 0.0), 0.999) ** 2)) + min(alike, 0.0)) - 0.5 * unusual

    def refine(self, affine: np.ndarray, enough: float = _NEAR) -> np.ndarray:
        """The affine after damped Gauss-Newton steps, none of which lowers the score."""
        best, damping = self.score(affine), 1e-3
        for _ in range(_ROUNDS):
            step = self._system(affine)
            while damping < 1e3:
                trial = step(damping) @ affine
                score = self.score(trial)
                if score > best:
                    break
                damping *= 8
            else:
                break
            gain, best, affine, damping = score - best, score, trial, damping / 4
            if gain < enough:
                break
        return affine

    def _system(self, affine: np.ndarray) -> Callable[[float], np.ndarray]:
        """The Gauss-Newton step as a function of the damping: (4, 4), to be applied after the affine."""
        at = self.points @ affine[:3, :3].T + affine[:3, 3]
        middle = at.mean(axis=0)
        seen = self.seen(affine, self.head.data)
        arms = [*((at - middle) / _ARM).T, np.ones(len(at))]
        moves = np.array([s * arm for s in (self.seen(affine, part) for part in self.slope) for arm in arms])
        gain = float(seen @ self.values / max(((seen - seen.mean()) ** 2).sum(), 1e-30))
        rows = np.concatenate([gain * moves, seen[None], np.ones((1, len(at)))])
        wanted = self.values - gain * seen
        weight = self.count / max(((wanted - wanted.mean()) ** 2).sum(), 1e-30)
        normal, right = weight * rows @ rows.T, weight * rows @ wanted
        prior = np.concatenate([_STRAINS / _ARM, np.zeros((6, 2))], axis=1) / _SPREADS[:, None]
        normal += prior.T @ prior
        right -= prior.T @ (_deviation(affine) / _SPREADS)

        def step(damping: float) -> np.ndarray:
            scale = np.diag(normal).copy()
            scale[-2:] = 0
            move = np.linalg.lstsq(normal + damping * np.diag(scale), right, rcond=1e-12)[0][:-2].reshape(3, 4)
            turn = np.eye(4)
            turn[:3, :3] += move[:, :3] / _ARM
            turn[:3, 3] = move[:, 3] - (turn[:3, :3] - np.eye(3)) @ middle
            return turn

        return step


def _deviation(affine: np.ndarray) -> np.ndarray:
    """Logarithmic strain of an affine, (6,): the mean minus that of adults, and five deviatoric components."""
    values, vectors = np.linalg.eigh(affine[:3, :3] @ affine[:3, :3].T)
    strain = (vectors * np.log(np.maximum(values, 1e-12)) / 2) @ vectors.T
    found = _STRAINS @ np.pad(strain, ((0, 0), (0, 1))).ravel()
    found[0] -= _SIZE
    return np.asarray(found)


def _strains() -> np.ndarray:
    """The mean strain and five deviatoric ones, as rows over the 12 entries of a (3, 4) matrix."""
    rows = np.zeros((6, 3, 4))
    rows[0, range(3), range(3)] = 1 / 3
    rows[1, 0, 0], rows[1, 1, 1] = 0.5**0.5, -(0.5**0.5)
    rows[2, range(3), range(3)] = np.array([1, 1, -2]) / 6**0.5
    for row, (i, j) in enumerate(((0, 1), (0, 2), (1, 2)), 3):
        rows[row, i, j] = rows[row, j, i] = 0.5**0.5
    return rows.reshape(6, 12)


_STRAINS = _strains()


def _template_variants(template: Volume) -> list[Volume]:
    """The bare template and the template with a scalp, normalised as heads are, on voxels of 4 mm; NaN where unknown."""
    mask = downsample(Volume((template.data != 0).astype(np.float32), template.affine), _FINE)
    thin = downsample(template, _FINE)
    width = int(np.ceil((_SCALP[1] + _LOCAL) / _FINE))
    affine = thin.affine.copy()
    affine[:3, 3] -= affine[:3, :3] @ np.full(3, width)
    brain = np.pad(mask.data > 0.5, width)
    bare = np.where(brain, np.pad(thin.data, width), 0).astype(np.float32)
    away = ndimage.distance_transform_edt(~brain, sampling=thin.spacing)
    above = Volume(bare, affine).to_world(np.argwhere(np.ones_like(brain)))[:, 2].reshape(brain.shape) > _FOREHEAD
    clothed = bare.copy()
    clothed[above & (away > _SCALP[0]) & (away <= _SCALP[1])] = 0.8 * np.quantile(bare[brain], _BRIGHT)
    variants = []
    for picture, known in ((bare, away <= _FLUID), (clothed, (away <= _FLUID) | (above & (away <= _SCALP[1])))):
        normal = _standardised(Volume(picture, affine))
        variants.append(Volume(np.where(known, normal.data, np.nan), affine))
    return variants


def _ends(variant: Volume) -> tuple[np.ndarray, np.ndarray]:
    """Corners (3,), (3,) in m of the bounding box of the known part of the template."""
    known = variant.to_world(np.argwhere(~np.isnan(variant.data)))
    return known.min(axis=0), known.max(axis=0)


def downsample(volume: Volume, step: float) -> Volume:
    """Downsample a volume by averaging blocks of voxels.

    Parameters
    ----------
    volume : Volume
        The volume.
    step : float
        Edge (m) of a block, rounded to whole voxels.

    Returns
    -------
    Volume
        float32.
    """
    every = np.maximum(np.rint(step / volume.spacing).astype(int), 1)
    data = np.pad(volume.data, [(0, -size % n) for size, n in zip(volume.data.shape, every, strict=True)], mode="edge")
    blocks = np.column_stack([np.array(data.shape) // every, every]).ravel()
    affine = volume.affine @ np.diag([*every, 1.0])
    affine[:3, 3] += volume.affine[:3, :3] @ ((every - 1) / 2)
    return Volume(data.reshape(blocks).mean(axis=(1, 3, 5), dtype=np.float32), affine)


def normalise_locally(head: Volume) -> Volume:
    """Normalise a head by its local mean and standard deviation over some 20 mm, after clipping the grey values of fat."""
    data = head.data - np.quantile(head.data, 0.02)
    bright = data[data > 0.1 * np.quantile(data, 0.98)]
    top = np.quantile(bright, _BRIGHT) if bright.size else 1.0
    return _standardised(Volume(data.clip(0, top).astype(np.float32), head.affine))


def _standardised(picture: Volume) -> Volume:
    width = _LOCAL / picture.spacing
    mean = ndimage.gaussian_filter(picture.data, width)
    spread = np.sqrt(np.maximum(ndimage.gaussian_filter(picture.data**2, width) - mean**2, 0))
    return Volume((picture.data - mean) / (spread + _FLOOR * np.quantile(mean, 0.9) + 1e-12), picture.affine)


def _check_bright(head: Volume) -> None:
    """Refuse images that are nearly only background."""
    thin = downsample(head, _FINE / 2)
    bright = largest_component(ndimage.binary_opening(thin.data > otsu_threshold(thin.data)))
    litres = bright.sum() * thin.voxel_volume * 1e3
    if litres < _LEAST:
        raise InputError(
            "image",
            f"an image whose largest bright part has {litres:.2f} litres",
            f"at least {_LEAST:g}, after removal of a noisy background (as of MP2RAGE)",
        )


def otsu_threshold(data: np.ndarray) -> float:
    """Otsu's threshold between dark and bright grey values (Otsu 1979, doi:10.1109/TSMC.1979.4310076)."""
    low, high = np.quantile(data, [0.001, 0.995])
    counts, edges = np.histogram(data.clip(low, high), 256)
    centres = (edges[1:] + edges[:-1]) / 2
    below, sums = np.cumsum(counts), np.cumsum(counts * centres)
    above = below[-1] - below
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = below * above * (sums / below - (sums[-1] - sums) / above) ** 2
    return float(edges[1 + int(np.nanargmax(apart[:-1]))])


def largest_component(mask: np.ndarray) -> np.ndarray:
    """Largest connected component of a mask, by faces."""
    pieces, count = ndimage.label(mask)
    return pieces == np.bincount(pieces.ravel())[1:].argmax() + 1 if count else mask


def _rotation_matrix(angles: tuple[float, ...]) -> np.ndarray:
    """Rotation matrix from angles (degrees) about the axes right, front and up, in this order."""
    turn = np.eye(3)
    for axis, angle in enumerate(np.radians(angles)):
        c, s = np.cos(angle), np.sin(angle)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        one = np.eye(3)
        one[i, i], one[j, j], one[i, j], one[j, i] = c, c, -s, s
        turn = one @ turn
    return turn
