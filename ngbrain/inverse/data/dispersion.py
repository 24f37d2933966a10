"""Whether one modulus fits all frequencies of the data: the estimates of each frequency, compared part by part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ngbrain.errors import NgbrainError
from ngbrain.inverse.data.direct_inversion import local_moduli, split_points
from ngbrain.io.waves import WaveData

FACTOR, SURE = 1.35, 4.0
"""Moduli of two frequencies contradict each other where they differ by this factor, and by so many standard errors of the
parts."""


def contradiction(data: WaveData) -> str:
    """Return a description of how moduli at the lowest and the highest frequency differ; empty where one modulus may fit both.

    Each part of the points is compared with itself, so that variation in space does not count. The moduli are those of
    `local_moduli`. Noise makes them too small, and coarse points too large. So only a factor of `FACTOR` counts as a
    contradiction.

    Examples
    --------
    >>> grid = np.array([[x, y] for y in range(24) for x in range(24)]) * 3e-3
    >>> def waves(*moduli):
    ...     k = [2 * np.pi * f * np.sqrt(1000 / G) for f, G in zip((40, 60), moduli)]
    ...     u = [np.stack([np.exp(-1j * q * grid[:, 1]), np.exp(-1j * q * grid[:, 0])], axis=1) for q in k]
    ...     return WaveData(grid, 1e-5 * np.stack(u), [40.0, 60.0], 1000.0, "isotropic", "viscoelastic", poisson=0.4)
    >>> contradiction(waves(2500 + 500j, 2500 + 500j))
    ''
    >>> contradiction(waves(2000 + 400j, 4000 + 800j))
    '2 kPa at 40 Hz, 4.1 kPa at 60 Hz'
    """
    each = np.unique(data.frequency[data.frequency > 0])
    if len(each) < 2:
        return ""
    low, high = (data.frequency == f for f in (each[0], each[-1]))
    try:
        moduli = [
            np.log(
                np.abs(local_moduli(replace(data, displacement=data.displacement[own], frequency=data.frequency[own])))
            )
            for own in (low, high)
        ]
    except NgbrainError:  # too few points for a smooth field
        return ""
    known = data.mask & np.isfinite(moduli).all(axis=0)
    if known.sum() < 2:
        return ""
    medians = np.array(
        [[np.median(values[known][part]) for values in moduli] for part in split_points(data.points[known])]
    )
    change = medians[:, 1] - medians[:, 0]
    error = change.std(ddof=1) / np.sqrt(len(change)) if len(change) > 1 else np.inf
    if abs(change.mean()) < max(np.log(FACTOR), SURE * error):
        return ""
    pairs = zip(np.exp(medians.mean(axis=0)) / 1e3, (each[0], each[-1]), strict=True)
    return ", ".join(f"{modulus:.2g} kPa at {frequency:g} Hz" for modulus, frequency in pairs)
