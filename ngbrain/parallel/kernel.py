"""What the system says of memory: how much there is, and how often it has ended a process for want of it."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from pathlib import Path

GIB = 2.0**30
_GROUPS = Path("/sys/fs/cgroup")
_COUNT = re.compile(r"^oom_kill (\d+)$", re.MULTILINE)


def memory_kills() -> int | None:
    """Processes that the system has ended for want of memory: of this process's control group, else of the machine.

    None where nothing says so (no Linux, or no right to read it).
    """
    own = _group()
    for path in (own / "memory.events", _GROUPS / "memory/memory.oom_control", Path("/proc/vmstat")):
        with suppress(OSError):
            if count := _COUNT.search(path.read_text()):
                return int(count[1])
    return None


def machine_memory() -> float | None:
    """Bytes that processes here can have: of the machine, or of this process's control group where that is less."""
    found = list[float]()
    for path in (_group() / "memory.max", _GROUPS / "memory/memory.limit_in_bytes"):
        with suppress(OSError, ValueError):
            found.append(float(path.read_text()))
    with suppress(ValueError, AttributeError, OSError):
        found.append(float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")))
    return min(found, default=None)


def _group() -> Path:
    """The folder of this process's control group (version 2)."""
    with suppress(OSError):
        for line in Path("/proc/self/cgroup").read_text().splitlines():
            if line.startswith("0::") and (path := _GROUPS / line[3:].lstrip("/")).is_dir():
                return path
    return _GROUPS
