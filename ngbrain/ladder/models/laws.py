"""Constitutive laws and finite elements that a model's levels stand for."""

from __future__ import annotations

import math

from ngbrain.ladder.levels import Model, OrderLevel, TimeLevel
from ngbrain.materials import Viscous
from ngbrain.materials.base import Law
from ngbrain.materials.families import elastic_law


def has_memory(model: Model) -> bool:
    """Whether it has a memory."""
    return TimeLevel(model.get("time", TimeLevel.INSTANTANEOUS)).has_memory


def form_of(model: Model) -> str:
    """Displacements of the order alone, or one order higher over pressures of the order."""
    k = OrderLevel(model["order"]).degree
    return f"P{k}" if model.get("pressure") == "none" else f"P{k + 1}/P{k}"


def relaxed_law(material: Viscous, ramp: float, t: float) -> Law:
    """The elastic law with the stress that small strains have at t, which grew evenly in `ramp` and then stayed.

    A branch of modulus μ and time τ has μ (τ/T)(1 - e^(-T/τ)) e^(-(t - T)/τ) left.
    """
    return elastic_law(material, lambda tau: tau / ramp * -math.expm1(-ramp / tau) * math.exp(-(t - ramp) / tau))
