"""Laws as scenes state them: by registry name or by the path of a user-defined law, with parameter values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from ngbrain.errors import InputError, nearest
from ngbrain.materials import admission
from ngbrain.materials.base import Law
from ngbrain.materials.maxwell import Maxwell
from ngbrain.materials.registry import (
    REGISTRY,
    LawEntry,
    Number,
    Parameter,
    describe_error,
    entry_at,
    laws_of,
    register,
)

ETA = Parameter("eta", "Pa_s", 1e-6, 1e12)
"""Viscosity of a branch, whatever its law."""


def from_folder(material: Any, folder: Path) -> Any:
    """Resolve the relative path of a user-defined law against the folder of the file that names it.

    Parameters
    ----------
    material : object
        Table of a material, or a list of them.
    folder : pathlib.Path
        Folder of the file.

    Returns
    -------
    object
        The same with resolved paths.
    """
    if isinstance(material, list):
        return [from_folder(each, folder) for each in material]
    source = material.get("path") if isinstance(material, dict) else None
    where = source.rpartition(":")[0] if isinstance(source, str) else ""
    return {**material, "path": str(folder / str(source))} if where.endswith(".py") else material


@dataclass(frozen=True)
class NamedLaw:
    """A law by its name in the registry, or by its path, with its parameter values (SI).

    Parameters
    ----------
    name : str
        A key of `REGISTRY`, FILE.py:CLASS or package.module:CLASS.
    values : tuple of (str, float or tuple of float)
        Parameter names and values, in the order of the registry.

    Examples
    --------
    >>> NamedLaw.read({"name": "Gent", "mu_Pa": 900.0, "jm": 0.5}).law()
    Gent(mu=900.0, jm=0.5)
    """

    name: str
    values: tuple[tuple[str, Number], ...]

    @classmethod
    def read(cls, data: Mapping[str, Any], path: str = "material") -> NamedLaw:
        """Read a law from a table: `name`, or the `path` of a user-defined law, and its parameters with the unit in the key.

        Parameters
        ----------
        data : dict of str to object
            The table.
        path : str, default 'material'
            Position of the table in the file, for messages.

        Returns
        -------
        NamedLaw
            The law.

        Raises
        ------
        InputError
            An unknown name, a file that may not be run, a parameter that is missing, unknown or out of its bounds,
            values that the law itself refuses, or a user-defined law that is not admitted.
        """
        name, source = data.get("name"), data.get("path")
        if source is not None and name is not None:
            raise InputError(f"{path}.path", repr(source), "this key or name, not both")
        if source is not None:
            entry = entry_at(str(source), path)
            name = entry.source
        elif not isinstance(name, str) or name not in REGISTRY:
            found = "missing" if name is None else repr(name)
            raise InputError(f"{path}.name", found, nearest(str(name or ""), list(REGISTRY)))
        else:
            entry = REGISTRY[name]
        known = {parameter.key: parameter for parameter in entry.parameters}
        if unknown := [key for key in data if key not in ("name", "path") and key not in known]:
            raise InputError(f"{path}.{unknown[0]}", "not a known key", nearest(unknown[0], list(known)))
        values = []
        for key, parameter in known.items():
            if key in data:
                values.append((parameter.name, parameter.read(data[key], path)))
            elif parameter.default is None:
                raise InputError(f"{path}.{key}", "missing", parameter.wanted)
        made = cls(str(name), tuple(values))
        if not entry.is_user_defined:
            made.law()
            return made
        try:
            _admitted(made)
        except InputError as error:
            raise InputError(f"{path}: {error.field}", error.value, error.wanted) from None
        return made

    @property
    def entry(self) -> LawEntry:
        """Entry of the registry, or of the file that was run."""
        return entry_at(self.name, "material") if ":" in self.name else REGISTRY[self.name]

    def law(self) -> Law:
        """The law."""
        return self.entry.make(**{name: list(v) if isinstance(v, tuple) else v for name, v in self.values})

    @property
    def cautions(self) -> list[str]:
        """Warnings: where a user-defined law is not elliptic or has no finite energy."""
        return list(_admitted(self)) if self.entry.is_user_defined else []

    def to_dict(self) -> dict[str, Any]:
        """The table, as a file states it."""
        keys = {parameter.name: parameter.key for parameter in self.entry.parameters}
        shown = {keys[name]: list(v) if isinstance(v, tuple) else v for name, v in self.values}
        return {"path" if ":" in self.name else "name": self.name, **shown}

    def __reduce__(self) -> tuple[Any, ...]:  # another process has to execute the file too
        return _restored, (self.name, self.values, self.entry.source)


@dataclass(frozen=True)
class NamedBranch:
    """A Maxwell branch: a law by its name or path, and a viscosity.

    Parameters
    ----------
    named : NamedLaw
        Law of the spring, isotropic.
    eta : float
        Viscosity η (Pa s); the relaxation time at small strain is η/μ.

    Examples
    --------
    >>> NamedBranch.read({"name": "Gent", "mu_Pa": 900.0, "jm": 0.5, "eta_Pa_s": 1800.0}).branch().tau
    2.0
    """

    named: NamedLaw
    eta: float

    @classmethod
    def read(cls, data: Mapping[str, Any], path: str = "maxwell") -> NamedBranch:
        """Read a branch from a table: that of a law, and `eta_Pa_s`.

        Parameters
        ----------
        data : dict of str to object
            The table.
        path : str, default 'maxwell'
            Position of the table in the file, for messages.

        Returns
        -------
        NamedBranch
            The branch.

        Raises
        ------
        InputError
            What `NamedLaw.read` refuses, no viscosity, or a law that cannot be a branch.
        """
        if ETA.key not in data:
            raise InputError(f"{path}.{ETA.key}", "missing", ETA.wanted)
        named = NamedLaw.read({key: value for key, value in data.items() if key != ETA.key}, path)
        made = cls(named, float(ETA.read(data[ETA.key], path)))  # type: ignore[arg-type]
        try:
            made.branch()
        except InputError as error:
            raise InputError(path, named.name, error.wanted) from None
        return made

    def branch(self) -> Maxwell:
        """The branch."""
        return Maxwell(self.named.law(), self.eta)

    def to_dict(self) -> dict[str, Any]:
        """The table, as a file states it."""
        return {**self.named.to_dict(), ETA.key: self.eta}


def _restored(name: str, values: tuple[tuple[str, Number], ...], source: str) -> NamedLaw:
    place = source.rpartition(":")[0]
    if place and ":" in name:
        laws_of(place, "material.path")
    elif place:
        register(place)
    return NamedLaw(name, values)


@lru_cache(maxsize=256)
def _admitted(named: NamedLaw) -> tuple[str, ...]:
    """Warnings about a user-defined law; `InputError` where it is not admitted."""
    name = named.name.rpartition(":")[2]
    try:
        law = named.law()
    except InputError:
        raise
    except Exception as error:
        raise InputError(
            name, f"a class that raises {describe_error(error)}", "one that takes these parameters"
        ) from None
    return tuple(admission.admit(law, name))
