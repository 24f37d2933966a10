"""How much memory a task will take, foretold by its size from what was measured (`benchmarks/memory.py`)."""

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
    """Kind of work → what its size is counted in, base and factor (GiB), power, sizes measured, the largest error from 1 GiB on."""
    found: dict[str, dict[str, Any]] = json.loads(_TABLE.read_text())
    return found


def predicted_memory(kind: str, size: float, frequencies: int = 1) -> float:
    """Bytes that a process will take at its peak.

    Parameters
    ----------
    kind : str
        One of `memory_table`: "statics" (a factor of a mixed system, by unknowns), "zone" (an inversion in space in cubes of third
        order, by cubes), "plane" (one in the plane, by points), "retraction" (by tetrahedra), "scan" (a T1 to a mesh, by
        tetrahedra).
    size : float
        As the table counts it.
    frequencies : int
        Of waves in space, whose matrices are all kept: each after the first adds the share `each_frequency` of the table. Other
        kinds take as much whatever the number.

    Returns
    -------
    float

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
