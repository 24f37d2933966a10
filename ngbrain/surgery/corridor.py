"""Anatomy in the retraction corridor that no mesh contains: the falx and the superior sagittal sinus in the mid plane."""

from __future__ import annotations

import warnings

import numpy as np

from ngbrain.errors import ImplausibleWarning
from ngbrain.mesh import Cleft
from ngbrain.surgery.model import RetractionModel

SINUS = 6e-3
"""Approximate half width (m) of the superior sagittal sinus, which lies under the skull along the mid plane."""
STEPS = 200


def check_corridor(model: RetractionModel) -> list[str]:
    """Warn of a cleft that reaches the mid plane of the head.

    Parameters
    ----------
    model : RetractionModel
        Its mid plane is x = 0 in the head's own coordinates for the idealised head and MNI152, and the middle of the brain for
        another scan.

    Returns
    -------
    list of str
        The warning, which is also issued as `ImplausibleWarning`; empty without one.
    """
    found = corridor_findings(model)
    if not found:
        return []
    text = f"the corridor {' and '.join(found)}: neither the falx nor sinuses are part of the model"
    warnings.warn(text, ImplausibleWarning, stacklevel=3)
    return [text]


def corridor_findings(model: RetractionModel) -> list[str]:
    """What the cleft of a model crosses near the mid plane, in words (`crossings`)."""
    return crossings(model.cleft, _middle(model))


def crossings(cleft: Cleft, middle: float = 0.0) -> list[str]:
    """Structures that a cleft crosses near the mid plane, in words.

    Parameters
    ----------
    cleft : Cleft
    middle : float, optional
        Position x (m) of the mid plane.

    Returns
    -------
    list of str

    Examples
    --------
    >>> along = Cleft(np.array([0.03, 0, 0]), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), 0.04, 4e-3, 12e-3)
    >>> crossings(along), crossings(along, middle=0.03)
    ([], ['crosses the mid plane, where the falx stands', 'ends within 6 mm of the mid plane, under the sagittal sinus'])
    """
    heights = np.linspace(0, cleft.depth, STEPS)
    corners = [a * cleft.across + b * cleft.along for a in _sides(cleft.opening) for b in _sides(cleft.width)]
    x = np.array([[(cleft.target + corner + h * cleft.out)[0] for h in heights] for corner in corners]) - middle
    found = []
    if x.min() <= 0 <= x.max():
        found.append("crosses the mid plane, where the falx stands")
    if np.abs(x[:, -1]).min() < SINUS or x[:, -1].min() <= 0 <= x[:, -1].max():
        found.append(f"ends within {1e3 * SINUS:g} mm of the mid plane, under the sagittal sinus")
    return found


def _sides(length: float) -> tuple[float, float]:
    return -length / 2, length / 2


def _middle(model: RetractionModel) -> float:
    extent = getattr(model.head, "extent", None)
    if extent is None or model.scene.geometry.kind != "scan":
        return 0.0
    return float(extent()[0][0])
