"""How runs change with parameters.

`run_model` and its products, `replayed`, over a `replay` on a fixed grid of times with its `tangents`; one time `step` and its
derivatives (`step_hessian`, `step_turned`, `step_shape`, `maxwell_step`), as `quadrature_blocks`; `friction_step` and
`inertia_step` of what rubs and has mass; `run_observables`, what is seen at the end of a step.
"""

__all__ = [
    "friction_step",
    "inertia_step",
    "maxwell_step",
    "quadrature_blocks",
    "replay",
    "replayed",
    "run_model",
    "run_observables",
    "step",
    "step_hessian",
    "step_shape",
    "step_turned",
    "tangents",
]
