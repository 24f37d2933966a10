"""Equations and their solution.

One nonlinear solid, `Problem`, and what drives it: `LoadPath` to equilibrium, `TimeStepper` and `run_load_history` through time.
For a loop of one's own `advance` makes a step from one `State` to the next, under what is `LoadProgram`.
What it is made of: `Material` by region; supports by boundary; loads (`Traction`, `Weight`, `Pressure`, `Spring`, `RigidFace`,
`RigidBody`, `CavityPressure`, `CavityVolume`) and `Inertia`; contacts (`Contact`, `Friction`, `Sliding`, `Closing`,
`GivenForce`); in space or in `PlaneStrain` and `Axisymmetric`. Linear waves at one frequency: `Harmonic`; on a deformed body
`Harmonic.about`. What is asked of a state: `ngbrain.forward.observables`. Models that are differentiated by parameters:
`StaticModel` of equilibria (`LoadCase`), `RunModel` of runs, `WaveModel` of waves.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ngbrain.forward.common.kinematics import AntiPlane, Axisymmetric, PlaneStrain
    from ngbrain.forward.common.loads import (
        CavityPressure,
        CavityVolume,
        Pressure,
        RigidBody,
        RigidFace,
        Spring,
        Traction,
        Weight,
    )
    from ngbrain.forward.common.material import Material
    from ngbrain.forward.common.state import State
    from ngbrain.forward.contact.force_control import GivenForce
    from ngbrain.forward.contact.friction import Friction
    from ngbrain.forward.contact.rigid import Closing, Contact, Sliding
    from ngbrain.forward.harmonic.problem import Harmonic
    from ngbrain.forward.harmonic.wave import Wave
    from ngbrain.forward.sensitivity.harmonic.wave_model import WaveModel
    from ngbrain.forward.sensitivity.static_model import LoadCase, StaticModel
    from ngbrain.forward.sensitivity.transient.run_model import RunModel
    from ngbrain.forward.solid.advance import LoadHistory, LoadProgram, advance, newton_for
    from ngbrain.forward.solid.inertia import GeneralizedAlpha, Inertia
    from ngbrain.forward.solid.problem import Problem
    from ngbrain.forward.statics.load_path import LoadPath
    from ngbrain.forward.transient.step_control import ErrorControl, GivenSteps, StepControl
    from ngbrain.forward.transient.time_stepper import TimeStepper, run_load_history

_HOME = {
    "contact.rigid": ("Closing", "Contact", "Sliding"),
    "contact.force_control": ("GivenForce",),
    "contact.friction": ("Friction",),
    "harmonic.problem": ("Harmonic",),
    "harmonic.wave": ("Absorbing", "Wave"),
    "sensitivity.static_model": ("LoadCase", "StaticModel"),
    "solid.inertia": ("GeneralizedAlpha", "Inertia"),
    "common.kinematics": ("AntiPlane", "Axisymmetric", "PlaneStrain"),
    "statics.load_path": ("LoadPath",),
    "common.loads": (
        "CavityPressure", "CavityVolume", "Pressure", "RigidBody", "RigidFace", "Spring", "Traction", "Weight",
    ),
    "common.material": ("Material",),
    "common.state": ("State",),
    "solid.advance": ("LoadHistory", "LoadProgram", "advance", "newton_for"),
    "solid.problem": ("Problem",),
    "sensitivity.harmonic.wave_model": ("WaveModel",),
    "transient.step_control": ("ErrorControl", "GivenSteps", "StepControl"),
    "sensitivity.transient.run_model": ("RunModel",),
    "transient.time_stepper": ("TimeStepper", "run_load_history"),
}  # fmt: skip
_MODULE = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "Absorbing",
    "AntiPlane",
    "Axisymmetric",
    "CavityPressure",
    "CavityVolume",
    "Closing",
    "Contact",
    "ErrorControl",
    "Friction",
    "GeneralizedAlpha",
    "GivenForce",
    "GivenSteps",
    "Harmonic",
    "Inertia",
    "LoadCase",
    "LoadHistory",
    "LoadPath",
    "LoadProgram",
    "Material",
    "PlaneStrain",
    "Pressure",
    "Problem",
    "RigidBody",
    "RigidFace",
    "RunModel",
    "Sliding",
    "Spring",
    "State",
    "StaticModel",
    "StepControl",
    "TimeStepper",
    "Traction",
    "Wave",
    "WaveModel",
    "Weight",
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
