"""The one nonlinear solid, and one step of it.

`problem` (`Problem`: residual and tangent) is built on its `discretisation`, the `reactions` of its supports and what is `stepped`
in time. Its parts: `tissue` with `internal_forces` and `internal_variables`, `inertia`, what is `applied` (contacts and loads), and
the factorised `tangent`. `advance` makes a step; load paths, time stepping and replays are controllers over it.
"""

__all__ = [
    "advance",
    "applied",
    "discretisation",
    "inertia",
    "internal_forces",
    "internal_variables",
    "problem",
    "reactions",
    "stepped",
    "tangent",
    "tissue",
]
