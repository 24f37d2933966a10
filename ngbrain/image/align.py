"""Where the template brain lies in a head: the affine map that makes the two pictures most alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image.volume import Volume

_SHELL = 6e-3  # m around the template's brain that are compared too: dark there, as fluid and bone are
_STEPS = (8e-3, 4e-3)  # m between the points compared, coarse to fine
_TURNS = np.radians((-30.0, 0.0, 30.0))  # about each axis, where the search starts
_SIZES = (0.9, 1.0, 1.12)
_SHIFTS = (-20e-3, 0.0, 20e-3)  # m, forward and up
_BEST, _APART = 6, 20e-3  # starts that are followed, and how far (m) their middles or corners are apart
_TOP = 15e-3  # m from the top of the head to the top of the brain
_SEEN = 80e-3  # m below the top, where a head is as wide and long as its brain case
_ROUNDS = 40
_BLUR = 0.4  # of a step: standard deviation of the Gaussian
_ARM = 0.07  # m, in which turns and stretches are counted, so that they are as large as shifts
_DEEP = 4e-3  # m
_LEAST = 0.5  # litres


@dataclass(frozen=True, eq=False)
class Alignment:
    """The template in a head.

    affine    (4, 4), takes points of the template (m) to points of the head (m)
    likeness  correlation of the grey values of the two, -1 to 1, more than 4 mm inside the brain: there it speaks for
              anatomy, while any bright lump in the dark is like a brain on the whole
    """

    affine: np.ndarray
    likeness: float


def align(head: Volume, template: Volume) -> Alignment:
    """Find `template`, a brain on an exact background of 0, in `head`, with a skull or without.

    The correlation coefficient of grey values over the brain and 6 mm around it is made as large as an affine map can,
    from the best of many turned, shifted and scaled places: by steps of Gauss-Newton on ∫(t - c·h(Ax + b) - d)² dx,
    damped (Levenberg) so that none lessens it, first with one scale for all directions. Where the head has no values
    it counts as dark.

    Raises:
        InputError: there is next to nothing but background in `head`.

    >>> at = 4e-3 * (np.indices((45, 55, 45)).reshape(3, -1).T - [22, 27, 22])
    >>> egg = lambda points: np.clip(8 * (1 - np.linalg.norm(points / [0.06, 0.08, 0.05], axis=1)), 0, 1)
    >>> affine = np.diag([4e-3, 4e-3, 4e-3, 1])
    >>> one, other = (Volume(egg(at - shift).reshape(45, 55, 45), affine) for shift in (0, [0.008, -0.01, 0.004]))
    >>> align(other, one).affine[:3, 3].round(3)
    array([ 0.008, -0.01 , 0.004])
    """
    bright = largest(ndimage.binary_opening(head.data > otsu(head.data), iterations=2))
    litres = bright.sum() * head.voxel_volume * 1e3
    if litres < _LEAST:
        raise InputError(
            "image",
            f"a picture whose largest bright part has {litres:.2f} litres",
            f"at least {_LEAST:g}, after a background of noise (as MP2RAGE has) was taken out",
        )
    top = np.quantile(head.data[bright], 0.98)  # fat: as bright as it likes, it says nothing
    clipped = Volume(np.clip(head.data, head.data.min(), top).astype(np.float32), head.affine)
    coarse, *finer = (_Pair.of(clipped, template, step) for step in _STEPS)
    places = [coarse.climbed(start, similar=True) for start in _starts(coarse, _outline(bright, head))]
    places = [coarse.climbed(place, similar=False) for _, place in sorted(places, key=lambda place: -place[0])[:2]]
    _, affine = max(places, key=lambda place: place[0])
    for pair in finer:
        _, affine = pair.climbed(affine, similar=False)
    return Alignment(affine, pair.likeness(affine))


@dataclass(frozen=True, eq=False)
class _Pair:
    """A head, smoothed, and its gradient (per m); points of the template (n, 3) in m, its grey values there less their
    mean, and whether the points are deep in it."""

    head: np.ndarray
    slope: list[np.ndarray]
    to_voxels: np.ndarray
    dark: float
    points: np.ndarray
    values: np.ndarray
    deep: np.ndarray

    @classmethod
    def of(cls, head: Volume, template: Volume, step: float) -> _Pair:
        """At points `step` (m) apart."""
        smooth, to_head = _thinned(head.data, head, step)
        slope = np.gradient(smooth, *np.linalg.norm(to_head[:3, :3], axis=0))
        reach = int(np.ceil(2 * _SHELL / step)) + 1
        thin, to_template = _thinned(template.data, template, step)
        brain, _ = _thinned((template.data != 0).astype(np.float32), template, step)
        brain, thin = np.pad(brain, reach) > 0.5, np.pad(thin, reach)
        spacing = np.linalg.norm(to_template[:3, :3], axis=0)
        lattice = np.zeros_like(brain)
        lattice[::2, ::2, ::2] = True
        near = ndimage.distance_transform_edt(~brain, sampling=spacing) <= _SHELL
        where = np.argwhere(near & lattice)
        points = (where - reach) @ to_template[:3, :3].T + to_template[:3, 3]
        values = thin[tuple(where.T)]
        deep = ndimage.distance_transform_edt(brain, sampling=spacing)[tuple(where.T)] > _DEEP
        return cls(smooth, slope, np.linalg.inv(to_head), float(smooth.min()), points, values - values.mean(), deep)

    def seen(self, affine: np.ndarray, picture: np.ndarray, outside: float) -> np.ndarray:
        """Values (n,) of a picture of the head at the points of the template."""
        to = self.to_voxels @ affine
        where = to[:3, :3] @ self.points.T + to[:3, 3:]
        return ndimage.map_coordinates(picture, where, order=1, mode="constant", cval=outside)

    def correlation(self, affine: np.ndarray) -> float:
        """Of the grey values."""
        return _correlation(self.seen(affine, self.head, self.dark), self.values)

    def likeness(self, affine: np.ndarray) -> float:
        """Correlation of the grey values deep in the brain."""
        return _correlation(self.seen(affine, self.head, self.dark)[self.deep], self.values[self.deep])

    def climbed(self, affine: np.ndarray, similar: bool) -> tuple[float, np.ndarray]:
        """The correlation and the place that steps from a place lead to; `similar`: turns, shifts and one scale only."""
        best, damping = self.correlation(affine), 1e-3
        for _ in range(_ROUNDS):
            step = self._system(affine, similar)
            while damping < 1e3:
                trial = step(damping) @ affine
                alike = self.correlation(trial)
                if alike > best:
                    break
                damping *= 8
            else:
                break
            gain, best, affine, damping = alike - best, alike, trial, damping / 4
            if gain < 1e-5:
                break
        return best, affine

    def _system(self, affine: np.ndarray, similar: bool) -> Callable[[float], np.ndarray]:
        """The step of Gauss-Newton as a function of the damping, (4, 4), to be applied after the affine map."""
        at = self.points @ affine[:3, :3].T + affine[:3, 3]
        middle = at.mean(axis=0)
        seen = self.seen(affine, self.head, self.dark)
        slope = [self.seen(affine, part, 0.0) for part in self.slope]
        arms = [*((at - middle) / _ARM).T, np.ones(len(at))]
        moves = np.array([s * arm for s in slope for arm in arms])  # (12, n)
        basis = _SIMILAR if similar else np.eye(12)
        rows = np.concatenate([basis @ moves, seen[None], np.ones((1, len(at)))])
        gain = float(seen @ self.values / max(((seen - seen.mean()) ** 2).sum(), 1e-30))
        rows[:-2] *= gain
        normal = rows @ rows.T
        right = rows @ (self.values - gain * seen)

        def step(damping: float) -> np.ndarray:
            scale = np.diag(normal).copy()
            scale[-2:] = 0
            solved = np.linalg.lstsq(normal + damping * np.diag(scale), right, rcond=1e-12)[0]
            move = (basis.T @ solved[:-2]).reshape(3, 4)
            turn = np.eye(4)
            turn[:3, :3] += move[:, :3] / _ARM
            turn[:3, 3] = move[:, 3] - (turn[:3, :3] - np.eye(3)) @ middle
            return turn

        return step


def _thinned(data: np.ndarray, volume: Volume, step: float) -> tuple[np.ndarray, np.ndarray]:
    """A picture on the grid of a volume, smoothed, on voxels of about half a step, and their affine."""
    stride = np.maximum(np.rint(step / 2 / volume.spacing).astype(int), 1)
    smooth = ndimage.gaussian_filter(data, _BLUR * step / volume.spacing, truncate=3)
    return smooth[tuple(slice(None, None, each) for each in stride)], volume.affine @ np.diag([*stride, 1.0])


def _correlation(one: np.ndarray, other: np.ndarray) -> float:
    one, other = one - one.mean(), other - other.mean()
    both = float(np.sqrt((one @ one) * (other @ other)))
    return float(one @ other) / both if both > 0 else -1.0


def _similar() -> np.ndarray:
    """Three turns, a scale and three shifts as rows over the 12 entries of a (3, 4) matrix."""
    rows = np.zeros((7, 3, 4))
    for row, (i, j) in enumerate(((2, 1), (0, 2), (1, 0))):
        rows[row, i, j], rows[row, j, i] = 1, -1
    rows[3, range(3), range(3)] = 1
    rows[range(4, 7), range(3), 3] = 1
    return rows.reshape(7, 12)


_SIMILAR = _similar()


def otsu(data: np.ndarray) -> float:
    """The threshold between dark and bright that parts the grey values best (Otsu 1979, doi:10.1109/TSMC.1979.4310076)."""
    low, high = np.quantile(data, [0.001, 0.995])
    counts, edges = np.histogram(data.clip(low, high), 256)
    centres = (edges[1:] + edges[:-1]) / 2
    below, sums = np.cumsum(counts), np.cumsum(counts * centres)
    above = below[-1] - below
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = below * above * (sums / below - (sums[-1] - sums) / above) ** 2
    return float(edges[1 + int(np.nanargmax(apart[:-1]))])


def foreground(head: Volume) -> np.ndarray:
    """The largest piece that is not dark, its holes filled: a mask (nx, ny, nz) of the head, however uneven its coil.

    >>> ball = np.linalg.norm(np.indices((30, 30, 30)) - 14.5, axis=0)
    >>> found = foreground(Volume(np.select([ball < 5, ball < 12], [0.0, 1.0]), np.eye(4)))
    >>> f"{found[ball < 11].mean():.0%} of it, {found[ball > 12].mean():.0%} of the rest"
    '100% of it, 0% of the rest'
    """
    bright = ndimage.binary_opening(head.data > otsu(head.data) / 2, iterations=2)
    return np.asarray(ndimage.binary_fill_holes(largest(bright)))


def largest(mask: np.ndarray) -> np.ndarray:
    """Its largest piece; pieces hang together by faces."""
    pieces, count = ndimage.label(mask)
    return pieces == np.bincount(pieces.ravel())[1:].argmax() + 1 if count else mask


def _outline(bright: np.ndarray, head: Volume) -> np.ndarray:
    """Points (n, 3) in m of the bright part of a head, 8 mm apart."""
    every = np.maximum(np.rint(8e-3 / head.spacing).astype(int), 1)
    lattice = np.zeros_like(bright)
    lattice[tuple(slice(None, None, e) for e in every)] = True
    return head.to_world(np.argwhere(bright & lattice))


def _starts(pair: _Pair, outline: np.ndarray) -> list[np.ndarray]:
    """Places (4, 4) of the template at which the correlation is high, no two of them near each other.

    For each turn of the head its top is found, and the middle of what lies less than 80 mm below.
    """
    brain = pair.points[pair.values > pair.values.min() + 0.2 * np.ptp(pair.values)]
    low, high = brain.min(axis=0), brain.max(axis=0)
    found = []
    for angles in product(_TURNS, repeat=3):
        turn = _turned(angles)
        flat = outline @ turn  # the head as it would lie untilted
        crown = np.quantile(flat[:, 2], 0.999)
        case = flat[flat[:, 2] > crown - _SEEN]
        middle = (case.min(axis=0) + case.max(axis=0)) / 2
        for size, forward, up in product(_SIZES, _SHIFTS, _SHIFTS):
            to = np.array([middle[0], middle[1] + forward, crown - _TOP + up])
            start = np.eye(4)
            start[:3, :3] = size * turn
            start[:3, 3] = turn @ (to - size * np.array([*(low + high)[:2] / 2, high[2]]))
            found.append((pair.correlation(start), start))
    found.sort(key=lambda place: -place[0])
    corners = np.array(list(product(*zip(low, high, strict=True))))
    kept: list[np.ndarray] = []
    for _, start in found:
        here = corners @ start[:3, :3].T + start[:3, 3]
        if all(np.abs(here - (corners @ k[:3, :3].T + k[:3, 3])).max() > _APART for k in kept):
            kept.append(start)
        if len(kept) == _BEST:
            break
    return kept


def _turned(angles: tuple[float, ...]) -> np.ndarray:
    """Turns about the axes right, front and up, in this order."""
    turn = np.eye(3)
    for axis, angle in enumerate(angles):
        c, s = np.cos(angle), np.sin(angle)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        one = np.eye(3)
        one[i, i], one[j, j], one[i, j], one[j, i] = c, c, -s, s
        turn = one @ turn
    return turn
