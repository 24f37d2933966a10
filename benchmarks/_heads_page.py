"""Tables of the page of results on heads, written between marks of its text from the records of `heads_of_strangers`."""

from __future__ import annotations

import re

import numpy as np
from _tables import table

Record = dict

ROUTES = ("lattice", "conforming")


def labels(records: list[Record]) -> str:
    """Labels compared with MUSE's; ° marks a head that was never segmented before."""
    titles = (
        "head", "CPU s", "brain ml", "ventricles ml", "contrast", "grey", "white", "ventricles", "brain",
        "grey of the ceiling", "white of the ceiling",
    )  # fmt: skip
    lines = []
    for of in sorted((record for record in records if "dice_grey" in record), key=_order):
        overlaps = [f"{of[f'dice_{name}']:.3f}" for name in ("grey", "white", "ventricles", "brain")]
        shares = [f"{of[f'dice_{name}'] / of[f'ceiling_{name}']:.3f}" for name in ("grey", "white")]
        numbers = [str(of[key]) for key in ("cpu_s", "brain_ml", "ventricles_ml", "contrast")]
        lines.append([_name(of) + "°" * of.get("unseen", False), *numbers, *overlaps, *shares])
    return table(titles, lines)


def meshes(records: list[Record]) -> str:
    """Labels and hull meshes of T1s without a label map, including refused ones."""
    titles = (
        "T1", "labels CPU s", "brain ml", "ventricles ml", "contrast", "mesh CPU s", "both", "smallest dihedral",
    )  # fmt: skip
    lines = []
    for of in records:
        if not of.get("recognised", True):
            lines.append([_name(of), f"refused: {of['reason'].partition('; wanted')[0]}", *[""] * 6])
        elif "hull" in of and "dice_grey" not in of:
            numbers = [str(of[key]) for key in ("cpu_s", "brain_ml", "ventricles_ml", "contrast")]
            mesh, both = of["hull"], f"{of['cpu_s'] + of['hull']['cpu_s']:.1f}"
            lines.append([_name(of), *numbers, str(mesh["cpu_s"]), both, f"{mesh['smallest_dihedral_deg']}°"])
    return table(titles, lines)


def demos(records: list[Record]) -> str:
    """The fast demo on each head, and the number of finished reports."""
    rows = [record for record in records if "demo" in record]
    titles = (
        "T1", "report", "CPU s", "GiB", "brain ml", "ventricles ml", "off by", "smallest dihedral",
        "cleft off its place, deep (mm)", "peak pressure (mmHg)", "peak force (N)",
    )  # fmt: skip
    reached = sum(record["demo"]["report"] for record in rows)
    return f"{reached} of {len(rows)} reached the report ({_made(rows, 'demo')}).\n\n{table(titles, map(_demo, rows))}"


def _demo(record: Record) -> list[str]:
    demo = record["demo"]
    start = [_name(record), "yes" if demo["report"] else "**no**", f"{demo['cpu_s']:.0f}", f"{demo['peak_gib']:.1f}"]
    if "brain_ml" not in demo:
        return [*start, demo["reason"], *[""] * 6]
    off = max(abs(demo["brain_off"]), abs(demo["ventricles_off"]))
    return [
        *start, f"{demo['brain_ml']:.0f}", f"{demo['ventricles_ml']:.1f}", f"{off:.2%}",
        f"{demo['smallest_dihedral_deg']}°", f"{demo['place_off_mm']}, {demo['depth_mm']}",
        _range(demo["peak_pressure_mmHg"], 0), _range(demo["peak_force_N"], 2),
    ]  # fmt: skip


def routes(records: list[Record]) -> str:
    """Meshes by the routes with tissue interfaces."""
    rows = [(record, route) for route in ROUTES for record in records if route in record]
    titles = ("T1", "route", "mesh", "smallest dihedral", "regions off by at most", "tetrahedra", "CPU s", "GiB")
    lines = []
    for record, route in rows:
        made = record[route]
        off = [abs(value) for key, value in made.items() if key.endswith("_off")]
        cells = [made.get("reason", "made"), *[""] * 3]
        if off:
            cells = ["made", f"{made['smallest_dihedral_deg']}°", f"{max(off):.2%}", str(made["tetrahedra"])]
        lines.append([_name(record), route, *cells, f"{made['cpu_s']:.0f}", f"{made['peak_gib']:.1f}"])
    return table(titles, lines)


def _order(record: Record) -> tuple[bool, str, int]:
    """Sort key: s2 before s10, persons last."""
    name = _name(record)
    return name.startswith("person"), name.rstrip("0123456789"), int(re.sub(r"\D", "", name) or 0)


def _name(record: Record) -> str:
    name = record["head"].partition("_t1")[0].partition(".")[0]
    return f"{name}: {record['about']}" if "about" in record else name


def _range(values: dict[str, float], digits: int) -> str:
    low, high = np.min(list(values.values())), np.max(list(values.values()))
    return f"{low:.{digits}f} to {high:.{digits}f}"


def _made(records: list[Record], what: str) -> str:
    commits = sorted({record[what]["run"]["commit"] for record in records})
    dates = sorted({record[what]["run"]["date"] for record in records})
    return f"commit {', '.join(commits)}, {' to '.join(dates)}"
