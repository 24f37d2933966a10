"""Versions of what computes."""

from __future__ import annotations

import platform
from importlib.metadata import version


def versions() -> dict[str, str]:
    """Versions of everything that numbers depend on."""
    packages = {name: version(name) for name in ("ngbrain", "ngsolve", "netgen-mesher", "numpy", "scipy", "h5py")}
    return {"python": platform.python_version(), **packages}
