"""Optimisers of a reduced objective, and selection of the regularisation weights.

Optimisers

- `gauss_newton`: Gauss-Newton inversion of plane wave problems; every step is one factorisation of the optimality conditions.
- `gauss_newton_cg`: Gauss-Newton inversion of 3-D wave problems by preconditioned conjugate gradients, with checkpoints.
- `levenberg_marquardt`: Levenberg-Marquardt for any model.
- `quasi_newton`: BFGS, L-BFGS and Newton-CG for any model.
- `result`: Result and iteration log that all optimisers share.

Parts of a Gauss-Newton step

- `kkt`: Optimality conditions with waves and fields as unknowns, factorised (plane problems).
- `normal_equations`: Normal equations in the fields alone, by conjugate gradients (3-D problems).
- `preconditioners`: Preconditioners of the normal equations, block by block.
- `gauss_newton_hessian`: Gauss-Newton Hessian JᵀWJ + Σ αR of any model by its products, and the metric of the regularisers.

Regularisation weights and checkpoints

- `regularisation_weight`: Weight policies: evidence maximisation, discrepancy principle, fixed weights; corner of an L-curve.
- `weight_selection`: How an inversion selects its weights: by a policy during the descent, or from an L-curve.
- `fingerprint`: Fingerprint of an inverse problem, by which a checkpoint is matched to its problem.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.inverse.optimise import (
        fingerprint,
        gauss_newton,
        gauss_newton_cg,
        gauss_newton_hessian,
        kkt,
        levenberg_marquardt,
        normal_equations,
        preconditioners,
        quasi_newton,
        regularisation_weight,
        result,
        weight_selection,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

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
