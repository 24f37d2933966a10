"""The state of a run as JSON and plain arrays: types are kept, numbers are exact, and nothing is pickled."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError
from ngbrain.reading import read_npz

Array = npt.NDArray[Any]
MOST_STATE = 2**34
"""Maximum size (bytes) of a state: 16 GiB."""


def save_state(path: str | os.PathLike[str], state: Any) -> None:
    """Write a state atomically.

    Parameters
    ----------
    path : str or Path
        Output .npz file.
    state : object
        Anything that `pack` accepts.

    Raises
    ------
    InputError
        `pack` refuses a part of the state.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_state(f"{folder}/state.npz", {"u": np.arange(2.0), "step": 12})
    ...     load_state(f"{folder}/state.npz")
    {'u': array([0., 1.]), 'step': 12}
    """
    arrays: list[tuple[str, Array]] = []
    packed = np.frombuffer(json.dumps(pack(state, "state", arrays)).encode(), np.uint8)
    numbered = {str(i): array for i, (_, array) in enumerate(arrays)}
    atomic_write(Path(path), lambda part: np.savez(part, state=packed, **numbered))  # type: ignore[arg-type]


def load_state(path: str | os.PathLike[str]) -> Any:
    """Read a state that `save_state` has written; `InputError` for other files."""
    path = Path(path)
    found = read_npz(path, "state", MOST_STATE)
    try:
        arrays = [found[str(i)] for i in range(len(found) - 1)]
        return unpack(json.loads(found["state"].tobytes()), arrays)
    except (KeyError, ValueError, TypeError, IndexError) as error:
        raise InputError("state", f"damaged ({type(error).__name__}: {error})", "what ngbrain wrote", path) from error


def pack(value: Any, name: str, arrays: list[tuple[str, Array]]) -> Any:
    """Convert a value to JSON-compatible data and a list of arrays.

    Sequences start with their type, so that no list can be mistaken for an array reference.

    Parameters
    ----------
    value : object
        None, bool, int, float, str, NumPy numbers and arrays without objects, and lists, tuples and mappings of these.
    name : str
        Name of the value, for messages and arrays.
    arrays : list of (str, numpy.ndarray)
        Named arrays are appended here.

    Returns
    -------
    object
        JSON-compatible data.

    Raises
    ------
    InputError
        The value has another type.
    """
    if isinstance(value, np.number | np.bool_):  # inline, as a list may hold thousands
        return ["number", value.dtype.str, value.tobytes().hex()]
    if value is None or isinstance(value, (bool, int, float, str)):
        return value  # Python's JSON keeps every float exactly, also inf and nan
    if isinstance(value, Mapping) and all(isinstance(key, str) for key in value):
        return {key: pack(item, f"{name}.{key}", arrays) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [type(value).__name__, *(pack(item, f"{name}[{i}]", arrays) for i, item in enumerate(value))]
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        arrays.append((name, value))
        return ["array", len(arrays) - 1]
    wanted = "numbers, text, None, arrays (a vector's: vec.FV().NumPy()), lists, mappings with text keys"
    raise InputError(name, f"a {type(value).__name__}", wanted)


def unpack(packed: Any, arrays: Sequence[Array]) -> Any:
    """Invert `pack`.

    Parameters
    ----------
    packed : object
        JSON-compatible data.
    arrays : sequence of numpy.ndarray
        The arrays.

    Returns
    -------
    object
    """
    if isinstance(packed, dict):
        return {key: unpack(item, arrays) for key, item in packed.items()}
    if not isinstance(packed, list):
        return packed
    kind, *items = packed
    if kind in ("array", "number"):
        return arrays[items[0]] if kind == "array" else np.frombuffer(bytes.fromhex(items[1]), items[0])[0]
    return (tuple if kind == "tuple" else list)(unpack(item, arrays) for item in items)


def write_array(group: h5py.Group, name: str, array: Array) -> h5py.Dataset:
    """Write an array to HDF5; types that HDF5 lacks (text, dates, records, long double) as .npy bytes.

    Parameters
    ----------
    group : h5py.Group
        The group.
    name : str
        Name in the group.
    array : numpy.ndarray
        The array.

    Returns
    -------
    h5py.Dataset
    """
    if array.dtype.kind in "biufc" and array.dtype.char not in "gG":
        return group.create_dataset(name, data=array)
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=False)
    group.create_dataset(name, data=np.frombuffer(stream.getbuffer(), np.uint8)).attrs["npy"] = True
    return group[name]


def read_array(data: h5py.Dataset) -> Array:
    """Read an array that `write_array` has written."""
    return np.asarray(np.load(io.BytesIO(data[()]), allow_pickle=False) if "npy" in data.attrs else data[()])
