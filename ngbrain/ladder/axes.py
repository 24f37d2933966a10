"""The axes along which a model may be richer, as data: their levels from the cheapest to the richest, and what a step costs.

A model says a level for each axis of its scene. No axis knows another: what a level means is for `bodies` to say, and how far a
step would move the answers for `estimates`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ngbrain.errors import InputError, nearest
from ngbrain.ladder.levels import (
    HALVINGS,
    AxisLevel,
    ExtentLevel,
    MeshLevel,
    Model,
    OrderLevel,
    PresenceLevel,
    PressureLevel,
    SpaceLevel,
    StrainLevel,
    TimeLevel,
    TissueLevel,
)
from ngbrain.ladder.models.motions import characteristic_time
from ngbrain.ladder.models.section import Labelled, cannot_be_cut, not_in_section
from ngbrain.scene import Scene


@dataclass(frozen=True)
class Axis:
    """One way to model more.

    levels   from cheap to rich
    left_out what the level below the next one leaves out, in words, one for each step
    by       how a step is estimated: see `estimates`
    at_once  whether the estimate is of the step to the richest level, as the next one may change little and the last one much
    growth   how many times the computing time a step takes, roughly
    tail     what all further steps of this kind would add, over what the next one does
    """

    name: str
    levels: tuple[AxisLevel, ...]
    left_out: tuple[str, ...]
    by: tuple[str, ...]
    growth: tuple[float, ...]
    tail: float = 1.0
    to_richest: tuple[bool, ...] = ()

    def estimated_level(self, level: str) -> AxisLevel:
        """The level that the estimate at this one is of."""
        i = self.index(level)
        whole = (each for each in self.levels[i + 1 :] if not each.is_partial)
        return self.levels[-1] if self.to_richest and self.to_richest[i] else next(whole, self.levels[-1])

    def index(self, level: str) -> int:
        """Its place among the levels."""
        return [str(each) for each in self.levels].index(level)

    def next_level(self, level: str) -> AxisLevel | None:
        """The next richer level."""
        i = self.index(level) + 1
        return self.levels[i] if i < len(self.levels) else None


AXES = {
    axis.name: axis
    for axis in (
        Axis(
            "tissue",
            tuple(TissueLevel),
            ("that tissues differ", "how stiffness varies within a tissue"),
            ("step", "step"),
            (1.2, 1.2),
        ),
        Axis("fibres", tuple(PresenceLevel), ("fibres",), ("step",), (1.5,)),
        Axis("strain", tuple(StrainLevel), ("that strains and turns are finite",), ("strained",), (5.0,)),
        Axis(
            "time",
            tuple(TimeLevel),
            ("relaxation", "how parts relax one beside the other", "that relaxing parts strain far"),
            ("step", "coarse", "coarse"),
            (1.0, 30.0, 3.0),
            to_richest=(False, True, True),
        ),
        Axis("inertia", tuple(PresenceLevel), ("inertia",), ("moving",), (10.0,)),
        Axis(
            "pressure",
            tuple(PressureLevel),
            ("pressures of their own in nearly incompressible tissue",),
            ("step",),
            (2.0,),
        ),
        Axis("contact", tuple(PresenceLevel), ("that tissue slides and parts",), ("touching",), (2.0,)),
        Axis("friction", tuple(PresenceLevel), ("friction",), ("coarse",), (2.0,)),
        Axis("extent", tuple(ExtentLevel), ("what lies around the region of interest",), ("roughly",), (2.0,)),
        Axis("space", tuple(SpaceLevel), ("what happens out of the plane",), ("roughly",), (20.0,)),
        Axis("order", tuple(OrderLevel)[:3], ("elements one order higher",) * 2, ("order",) * 2, (5.0, 5.0), 1.3),
        Axis(
            "mesh",
            tuple(MeshLevel),
            ("elements half as large", "elements half as large where less is asked of them") * 2,
            ("mesh",) * 4,
            (4.0, 3.0, 4.0, 3.0),
            1.6,
        ),
    )
}
"""Of bodies under loads."""
ELEMENTS = ("order", "mesh")
"""Axes that are no physics."""
SLOW = 3.0
"""Crossings of a shear wave in whose time loads may grow without a word on inertia."""
LONG, SOFT = 0.2, 300.0
"""Longest side (m) of a body that is no block, and modulus (Pa) of tissue that has a map: neither is read here."""


def _solved(axis: Axis) -> Axis:
    """The same, with its steps estimated by taking them: a wave is one solve."""
    return replace(axis, by=("solve",) * len(axis.by))


OF_WAVES = {
    axis.name: axis
    for axis in (
        _solved(AXES["tissue"]),
        replace(_solved(AXES["inertia"]), growth=(1.0,)),
        Axis("loss", tuple(PresenceLevel), ("loss",), ("solve",), (1.5,)),
        _solved(AXES["pressure"]),
        AXES["space"],
        Axis("order", tuple(OrderLevel), ("elements one order higher",) * 3, ("section",) * 3, (4.0,) * 3, 1.2),
        Axis(
            "mesh",
            HALVINGS,
            ("elements half as large",) * 2,
            ("section",) * 2,
            (10.0, 10.0),
            1.6,
        ),
    )
}
"""Of bodies that are shaken."""


def axes_of(scene: Scene, richest: Model | None = None, questions: Sequence[Labelled] = ()) -> dict[str, Axis]:
    """The axes that mean something for a scene, up to the levels of `richest`; `InputError` for names that are none.

    `questions` are those that are asked beside the scene's.
    """
    waves = scene.time.frequency is not None
    known = OF_WAVES if waves else AXES
    bounds = richest or {}
    check_levels("richest", bounds, known)
    laws, beyond = [tissue.law() for tissue in scene.tissues], not_in_section(scene, questions)
    idle = {
        "fibres": all(tissue.fibre_stiffness is None for tissue in scene.tissues),
        "time": not any(law.branches for law in laws),
        "loss": not any(law.branches or tissue.loss_tangent for law, tissue in zip(laws, scene.tissues, strict=True)),
        "friction": not any(body.friction for body in scene.contacts),
        "contact": all(bc.contact == "bonded" for bc in scene.displacement_bcs),
        "inertia": not waves
        and min(scene.time.ramp, characteristic_time(scene, scene.time.end)) > SLOW * _crossing(scene),
        "space": scene.geometry.kind != "block" or beyond is not None,
        "extent": cannot_be_cut(scene) or bool(questions),
    }
    if bounds.get("space") == "plane" and idle["space"]:
        raise InputError("richest['space']", "'plane'", f"'solid': {beyond or 'only a block has a section'}")
    first, most = _tissues(scene)
    found = {}
    for name, axis in known.items():
        if idle.get(name):
            continue
        last = axis.index(bounds.get(name, axis.levels[-1])) + 1
        least, last = (first, max(first + 1, min(last, most))) if name == "tissue" else (0, last)
        if name == "time" and not any(law.maxwell_branches for law in laws):  # hereditary branches are all there is
            last = min(last, axis.index(TimeLevel.PRONY) + 1)
        if name == "time" and scene.is_timed:  # moduli as they are at one moment stand for a ramp and a hold alone
            least, last = axis.index(TimeLevel.PRONY), max(last, axis.index(TimeLevel.PRONY) + 1)
        if last - least > 1 or (name == "time" and least) or name in bounds or name in ("order", "mesh", "space"):
            found[name] = restrict(axis, least, last)
    if scene.geometry.kind == "idealised" or scene.contacts:  # curved elements cannot be cut one by one
        found["mesh"] = _whole_steps(found["mesh"])
    if scene.contacts:
        found = {name: _touching(axis) for name, axis in found.items() if name != "strain"}
        found = {"strain": restrict(AXES["strain"], 1, 2), **found}
    return found


def _touching(axis: Axis) -> Axis:
    """The same of a body that a rigid one meets, which has no linear cousin: its steps are taken, elements as they are and others
    on the largest ones.
    """
    return replace(axis, by=("solve" if axis.name in ELEMENTS else "coarse",) * len(axis.by))


def check_levels(of: str, model: Model, known: Mapping[str, Axis]) -> None:
    """Raise `InputError` for an axis or a level that is none."""
    for name, level in model.items():
        if name not in known:
            raise InputError(of, repr(name), nearest(name, list(known)))
        if level not in known[name].levels:
            raise InputError(f"{of}[{name!r}]", repr(level), f"one of {', '.join(known[name].levels)}")


def restrict(axis: Axis, first: int, last: int) -> Axis:
    """The axis with its levels from the first up to the last, which is left out."""
    shorter: dict[str, Any] = {part: getattr(axis, part)[first : last - 1] for part in ("left_out", "by", "growth")}
    return replace(axis, levels=axis.levels[first:last], **shorter)


def _whole_steps(axis: Axis) -> Axis:
    """The axis without levels that are parts of steps."""
    kept = [i for i, level in enumerate(axis.levels) if not level.is_partial]
    parts: dict[str, Any] = {
        part: tuple(getattr(axis, part)[i] for i in kept[:-1]) for part in ("left_out", "by", "growth")
    }
    return replace(axis, levels=tuple(axis.levels[i] for i in kept), **parts)


def _crossing(scene: Scene) -> float:
    """Time (s) of a shear wave along the longest side, through the first tissue, to which others are exceptions."""
    longest, tissue = max(scene.geometry.sides) if scene.geometry.kind == "block" else LONG, scene.tissues[0]
    return longest * math.sqrt(tissue.rho / (SOFT if tissue.shear_modulus_map else tissue.initial_modulus))


def _tissues(scene: Scene) -> tuple[int, int]:
    """Levels of tissue that differ, as first and last + 1: one and each where there are several, map where there is one."""
    return int(len(scene.tissues) < 2), 3 if any(tissue.shear_modulus_map for tissue in scene.tissues) else 2


def cheapest(axes: Mapping[str, Axis]) -> dict[str, str]:
    """The model to begin with."""
    return {name: axis.levels[0] for name, axis in axes.items()}


def richest(axes: Mapping[str, Axis]) -> dict[str, str]:
    """Everything that there is."""
    return {name: axis.levels[-1] for name, axis in axes.items()}
