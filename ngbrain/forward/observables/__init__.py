"""What is asked of a problem's state: numbers with a unit, and how they change with the unknowns.

`base` has the interface, `Observable` of any problem and `Observed` of one. `points`: `Displacements`, `SolutionUnknowns`; `force`:
`Force`, `Moment`; `integrals`: `Functional`, any integral of the state, `StrainEnergy`, `region_volume`; `percentiles`:
`StrainPercentile`, `StressPercentile`; `ratio`: `Ratio`; `wall`, of what rigid bodies press: `patch_pressure`, `NormalForce`,
`ContactForce`, `ContactArea`, `CurrentArea`, `PatchDisplacement`, `mean_depth`, each on a `Patch` or several; a user's own is a
`WallIntegral`, and a `WallPass` evaluates many at once.

    Force("top", (0, 0, 1)).value(problem)                     where it stands, or at a `State`
    StrainPercentile(95, band=0.05).gradient(problem)          by all unknowns

Dose, time above a threshold, amplitude and phase are made of what models show: `ngbrain.adjoint.derived`.

One of a user's own is a class with `name`, `unit` and `on`; where it is an integral, `Functional` is all it takes.
"""

from ngbrain.forward.observables.base import Observable, Observed
from ngbrain.forward.observables.force import Force, Moment
from ngbrain.forward.observables.integrals import Functional, StrainEnergy, region_volume
from ngbrain.forward.observables.percentiles import StrainPercentile, StressPercentile
from ngbrain.forward.observables.points import Displacements, SolutionUnknowns
from ngbrain.forward.observables.ratio import Ratio
from ngbrain.forward.observables.wall import (
    ContactArea,
    ContactForce,
    CurrentArea,
    NormalForce,
    Patch,
    PatchDisplacement,
    WallIntegral,
    WallPass,
    mean_depth,
    patch_pressure,
)

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
    "Observed",
    "Patch",
    "PatchDisplacement",
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
