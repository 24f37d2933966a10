"""A patient's stiffness relative to a norm, at any points of the body, with its standard deviation.

The logarithm of the relative stiffness is interpolated from a map, and its error is a Gaussian field of few numbers:

    ln r(x) = ln |G*|(x + shift) - ln |G*|_norm(tissue, frequency) + σ Σ_k w_k(x) z_k ,     Σ w_k² = 1

with w_k Gaussian functions about the `places`, which all plans share. Without a map |G*| is the norm, and σ the spread from person
to person. A lesion that waves do not resolve takes the value of the tissue around it times a ratio of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import KDTree
from scipy.special import ndtri

from ngbrain.errors import InputError, file_context
from ngbrain.image.read.property_maps import COVERED, fill_missing, measured_mask, read_map
from ngbrain.image.read.volume import Volume
from ngbrain.look import BriefText
from ngbrain.surgery.twin.case import Lesion, StiffnessData
from ngbrain.surgery.twin.norms import NormalTissue

Array = np.ndarray
PLACES = 60
"""Largest number of places, the numbers of a coarse field."""
RATIO = (0.2, 5.0)
"""Range of the median ratio to the norm; beyond it the unit or the body is another one."""
RIM = 4e-3
"""Width (m) over which a lesion's edge is smoothed, and of the layer around it whose stiffness it would have."""
LEAST_DEVIATION = 0.01
"""Smallest standard deviation of a logarithm: none is known better than to a percent."""


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredMap(BriefText):
    """A map of the magnitude of the shear modulus with its error.

    Parameters
    ----------
    modulus : Volume
        |G*| (Pa), NaN where nothing was measured.
    deviation : Volume
        Standard deviation of ln |G*|.
    frequency : float
        Hz.
    note : str
        Where it comes from.
    """

    modulus: Volume
    deviation: Volume
    frequency: float
    note: str

    @classmethod
    def read(cls, data: StiffnessData) -> MeasuredMap:
        """Read the volumes of a case's `[stiffness]`; raises `InputError` for volumes that do not belong together."""
        assert data.map is not None
        modulus = read_map(data.map, "shear moduli |G*| (Pa)")
        if data.sd is not None:
            sd = _beside(modulus, data.sd, "stiffness.sd")
            found = sd / modulus.data
        else:
            low, high = (
                _beside(modulus, str(path), f"stiffness.{n}") for n, path in (("low", data.low), ("high", data.high))
            )
            inside = (low <= modulus.data) & (modulus.data <= high) | np.isnan(modulus.data + low + high)
            if not inside.all():
                share = 1 - inside.mean()
                raise InputError(
                    "stiffness.low",
                    f"above the map, or high below it, in {share:.1%} of the voxels",
                    "an interval around it",
                )
            found = np.log(high / low) / (2 * ndtri(0.975))
        deviation = Volume(np.where(np.isnan(modulus.data), np.nan, np.maximum(found, LEAST_DEVIATION)), modulus.affine)
        assert data.frequency is not None  # the case needs it with a map
        return cls(modulus, deviation, data.frequency, f"a map of |G*| at {data.frequency:g} Hz")


def _beside(modulus: Volume, path: str, key: str) -> Array:
    other = read_map(path, "shear moduli (Pa)")
    if other.data.shape != modulus.data.shape or not np.allclose(other.affine, modulus.affine, atol=1e-6):
        raise InputError(key, f"{path}, on other voxels than the map", "a volume on the same voxels as stiffness.map")
    return other.data


@dataclass(eq=False, repr=False)
class RelativeStiffness(BriefText):
    """ln r at points, with its uncertain parts.

    Parameters
    ----------
    normal : mapping
        Tissue of the scene (its `region`) → normal tissue; None for those without, such as fluid.
    places : (K, 3) array
        Centres (m) of the error field.
    correlation : float
        Distance (m) over which errors are alike.
    measured : MeasuredMap, optional
        Without it r = 1.
    lesions : sequence of Lesion
        All of the case.
    extra_deviation : float
        Standard deviation of ln r beyond the map's intervals.
    """

    normal: Mapping[str, NormalTissue | None]
    places: Array
    correlation: float
    measured: MeasuredMap | None = None
    lesions: Sequence[Lesion] = ()
    extra_deviation: float = 0.0
    _filled: Volume | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        if self.measured is not None:
            logs = Volume(np.log(self.measured.modulus.data), self.measured.modulus.affine)
            self._filled = fill_missing(logs)

    @property
    def lesion_priors(self) -> tuple[Lesion, ...]:
        """Lesions with a ratio of their own: those that waves do not resolve, or all without a map."""
        return tuple(each for each in self.lesions if self.measured is None or not each.is_resolved)

    @property
    def reference(self) -> float:
        """Geometric mean of the norm over the tissues (Pa), at the map's frequency."""
        found = [each.modulus_at_frequency(self._frequency(each)) for each in self.normal.values() if each is not None]
        return float(np.exp(np.mean(np.log(found)))) if found else 1.0

    def log_norm(self, tissue: str) -> float:
        """ln of a tissue's norm over `reference`; 0 without a map, or without a norm."""
        normal = self.normal[tissue]
        if normal is None or self.measured is None:
            return 0.0
        return float(np.log(normal.modulus_at_frequency(self.measured.frequency) / self.reference))

    def _frequency(self, normal: NormalTissue) -> float:
        return normal.frequency if self.measured is None else self.measured.frequency

    @property
    def norm_deviation(self) -> float:
        """Standard deviation of the norm's ln at the map's frequency."""
        found = [each.deviation(self._frequency(each)) for each in self.normal.values() if each is not None]
        return max(found, default=0.0)

    def log_map(self, points: Array, shift: Array | None = None) -> Array:
        """ln of the map over `reference` at points, moved by a shift; 0 without a map.

        Parameters
        ----------
        points : (n, 3) array
            m.
        shift : (3,) array, optional
            m.

        Returns
        -------
        (n,) array
        """
        if self._filled is None:
            return np.zeros(len(points))
        found = self._at(points if shift is None else points + shift)
        for lesion in self.lesion_priors:
            ball = lesion_shape(lesion, points)
            if ball.any():
                found = found + ball * (self._around(lesion) - found)
        return found

    def _at(self, points: Array) -> Array:
        assert self._filled is not None
        last = np.array(self._filled.data.shape) - 1
        inside = np.clip(self._filled.to_voxels(points), 0, last)
        return self._filled.interpolate(self._filled.to_world(inside)) - np.log(self.reference)

    def _around(self, lesion: Lesion) -> float:
        """Mean of ln of the map in a layer around a lesion."""
        directions = np.random.default_rng(0).normal(size=(200, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        shell = np.array(lesion.centre) + (lesion.diameter / 2 + 2 * RIM) * directions
        return float(self._at(shell).mean())

    def weights(self, points: Array) -> Array:
        """Functions of the error field at points, with squares that add up to 1 (n, K)."""
        squares = ((points[:, None] - self.places[None]) ** 2).sum(axis=2)
        nearest = squares.min(axis=1, keepdims=True)  # far from all places the nearest one counts
        found = np.exp((nearest - squares) / (2 * self.correlation**2))
        return np.asarray(found / np.sqrt((found**2).sum(axis=1, keepdims=True)))

    def deviations(self) -> Array:
        """Standard deviation of ln r at the places (K,)."""
        if self.measured is None:
            spread = [np.log(each.person_factor) for each in self.normal.values() if each is not None]
            own = np.full(len(self.places), max(spread, default=0.0))
        else:
            volume = fill_missing(self.measured.deviation)
            last = np.array(volume.data.shape) - 1
            own = volume.interpolate(volume.to_world(np.clip(volume.to_voxels(self.places), 0, last)))
        return np.asarray(np.hypot(own, self.extra_deviation))

    def check_on(self, points: Array) -> dict[str, float]:
        """Whether the map lies over a body and is of its unit.

        Parameters
        ----------
        points : (n, 3) array
            Points (m) of tissue with a norm.

        Returns
        -------
        dict
            `measured` (share of the points) and `ratio_median`, `ratio_p5`, `ratio_p95`; empty without a map.

        Raises
        ------
        InputError
            The map lies elsewhere, or is no map of this tissue in Pa.
        """
        if self.measured is None:
            return {}
        known = np.argwhere(~np.isnan(self.measured.modulus.data))
        off = float(np.linalg.norm(self.measured.modulus.to_world(known).mean(axis=0) - points.mean(axis=0)))
        try:
            with file_context("stiffness"):
                found = measured_mask(self.measured.modulus, points)
        except InputError as error:
            wanted = f"one in the space of this head, over at least {COVERED:.0%} of it"
            raise InputError("stiffness.map", f"{error.value}; its middle is {1e3 * off:.0f} mm away", wanted) from None
        ratio = np.exp(self.log_map(points[found]))
        middle = float(np.median(ratio))
        if not RATIO[0] <= middle <= RATIO[1]:
            wanted = f"|G*| in Pa, {RATIO[0]:g} to {RATIO[1]:g} times the norm in the median"
            raise InputError(
                "stiffness.map", f"{middle:.3g} times the norm of {self.reference:.0f} Pa in the median", wanted
            )
        p5, p95 = np.percentile(ratio, [5, 95])
        return {"measured": float(found.mean()), "ratio_median": middle, "ratio_p5": float(p5), "ratio_p95": float(p95)}


def lesion_shape(lesion: Lesion, points: Array) -> Array:
    """1 inside a lesion, 0 outside, with an edge of the width `RIM`.

    Parameters
    ----------
    lesion : Lesion
    points : (n, 3) array
        m.

    Returns
    -------
    (n,) array

    Examples
    --------
    >>> from ngbrain.surgery.twin.case import Lesion
    >>> ball = Lesion(centre=(0.0, 0.0, 0.0), diameter=8e-3)
    >>> lesion_shape(ball, np.array([[0, 0, 0], [4e-3, 0, 0], [0.01, 0, 0]])).tolist()
    [1.0, 0.5, 0.0]
    """
    off = np.linalg.norm(points - np.array(lesion.centre), axis=1)
    return np.clip(0.5 + (lesion.diameter / 2 - off) / RIM, 0.0, 1.0)


def choose_places(points: Array, sites: Array, distance: float, most: int = PLACES) -> Array:
    """Places of a coarse field: the sites, then the points farthest from all places so far.

    Parameters
    ----------
    points : (n, 3) array
        Points of the body (m).
    sites : (m, 3) array
        Where plans are.
    distance : float
        No point is farther than this (m) from a place, unless there are `most`.
    most : int
        Largest number.

    Returns
    -------
    (K, 3) array

    Examples
    --------
    >>> line = np.column_stack([np.linspace(0, 1, 11), np.zeros((11, 2))])
    >>> choose_places(line, line[:1], 0.4)[:, 0].tolist()
    [0.0, 1.0, 0.5]
    """
    chosen = list(np.asarray(sites, float))
    gaps, _ = KDTree(np.array(chosen)).query(points)
    while len(chosen) < most and gaps.max() > distance:
        chosen.append(points[np.argmax(gaps)])
        gaps = np.minimum(gaps, np.linalg.norm(points - chosen[-1], axis=1))
    return np.array(chosen)
