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
from ngbrain.look import BriefText
from ngbrain.materials.base import Value

Vector: TypeAlias = Sequence[Value] | CoefficientFunction


@dataclass(frozen=True, repr=False)
class Wave(BriefText):
    """Excitation at one frequency.

    Parameters
    ----------
    frequency : float
        Frequency (Hz); 0 for quasi-static.
    displacement : dict
        Boundary pattern → displacement amplitude (m, complex), for Dirichlet boundaries of the problem.
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
    displacement: Mapping[str, Vector] = field(default_factory=dict)
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
    """Absorbing boundary of impedance z_p = √(ρ(K + 4G/3)) along its normal, z_s = √(ρG) across (Pa s/m).

    Exact for plane waves at normal incidence.

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
    """A vector as one CoefficientFunction; `InputError` for components that are None."""
    if isinstance(value, CoefficientFunction):
        return value
    if any(part is None for part in value):  # NGSolve's constructor would end the process
        raise InputError("Wave", repr(tuple(value)), "numbers; leave free components out of `dirichlet`: {'y': 'top'}")
    return ngs.CF(tuple(value))


def dirichlet_axes(
    mesh: ngs.Mesh, names: str, waves: Sequence[Wave], dirichlet: str | Mapping[str, str]
) -> dict[str, str]:
    """Dirichlet boundaries of the waves, a pattern for each axis, checked.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    names : str
        Names of the axes.
    waves : sequence of Wave
    dirichlet : str or dict
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
    axes = dict.fromkeys(names, dirichlet) if isinstance(dirichlet, str) else dict(dirichlet)
    if not set(axes) <= set(names):
        raise InputError("dirichlet", sorted(axes), f"patterns for axes among {', '.join(names)}")
    axes = {axis: pattern for axis, pattern in axes.items() if pattern}
    allowed = set[int]().union(*(boundaries(mesh, pattern) for pattern in axes.values()))
    for wave in waves:
        for pattern in wave.displacement:
            if not boundaries(mesh, pattern) <= allowed:
                raise InputError(
                    "Wave.displacement", repr(pattern), f"boundaries among the Dirichlet ones: {dirichlet!r}"
                )
        for pattern in wave.traction:
            boundaries(mesh, pattern)
        for value in (
            *wave.displacement.values(),
            *wave.traction.values(),
            *([] if wave.force is None else [wave.force]),
        ):
            if (size := vector(value).dim) != len(names):
                raise InputError("Wave", f"a vector of {size} components", f"{len(names)} components")
    return axes
