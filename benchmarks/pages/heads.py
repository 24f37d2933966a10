"""Tables of the page on people's heads."""

from statistics import median

import _heads_page
from _pages import records
from _tables import Record, bullets, number, spread

LEAST = 12
"""The smallest dihedral angle (degrees) that `mesh T1` keeps."""


def _heads() -> list[Record]:
    return records("heads_of_strangers")


def labels() -> str:
    return _heads_page.labels(_heads())


def meshes() -> str:
    return _heads_page.meshes(_heads())


def demos() -> str:
    return _heads_page.demos(_heads())


def routes() -> str:
    return _heads_page.routes(_heads())


def behind() -> str:
    angles = [r["demo"]["smallest_dihedral_deg"] for r in _heads() if "smallest_dihedral_deg" in r.get("demo", {})]
    below = sum(angle < LEAST for angle in angles)
    refused = [r["head"].partition("_t1")[0] for r in _heads() if not r.get("recognised", True)]
    both = {}
    for r in _heads():
        if "hull" in r and "dice_grey" not in r:
            both[r["head"].partition("_t1")[0]] = r["cpu_s"] + r["hull"]["cpu_s"]
    longest = max(both, key=lambda head: both[head])
    range_ = spread(angles, lambda angle: number(angle, 3))
    return bullets(
        [
            f"Beside the cleft of the demos' coarse meshes the smallest dihedral angle is {range_}°, in {below} of {len(angles)}"
            f" below the {LEAST}° that `mesh T1` keeps.",
            f"Refused: {', '.join(refused)}.",
            f"From a T1 to a mesh by hull {longest} takes longest, {number(both[longest], 3)} CPU s.",
        ]
    )


def overlaps() -> str:
    found = [r for r in _heads() if "dice_grey" in r]
    texts = []
    for name, shown in (("grey", "grey matter"), ("white", "white matter"), ("ventricles", "ventricles")):
        values = [r[f"dice_{name}"] for r in found]
        texts.append(f"{shown} {number(median(values), 3)} ({number(min(values), 3)})")
    for name in ("grey", "white"):
        values = [r[f"dice_{name}"] / r[f"ceiling_{name}"] for r in found]
        texts.append(f"{name} matter of the ceiling {number(median(values), 4)} ({number(min(values), 4)})")
    return f"Median (and worst) of {len(found)} heads: {', '.join(texts)}."
