"""The operating system: memory limits, out-of-memory kills, and standard streams that are closed."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from pathlib import Path

GIB = 2.0**30
_GROUPS = Path("/sys/fs/cgroup")
_COUNT = re.compile(r"^oom_kill (\d+)$", re.MULTILINE)


def open_standard_streams() -> None:
    """Open each of the descriptors 0, 1 and 2 that is closed on the null device; otherwise the next pipe or file would take it.

    Processes that are started inherit it.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # gets the lowest number that is free


def memory_kills() -> int | None:
    """Number of out-of-memory kills in this process's control group, or on the machine.

    None if unknown (no Linux, or no permission).
    """
    own = _group()
    for path in (own / "memory.events", _GROUPS / "memory/memory.oom_control", Path("/proc/vmstat")):
        with suppress(OSError):
            if count := _COUNT.search(path.read_text()):
                return int(count[1])
    return None


def machine_memory() -> float | None:
    """Memory (bytes) of the machine, or of this process's control group if that is less; None if unknown."""
    found = list[float]()
    for path in (_group() / "memory.max", _GROUPS / "memory/memory.limit_in_bytes"):
        with suppress(OSError, ValueError):
            found.append(float(path.read_text()))
    with suppress(ValueError, AttributeError, OSError):
        found.append(float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")))
    return min(found, default=None)


def _group() -> Path:
    """Folder of this process's control group (version 2)."""
    with suppress(OSError):
        for line in Path("/proc/self/cgroup").read_text().splitlines():
            if line.startswith("0::") and (path := _GROUPS / line[3:].lstrip("/")).is_dir():
                return path
    return _GROUPS
