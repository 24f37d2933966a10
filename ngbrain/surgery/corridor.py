"""What lies in the way of a retraction that no mesh has: the falx and the sagittal sinus in the middle between the hemispheres."""

from __future__ import annotations

import warnings

import numpy as np

from ngbrain.errors import ImplausibleWarning
from ngbrain.mesh import Cleft
from ngbrain.surgery.model import RetractionModel

SINUS = 6e-3
"""Half width (m) of the superior sagittal sinus, about: it lies under the skull along the mid plane."""
STEPS = 200


def check_corridor(model: RetractionModel) -> list[str]:
    """Warn of a cleft that reaches the mid plane of the head.

    Parameters
    ----------
    model : Model
        Of a scene. Its mid plane is that of the head's own coordinates: x = 0 of the idealised head and of MNI152, the middle of
        the brain of another scan.

    Returns
    -------
    list of str
        The warning, which is also issued as `ImplausibleWarning`, or nothing.
    """
    found = crossings(model.cleft, _middle(model))
    if not found:
        return []
    text = f"the corridor {' and '.join(found)}: neither the falx nor sinuses are part of the model"
    warnings.warn(text, ImplausibleWarning, stacklevel=3)
    return [text]


def crossings(cleft: Cleft, middle: float = 0.0) -> list[str]:
    """What a cleft crosses at the plane x = `middle` (m), in words.

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
