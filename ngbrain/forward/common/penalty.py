"""Regularised penalty energy of contact."""

from __future__ import annotations

import ngsolve as ngs
from ngsolve import CoefficientFunction


def soft_penalty(depth: CoefficientFunction, penalty: float, softness: float) -> CoefficientFunction:
    """Penalty energy ψ per area (J/m²): 0 for a gap, ε d³/(6s) up to the depth s, and a parabola beyond.

    Parameters
    ----------
    depth : CoefficientFunction
        Penetration d (m).
    penalty : float
        ε (Pa/m).
    softness : float
        s (m).

    Returns
    -------
    CoefficientFunction
    """
    d, s = depth, softness
    soft, stiff = d**3 / (6 * s), (d * d - d * s + s * s / 3) / 2
    return penalty * ngs.IfPos(d, ngs.IfPos(d - s, stiff, soft), 0)
