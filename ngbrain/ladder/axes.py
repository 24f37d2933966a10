"""The axes along which a model can be enriched, as data: their levels from cheap to rich, and the cost of a step.

A model is a level for each axis of its scene. Axes are independent of one another: `models` defines what a level means, and
`estimates` how far a step would change the answers.
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
    """One axis of model enrichment.

    Parameters
    ----------
    name : str
    levels : tuple of AxisLevel
        From cheap to rich.
    left_out : tuple of str
        For each step, what the level below it leaves out, in words.
    by : tuple of str
        For each step, its estimator (`estimates.ESTIMATORS`).
    growth : tuple of float
        For each step, the approximate factor in computing time.
    tail : float
        Total change of all further steps of this kind, relative to the next one.
    to_richest : tuple of bool
        For each step, whether the estimate is of the step to the richest level, because the next one may change little.
    """

    name: str
    levels: tuple[AxisLevel, ...]
    left_out: tuple[str, ...]
    by: tuple[str, ...]
    growth: tuple[float, ...]
    tail: float = 1.0
    to_richest: tuple[bool, ...] = ()

    def estimated_level(self, level: str) -> AxisLevel:
        """The richer level whose effect is estimated at a level."""
        i = self.index(level)
        whole = (each for each in self.levels[i + 1 :] if not each.is_partial)
        return self.levels[-1] if self.to_richest and self.to_richest[i] else next(whole, self.levels[-1])

    def index(self, level: str) -> int:
        """Index of a level."""
        return [str(each) for each in self.levels].index(level)

    def next_level(self, level: str) -> AxisLevel | None:
        """The next richer level; None at the richest."""
        i = self.index(level) + 1
        return self.levels[i] if i < len(self.levels) else None


AXES = {
    axis.name: axis
    for axis in (
        Axis(
            "tissue",
            tuple(TissueLevel),
            ("differences between tissues", "variation of stiffness within a tissue"),
            ("step", "step"),
            (1.2, 1.2),
        ),
        Axis("fibres", tuple(PresenceLevel), ("fibres",), ("step",), (1.5,)),
        Axis("strain", tuple(StrainLevel), ("finite strains and rotations",), ("strained",), (5.0,)),
        Axis(
            "time",
            tuple(TimeLevel),
            ("relaxation", "viscoelasticity with several relaxation times", "finite viscoelastic strain"),
            ("step", "coarse", "coarse"),
            (1.0, 30.0, 3.0),
            to_richest=(False, True, True),
        ),
        Axis("inertia", tuple(PresenceLevel), ("inertia",), ("moving",), (10.0,)),
        Axis(
            "pressure",
            tuple(PressureLevel),
            ("pressure unknowns in nearly incompressible tissue",),
            ("step",),
            (2.0,),
        ),
        Axis("contact", tuple(PresenceLevel), ("sliding and separation of tissue",), ("touching",), (2.0,)),
        Axis("friction", tuple(PresenceLevel), ("friction",), ("coarse",), (2.0,)),
        Axis("extent", tuple(ExtentLevel), ("the surroundings of the region of interest",), ("roughly",), (2.0,)),
        Axis("space", tuple(SpaceLevel), ("out-of-plane effects",), ("roughly",), (20.0,)),
        Axis("order", tuple(OrderLevel)[:3], ("elements one order higher",) * 2, ("order",) * 2, (5.0, 5.0), 1.3),
        Axis(
            "mesh",
            tuple(MeshLevel),
            ("elements half as large", "elements half as large where they matter less") * 2,
            ("mesh",) * 4,
            (4.0, 3.0, 4.0, 3.0),
            1.6,
        ),
    )
}
"""Axes of bodies under loads."""
ELEMENTS = ("order", "mesh")
"""Axes of the discretisation."""
SLOW = 3.0
"""Inertia is considered for loads that increase within this number of shear-wave transit times."""
LONG, SOFT = 0.2, 300.0
"""Assumed longest side (m) of a body that is no block, and modulus (Pa) of tissue with a map: the files are not read at this
stage."""


def _solved(axis: Axis) -> Axis:
    """The axis with steps that are estimated by taking them: a harmonic problem is one linear solve."""
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
"""Axes of harmonic problems."""


def axes_of(scene: Scene, richest: Model | None = None, questions: Sequence[Labelled] = ()) -> dict[str, Axis]:
    """The axes that apply to a scene.

    Parameters
    ----------
    scene : Scene
    richest : mapping of str, optional
        Axis → its last level.
    questions : sequence of Question
        Observables in addition to the scene's quantities.

    Returns
    -------
    dict of Axis
        By name.

    Raises
    ------
    InputError
        An unknown axis or level, or a plane section that the scene does not have.
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
        if name == "time" and not any(law.maxwell_branches for law in laws):  # all branches are hereditary
            last = min(last, axis.index(TimeLevel.PRONY) + 1)
        if name == "time" and scene.is_timed:  # relaxed moduli are defined for a ramp and a hold only
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
    """The axis for a scene with rigid contact, which has no linear approximation: elements are estimated by solution, other steps
    on the coarsest elements.
    """
    return replace(axis, by=("solve" if axis.name in ELEMENTS else "coarse",) * len(axis.by))


def check_levels(of: str, model: Model, known: Mapping[str, Axis]) -> None:
    """Check a model's axes and levels.

    Parameters
    ----------
    of : str
        Name of the argument, for messages.
    model : mapping of str
        Axis → level.
    known : mapping of Axis

    Raises
    ------
    InputError
        An unknown axis or level.
    """
    for name, level in model.items():
        if name not in known:
            raise InputError(of, repr(name), nearest(name, list(known)))
        if level not in known[name].levels:
            raise InputError(f"{of}[{name!r}]", repr(level), f"one of {', '.join(known[name].levels)}")


def restrict(axis: Axis, first: int, last: int) -> Axis:
    """The axis with a range of its levels.

    Parameters
    ----------
    axis : Axis
    first, last : int
        Indices of the first level and of the one after the last.

    Returns
    -------
    Axis
    """
    shorter: dict[str, Any] = {part: getattr(axis, part)[first : last - 1] for part in ("left_out", "by", "growth")}
    return replace(axis, levels=axis.levels[first:last], **shorter)


def _whole_steps(axis: Axis) -> Axis:
    """The axis without partial levels."""
    kept = [i for i, level in enumerate(axis.levels) if not level.is_partial]
    parts: dict[str, Any] = {
        part: tuple(getattr(axis, part)[i] for i in kept[:-1]) for part in ("left_out", "by", "growth")
    }
    return replace(axis, levels=tuple(axis.levels[i] for i in kept), **parts)


def _crossing(scene: Scene) -> float:
    """Transit time (s) of a shear wave along the longest side, in the first tissue."""
    longest, tissue = max(scene.geometry.sides) if scene.geometry.kind == "block" else LONG, scene.tissues[0]
    return longest * math.sqrt(tissue.rho / (SOFT if tissue.shear_modulus_map else tissue.initial_modulus))


def _tissues(scene: Scene) -> tuple[int, int]:
    """First and last + 1 level of the tissue axis: one and each if there are several tissues, map if one has a map."""
    return int(len(scene.tissues) < 2), 3 if any(tissue.shear_modulus_map for tissue in scene.tissues) else 2


def cheapest(axes: Mapping[str, Axis]) -> dict[str, str]:
    """The cheapest model."""
    return {name: axis.levels[0] for name, axis in axes.items()}


def richest(axes: Mapping[str, Axis]) -> dict[str, str]:
    """The richest model."""
    return {name: axis.levels[-1] for name, axis in axes.items()}
