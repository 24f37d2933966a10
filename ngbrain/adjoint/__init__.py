"""Derivatives and inverse problems: the reduced objective, and verification of derivatives.

- objective of an inversion as a function of its unknowns: `Reduced` of a `Model`, a `Misfit`, `Unknowns` and a `Regulariser`;
  `Point` is the objective at given unknowns
- quantities derived from a model's data, as models: `Derived` with `Amplitude`, `Phase`, `Dose`, `TimeAbove`, or a
  `DerivedQuantity` of your own
- a quantity over time, its integral, time above a threshold and their derivatives: `TimeCurve`
- verification of derivatives: `taylor` (Taylor remainder test), `dot` (dot-product test)

Modules
-------
- `reduced`, `derived`, `derived_quantity`, `time_curve`, `check`
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.adjoint import check, derived, derived_quantity, reduced, time_curve
    from ngbrain.adjoint.check import dot, taylor
    from ngbrain.adjoint.derived import Amplitude, Derived, Dose, Phase, TimeAbove
    from ngbrain.adjoint.derived_quantity import DerivedQuantity
    from ngbrain.adjoint.reduced import Misfit, Model, Point, Reduced, Regulariser, Unknowns
    from ngbrain.adjoint.time_curve import TimeCurve
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "Amplitude",
    "Derived",
    "DerivedQuantity",
    "Dose",
    "Misfit",
    "Model",
    "Phase",
    "Point",
    "Reduced",
    "Regulariser",
    "TimeAbove",
    "TimeCurve",
    "Unknowns",
    "check",
    "derived",
    "derived_quantity",
    "dot",
    "reduced",
    "taylor",
    "time_curve",
]
