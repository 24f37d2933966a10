"""Harmonic excitation at one frequency, and absorbing boundaries."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import ngsolve as ngs
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.forward.common.regions import boundaries
from ngbrain.materials.base import Value

Vector: TypeAlias = Sequence[Value] | CoefficientFunction


@dataclass(frozen=True)
class Wave:
    """What drives the body at one frequency (Hz, 0 for quasi-static).

    Parameters
    ----------
    frequency : float
        Hz.
    held : dict
        Boundary pattern → displacement amplitude (m, complex), for boundaries among those that the body is held at.
    traction : dict
        Boundary pattern → force per area (Pa, complex).
    force : vector, optional
        Per volume (N/m³, complex).

    Raises
    ------
    InputError
        For a frequency below 0.
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
class AbsorbingBoundary:
    """A boundary that lets plane waves out: z_p = √(ρ(K + 4G/3)) along its normal, z_s = √(ρG) across (Pa s/m).

    Exact for waves that meet it squarely.

    Parameters
    ----------
    boundary : str
        A pattern.
    shear, bulk : float, complex or CoefficientFunction
        Moduli (Pa) behind the boundary.

    References
    ----------
    Lysmer and Kuhlemeyer 1969, 10.1061/JMCEA3.0001144.
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


def held_axes(mesh: ngs.Mesh, names: str, waves: Sequence[Wave], held: str | Mapping[str, str]) -> dict[str, str]:
    """Dirichlet boundaries of the waves, a pattern for each axis, checked.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    names : str
        Names of the axes.
    waves : sequence of Wave
    held : str or dict
        A pattern, or axis → pattern.

    Returns
    -------
    dict
        Axis → pattern.

    Raises
    ------
    InputError
        Without waves, for unknown axes or patterns, and loads that do not fit.
    """
    if not waves:
        raise InputError("waves", "none", "one Wave or more")
    axes = dict.fromkeys(names, held) if isinstance(held, str) else dict(held)
    if not set(axes) <= set(names):
        raise InputError("held", sorted(axes), f"patterns for axes among {', '.join(names)}")
    axes = {axis: pattern for axis, pattern in axes.items() if pattern}
    allowed = set[int]().union(*(boundaries(mesh, pattern) for pattern in axes.values()))
    for wave in waves:
        for pattern in wave.held:
            if not boundaries(mesh, pattern) <= allowed:
                raise InputError("Wave.held", repr(pattern), f"boundaries among those held: {held!r}")
        for pattern in wave.traction:
            boundaries(mesh, pattern)
        for value in (*wave.held.values(), *wave.traction.values(), *([] if wave.force is None else [wave.force])):
            if (size := vector(value).dim) != len(names):
                raise InputError("Wave", f"a vector of {size} components", f"{len(names)} components")
    return axes
