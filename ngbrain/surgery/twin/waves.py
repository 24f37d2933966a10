"""A map of |G*| with its error from an inversion of waves."""

from __future__ import annotations

import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.read.volume import Volume
from ngbrain.inverse.elastography.result import Inversion
from ngbrain.inverse.uncertainty.credible_maps import uncertainty
from ngbrain.io.waves import WaveData
from ngbrain.surgery.twin.stiffness import LEAST_DEVIATION, MeasuredMap

WITHOUT_BARS = 0.2
"""Standard deviation of ln |G*| of an inversion that has no error bars."""


def map_from_inversion(found: Inversion) -> MeasuredMap:
    """The map of an inversion, with the standard deviation of its posterior.

    Parameters
    ----------
    found : Inversion
        Of waves in space, on a grid in the head's own axes.

    Returns
    -------
    MeasuredMap

    Raises
    ------
    InputError
        Waves in a plane, on scattered points, of no frequency or of several.
    """
    data = found.data
    frequencies = sorted(set(data.frequency.tolist()))
    if len(frequencies) != 1 or frequencies[0] <= 0:
        listed = ", ".join(f"{each:g}" for each in frequencies)
        raise InputError("stiffness.waves", f"at {listed} Hz", "waves of one frequency")
    modulus = np.hypot(found.maps["storage"], found.maps.get("loss", 0.0))
    try:
        drawn = uncertainty(found).draws()
        inside = np.log(np.hypot(drawn["storage"], drawn.get("loss", 0.0))).std(axis=0)
        deviation, bars = np.full(len(modulus), np.nan), "with its posterior's standard deviation"
        deviation[~np.isnan(modulus)] = np.maximum(inside, LEAST_DEVIATION)
    except InputError:  # zones and slices have no posterior
        deviation = np.where(np.isnan(modulus), np.nan, WITHOUT_BARS)
        bars = f"without error bars: {WITHOUT_BARS:.0%} assumed"
    affine = grid_affine(data)
    assert data.grid is not None
    boxes = [Volume(data.grid.box(each), affine) for each in (modulus, deviation)]
    note = f"an inversion of waves at {frequencies[0]:g} Hz, {bars}"
    return MeasuredMap(boxes[0], boxes[1], frequencies[0], note)


def grid_affine(data: WaveData) -> np.ndarray:
    """Affine (4, 4) from indices of the points' grid to m; raises `InputError` for other points than those of a grid in space."""
    if data.dim != 3 or data.grid is None:
        wanted = "waves on a grid in space, in the head's own axes"
        raise InputError("stiffness.waves", "in a plane" if data.dim != 3 else "on scattered points", wanted)
    found = np.eye(4)
    found[:3, :3] = (data.grid.axes * data.grid.spacing[:, None]).T
    found[:3, 3] = data.grid.origin
    return found
