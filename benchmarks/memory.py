"""Memory of a task by its size: measured, fitted, and predicted for other sizes.

Each size has a process of its own, on one thread, whose peak of memory counts; sizes that `statics_scaling` and
`inversion_zones` have on record are taken from there. Fitted is base + factor n^power, where the base is a process without
work; `error` is that of a size foretold from all others. Work of `HELD_OUT` is in no fit of sizes: zones of two frequencies,
whose matrices are all kept, and a retraction in another head (open circles in the chart). The library's table
(`parallel.predicted_memory`) is made from the records.

    python benchmarks/memory.py [--quick] [--json]            last line of --json: a list of records
    python benchmarks/memory.py --chart FILE.png < memory.json
    python benchmarks/memory.py --table < memory.json         write ngbrain/parallel/memory.json
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from _command import main

GIB = 2**30
HERE = Path(__file__).resolve().parent
PARTS = HERE.parent / "out" / "bench" / "memory.parts.jsonl"
"""Records of an interrupted run; delete the file to measure again."""
TABLE = HERE.parent / "ngbrain" / "parallel" / "memory.json"
SIZES: dict[str, tuple[str, tuple[float, ...], tuple[float, ...]]] = {
    "statics": ("unknowns", (), (2_000, 4_000, 8_000)),
    "zone": ("elements", (4, 5, 7), (4,)),
    "retraction": ("elements", (1.2, 1.0, 0.8, 0.5, 0.4, 0.3, 0.25), (2.0, 1.7, 1.4)),
    "scan": ("elements", (8, 5, 3.5), (14, 12, 10)),
    "plane": ("points", (15, 21, 41), (9, 11, 13)),
}
"""Kind → unit of its size, arguments, and arguments with --quick."""
HELD_OUT: dict[str, tuple[str, tuple[float, ...], int]] = {
    "two_frequencies": ("zone", (5, 7), 2),
    "head": ("retraction", (1.0, 0.7), 1),
}
"""Other work → its kind, arguments, frequencies."""
QUICK = ("statics", "plane")
ENOUGH = 0.25
"""Largest error of a useful prediction."""


def one(kind: str, size: float) -> dict:
    """A record, measured in this process."""
    import _work
    from statics_scaling import peak

    _work.quiet()
    begun = time.process_time()
    n = 0 if kind == "nothing" else getattr(_work, kind)(size)
    return {"kind": kind, "size": size, "n": n, "peak_gib": peak(), "cpu_s": time.process_time() - begun}


def apart(kind: str, size: float, quick: bool) -> dict:
    """The same in a separate process, or from an interrupted run."""
    for kept in PARTS.read_text().splitlines() if PARTS.exists() and not quick else ():
        if (found := json.loads(kept))["kind"] == kind and found["size"] == size:
            return found
    command = [sys.executable, __file__, "--one", kind, str(size)]
    with tempfile.TemporaryDirectory() as cache:  # what is kept from a run before would not be computed
        environment = os.environ | {"NGBRAIN_CACHE": cache}
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode:
        raise RuntimeError(f"{kind} {size}: {done.stderr[-500:]}")
    found = json.loads(done.stdout.splitlines()[-1])
    print(line(found), file=sys.stderr, flush=True)
    if not quick:
        PARTS.parent.mkdir(parents=True, exist_ok=True)
        with PARTS.open("a") as parts:
            parts.write(json.dumps(found) + "\n")
    return found


def measure(quick: bool) -> list[dict]:
    """A record for each size, with its prediction."""
    base = apart("nothing", 0, quick)["peak_gib"]
    records = []
    for kind in QUICK if quick else SIZES:
        of, full, short = SIZES[kind]
        found = [apart(kind, size, quick) for size in (short if quick else full)] + (
            [] if quick else measured_before(kind)
        )
        n, peak = (np.array([float(r[key]) for r in found]) for key in ("n", "peak_gib"))
        for i, record in enumerate(found):
            others = np.arange(len(n)) != i
            factor, power = fitted(n[others], peak[others], base)
            foretold = base + factor * n[i] ** power
            more = {"of": of, "base_gib": base, "foretold_gib": foretold, "error": abs(foretold / peak[i] - 1)}
            records.append(record | more | _named(record))
    return records + ([] if quick else held_out(records))


def held_out(records: list[dict]) -> list[dict]:
    """Records of other work, predicted from all sizes of its kind; the smallest with two frequencies gives that of a frequency."""
    fits, found = table(records), []
    for work, (kind, sizes, frequencies) in HELD_OUT.items():
        own = [apart(work, size, False) | {"frequencies": frequencies} for size in sizes]
        if frequencies > 1:
            alone = [r for r in records if r["kind"] == kind]
            fits[kind]["each_frequency"] = share_of_a_frequency(alone, own)
        fit = fits[kind]
        for record in own:
            n, share = record["n"], fit.get("each_frequency", 0.0)
            foretold = fit["base_gib"] + fit["factor_gib"] * n ** fit["power"] * (1 + share * (frequencies - 1))
            more = {"kind": kind, "work": work, "of": fit["of"], "base_gib": fit["base_gib"], "held_out": True}
            more |= {"foretold_gib": foretold, "error": abs(foretold / record["peak_gib"] - 1)}
            found.append(record | more | _named(record))
    return found


def share_of_a_frequency(alone: list[dict], several: list[dict]) -> float:
    """Relative memory above the base of one more frequency, from the smallest size with both."""
    for more in sorted(several, key=lambda r: r["n"]):
        for one in alone:
            if one["n"] == more["n"] and "from" not in one:
                added = (more["peak_gib"] - one["peak_gib"]) / (more["frequencies"] - 1)
                return round(added / (one["peak_gib"] - one["base_gib"]), 3)
    raise RuntimeError("no size with one frequency and with more")


def _named(record: dict) -> dict:
    return {"method": f"ngbrain:{record['kind']}", "order": None, "ndof": record["n"], "converged": True}


def measured_before(kind: str) -> list[dict]:
    """Peaks of the same work that other benchmarks have on record."""
    found = []
    if kind == "statics":
        for r in json.loads((HERE / "statics_scaling.json").read_text()):
            if r["case"] == "mixed" and r["method"] == "ngbrain:sparsecholesky" and r["converged"]:
                found.append((r["ndof"], r["memory_gib"], r["cpu_s"], "statics_scaling"))
    if kind == "zone":
        for r in json.loads((HERE / "inversion_zones.json").read_text()):
            if r["method"].startswith("ngbrain:one inversion"):
                found.append((r["elements"], r["peak_gib"], r["cpu_s"], "inversion_zones"))
    names = ("n", "peak_gib", "cpu_s", "from")
    return [{"kind": kind, "size": each[0]} | dict(zip(names, each, strict=True)) for each in found]


def fitted(n: np.ndarray, peak: np.ndarray, base: float) -> tuple[float, float]:
    """Factor and power of the memory above the base, by least squares of logarithms."""
    power, factor = np.polyfit(np.log(n), np.log(np.maximum(peak - base, 1e-3)), 1)
    return float(np.exp(factor)), float(power)


def table(records: list[dict]) -> dict[str, dict]:
    """Table of the library: kind → unit, base, factor, power, measured sizes, largest error."""
    found = {}
    for kind in dict.fromkeys(r["kind"] for r in records):
        every = [r for r in records if r["kind"] == kind]
        of, several = [r for r in every if "held_out" not in r], [r for r in every if r.get("frequencies", 1) > 1]
        n, peak = (np.array([float(r[key]) for r in of]) for key in ("n", "peak_gib"))
        factor, power = fitted(n, peak, of[0]["base_gib"])
        found[kind] = {
            "of": of[0]["of"],
            "base_gib": round(of[0]["base_gib"], 4),
            "factor_gib": float(f"{factor:.4g}"),
            "power": round(power, 4),
            "measured": [int(n.min()), int(n.max())],
            "largest_error": round(max((r["error"] for r in every if r["peak_gib"] >= 1), default=0.0), 3),
        }
        if several:
            found[kind]["each_frequency"] = share_of_a_frequency(of, several)
    return found


def chart(records: list[dict], png: str) -> None:
    """Memory against size, measured and predicted."""
    from _front import figure

    plt, made, panels = figure(12, 3.6, len({r["kind"] for r in records}))
    for axes, kind in zip(np.atleast_1d(panels), dict.fromkeys(r["kind"] for r in records), strict=True):
        of = [r for r in records if r["kind"] == kind]
        fit = table(of)[kind]
        n = np.geomspace(min(r["n"] for r in of), 2 * max(r["n"] for r in of), 50)
        axes.plot(n, fit["base_gib"] + fit["factor_gib"] * n ** fit["power"], "-", color="#999999")
        for held, style in ((False, {"color": "#0072B2"}), (True, {"color": "#D55E00", "mfc": "none"})):
            own = [r for r in of if ("held_out" in r) is held]
            axes.plot([r["n"] for r in own], [r["peak_gib"] for r in own], "o", **style)
        axes.set(title=kind, xlabel=of[0]["of"], xscale="log", yscale="log", ylim=(0.2, 16))
        ticks = [f"{size:.0e}" for size in n[[0, -1]]]
        axes.set_xticks([float(size) for size in ticks], [f"{float(size):,.0f}" for size in ticks])
        axes.set_yticks([0.25, 0.5, 1, 2, 4, 8], ["¼", "½", "1", "2", "4", "8"])
        axes.minorticks_off()
    np.atleast_1d(panels)[0].set_ylabel("peak of memory (GiB)")
    made.savefig(png)
    plt.close(made)


def line(r: dict) -> str:
    """One record as text."""
    foretold = f", foretold {r['foretold_gib']:.2f}" if "foretold_gib" in r else ""
    return f"{r['kind']:<12}{r['n']:>9}  {r['peak_gib']:6.2f} GiB{foretold}  {r['cpu_s']:.0f} s"


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(one(sys.argv[2], float(sys.argv[3]))))
    elif sys.argv[1:2] == ["--table"]:
        TABLE.write_text(json.dumps(table(json.load(sys.stdin)), indent=1) + "\n")
    else:
        main(__doc__, measure, chart, line)
