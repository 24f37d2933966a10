"""The quantities that are looked for in a material: where they start, between which bounds, and the modulus that they make."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from ngbrain.errors import InputError, nearest
from ngbrain.inverse.data.direct_inversion import uniform_modulus, uniform_shear
from ngbrain.inverse.data.plausibility import check_frequency
from ngbrain.inverse.objective.parameters import Bounded, Log
from ngbrain.io.waves import WaveData

LOSSY = 0.1
FIBROUS = 0.5
"""Loss tangent, and ζ and φ, to start from."""
EXPONENT, EXPONENTS = "exponent", (-1.0, 3.0)
"""Of frequency, a in G*(ω) = G*(ω₀) (ω/ω₀)^a, and its bounds: soft tissue has 0 to 1."""
MODULI = ("youngs", "storage", "loss", "mu", "magnitude")
Value = TypeVar("Value")


@dataclass(frozen=True)
class Quantity:
    """A property that is looked for: where it starts, the bounds that it stays within, whether it is one number for all tissue."""

    name: str
    start: float
    floor: float = 0.0
    ceiling: float = np.inf
    single: bool = False

    def within(self, values: np.ndarray) -> bool:
        """Whether all these lie between the bounds."""
        return bool(np.all((values > self.floor) & (values < self.ceiling)))

    @property
    def transform(self) -> Log | Bounded:
        """The variable that can take any value: ln(θ - floor), or one for both bounds."""
        return Log(self.floor) if self.ceiling == np.inf else Bounded(self.floor, self.ceiling)


def quantities(data: WaveData, shear: float | None = None) -> tuple[Quantity, ...]:
    """What the data's material has: youngs, or storage and loss (isotropic); mu or storage and loss, zeta, phi (fibres).

    `shear` (Pa) is where moduli start; unasked what the waves suggest. Raises `InputError` where that is the modulus of no tissue.
    """
    stiff, loss = _start(data) if shear is None else (shear, LOSSY * shear)
    if data.rheology == "viscoelastic":
        moduli = [Quantity("storage", stiff), Quantity("loss", loss)]
    elif data.symmetry == "isotropic":
        moduli = [Quantity("youngs", float(np.real(data.youngs_of(stiff))))]
    else:
        moduli = [Quantity("mu", stiff)]
    if data.symmetry == "transversely_isotropic":
        moduli += [Quantity("zeta", FIBROUS, -0.75), Quantity("phi", FIBROUS, -1.0)]
    return tuple(moduli)


def polar(data: WaveData, shear: float | None = None) -> tuple[Quantity, ...]:
    """The same with magnitude |G*| (Pa) and phase (rad, 0 to π/2) in place of storage and loss: ln G* = ln |G*| + i phase.

    Regularisers then hold the loss angle even where the modulus is not, and the other way round. Raises `InputError` for
    elastic data.
    """
    if data.rheology != "viscoelastic":
        raise InputError("unknowns", "'polar'", "moduli: elastic data have no phase")
    storage, loss, *others = quantities(data, shear)
    modulus = complex(storage.start, loss.start)
    size, phase = Quantity("magnitude", abs(modulus)), Quantity("phase", float(np.angle(modulus)), 0.0, np.pi / 2)
    return size, phase, *others


UNKNOWNS: dict[str, Callable[..., tuple[Quantity, ...]]] = {"moduli": quantities, "polar": polar}
"""Ways of looking for a complex modulus, as `invert` offers them."""


def unknowns_of(data: WaveData, chosen: str) -> tuple[Quantity, ...]:
    """Those of a name in `UNKNOWNS`; `InputError` for another one."""
    if chosen not in UNKNOWNS:
        raise InputError("unknowns", repr(chosen), nearest(chosen, tuple(UNKNOWNS)))
    return UNKNOWNS[chosen](data)


def exponent(data: WaveData) -> Quantity:
    """The exponent a of G*(x, ω) = G*₀(x) (ω/ω₀)^a, from the moduli that each frequency suggests by itself.

    Raises `InputError` for data of one frequency, or with loads at rest.
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
    return Quantity(EXPONENT, float(np.clip(slope, 0.1, 1.5)), *EXPONENTS, single=True)


def as_moduli(values: Mapping[str, Value], library: Any = np) -> dict[str, Value]:
    """Storage and loss from magnitude and phase, where there are some; `library` has cos and sin of such values.

    >>> {name: float(round(value, 6)) for name, value in as_moduli({"magnitude": 2.0, "phase": np.pi / 6}).items()}
    {'storage': 1.732051, 'loss': 1.0}
    """
    if "magnitude" not in values:
        return dict(values)
    rest: dict[str, Any] = dict(values)
    size, phase = rest.pop("magnitude"), rest.pop("phase")
    return {"storage": size * library.cos(phase), "loss": size * library.sin(phase), **rest}


def as_polar(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Values with the magnitude and phase of storage and loss beside them, where there are some."""
    if "storage" not in values:
        return dict(values)
    modulus = values["storage"] + 1j * values["loss"]
    return {**values, "magnitude": np.abs(modulus), "phase": np.angle(modulus)}


def _start(data: WaveData) -> tuple[float, float]:
    """Storage and loss modulus (Pa) that waves suggest."""
    modulus = uniform_modulus(data).value
    check_frequency(data, abs(modulus))
    return modulus.real, max(modulus.imag, LOSSY * modulus.real)
