# ruff: noqa: RUF009  (what the calls in class bodies return is a dataclasses.field)
"""The case file of a twin: a patient's scene, what is known of the stiffness, and two or more surgical plans."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.errors import InputError
from ngbrain.look import BriefText
from ngbrain.scene import Scene
from ngbrain.schema.document import Document, Section
from ngbrain.schema.fields import custom_table, number, path, table, text

TABLES = ("cleft", "tool", "time", "mesh", "patient", "protocol")
"""Tables of a scene that a plan may change."""
LISTED = ("tool", "protocol")
"""Those of them that a scene has as lists."""
RESOLVED = 8e-3
"""Diameter (m) below which waves do not resolve a lesion, so that a map says nothing of it."""
WIDEST = 10.0


@dataclass(frozen=True, repr=False)
class Changes(BriefText):
    """Keys of a scene's table with other values, as they are in TOML."""

    keys: Mapping[str, Any]

    def to_dict(self) -> dict[str, Any]:
        """The keys."""
        return dict(self.keys)


def _changes(key: str) -> Any:
    def relocate(value: Any, folder: Path) -> Any:
        if isinstance(value, list):
            return [relocate(each, folder) for each in value]
        is_file = isinstance(value, Mapping) and isinstance(value.get("file"), str)
        return {**value, "file": str(folder / value["file"])} if is_file else value

    wanted = f"a table [plan.{key}] with keys of a scene's {key}"
    return custom_table(key, lambda raw, _: Changes(raw), {"type": "object"}, wanted, relocate)


def _file_or_name(key: str, default: Any, wanted: str) -> Any:
    """Field of a TOML file by its path, or of a shipped one by its name."""
    entry = text(key, default, wanted, lambda raw: raw.strip()).metadata["entry"]

    def relocate(value: Any, folder: Path) -> Any:
        return str(folder / value) if isinstance(value, str) and value.endswith(".toml") else value

    return field(default=default, metadata={"entry": replace(entry, relocate=relocate)})


@dataclass(frozen=True, kw_only=True)
class StiffnessData(Section):
    """What is known of the patient's stiffness: waves, or a map with intervals. Without it the catalogue counts.

    Parameters
    ----------
    waves
        Path of wave data (.npz, .h5, .mat, NIfTI with its sidecar) on points of the head, which are inverted.
    map
        In place of waves: path of a volume of |G*|, the magnitude of the shear modulus (Pa), in the head's own axes; 0 or NaN
        where nothing was measured.
    sd
        Path of a volume of its standard deviation, in the same unit.
    low, high
        In place of that: paths of volumes of the ends of its 95 % interval.
    frequency
        Of the waves that the map was made from; needed with a map.
    map_factor
        Error of the map beyond its intervals (resolution, the model of the inversion), one standard deviation as a factor.
    registration
        Error of its place along each axis, one standard deviation.
    correlation
        Distance over which errors of the map are alike.
    loss_tangent
        Measured G″/G′, for the second way from waves to a retraction, by a spring-pot.
    """

    KEY = "stiffness"

    waves: str | None = path("waves", None, "the path of wave data (.npz, .h5, .mat, NIfTI)")
    map: str | None = path("map", None, "the path of a NIfTI volume of shear moduli |G*|")
    sd: str | None = path("sd", None, "the path of a NIfTI volume of standard deviations")
    low: str | None = path("low", None, "the path of a NIfTI volume of lower ends of 95 % intervals")
    high: str | None = path("high", None, "the path of a NIfTI volume of upper ends of 95 % intervals")
    frequency: float | None = number("frequency_Hz", None)
    map_factor: float = number("map_factor", 1.1, least=1.0)
    registration: float = number("registration_mm", 1e-3, least=0.0)
    correlation: float = number("correlation_mm", 20e-3, least=2.0)
    loss_tangent: float | None = number("loss_tangent", None)

    def _check(self, path: str, scene: Case) -> None:
        wanted = "the path of a map, or waves, and not both"
        self._need((self.map is None) != (self.waves is None), path, "map", wanted)
        for name in ("sd", "low", "high", "frequency"):
            wanted = "this key only with stiffness.map"
            self._need(getattr(self, name) is None or self.map is not None, path, name, wanted)
        self._need((self.low is None) == (self.high is None), path, "low", "this key and high, or neither")
        given = (self.sd is not None) + (self.low is not None)
        wanted = "a volume of standard deviations, or low and high, and not both: without them a map has no interval"
        self._need(self.map is None or given == 1, path, "sd", wanted)
        wanted = "the frequency of the waves that the map was made from: a modulus grows with it"
        self._need(self.map is None or self.frequency is not None, path, "frequency", wanted)
        self._need(self.map_factor <= WIDEST, path, "map_factor", f"a factor of 1 to {WIDEST:g}")
        self._need(self.registration <= 20e-3, path, "registration", "at most 20: a map of this head")
        self._need(self.loss_tangent is None or self.loss_tangent <= 5, path, "loss_tangent", "a ratio of at most 5")


@dataclass(frozen=True, kw_only=True)
class Link(Section):
    """From small strain at tens of hertz to a retraction of minutes, ln stiffness = exponent · ln r + e, and the laws' spread.

    Parameters
    ----------
    exponent
        Lowest and highest exponent of the ratio r.
    patient_factor
        One standard deviation of e over the whole patient, as a factor.
    region_factor
        One standard deviation of e of a tissue, and of a place, as a factor.
    level_factor
        Replaces the patient's one: without waves it is that of the catalogue's comparable tissues.
    stiffening_factor
        One standard deviation of the exponents of Ogden's laws; by default that of the catalogue's comparable tissues.
    relaxation_factor
        One standard deviation of all relaxation times, as a factor.
    """

    exponent: tuple[float, float] = number("exponent", (0.5, 1.2), least=0.0, size=2)
    patient_factor: float = number("patient_factor", 1.5, least=1.0)
    region_factor: float = number("region_factor", 1.3, least=1.0)
    level_factor: float | None = number("level_factor", None, least=1.0)
    stiffening_factor: float | None = number("stiffening_factor", None, least=1.0)
    relaxation_factor: float = number("relaxation_factor", 2.0, least=1.0)

    def _check(self, path: str, scene: Case) -> None:
        low, high = self.exponent
        self._need(low <= high <= 3, path, "exponent", "two numbers in order, of at most 3")
        for name in ("patient_factor", "region_factor", "level_factor", "stiffening_factor", "relaxation_factor"):
            value = getattr(self, name)
            self._need(value is None or value <= WIDEST, path, name, f"a factor of 1 to {WIDEST:g}")


@dataclass(frozen=True, kw_only=True)
class Lesion(Section):
    """A ball of other tissue. Below 8 mm no map resolves it: it takes the stated prior.

    Parameters
    ----------
    name
        For the report.
    centre
        In the head's own axes.
    diameter
        Of the ball.
    ratio
        Its stiffness over that of the tissue around it.
    ratio_factor
        One standard deviation of that, as a factor; by default 3, hardly anything is known.
    """

    name: str = text("name", "lesion", "a name of up to 50 characters", lambda raw: 0 < len(raw.strip()) <= 50)
    centre: tuple[float, float, float] = number("centre_mm", MISSING, signed=True, size=3)
    diameter: float = number("diameter_mm", MISSING, least=1.0)
    ratio: float = number("ratio", 1.0)
    ratio_factor: float = number("ratio_factor", 3.0, least=1.0)

    @property
    def is_resolved(self) -> bool:
        """Whether waves resolve it, so that a map counts there."""
        return self.diameter >= RESOLVED

    def _check(self, path: str, scene: Case) -> None:
        self._need(self.diameter <= 0.1, path, "diameter", "at most 100")
        self._need(0.01 <= self.ratio <= 100, path, "ratio", "a ratio of 0.01 to 100")
        self._need(self.ratio_factor <= WIDEST, path, "ratio_factor", f"a factor of 1 to {WIDEST:g}")


@dataclass(frozen=True, kw_only=True)
class Craniotomy(Section):
    """An opening of the skull that is made already: every plan has to pass through it.

    Parameters
    ----------
    centre
        A point on the surface of the brain under the middle of the opening.
    diameter
        Of the opening.
    """

    centre: tuple[float, float, float] = number("centre_mm", MISSING, signed=True, size=3)
    diameter: float = number("diameter_mm", MISSING)


@dataclass(frozen=True, kw_only=True)
class Plan(Section):
    """A surgical plan: a scene of its own, or the base scene with other keys.

    Parameters
    ----------
    name
        For the report.
    scene
        Path of a scene of its own.
    cleft, tool, time, mesh, patient, protocol
        Keys of these tables of the base scene with other values; a protocol replaces that of the scene.
    """

    NAME = "up to 50 letters, digits, spaces and . + - _, of which the first is a letter or digit"

    name: str = text("name", MISSING, NAME, re.compile(r"\w[\w .+-]{0,49}").fullmatch)
    scene: str | None = path("scene", None, "the path of a scene (.toml)", (".toml",))
    cleft: tuple[Changes, ...] | None = _changes("cleft")
    tool: tuple[Changes, ...] | None = _changes("tool")
    time: tuple[Changes, ...] | None = _changes("time")
    mesh: tuple[Changes, ...] | None = _changes("mesh")
    patient: tuple[Changes, ...] | None = _changes("patient")
    protocol: tuple[Changes, ...] | None = _changes("protocol")

    def _check(self, path: str, scene: Case) -> None:
        for name in TABLES:
            value = getattr(self, name)
            self._need(value is None or len(value) == 1, path, name, "one table: a plan has one protocol and one tool")

    def make_scene(self, base: Scene) -> Scene:
        """The scene of this plan.

        Parameters
        ----------
        base : Scene
            What it differs from.

        Returns
        -------
        Scene
            With one protocol.

        Raises
        ------
        InputError
            The changes make no valid scene; the message names the plan.
        """
        own = base if self.scene is None else Scene.from_toml(self.scene)
        found = own.to_dict()
        for name in TABLES:
            changes = getattr(self, name)
            if changes is None:
                continue
            keys, before = changes[0].to_dict(), found.get(name) or {}
            if name == "protocol":
                found[name] = [keys]
                continue
            before = dict(before[0] if name in LISTED else before)
            if "target_mm" in keys or "target_voxel" in keys:
                before.pop("target_mm", None), before.pop("target_voxel", None)
            found[name] = [before | keys] if name in LISTED else before | keys
        found["protocol"] = found["protocol"][:1] if found.get("protocol") else [{"kind": "continuous"}]
        found.pop("quantity", None)
        try:
            scene = Scene.from_dict(found)
        except InputError as error:
            raise InputError(f"plan {self.name!r}: {error.field}", error.value, error.wanted) from None
        if not scene.is_operation:
            raise InputError(f"plan {self.name!r}", "a scene without a cleft", "an operation: a scene with [cleft]")
        return scene


@dataclass(frozen=True, kw_only=True)
class Case(Document):
    """One patient and the plans that are compared.

    Parameters
    ----------
    title
        A line.
    scene
        The base scene: head, tissues, mesh, time, tool.
    norm
        Path of a norm file, or the name of a shipped one.
    stiffness
        What is known of the patient's stiffness.
    link
        From waves to a retraction.
    lesions
        Other tissue.
    craniotomy
        An opening of the skull that is made already.
    structures
        Path of a label map in the head's own axes whose structures are named where a corridor crosses them.
    scheme
        Its numbering: freesurfer, synthseg, muse, spm, cat, fast or ngbrain; needed with structures.
    plans
        Two or more.
    """

    title: str = text("title", "", "one line of text", lambda raw: True)
    scene: str = _file_or_name(
        "scene", MISSING, "the path of a scene (.toml), or the name of a shipped one such as idealised_fast"
    )
    norm: str = _file_or_name("norm", "brain", "the path of a norm (.toml), or the name of a shipped one")
    stiffness: StiffnessData | None = table(StiffnessData, None)
    link: Link = table(Link, Link)
    lesions: tuple[Lesion, ...] = table(Lesion, (), size=0)
    craniotomy: Craniotomy | None = table(Craniotomy, None)
    structures: str | None = path("structures", None, "the path of a label map (NIfTI, MGZ)")
    scheme: str = text("scheme", "", "the name of a numbering of labels", lambda raw: True)
    plans: tuple[Plan, ...] = table(Plan, size=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.plans) < 2:
            raise InputError("plan", f"given {len(self.plans)} time", "two or more tables [[plan]], to be compared")
        if self.structures is not None and not self.scheme.strip():
            raise InputError("scheme", "missing", "the numbering of the structures, such as freesurfer or muse")
        plans, lesions = [plan.name for plan in self.plans], [lesion.name for lesion in self.lesions]
        for key, names in (("plan", plans), ("lesion", lesions)):
            if twice := [name for name in names if names.count(name) > 1]:
                raise InputError(f"{key}.name", repr(twice[0]), f"a name for each {key} that no other has")
        for key, part in (("stiffness", self.stiffness), ("link", self.link)):
            if part is not None:
                part._check(key, self)
        for key, parts in (("lesion", self.lesions), ("plan", self.plans)):
            for i, each in enumerate(parts, 1):
                each._check(f"{key}#{i}", self)

    @staticmethod
    def template() -> str:
        """Text of a commented case that runs as it is, beside the sample data `twin`."""
        return (resources.files("ngbrain.samples") / "twin.toml").read_text(encoding="utf-8")

    def base(self) -> Scene:
        """The base scene, from its file or shipped."""
        return Scene.from_toml(self.scene) if self.scene.endswith(".toml") else Scene.shipped(self.scene)

    def scenes(self) -> dict[str, Scene]:
        """Plan → its scene; raises `InputError` for scenes on different heads or with different tissues."""
        base = self.base()
        found = {plan.name: plan.make_scene(base) for plan in self.plans}
        first = next(iter(found.values()))
        for name, scene in found.items():
            if scene.geometry != first.geometry:
                raise InputError(f"plan {name!r}: geometry", scene.geometry.kind, "the same head for all plans")
            if scene.tissues != first.tissues:
                raise InputError(
                    f"plan {name!r}: tissue", "other tissues", "the same tissues for all plans: one patient"
                )
        if first.geometry.stiffness_map or any(tissue.shear_modulus_map for tissue in first.tissues):
            raise InputError("scene", "with a stiffness map of its own", "the map as stiffness.map of the case")
        return found

    def check_opening(self, name: str, entry: np.ndarray, diagonal: float) -> None:
        """Raise `InputError` where a plan does not pass through the craniotomy.

        Parameters
        ----------
        name : str
            Plan.
        entry : (3,) array
            Where its corridor leaves the brain (m).
        diagonal : float
            Of its cross-section (m).
        """
        if self.craniotomy is None:
            return
        off = float(np.linalg.norm(entry - np.array(self.craniotomy.centre)))
        room = self.craniotomy.diameter / 2 - diagonal / 2
        if off > room:
            found = f"{1e3 * off:.1f} mm from the centre of the craniotomy"
            raise InputError(f"plan {name!r}: cleft", found, f"within {1e3 * max(room, 0):.1f} mm, inside the opening")
