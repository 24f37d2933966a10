"""Derivatives of time-dependent runs with respect to parameters.

- `run_model`: `RunModel`, from parameters to observables over time.
- `run_linearisation`: the run at one θ, with tangent-linear, adjoint and second-order products.
- `replay`: the run on a fixed time grid, with checkpoints.
- `run_observables`: observables at the end of a time step and their derivatives.
- `step`: first derivatives of one time step of the tissue.
- `step_hessian`: second derivatives of one time step; those of the tissue are in `tissue_hessian`.
- `step_shape`: derivatives of one time step with respect to node positions.
- `maxwell_step`: one time step of a nonlinear Maxwell branch.
- `friction_step`, `inertia_step`: what friction and inertia add to a time step.
- `tangents`: solves with the tangent of each step and with its transpose.
- `quadrature_blocks`: variables and functions at quadrature points.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.forward.sensitivity.transient import (
        friction_step,
        inertia_step,
        maxwell_step,
        quadrature_blocks,
        replay,
        run_linearisation,
        run_model,
        run_observables,
        step,
        step_hessian,
        step_shape,
        tangents,
        tissue_hessian,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "friction_step",
    "inertia_step",
    "maxwell_step",
    "quadrature_blocks",
    "replay",
    "run_linearisation",
    "run_model",
    "run_observables",
    "step",
    "step_hessian",
    "step_shape",
    "tangents",
    "tissue_hessian",
]
