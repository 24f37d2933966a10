"""Training data, and wave data on rasters.

- `dataset`: Data to learn from: squares with random stiffness, their waves or compression computed, each sample from
  a seed of its own.
- `random_fields`: Families of stiffness maps on the unit square: moduli relative to a background of about 1, drawn at
  random.
- `raster`: Plane data on a raster of square cells, and the squares of it that an operator looks at.
- `residual`: Whether maps hold for the displacements they were made of: the equations of motion, asked without
  knowing the truth.
- `ultrasound_window`: A window that is cut out of a larger body at rest, as an ultrasound probe sees it, for the
  operator of compression.
"""

__all__ = ["dataset", "random_fields", "raster", "residual", "ultrasound_window"]
