"""Constitutive laws and elements of a model's levels."""

from __future__ import annotations

import math

from ngbrain.ladder.levels import Model, OrderLevel, TimeLevel
from ngbrain.materials import Viscous
from ngbrain.materials.base import Law
from ngbrain.materials.families import elastic_law


def has_memory(model: Model) -> bool:
    """Whether a model is viscoelastic."""
    return TimeLevel(model.get("time", TimeLevel.INSTANTANEOUS)).has_memory


def form_of(model: Model) -> str:
    """Elements of a model: displacements of its order, or mixed elements one order higher with pressures of its order."""
    k = OrderLevel(model["order"]).degree
    return f"P{k}" if model.get("pressure") == "none" else f"P{k + 1}/P{k}"


def relaxed_law(material: Viscous, ramp: float, t: float) -> Law:
    """Elastic law with the small-strain stress at time t, after a linear ramp and a hold.

    A branch of modulus μ and relaxation time τ has the modulus μ (τ/T)(1 - e^(-T/τ)) e^(-(t - T)/τ) after a ramp of T.

    Parameters
    ----------
    material : Viscous
    ramp : float
        Duration (s) of the ramp.
    t : float
        Time (s).

    Returns
    -------
    Law
    """
    return elastic_law(material, lambda tau: tau / ramp * -math.expm1(-ramp / tau) * math.exp(-(t - ramp) / tau))
