"""Versions of the packages that affect results."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version


def versions() -> dict[str, str]:
    """Versions of Python and of all packages that affect numerical results."""
    packages = {name: version(name) for name in ("ngbrain", "ngsolve", "netgen-mesher", "numpy", "scipy", "h5py")}
    return {"python": platform.python_version(), **packages}


def show_versions() -> None:
    """Print the versions of everything that numbers depend on, the platform and the threads, as a report of a fault needs them.

    >>> show_versions()  # doctest: +ELLIPSIS
    python         ...
    ngbrain        ...
    """
    rows = {**versions(), "platform": platform.platform(), "cores": str(os.cpu_count())}
    for name, value in rows.items():
        print(f"{name:<14} {value}")
