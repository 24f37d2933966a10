"""A label map as functions in space.

- `indicators`: smooth indicator functions of the labels, whose interfaces a mesh follows.
- `sampling`: sample points on interfaces and inside regions, spaced by a size field.
- `volume_fractions`: fast interpolation of volume fractions and their gradients.
- `volume_zones`: zones in which the regions' volumes are matched: the whole mesh, or its refined part and the rest.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.mesh.labels import indicators, sampling, volume_fractions, volume_zones
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = ["indicators", "sampling", "volume_fractions", "volume_zones"]
