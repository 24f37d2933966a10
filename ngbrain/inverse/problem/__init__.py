"""Elastography as an inverse problem: unknown property fields, elements, boundary data and the wave model.

- `boundary_data`: Dirichlet and traction-free parts of the boundary, from the data's `dirichlet` flags.
- `discretisation`: the finite elements in which wave data are inverted: those of the data, or new ones over the same points.
- `field_values`: fields fitted to values that are known at points.
- `label_shares`: fields that are smooth within a label and may jump between labels.
- `properties`: the unknown material properties: start values, bounds and the moduli that they make.
- `property_fields`: the fields of a property: one for all tissue, or one for each label.
- `voxel_lattice`: quadrilaterals or hexahedra over the points of wave data.
- `wave_problem`: the inverse problem of some data: material, wave model and unknowns.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.inverse.problem import (
        boundary_data,
        discretisation,
        field_values,
        label_shares,
        properties,
        property_fields,
        voxel_lattice,
        wave_problem,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "boundary_data",
    "discretisation",
    "field_values",
    "label_shares",
    "properties",
    "property_fields",
    "voxel_lattice",
    "wave_problem",
]
