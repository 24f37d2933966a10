"""What drives a body at one frequency, and boundaries that let waves out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import ngsolve as ngs
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.materials.base import Value

Vector: TypeAlias = Sequence[Value] | CoefficientFunction


@dataclass(frozen=True)
class Wave:
    """What drives the body at one frequency (Hz, 0 for quasi-static).

    held      boundary pattern → displacement amplitude (m, complex), for boundaries among those that the body is held at
    traction  boundary pattern → force per area (Pa, complex)
    force     per volume (N/m³, complex)
    """

    frequency: float
    held: Mapping[str, Vector] = field(default_factory=dict)
    traction: Mapping[str, Vector] = field(default_factory=dict)
    force: Vector | None = None

    def __post_init__(self) -> None:
        if not (isinstance(self.frequency, (int, float)) and 0 <= self.frequency < math.inf):
            raise InputError("Wave.frequency", self.frequency, "a frequency in Hz of at least 0")

    @property
    def omega(self) -> float:
        """Angular frequency (rad/s)."""
        return 2 * math.pi * self.frequency


@dataclass(frozen=True)
class Absorbing:
    """A boundary that lets plane waves out: z_p = √(ρ(K + 4G/3)) along its normal, z_s = √(ρG) across (Pa s/m).

    Exact for waves that meet it squarely. Source: Lysmer and Kuhlemeyer 1969, 10.1061/JMCEA3.0001144.
    """

    boundary: str
    shear: Value
    bulk: Value = 0.0


def vector(value: Vector) -> CoefficientFunction:
    """As one CoefficientFunction; `InputError` for components that are None."""
    if isinstance(value, CoefficientFunction):
        return value
    if any(part is None for part in value):  # NGSolve's constructor would end the process
        raise InputError(
            "Wave", repr(tuple(value)), "numbers; components that slide are left out of `held`, {'y': 'top'}"
        )
    return ngs.CF(tuple(value))
