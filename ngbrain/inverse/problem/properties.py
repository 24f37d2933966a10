"""The unknown material properties: start values, bounds and the moduli that they make."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from ngbrain.errors import InputError, nearest
from ngbrain.inverse.data.direct_inversion import uniform_modulus, uniform_shear
from ngbrain.inverse.data.plausibility import check_frequency
from ngbrain.inverse.objective.parameters import BoundedTransform, LogTransform
from ngbrain.io.waves import WaveData

LOSSY = 0.1
FIBROUS = 0.5
"""Start values: the loss tangent, and ζ and φ."""
EXPONENT, EXPONENTS = "exponent", (-1.0, 3.0)
"""Name and bounds of the exponent a in G*(ω) = G*(ω₀) (ω/ω₀)^a. Soft tissue has 0 to 1."""
MODULI = ("youngs", "storage", "loss", "mu", "magnitude")
Value = TypeVar("Value")


@dataclass(frozen=True)
class Property:
    """An unknown material property.

    Parameters
    ----------
    name : str
        Such as "storage".
    start : float
        Start value, Pa for moduli.
    lower, upper : float
        Bounds.
    is_uniform : bool
        Whether it is one number for all tissue.
    """

    name: str
    start: float
    lower: float = 0.0
    upper: float = np.inf
    is_uniform: bool = False

    def contains(self, values: np.ndarray) -> bool:
        """Whether all these values lie between the bounds."""
        return bool(np.all((values > self.lower) & (values < self.upper)))

    @property
    def transform(self) -> LogTransform | BoundedTransform:
        """The transform to an unbounded variable: ln(θ - lower), or one for both bounds."""
        return LogTransform(self.lower) if self.upper == np.inf else BoundedTransform(self.lower, self.upper)


def material_properties(data: WaveData, shear: float | None = None) -> tuple[Property, ...]:
    """Return the unknown properties of the data's material.

    Isotropic: youngs, or storage and loss. With fibres: mu (or storage and loss), zeta and phi.

    Parameters
    ----------
    data : WaveData
        Their symmetry and rheology decide.
    shear : float, optional
        Shear modulus (Pa) from which moduli start; by default the one that the waves suggest.

    Returns
    -------
    tuple of Property
        The properties.

    Raises
    ------
    InputError
        The waves suggest a modulus that no tissue has.
    """
    stiff, loss = _start(data) if shear is None else (shear, LOSSY * shear)
    if data.rheology == "viscoelastic":
        moduli = [Property("storage", stiff), Property("loss", loss)]
    elif data.symmetry == "isotropic":
        moduli = [Property("youngs", float(np.real(data.youngs_of(stiff))))]
    else:
        moduli = [Property("mu", stiff)]
    if data.symmetry == "transversely_isotropic":
        moduli += [Property("zeta", FIBROUS, -0.75), Property("phi", FIBROUS, -1.0)]
    return tuple(moduli)


def polar_properties(data: WaveData, shear: float | None = None) -> tuple[Property, ...]:
    """Return the properties with magnitude |G*| (Pa) and phase (rad, 0 to π/2) in place of storage and loss.

    As ln G* = ln |G*| + i phase, regularisers then act on modulus and loss angle separately.

    Parameters
    ----------
    data : WaveData
        Viscoelastic data.
    shear : float, optional
        As for `material_properties`.

    Returns
    -------
    tuple of Property
        The properties.

    Raises
    ------
    InputError
        The data are elastic.
    """
    if data.rheology != "viscoelastic":
        raise InputError("unknowns", "'polar'", "moduli: elastic data have no phase")
    storage, loss, *others = material_properties(data, shear)
    modulus = complex(storage.start, loss.start)
    size, phase = Property("magnitude", abs(modulus)), Property("phase", float(np.angle(modulus)), 0.0, np.pi / 2)
    return size, phase, *others


UNKNOWNS: dict[str, Callable[..., tuple[Property, ...]]] = {"moduli": material_properties, "polar": polar_properties}
"""Parametrisations of a complex modulus, as `invert` offers them."""


def select_properties(data: WaveData, chosen: str) -> tuple[Property, ...]:
    """Return the unknown properties of a parametrisation.

    Parameters
    ----------
    data : WaveData
        The data.
    chosen : str
        A name in `UNKNOWNS`.

    Returns
    -------
    tuple of Property
        The properties.

    Raises
    ------
    InputError
        `UNKNOWNS` has no such name.
    """
    if chosen not in UNKNOWNS:
        raise InputError("unknowns", repr(chosen), nearest(chosen, tuple(UNKNOWNS)))
    return UNKNOWNS[chosen](data)


def frequency_exponent(data: WaveData) -> Property:
    """Return the unknown exponent a of G*(x, ω) = G*₀(x) (ω/ω₀)^a; it starts from the moduli that each frequency suggests.

    Raises
    ------
    InputError
        The data have one frequency, or quasi-static loads.
    """
    each = np.unique(data.frequency)
    if len(each) < 2 or not each[0]:
        raise InputError("dispersion", "power", "waves of two frequencies or more, and none at rest")
    moduli = []
    for f in each:
        chosen = data.frequency == f
        moduli.append(
            uniform_shear(replace(data, displacement=data.displacement[chosen], frequency=data.frequency[chosen]))
        )
    slope = float(np.polyfit(np.log(each), np.log(moduli), 1)[0])
    return Property(EXPONENT, float(np.clip(slope, 0.1, 1.5)), *EXPONENTS, is_uniform=True)


def as_moduli(values: Mapping[str, Value], library: Any = np) -> dict[str, Value]:
    """Replace magnitude and phase by storage and loss, where there are some.

    Parameters
    ----------
    values : mapping of str to value
        Property → values.
    library : module
        Has cos and sin of such values: numpy or ngsolve.

    Returns
    -------
    dict
        Property → values.

    Examples
    --------
    >>> {name: float(round(value, 6)) for name, value in as_moduli({"magnitude": 2.0, "phase": np.pi / 6}).items()}
    {'storage': 1.732051, 'loss': 1.0}
    """
    if "magnitude" not in values:
        return dict(values)
    rest: dict[str, Any] = dict(values)
    size, phase = rest.pop("magnitude"), rest.pop("phase")
    return {"storage": size * library.cos(phase), "loss": size * library.sin(phase), **rest}


def as_polar(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the values, and magnitude and phase of storage and loss beside them where there are some."""
    if "storage" not in values:
        return dict(values)
    modulus = values["storage"] + 1j * values["loss"]
    return {**values, "magnitude": np.abs(modulus), "phase": np.angle(modulus)}


def _start(data: WaveData) -> tuple[float, float]:
    """Storage and loss modulus (Pa) that the waves suggest."""
    modulus = uniform_modulus(data).value
    check_frequency(data, abs(modulus))
    return modulus.real, max(modulus.imag, LOSSY * modulus.real)
