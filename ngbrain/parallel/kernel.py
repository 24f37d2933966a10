"""What the system says of memory: how much there is, and how often it has ended a process for want of it."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

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


def _group() -> Path:
    """The folder of this process's control group (version 2)."""
    with suppress(OSError):
        for line in Path("/proc/self/cgroup").read_text().splitlines():
            if line.startswith("0::") and (path := _GROUPS / line[3:].lstrip("/")).is_dir():
                return path
    return _GROUPS
