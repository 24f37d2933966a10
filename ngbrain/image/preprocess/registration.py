"""Affine registration of the template brain to a head, without a starting guess."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import fft, ndimage

from ngbrain.errors import InputError
from ngbrain.image.read.volume import Volume

ALIKE = 0.4
"""Least likeness of two brains. Measured: T1s of heads 0.49 and more, stripped ones 0.7 and more, T2s 0.35 to 0.5."""
INSIDE = 0.2
"""Least correlation of two brains inside. Measured: T1s 0.34 and more, noise in the shape of a brain 0.07."""

_COARSE, _FINE, _FINEST = 8e-3, 4e-3, 2e-3  # m, voxels of the search, of the fit and of its end
_LOCAL = 20e-3  # m, standard deviation of the Gaussian over which grey values are normalised
_FLOOR = 0.05  # of a bright voxel: smaller local spreads are background noise, which is not to be amplified
_BRIGHT = 0.95  # quantile of the grey values of a head above which they are clipped: fat carries no information
_FLUID = 8e-3  # m around the brain that are dark: fluid and bone
_SCALP = (9e-3, 17e-3)  # m from the brain in which a scalp is bright
_FOREHEAD = -5e-3  # m, height in the template above which a scalp is drawn: faces and necks differ too much
_SIZES = (0.82, 0.90, 0.98, 1.07)
_STARTS, _APART = 3, 25e-3  # starts kept of each search at each size, and the least distance (m) between their corners
_PATCH = 44  # voxels, edge of the cube that holds the template at any turn and size
_ROUNDS = 30
_NEAR, _SETTLED = 0.05, 1e-4  # gain in log-likelihood below which steps end, and at the end
_ARM = 0.07  # m: a turn by 1 moves the brain's surface about as much as a shift by this
# Adult brains against MNI152, which is larger than most: logarithm of the mean stretch, and of its differences by axis.
_SIZE, _SIZE_SPREAD, _SHAPE_SPREAD = -0.06, 0.08, 0.035
_SPREADS = np.array([_SIZE_SPREAD] + 5 * [_SHAPE_SPREAD])
_INDEPENDENT = 12e-3  # m between points whose errors are independent
_ENOUGH, _ENOUGH_BARE = (
    0.45,
    0.65,
)  # likeness below which heads turned further are tried as well, of stripped heads the latter
_BARE = 0.3  # part of a picture that is exactly 0 around a stripped head
_LEAST = 0.5  # litres
_DEPTH, _SMOOTH = 8e-3, 3e-3  # m, for `correlation_inside`
# Degrees about the axes right, front and up.
_TURNS = [(nod, 0, 0) for nod in (-40, -20, 0, 20, 40)]
_TURNS += [(nod, side, 0) for nod in (-25, 0, 25) for side in (-20, 20)]
_TURNS += [(nod, 0, side) for nod in (-25, 0, 25) for side in (-20, 20)]
_FAR_TURNS = list(product((-60, -30, 0, 30, 60), (-50, -25, 0, 25, 50), (-50, -25, 0, 25, 50)))


@dataclass(frozen=True, eq=False)
class Alignment:
    """The template in a head.

    affine    (4, 4), takes points of the template (m) to points of the head (m)
    likeness  correlation of the locally normalised grey values of the two over the brain and what is around it, -1 to 1
    """

    affine: np.ndarray
    likeness: float


def align(head: Volume, template: Volume, start: np.ndarray | None = None, far: bool = True) -> Alignment:
    """Find `template`, a brain on an exact background of 0, in `head`, with a skull or without.

    start   (4, 4), where it was found before in a picture of the same head: improved, and searched for only if it does not fit
    far     whether it is looked for at more turns where none of the nearer ones fits

    Grey values are normalised by mean and spread over some 20 mm, which takes out coil fields and makes scanners alike. All
    shifts of the template are tried by Fourier transforms, at 17 turns (125 more where none fits) and four sizes, on
    voxels of 8 mm, once with the bare template and once with a scalp drawn around it. The best places are improved by
    Gauss-Newton steps (Levenberg's damping) on the log-likelihood of the grey values plus that of the stretches among
    adults, and the place that explains both pictures best is returned.

    Raises:
        InputError: less than half a litre of `head` is bright.

    >>> from ngbrain.image.read.volume import mni152
    >>> template = mni152().volume
    >>> np.abs(align(template, template).affine[:3, 3]).max() < 1e-3
    np.True_
    """
    _check_bright(head)
    fine = downsample(head, _FINE)
    coarse = normalise_locally(downsample(fine, _COARSE))
    fine = normalise_locally(fine)
    finest = normalise_locally(downsample(head, _FINEST))
    looks = _dressed(template)
    enough = _ENOUGH_BARE if (head.data == 0).mean() > _BARE else _ENOUGH
    if start is not None:
        best = _settled(fine, finest, looks, [start])
        if best.likeness >= enough:
            return best
    best = _best(coarse, fine, finest, looks, _TURNS)
    if best.likeness < enough and far:
        best = max(best, _best(coarse, fine, finest, looks, _FAR_TURNS), key=lambda place: place.likeness)
    return best


def correlation_inside(head: Volume, template: Volume, affine: np.ndarray) -> float:
    """Correlation (-1 to 1) of smoothed grey values deep in a brain with those of the template there.

    The likeness of an alignment counts edges of the brain too, which any picture in the shape of a brain has.
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


def _best(
    coarse: Volume, fine: Volume, finest: Volume, looks: list[Volume], turns: Iterable[tuple[float, ...]]
) -> Alignment:
    """The best place that the searches with each look of the template lead to."""
    turns, places = list(turns), []
    for look in looks:
        pair = _Pair.of(coarse, look, _COARSE)
        places.append(max((pair.climbed(start) for start in _found(coarse, look, turns)), key=pair.score))
    return _settled(fine, finest, looks, places)


def _settled(fine: Volume, finest: Volume, looks: list[Volume], starts: list[np.ndarray]) -> Alignment:
    """The best place that starts, one for each look of the template or one for all, lead to."""
    at_4 = [_Pair.of(fine, look, _COARSE) for look in looks]
    if len(starts) < len(looks):
        starts = starts * len(looks)
    places = [pair.climbed(start) for pair, start in zip(at_4, starts, strict=True)]
    best = max(places, key=lambda place: sum(pair.score(place) for pair in at_4))
    look = looks[int(np.argmax([pair.correlation(best) for pair in at_4]))]
    best = _Pair.of(finest, look, _FINE).climbed(best, _SETTLED)
    return Alignment(best, max(pair.correlation(best) for pair in at_4))


def _found(head: Volume, look: Volume, turns: list[tuple[float, ...]]) -> list[np.ndarray]:
    """Places (4, 4) of high correlation with a head on voxels of 8 mm, no two near each other.

    Some of each size: a larger template covers more of the head, scalp too, and its products are larger for that alone.
    """
    shape = [fft.next_fast_len(n + _PATCH, real=True) for n in head.data.shape]
    margin = _PATCH // 2
    spectrum = fft.rfftn(np.pad(head.data, margin), shape)
    inside = (~np.isnan(look.data)).astype(np.float32)
    values = np.nan_to_num(look.data)
    middle = look.to_world(ndimage.center_of_mass(inside * (np.abs(values) > 0)))
    grid = (np.indices((_PATCH,) * 3).reshape(3, -1).T - margin) * head.spacing
    ends = np.array(list(product(*zip(*_ends(look), strict=True))))
    found: dict[float, list[tuple[float, np.ndarray]]] = {size: [] for size in _SIZES}
    for angles, size in product(turns, _SIZES):
        turn = _turned(angles)
        where = look.to_voxels(grid @ turn / size + middle).T
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
    """A normalised head, its gradient (per m), and points (n, 3) in m of the template with their values less the mean.

    count   number of the points that speak independently of each other
    """

    head: Volume
    slope: list[np.ndarray]
    points: np.ndarray
    values: np.ndarray
    count: float

    @classmethod
    def of(cls, head: Volume, look: Volume, step: float) -> _Pair:
        lattice = np.zeros(look.data.shape, bool)
        lattice[tuple(slice(None, None, max(round(step / each), 1)) for each in look.spacing)] = True
        where = np.argwhere(lattice & ~np.isnan(look.data))
        values = look.data[tuple(where.T)]
        count = len(where) * min(1.0, (step / _INDEPENDENT) ** 3)
        # By the chain rule along the axes of the world, whichever way those of the voxels run.
        slope = np.tensordot(np.linalg.inv(head.affine[:3, :3]).T, np.array(np.gradient(head.data)), 1)
        return cls(head, list(slope), look.to_world(where), values - values.mean(), count)

    def seen(self, affine: np.ndarray, picture: np.ndarray) -> np.ndarray:
        """Values (n,) of a picture of the head at the points of the template; 0 outside."""
        to = np.linalg.inv(self.head.affine) @ affine
        return ndimage.map_coordinates(picture, to[:3, :3] @ self.points.T + to[:3, 3:], order=1)

    def correlation(self, affine: np.ndarray) -> float:
        """Of the values, -1 to 1."""
        seen = self.seen(affine, self.head.data)
        seen = seen - seen.mean()
        both = float(np.sqrt((seen @ seen) * (self.values @ self.values)))
        return float(seen @ self.values) / both if both > 0 else -1.0

    def score(self, affine: np.ndarray) -> float:
        """Logarithm of the likelihood of the head's values and of the stretches, up to a constant."""
        if np.linalg.det(affine[:3, :3]) < 0.1:
            return -np.inf
        alike = self.correlation(affine)
        unusual = float(((_deviation(affine) / _SPREADS) ** 2).sum())
        # Of a linear fit with correlation c, residuals have a variance of 1 - c²; below 0 any slope will do.
        return self.count * (-0.5 * np.log1p(-(min(max(alike, 0.0), 0.999) ** 2)) + min(alike, 0.0)) - 0.5 * unusual

    def climbed(self, affine: np.ndarray, enough: float = _NEAR) -> np.ndarray:
        """The place that damped Gauss-Newton steps lead to, none of which lowers the score."""
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
        """The step of Gauss-Newton as a function of the damping, (4, 4), to be applied after the affine map."""
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
    """Logarithmic strain of a map, (6,): the mean less that of adults, and five that change the shape."""
    values, vectors = np.linalg.eigh(affine[:3, :3] @ affine[:3, :3].T)
    strain = (vectors * np.log(np.maximum(values, 1e-12)) / 2) @ vectors.T
    found = _STRAINS @ np.pad(strain, ((0, 0), (0, 1))).ravel()
    found[0] -= _SIZE
    return np.asarray(found)


def _strains() -> np.ndarray:
    """The mean strain and five deviatoric ones as rows over the 12 entries of a (3, 4) matrix."""
    rows = np.zeros((6, 3, 4))
    rows[0, range(3), range(3)] = 1 / 3
    rows[1, 0, 0], rows[1, 1, 1] = 0.5**0.5, -(0.5**0.5)
    rows[2, range(3), range(3)] = np.array([1, 1, -2]) / 6**0.5
    for row, (i, j) in enumerate(((0, 1), (0, 2), (1, 2)), 3):
        rows[row, i, j] = rows[row, j, i] = 0.5**0.5
    return rows.reshape(6, 12)


_STRAINS = _strains()


def _dressed(template: Volume) -> list[Volume]:
    """The template bare and with a scalp, normalised as heads are, on voxels of 4 mm; NaN where nothing is known."""
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
    looks = []
    for picture, known in ((bare, away <= _FLUID), (clothed, (away <= _FLUID) | (above & (away <= _SCALP[1])))):
        normal = _standardised(Volume(picture, affine))
        looks.append(Volume(np.where(known, normal.data, np.nan), affine))
    return looks


def _ends(look: Volume) -> tuple[np.ndarray, np.ndarray]:
    """Corners (3,), (3,) in m of the box around what is known of the template."""
    known = look.to_world(np.argwhere(~np.isnan(look.data)))
    return known.min(axis=0), known.max(axis=0)


def downsample(volume: Volume, step: float) -> Volume:
    """Means over blocks of voxels of about `step` (m) along each edge."""
    every = np.maximum(np.rint(step / volume.spacing).astype(int), 1)
    data = np.pad(volume.data, [(0, -size % n) for size, n in zip(volume.data.shape, every, strict=True)], mode="edge")
    blocks = np.column_stack([np.array(data.shape) // every, every]).ravel()
    affine = volume.affine @ np.diag([*every, 1.0])
    affine[:3, 3] += volume.affine[:3, :3] @ ((every - 1) / 2)
    return Volume(data.reshape(blocks).mean(axis=(1, 3, 5), dtype=np.float32), affine)


def normalise_locally(head: Volume) -> Volume:
    """Grey values of a head less their mean over some 20 mm, divided by their spread there; fat is clipped before."""
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
    """Refuse what is next to nothing but background."""
    thin = downsample(head, _FINE / 2)
    bright = largest_component(ndimage.binary_opening(thin.data > otsu_threshold(thin.data)))
    litres = bright.sum() * thin.voxel_volume * 1e3
    if litres < _LEAST:
        raise InputError(
            "image",
            f"a picture whose largest bright part has {litres:.2f} litres",
            f"at least {_LEAST:g}, after a background of noise (as MP2RAGE has) was taken out",
        )


def otsu_threshold(data: np.ndarray) -> float:
    """The threshold between dark and bright that parts the grey values best (Otsu 1979, doi:10.1109/TSMC.1979.4310076)."""
    low, high = np.quantile(data, [0.001, 0.995])
    counts, edges = np.histogram(data.clip(low, high), 256)
    centres = (edges[1:] + edges[:-1]) / 2
    below, sums = np.cumsum(counts), np.cumsum(counts * centres)
    above = below[-1] - below
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = below * above * (sums / below - (sums[-1] - sums) / above) ** 2
    return float(edges[1 + int(np.nanargmax(apart[:-1]))])


def largest_component(mask: np.ndarray) -> np.ndarray:
    """Its largest piece; pieces hang together by faces."""
    pieces, count = ndimage.label(mask)
    return pieces == np.bincount(pieces.ravel())[1:].argmax() + 1 if count else mask


def _turned(angles: tuple[float, ...]) -> np.ndarray:
    """Turns by degrees about the axes right, front and up, in this order."""
    turn = np.eye(3)
    for axis, angle in enumerate(np.radians(angles)):
        c, s = np.cos(angle), np.sin(angle)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        one = np.eye(3)
        one[i, i], one[j, j], one[i, j], one[j, i] = c, c, -s, s
        turn = one @ turn
    return turn
