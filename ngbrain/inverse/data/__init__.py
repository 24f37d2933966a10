"""Wave data before inversion: quality, outliers, plausibility, and direct estimates of stiffness.

- `direct_inversion`: algebraic inversion of the wave equation, and local frequency estimation.
- `dispersion`: whether one modulus fits all frequencies of the data.
- `moving_least_squares`: smooth fields through scattered points.
- `outliers`: measured displacements that no smooth field explains.
- `plausibility`: whether wavelength and frequency are those of soft tissue, and whether there are enough points for a wave.
- `quality`: noise, strain SNR, distance of a resonance, and resolution of maps.
- `smooth_field`: a smooth displacement field with its derivatives.
- `smoothing`: smooth fields through noisy displacements: tensor-product splines on grids, else moving least squares.
- `stiffness_maps`: published maps of shear stiffness and damping ratio as complex shear moduli of a head.
- `subset`: a part of wave data with the noise of the whole.
- `time_convention`: whether waves lose energy, as tissue requires; in the convention e^{-iωt} they seem to gain it.
- `ultrasound`: quasi-static data with one component tracked by ultrasound: assumptions and notes.
"""

from typing import TYPE_CHECKING

from ngbrain.lazy import lazy_names

if TYPE_CHECKING:
    from ngbrain.inverse.data import (
        direct_inversion,
        dispersion,
        moving_least_squares,
        outliers,
        plausibility,
        quality,
        smooth_field,
        smoothing,
        stiffness_maps,
        subset,
        time_convention,
        ultrasound,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "direct_inversion",
    "dispersion",
    "moving_least_squares",
    "outliers",
    "plausibility",
    "quality",
    "smooth_field",
    "smoothing",
    "stiffness_maps",
    "subset",
    "time_convention",
    "ultrasound",
]
