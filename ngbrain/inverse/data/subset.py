"""A part of wave data with the noise of the whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ngbrain.io.waves import WaveData

Array = np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class WaveSubset(WaveData):
    """Wave data of a part of a body, whose noise is relative to the rms of all data.

    Parameters
    ----------
    of_all : numpy.ndarray
        (loads, 1, dim) rms of all data, m. Other parameters are those of `WaveData`.
    """

    of_all: Array = None  # type: ignore[assignment]

    @property
    def rms(self) -> Array:
        """The rms of all data."""
        return self.of_all
