"""The page of a calibration: stiffness factors of a patient's tissues, forces and landmarks."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.report.pages.page import write_page
from ngbrain.report.pictures.style import figure, png, style

UNEXPLAINED = 2.0
"""Ratio of misfit to expected misfit from which the page says that noise does not explain it."""
TICKS = (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0)
MEASURED, COMPUTED = "#D55E00", "#0072B2"


def build(path: str | os.PathLike[str], result: Mapping[str, Any]) -> Path:
    """Write the page of a result of the command `calibrate`.

    Parameters
    ----------
    path : str or path-like
        Output file.
    result : mapping of str to Any
        The result.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    MissingExtra
        matplotlib or jinja2 is not installed.
    """
    return write_page(
        Path(path), "calibration.html", {"found": _plot_factors(result), "fit": _plot_fit(result)}, result=result
    )


def _plot_factors(result: Mapping[str, Any]) -> bytes:
    """Plot the factors and their intervals."""
    with style():
        tissues = result["tissues"]
        height = 0.85 + 0.4 * len(tissues)
        made = figure(height)
        axis = made.add_axes((0.2, 0.72 / height, 0.77, 0.4 * len(tissues) / height))
        for row, of in enumerate(tissues.values()):
            axis.plot([of["low"], of["high"]], [row, row], color=COMPUTED, lw=2.5, solid_capstyle="butt")
            axis.plot(of["value"], row, "o", color=COMPUTED, ms=8)
        axis.axvline(1, color="#4d4d4d", lw=1, ls="--")
        low = 0.9 * min(1.0, *(of["low"] for of in tissues.values()))
        high = 1.1 * max(1.0, *(of["high"] for of in tissues.values()))
        axis.set(xscale="log", xlim=(low, high), ylim=(len(tissues) - 0.5, -0.5))
        axis.set(yticks=range(len(tissues)), yticklabels=list(tissues))
        ticks = [tick for tick in TICKS if low <= tick <= high]
        axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axis.minorticks_off()
        axis.set_xlabel("moduli over those of the scene (dashed: the scene's own)")
        return png(made)


def _plot_fit(result: Mapping[str, Any]) -> bytes:
    """Plot measured and computed force over time and displacements."""
    with style():
        made = figure(3.8)
        force, moved = made.add_axes((0.08, 0.15, 0.4, 0.78)), made.add_axes((0.57, 0.15, 0.41, 0.78))
        measured, computed = (_arrays(result[side]) for side in ("seen", "fitted"))
        force.plot(result["times_s"], computed[0], "o-", color=COMPUTED, ms=6, label="computed")
        force.plot(result["times_s"], measured[0], "x", color=MEASURED, ms=8, mew=2, label="measured")
        force.margins(y=0.08)
        force.set(xlabel="time (s)", ylabel="force of the blade (N)")
        force.set_ylim(bottom=0)
        force.legend(frameon=False)
        if np.any(np.isfinite(measured[1])):
            ends = [least_or_most([measured[1], computed[1]]) for least_or_most in (np.nanmin, np.nanmax)]
            moved.plot(ends, ends, color="#4d4d4d", lw=1, ls="--")
            moved.plot(measured[1], computed[1], ".", color=COMPUTED, ms=6)
        else:
            moved.text(0.5, 0.5, "no landmarks", ha="center", transform=moved.transAxes)
        moved.set(xlabel="measured displacement, each component (mm)", ylabel="computed (mm)")
        return png(made)


def _arrays(side: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Forces, and all displacement components; NaN for missing values."""
    return np.array(side["force_N"], float), np.ravel(np.array(side["displacements_mm"], float))
