"""Laws by name: what a scene's file or a command may ask for, with the parameters of each, their units and bounds.

A law of one's own takes a class (see `ngbrain.materials.base.Law`) and one line, such as

    REGISTRY["LopezPamies"] = LawEntry(LopezPamies, (MU, Parameter("a", low=0.1, high=20.0)))

>>> [parameter.key for parameter in REGISTRY["Gent"].parameters]
['mu_Pa', 'jm']
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from ngbrain.errors import InputError, nearest
from ngbrain.materials.base import Law
from ngbrain.materials.isotropic import Demiray, Gent, MooneyRivlin, NeoHooke, Ogden, UnsplitNeoHooke, Yeoh

Number = float | tuple[float, ...]


@dataclass(frozen=True)
class Parameter:
    """A parameter of a law.

    Parameters
    ----------
    name : str
        As the law's class has it.
    unit : str
        "Pa", or "" of a pure number.
    low, high : float
        What it lies between, ends included.
    default : float, optional
        Without one it has to be given.
    several : bool
        Whether there may be a list of them, a term each.
    """

    name: str
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    default: float | None = None
    several: bool = False

    @property
    def key(self) -> str:
        """With its unit, as a file has it."""
        return f"{self.name}_{self.unit}" if self.unit else self.name

    @property
    def wanted(self) -> str:
        """What is accepted, in words."""
        unit = f" in {self.unit}" if self.unit else ""
        many = ", or a list of them" if self.several else ""
        return f"a number{unit} from {self.low:g} to {self.high:g}{many}"

    def read(self, raw: Any, path: str) -> Number:
        """The value; `InputError` for one that is none."""
        many = isinstance(raw, list | tuple)
        values = raw if many else [raw]
        numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
        if not values or (many and not self.several) or not numbers or not all(map(self._fits, values)):
            raise InputError(f"{path}.{self.key}", repr(raw), self.wanted)
        return tuple(map(float, values)) if many else float(raw)

    def _fits(self, value: float) -> bool:
        return self.low <= value <= self.high


@dataclass(frozen=True)
class LawEntry:
    """A law that has a name: what makes it of its parameters."""

    make: Callable[..., Law]
    parameters: tuple[Parameter, ...]

    @property
    def about(self) -> str:
        """The first line of what its class says of itself."""
        return (inspect.getdoc(self.make) or "").partition("\n")[0]


MU = Parameter("mu", "Pa", 1e-3, 1e9)
REGISTRY: dict[str, LawEntry] = {
    "NeoHooke": LawEntry(NeoHooke, (MU,)),
    "UnsplitNeoHooke": LawEntry(UnsplitNeoHooke, (MU,)),
    "MooneyRivlin": LawEntry(MooneyRivlin, (Parameter("c10", "Pa", -1e9, 1e9), Parameter("c01", "Pa", -1e9, 1e9))),
    "Yeoh": LawEntry(
        Yeoh,
        (
            Parameter("c1", "Pa", 1e-3, 1e9),
            Parameter("c2", "Pa", -1e9, 1e9, default=0.0),
            Parameter("c3", "Pa", -1e9, 1e9, default=0.0),
        ),
    ),
    "Gent": LawEntry(Gent, (MU, Parameter("jm", "", 1e-3, 1e6))),
    "Demiray": LawEntry(Demiray, (MU, Parameter("b", "", 1e-6, 1e3))),
    "Ogden": LawEntry(
        Ogden,
        (Parameter("mu", "Pa", -1e9, 1e9, several=True), Parameter("alpha", "", -1e3, 1e3, several=True)),
    ),
}
"""Name → law; `ngbrain materials --laws` lists them."""


@dataclass(frozen=True)
class NamedLaw:
    """A law by its name in the registry, with its parameters' values (SI).

    Parameters
    ----------
    name : str
        One of `REGISTRY`.
    values : tuple of (str, number or tuple)
        The parameters given, in the order of the registry.

    Examples
    --------
    >>> NamedLaw.read({"name": "Gent", "mu_Pa": 900.0, "jm": 0.5}).law()
    Gent(mu=900.0, jm=0.5)
    """

    name: str
    values: tuple[tuple[str, Number], ...]

    @classmethod
    def read(cls, data: Mapping[str, Any], path: str = "material") -> NamedLaw:
        """From a table of a file: `name`, and the law's parameters with the unit in the key.

        Raises `InputError` for a name that is none, a parameter that is missing, unknown or out of its bounds, and for values that
        the law itself refuses.
        """
        name = data.get("name")
        if not isinstance(name, str) or name not in REGISTRY:
            found = "missing" if name is None else repr(name)
            raise InputError(f"{path}.name", found, nearest(str(name or ""), list(REGISTRY)))
        entry = REGISTRY[name]
        known = {parameter.key: parameter for parameter in entry.parameters}
        if unknown := [key for key in data if key != "name" and key not in known]:
            raise InputError(f"{path}.{unknown[0]}", "not a known key", nearest(unknown[0], list(known)))
        values = []
        for key, parameter in known.items():
            if key in data:
                values.append((parameter.name, parameter.read(data[key], path)))
            elif parameter.default is None:
                raise InputError(f"{path}.{key}", "missing", parameter.wanted)
        made = cls(name, tuple(values))
        made.law()
        return made

    def law(self) -> Law:
        """The law."""
        return REGISTRY[self.name].make(**{name: list(v) if isinstance(v, tuple) else v for name, v in self.values})

    def to_dict(self) -> dict[str, Any]:
        """As a file has it."""
        keys = {parameter.name: parameter.key for parameter in REGISTRY[self.name].parameters}
        shown = {keys[name]: list(v) if isinstance(v, tuple) else v for name, v in self.values}
        return {"name": self.name, **shown}
