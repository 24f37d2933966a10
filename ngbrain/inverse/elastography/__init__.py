"""Elastography: property maps from wave data by one call, and what can be said of them.

- `assembly`: the assembly of an inversion's result: checks and notes.
- `derived_maps`: maps derived from G*, statistics by label, errors against the truth.
- `each_frequency`: each frequency of the data inverted by itself.
- `identifiability`: what waves cannot determine, as notes on the maps.
- `initial_guess`: start values from given maps, and the comparison of several starts.
- `inverse_crime`: whether data were computed in the elements that invert them.
- `invert`: the inversion of wave data; it chooses noise, elements, starts, regularisers and weights.
- `invert_3d`: the inversion of wave data in space.
- `invert_slices`: slabs with motion through their slices alone, slice by slice as anti-plane shear.
- `result`: the result of an inversion.
- `usability`: reasons against the use of maps.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.inverse.elastography import (
        assembly,
        derived_maps,
        each_frequency,
        identifiability,
        initial_guess,
        inverse_crime,
        invert,
        invert_3d,
        invert_slices,
        result,
        usability,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "assembly",
    "derived_maps",
    "each_frequency",
    "identifiability",
    "initial_guess",
    "inverse_crime",
    "invert",
    "invert_3d",
    "invert_slices",
    "result",
    "usability",
]
