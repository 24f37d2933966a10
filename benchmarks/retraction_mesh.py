"""Effect of the element size on a retraction, on five meshes of two heads, and the estimate of a result's own check.

A spatula opens a cleft by 5 mm in 10 s and holds for 110 s (the fast demos): MNI152 and the idealised head, Griffiths' constants,
elements of 5.7, 4, 2.8, 2 and 1.4 mm at the site. Quantities of a record: value; error, from the finest mesh; estimate, by which
the next coarser mesh moves it (of 4 mm: the next finer), as `ngbrain.surgery.uncertainty.verification_runs.other_elements`
does. `scatter`: meshes whose sizes are 1 % from the second one's.

    python benchmarks/retraction_mesh.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/retraction_mesh.py --chart FILE.png < records.json

`--quick` is the idealised head on the three coarsest meshes.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

from _command import main

from ngbrain.errors import require
from ngbrain.look import STYLE
from ngbrain.scene import Scene
from ngbrain.surgery import ProtocolRun, RetractionModel, answer, uncertainty

SIZES = tuple(tuple(size * 2 ** (k / 2) for size in (1.0, 2.5, 6.5)) for k in (5, 4, 3, 2, 1))
"""Elements (mm) at the site, under the craniotomy, elsewhere: each mesh √2 times as fine as the one before."""
SCATTERED = (0.99, 1.01)
"""Scale factors of the second mesh."""
SCENES = {"mni152": "demo_fast", "idealised": "idealised_fast"}
QUANTITIES = {
    "peak_pressure_mmHg": "peak pressure",
    "dose_mmHg_min": "dose",
    "peak_force_N": "force",
    "mps_p95": "strain, 95 %",
    "von_mises_p95_kPa": "von Mises, 95 %",
}


def measure(quick: bool) -> list[dict]:
    """All records."""
    records = []
    for head in ["idealised"] if quick else SCENES:
        made = RetractionModel.from_scene(Scene.shipped(SCENES[head]))
        meshes = SIZES[: 3 if quick else None]
        found = [held(made, head, sizes) for sizes in meshes]
        exact = found[-1]["values"]
        for record, coarser, finer in zip(found[1:], found, [*found[2:], None], strict=False):
            other = finer if record["site_mm"] >= 1e3 * uncertainty.verification_runs.COARSE["wall"] else coarser
            record["estimates"] = apart(record["values"], other["values"])
        for record in found[:-1]:
            record["errors"] = apart(record["values"], exact)
            record["error"] = record["errors"]["peak_pressure_mmHg"]
        again = [held(made, head, tuple(share * size for size in meshes[1])) for share in SCATTERED]
        for record in again:
            record |= {"study": "scatter", "errors": apart(record["values"], exact)}
        records += found + again
    return records


def held(on: RetractionModel, head: str, sizes: tuple[float, ...]) -> dict[str, Any]:
    """Record of the hold on a mesh."""
    started = time.process_time()
    finer = {name: 1e-3 * mm for name, mm in zip(uncertainty.verification_runs.COARSE, sizes, strict=True)}
    model = RetractionModel.from_scene(replace(on.scene, mesh=replace(on.scene.mesh, **finer)), on.head)
    run = ProtocolRun(model, model.hold("hold"), None).run()
    found = answer(run.result(), model.scene.patient)
    return {
        "study": "mesh",
        "method": "ngbrain:transient",
        "head": head,
        "site_mm": sizes[0],
        "near_mm": sizes[1],
        "far_mm": sizes[2],
        "order": model.scene.mesh.order,
        "ndof": run.transient.problem.fes.ndof,
        "converged": True,
        "cpu_s": time.process_time() - started,
        "threads": 1,
        "error": None,
        "values": {name: found[name] for name in QUANTITIES},
    }


def apart(values: dict[str, float], others: dict[str, float]) -> dict[str, float]:
    """Relative differences of each from the others."""
    return {name: abs(values[name] / other - 1) for name, other in others.items()}


def chart(records: list[dict], path: str) -> None:
    """Errors against time, a panel for each head, with the estimates of the check."""
    plt: Any = require("matplotlib.pyplot", "demo")
    plt.rcParams.update(STYLE)
    heads = list(dict.fromkeys(r["head"] for r in records))
    figure, panels = plt.subplots(
        1, len(heads), figsize=(5.6 * len(heads), 4.4), layout="constrained", squeeze=False, sharey=True
    )
    for axes, head in zip(panels[0], heads, strict=True):
        of = [r for r in records if r["head"] == head and "errors" in r]
        for k, (name, words) in enumerate(QUANTITIES.items()):
            line = [r for r in of if r["study"] == "mesh"]
            look = {"color": f"C{k}", "ms": 5}
            axes.plot(
                [r["cpu_s"] for r in line], [r["errors"][name] for r in line], marker="o", lw=1.4, label=words, **look
            )
            said = [r for r in line if "estimates" in r]
            axes.plot(
                [r["cpu_s"] for r in said], [r["estimates"][name] for r in said], marker="_", ls=":", lw=1, **look
            )
            again = [r for r in of if r["study"] == "scatter"]
            axes.plot([r["cpu_s"] for r in again], [r["errors"][name] for r in again], marker="x", ls="", **look)
        axes.set(xscale="log", yscale="log", xlabel="CPU time (s)", title=head)
        axes.set_xticks([20, 50, 100, 200], ["20", "50", "100", "200"])
        axes.minorticks_off()
        axes.grid(alpha=0.25, lw=0.6)
    panels[0][0].set_ylabel("relative difference from the finest mesh")
    panels[0][0].legend(fontsize=8, frameon=False)
    figure.suptitle(
        "Elements of 5.7, 4, 2.8, 2 mm at the site against 1.4 mm; dotted: what the check says; crosses: 4 mm, sizes 1 % apart",
        fontsize=10,
    )
    figure.savefig(path, dpi=150)
    plt.close(figure)


def line(r: dict) -> str:
    """One record as text."""
    text = f"{r['study']:<8}{r['head']:<10}{r['site_mm']:6.3f} mm {r['ndof']:7d} unknowns {r['cpu_s']:7.1f} s  "
    text += ", ".join(f"{QUANTITIES[name]} {value:.4g}" for name, value in r["values"].items())
    for key in ("errors", "estimates"):
        if key in r:
            text += f"; {key} " + " ".join(f"{value:.1%}" for value in r[key].values())
    return text


if __name__ == "__main__":
    main(__doc__ or "", measure, chart, line)
