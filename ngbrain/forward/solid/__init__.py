"""The nonlinear solid, and one step of it.

`problem` (`Problem`: residual and tangent) is built on its `discretisation`, the `reactions` of its supports and its states
(`stateful`). Its terms are `tissue` with `internal_forces` and `internal_variables`, `inertia`, and `external_loads` (contacts and
loads); `tangent` is the factorised tangent. `virtual_work` has the virtual work as symbolic expressions, for derivatives.
`advance` makes one step; load paths, time stepping and replays are controllers of it.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.forward.solid import (
        advance,
        discretisation,
        external_loads,
        inertia,
        internal_forces,
        internal_variables,
        problem,
        reactions,
        stateful,
        tangent,
        tissue,
        virtual_work,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

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
