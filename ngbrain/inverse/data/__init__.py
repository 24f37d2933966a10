"""Wave data before inversion: quality, outliers, plausibility, and direct estimates of stiffness.

- `direct_inversion`: algebraic inversion of the wave equation, and local frequency estimation.
- `dispersion`: whether one modulus fits all frequencies of the data.
- `outliers`: measured displacements that no smooth field explains.
- `plausibility`: whether wavelength and frequency are those of soft tissue, and whether there are enough points for a wave.
- `quality`: noise, strain SNR, distance of a resonance, and resolution of maps.
- `smoothing`: smooth fields through noisy displacements: tensor-product splines and moving least squares.
- `stiffness_maps`: published maps of shear stiffness and damping ratio as complex shear moduli of a head.
- `subset`: a part of wave data with the noise of the whole.
- `time_convention`: whether waves lose energy, as tissue requires; in the convention e^{-iωt} they seem to gain it.
- `ultrasound`: quasi-static data with one component tracked by ultrasound: assumptions and notes.
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
