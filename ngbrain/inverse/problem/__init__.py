"""Elastography as an inverse problem: which fields are unknown, in which elements, driven by which data.

- `boundary_data`: Which part of a body's boundary measured displacements drive, and which is free of forces, as the
  data's `dirichlet` says.
- `discretisation`: Which elements wave data are inverted in: those they were made in, or our own over the same
  points.
- `field_values`: Nodal values of unknown fields from values at points, and where these are known.
- `label_shares`: Fields that are smooth inside a label and free to jump between labels, on meshes that know nothing
  of the labels.
- `properties`: The quantities that are looked for in a material: where they start, between which bounds, and the
  modulus that they make.
- `property_fields`: What a property is made of: one field over all tissue, or one for each label.
- `voxel_lattice`: Quadrilaterals or hexahedra over the points of wave data, faces along the coordinates; in space as
  large as the waves allow.
- `wave_problem`: From wave data to a problem: which fields a material has, the model that predicts the waves, and
  what is unknown in it.
"""

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
