"""MATLAB files: numbers, logicals and text by name. Version 7.3 is HDF5; SciPy reads earlier versions, and writes version 5."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io


def read_matlab(path: Path) -> dict[str, Any]:
    """Variable → array, number or text; structures, cells and objects are ignored. 1 × 1 becomes a number, 1 × n (n,)."""
    found = _read_hdf5(path) if h5py.is_hdf5(path) else scipy.io.loadmat(path)
    return {
        name: _plain(value)
        for name, value in found.items()
        if not name.startswith("__") and isinstance(value, np.ndarray) and value.dtype.kind in "biufcU"
    }


def write_matlab(path: Path, keys: Mapping[str, Any]) -> None:
    """Write variables to a MATLAB file of version 5.

    Parameters
    ----------
    path : Path
        The file.
    keys : mapping
        Variable → array, number or text; vectors become n × 1.
    """
    with path.open("wb") as file:
        scipy.io.savemat(file, dict(keys), do_compression=True, oned_as="column")


def _plain(value: np.ndarray) -> Any:
    if value.dtype.kind == "U":
        return str(value.ravel()[0]).strip() if value.size else ""
    if value.ndim == 2 and 1 in value.shape:
        value = value.ravel()
        return value[0] if value.size == 1 else value
    return value


def _read_hdf5(path: Path) -> dict[str, np.ndarray]:
    """Read version 7.3: axes are reversed, complex numbers are pairs, text is character codes."""
    found = {}
    with h5py.File(path, "r") as file:
        for name, item in file.items():
            if not isinstance(item, h5py.Dataset) or item.attrs.get("MATLAB_empty", 0):
                continue
            value = item[()]
            kind = item.attrs.get("MATLAB_class", b"")
            if isinstance(value, np.ndarray) and value.dtype.names == ("real", "imag"):
                value = value["real"] + 1j * value["imag"]
            if not isinstance(value, np.ndarray) or value.dtype.kind not in "biufc":
                continue
            if kind == b"char":
                value = np.array("".join(map(chr, value.T.ravel())))
            found[name] = np.asarray(value).T
    return found
