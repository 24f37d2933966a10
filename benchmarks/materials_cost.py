"""What a law costs against how well it fits: one assembly of its tangent, and 1 - R² on Budday's curves of human brain.

Every law is fitted to the averaged compression, tension and shear of four regions (`ngbrain.materials.lab`, each curve
scaled by its peak); error: the mean over regions and curves of 1 - R². Time: one tangent of W(C̄) + p(J - 1) - p²/2K on
P2/P1 tetrahedra of a block, at a strained state, the fitted law of the cortex; with and without `.Compile()`. The peer is
the Neo-Hookean displacement form of NGSolve's own tutorials, μ/2 (tr C - 3) - μ ln J + λ/2 (ln J)² in `Variation`,
with Lamé's λ in place of the pressure.

    python benchmarks/materials_cost.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/materials_cost.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from collections.abc import Callable

import ngsolve as ngs
import numpy as np
from _command import main

from ngbrain.errors import require
from ngbrain.forward import solid
from ngbrain.materials import (
    Deformation,
    Demiray,
    Gent,
    HolzapfelGasserOgden,
    Law,
    Maxwell,
    MooneyRivlin,
    NeoHooke,
    Ogden,
    SaintVenant,
    Viscous,
    Yeoh,
    density,
    lab,
    perturbed_lagrangian,
)
from ngbrain.mesh import block

REGIONS = ("cortex", "corona_radiata", "basal_ganglia", "corpus_callosum")
SIZE, BULK, PATIENCE = (0.02, 0.02, 0.02), 1e6, 20.0

Maker = Callable[..., Law]
# Name → what makes the law of its parameters, a first guess, bounds.
LAWS: dict[str, tuple[Maker, dict[str, float], dict[str, tuple[float, float]]]] = {
    "Neo-Hooke": (NeoHooke, {"mu": 500.0}, {}),
    "Saint-Venant": (lambda mu: SaintVenant(mu), {"mu": 500.0}, {}),
    "Mooney-Rivlin": (lambda c10, c01: MooneyRivlin(c10, c01), {"c10": 100.0, "c01": 200.0}, {}),
    "Yeoh": (lambda c1, c2, c3: Yeoh(c1, c2, c3), {"c1": 300.0, "c2": 1e3, "c3": 1e4}, {}),
    "Demiray": (Demiray, {"mu": 500.0, "b": 10.0}, {"b": (0.1, 100.0)}),
    "Gent": (Gent, {"mu": 500.0, "jm": 0.2}, {"jm": (0.05, 100.0)}),
    "Ogden": (lambda mu, alpha: Ogden(mu, alpha), {"mu": 500.0, "alpha": -15.0}, {"alpha": (-60.0, 60.0)}),
    "Ogden, two terms": (
        lambda m1, a1, m2, a2: Ogden([m1, m2], [a1, a2]),
        {"m1": 400.0, "a1": -20.0, "m2": 50.0, "a2": 15.0},
        {"a1": (-60.0, -1.0), "a2": (1.0, 60.0), "m1": (1.0, 1e4), "m2": (1e-3, 1e4)},
    ),
    "exponential of all fibres": (
        lambda mu, k1, k2: HolzapfelGasserOgden(mu, k1, k2, 1 / 3, (1.0, 0.0, 0.0)),
        {"mu": 300.0, "k1": 1e3, "k2": 10.0},
        {"k1": (1.0, 1e5), "k2": (0.1, 200.0)},
    ),
}


def fitted(name: str, regions: tuple[str, ...]) -> tuple[Law, float]:
    """The law of the first region's fit, and the mean of 1 - R² over regions and curves."""
    make, start, bounds = LAWS[name]
    fits = [lab.fit(make, lab.budday(region), start, bounds) for region in regions]
    return fits[0].law, float(np.mean([1 - r2 for fit in fits for r2 in fit.r2.values()]))


def strained(fes: ngs.FESpace) -> ngs.GridFunction:
    """A state of some ten percent strain."""
    gfu = ngs.GridFunction(fes)
    bend = ngs.CF((ngs.y * ngs.z, 0.2 * ngs.x * ngs.x, ngs.x * ngs.y)) / SIZE[0]
    (gfu.components[0] if gfu.components[0].dim == 3 else gfu).Set(0.15 * bend)
    return gfu


def assembly(fes: ngs.FESpace, energy: ngs.CF, repeats: int, rules: dict | None = None) -> float:
    """CPU seconds of one tangent, the best of several."""
    form = ngs.BilinearForm(fes, symmetric=True)
    term = ngs.SymbolicEnergy(energy)
    for shape, rule in (rules or {}).items():
        term.SetIntegrationRule(shape, rule)
    form += term
    state, seconds = strained(fes).vec, []
    for _ in range(repeats + 1):
        start = time.process_time()
        form.AssembleLinearization(state)
        seconds.append(time.process_time() - start)
        if sum(seconds) > PATIENCE:
            return seconds[-1] if len(seconds) == 1 else min(seconds)
    return min(seconds[1:])


def mixed(mesh: ngs.Mesh, law: Law) -> tuple[ngs.FESpace, ngs.CF]:
    """P2/P1 and the energy of an elastic law on it."""
    fes = ngs.VectorH1(mesh, order=2) * ngs.H1(mesh, order=1)
    u, p = fes.TrialFunction()
    at = Deformation.from_gradient(ngs.Id(3) + ngs.Grad(u))
    return fes, density(law, at) + perturbed_lagrangian(at.J, p, BULK)


def flowing(mesh: ngs.Mesh, law: Law) -> tuple[ngs.FESpace, ngs.CF, dict]:
    """The same with two Maxwell branches of the law beside it, in the middle of a time step."""
    fes = ngs.VectorH1(mesh, order=2) * ngs.H1(mesh, order=1)
    material = Viscous(law, (Maxwell(law, 1e3), Maxwell(law, 1e5)))
    history = solid.internal_variables.History(mesh, {"tissue": material}, 1)
    state = strained(fes).components[0]
    history.follow(Deformation.from_gradient(ngs.Id(3) + ngs.Grad(state)).shape)
    history.begin(1.0)
    history.relax()
    history.maxwell.stiffen()
    u, p = fes.TrialFunction()
    at = Deformation.from_gradient(ngs.Id(3) + ngs.Grad(u))
    energy = material.density(at, []) + history.energy(material, at.shape) + perturbed_lagrangian(at.J, p, BULK)
    return fes, energy, history.rules


def tutorial(mesh: ngs.Mesh) -> tuple[ngs.FESpace, ngs.CF]:
    """What NGSolve's tutorials write."""
    fes = ngs.VectorH1(mesh, order=2)
    F = ngs.Id(3) + ngs.Grad(fes.TrialFunction())
    J = ngs.Det(F)
    return fes, 250 * (ngs.Trace(F.trans * F) - 3) - 500 * ngs.log(J) + BULK / 2 * ngs.log(J) ** 2


def measure(quick: bool) -> list[dict]:
    """One record for each law, and the peer's."""
    mesh = block(SIZE, 0.008 if quick else 0.005)
    regions = REGIONS[:1] if quick else REGIONS
    repeats = 2 if quick else 5
    records, ogden, neo = [], None, None
    for name in LAWS:
        law, error = fitted(name, regions)
        ogden = law if name == "Ogden" else ogden
        fes, energy = mixed(mesh, law)
        plain = assembly(fes, energy, repeats)
        compiled = assembly(fes, energy.Compile(), repeats)
        neo = neo or compiled
        record = {"law": name, "method": f"ngbrain:{name}", "order": 2, "ndof": fes.ndof, "error": error}
        records.append({**record, "cpu_s": compiled, "ratio": compiled / neo, "plain": plain / neo, "converged": True})
    error = next(r["error"] for r in records if r["law"] == "Ogden")
    fes, energy, rules = flowing(mesh, ogden)
    plain, compiled = assembly(fes, energy, repeats, rules), assembly(fes, energy.Compile(), repeats, rules)
    name = "Ogden, two Maxwell branches"
    record = {"law": name, "method": f"ngbrain:{name}", "order": 2, "ndof": fes.ndof, "error": error}
    records.append({**record, "cpu_s": compiled, "ratio": compiled / neo, "plain": plain / neo, "converged": True})
    fes, energy = tutorial(mesh)
    plain, compiled = assembly(fes, energy, repeats), assembly(fes, energy.Compile(), repeats)
    record = {
        "law": "Neo-Hooke",
        "method": "NGSolve tutorial",
        "order": 2,
        "ndof": fes.ndof,
        "error": records[0]["error"],
    }
    records.append({**record, "cpu_s": compiled, "ratio": compiled / neo, "plain": plain / neo, "converged": True})
    return records


def chart(records: list[dict], path: str) -> None:
    """1 - R² against the cost of an assembly relative to Neo-Hooke; a line leads to the cost without `.Compile()`."""
    plt = require("matplotlib.pyplot", "report")
    figure, axes = plt.subplots(figsize=(9, 5.4), layout="constrained")
    colours = plt.get_cmap("tab10")
    for k, r in enumerate(records):
        colour = "#555555" if r["method"].startswith("NGSolve") else colours(k % 10)
        label = r["method"].removeprefix("ngbrain:")
        axes.plot([r["ratio"], r["plain"]], [r["error"]] * 2, "-", color=colour, lw=0.9, alpha=0.6)
        axes.plot(r["plain"], r["error"], "o", mfc="white", mec=colour, ms=7)
        axes.plot(r["ratio"], r["error"], "o", color=colour, ms=8, label=label)
    axes.set(xscale="log", yscale="log", ylabel="1 - R², mean over regions and curves")
    axes.set_xlabel("time of one assembly, Neo-Hooke compiled = 1      (full: compiled; hollow: not)")
    axes.set_title("What a law costs, and how well it fits human brain (Budday 2017)")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("{x:g}")
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=8.5, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
    figure.savefig(path, dpi=150)


def line(r: dict) -> str:
    """One record as text."""
    return f"{r['method']:<38} 1 - R² {r['error']:.3f}   {r['ratio']:6.2f} compiled   {r['plain']:7.2f} not"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
