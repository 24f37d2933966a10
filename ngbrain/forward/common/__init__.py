"""What every problem is posed with.

`kinematics` (space, plane strain, axisymmetric, anti-plane), `material` by region, `dirichlet` conditions and `loads` by boundary,
`regions` (names and patterns), `boundaries` of a mesh, `rigid_motions` that nothing prevents, finite `elements` and the choice of
them (`element_choice`), `unknowns` of a space, `interpolation` at points, the `penalty` of contact, `solve_counts`.
"""

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
    "unknowns",
]
