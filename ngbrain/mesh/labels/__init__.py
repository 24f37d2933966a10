"""A label map as functions in space: indicators, volume fractions, points where regions meet.

- `indicators`: A map of labels as smooth functions: what a mesh of tissues follows, and is measured against.
- `sampling`: Points to mesh regions with: on where regions meet and inside them, as far apart as a size field asks.
- `volume_fractions`: The shares of regions around many points at once, and their slopes.
- `volume_zones`: Where regions are to have their volumes each for itself: all of a mesh, or its fine part and the
  rest.
"""

__all__ = ["indicators", "sampling", "volume_fractions", "volume_zones"]
