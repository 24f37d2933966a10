"""What a retraction does to tissue: strain percentiles and volumes, pressure doses and times above thresholds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import ngsolve as ngs
import numpy as np
from scipy.interpolate import PchipInterpolator, PPoly

from ngbrain.forward.body import Body
from ngbrain.mesh.cleft import Cleft
from ngbrain.tensors import deformation_gradient, octahedral_shear
from ngbrain.units import to_minutes, to_ml

NEIGHBOURHOOD = 20e-3
"""Strain percentiles are over tissue this near (m) to the unloaded cleft walls."""
MPS_THRESHOLDS = (0.14, 0.18, 0.21, 0.34)
"""Maximum principal strains of axonal injury in the optic nerve: Bain & Meaney 2000, 10.1115/1.1324667."""
SAMPLE_RULE = 2
"""Order of the rule at whose points strain is sampled; its points carry the volumes."""


@dataclass(frozen=True)
class Strain:
    """Strain at sample points: stretches λ (n, 3) ascending, volumes (m³), and which points are near the site."""

    stretch: np.ndarray
    volume: np.ndarray
    near: np.ndarray

    @property
    def mps(self) -> np.ndarray:
        """Maximum principal strain, the largest eigenvalue of E = (C - 1)/2."""
        return (self.stretch[:, 2] ** 2 - 1) / 2

    @property
    def oss(self) -> np.ndarray:
        """Octahedral shear strain of the logarithmic strain."""
        return octahedral_shear(np.log(self.stretch))

    def percentile(self, values: np.ndarray, percent: float) -> float:
        """Volume-weighted percentile over the tissue near the site."""
        values, weights = values[self.near], self.volume[self.near]
        order = np.argsort(values, kind="stable")
        share = np.cumsum(weights[order]) / np.sum(weights)
        return float(values[order][np.searchsorted(share, percent / 100)])

    def volume_where(self, mask: np.ndarray) -> float:
        """Unloaded volume (ml) of the tissue where a mask holds."""
        return to_ml(float(np.sum(self.volume[mask])))


class StrainSampler:
    """Evaluates strain at quadrature points of the tissue regions, with their volumes and distance to the cleft."""

    def __init__(self, body: Body, cleft: Cleft, tissue: str) -> None:
        rule = ngs.IntegrationRule(ngs.TET, SAMPLE_RULE)
        mesh = body.mesh
        region = mesh.Materials(tissue)
        self._points = mesh.MapToAllElements(rule, region)
        jacobian = np.abs(ngs.Det(ngs.specialcf.JacobianMatrix(3))(self._points)).ravel()
        n_elements = jacobian.size // len(rule.weights)
        self.volume = jacobian * np.tile(np.array(rule.weights), n_elements)
        positions = ngs.CF((ngs.x, ngs.y, ngs.z))(self._points)
        self.near = cleft.distance_to_walls(positions) <= NEIGHBOURHOOD
        self._F = deformation_gradient(body.u).Compile()

    def __call__(self) -> Strain:
        """The strain of the body as it stands."""
        F = self._F(self._points).reshape(-1, 3, 3)
        stretch = np.sqrt(np.linalg.eigvalsh(np.einsum("nki,nkj->nij", F, F)))
        return Strain(stretch, self.volume, self.near)


def curve(t: np.ndarray, pressure: np.ndarray, events: Sequence[float]) -> PPoly:
    """Pressure at steps as a function of time: a monotone cubic between events (s), where it may bend.

    Steps have to end on the events, from first to last. Long steps of a hold are followed to a part of a percent, where
    straight lines would lie above.

    Source: Fritsch & Butland 1984, 10.1137/0905021.
    """
    at = np.searchsorted(t, events)
    pieces = [PchipInterpolator(t[i : j + 1], pressure[i : j + 1]) for i, j in pairwise(at)]
    return PPoly(np.concatenate([piece.c for piece in pieces], axis=1), t[at[0] : at[-1] + 1])


def dose(pressure: PPoly, until: float | None = None) -> float:
    """∫ p dt in (unit of p) minutes, of a `curve` to its end or to a time (s).

    >>> dose(curve(np.array([0.0, 60.0, 120.0]), np.array([10.0, 10.0, 10.0]), [0.0, 120.0]))
    20.0
    """
    start, end = pressure.x[[0, -1]]
    return to_minutes(float(pressure.integrate(start, end if until is None else until)))


def times_above(pressure: PPoly, threshold: float) -> tuple[float, float]:
    """Total and longest uninterrupted time (s) that a `curve` spends above a threshold.

    >>> times_above(curve(np.array([0.0, 10.0, 20.0]), np.array([0.0, 40.0, 0.0]), [0.0, 10.0, 20.0]), 20.0)
    (10.0, 10.0)
    """
    crossings = pressure.solve(threshold, discontinuity=False, extrapolate=False)
    ends = np.unique([*pressure.x[[0, -1]], *crossings[np.isfinite(crossings)]])
    lengths = np.where(pressure((ends[1:] + ends[:-1]) / 2) > threshold, np.diff(ends), 0.0)
    total = longest = current = 0.0
    for length in lengths.tolist():
        current = current + length if length else 0.0
        total, longest = total + length, max(longest, current)
    return total, longest
