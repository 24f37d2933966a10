"""Sampling points in tissue with stretches, stress and rates, and statistics that single points do not dominate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np

from ngbrain.forward.observables import StrainPercentile
from ngbrain.forward.observables.percentiles import weighted_percentile
from ngbrain.forward.solid.problem import Problem
from ngbrain.look import BriefText
from ngbrain.materials.points import evaluate_at_points
from ngbrain.mesh.geometry.cleft import Cleft
from ngbrain.surgery.measures.injury import Strain, stretching_rate, von_mises
from ngbrain.surgery.tools.base import coordinates
from ngbrain.tensors import deformation_gradient
from ngbrain.units import to_ml

NEIGHBOURHOOD = 20e-3
"""Percentiles and largest means are over tissue within this distance (m) of the unloaded cleft walls."""
AMOUNT = 0.5e-6
"""Volume (m³) over which the largest mean of a measure is taken: 0.5 ml, a cube of 8 mm.

The smallest volume for which the mean converges on affordable meshes. Neo-Hooke on the idealised head, 1 mm opening, elements of 4,
2.8 and 2 mm at the site: for the maximum principal strain the largest value is .119, .147, .188, the largest mean over 0.1 ml .095,
.102, .111, over 0.5 ml .078, .079, .081; for the von Mises stress the largest value is 481, 512, 648 Pa, those means 360, 350, 384
and 296, 291, 297.
"""


BANDS = {50: 0.05, 95: 0.02, 99: 0.01}
"""Percentile → half width, in volume, of the band over which its smoothed observable (`tissue_percentiles`) is averaged."""
UNKNOWN = (0.0, math.inf)
"""Stretch range of a law without known data: all stretches."""


@dataclass(frozen=True)
class TissuePart:
    """The part of a mesh that one tissue name covers.

    Parameters
    ----------
    where : CoefficientFunction
        1 inside, 0 elsewhere.
    fitted : tuple of float
        Lowest and highest stretch that its law was fitted to, `UNKNOWN` without data.
    modulus : float
        Initial shear modulus (Pa).
    """

    where: ngs.CoefficientFunction
    fitted: tuple[float, float]
    modulus: float

    @property
    def fitted_strain(self) -> float:
        """Largest |λ - 1| of the data; inf without data."""
        return round(max(abs(stretch - 1) for stretch in self.fitted), 9)


@dataclass(frozen=True)
class MeasureStatistics:
    """Statistics of a measure near the site at one time.

    Parameters
    ----------
    t : float
        Time (s).
    p50, p95, p99 : float
        Volume-weighted percentiles.
    largest : float
        `largest_mean` over `AMOUNT`.
    """

    t: float
    p50: float
    p95: float
    p99: float
    largest: float


@dataclass(frozen=True, repr=False)
class Sites(BriefText):
    """Sampling points, each representing a volume of unloaded tissue.

    Parameters
    ----------
    volume : (n,) array
        Volumes (m³).
    part : (n,) int array
        Index of the tissue in `names`.
    near : int array
        Indices of the points near the site.
    names : tuple of str
        Tissue names.
    """

    volume: np.ndarray
    part: np.ndarray
    near: np.ndarray
    names: tuple[str, ...]

    def statistics(self, t: float, values: np.ndarray) -> MeasureStatistics:
        """Statistics of a measure near the site.

        Parameters
        ----------
        t : float
            Time (s).
        values : array
            At the points near the site.

        Returns
        -------
        MeasureStatistics
        """
        volume = self.volume[self.near]
        p50, p95, p99 = (weighted_percentile(values, volume, percent) for percent in BANDS)
        return MeasureStatistics(t, p50, p95, p99, largest_mean(values, volume, AMOUNT))

    def ml(self, mask: np.ndarray) -> dict[str, float]:
        """Tissue name → unloaded volume (ml) of the points in a mask of all points."""
        sums = np.bincount(self.part[mask], self.volume[mask], len(self.names))
        return dict(zip(self.names, to_ml(sums).tolist(), strict=True))


def tissue_percentiles(cleft: Cleft, parts: Mapping[str, TissuePart]) -> dict[str, StrainPercentile]:
    """Percentiles of strain near the site as observables with gradients, by key such as mps_p95 or oss_p50.

    They are those of `MeasureStatistics`, smoothed over `BANDS` of the volume and at their own points; `raw` is not smoothed.

    Parameters
    ----------
    cleft : Cleft
        The site is around its walls.
    parts : mapping of TissuePart
        Tissues that count, by name.

    Returns
    -------
    dict of StrainPercentile

    Examples
    --------
    >>> out, across = np.array([0.0, 0, 1]), np.array([1.0, 0, 0])
    >>> cleft = Cleft(np.zeros(3), out, across, 30e-3, 4e-3, 12e-3)
    >>> list(tissue_percentiles(cleft, {"white": TissuePart(ngs.CF(1.0), UNKNOWN, 1e3)}))[:3]
    ['mps_p50', 'mps_p95', 'mps_p99']
    """
    a, b, c = coordinates(cleft, ngs.CF((ngs.x, ngs.y, ngs.z)))
    off = [
        _magnitude(a) - cleft.opening / 2,
        _above_zero(_magnitude(b) - cleft.width / 2),
        _above_zero(-c) + _above_zero(c - cleft.depth),
    ]
    near = ngs.IfPos(NEIGHBOURHOOD**2 - sum(each * each for each in off), 1.0, 0.0)
    where = near * sum(part.where for part in parts.values())
    measures = {"mps": "Green-Lagrange", "oss": "octahedral"}
    return {
        f"{name}_p{percent}": StrainPercentile(percent, band=band, where=where, measure=measure)
        for name, measure in measures.items()
        for percent, band in BANDS.items()
    }


def _magnitude(x: ngs.CoefficientFunction) -> ngs.CoefficientFunction:
    """|x|."""
    return ngs.IfPos(x, x, -x)


def _above_zero(x: ngs.CoefficientFunction) -> ngs.CoefficientFunction:
    """x where it is above 0, else 0."""
    return ngs.IfPos(x, x, 0.0)


def largest_mean(values: np.ndarray, volumes: np.ndarray, amount: float) -> float:
    """The largest mean of a field over any part of the tissue with a given volume: (1/V) max ∫_A f dV over all A with |A| = V.

    The part is where the field is largest. The largest means of two fields differ by at most ∫|f - g| dV / V, so that the measure
    converges wherever the field itself converges in the mean, also at singular edges and corners, where the largest value
    diverges. If there is less tissue than the volume, it is the mean of all.

    Parameters
    ----------
    values : (n,) array
        Field at the points.
    volumes : (n,) array
        Volumes that the points represent.
    amount : float
        V, in the unit of the volumes.

    Returns
    -------
    float

    References
    ----------
    Rockafellar & Uryasev 2002, 10.1016/S0378-4266(02)00271-6 (conditional value at risk).

    Examples
    --------
    >>> largest_mean(np.array([1.0, 5.0, 3.0]), np.array([1.0, 1.0, 2.0]), 2.0)
    4.0
    """
    order = np.argsort(-values, kind="stable")
    volumes = volumes[order]
    taken = np.clip(amount - (np.cumsum(volumes) - volumes), 0.0, volumes)
    return float(taken @ values[order] / np.sum(taken))


class Sampler:
    """Samples strain, stress and rate of deformation of a body at its own quadrature points in tissue.

    Parameters
    ----------
    body : Problem
    cleft : Cleft
        The site is around its walls.
    parts : dict of TissuePart
        By name; other tissue is not sampled.
    """

    def __init__(self, body: Problem, cleft: Cleft, parts: dict[str, TissuePart]) -> None:
        self.body = body
        rule = body.history.rules[ngs.TET]
        points = body.mesh.MapToAllElements({ngs.TET: rule}, ngs.VOL)
        shares = np.column_stack([evaluate_at_points(part.where, points) for part in parts.values()])
        self._tissue = np.flatnonzero(shares.max(axis=1) > 0.5)
        self._points = points[self._tissue]
        jacobian = np.abs(ngs.Det(ngs.specialcf.JacobianMatrix(3))(self._points)).ravel()
        weights = np.tile(np.array(rule.weights), body.mesh.ne)[self._tissue]
        places = ngs.CF((ngs.x, ngs.y, ngs.z))(self._points)
        near = np.flatnonzero(cleft.distance_to_walls(places) <= NEIGHBOURHOOD)
        self.sites = Sites(jacobian * weights, shares[self._tissue].argmax(axis=1), near, tuple(parts))
        self._fitted = np.array([part.fitted for part in parts.values()])[self.sites.part].T
        self._F = deformation_gradient(body.u).Compile()
        self.start(0.0)

    def start(self, t: float) -> None:
        """Use the present state at time t (s) as the reference of the next rates."""
        self._before = t, self._deformation()[self.sites.near]

    def __call__(self, t: float) -> TissueSample:
        """Sample the present state at time t (s), after `Problem.tissue_forces`."""
        F, near = self._deformation(), self.sites.near
        before, self._before = self._before, (t, F[near])
        rate = stretching_rate(before[1], F[near], t - before[0]) if t > before[0] else np.zeros(len(near))
        stress = von_mises(F[near], self.body.tissue_stress()[self._tissue[near]])
        strain = Strain(np.sqrt(np.linalg.eigvalsh(np.einsum("nki,nkj->nij", F, F))))
        return TissueSample(t, self.sites, strain, strain.beyond(*self._fitted), stress, rate)

    def _deformation(self) -> np.ndarray:
        return np.asarray(self._F(self._points)).reshape(-1, 3, 3)


@dataclass(frozen=True, repr=False)
class TissueSample(BriefText):
    """Tissue at one time.

    Parameters
    ----------
    t : float
        Time (s).
    sites : Sites
    strain : Strain
        At all points.
    beyond : bool array
        Whether the strain leaves the range that its law was fitted to.
    von_mises, rate : array
        Cauchy stress (Pa) and rate of deformation (1/s, over the last step) near the site.
    """

    t: float
    sites: Sites
    strain: Strain
    beyond: np.ndarray
    von_mises: np.ndarray
    rate: np.ndarray

    def statistics(self) -> dict[str, MeasureStatistics]:
        """Statistics of every measure, by name."""
        near = self.sites.near
        measures = {
            "mps": self.strain.mps[near],
            "oss": self.strain.oss[near],
            "von_mises": self.von_mises,
            "rate": self.rate,
        }
        return {name: self.sites.statistics(self.t, values) for name, values in measures.items()}
