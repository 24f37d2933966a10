"""Subzones against one inversion: difference of the maps, error against the truth, and cost, by zone size.

A block of 6 cm with a ball of 20 mm, twice as stiff, in its middle, where eight zones meet; two loads at 80 Hz, 2.3
wave lengths from side to side, simulated with fourth order on tetrahedra, points every 2.5 mm, 2 % noise, one seed. `off` is the
rms of ln(modulus/that of one inversion) over all points, `error` that of ln(modulus/truth), storage and loss; a size is in wave
lengths, the most that is allowed (`side` is what came of it), and neighbours overlap as they do by default: by two of the largest
zones' five elements along a side, one of four, one of three. `cpu_s` of a pass counts all before it. Memory is that of a process,
of zones with their check as one body. Zones that are more than a tenth off have failed: a cross.

    python benchmarks/inversion_zones.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/inversion_zones.py --chart FILE.png < records.json
"""

from __future__ import annotations

import resource
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
from _ball_waves import BallInBlock
from _command import main
from _front import figure

from ngbrain.inverse import (
    Inversion,
    StartResult,
    fit_smooth_field,
    helmholtz_of_curl,
    invert_by_subzones,
    invert_in_space,
    subzones,
)
from ngbrain.io import WaveData
from ngbrain.threads import set_threads

Record = dict
Maps = dict[str, np.ndarray]
BLOCK = BallInBlock(0.06, (0.03, 0.03, 0.03), 0.010, (4000 + 1600j, 8000 + 3200j), 80.0, 0.009)
NOISE, FAILED, PASSES = 0.02, 0.1, 1
WAVE = 0.026
"""Shear wavelength in the block (m)."""
SIZES = (1.0, 1.35, 1.7)
PARTS = ("storage", "loss")
TIMES, PER_CENT = (200, 300, 400, 600, 800, 1200, 1600), (1, 1.5, 2, 3, 4, 5, 7, 10, 20, 50, 100, 200)
ONE = "ngbrain:one inversion"
COLOURS = {"algebraic": "#D55E00", ONE: "#4d4d4d", 1.0: "#56B4E9", 1.35: "#0072B2", 1.7: "#009E73"}


def measure(quick: bool) -> list[Record]:
    """One record for each method; for zones one before and one after each pass."""
    data = BLOCK.waves(*((2, 4e-3) if quick else (4, 2.5e-3)), NOISE)
    rounds = 1 if quick else 16
    whole, record = apart(one, data, rounds)
    records = [direct(data, whole), record, apart(one, data, rounds, 4 if quick else 8, whole)[1]]
    for size in SIZES[2:] if quick else SIZES:
        records += apart(zones, data, rounds, size, whole)
        print(line(records[-1]), file=sys.stderr, flush=True)
    return records


def apart(way, *arguments):
    """Run in a separate process, to measure its peak memory."""
    with ProcessPoolExecutor(1, get_context("spawn"), initializer=set_threads, initargs=(1,)) as executor:
        return executor.submit(way, *arguments).result()


def direct(data: WaveData, whole: Maps) -> Record:
    """Algebraic inversion, for comparison."""
    begun = time.process_time()
    modulus = helmholtz_of_curl(data, fit_smooth_field(data), 5e-3)
    maps = {"storage": np.maximum(modulus.real, 1.0), "loss": np.maximum(modulus.imag, 1.0)}
    made = {"method": "algebraic", "order": None, "ndof": 0, "converged": True, "cpu_s": time.process_time() - begun}
    return made | judged(data, maps, whole)


def one(data: WaveData, rounds: int, cells: int | None = None, whole: Maps | None = None) -> tuple[Maps, Record]:
    """Inversion of the whole block, optionally with another number of hexahedra along a side."""
    elements = BLOCK.hexahedra(3, cells, len(data.points)) if cells else None
    found = invert_in_space(data, elements, noise=NOISE, max_iterations=rounds)
    name = f"{ONE}, {cells}³ cells" if cells else ONE
    record = {"method": name, **judged(data, found.maps, whole or found.maps), **about(found, found.starts[-1:])}
    return found.maps, record | {"elements": found.model["n_elements"], "misfit": found.checks["misfit_over_expected"]}


def zones(data: WaveData, rounds: int, size: float, whole: Maps) -> list[Record]:
    """Zones of a size in wavelengths, and their passes."""
    lengths = {"size": size * WAVE, "overlap": subzones.invert.OVERLAP / subzones.invert.SIDE * size * WAVE}
    found = invert_by_subzones(data, noise=NOISE, **lengths, passes=PASSES, max_iterations=rounds)
    points = found.model["points_of_a_zone"]
    side = max(points) ** (1 / 3) * data.point_spacing / WAVE
    common = {"method": "ngbrain:zones", "size": size, "side": side, "zones": found.model["zones"], "points": points}
    records = []
    for i, row in enumerate(found.starts):
        records.append({**common, "passes": i, **judged(data, row.maps, whole), **about(found, found.starts[: i + 1])})
    for name in PARTS:
        records[0][f"disagreement_{name}"] = found.checks[f"disagreement_{name}_first"]
        records[-1][f"disagreement_{name}"] = found.checks[f"disagreement_{name}"]
    records[-1]["misfit_as_one_body"] = found.checks.get("misfit_as_one_body")
    return records


def about(found: Inversion, rows: list[StartResult]) -> Record:
    """Size and cost, common to these rows."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    cpu = sum(row.cpu_s for row in rows)
    return {
        "order": 3,
        "ndof": found.model["n_unknowns"],
        "converged": rows[-1].converged,
        "cpu_s": cpu,
        "peak_gib": peak,
    }


def judged(data: WaveData, maps: Maps, whole: Maps) -> Record:
    """Errors against one inversion and against the truth; medians in the ball's core and outside it."""
    truth = np.array(BLOCK.moduli)[data.labels]
    true = {"storage": truth.real, "loss": truth.imag}

    def rms(values: np.ndarray, others: np.ndarray) -> float:
        return float(np.sqrt(np.nanmean(np.log(values / others) ** 2)))

    off, errors = ([rms(maps[name], others[name]) for name in PARTS] for others in (whole, true))
    return {
        "off": off,
        "off_by": [BLOCK.contrast(data.points, maps[n]) / BLOCK.contrast(data.points, whole[n]) - 1 for n in PARTS],
        "error": max(errors),
        "errors": errors,
        "contrast": [BLOCK.contrast(data.points, maps[name]) for name in PARTS],
        "failed": bool(max(off) > FAILED),
    }


def chart(records: list[Record], png: str) -> None:
    """Distance from one inversion, and from the truth, against CPU time."""
    plt, made, panels = figure(11, 4.8, 2)
    ours = [r for r in records if r["order"]]
    for axes, key in zip(panels, ("off", "errors"), strict=True):
        for size in dict.fromkeys(r["size"] for r in ours if "size" in r):
            way = [r for r in ours if r.get("size") == size]
            label = f"{way[0]['zones']} zones, up to {way[0]['side']:.2g} wave lengths wide"
            axes.plot([r["cpu_s"] for r in way], [100 * r[key][1] for r in way], "-", color=COLOURS[size], label=label)
            for r in way:
                mark = "x" if r["failed"] else "o"
                axes.plot(r["cpu_s"], 100 * r[key][1], mark, color=COLOURS[size], ms=9, mew=2.5)
                axes.annotate(
                    f"{r['passes']}", (r["cpu_s"], 100 * r[key][1]), textcoords="offset points", xytext=(7, 5)
                )
        axes.set(xscale="log", yscale="log", xlabel="CPU time, s")
        for axis, ticks in ((axes.xaxis, TIMES), (axes.yaxis, PER_CENT)):
            axis.set_ticks(ticks, [str(tick) for tick in ticks])
        axes.minorticks_off()
        axes.grid(True, alpha=0.3)
        axes.margins(0.15)
    left, right = panels
    (single,) = (r for r in ours if r["method"] == ONE)
    (algebraic,) = (r for r in records if r["method"] == "algebraic")
    right.plot(single["cpu_s"], 100 * single["errors"][1], "s", color=COLOURS[ONE], ms=9, label="one inversion")
    right.axhline(100 * algebraic["errors"][1], color=COLOURS["algebraic"], ls=":", label="algebraic inversion")
    (other,) = (r for r in ours if r["method"].startswith(f"{ONE},"))
    left.plot(other["cpu_s"], 100 * other["off"][1], "s", color="0.6", ms=9, label="one inversion in other elements")
    right.plot(other["cpu_s"], 100 * other["errors"][1], "s", color="0.6", ms=9)
    left.axvline(single["cpu_s"], color=COLOURS[ONE], ls="--", lw=1, label="time of one inversion")
    left.set_ylabel("loss modulus, rms of ln off one inversion's, %")
    right.set_ylabel("loss modulus, rms of ln off the truth, %")
    entries = {text: mark for axes in panels for mark, text in zip(*axes.get_legend_handles_labels(), strict=True)}
    made.legend(entries.values(), entries.keys(), fontsize=8, ncols=3, loc="outside lower center")
    made.suptitle(
        "A ball twice as stiff in a block of 2.3 wave lengths, 2 % noise; numbers: passes among neighbours; a cross: failed"
    )
    made.savefig(png, dpi=130)
    plt.close(made)


def line(r: Record) -> str:
    """One record as text."""
    kind = f" of {r['size']:g} wave lengths, {r['passes']} passes" if "size" in r else ""
    off, error, contrast = ("{:.3g}, {:.3g}".format(*r[key]) for key in ("off", "errors", "contrast"))
    return f"{r['method']}{kind}: off one inversion {off}, truth {error}; contrast {contrast}; {r['cpu_s']:.0f} s"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
