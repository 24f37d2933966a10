"""Wave data before they are inverted: quality, outliers, plausibility, and estimates straight from the waves.

- `direct_inversion`: Stiffness straight from the waves: algebraic inversion of the wave equation, and local
  frequency.
- `dispersion`: Whether one modulus can serve all frequencies of the data: what each frequency suggests by itself,
  compared place by place.
- `outliers`: Measured displacements that no smooth field explains.
- `plausibility`: Whether waves can be those of soft tissue: the stiffness that their length and frequency mean, and
  the points along a wave.
- `quality`: What wave data are good for, in numbers: strain over noise, nearness of a resonance, and how fine a map
  they determine.
- `smoothing`: Smooth fields through noisy displacements: tensor-product splines on grids, moving least squares
  through scattered points.
- `stiffness_maps`: Published maps of shear stiffness and damping ratio as complex shear moduli of a head: the truth
  of in-silico experiments.
- `subset`: A part of wave data that knows the noise of the whole.
- `time_convention`: Whether waves lose energy, as those of tissue do: in the other time convention, e^{-iωt}, they
  seem to gain it.
- `ultrasound`: Tissue at rest that a probe presses, one component of its displacement tracked by ultrasound: what is
  assumed, and said.
"""

__all__ = [
    "direct_inversion",
    "dispersion",
    "outliers",
    "plausibility",
    "quality",
    "smoothing",
    "stiffness_maps",
    "subset",
    "time_convention",
    "ultrasound",
]
