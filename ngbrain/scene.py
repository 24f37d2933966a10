# ruff: noqa: RUF009  (what the calls in class bodies return is a dataclasses.field)
"""A scene as plain data: what is operated on, with what, how, and how finely it is computed.

SI units inside; in TOML the unit is the end of the key (`width_mm`, `ramp_s`, `mu_Pa`). Each field says once how it
stands in TOML (`Entry`); reading, writing, checking and messages follow from that, for files and for Python alike.
"""

from __future__ import annotations

import json
import math
import re
import reprlib
import tomllib
import warnings
from collections.abc import Callable, Collection
from dataclasses import MISSING, Field, dataclass, field, fields, replace
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

from ngbrain.errors import InputError, nearest
from ngbrain.materials import CATALOGUE, NeoHooke, OgdenBranches, Viscous, constants

UNITS = {"mm": (1000, "length in mm"), "Pa_s": (1, "viscosity"), "Pa": (1, "modulus in Pa"), "s": (1, "time in s")}
"""End of a key → how many of the unit are one SI unit (whole: then SI → unit → SI settles at once), and in words."""
MOST = 1000  # holds or stages of a protocol


@dataclass(frozen=True)
class Entry:
    """How a field stands in TOML: what is accepted under which key, how many of its unit are one SI (0: not a number).

    `size` is 1, the length of a list, or 0 for a list of any length but zero (a single value is one too).
    """

    key: str
    wanted: str
    accept: Callable[[Any], Any]
    per_si: int = 0
    size: int = 1
    table: type[Section] | None = None

    def read(self, raw: Any, path: str) -> Any:
        """From TOML to SI (lists to tuples), or an `InputError` that names the path."""
        values = raw if isinstance(raw, list) and self.size != 1 else [raw]
        if not values or len(values) != (self.size or len(values)) or not all(map(self.accept, values)):
            raise InputError(path, _brief(raw), self.wanted)
        if self.table:
            values = [_read(self.table, v, path if self.size else f"{path}#{i}") for i, v in enumerate(values, 1)]
        values = [v / self.per_si if self.per_si else v for v in values]
        return values[0] if self.size == 1 else tuple(values)

    def show(self, value: Any) -> Any:
        """From SI to TOML, NumPy's numbers and arrays too; what has no place in TOML stays as it is."""
        value = value.tolist() if hasattr(value, "tolist") else value
        if isinstance(value, (list, tuple)):
            return [self.show(item) for item in value]
        if isinstance(value, Section):
            return value.to_dict()
        if not self.per_si or not _is_number(value):
            return value
        short = float(f"{value * self.per_si:.15g}")
        return short if short / self.per_si == value else value * self.per_si


def _is_number(raw: Any, kind: Any = (int, float)) -> bool:
    return isinstance(raw, kind) and not isinstance(raw, bool) and abs(raw) <= 1e300  # not so for nan


def _field(entry: Entry, default: Any) -> Any:
    make: dict[str, Any] = {"default_factory" if callable(default) else "default": default}
    return field(metadata={"entry": entry}, **make)


def _number(key: str, default: Any = MISSING, least: float | None = None, signed: bool = False, size: int = 1) -> Any:
    """A number in the key's unit that is > 0, or ≥ `least`, or any (`signed`); for `size` see `Entry`."""
    per_si, noun = next((value for unit, value in UNITS.items() if key.endswith(f"_{unit}")), (1, "number"))
    wanted = f"a {noun}" + ("" if signed else " greater than 0" if least is None else f" of at least {least:g}")
    wanted += {0: ", or a list of them", 1: ""}.get(size, f" in each of {size} places")

    def accept(raw: Any) -> bool:
        return _is_number(raw) and (signed or (raw > 0 if least is None else raw >= least))

    return _field(Entry(key, wanted, accept, per_si, size), default)


def _whole(key: str, default: Any, low: int, high: int) -> Any:
    wanted = f"a whole number from {low} to {high}"
    return _field(Entry(key, wanted, lambda raw: _is_number(raw, int) and low <= raw <= high), default)


def _text(key: str, default: Any, wanted: str, accept: Callable[[str], Any]) -> Any:
    return _field(Entry(key, wanted, lambda raw: isinstance(raw, str) and raw.isprintable() and accept(raw)), default)


def _choice(key: str, default: Any, choices: Collection[str]) -> Any:
    return _text(key, default, "one of " + ", ".join(choices), choices.__contains__)


def _pattern(key: str, default: Any = MISSING) -> Any:
    def accept(raw: str) -> Any:
        try:
            with warnings.catch_warnings(action="ignore"):
                return raw.strip() and re.compile(raw)
        except (re.error, OverflowError, RecursionError):
            return False

    return _text(key, default, "a name or a regular expression", accept)


def _table(cls: type[Section], default: Any = MISSING, size: int = 1) -> Any:
    key = cls.__name__.lower()
    wanted = f"a table [{key}]" if size else f"one or more tables [[{key}]]"
    return _field(Entry(key, wanted, lambda raw: True, 0, size, cls), default)


class Section:
    """What all parts share: a part's fields are checked when it is made, what is between fields when a scene is."""

    def __post_init__(self) -> None:
        section = f"{type(self).__name__.lower()}.".removeprefix("scene.")
        for name, f in _fields(self).items():
            entry, shown = f.metadata["entry"], self.shown(name)
            if shown is not None or f.default is not None:
                object.__setattr__(self, name, entry.read(shown, section + entry.key))

    def shown(self, name: str) -> Any:
        """A field's value as TOML has it, in the unit of its key; None where it is not given."""
        return _fields(self)[name].metadata["entry"].show(getattr(self, name))

    def to_dict(self) -> dict[str, Any]:
        """In TOML's keys and units, fit for JSON; `Scene.from_dict` gives the same scene back."""
        values = {f.metadata["entry"].key: self.shown(name) for name, f in _fields(self).items()}
        return {key: value for key, value in values.items() if value is not None}

    def _need(self, ok: Any, path: str, name: str, wanted: str) -> None:
        if not ok:
            raise InputError(f"{path}.{_fields(self)[name].metadata['entry'].key}", _brief(self.shown(name)), wanted)

    def _check(self, path: str, scene: Scene) -> None:
        pass  # what is wrong between fields, of this part and others


def _fields(part: Any) -> dict[str, Field[Any]]:
    return {f.name: f for f in fields(part)}


def _read(cls: type[Section], data: Any, path: str) -> Any:
    if not isinstance(data, dict):
        raise InputError(path or "scene", _brief(data), "a table of keys and values")
    known, path = {f.metadata["entry"].key: f for f in fields(cls)}, path and f"{path}."  # type: ignore[arg-type]
    for key in data:
        if key not in known:
            shown = key if re.fullmatch(r"[\w-]{1,60}", str(key)) else _brief(key)
            raise InputError(f"{path}{shown}", "not a known key", nearest(str(key), known))
    for key, f in known.items():
        if key not in data and f.default is MISSING and f.default_factory is MISSING:
            raise InputError(f"{path}{key}", "missing", f.metadata["entry"].wanted)
    return cls(**{f.name: f.metadata["entry"].read(data[key], path + key) for key, f in known.items() if key in data})


def _brief(value: Any) -> str:
    try:
        return "missing" if value is None else " ".join(reprlib.repr(value).split())
    except ValueError:  # Python refuses to print whole numbers of thousands of digits
        return "a number of thousands of digits"


@dataclass(frozen=True, kw_only=True)
class Body(Section):
    """The head: its shape; element sizes (m) on the cleft, under the craniotomy and elsewhere; polynomial order."""

    head: str = _choice("head", "idealised", ["idealised"])
    site: float = _number("site_mm", 2e-3)
    near: float = _number("near_mm", 6e-3)
    far: float = _number("far_mm", 20e-3)
    order: int = _whole("order", 2, 2, 4)

    def _check(self, path: str, scene: Scene) -> None:
        self._need(self.near >= self.site, path, "near", f"at least {self.shown('site'):g}, body.site_mm")
        self._need(self.far >= self.near, path, "far", f"at least {self.shown('near'):g}, body.near_mm")


@dataclass(frozen=True, kw_only=True)
class Tissue(Section):
    """What the regions that match a pattern are made of, by `constants` or by `mu`.

    constants    name in the catalogue
    mu           shear moduli (Pa): one alone is Neo-Hooke, not relaxing; else first the part that stays, then branches
    alpha        as many Ogden exponents
    eta          viscosities (Pa s) of the branches, one fewer
    bulk_ratio   bulk modulus / initial shear modulus
    """

    region: str = _pattern("region")
    constants: str | None = _choice("constants", None, CATALOGUE)
    mu: tuple[float, ...] | None = _number("mu_Pa", None, size=0)
    alpha: tuple[float, ...] | None = _number("alpha", None, signed=True, size=0)
    eta: tuple[float, ...] | None = _number("eta_Pa_s", None, size=0)
    bulk_ratio: float = _number("bulk_ratio", 1000.0)

    def _check(self, path: str, scene: Scene) -> None:
        mu, alpha, eta = self.mu or (), self.alpha or (), self.eta or ()
        for name, values in (("mu", mu), ("alpha", alpha), ("eta", eta)):
            self._need(not (self.constants and values), path, name, "this key or constants, not both")
        if not self.constants:
            self._need(mu or alpha or eta, path, "constants", "constants, a name in the catalogue, or mu_Pa")
            self._need(mu, path, "mu", "moduli to go with alpha and eta_Pa_s")
            fits = len(alpha) == len(mu) or len(mu) == 1 > len(alpha)
            self._need(fits and all(alpha), path, "alpha", f"as many values as mu_Pa, {len(mu)}, none of them 0")
            self._need(len(eta) == len(mu) - 1, path, "eta", f"one value fewer than mu_Pa: {len(mu) - 1}")
        self._need(math.isfinite(self.bulk), path, "bulk_ratio", "one that, times mu_Pa, is a finite bulk modulus")

    @property
    def _constants(self) -> OgdenBranches:
        if self.constants:
            return constants(self.constants)
        return OgdenBranches(self.mu or (), self.alpha or (), self.eta or (), "the scene", math.nan)

    def law(self) -> Viscous | NeoHooke:
        """The law of shape."""
        return self._constants.law() if self._constants.alpha else NeoHooke(self.initial_modulus)

    @property
    def initial_modulus(self) -> float:
        """Shear modulus (Pa) of an instantaneous small strain."""
        return self._constants.initial_modulus

    @property
    def bulk(self) -> float:
        """Bulk modulus K (Pa)."""
        return self.bulk_ratio * self.initial_modulus

    @property
    def fitted_strain(self) -> float | None:
        """Largest stretch change (|λ - 1|) of the data behind the catalogue's constants; None for other tissues."""
        return self._constants.fitted_strain if self.constants else None

    def with_alpha(self, alpha: float) -> Tissue:
        """The same moduli and times with every Ogden exponent replaced; a Neo-Hooke tissue has none and stays."""
        return self._explicit(1.0, (alpha,) * len(self._constants.alpha))

    def scaled(self, factor: float) -> Tissue:
        """Moduli and viscosities times `factor`, so that times stay; such constants are no longer the catalogue's."""
        return self._explicit(factor, self._constants.alpha)

    def _explicit(self, factor: float, alpha: tuple[float, ...]) -> Tissue:
        mu, eta = (tuple(factor * value for value in values) for values in (self._constants.mu, self._constants.eta))
        return replace(self, constants=None, mu=mu, alpha=alpha or None, eta=eta or None)


@dataclass(frozen=True, kw_only=True)
class Support(Section):
    """Pattern of the boundaries that are held."""

    fixed: str = _pattern("fixed", "skull")


@dataclass(frozen=True, kw_only=True)
class Cleft(Section):
    """The opening: centre of its floor (m), size along (`width`) and between its walls, diameter of the craniotomy (m).

    approach   direction from the target outwards; None: the shortest way
    across     direction from wall to wall; None: left to right
    """

    target: tuple[float, float, float] = _number("target_mm", signed=True, size=3)
    width: float = _number("width_mm", 12e-3)
    opening: float = _number("opening_mm", 4e-3)
    craniotomy: float = _number("craniotomy_mm", 40e-3)
    approach: tuple[float, float, float] | None = _number("approach", None, signed=True, size=3)
    across: tuple[float, float, float] | None = _number("across", None, signed=True, size=3)

    def _check(self, path: str, scene: Scene) -> None:
        diagonal = math.hypot(self.width, self.opening)
        wanted = f"more than {1e3 * diagonal:.4g}, the diagonal of cleft.width_mm by cleft.opening_mm"
        self._need(self.craniotomy > diagonal, path, "craniotomy", wanted)
        for name in ("approach", "across"):
            self._need(any(getattr(self, name) or (1,)), path, name, "a direction: not all 0")


@dataclass(frozen=True, kw_only=True)
class Blade(Section):
    """A flat spatula: width, rounding of its edges, height of its tip above the cleft's floor, thickness (m)."""

    width: float = _number("width_mm", 10e-3)
    edge_radius: float = _number("edge_radius_mm", 1e-3, least=1.0)
    tip: float = _number("tip_mm", 4e-3)
    thickness: float = _number("thickness_mm", 2e-3)

    def _check(self, path: str, scene: Scene) -> None:
        wanted = f"at most {scene.cleft.shown('width'):g}, cleft.width_mm: not a blade wider than the cleft"
        self._need(self.width <= scene.cleft.width, path, "width", wanted)
        wanted = f"at most {scene.cleft.shown('opening'):g}, cleft.opening_mm: not a blade thicker than the cleft"
        self._need(self.thickness <= scene.cleft.opening, path, "thickness", wanted)
        wanted = f"at least twice blade.edge_radius_mm = {self.shown('edge_radius'):g}"
        self._need(self.width >= 2 * self.edge_radius, path, "width", wanted)


@dataclass(frozen=True, kw_only=True)
class Retraction(Section):
    """What all protocols share: how far the blade goes from first contact (m), how long that takes, the end (s)."""

    opening: float = _number("opening_mm", 5e-3)
    ramp: float = _number("ramp_s", 10.0)
    elapsed: float = _number("elapsed_s", 900.0)

    def _check(self, path: str, scene: Scene) -> None:
        self._need(self.elapsed > self.ramp, path, "elapsed", f"more than {self.ramp:g}, retraction.ramp_s")


@dataclass(frozen=True, kw_only=True)
class Protocol(Section):
    """How the blade is driven; `name` is `kind` unless given. The fields of other kinds are None.

    continuous     open, hold
    intermittent   open, hold for `hold` s, let go, open again `rest` s after letting go, …
    staged         open in `stages` equal steps with `rest` s between them, hold
    program        the blade's way (m) `opening` from first contact at `times` (s), straight in between
    """

    KINDS: ClassVar = {"continuous": (), "intermittent": ("hold", "rest"), "staged": ("stages", "rest")}
    KINDS["program"] = ("times", "opening")

    kind: str = _choice("kind", MISSING, KINDS)
    name: str = _text("name", "", "letters, digits, spaces and . + - _", re.compile(r"\w[\w .+-]*").fullmatch)
    hold: float = _number("hold_s", None)
    rest: float = _number("rest_s", None)
    stages: int = _whole("stages", None, 2, MOST)
    times: tuple[float, ...] = _number("t_s", None, least=0.0, size=0)
    opening: tuple[float, ...] = _number("opening_mm", None, signed=True, size=0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", self.kind if self.name == "" else self.name)
        super().__post_init__()

    def _check(self, path: str, scene: Scene) -> None:
        own = self.KINDS[self.kind]
        keys = ", ".join(f.metadata["entry"].key for name, f in _fields(self).items() if name in ("kind", "name", *own))
        for name in ("hold", "rest", "stages", "times", "opening"):
            wanted = f"{'a value' if name in own else 'this key left out'}: kind {self.kind!r} has {keys}"
            self._need((getattr(self, name) is not None) == (name in own), path, name, wanted)
        ramp, end = scene.retraction.ramp, scene.retraction.elapsed
        shared = f"retraction.ramp_s = {ramp:g} and retraction.elapsed_s = {end:g}"
        if self.kind == "intermittent":
            cycle = ramp + self.hold + self.rest
            n = math.ceil(min(max((end * (1 - 1e-12) - ramp - self.hold) / cycle, 0), MOST))  # holds before the last
            wanted = (
                f"holds of which one, of at most {MOST}, is under way at the end, for rest_s = {self.rest:g}, {shared}"
            )
            exact = (end - n * ramp - (n - 1) * self.rest) / max(n, 1)
            wanted += f"; such as {exact:.6g}" if n < MOST else ""
            self._need(n < MOST and n * cycle + ramp < end, path, "hold", wanted)
        if self.kind == "staged":
            in_time = ramp + (self.stages - 1) * self.rest < end
            self._need(in_time, path, "rest", f"short enough for stages = {self.stages} with {shared}")
        if self.kind == "program":
            rising = self.times[0] == 0 and all(a < b for a, b in pairwise(self.times))
            wanted = f"times that start at 0, increase, and end at retraction.elapsed_s = {end:g}"
            self._need(rising and math.isclose(self.times[-1], end), path, "times", wanted)
            wanted = f"{len(self.times)} values, as many as t_s; the first 0, or less (clear of tissue), some greater"
            fits = len(self.opening) == len(self.times) and self.opening[0] <= 0 < max(self.opening)
            self._need(fits, path, "opening", wanted)


@dataclass(frozen=True, kw_only=True)
class Steps(Section):
    """Longest time step (s) while the blade pushes and while it rests."""

    contact: float = _number("contact_s", 1.0)
    longest: float = _number("longest_s", 60.0)


def _protocols() -> tuple[Protocol, ...]:
    staged = Protocol(kind="staged", stages=5, rest=30.0)
    return Protocol(kind="continuous"), Protocol(kind="intermittent", hold=230.0, rest=90.0), staged


@dataclass(frozen=True, kw_only=True)
class Scene(Section):
    """One operation on one head. Whatever is wrong with one raises `InputError`.

    >>> scene = Scene.shipped("demo")
    >>> scene.blade.width, scene.to_dict()["blade"]["width_mm"], [p.name for p in scene.protocols]
    (0.01, 10.0, ['continuous', 'intermittent', 'staged'])
    """

    title: str = _text("title", "", "one line of text", lambda raw: True)
    body: Body = _table(Body, Body)
    tissues: tuple[Tissue, ...] = _table(Tissue, size=0)
    support: Support = _table(Support, Support)
    cleft: Cleft = _table(Cleft)
    blade: Blade = _table(Blade, Blade)
    retraction: Retraction = _table(Retraction, Retraction)
    protocols: tuple[Protocol, ...] = _table(Protocol, _protocols, size=0)
    steps: Steps = _table(Steps, Steps)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, f in _fields(self).items():
            many, parts = f.metadata["entry"].size == 0, getattr(self, name)
            for i, part in enumerate(parts if many else [parts] if name != "title" else [], 1):
                part._check(f"{f.metadata['entry'].key}#{i}" if many else f.metadata["entry"].key, self)
        for key, name, parts in (("tissue", "region", self.tissues), ("protocol", "name", self.protocols)):
            names = [getattr(part, name) for part in parts]
            for i, part in enumerate(parts):
                part._need(names[i] not in names[:i], f"{key}#{i + 1}", name, "one that is not used before")

    @classmethod
    def from_dict(cls, data: Any, file: str | Path | None = None) -> Scene:
        """From TOML's keys and units; `file` is for messages."""
        try:
            return _read(cls, data, "")
        except InputError as error:
            raise InputError(error.field, error.value, error.wanted, file) from None

    @classmethod
    def from_toml(cls, path: str | Path) -> Scene:
        """From a file."""
        try:
            data = tomllib.loads(Path(path).read_bytes().decode("utf-8-sig"))
        except (OSError, ValueError, RecursionError) as error:
            why = " ".join(str(error).split())
            raise InputError("file", f"unreadable ({why})", "a scene in TOML", path) from None
        return cls.from_dict(data, path)

    @classmethod
    def shipped(cls, name: str) -> Scene:
        """One that comes with the package: "demo" or "demo_fast"."""
        files = {Path(file.name).stem: file for file in resources.files("ngbrain.scenes").iterdir()}
        known = [stem for stem, file in files.items() if file.name.endswith(".toml")]
        if name not in known:
            raise InputError("scene", _brief(name), nearest(str(name), known))
        with resources.as_file(files[name]) as path:
            return cls.from_toml(path)

    def to_toml(self) -> str:
        """As the text of a file; reading it gives the same scene back."""
        lines = []
        for key, value in ({"": {"title": self.title}} | self.to_dict()).items():
            for table in [] if key == "title" else value if isinstance(value, list) else [value]:
                lines += ["", f"[[{key}]]" if isinstance(value, list) else f"[{key}]"] if key else []
                lines += [f"{k} = {json.dumps(v, ensure_ascii=False)}" for k, v in table.items()]
        return "\n".join(lines) + "\n"
