"""The energy that keeps two surfaces apart."""

from __future__ import annotations

import ngsolve as ngs
from ngsolve import CoefficientFunction


def soft_penalty(depth: CoefficientFunction, penalty: float, softness: float) -> CoefficientFunction:
    """ψ (J/m²) of `RigidContact`: 0 without depth, ε d³/(6s) up to s, and a parabola beyond."""
    d, s = depth, softness
    soft, stiff = d**3 / (6 * s), (d * d - d * s + s * s / 3) / 2
    return penalty * ngs.IfPos(d, ngs.IfPos(d - s, stiff, soft), 0)
