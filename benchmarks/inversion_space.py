"""Waves in space: error against CPU time of elements of several sizes and orders, algebraic inversion and local frequency.

A block of 6 cm with a ball of 15 mm, twice as stiff, that lies anywhere in the elements; two loads at 50 Hz, simulated with
fourth order on tetrahedra, points every 2 mm, 2 % noise, one seed. `error` is the rms of ln |G*/truth| over all points; `contrast`
the median of the ball's core (a voxel off its border) over that of the 5 mm around it, truly 2. What is more than .4 off has
failed: a cross. The smoothing that algebraic inversion and a start take is in their times.

    python benchmarks/inversion_space.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/inversion_space.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
from _ball_waves import BallInBlock
from _command import main, sweep
from _front import figure

from ngbrain import parallel
from ngbrain.inverse import fit_smooth_field, helmholtz_of_curl, invert_in_space, local_frequency
from ngbrain.io import WaveData

Record = dict
BLOCK = BallInBlock(0.06, (0.032, 0.028, 0.030), 7.5e-3, (2400 + 1000j, 4800 + 2000j), 50.0, 0.011)
NOISE, TRUE, FAILED = 0.02, 2.0, 0.4
CELLS = ((2, 4), (2, 6), (3, 4), (3, 5), (3, 6))
"""Order and hexahedra along a side."""
COLOURS = {
    "algebraic": "#D55E00",
    "local frequency": "#CC79A7",
    "ngbrain:order 2": "#56B4E9",
    "ngbrain:order 3": "#0072B2",
}


def measure(quick: bool, executor: parallel.AnyExecutor = None) -> list[Record]:
    """One record for each method."""
    ways = [*DIRECT, *(CELLS[:1] if quick else CELLS)]
    return sweep(way, {str(each): (each, quick) for each in ways}, executor)


def way(which: str | tuple[int, int], quick: bool) -> Record:
    """Record of a direct method by name, or of elements by order and number."""
    data = _waves(quick)
    return direct(data, which, DIRECT[which]) if isinstance(which, str) else inverted(data, *which, 1 if quick else 16)


@cache
def _waves(quick: bool) -> WaveData:
    return BLOCK.waves(*((2, 4e-3) if quick else (4, 2e-3)), NOISE)


def _algebraic(data: WaveData) -> np.ndarray:
    return helmholtz_of_curl(data, fit_smooth_field(data), 5e-3)


DIRECT = {"algebraic": _algebraic, "local frequency": local_frequency}


def direct(data: WaveData, method: str, answer: Callable[[WaveData], np.ndarray]) -> Record:
    """Record of a direct method."""
    begun = time.process_time()
    modulus = answer(replace(data))  # a smooth field is kept with its data
    made = {"method": method, "order": None, "ndof": 0, "converged": True, **judged(data, modulus)}
    return made | {"cpu_s": time.process_time() - begun}


def inverted(data: WaveData, order: int, cells: int, rounds: int) -> Record:
    """Record of `invert_in_space`."""
    elements = BLOCK.hexahedra(order, cells, len(data.points))
    begun = time.process_time()
    found = invert_in_space(replace(data), elements, noise=NOISE, max_iterations=rounds)
    cpu_s = time.process_time() - begun
    return {
        "method": f"ngbrain:order {order}",
        "order": order,
        "cells": cells,
        "ndof": found.model["n_unknowns"],
        **judged(data, found.maps["storage"] + 1j * found.maps["loss"]),
        "misfit": found.checks["misfit_over_expected"],
        "converged": found.checks["converged"],
        "rounds": len(found.starts[-1].history),
        "cpu_s": cpu_s,
    }


def judged(data: WaveData, modulus: np.ndarray) -> Record:
    """Errors against the truth, where there is a result."""
    known = np.isfinite(modulus) & (modulus != 0)
    size, truth = np.abs(modulus), np.array(BLOCK.moduli)[data.labels]

    def contrast(values: np.ndarray) -> float:
        return BLOCK.contrast(data.points, values, known)

    both = [contrast(modulus.real), contrast(modulus.imag) if np.abs(modulus.imag[known]).max() > 0 else None]
    return {
        "error": float(np.sqrt(np.mean(np.log(size[known] / np.abs(truth[known])) ** 2))),
        "contrast": contrast(size),
        "contrasts": both,
        "block": float(np.median(size[known & (data.labels == 0)]) / abs(BLOCK.moduli[0]) - 1),
        "failed": bool(abs(contrast(size) - TRUE) > FAILED),
    }


def chart(records: list[Record], png: str) -> None:
    """Error and contrast against CPU time."""
    plt, made, (left, right) = figure(11, 4.8, 2)
    for r in records:
        colour, mark = COLOURS[r["method"]], "x" if r["failed"] else "o"
        for axes, value in ((left, 100 * r["error"]), (right, r["contrast"])):
            axes.plot(r["cpu_s"], value, mark, color=colour, ms=9, mew=2.5)
            text = f"{r['cells']}³ cells" if r["order"] else r["method"]
            above = r["method"] in ("algebraic", "ngbrain:order 3")
            offset = (8, 5 if above else -13)
            axes.annotate(text, (r["cpu_s"], value), textcoords="offset points", xytext=offset, fontsize=8)
    for method in dict.fromkeys(r["method"] for r in records):
        right.plot([], [], "o", color=COLOURS[method], label=method.removeprefix("ngbrain:"))
    right.axhline(TRUE, color="0.4", ls="--", lw=1)
    right.text(right.get_xlim()[0], TRUE, " truth", va="bottom", fontsize=8)
    left.set(xscale="log", yscale="log", xlabel="CPU time, s", ylabel="rms of ln |G*| off the truth, %")
    left.set_yticks([2, 5, 10, 20, 50, 100], ["2", "5", "10", "20", "50", "100"])
    left.minorticks_off()
    right.set(xscale="log", xlabel="CPU time, s", ylabel="contrast of a ball twice as stiff")
    for axes in (left, right):
        axes.grid(True, alpha=0.3)
        axes.margins(0.18)
    right.legend(loc="lower right", fontsize=8)
    made.suptitle(
        "A ball of 15 mm in a block of 6 cm, two loads at 50 Hz, 2 % noise; a cross: contrast off by more than 0.4"
    )
    made.savefig(png, dpi=130)
    plt.close(made)


def line(r: Record) -> str:
    """One record as text."""
    size = f" {r['cells']}³ cells, {r['ndof']} unknowns" if r["order"] else ""
    return (
        f"{r['method']}{size}: rms {100 * r['error']:.3g} %, contrast {r['contrast']:.3g}, "
        f"block {100 * r['block']:+.2g} %; {r['cpu_s']:.1f} s"
    )


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
