"""Derivatives and inverse problems: the reduced objective, and verification of derivatives.

`reduced`
    Objective of an inversion as a function of its unknowns: `Model`, `Misfit`, `Unknowns`, `Regulariser`, `Reduced`, `Point`.
`derived`
    Quantities derived from a model's data, as models: `Derived` with `Amplitude`, `Phase`, `Dose`, `TimeAbove`.
`derived_quantity`
    Interface `DerivedQuantity`, for quantities of your own.
`time_curve`
    A quantity over time: integral, time above a threshold, their derivatives.
`check`
    Taylor remainder test (`taylor`) and dot-product test (`dot`).
"""

__all__ = ["check", "derived", "derived_quantity", "reduced", "time_curve"]
