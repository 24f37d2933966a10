"""Training data, and wave data on rasters.

- `dataset`: training data: squares of random stiffness with computed waves or compression, each from its own seed
- `random_fields`: families of random stiffness maps on the unit square
- `raster`: plane data on a raster of square cells, and its partition into squares
- `residual`: residuals of the equations of motion for predicted maps
- `ultrasound_window`: windows of larger bodies, as seen by an ultrasound probe
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.surrogate.data import dataset, random_fields, raster, residual, ultrasound_window
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["dataset", "random_fields", "raster", "residual", "ultrasound_window"]
