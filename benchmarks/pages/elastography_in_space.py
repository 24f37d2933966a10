"""Tables of the page on elastography in space."""

from collections.abc import Callable

from _pages import records
from _tables import MISSING, Record, bullets, count, name, number, percent, seconds, table

MAPS = "MRE134: "
LIMIT = 0.05


def _head(maps: bool) -> list[Record]:
    return [r for r in records("elastography_head") if r["method"].startswith(MAPS) == maps]


def behind() -> str:
    best = next(r for r in _head(False) if r["method"] == "ngbrain:inversion")
    off = {
        f"{kind} of {tissue}": best["median_off"][tissue][kind]
        for tissue in ("grey", "white")
        for kind in ("storage", "loss")
    }
    missed = ", ".join(f"{what} by {percent(value)}" for what, value in off.items() if abs(value) > LIMIT)
    zones = [r for r in records("inversion_zones") if r["method"] == "ngbrain:zones"]
    one = next(r for r in records("inversion_zones") if r["method"] == "ngbrain:one inversion")
    default = max((r for r in zones if r["passes"] == 1), key=lambda r: r["ndof"])
    return bullets([
        f"A head without labels, {percent(LIMIT)} asked: {missed}.",
        f"Zones with a pass take {number(default['cpu_s'] / one['cpu_s'])} times the CPU time of one inversion.",
    ])  # fmt: skip


def head() -> str:
    return _heads(_head(False))


def measured_map() -> str:
    extra: dict[str, Callable[[Record], str]] = {
        "truly": lambda r: _pair(r["true_contrast"], number3),
        "rms of ln abs(G*)": lambda r: number(r["rms_ln"]),
        "rank with the truth": lambda r: number(r["rank"]),
        "with the smooth map": lambda r: number(r["rank_smooth"]),
        "single voxels shown": lambda r: percent(r["detail"]),
    }
    return _heads(_head(True), extra)


def _heads(found: list[Record], extra: dict[str, Callable[[Record], str]] | None = None) -> str:
    extra = extra or {}
    rows = []
    for r in found:
        off = [_pair(r["median_off"][tissue], _signed) for tissue in ("grey", "white")]
        told = [
            _pair(r["contrast"], number3), *(show(r) for show in extra.values()), count(r["ndof"]), str(r.get("elements", MISSING)),
            number(r.get("misfit")), seconds(r["wall_s"]), seconds(r["cpu_s"]), f"{number(r['peak_gib'])} GiB",
        ]  # fmt: skip
        rows.append([name(r["method"].removeprefix(MAPS)), *off, *told])
    titles = (
        "method", "grey off by", "white off by", "contrast of the ball", *extra, "unknowns of a wave", "elements",
        "misfit over its level", "clock", "CPU time", "memory",
    )  # fmt: skip
    return table(titles, rows)


def block() -> str:
    rows = []
    for r in records("inversion_space"):
        method = f"{name(r['method'])}, {r['cells']}³ hexahedra" if r.get("cells") else r["method"]
        contrasts = ", ".join(number3(c) for c in r["contrasts"] if c is not None)
        rows.append([
            method, count(r["ndof"] or None), percent(r["error"]), contrasts, _signed(r["block"]), number(r.get("misfit")),
            seconds(r["cpu_s"]),
        ])  # fmt: skip
    titles = (
        "method",
        "unknowns of a wave",
        "rms of ln abs(G*)",
        "contrast",
        "block off by",
        "misfit over its level",
        "CPU time",
    )
    return table(titles, rows)


def zones() -> str:
    rows = []
    for r in records("inversion_zones"):
        what = f"{r['zones']} zones of {_side(r)}³ elements" if r.get("zones") else name(r["method"])
        apart = [r.get("disagreement_storage"), r.get("disagreement_loss")]
        rows.append([
            what, str(r.get("passes", MISSING)), count(r["ndof"] or None), _two(r["off"]), _two(r["errors"]),
            ", ".join(number3(c) for c in r["contrast"]), _two(apart) if apart[0] is not None else MISSING,
            number(r.get("misfit_as_one_body", r.get("misfit")), 3), seconds(r["cpu_s"], 4),
            f"{number(r['peak_gib'])} GiB" if r.get("peak_gib") else MISSING,
        ])  # fmt: skip
    titles = (
        "method", "passes", "unknowns of a zone", "off one inversion", "off the truth", "contrast (truly 2)",
        "zones apart where they overlap", "misfit as one body", "CPU time", "memory",
    )  # fmt: skip
    return table(titles, rows)


def _side(record: Record) -> int:
    """Elements along a side of a zone, from its unknowns."""
    return (round((record["ndof"] / 3) ** (1 / 3)) - 1) // record["order"]


def number3(value: float) -> str:
    return number(value, 3)


def _two(values: list[float]) -> str:
    return ", ".join(number(100 * value) for value in values) + " %"


def _signed(value: float) -> str:
    return ("+" if value > 0 else "") + percent(value)


def _pair(values: dict[str, float], show: Callable[[float], str]) -> str:
    return ", ".join(show(value) for value in values.values())
