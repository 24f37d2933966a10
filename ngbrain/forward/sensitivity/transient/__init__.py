"""How runs change with parameters.

`run_model` over a `replay` on a fixed grid of times with its `tangents`; one time `step` and its derivatives (`step_hessian`,
`step_turned`, `step_shape`, `maxwell_step`), as `quadrature_blocks`.
"""

__all__ = [
    "maxwell_step",
    "quadrature_blocks",
    "replay",
    "run_model",
    "step",
    "step_hessian",
    "step_shape",
    "step_turned",
    "tangents",
]
