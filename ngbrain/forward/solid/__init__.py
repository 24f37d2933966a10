"""The one nonlinear solid, and one step of it.

`problem` (`Problem`: residual and tangent) is built on its `discretisation`, the `reactions` of its supports and its states
(`stateful`). Its parts: `tissue` with `internal_forces` and `internal_variables`, `inertia`, `external_loads` (contacts and loads)
and the factorised `tangent`. `virtual_work` has its work as expressions to be differentiated. `advance` makes a step; load paths,
time stepping and replays are controllers over it.
"""

__all__ = [
    "advance",
    "discretisation",
    "external_loads",
    "inertia",
    "internal_forces",
    "internal_variables",
    "problem",
    "reactions",
    "stateful",
    "tangent",
    "tissue",
    "virtual_work",
]
