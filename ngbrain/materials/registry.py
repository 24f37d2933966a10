"""Laws by name: what a scene's file or a command may ask for, with the parameters of each, their units and bounds.

A law of one's own takes a class (see `ngbrain.materials.base.Law`) that says its `initial_modulus`, and one line, such as

    REGISTRY["LopezPamies"] = LawEntry(LopezPamies, (MU, Parameter("a", low=0.1, high=20.0)))

in a Python file for `--laws` (`register`), or no line at all: a scene's `path = "my_laws.py:LopezPamies"` then takes the
arguments of the class. `ngbrain.materials.admission` is what it has to pass. The file is run, so a scene that a run wrote may
not ask for it.

>>> [parameter.key for parameter in REGISTRY["Gent"].parameters]
['mu_Pa', 'jm']
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
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
    """A law that has a name: what makes it of its parameters, and of a user's own `FILE.py:CLASS` or `package.module:CLASS`."""

    make: Callable[..., Law]
    parameters: tuple[Parameter, ...]
    source: str = ""

    @property
    def is_user_defined(self) -> bool:
        """Whether it is none of the package."""
        return not self.make.__module__.startswith("ngbrain.")

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


RESULT = "result.json"
"""What says that a folder has results in it."""
WHERE = "FILE.py:CLASS, or package.module:CLASS"
_loaded: dict[str, dict[str, LawEntry]] = {}
"""Files and modules that were run → their laws."""
_given: ContextVar[str] = ContextVar("given", default="a scene that is not read from a file")
"""Why a scene may not name a file to be run; nothing where it may."""


@contextmanager
def reading(file: str | Path) -> Iterator[None]:
    """A user's own file is read, which may name a file of laws; one beside a result.json may not, as a run wrote it."""
    folders = {Path(file).parent, Path(file).resolve().parent}
    of_results = [folder for folder in folders if (folder / RESULT).exists()]
    token = _given.set(f"a scene beside {of_results[0] / RESULT}" if of_results else "")
    try:
        yield
    finally:
        _given.reset(token)


def register(where: str | Path) -> list[str]:
    """Give the laws of a Python file, or of a module that can be imported, their names in `REGISTRY`; it is run.

    Parameters
    ----------
    where : str or Path
        The file, or the module's name. Every class in it that has an `energy` is a law under its name, with the arguments of the
        class or the `Parameter`s that its `parameters` lists; so is what the file itself puts into `REGISTRY`.

    Returns
    -------
    list of str
        Their names.

    Raises
    ------
    InputError
        It cannot be run, has no law, or has a name that is taken.

    Examples
    --------
    >>> register("ngbrain.materials.linear")
    Traceback (most recent call last):
    ngbrain.errors.InputError: --laws is 'ngbrain.materials.linear', which is the package's own; wanted: laws of your own
    """
    place = _place(str(where))
    if place.split(".")[0] == "ngbrain":
        raise InputError("--laws", f"{str(where)!r}, which is the package's own", "laws of your own")
    found = laws_of(place, "--laws")
    if not found:
        raise InputError("--laws", f"{where}, without a law", "a file with a class that has `energy(C)`")
    for name, entry in found.items():
        if name in REGISTRY and REGISTRY[name].source != entry.source:
            raise InputError("--laws", f"{where}, with another {name!r}", "a name that no other law has")
    REGISTRY.update(found)
    return list(found)


def _place(where: str) -> str:
    """A file's whole path, a module's name as it is."""
    return str(Path(where).resolve()) if where.endswith(".py") else where


def laws_of(place: str, path: str) -> dict[str, LawEntry]:
    """The laws of a file or module, which is run once."""
    if place not in _loaded:
        before = dict(REGISTRY)
        try:
            module = _run(place, path)
            lines = {name: entry for name, entry in REGISTRY.items() if before.get(name) is not entry}
        finally:
            REGISTRY.clear()
            REGISTRY.update(before)
        if taken := [name for name in lines if name in before]:
            raise InputError(path, f"{place}, with another {taken[0]!r}", "a name that no other law has")
        made = {entry.make for entry in lines.values()}
        classes = {
            name: LawEntry(each, _arguments(each, path))
            for name, each in vars(module).items()
            if isinstance(each, type) and callable(getattr(each, "energy", None)) and each not in made
            if each.__module__ == module.__name__
        }
        _loaded[place] = {name: replace(each, source=f"{place}:{name}") for name, each in (lines | classes).items()}
    return _loaded[place]


def _run(place: str, path: str) -> ModuleType:
    """The module; whatever goes wrong in it is an `InputError`."""
    try:
        if not place.endswith(".py"):
            return importlib.import_module(place)
        if not Path(place).is_file():
            raise InputError(path, f"{place}, where no file is", "a Python file with a law in it")
        name = f"ngbrain_own_laws_{len(_loaded)}_{Path(place).stem}"
        spec = importlib.util.spec_from_file_location(name, place)
        assert spec is not None and spec.loader is not None
        module = sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module
    except InputError:
        raise
    except (Exception, SystemExit) as error:
        raise InputError(path, f"{place}, which ends in {describe_error(error)}", "a file that can be run") from None


def _arguments(make: type, path: str) -> tuple[Parameter, ...]:
    """What a class says of its parameters, or the arguments that it takes."""
    declared = getattr(make, "parameters", None)
    if isinstance(declared, tuple) and all(isinstance(each, Parameter) for each in declared):
        return declared
    if declared is not None:
        raise InputError(path, f"{make.__name__}.parameters = {declared!r}", "a tuple of `Parameter`s")
    found = []
    for name, argument in inspect.signature(make).parameters.items():
        default = argument.default if isinstance(argument.default, int | float) else None
        if argument.default is argument.empty or default is not None:
            found.append(Parameter(name, default=default))
    return tuple(found)


def describe_error(error: BaseException) -> str:
    """What went wrong in code of a user's, in a line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def entry_at(source: str, path: str) -> LawEntry:
    """A user's own law by its place; `InputError` unless that was run already, or the file that names it may have it run."""
    where, _, name = source.rpartition(":")
    if not where or not name.isidentifier():
        raise InputError(f"{path}.path", repr(source), WHERE)
    place = _place(where)
    if place not in _loaded and (why := _given.get()):
        wanted = "no code to be run: give the file by --laws (in Python: ngbrain.materials.registry.register), or move the scene"
        raise InputError(f"{path}.path", f"{source!r}, in {why}", wanted)
    laws = laws_of(place, f"{path}.path")
    if name not in laws and not place.endswith(".py"):  # a class that the module has from elsewhere
        made = getattr(sys.modules[place], name, None)
        if isinstance(made, type) and callable(getattr(made, "energy", None)):
            laws[name] = LawEntry(made, _arguments(made, f"{path}.path"), f"{place}:{name}")
    if name not in laws:
        raise InputError(f"{path}.path", repr(source), f"a class with `energy(C)` in it, {nearest(name, list(laws))}")
    return laws[name]
