"""What a retraction does to tissue: strain percentiles and volumes, pressure doses and times above thresholds."""

from __future__ import annotations

from dataclasses import dataclass

import ngsolve as ngs
import numpy as np

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


def dose(t: np.ndarray, pressure: np.ndarray) -> float:
    """∫ p dt in (unit of p) minutes, by the trapezoidal rule.

    >>> dose(np.array([0.0, 120.0]), np.array([10.0, 10.0]))
    20.0
    """
    return to_minutes(float(np.trapezoid(pressure, t)))


def times_above(t: np.ndarray, pressure: np.ndarray, threshold: float) -> tuple[float, float]:
    """Total and longest uninterrupted time (s) that a piecewise linear curve spends above a threshold.

    >>> times_above(np.array([0.0, 10.0, 20.0]), np.array([0.0, 40.0, 0.0]), 20.0)
    (10.0, 10.0)
    """
    total = longest = current = 0.0
    for t0, t1, p0, p1 in zip(t, t[1:], pressure, pressure[1:], strict=False):
        if p0 <= threshold and p1 <= threshold:
            current = 0.0
            continue
        if p0 > threshold and p1 > threshold:
            piece = t1 - t0
            current += piece
        else:
            cross = t0 + (threshold - p0) / (p1 - p0) * (t1 - t0)
            piece = cross - t0 if p0 > threshold else t1 - cross
            current = current + piece if p0 > threshold else piece
        total += piece
        longest = max(longest, current)
        if p1 <= threshold:
            current = 0.0
    return float(total), float(longest)
