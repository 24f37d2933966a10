"""The one nonlinear solid.

`problem` (`Problem`: spaces, residual, tangent); what it is made of: `tissue` with its `internal_forces` and `internal_variables`,
`inertia`; its `tangent`, and the `reactions` of its supports.
"""

__all__ = [
    "assembled",
    "inertia",
    "internal_forces",
    "internal_variables",
    "problem",
    "reactions",
    "tangent",
    "time_steps",
    "tissue",
]
