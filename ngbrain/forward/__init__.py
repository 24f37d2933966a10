"""Mechanics: boundary-value problems, their solution, observables and derivatives.

Problems
    `Problem` (nonlinear solid), `Material` by region, `PlaneStrain`, `Axisymmetric`, `AntiPlane`; `Inertia` with
    `GeneralizedAlpha` time integration.
Loads
    `TractionLoad`, `PressureLoad`, `BodyForce`, `Spring`, `RigidFace`, `RigidBody`, `CavityPressure`, `CavityVolume`.
Contact
    `RigidContact`, `SlidingSupport`, `SelfContact` (self-contact), `Friction`, `PrescribedForce` (force-controlled rigid bodies).
Solution
    `LoadPath` (equilibrium), `TimeStepper` and `run_load_history` (time), with `StepControl`, `ErrorControl` or `PrescribedSteps`.
    For a loop of your own: `advance` makes one step from one `State` to the next under a `LoadProgram`; `newton_for` gives
    Newton's method with the settings that the element needs.
Harmonic waves
    `HarmonicProblem` with `Wave` and `AbsorbingBoundary` boundaries; `HarmonicProblem.about` for small waves on a deformed body.
Differentiable models
    `StaticModel` of equilibria (`LoadCase`), `RunModel` of runs in time, `WaveModel` of harmonic waves.

Sub-packages: `common`, `contact`, `harmonic`, `observables`, `sensitivity`, `solid`, `statics`, `transient`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ngbrain.forward.common.kinematics import AntiPlane, Axisymmetric, PlaneStrain
    from ngbrain.forward.common.loads import (
        BodyForce,
        CavityPressure,
        CavityVolume,
        PressureLoad,
        RigidBody,
        RigidFace,
        Spring,
        TractionLoad,
    )
    from ngbrain.forward.common.material import Material
    from ngbrain.forward.common.state import State
    from ngbrain.forward.contact.force_control import PrescribedForce
    from ngbrain.forward.contact.friction import Friction
    from ngbrain.forward.contact.rigid import RigidContact, SelfContact, SlidingSupport
    from ngbrain.forward.harmonic.problem import HarmonicProblem
    from ngbrain.forward.harmonic.wave import Wave
    from ngbrain.forward.sensitivity.harmonic.wave_model import WaveModel
    from ngbrain.forward.sensitivity.static_model import LoadCase, StaticModel
    from ngbrain.forward.sensitivity.transient.run_model import RunModel
    from ngbrain.forward.solid.advance import LoadHistory, LoadProgram, advance, newton_for
    from ngbrain.forward.solid.inertia import GeneralizedAlpha, Inertia
    from ngbrain.forward.solid.problem import Problem
    from ngbrain.forward.statics.load_path import LoadPath
    from ngbrain.forward.transient.step_control import ErrorControl, PrescribedSteps, StepControl
    from ngbrain.forward.transient.time_stepper import TimeStepper, run_load_history

_HOME = {
    "contact.rigid": ("SelfContact", "RigidContact", "SlidingSupport"),
    "contact.force_control": ("PrescribedForce",),
    "contact.friction": ("Friction",),
    "harmonic.problem": ("HarmonicProblem",),
    "harmonic.wave": ("AbsorbingBoundary", "Wave"),
    "sensitivity.static_model": ("LoadCase", "StaticModel"),
    "solid.inertia": ("GeneralizedAlpha", "Inertia"),
    "common.kinematics": ("AntiPlane", "Axisymmetric", "PlaneStrain"),
    "statics.load_path": ("LoadPath",),
    "common.loads": (
        "CavityPressure", "CavityVolume", "PressureLoad", "RigidBody", "RigidFace", "Spring", "TractionLoad", "BodyForce",
    ),
    "common.material": ("Material",),
    "common.state": ("State",),
    "solid.advance": ("LoadHistory", "LoadProgram", "advance", "newton_for"),
    "solid.problem": ("Problem",),
    "sensitivity.harmonic.wave_model": ("WaveModel",),
    "transient.step_control": ("ErrorControl", "PrescribedSteps", "StepControl"),
    "sensitivity.transient.run_model": ("RunModel",),
    "transient.time_stepper": ("TimeStepper", "run_load_history"),
}  # fmt: skip
_MODULE = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "AbsorbingBoundary",
    "AntiPlane",
    "Axisymmetric",
    "BodyForce",
    "CavityPressure",
    "CavityVolume",
    "ErrorControl",
    "Friction",
    "GeneralizedAlpha",
    "HarmonicProblem",
    "Inertia",
    "LoadCase",
    "LoadHistory",
    "LoadPath",
    "LoadProgram",
    "Material",
    "PlaneStrain",
    "PrescribedForce",
    "PrescribedSteps",
    "PressureLoad",
    "Problem",
    "RigidBody",
    "RigidContact",
    "RigidFace",
    "RunModel",
    "SelfContact",
    "SlidingSupport",
    "Spring",
    "State",
    "StaticModel",
    "StepControl",
    "TimeStepper",
    "TractionLoad",
    "Wave",
    "WaveModel",
    "advance",
    "newton_for",
    "run_load_history",
]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """The names above, imported when they are first used."""
        if name not in _MODULE:
            raise AttributeError(f"module 'ngbrain.forward' has no attribute {name!r}")
        return getattr(import_module(f"ngbrain.forward.{_MODULE[name]}"), name)

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
