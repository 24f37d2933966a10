"""Optimisers of a reduced objective, and how the regularisation weight is chosen.

- `fingerprint`: What tells one inversion's problem from another, part by part: a checkpoint is of use for its own
  alone.
- `gauss_newton`: Gauss-Newton inversion of plane problems: every step by one factorisation of the optimality
  conditions.
- `gauss_newton_cg`: Gauss-Newton inversion of problems in space: every step by preconditioned conjugate gradients,
  with a checkpoint.
- `gauss_newton_hessian`: The Gauss-Newton matrix H = JᵀWJ + Σ αR of any model, known by its products, and the metric
  that makes them few.
- `kkt`: One Gauss-Newton step with waves and fields as unknowns together, by one sparse factorisation.
- `levenberg_marquardt`: Levenberg's and Marquardt's steps on the reduced objective: Gauss-Newton with a damping that
  its own success steers.
- `normal_equations`: One Gauss-Newton step in the fields alone, by conjugate gradients: for problems in space, whose
  factors fill the memory.
- `preconditioners`: What Gauss-Newton steps in space are preconditioned with, block by block.
- `quasi_newton`: BFGS, L-BFGS and Newton-CG on the reduced objective: an inversion by values, gradients and products
  alone.
- `regularisation_weight`: How strongly regularisers weigh against data: chosen by what the data determine.
- `result`: Where an inversion ended and how it went there, the same for all ways of going.
- `weight_selection`: How an inversion comes to its weights: they settle with the fields, or a curve is drawn and its
  corner taken.
"""

__all__ = [
    "fingerprint",
    "gauss_newton",
    "gauss_newton_cg",
    "gauss_newton_hessian",
    "kkt",
    "levenberg_marquardt",
    "normal_equations",
    "preconditioners",
    "quasi_newton",
    "regularisation_weight",
    "result",
    "weight_selection",
]
