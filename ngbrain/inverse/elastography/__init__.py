"""Property maps from wave data, by one call; what is said of them.

- `derived_maps`: What an inversion answers: maps of what follows from G*, medians by label, errors against the truth.
- `each_frequency`: Wave data of several frequencies, each inverted by itself: moduli as they are at that frequency,
  without a law between them.
- `identifiability`: What waves cannot tell, whatever is done with them, and what the answer therefore rests on:
  sentences for its notes.
- `initial_guess`: Where an inversion starts: from maps that are given, or from several places, whose ends are
  compared at equal weights.
- `inverse_crime`: The inverse crime: data computed with the very mesh and elements that they are inverted with
  flatter every method.
- `invert`: The inversion of wave data from one call: noise, elements, starts, regularisers and weights are chosen and
  told.
- `invert_3d`: The inversion of wave data in space from one call.
- `invert_slices`: Slabs of which only the motion through their slices was measured: each slice by itself, as anti-
  plane shear.
- `result`: What an inversion found, and what there is to say of it.
- `usability`: Whether maps of an inversion can be used at all: reasons against them, from the misfit and from the
  numbers themselves.
"""

__all__ = [
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
