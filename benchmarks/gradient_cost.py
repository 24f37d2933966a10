"""What the gradient of a misfit of harmonic waves costs, over the waves themselves, by order, fields and loads.

A square of 10 cm (a cube for `space`) under one load or two, at one frequency (one factor serves both) or at two; fields of
first order on its elements: storage; storage and loss; and with fibres zeta and phi besides. `ratio` is the CPU time of the
gradient over that of the waves, `adjoints` the part of it that solves with the old factor and no method can do without; each the
least of several runs, one thread. Peers: the same gradient by ∂A/∂θ assembled as a matrix, as Gauss-Newton needs it, and by
one-sided differences, a set of waves for each unknown (their number times the waves' time, not run). `error`: the gradient along a
random direction against a central difference.

    python benchmarks/gradient_cost.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/gradient_cost.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import ngsolve as ngs
import numpy as np
from _command import main
from _front import figure

from ngbrain.forward import HarmonicProblem, Wave, WaveLinearisation, WaveModel, sensitivity
from ngbrain.materials import Shearing, TransverselyIsotropic
from ngbrain.mesh import boxes, rectangles

Record = dict
SIDE, POINTS, STEP = 0.1, 40, 1e-4
START = {"storage": 2000.0, "loss": 400.0, "zeta": 0.5, "phi": 0.3}
FIELDS = {"storage": 1, "storage, loss": 2, "storage, loss, fibres": 4}
FORMS = {"P1": 100, "P2": 50, "P4": 25, "P4/P3": 25}
"""Form → elements along a side: 20 402 displacements each."""
LOADS = {"1 load": (50.0,), "2 loads": (50.0, 50.0), "2 frequencies": (50.0, 60.0)}
OURS, MATRIX, DIFFERENCES = "ngbrain:adjoint", "assembled ∂A/∂θ", "differences"
COLOURS = dict(zip(LOADS, ("#0072B2", "#D55E00", "#009E73"), strict=True))


def model(fields: str, form: str, n: int, loads: str, dim: int = 2) -> WaveModel:
    """Fields that vary by a tenth, points on a grid inside."""
    line, rng = np.linspace(0, SIDE, n + 1), np.random.default_rng(1)
    mesh = rectangles(line, line) if dim == 2 else boxes(np.ones((n,) * 3, bool), line, line, line)
    found = {}
    for name in list(START)[: FIELDS[fields]]:
        found[name] = ngs.GridFunction(ngs.H1(mesh, order=1))
        found[name].vec.FV().NumPy()[:] = START[name] * (1 + 0.1 * rng.random(found[name].space.ndof))
    modulus = found["storage"] * (1 + 0.2j) if len(found) == 1 else found["storage"] + 1j * found["loss"]
    law: Shearing | TransverselyIsotropic = Shearing(modulus)
    if "zeta" in found:
        fibre = (np.cos(0.3), np.sin(0.3), 0.0)[:dim]
        law = TransverselyIsotropic(modulus, found["zeta"], found["phi"], fibre)
    first, second = ("top", "bottom") if dim == 2 else ("hull", "hull")
    driven = {first: (1e-3, 0, 0)[:dim]}, {second: (0, 1e-3, 0)[:dim]}
    waves = [Wave(f, held) for f, held in zip(LOADS[loads], driven, strict=False)]
    body = HarmonicProblem(mesh, law, waves, bulk=2e5, form=form)
    inner = np.linspace(0.02, 0.98, POINTS if dim == 2 else 12) * SIDE
    return WaveModel(body, found, np.stack(np.meshgrid(*[inner] * dim), axis=-1).reshape(-1, dim))


def least(run: Callable[[], object], times: int) -> float:
    """CPU time (s) of the fastest of so many runs."""
    spent = []
    for _ in range(times):
        begun = time.process_time()
        run()
        spent.append(time.process_time() - begun)
    return min(spent)


def off(of: WaveModel, there: WaveLinearisation, wanted: np.ndarray) -> float:
    """Of the gradient of ½ |d - d0|² from a central difference, along all fields at random."""
    theta, fields = of.theta, slice(0, of.blocks[sensitivity.harmonic.wave_model.BOUNDARY].start)
    direction = np.zeros(of.size)
    direction[fields] = theta[fields] * np.random.default_rng(2).normal(size=fields.stop)
    mine = there.gradient(there.data - wanted) @ direction
    up, down = (0.5 * np.sum(np.abs(of.evaluate(theta + s * STEP * direction).data - wanted) ** 2) for s in (1, -1))
    return float(abs((up - down) / (2 * STEP) / mine - 1))


def measured(fields: str, form: str, n: int, loads: str, times: int, dim: int = 2) -> Iterator[Record]:
    """Ours and its peers."""
    of = model(fields, form, n, loads, dim)
    theta = of.theta
    waves = least(lambda: of.evaluate(theta), times)
    there = of.evaluate(theta)
    wanted = there.data * (1.1 + 0.2j)
    w = there.data - wanted
    there.gradient(w)  # which fields go together is tried once for all inversions
    ours, adjoints = (
        least(lambda: there.gradient(w), 2 * times),
        least(lambda: there._adjoints(w, "adjoint"), 2 * times),
    )
    around = least(lambda: WaveLinearisation(of, there.factors, there.waves).vjp(w), times)
    own = {"case": "plane" if dim == 2 else "space", "fields": fields, "form": form, "loads": loads}
    more = {"order": of.body.form.order, "ndof": of.body.fes.ndof, "waves_s": waves, "converged": True, "reason": ""}
    error, unknowns = off(of, there, wanted), of.blocks[sensitivity.harmonic.wave_model.BOUNDARY].start
    for method, spent in ((OURS, ours), (MATRIX, around), (DIFFERENCES, unknowns * waves)):
        if method == DIFFERENCES:
            more |= {"converged": False, "reason": "not run: its time is that of a set of waves for each unknown"}
        yield {
            "method": method,
            **own,
            **more,
            "error": error if method != DIFFERENCES else None,
            "cpu_s": spent,
            "ratio": spent / waves,
            "adjoints": adjoints / waves if method == OURS else None,
        }


def measure(quick: bool) -> list[Record]:
    """In the plane all forms, fields and loads; in space one of each."""
    records: list[Record] = []
    for form, n in FORMS.items():
        for fields in FIELDS:
            for loads in LOADS if not quick else list(LOADS)[:1]:
                records += measured(fields, form, n // 4 if quick else n, loads, 2 if quick else 5)
    records += measured("storage, loss", "P2/P1", 4 if quick else 12, "1 load", 1 if quick else 2, dim=3)
    return records


def chart(records: list[Record], png: str) -> None:
    """Bars of ours; what is solves is dark."""
    plt, made, axes = figure(11, 4.6, len(FIELDS))
    mine = [r for r in records if r["method"] == OURS and r["case"] == "plane"]
    top = 1.15 * max(r["ratio"] for r in mine)
    for axis, fields in zip(axes, FIELDS, strict=True):
        for k, loads in enumerate(LOADS):
            for i, form in enumerate(FORMS):
                for r in (r for r in mine if (r["fields"], r["form"], r["loads"]) == (fields, form, loads)):
                    where, label = i + 0.27 * (k - 1), loads if not i else None
                    axis.bar(where, r["ratio"], 0.24, color=COLOURS[loads], alpha=0.45, label=label)
                    axis.bar(where, r["adjoints"], 0.24, color=COLOURS[loads])
                    axis.text(
                        where, r["ratio"] + 0.01 * top, f"{r['ratio']:.2f}", ha="center", fontsize=6.5, rotation=90
                    )
        axis.axhline(0.1, color="#333333", lw=0.8, ls="--")
        axis.set(title=fields, xticks=range(len(FORMS)), xticklabels=list(FORMS), ylim=(0, top))
        axis.grid(axis="y", alpha=0.25)
    axes[0].set_ylabel("gradient over waves, CPU time (dark: solves)")
    axes[0].legend(fontsize=8, frameon=False)
    made.suptitle("What a gradient costs, 20 402 displacements in the plane; dashed: a tenth of the waves", fontsize=10)
    made.savefig(png, dpi=150)
    plt.close(made)


def line(r: Record) -> str:
    """One record as text."""
    solves = "" if r["adjoints"] is None else f", {r['adjoints']:.3f} of it solves"
    where = f"{r['case']} {r['form']:6} {r['fields']:22} {r['loads']:14} {r['ndof']:7}"
    spent = f"waves {r['waves_s']:.3f} s, gradient {r['ratio']:.3f}{solves}"
    told = r["reason"] or f"off {r['error']:.1e}"
    return f"{r['method']:16} {where} {spent}; {told}"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
