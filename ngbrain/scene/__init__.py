# ruff: noqa: RUF009  (what the calls in class bodies return is a dataclasses.field)
"""A scene as plain data: a body with its supports and loads, or an operation, the requested quantities, and the mesh size.

Values are in SI units; in TOML the unit is the suffix of the key (`width_mm`, `ramp_s`, `mu_Pa`). `ngbrain.schema.document` reads
and writes. A part checks its own fields when it is made (also in Python), a `Scene` the relations between fields and parts.

- `geometry`: The body and its element sizes: `Geometry`, `MeshSize`.
- `tissues`: Materials: `Tissue`.
- `conditions`: Supports and loads: `DisplacementBC`, `Traction`, `Pressure`, `Gravity`, `Fluid`.
- `contacts`: Rigid bodies: `Contact`.
- `operation`: Cleft, tool and patient: `CleftSpec`, `Tool`, `Patient`.
- `protocols`: Time and the tool's motion: `Time`, `Protocol`.
- `quantities`: Requested quantities: `Quantity`.
- `result`: The result of a scene.
- `schema`: JSON schema and reference page of the file format.
"""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

from ngbrain.errors import InputError, nearest
from ngbrain.lazy import lazy_names
from ngbrain.look import NotebookCard
from ngbrain.materials.registry import reading
from ngbrain.mesh.geometry.primitives import Ellipsoids
from ngbrain.scene.conditions import DisplacementBC, Fluid, Given, Gravity, Pressure, Traction, depends_on_time
from ngbrain.scene.contacts import Contact
from ngbrain.scene.geometry import Geometry, MeshSize
from ngbrain.scene.operation import CleftSpec, Openable, Patient, Tool
from ngbrain.scene.protocols import Protocol, Time
from ngbrain.scene.quantities import Quantity
from ngbrain.scene.tissues import DENSITY, Tissue
from ngbrain.schema.document import Document, Section, brief, entries
from ngbrain.schema.fields import table, text

if TYPE_CHECKING:
    from ngbrain.scene import conditions, contacts, geometry, operation, protocols, quantities, result, schema, tissues
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "CleftSpec",
    "Contact",
    "DisplacementBC",
    "Fluid",
    "Geometry",
    "Gravity",
    "MeshSize",
    "Patient",
    "Pressure",
    "Protocol",
    "Quantity",
    "Scene",
    "Time",
    "Tissue",
    "Tool",
    "Traction",
    "conditions",
    "contacts",
    "geometry",
    "operation",
    "protocols",
    "quantities",
    "result",
    "schema",
    "tissues",
]


@dataclass(frozen=True, kw_only=True, repr=False)
class Scene(NotebookCard, Document):
    """One job: a body under loads, or an operation (a scene with a cleft and a tool). Invalid input raises `InputError`.

    Parameters
    ----------
    title
        Title, one line.
    geometry
        The body.
    mesh
        Element sizes.
    tissues
        Materials by region.
    displacement_bcs
        Prescribed displacements. By default an operation is fixed at the skull.
    tractions, pressures
        Loads of a body.
    gravity, fluid
        Gravity, and a fluid around the body or around the brain before the tool touches it.
    contacts
        Rigid bodies that press on it.
    cleft, tools, protocols, patient
        Parts of an operation; by default with one continuous protocol.
    time
        Ramp and end, or a frequency.
    quantities
        Requested quantities, with tolerances: the cheapest model within them is used. An operation without any is computed with
        the elements of `mesh`.

    Examples
    --------
    >>> scene = Scene.shipped("idealised")
    >>> scene.tool.width, scene.to_dict()["tool"][0]["width_mm"], [p.name for p in scene.protocols]
    (0.01, 10.0, ['continuous', 'intermittent', 'staged'])
    >>> scene = Scene(
    ...     geometry=Geometry(kind="block", size=(0.06, 0.06, 0.04)),
    ...     tissues=[Tissue(mu=1000.0)],
    ...     displacement_bcs=[DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=(0, 0, -1e-3))],
    ...     quantities=[Quantity(name="force", boundary="top", tolerance=0.05)],
    ... )
    >>> scene.quantities[0].label, Scene.from_dict(scene.to_dict()) == scene
    ('force on top, end', True)
    """

    PICTURE: ClassVar[str] = "ngbrain.workflows.preview:plot_scene"

    title: str = text("title", "", "one line of text", lambda raw: True)
    geometry: Geometry = table(Geometry)
    mesh: MeshSize = table(MeshSize, MeshSize)
    tissues: tuple[Tissue, ...] = table(Tissue, size=0)
    displacement_bcs: tuple[DisplacementBC, ...] = table(DisplacementBC, (), size=0)
    tractions: tuple[Traction, ...] = table(Traction, (), size=0)
    pressures: tuple[Pressure, ...] = table(Pressure, (), size=0)
    gravity: Gravity | None = table(Gravity, None)
    fluid: Fluid | None = table(Fluid, None)
    contacts: tuple[Contact, ...] = table(Contact, (), size=0)
    cleft: CleftSpec | None = table(CleftSpec, None)
    time: Time = table(Time, Time)
    tools: tuple[Tool, ...] = table(Tool, (), size=0)
    protocols: tuple[Protocol, ...] = table(Protocol, (), size=0)
    quantities: tuple[Quantity, ...] = table(Quantity, (), size=0)
    patient: Patient = table(Patient, Patient)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_kind()
        for name, entry in entries(self).items():
            one, parts = entry.size == 1, getattr(self, name)
            found = ([parts] if parts is not None else []) if one else parts
            for i, part in enumerate(found, 1) if entry.table else ():
                part._check(entry.key if one else f"{entry.key}#{i}", self)
        if self.cleft and self.geometry.kind == "idealised":  # a scan has to be read first
            self.check_on(Ellipsoids())
        self._check_unique("tissue", self.tissues, "region", [tissue.region for tissue in self.tissues])
        self._check_unique("quantity", self.quantities, "name", [quantity.label for quantity in self.quantities])
        self._check_unique("protocol", self.protocols, "name", [_as_file(protocol.name) for protocol in self.protocols])

    def _check_kind(self) -> None:
        """Check what a body under loads and an operation must have or must not have; set an operation's defaults."""
        if self.cleft is None:
            for name, none in (("tools", ()), ("protocols", ()), ("patient", Patient())):
                wanted = "this table left out: without a [cleft] there is no operation"
                self._need_table(getattr(self, name) == none, name, "given", wanted)
            wanted = "one or more tables [[quantity]], the requested quantities of a body under loads"
            self._need_table(self.quantities, "quantities", "missing", wanted)
            wanted = "a [[displacement_bc]], [[traction]], [[pressure]], [[contact]], [gravity] or a tissue with swelling_percent"
            loaded = self.displacement_bcs or self.tractions or self.pressures or self.contacts or self.is_preloaded
            self._need_table(loaded, "displacement_bcs", "missing", wanted)
            return
        self._need_table(self.geometry.is_head, "cleft", "given", "geometry.kind a head, to go with it")
        for name in ("tractions", "pressures", "contacts"):
            self._need_table(
                not getattr(self, name), name, "given", "this table left out: an operation does not have it yet"
            )
        self._need_table(len(self.tools) <= 1, "tools", f"given {len(self.tools)} times", "one table [[tool]]")
        for name, default in (
            ("tools", (Tool(),)),
            ("protocols", (Protocol(kind="continuous"),)),
            ("displacement_bcs", (DisplacementBC(boundary="skull"),)),
        ):
            if not getattr(self, name):
                object.__setattr__(self, name, default)

    def _need_table(self, ok: object, name: str, found: str, wanted: str) -> None:
        if not ok:
            raise InputError(entries(self)[name].key, found, wanted)

    def summary(self) -> dict[str, str]:
        """Kind of job, geometry, tissues, loads and requested quantities, in words."""
        acting = {
            "displacement condition": len(self.displacement_bcs),
            "traction": len(self.tractions),
            "pressure": len(self.pressures),
            "contact": len(self.contacts),
            "tool": len(self.tools),
            "protocol": len(self.protocols),
            "quantity": len(self.quantities),
        }
        acting |= {name: 1 for name in ("gravity", "fluid") if getattr(self, name) is not None}
        acting["swelling"] = int(any(tissue.swelling for tissue in self.tissues))
        counted = [
            f"{n} {name}{'' if n == 1 else 's'}".replace("quantitys", "quantities") for name, n in acting.items() if n
        ]
        return {
            "title": self.title or ("operation" if self.is_operation else "body under loads"),
            "geometry": self.geometry.kind,
            "tissues": ", ".join(tissue.region for tissue in self.tissues) or "none",
            "conditions": ", ".join(counted) or "none",
        }

    def _thumbnail(self) -> str:
        """The picture of a body; a head is meshed first, which a card does not wait for: call `plot`."""
        return "" if self.geometry.is_head else super()._thumbnail()

    @property
    def is_operation(self) -> bool:
        """Whether a tool opens a cleft."""
        return self.cleft is not None

    @property
    def is_preloaded(self) -> bool:
        """Whether gravity or swelling loads the body: in an operation, before the tool touches it."""
        return self.gravity is not None or any(tissue.swelling for tissue in self.tissues)

    @property
    def is_timed(self) -> bool:
        """Whether a formula prescribes a position or a load as a function of time."""
        loads: list[Given] = [value for traction in self.tractions for value in traction.value]
        loads += [pressure.value for pressure in self.pressures]
        moved = [bc.is_timed for bc in self.displacement_bcs] + [body.is_timed for body in self.contacts]
        return any(moved) or any(map(depends_on_time, loads))

    @property
    def operated(self) -> CleftSpec:
        """The cleft of an operation."""
        if self.cleft is None:
            raise InputError("cleft", "missing", "a scene with a [cleft]: an operation")
        return self.cleft

    @property
    def tool(self) -> Tool:
        """The tool of an operation."""
        return self.tools[0]

    def check_on(self, head: Openable) -> None:
        """Raise `InputError` for a cleft, tool or protocol that does not fit into a head."""
        wall = self.operated.wall(head)
        self.tool._check_wall("tool#1", wall)
        for i, protocol in enumerate(self.protocols, 1):
            protocol._check_wall(f"protocol#{i}", wall)

    @property
    def warnings(self) -> list[str]:
        """Assumptions on the tissues and notes on their constants, a line each."""
        waves, found = self.time.frequency is not None, list[str]()
        for i, tissue in enumerate(self.tissues, 1):
            said = tissue.cautions
            if waves and not tissue.loss_tangent and not tissue.law().branches:
                said = [*said, "it is neither viscoelastic nor has a loss tangent: waves in it are not attenuated"]
            found += [f"tissue#{i} ({tissue.region}): {caution}" for caution in said]
        if self.time == Time() and any(tissue.law().branches for tissue in self.tissues):
            found.append(f"time is not given: {self.time.in_words} are assumed")
        if self.geometry.stiffness_map:
            found.append(
                "geometry.stiffness_map is relative: where it is 1.1 times its mean over a tissue, that tissue's moduli are 1.1 "
                "times those of the scene; its absolute values, measured at high rates and small strains, are not used"
            )
        if self.is_operation and self.gravity is not None:
            assumed = f"density_kg_m3 is not given: {DENSITY:g} is assumed"
            found += [f"tissue#{i} ({s.region}): {assumed}" for i, s in enumerate(self.tissues, 1) if s.density is None]
        if self.is_operation and not any(tissue.law().branches for tissue in self.tissues):
            found.append("no tissue is viscoelastic: pressures do not relax during holds")
        return found

    @staticmethod
    def _check_unique(key: str, parts: tuple[Section, ...], name: str, values: list[str]) -> None:
        for i, part in enumerate(parts):
            part._need(values[i] not in values[:i], f"{key}#{i + 1}", name, "one that is not used before")

    @classmethod
    def from_toml(cls, path: str | Path) -> Self:
        """Read a file; paths in it are relative to its folder. It may name laws of the user's own (`registry.reading`)."""
        with reading(path):
            return super().from_toml(path)

    @classmethod
    def shipped(cls, name: str) -> Scene:
        """A scene of the package: "demo" (a real head), "idealised", or the coarser "demo_fast" and "idealised_fast"."""
        files = _shipped()
        if name not in files:
            raise InputError("scene", brief(name), nearest(str(name), list(files)))
        with resources.as_file(files[name]) as path:
            return cls.from_toml(path)

    @staticmethod
    def template(kind: str = "operation") -> str:
        """Text of a commented file that runs as it is, for an "operation" or a "body" under loads; every key is explained."""
        files = {"operation": _shipped()["demo"], "body": resources.files("ngbrain.samples") / "plate.toml"}
        if kind not in files:
            raise InputError("kind", brief(kind), nearest(str(kind), list(files)))
        return files[kind].read_text(encoding="utf-8")

    @classmethod
    def schema(cls) -> dict[str, Any]:
        """JSON schema of the file format, with which editors complete and check keys."""
        from ngbrain.scene.schema import json_schema

        return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "ngbrain scene"} | json_schema(cls)


def _shipped() -> dict[str, Traversable]:
    """Scenes that come with the package, by name."""
    files = resources.files("ngbrain.scenes").iterdir()
    return {Path(file.name).stem: file for file in files if file.name.endswith(".toml")}


def _as_file(name: str) -> str:
    """A name as case-insensitive, accent-normalising file systems compare it."""
    return unicodedata.normalize("NFKC", name).casefold()
