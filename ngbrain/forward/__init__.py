"""Equations and their solution.

One nonlinear solid, `Problem`, and what drives it: `LoadPath` to equilibrium, `TimeStepper` and `run_load_history` through time.
What it is made of: `Material` by region; supports by boundary; loads (`Traction`, `Weight`, `Pressure`, `Spring`, `RigidFace`,
`RigidBody`, `CavityPressure`, `CavityVolume`) and `Inertia`; contacts (`Contact`, `Friction`, `Sliding`, `Closing`); in space or in
`PlaneStrain` and `Axisymmetric`. Linear waves at one frequency: `Harmonic`; on a deformed body `PrestressedModel`. Models that are
differentiated by parameters: `StaticModel` of equilibria (`Case`), `RunModel` of runs, `WaveModel` of waves.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ngbrain.forward.contact import Closing, Contact, Sliding
    from ngbrain.forward.friction import Friction
    from ngbrain.forward.harmonic import Harmonic, Wave
    from ngbrain.forward.implicit import Case, StaticModel
    from ngbrain.forward.inertia import GeneralizedAlpha, Inertia
    from ngbrain.forward.kinematics import AntiPlane, Axisymmetric, PlaneStrain
    from ngbrain.forward.load_path import LoadPath
    from ngbrain.forward.loads import (
        CavityPressure,
        CavityVolume,
        Pressure,
        RigidBody,
        RigidFace,
        Spring,
        Traction,
        Weight,
    )
    from ngbrain.forward.material import Material
    from ngbrain.forward.prestressed import PrestressedModel
    from ngbrain.forward.problem import Problem
    from ngbrain.forward.sensitivity import WaveModel
    from ngbrain.forward.steps import ErrorControl, GivenSteps, StepControl
    from ngbrain.forward.through_time import RunModel
    from ngbrain.forward.time_stepper import LoadHistory, TimeStepper, run_load_history

_HOME = {
    "contact": ("Closing", "Contact", "Sliding"),
    "friction": ("Friction",),
    "harmonic": ("Harmonic", "Wave"),
    "implicit": ("Case", "StaticModel"),
    "inertia": ("GeneralizedAlpha", "Inertia"),
    "kinematics": ("AntiPlane", "Axisymmetric", "PlaneStrain"),
    "load_path": ("LoadPath",),
    "loads": (
        "CavityPressure", "CavityVolume", "Pressure", "RigidBody", "RigidFace", "Spring", "Traction", "Weight",
    ),
    "material": ("Material",),
    "prestressed": ("PrestressedModel",),
    "problem": ("Problem",),
    "sensitivity": ("WaveModel",),
    "steps": ("ErrorControl", "GivenSteps", "StepControl"),
    "through_time": ("RunModel",),
    "time_stepper": ("LoadHistory", "TimeStepper", "run_load_history"),
}  # fmt: skip
_MODULE = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "AntiPlane",
    "Axisymmetric",
    "Case",
    "CavityPressure",
    "CavityVolume",
    "Closing",
    "Contact",
    "ErrorControl",
    "Friction",
    "GeneralizedAlpha",
    "GivenSteps",
    "Harmonic",
    "Inertia",
    "LoadHistory",
    "LoadPath",
    "Material",
    "PlaneStrain",
    "Pressure",
    "PrestressedModel",
    "Problem",
    "RigidBody",
    "RigidFace",
    "RunModel",
    "Sliding",
    "Spring",
    "StaticModel",
    "StepControl",
    "TimeStepper",
    "Traction",
    "Wave",
    "WaveModel",
    "Weight",
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
