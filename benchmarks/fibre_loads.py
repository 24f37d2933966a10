"""Fibres: which numbers waves in a plane tell, by the number of loads, of frequencies, and by how compressible the body is.

The published body with fibres at 30° (`ngbrain.inverse.phantoms.benchmark`, "TI": μ 10 to 15 kPa, ζ 0.5 to 2.5, φ 0.2 to
0.4) on a coarser
grid of its own elements, 1 % noise on every point, one seed, from measured waves, smooth fields, weights by the evidence. `errors`
are of μ, ζ and φ, and of μ(1+φ) and μ(1+ζ), which alone a plane of incompressible fibres shows; `determined` is how many numbers
of each field the data determine, from the Gauss-Newton matrix. Edges move in turn, the others are free; the first two loads
are the published ones. `error` is that of μ; `start` has the errors of the uniform start.

    python benchmarks/fibre_loads.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/fibre_loads.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from _command import main, sweep
from _front import figure

from ngbrain import parallel
from ngbrain.inverse import PHANTOMS, GaussNewton, Phantom, fibre_shear_moduli, phantoms

Record = dict
NODES, NOISE = 21, 0.01
DRIVE = phantoms.benchmark.DRIVE
MORE = ({"left": (0, DRIVE)}, {"right": (DRIVE, 0)}, {"bottom": (DRIVE, 0)}, {"right": (0, DRIVE)})
MORE += ({"top": (0, DRIVE)}, {"left": (DRIVE, 0)})
LOADS = ((2, (50.0,)), (4, (50.0,)), (8, (50.0,)), (2, (30.0, 50.0, 80.0)), (4, (30.0, 80.0)))
"""Drives, and the frequencies (Hz) of each."""
BULKS = (5e5, 2e4)
"""Pa: as published, 33 to 50 times μ, and hardly more than μ."""
FIELDS = {"mu": "μ", "zeta": "ζ", "phi": "φ", "shear_along": "μ(1+φ)", "shear_stretch": "μ(1+ζ)"}
COLOURS = {"mu": "#0072B2", "zeta": "#D55E00", "phi": "#CC79A7", "shear_along": "#009E73", "shear_stretch": "#56B4E9"}


def measure(quick: bool, executor: parallel.AnyExecutor = None) -> list[Record]:
    """One record for each body and set of loads."""
    loads = LOADS[:2] if quick else LOADS
    every = [(bulk, *each, 9 if quick else NODES) for bulk in BULKS for each in loads]
    return sweep(record, {str(each): each for each in every}, executor)


def record(bulk: float, drives: int, frequencies: tuple[float, ...], nodes: int) -> Record:
    """One inversion."""
    published = PHANTOMS["TI"]
    phantom: Phantom = replace(
        published, nodes=nodes, bulk=bulk, frequency=frequencies, drives=(published.drives + MORE)[:drives]
    )
    measured = phantom.simulate_measurements(NOISE)
    inversion = measured.inversion()
    begun = time.process_time()
    found = GaussNewton(inversion.reduced).from_waves(inversion.start, inversion.waves)
    cpu_s = time.process_time() - begun

    def errors(fields: dict[str, np.ndarray]) -> dict[str, float]:
        truth = measured.truth | fibre_shear_moduli(measured.truth)
        fields = fields | fibre_shear_moduli(fields)
        return {name: float(np.linalg.norm(fields[name] - t) / np.linalg.norm(t)) for name, t in truth.items()}

    known = errors(inversion.fields(found.x))
    return {
        "method": "ngbrain:GN from waves",
        "order": 1,
        "ndof": inversion.model.body.fes.ndof,
        "bulk": bulk,
        "drives": drives,
        "frequencies": frequencies,
        "loads": drives * len(frequencies),
        "noise": NOISE,
        "seed": 0,
        "error": known["mu"],
        "errors": known,
        "start": errors(inversion.fields(inversion.start)),
        "determined": found.history[-1].determined,
        "misfit": found.level.ratio,
        "converged": found.converged,
        "rounds": len(found.history),
        "cpu_s": cpu_s,
    }


def chart(records: list[Record], png: str) -> None:
    """A panel for each bulk modulus: errors and numbers determined, by loads."""
    plt, made, panels = figure(11, 5.2, 2, sharey=True)
    for axes, bulk in zip(panels, BULKS, strict=True):
        rows = [r for r in records if r["bulk"] == bulk]
        for name, symbol in FIELDS.items():
            errors = [100 * r["errors"][name] for r in rows]
            combined = name.startswith("shear")
            axes.plot(
                errors, "s-" if combined else "o--", color=COLOURS[name], lw=2.4 if combined else 1.3, label=symbol
            )
        numbers = [", ".join(f"{FIELDS[n]} {v:.0f}" for n, v in r["determined"].items()) for r in rows]
        texts = [
            f"{r['drives']} loads at {', '.join(f'{f:g}' for f in r['frequencies'])} Hz\n{n}"
            for r, n in zip(rows, numbers, strict=True)
        ]
        axes.set_xticks(range(len(rows)), texts, rotation=30, ha="right", fontsize=8)
        axes.set(yscale="log", title=f"K = {bulk / 1e3:g} kPa, {bulk / 1e4:g} times μ")
        axes.set_yticks([2, 3, 5, 10, 20], ["2", "3", "5", "10", "20"])
        axes.minorticks_off()
        axes.grid(True, axis="y", alpha=0.3)
    panels[0].set_ylabel("relative error, %")
    panels[1].legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), frameon=False)
    made.suptitle("Fibres in a plane, 1 % noise: errors; below, how many numbers of each field the data determine")
    made.savefig(png, dpi=130)
    plt.close(made)


def line(r: Record) -> str:
    """One record as text."""
    errors = ", ".join(f"{FIELDS[name]} {100 * value:.3g}" for name, value in r["errors"].items())
    numbers = ", ".join(f"{FIELDS[name]} {value:.1f}" for name, value in r["determined"].items())
    at = ", ".join(f"{f:g}" for f in r["frequencies"])
    return f"K {r['bulk'] / 1e3:g} kPa, {r['drives']} loads at {at} Hz: {errors} %; determined {numbers}; {r['cpu_s']:.1f} s"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
