"""Training data, and wave data on rasters.

- `dataset`: training data: squares of random stiffness with computed waves or compression, each from its own seed
- `random_fields`: families of random stiffness maps on the unit square
- `raster`: plane data on a raster of square cells, and its partition into squares
- `residual`: residuals of the equations of motion for predicted maps
- `ultrasound_window`: windows of larger bodies, as seen by an ultrasound probe
"""

__all__ = ["dataset", "random_fields", "raster", "residual", "ultrasound_window"]
