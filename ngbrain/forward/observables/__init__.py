"""Observables: quantities of a problem's state, with unit and gradient with respect to the unknowns.

`base`: the interface, `Observable` of any problem and `ProblemObservable` of one. `points`: `Displacements`,
`SolutionUnknowns`; `force`: `Force`, `Moment`; `integrals`: `Functional`, any integral of the state, `StrainEnergy`,
`region_volume`; `percentiles`: `StrainPercentile`, `StressPercentile`; `ratio`: `Ratio`; `patches`, of walls in contact with
rigid bodies: `patch_pressure`, `NormalForce`, `ContactForce`, `ContactArea`, `CurrentArea`, `PatchDisplacement`, `mean_depth`,
each on one `Patch` or several. `wall`: `WallIntegral` for user-defined ones; `WallPass` evaluates many at once.

    Force("top", (0, 0, 1)).value(problem)                     at the current state, or at a `State`
    StrainPercentile(95, band=0.05).gradient(problem)          with respect to all unknowns

Dose, time above a threshold, amplitude and phase are derived from a model's data: `ngbrain.adjoint.derived`.

A user-defined observable is a class with `name`, `unit` and `on`; for an integral, `Functional` is enough.
"""

from ngbrain.forward.observables.base import Observable, ProblemObservable
from ngbrain.forward.observables.force import Force, Moment
from ngbrain.forward.observables.integrals import Functional, StrainEnergy, region_volume
from ngbrain.forward.observables.patches import (
    ContactArea,
    ContactForce,
    CurrentArea,
    NormalForce,
    Patch,
    PatchDisplacement,
    mean_depth,
    patch_pressure,
)
from ngbrain.forward.observables.percentiles import StrainPercentile, StressPercentile
from ngbrain.forward.observables.points import Displacements, SolutionUnknowns
from ngbrain.forward.observables.ratio import Ratio
from ngbrain.forward.observables.wall import WallIntegral, WallPass

__all__ = [
    "ContactArea",
    "ContactForce",
    "CurrentArea",
    "Displacements",
    "Force",
    "Functional",
    "Moment",
    "NormalForce",
    "Observable",
    "Patch",
    "PatchDisplacement",
    "ProblemObservable",
    "Ratio",
    "SolutionUnknowns",
    "StrainEnergy",
    "StrainPercentile",
    "StressPercentile",
    "WallIntegral",
    "WallPass",
    "mean_depth",
    "patch_pressure",
    "region_volume",
]
