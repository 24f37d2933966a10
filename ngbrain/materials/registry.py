"""Registry of laws by name, with parameters, units and bounds, for scene files and commands.

A user-defined law needs a class (see `ngbrain.materials.base.Law`) that states its `initial_modulus`, and one line,
such as

    REGISTRY["LopezPamies"] = LawEntry(LopezPamies, (MU, Parameter("a", low=0.1, high=20.0)))

in a Python file for `--laws` (`register`). Without such a line, `path = "my_laws.py:LopezPamies"` in a scene takes
the arguments of the class as parameters. `ngbrain.materials.admission` checks the law. The file is executed, so a
scene that a run has written may not name one.

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
        Name of the argument of the law's class.
    unit : str, default ''
        "Pa", or "" for a dimensionless parameter.
    low, high : float, default -math.inf
        Admissible range, ends included.
    default : float, optional
        Default value; without one the parameter is required.
    several : bool, default False
        Whether a list is admissible, one value per term.
    """

    name: str
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    default: float | None = None
    several: bool = False

    @property
    def key(self) -> str:
        """Key in a file: the name with its unit."""
        return f"{self.name}_{self.unit}" if self.unit else self.name

    @property
    def wanted(self) -> str:
        """Description of admissible values."""
        unit = f" in {self.unit}" if self.unit else ""
        many = ", or a list of them" if self.several else ""
        return f"a number{unit} from {self.low:g} to {self.high:g}{many}"

    def read(self, raw: Any, path: str) -> Number:
        """Check a value from a file.

        Parameters
        ----------
        raw : object
            Value as read.
        path : str
            Position of the table in the file, for messages.

        Returns
        -------
        Number
            The value, or a tuple of values.

        Raises
        ------
        InputError
            No number, out of range, or a list where one value is expected.
        """
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
    """Entry of the registry.

    Parameters
    ----------
    make : callable
        Class or function that makes the law from its parameters.
    parameters : tuple of Parameter
        The parameters.
    source : str, default ''
        `FILE.py:CLASS` or `package.module:CLASS` of a user-defined law, else "".
    """

    make: Callable[..., Law]
    parameters: tuple[Parameter, ...]
    source: str = ""

    @property
    def is_user_defined(self) -> bool:
        """Whether the law is not part of this package."""
        return not self.make.__module__.startswith("ngbrain.")

    @property
    def about(self) -> str:
        """First line of the docstring of its class."""
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
"""File whose presence marks a folder of results."""
WHERE = "FILE.py:CLASS, or package.module:CLASS"
_loaded: dict[str, dict[str, LawEntry]] = {}
"""Files and modules already executed → their laws."""
_given: ContextVar[str] = ContextVar("given", default="a scene that is not read from a file")
"""Why a scene may not name a file to be executed; empty where it may."""


@contextmanager
def reading(file: str | Path) -> Iterator[None]:
    """Context in which a user's own file is read, which may name a file of laws.

    A file beside a result.json may not, as a run has written it.
    """
    folders = {Path(file).parent, Path(file).resolve().parent}
    of_results = [folder for folder in folders if (folder / RESULT).exists()]
    token = _given.set(f"a scene beside {of_results[0] / RESULT}" if of_results else "")
    try:
        yield
    finally:
        _given.reset(token)


def register(where: str | Path) -> list[str]:
    """Execute a Python file or importable module and add its laws to `REGISTRY`.

    Parameters
    ----------
    where : str or pathlib.Path
        The file, or the name of the module. Every class with an `energy` is a law under its own name. Its
        parameters are the arguments of the class, or the `Parameter`s that its attribute `parameters` lists. What
        the file itself puts into `REGISTRY` is added too.

    Returns
    -------
    list of str
        The names of the laws.

    Raises
    ------
    InputError
        The file fails, has no law, or uses a name that is taken.

    Examples
    --------
    >>> register("ngbrain.materials.linear")
    Traceback (most recent call last):
    ngbrain.errors.InputError: --laws is 'ngbrain.materials.linear', a module of this package; wanted: user-defined laws
    """
    place = _place(str(where))
    if place.split(".")[0] == "ngbrain":
        raise InputError("--laws", f"{str(where)!r}, a module of this package", "user-defined laws")
    found = laws_of(place, "--laws")
    if not found:
        raise InputError("--laws", f"{where}, without a law", "a file with a class that has `energy(C)`")
    for name, entry in found.items():
        if name in REGISTRY and REGISTRY[name].source != entry.source:
            raise InputError("--laws", f"{where}, with another {name!r}", "a name that no other law has")
    REGISTRY.update(found)
    return list(found)


def _place(where: str) -> str:
    """Absolute path of a file; the name of a module unchanged."""
    return str(Path(where).resolve()) if where.endswith(".py") else where


def laws_of(place: str, path: str) -> dict[str, LawEntry]:
    """The laws of a file or module, which is executed once.

    Parameters
    ----------
    place : str
        Absolute path of the file, or name of the module.
    path : str
        Name of the field or option, for messages.

    Returns
    -------
    dict of str to LawEntry
        Laws by name.

    Raises
    ------
    InputError
        The file fails, or uses a name that is taken.
    """
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
    """Execute the module; every failure in it becomes an `InputError`."""
    try:
        if not place.endswith(".py"):
            return importlib.import_module(place)
        if not Path(place).is_file():
            raise InputError(path, f"{place}, which does not exist", "a Python file with a law in it")
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
    """Parameters that a class declares, or the arguments that it takes."""
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
    """One-line description of an error in user code."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def entry_at(source: str, path: str) -> LawEntry:
    """Entry of a user-defined law by its path.

    Parameters
    ----------
    source : str
        FILE.py:CLASS or package.module:CLASS.
    path : str
        Position of the table in the file, for messages.

    Returns
    -------
    LawEntry
        The entry.

    Raises
    ------
    InputError
        A malformed path, no such class, or a file that was not executed before and that this scene may not have
        executed.
    """
    where, _, name = source.rpartition(":")
    if not where or not name.isidentifier():
        raise InputError(f"{path}.path", repr(source), WHERE)
    place = _place(where)
    if place not in _loaded and (why := _given.get()):
        wanted = "no code to be run: give the file by --laws (in Python: ngbrain.materials.registry.register), or move the scene"
        raise InputError(f"{path}.path", f"{source!r}, in {why}", wanted)
    laws = laws_of(place, f"{path}.path")
    if name not in laws and not place.endswith(".py"):  # a class that the module imports
        made = getattr(sys.modules[place], name, None)
        if isinstance(made, type) and callable(getattr(made, "energy", None)):
            laws[name] = LawEntry(made, _arguments(made, f"{path}.path"), f"{place}:{name}")
    if name not in laws:
        raise InputError(f"{path}.path", repr(source), f"a class with `energy(C)` in it, {nearest(name, list(laws))}")
    return laws[name]
