"""The files of an inversion: result.json, maps.npz, and images on the grid of the data's image."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.atomic import atomic_write
from ngbrain.inverse.elastography.result import Inversion
from ngbrain.inverse.uncertainty.credible_maps import Uncertainty
from ngbrain.io.json_file import write_json
from ngbrain.io.waves import WaveData, write_map
from ngbrain.report.pages.parameters import PARAMETERS
from ngbrain.workflows.bids import write_derivative


def write_inversion(
    folder: Path, inversion: Inversion, bars: Uncertainty | None = None, subject: str = "", **of_the_run: Any
) -> dict[str, Any]:
    """Write the files of an inversion into an existing folder; result.json is the last one.

    maps.npz has `Inversion.arrays`; NAME.nii.gz are written for data from an image.

    Parameters
    ----------
    folder : Path
    inversion : Inversion
    bars : Uncertainty, optional
        Error bars: their arrays go into maps.npz, their `result` is the result's `error_bars`.
    subject : str, optional
        Subject of a BIDS derivative dataset that the images are copied into (`ngbrain.workflows.bids`).
    **of_the_run
        Further entries of the result, such as verb, versions, threads, time_s.

    Returns
    -------
    dict
        The result.

    Raises
    ------
    MissingExtra
        Images without nibabel.
    OSError
        The disk is full or the folder not writable.
    """
    bands = bars.arrays() if bars else {}
    arrays = inversion.arrays() | bands
    images = *inversion.maps, *inversion.derived_maps, *bands, "oss", "oss_snr"
    told = {"error_bars": bars.result()} if bars else {}
    return write_maps(folder, inversion.data, arrays, images, {**of_the_run, **inversion.to_dict(), **told}, subject)


def write_maps(
    folder: Path,
    data: WaveData,
    arrays: Mapping[str, np.ndarray],
    images: Sequence[str],
    result: Mapping[str, Any],
    subject: str = "",
) -> dict[str, Any]:
    """Write arrays as maps.npz, images as NAME.nii.gz where the data came from one, and result.json last.

    Parameters
    ----------
    folder : Path
    data : WaveData
    arrays : mapping of array
    images : sequence of str
        Names of the arrays that are images.
    result : mapping
    subject : str, optional
        As in `write_inversion`.

    Returns
    -------
    dict
        The result with the names of the files. Errors as for `write_inversion`.
    """
    atomic_write(folder / "maps.npz", lambda part: np.savez_compressed(part, **arrays))  # type: ignore[arg-type]
    names = images if data.affine is not None else ()
    for name in names:
        about, unit = describe_map(name)
        write_map(folder / f"{name}.nii.gz", data, arrays[name].T, about, unit)  # loads, if there are some, last
        sidecar = {"LongName": about, "Units": unit or "1", "Sources": [str(result.get("source", ""))]}
        settings = {"SoftwareName": "ngbrain", "Settings": {"model": result.get("model", {})}}
        write_json(folder / f"{name}.json", finite({**sidecar, **settings}))
    files = ["maps.npz", *(f"{name}{kind}" for name in names for kind in (".nii.gz", ".json")), "result.json"]
    if subject:
        files += write_derivative(folder, names, subject)
    written: dict[str, Any] = finite({**result, "files": files})
    write_json(folder / "result.json", written)
    return written


def describe_map(name: str) -> tuple[str, str]:
    """What a map is, and the unit of its values in files (SI).

    Examples
    --------
    >>> describe_map("storage"), describe_map("loss_low"), describe_map("damping_ratio")
    (('Storage modulus', 'Pa'), ('Loss modulus, lower end of the 95 % interval', 'Pa'), ('Damping ratio', ''))
    """
    ends = {
        "_low": "lower end of the 95 % interval",
        "_high": "upper end of the 95 % interval",
        "_deviation": "standard deviation",
    }
    end = next((end for end in ends if name.endswith(end)), "")
    label = PARAMETERS.get(name.removesuffix(end) if end else name)
    if label is None:
        return name.replace("_", " "), ""
    return label.name + (
        f", {ends[end]}" if end else ""
    ), "Pa" if label.unit == "kPa" else "rad" if label.unit == "rad" else ""


def finite(value: Any) -> Any:
    """The value with None for numbers that JSON cannot represent, and text keys.

    Examples
    --------
    >>> finite({1: [2.0, float("nan")]})
    {'1': [2.0, None]}
    """
    if isinstance(value, dict):
        return {str(key): finite(each) for key, each in value.items()}
    if isinstance(value, list):
        return [finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
