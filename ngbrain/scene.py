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
from collections.abc import Callable, Iterable
from dataclasses import MISSING, Field, dataclass, field, fields, replace
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

from ngbrain.errors import InputError, nearest
from ngbrain.materials import CATALOGUE, NeoHooke, OgdenBranches, Viscous, constants

UNITS = {
    "mm": (1000, "length in mm"),
    "Pa_s": (1, "viscosity in Pa s"),
    "Pa": (1, "modulus in Pa"),
    "s": (1, "time in s"),
}
"""End of a key → how many of the unit are one SI unit (whole: then SI → unit → SI settles at once), and in words."""
MOST = 1000
"""Holds or stages of a protocol."""


@dataclass(frozen=True)
class Entry:
    """How a field stands in TOML: its key, what is accepted there, how many of its unit are one SI unit (if a number)."""

    key: str
    wanted: str
    accept: Callable[[Any], Any]
    per_si: int | None = None
    table: type[Section] | None = None

    def read(self, raw: Any, path: str) -> Any:
        """From TOML to SI (lists to tuples), or an `InputError` that names the path."""
        if not self.accept(raw):
            raise InputError(path, _brief(raw), self.wanted)
        if isinstance(raw, list):
            return tuple(self._read_one(item, f"{path}#{i}") for i, item in enumerate(raw, 1))
        return self._read_one(raw, path)

    def _read_one(self, raw: Any, path: str) -> Any:
        if self.table:
            return _read(self.table, raw, path)
        return raw / self.per_si if self.per_si else raw

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


def _number(key: str, default: Any = MISSING, least: float | None = None, signed: bool = False, size: int = 1) -> Any:
    """A number in the key's unit that is > 0, or ≥ `least`, or any (`signed`); `size` of them; one or a list (0)."""
    per_si, noun = next((value for unit, value in UNITS.items() if key.endswith(f"_{unit}")), (1, "number"))
    wanted = f"a {noun}" + ("" if signed else " greater than 0" if least is None else f" of at least {least:g}")
    wanted += {0: ", or a list of them", 1: ""}.get(size, f" in each of {size} places")

    def accept(raw: Any) -> bool:
        values = raw if isinstance(raw, list) and size != 1 else [raw]
        fit = all(_is_number(v) and (signed or (v > 0 if least is None else v >= least)) for v in values)
        return fit and len(values) > 0 and (size == 0 or len(values) == size)

    return field(default=default, metadata={"entry": Entry(key, wanted, accept, per_si)})


def _whole(key: str, low: int, high: int, default: Any) -> Any:
    entry = Entry(key, f"a whole number from {low} to {high}", lambda raw: _is_number(raw, int) and low <= raw <= high)
    return field(default=default, metadata={"entry": entry})


def _text(key: str, wanted: str, default: Any = MISSING, accept: Callable[[str], Any] = lambda raw: True) -> Any:
    entry = Entry(key, wanted, lambda raw: isinstance(raw, str) and raw.isprintable() and accept(raw))
    return field(default=default, metadata={"entry": entry})


def _choice(key: str, choices: Iterable[str], default: Any = MISSING) -> Any:
    return _text(key, "one of " + ", ".join(choices), default, lambda raw: raw in choices)


def _pattern(key: str, default: Any = MISSING) -> Any:
    def accept(raw: str) -> Any:
        try:
            with warnings.catch_warnings(action="ignore"):
                return raw.strip() and re.compile(raw)
        except (re.error, OverflowError, RecursionError):
            return False

    return _text(key, "a name or a regular expression", default, accept)


def _table(cls: type[Section], default: Any = None, many: bool = False) -> dict[str, Any]:
    wanted = f"one or more tables [[{cls.section()}]]"
    entry = Entry(cls.section(), wanted, lambda raw: not many or (isinstance(raw, list) and raw), table=cls)
    return {"metadata": {"entry": entry}} | ({"default_factory": default} if default else {})


class Section:
    """What all parts share: whatever way one is made, it holds only what a file could hold."""

    def __post_init__(self) -> None:
        for f, entry in _entries(self):
            if f.default is not None or self.shown(f.name) is not None:
                value = entry.read(self.shown(f.name), f"{self.section()}.{entry.key}".lstrip("."))
                object.__setattr__(self, f.name, value)
        self._check()

    @classmethod
    def section(cls) -> str:
        """Its name in TOML; the scene as a whole has none."""
        return cls.__name__.lower().removeprefix("scene")

    def shown(self, name: str) -> Any:
        """A field's value as TOML has it, in the unit of its key; None where it is not given."""
        return next(entry for f, entry in _entries(self) if f.name == name).show(getattr(self, name))

    def to_dict(self) -> dict[str, Any]:
        """In TOML's keys and units, fit for JSON."""
        values = {entry.key: self.shown(f.name) for f, entry in _entries(self)}
        return {key: value for key, value in values.items() if value is not None}

    def _need(self, ok: Any, name: str, wanted: str, path: str = "") -> None:
        if not ok:
            key = next(entry.key for f, entry in _entries(self) if f.name == name)
            raise InputError(f"{path or self.section()}.{key}", _brief(self.shown(name)), wanted)

    def _check(self) -> None:
        pass  # what is wrong between fields


def _entries(part: Any) -> list[tuple[Field[Any], Entry]]:
    return [(f, f.metadata["entry"]) for f in fields(part)]


def _read(cls: Any, data: Any, path: str) -> Any:
    if not isinstance(data, dict):
        raise InputError(path or "scene", _brief(data), "a table of keys and values")
    known, values = {entry.key for _, entry in _entries(cls)}, {}
    for key in data:
        if key not in known:
            shown = key if re.fullmatch(r"[\w-]{1,60}", str(key)) else _brief(key)
            raise InputError(f"{path}.{shown}".lstrip("."), "not a known key", nearest(str(key), known))
    for f, entry in _entries(cls):
        where = f"{path}.{entry.key}".lstrip(".")
        if entry.key in data:
            values[f.name] = entry.read(data[entry.key], where)
        elif f.default is MISSING and f.default_factory is MISSING:
            raise InputError(where, "missing", entry.wanted)
    try:
        return cls(**values)
    except InputError as error:
        raise InputError(path + error.field.removeprefix(cls.section()), error.value, error.wanted) from None


def _brief(value: Any) -> str:
    try:
        return "missing" if value is None else " ".join(reprlib.repr(value).split())
    except ValueError:  # Python refuses to print whole numbers of thousands of digits
        return "a number of thousands of digits"


def _tuple(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else () if value is None else (value,)


@dataclass(frozen=True, kw_only=True)
class Body(Section):
    """The head: its shape; element sizes (m) on the cleft, under the craniotomy and elsewhere; polynomial order."""

    head: str = _choice("head", ["idealised"], "idealised")
    site: float = _number("site_mm", 2e-3)
    near: float = _number("near_mm", 6e-3)
    far: float = _number("far_mm", 20e-3)
    order: int = _whole("order", 2, 4, 2)

    def _check(self) -> None:
        self._need(self.near >= self.site, "near", f"at least {self.shown('site'):g}, body.site_mm")
        self._need(self.far >= self.near, "far", f"at least {self.shown('near'):g}, body.near_mm")


@dataclass(frozen=True, kw_only=True)
class Tissue(Section):
    """What the regions that match a pattern are made of, by `constants` or by `mu`.

    constants    name in the catalogue
    mu           shear moduli (Pa): one alone is Neo-Hooke, not relaxing; else first the part that stays, then branches
    alpha        as many Ogden exponents
    eta          viscosities (Pa s) of the branches, one fewer
    bulk_ratio   bulk modulus / initial shear modulus

    >>> tissue = Tissue(region="cortex", constants="griffiths2024:cortex")
    >>> tissue.initial_modulus, tissue.bulk, tissue.with_alpha(-4.7).alpha
    (2380.0, 2380000.0, (-4.7, -4.7, -4.7))
    """

    region: str = _pattern("region")
    constants: str | None = _choice("constants", CATALOGUE, None)
    mu: float | tuple[float, ...] | None = _number("mu_Pa", None, size=0)
    alpha: float | tuple[float, ...] | None = _number("alpha", None, signed=True, size=0)
    eta: float | tuple[float, ...] | None = _number("eta_Pa_s", None, size=0)
    bulk_ratio: float = _number("bulk_ratio", 1000.0)

    def _check(self) -> None:
        for name in ("mu", "alpha", "eta"):
            self._need(not self.constants or getattr(self, name) is None, name, "this key or constants, not both")
        if not self.constants:
            n, alpha = len(_tuple(self.mu)), _tuple(self.alpha)
            self._need(n or alpha or self.eta, "constants", "constants, a name in the catalogue, or mu_Pa")
            self._need(n, "mu", "moduli to go with alpha and eta_Pa_s")
            self._need(len(alpha) == n or n == 1 > len(alpha), "alpha", f"as many values as mu_Pa: {n}")
            self._need(all(alpha), "alpha", "numbers other than 0")
            self._need(len(_tuple(self.eta)) == n - 1, "eta", f"one value fewer than mu_Pa: {n - 1}")
        self._need(math.isfinite(self.bulk), "bulk_ratio", "one that, times mu_Pa, is a finite bulk modulus")

    @property
    def _constants(self) -> OgdenBranches:
        if self.constants:
            return constants(self.constants)
        return OgdenBranches(_tuple(self.mu), _tuple(self.alpha), _tuple(self.eta), "the scene", math.nan)

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
        old = self._constants
        mu = old.mu if old.alpha else self.mu
        return replace(self, constants=None, mu=mu, alpha=(alpha,) * len(old.alpha) or None, eta=old.eta or None)

    def scaled(self, factor: float) -> Tissue:
        """Moduli and viscosities times `factor`, so that times stay; such constants are no longer the catalogue's."""
        old = self._constants
        mu, eta = tuple(factor * m for m in old.mu), tuple(factor * e for e in old.eta)
        return replace(self, constants=None, mu=mu, alpha=old.alpha or None, eta=eta or None)


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

    def _check(self) -> None:
        diagonal = math.hypot(self.width, self.opening)
        wanted = f"more than {1e3 * diagonal:.4g}, the diagonal of cleft.width_mm by cleft.opening_mm"
        self._need(self.craniotomy > diagonal, "craniotomy", wanted)
        units = []
        for name in ("approach", "across"):
            way = getattr(self, name) or (1.0,)
            self._need(any(way), name, "a direction: not all 0")
            large = [c / max(map(abs, way)) for c in way]
            units.append([c / math.hypot(*large) for c in large])
        cosine = sum(a * b for a, b in zip(*units, strict=False)) if self.approach and self.across else 0.0
        self._need(1 - cosine**2 > 0.01, "across", "a direction other than cleft.approach")


@dataclass(frozen=True, kw_only=True)
class Blade(Section):
    """A flat spatula: width, rounding of its edges, height of its tip above the cleft's floor, thickness (m)."""

    width: float = _number("width_mm", 10e-3)
    edge_radius: float = _number("edge_radius_mm", 1e-3, least=1.0)
    tip: float = _number("tip_mm", 4e-3)
    thickness: float = _number("thickness_mm", 2e-3)

    def _check(self) -> None:
        wanted = f"at least twice blade.edge_radius_mm = {self.shown('edge_radius'):g}"
        self._need(self.width >= 2 * self.edge_radius, "width", wanted)


@dataclass(frozen=True, kw_only=True)
class Retraction(Section):
    """What all protocols share: how far the blade goes from first contact (m), how long that takes, the end (s)."""

    opening: float = _number("opening_mm", 5e-3)
    ramp: float = _number("ramp_s", 10.0)
    elapsed: float = _number("elapsed_s", 900.0)

    def _check(self) -> None:
        self._need(self.elapsed > self.ramp, "elapsed", f"more than {self.ramp:g}, retraction.ramp_s")


@dataclass(frozen=True, kw_only=True)
class Protocol(Section):
    """How the blade is driven; `name` is `kind` unless given, and each kind has fields of its own.

    continuous     open, hold
    intermittent   open, hold for `hold` s, let go, open again `rest` s after letting go, …
    staged         open in `stages` equal steps with `rest` s between them, hold
    program        the blade's way (m) `opening` from first contact at `times` (s), straight in between
    """

    KINDS: ClassVar = {"continuous": (), "intermittent": ("hold", "rest"), "staged": ("stages", "rest")}
    KINDS |= {"program": ("times", "opening")}

    kind: str = _choice("kind", KINDS)
    name: str = _text("name", "letters, digits, spaces and . + - _", "", re.compile(r"\w[\w .+-]*").fullmatch)
    hold: float | None = _number("hold_s", None)
    rest: float | None = _number("rest_s", None)
    stages: int | None = _whole("stages", 2, MOST, None)
    times: tuple[float, ...] | None = _number("t_s", None, least=0.0, size=0)
    opening: tuple[float, ...] | None = _number("opening_mm", None, signed=True, size=0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", self.kind if self.name == "" else self.name)
        super().__post_init__()

    def _check(self) -> None:
        own = self.KINDS[self.kind]
        keys = ", ".join(["kind", "name", *(entry.key for f, entry in _entries(self) if f.name in own)])
        for name in ("hold", "rest", "stages", "times", "opening"):
            wanted = f"{'a value' if name in own else 'this key left out'}: kind {self.kind!r} has {keys}"
            self._need((getattr(self, name) is not None) == (name in own), name, wanted)
        if self.kind == "program":
            t, way = _tuple(self.times), _tuple(self.opening)
            rising = len(t) > 1 and t[0] == 0 and all(a < b for a, b in pairwise(t))
            self._need(rising, "times", "two or more times that start at 0 and increase")
            self._need(len(way) == len(t), "opening", f"as many values as t_s: {len(t)}")
            self._need(
                way[0] <= 0 < max(way), "opening", "values that start at 0, or less (clear of tissue), and exceed 0"
            )


@dataclass(frozen=True, kw_only=True)
class Steps(Section):
    """Longest time step (s) while the blade pushes and while it rests."""

    contact: float = _number("contact_s", 1.0)
    longest: float = _number("longest_s", 60.0)


def _protocols() -> tuple[Protocol, ...]:
    shared = [{"kind": "continuous"}, {"kind": "intermittent", "hold": 230.0, "rest": 90.0}]
    return tuple(Protocol(**p) for p in [*shared, {"kind": "staged", "stages": 5, "rest": 30.0}])


@dataclass(frozen=True, kw_only=True)
class Scene(Section):
    """One operation on one head. Whatever is wrong with one raises `InputError`.

    >>> scene = Scene.shipped("demo")
    >>> scene.blade.width, scene.to_dict()["blade"]["width_mm"], [p.name for p in scene.protocols]
    (0.01, 10.0, ['continuous', 'intermittent', 'staged'])
    """

    title: str = _text("title", "one line of text", "")
    body: Body = field(**_table(Body, Body))
    tissues: tuple[Tissue, ...] = field(**_table(Tissue, many=True))
    support: Support = field(**_table(Support, Support))
    cleft: Cleft = field(**_table(Cleft))
    blade: Blade = field(**_table(Blade, Blade))
    retraction: Retraction = field(**_table(Retraction, Retraction))
    protocols: tuple[Protocol, ...] = field(**_table(Protocol, _protocols, many=True))
    steps: Steps = field(**_table(Steps, Steps))

    def _check(self) -> None:
        blade, cleft = self.blade, self.cleft
        wanted = f"at most {cleft.shown('width'):g}, cleft.width_mm: not a blade wider than the cleft"
        blade._need(blade.width <= cleft.width, "width", wanted)
        wanted = f"at most {cleft.shown('opening'):g}, cleft.opening_mm: not a blade thicker than the cleft"
        blade._need(blade.thickness <= cleft.opening, "thickness", wanted)
        for i, tissue in enumerate(self.tissues):
            known = [other.region for other in self.tissues[:i]]
            tissue._need(tissue.region not in known, "region", "a region without a tissue so far", f"tissue#{i + 1}")
        for i, protocol in enumerate(self.protocols):
            known = [other.name for other in self.protocols[:i]]
            protocol._need(protocol.name not in known, "name", "a name not used so far", f"protocol#{i + 1}")
            self._check_times(protocol, f"protocol#{i + 1}")

    def _check_times(self, protocol: Protocol, path: str) -> None:
        """At `retraction.elapsed` the blade is in place."""
        ramp, end, hold, rest = (
            self.retraction.ramp,
            self.retraction.elapsed,
            protocol.hold or 0.0,
            protocol.rest or 0.0,
        )
        shared = f"retraction.ramp_s = {ramp:g} and retraction.elapsed_s = {end:g}"
        if protocol.kind == "intermittent":
            before = max((end * (1 - 1e-12) - ramp - hold) / (ramp + hold + rest), 0.0)
            protocol._need(before < MOST, "hold", f"at most {MOST} holds for rest_s, {shared}", path)
            n = math.ceil(before)  # holds over before the last one
            exact = (end - n * ramp - (n - 1) * rest) / max(n, 1)
            wanted = f"one under way at the end, such as {exact:.6g} for rest_s = {rest:g}, {shared}"
            protocol._need(n * (ramp + hold + rest) + ramp < end, "hold", wanted, path)
        late = ramp + ((protocol.stages or 1) - 1) * rest >= end
        protocol._need(not late, "rest", f"enough time for all stages, with {shared}", path)
        in_time = protocol.times is None or math.isclose(protocol.times[-1], end)
        protocol._need(in_time, "times", f"a last time equal to retraction.elapsed_s = {end:g}: equal extents", path)

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
        files = {
            f.name.removesuffix(".toml"): f for f in resources.files("ngbrain.scenes").iterdir() if ".toml" in f.name
        }
        if name not in files:
            raise InputError("scene", _brief(name), nearest(str(name), files))
        with resources.as_file(files[name]) as path:
            return cls.from_toml(path)

    def to_toml(self) -> str:
        """As the text of a file; reading it gives the same scene back."""
        lines = []
        for key, value in self.to_dict().items():
            if isinstance(value, str):
                lines.append(f"{key} = {json.dumps(value, ensure_ascii=False)}")
            for table in [] if isinstance(value, str) else value if isinstance(value, list) else [value]:
                lines += ["", f"[[{key}]]" if isinstance(value, list) else f"[{key}]"]
                lines += [f"{k} = {json.dumps(v, ensure_ascii=False)}" for k, v in table.items()]
        return "\n".join(lines) + "\n"
