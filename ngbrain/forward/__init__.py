"""Mechanics: boundary-value problems, their solution, observables and derivatives.

Problems
    `Problem` (nonlinear solid), `Material` by region, `PlaneStrain`, `Axisymmetric`, `AntiPlane`; `Inertia` with
    `GeneralizedAlpha` time integration.
Loads
    `TractionLoad`, `PressureLoad`, `BodyForce`, `FluidPressure`, `Spring`, `RigidFace`, `RigidBody`, `CavityPressure`,
    `CavityVolume`.
Contact
    `RigidContact`, `SlidingSupport`, `SelfContact`, `Friction`, `PrescribedForce` (force-controlled rigid bodies).
Solution
    `LoadPath` (equilibrium), `TimeStepper` and `run_load_history` (time), with `StepControl`, `ErrorControl` or `PrescribedSteps`
    (each a `Control` of the time step). For a loop of your own: `advance` makes one step from one `State` to the next under a
    `LoadProgram` or `LoadHistory`; `newton_for` gives Newton's method with the settings that the element needs.
Stability
    `smallest_eigenvalue` of the tangent, `compressed_fraction`, `creased_surface_fraction`.
Harmonic waves
    `HarmonicProblem` with `Wave` and `AbsorbingBoundary`; `HarmonicProblem.about` for small waves on a deformed body.
Observables
    `Displacements`, `Force`, `Moment`, `StrainEnergy`, `StrainPercentile`, `StressPercentile`, `Functional` (any integral),
    `Ratio`, `LinearObservable`; `Observable` is the interface. More are in `ngbrain.forward.observables`.
Values at points
    `evaluation`, `points_in_mesh`, `quadrature_points`, `quadrature_field`.
Differentiable models
    `StaticModel` of equilibria (`LoadCase`), `RunModel` of runs in time, `WaveModel` of harmonic waves, `Positions` in the loaded
    body; linearised: `StaticLinearisation`, `RunLinearisation`, `WaveLinearisation`. What they depend on beside material fields:
    `NodePositions`, `PrescribedDisplacement`.

Modules
-------
- `common`: what all problems share: kinematics, materials, supports, loads, elements.
- `contact`: contact with rigid bodies, friction.
- `solid`: the nonlinear solid, and one step of it.
- `statics`, `transient`, `harmonic`: equilibrium, time stepping, waves.
- `observables`: numbers with a unit, and how they change with the unknowns.
- `sensitivity`: models from parameters to data, with first and second derivatives.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.forward import common, contact, harmonic, observables, sensitivity, solid, statics, transient
    from ngbrain.forward.common.interpolation import evaluation, points_in_mesh, quadrature_field, quadrature_points
    from ngbrain.forward.common.kinematics import AntiPlane, Axisymmetric, PlaneStrain
    from ngbrain.forward.common.loads import (
        BodyForce,
        CavityPressure,
        CavityVolume,
        FluidPressure,
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
    from ngbrain.forward.harmonic.wave import AbsorbingBoundary, Wave
    from ngbrain.forward.observables.base import LinearObservable, Observable
    from ngbrain.forward.observables.force import Force, Moment
    from ngbrain.forward.observables.integrals import Functional, StrainEnergy
    from ngbrain.forward.observables.percentiles import StrainPercentile, StressPercentile
    from ngbrain.forward.observables.points import Displacements
    from ngbrain.forward.observables.ratio import Ratio
    from ngbrain.forward.sensitivity.harmonic.wave_model import WaveLinearisation, WaveModel
    from ngbrain.forward.sensitivity.node_positions import NodePositions
    from ngbrain.forward.sensitivity.parameter_blocks import PrescribedDisplacement
    from ngbrain.forward.sensitivity.reference_shape import Positions
    from ngbrain.forward.sensitivity.static_equilibrium import LoadCase
    from ngbrain.forward.sensitivity.static_model import StaticLinearisation, StaticModel
    from ngbrain.forward.sensitivity.transient.run_linearisation import RunLinearisation
    from ngbrain.forward.sensitivity.transient.run_model import RunModel
    from ngbrain.forward.solid.advance import LoadHistory, LoadProgram, advance, newton_for
    from ngbrain.forward.solid.inertia import GeneralizedAlpha, Inertia
    from ngbrain.forward.solid.problem import Problem
    from ngbrain.forward.statics.load_path import LoadPath
    from ngbrain.forward.statics.stability import compressed_fraction, creased_surface_fraction, smallest_eigenvalue
    from ngbrain.forward.transient.step_control import Control, ErrorControl, PrescribedSteps, StepControl
    from ngbrain.forward.transient.time_stepper import TimeStepper, run_load_history
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "AbsorbingBoundary",
    "AntiPlane",
    "Axisymmetric",
    "BodyForce",
    "CavityPressure",
    "CavityVolume",
    "Control",
    "Displacements",
    "ErrorControl",
    "FluidPressure",
    "Force",
    "Friction",
    "Functional",
    "GeneralizedAlpha",
    "HarmonicProblem",
    "Inertia",
    "LinearObservable",
    "LoadCase",
    "LoadHistory",
    "LoadPath",
    "LoadProgram",
    "Material",
    "Moment",
    "NodePositions",
    "Observable",
    "PlaneStrain",
    "Positions",
    "PrescribedDisplacement",
    "PrescribedForce",
    "PrescribedSteps",
    "PressureLoad",
    "Problem",
    "Ratio",
    "RigidBody",
    "RigidContact",
    "RigidFace",
    "RunLinearisation",
    "RunModel",
    "SelfContact",
    "SlidingSupport",
    "Spring",
    "State",
    "StaticLinearisation",
    "StaticModel",
    "StepControl",
    "StrainEnergy",
    "StrainPercentile",
    "StressPercentile",
    "TimeStepper",
    "TractionLoad",
    "Wave",
    "WaveLinearisation",
    "WaveModel",
    "advance",
    "common",
    "compressed_fraction",
    "contact",
    "creased_surface_fraction",
    "evaluation",
    "harmonic",
    "newton_for",
    "observables",
    "points_in_mesh",
    "quadrature_field",
    "quadrature_points",
    "run_load_history",
    "sensitivity",
    "smallest_eigenvalue",
    "solid",
    "statics",
    "transient",
]
