"""Tables of the page on positions of a head."""

from _pages import records
from _tables import Record, count, listing, number, seconds

BENCHMARK, LOW, HIGH = "prone_to_supine", 0.52, 0.77


def _solved() -> list[Record]:
    return [r for r in records(BENCHMARK) if r["converged"]]


def _named(r: Record) -> str:
    free = r["boundary"].startswith("film")
    return r["boundary"] + (", no fluid" if free and not r["fluid"] else ", fluid" if free else "")


def _finest() -> list[Record]:
    sizes = {r["head"]: min(q["size_mm"] for q in _solved() if q["head"] == r["head"]) for r in _solved()}
    return [r for r in _solved() if r["size_mm"] == sizes[r["head"]]]


def verdict() -> str:
    met = [
        f"{_named(r)} on {r['head']} ({number(r['median_mm'], 3)} mm)"
        for r in _finest()
        if LOW <= r["median_mm"] <= HIGH
    ]
    off = [
        f"{_named(r)} on {r['head']} ({number(r['median_mm'], 3)} mm)"
        for r in _finest()
        if not LOW <= r["median_mm"] <= HIGH
    ]
    return f"Within the measured range: {'; '.join(met) or 'none'}. Outside of it: {'; '.join(off) or 'none'}."


def _mm(value: float) -> str:
    return f"{number(value, 3)} mm"


def boundaries() -> str:
    rows = [r | {"name": _named(r)} for r in _finest()]
    columns = {
        "head": ("head", str), "boundary": ("name", str), "median": ("median_mm", _mm), "least": ("least_mm", _mm),
        "most": ("most_mm", _mm), "towards the face": ("forwards_mm", _mm), "whole brain": ("whole_mm", _mm),
    }  # fmt: skip
    return listing(rows, columns)


def elements() -> str:
    rows = [r | {"name": _named(r)} for r in _solved()]
    columns = {
        "head": ("head", str), "boundary": ("name", str), "elements": ("size_mm", lambda x: f"{number(x)} mm"),
        "tetrahedra": ("tets", count), "unknowns": ("ndof", count), "CPU time": ("cpu_s", seconds), "median": ("median_mm", _mm),
    }  # fmt: skip
    return listing(rows, columns)
