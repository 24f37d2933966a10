"""Measures of tissue injury: strain, stress and their rates at points, and the dose of a pressure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ngbrain.adjoint.time_curve import TimeCurve
from ngbrain.look import BriefText
from ngbrain.tensors import octahedral_shear
from ngbrain.units import to_minutes

MPS_THRESHOLDS = (0.14, 0.18, 0.21, 0.34)
"""Maximum principal strains of axonal injury in the optic nerve: Bain & Meaney 2000, 10.1115/1.1324667."""


@dataclass(frozen=True, repr=False)
class Strain(BriefText):
    """Strain at points, from the principal stretches λ (n, 3), ascending."""

    stretch: np.ndarray

    @property
    def mps(self) -> np.ndarray:
        """Maximum principal strain, the largest eigenvalue of E = (C - 1)/2."""
        return (self.stretch[:, 2] ** 2 - 1) / 2

    @property
    def oss(self) -> np.ndarray:
        """Octahedral shear strain of the logarithmic strain."""
        return octahedral_shear(np.log(self.stretch))

    def beyond(self, least: np.ndarray, most: np.ndarray) -> np.ndarray:
        """Whether a stretch leaves the range that the law at each point was fitted to.

        Parameters
        ----------
        least, most : (n,) array
            Lowest and highest stretch of the data.

        Returns
        -------
        (n,) bool array
        """
        return np.asarray((self.stretch[:, 0] < least) | (self.stretch[:, 2] > most))


def von_mises(F: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Von Mises stress √(3/2 dev σ : dev σ) of the Cauchy stress σ = P Fᵀ / J.

    Parameters
    ----------
    F : (n, 3, 3) array
        Deformation gradient.
    P : (n, 3, 3) array
        Nominal stress ∂W/∂F.

    Returns
    -------
    (n,) array
        In the unit of P.

    Examples
    --------
    >>> F = np.diag([4.0, 0.5, 0.5])
    >>> float(von_mises(F[None], np.diag([3.0, 0.0, 0.0])[None])[0])  # 3 of nominal stress on a quarter of the area
    12.0
    """
    stress = np.einsum("nik,njk->nij", P, F) / np.linalg.det(F)[:, None, None]
    deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    return np.asarray(np.sqrt(1.5 * np.einsum("nij,nij->n", deviator, deviator)))


def stretching_rate(before: np.ndarray, after: np.ndarray, dt: float) -> np.ndarray:
    """Largest principal rate of deformation, averaged over a time step: the largest eigenvalue of ln(fᵀf) / 2dt.

    With f = F₁ F₀⁻¹ between two deformation gradients this is the largest eigenvalue of D = sym(Ḟ F⁻¹) where that is steady, and
    in the limit dt → 0; a rotation has none, and unloading counts as loading does.

    Parameters
    ----------
    before, after : (n, 3, 3) array
        Deformation gradients.
    dt : float
        Time (s) between them.

    Returns
    -------
    (n,) array
        In 1/s.

    Examples
    --------
    >>> F = np.diag([1.0, 1.0, np.exp(0.2)])
    >>> round(float(stretching_rate(np.eye(3)[None], F[None], 0.1)[0]), 12)
    2.0
    """
    f = after @ np.linalg.inv(before)
    return np.asarray(np.log(np.linalg.eigvalsh(np.einsum("nki,nkj->nij", f, f))[:, 2]) / (2 * dt))


def dose(pressure: TimeCurve, until: float | None = None) -> float:
    """Pressure-time dose ∫ p dt.

    Parameters
    ----------
    pressure : TimeCurve
        Pressure over time (s).
    until : float, optional
        End (s); by default the end of the curve.

    Returns
    -------
    float
        In (unit of the pressure) minutes.

    Examples
    --------
    >>> dose(TimeCurve([0.0, 60.0, 120.0], [10.0, 10.0, 10.0]))
    20.0
    """
    return to_minutes(pressure.integral(until))
