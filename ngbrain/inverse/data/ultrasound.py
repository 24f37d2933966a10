"""Quasi-static data with one component tracked by ultrasound, from tissue that a probe compresses: assumptions and notes.

The window is cut out of a larger body in space. Its rim moves as measured within errors; the other component and tractions
are unknown. Tracking errors are correlated over a grain of speckle, and a plane is no model of a body in space. Weights by
the evidence would take both for details of tissue. So the error counts as `MODEL_ERROR` at least, and fields are piecewise
constant.
"""

from __future__ import annotations

import numpy as np

from ngbrain.errors import NgbrainError
from ngbrain.inverse.data.smoothing import fit_smooth_field
from ngbrain.io.waves import WaveData

Array = np.ndarray
MODEL_ERROR = 0.1
"""Least error, relative to the rms of the displacement without rigid motion. From .06 to .12 the contrast of a cylinder that
is three times as stiff falls by .07, of a ball by .2 (two seeds of grain), and the variation of a phantom's background falls
from 66 to 13 %."""
COARSER, FEWEST = 2, 8
"""Points along each axis for each node of the elements, and the fewest elements along an axis."""
END = 0.25
"""Share of the depth at either end where strain and modulus are compared."""
BALL = 1.25
"""By Eshelby, the strain in a ball equals that in a cylinder whose contrast minus 1 is smaller by this factor."""


def is_tracked(data: WaveData) -> bool:
    """Whether data are plane and quasi-static, with a component that no load measures."""
    counts = np.isfinite(data.displacement[:, data.mask])
    return (
        data.dim == 2 and data.motion == "in_plane" and not data.frequency.any() and not counts.any(axis=(0, 1)).all()
    )


def minimum_model_error(data: WaveData) -> float:
    """Return `MODEL_ERROR` relative to the rms of the displacement with its rigid motion, as noise is; the largest of the loads."""
    axis = _axis(data)
    found = []
    for u, rms in zip(data.displacement[:, :, axis].real, data.rms[:, 0, axis], strict=True):
        known = data.mask & np.isfinite(u)
        if known.any():
            rigid = np.column_stack([np.ones(known.sum()), data.points[known, 1 - axis]])
            left = u[known] - rigid @ np.linalg.lstsq(rigid, u[known], rcond=None)[0]
            found.append(MODEL_ERROR * float(np.sqrt(np.mean(left**2))) / rms)
    return max(found)


def error_note() -> str:
    """Return a note on the assumed `MODEL_ERROR`."""
    return (
        f"one component at rest: {100 * MODEL_ERROR:g} % of the displacement without rigid motion counts as error, as a plane is "
        "no model of a body in space and errors of tracking are correlated over a grain of speckle; model_error overrides this"
    )


def map_notes(data: WaveData, youngs: Array) -> list[str]:
    """Return notes on a map of such data.

    Parameters
    ----------
    data : WaveData
        The data.
    youngs : numpy.ndarray
        (n,) Young's modulus, Pa.

    Returns
    -------
    list of str
        The notes.
    """
    notes = [
        "what is stiff is taken as a cylinder through the plane; the contrast of a ball reads low: where the map has r times the "
        f"surroundings, a ball has 1 + {BALL:g} (r - 1) times",
    ]
    try:
        axis = _axis(data)
        strain = np.nanmean(np.abs(fit_smooth_field(data).gradient()[:, :, axis, axis].real), axis=0)
    except NgbrainError:
        return notes
    depth = data.points[:, axis]
    low, high = np.quantile(depth[data.mask], [END, 1 - END])
    first, last = data.mask & (depth < low), data.mask & (depth > high)
    fall, rise = (float(np.nanmedian(values[first]) / np.nanmedian(values[last])) for values in (strain, youngs))
    least, most = min(1.0, 1 / fall, rise), max(1.0, 1 / fall, rise)
    return [
        *notes,
        f"trend along the beam: strain at small {'xy'[axis]} is {fall:.2g} times that at large. Stress that decays in uniform "
        "tissue and tissue that stiffens fit alike, so that its modulus there may be anything from "
        f"{least:.2g} to {most:.2g} times the other end's. The map's {rise:.2g} is the regulariser's choice; two loads narrow it",
    ]


def _axis(data: WaveData) -> int:
    """The measured component."""
    return int(np.argmax(np.isfinite(data.displacement[:, data.mask]).sum(axis=(0, 1))))
