"""Predicted peak memory of a task, from its size and measurements (`benchmarks/memory.py`)."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from ngbrain.errors import InputError, nearest
from ngbrain.parallel.kernel import GIB

_TABLE = Path(__file__).with_name("memory.json")


@cache
def memory_table() -> dict[str, dict[str, Any]]:
    """Kind of work → unit of its size, base and factor (GiB), exponent, sizes measured, largest relative error from 1 GiB on."""
    found: dict[str, dict[str, Any]] = json.loads(_TABLE.read_text())
    return found


def predicted_memory(kind: str, size: float, frequencies: int = 1) -> float:
    """Predict the peak memory (bytes) of a process.

    Parameters
    ----------
    kind : str
        A key of `memory_table`: "statics" (factorisation of a mixed system, by unknowns), "zone" (3-D inversion on cubes of
        third order, by cubes), "plane" (2-D inversion, by points), "retraction" (by tetrahedra), "scan" (meshing of a T1, by
        tetrahedra).
    size : float
        In the unit of the table.
    frequencies : int, optional
        Number of frequencies of 3-D waves, whose matrices are all stored: each after the first adds the share `each_frequency`
        of the table. Ignored for other kinds.

    Returns
    -------
    float

    Raises
    ------
    InputError
        The kind of work is unknown.

    Examples
    --------
    >>> predicted_memory("statics", 2e5) > 2 * predicted_memory("statics", 1e5)
    True
    """
    table = memory_table()
    if kind not in table:
        raise InputError("kind of work", repr(kind), nearest(kind, table))
    of = table[kind]
    more = 1 + of.get("each_frequency", 0.0) * (frequencies - 1)
    return float(GIB * (of["base_gib"] + of["factor_gib"] * max(size, 0.0) ** of["power"] * more))
