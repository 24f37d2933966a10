"""Versions of the packages that affect results, and which optional ones are installed."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, requires, version

NAME = "ngbrain"
CORE = ("ngbrain", "ngsolve", "netgen-mesher", "numpy", "scipy", "h5py")
REQUIREMENT = re.compile(
    r"(?P<name>[\w.-]+)(?:\[(?P<inner>[^]]*)\])?(?P<rest>[^;]*)(?:;.*extra == \"(?P<extra>[\w-]+)\")?"
)
FOR_DEVELOPERS = ("dev", "docs", "demo")
"""Extras that a user needs no word of, or that only name others."""


def versions() -> dict[str, str]:
    """Versions of Python and of all packages that affect numerical results."""
    packages = {name: version(name) for name in CORE}
    return {"python": platform.python_version(), **packages}


def find_version(package: str) -> str | None:
    """Version of an installed package, None where it is not installed.

    >>> find_version("no-such-package") is None
    True
    """
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def requirements() -> dict[str, dict[str, str]]:
    """The packages that ngbrain needs, with their least versions, by extra; those of "" are always needed.

    Returns
    -------
    dict of str to dict
        Extra → package → least version, "" where any will do. Extras of other extras are resolved.

    Examples
    --------
    >>> sorted(requirements()["report"])
    ['jinja2', 'matplotlib']
    """
    own: dict[str, dict[str, str]] = {"": {}}
    others: dict[str, list[str]] = {}
    for match in filter(None, map(REQUIREMENT.match, requires(NAME) or ())):
        extra = match["extra"] or ""
        packages = own.setdefault(extra, {})
        if match["name"] == NAME:
            others.setdefault(extra, []).extend(match["inner"].split(","))
        else:
            least = re.search(r">=\s*([\d.]+)", match["rest"])
            packages[match["name"]] = least[1] if least else ""

    def resolve(extra: str) -> dict[str, str]:
        return {name: least for each in others.get(extra, ()) for name, least in resolve(each).items()} | own[extra]

    return {extra: resolve(extra) for extra in own}


def is_older(found: str, least: str) -> bool:
    """Whether a version is older than another; only leading numbers count.

    Parameters
    ----------
    found : str
    least : str
        "" is older than all.

    Returns
    -------
    bool

    Examples
    --------
    >>> is_older("2.9.1", "2.10"), is_older("6.2.2608.post1", "6.2.2608")
    (True, False)
    """
    one, other = (tuple(int(number) for number in re.findall(r"\d+", text)) for text in (found, least))
    return one[: len(other)] < other


def optional_versions() -> dict[str, str]:
    """Versions of the optional packages that are installed, those of developers left out."""
    packages = {name for extra, of in requirements().items() if extra and extra not in FOR_DEVELOPERS for name in of}
    return {name: found for name in sorted(packages, key=str.lower) if (found := find_version(name))}


def platform_rows() -> Mapping[str, str]:
    """The system and the cores that this process may use."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return {"platform": platform.platform(), "cores": str(usable)}


def show_versions() -> None:
    """Print the versions of everything that numbers depend on, of optional packages, the platform and the cores.

    `ngbrain doctor` says the same and more, also where a package is missing or broken.

    >>> show_versions()  # doctest: +ELLIPSIS
    python         ...
    ngbrain        ...
    """
    rows = {**versions(), **optional_versions(), **platform_rows()}
    width = max(14, *map(len, rows))
    for name, value in rows.items():
        print(f"{name:<{width}} {value}")
