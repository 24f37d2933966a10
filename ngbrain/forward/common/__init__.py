"""What all problems share.

`kinematics` (3-D, plane strain, axisymmetric, anti-plane), `material` of a region, `dirichlet` conditions, `loads`, `regions`
(names and patterns), `boundaries` of a mesh, `rigid_motions` that no support prevents, `elements` (finite elements, inf-sup
test) and `element_choice`, `unknowns` and `state` of a problem, `interpolation` at points, `penalty` of contact, `solve_counts`.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.forward.common import (
        boundaries,
        dirichlet,
        element_choice,
        elements,
        interpolation,
        kinematics,
        loads,
        material,
        penalty,
        regions,
        rigid_motions,
        solve_counts,
        state,
        unknowns,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "boundaries",
    "dirichlet",
    "element_choice",
    "elements",
    "interpolation",
    "kinematics",
    "loads",
    "material",
    "penalty",
    "regions",
    "rigid_motions",
    "solve_counts",
    "state",
    "unknowns",
]
