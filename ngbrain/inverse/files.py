"""What an inversion leaves behind: result.json, maps.npz, and images on the grid of the data's own image."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.inverse.inversion import Inversion
from ngbrain.inverse.uncertainty import Uncertainty
from ngbrain.io.json_file import write_json
from ngbrain.io.waves import write_map
from ngbrain.io.whole import whole

IMAGES = ("magnitude", "phase", "damping_ratio", "stiffness")
"""Written as images beside the parameters, where the data came from one."""


def write_inversion(
    folder: Path, inversion: Inversion, bars: Uncertainty | None = None, **of_the_run: Any
) -> dict[str, Any]:
    """Write the files into a folder that is there; returns the result, of which result.json is the last to be written.

    bars         error bars: `Uncertainty.arrays` go into maps.npz, its `result` is the result's `error_bars`
    of_the_run   more entries of the result, such as verb, versions, threads, time_s

    maps.npz has `Inversion.arrays`; NAME.nii.gz are written for data from an image.

    Raises `MissingExtra` for images without nibabel, `OSError` when the disk is full or the folder not writable.
    """
    arrays = inversion.arrays() | (bars.arrays() if bars else {})
    whole(folder / "maps.npz", lambda part: np.savez_compressed(part, **arrays))  # type: ignore[arg-type]
    names = (*inversion.maps, *IMAGES) if inversion.data.affine is not None else ()
    for name in names:
        write_map(folder / f"{name}.nii.gz", inversion.data, arrays[name])
    files = ["maps.npz", *(f"{name}.nii.gz" for name in names), "result.json"]
    told = {"error_bars": bars.result()} if bars else {}
    result: dict[str, Any] = finite({**of_the_run, **inversion.result(), **told, "files": files})
    write_json(folder / "result.json", result)
    return result


def finite(value: Any) -> Any:
    """The same with None for numbers that JSON has no word for, and text for keys.

    >>> finite({1: [2.0, float("nan")]})
    {'1': [2.0, None]}
    """
    if isinstance(value, dict):
        return {str(key): finite(each) for key, each in value.items()}
    if isinstance(value, list):
        return [finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
