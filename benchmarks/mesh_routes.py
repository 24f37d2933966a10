"""Does the detail of a mesh matter? The same pressing and the same 50 Hz wave on the brain of MNI152 by each route.

Every route gets the same labels and stiffness by tissue: as a field of voxels inside a hull, by region where interfaces
conform. Pressing: a smooth dent of 5 mm in the surface, 12 mm in radius, elastic, K/μ = 20, order 2; asked are the mean
pressure on the dent and the 95th percentile of the largest principal strain within 20 mm of it. Wave: the surface shaken
sideways, G = μ(1 + .3i) three times that; asked is the displacement on a grid of points. Errors are against the finest mesh
of all routes (`reference`), so they hold what routes differ by; CPU time is of mesh, assembly and solve.

    python benchmarks/mesh_routes.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/mesh_routes.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time

import ngsolve as ngs
import numpy as np
from _command import main

from ngbrain.errors import require
from ngbrain.forward.material import Material
from ngbrain.forward.static import Static
from ngbrain.image import mni152
from ngbrain.image.labelfile import TISSUES
from ngbrain.image.labelmap import LabelMap
from ngbrain.image.tissues import tissues
from ngbrain.materials import NeoHooke
from ngbrain.mesh.elements import Elements
from ngbrain.mesh.grading import Graded
from ngbrain.mesh.hull import outlines
from ngbrain.mesh.routes import ROUTES
from ngbrain.units import to_mmHg

MU = {"csf": 200.0, "grey": 1000.0, "white": 1500.0, "ventricles": 100.0}
"""Shear moduli (Pa)."""
BULK, DENSITY, FREQUENCY, STIFFER = 20.0, 1000.0, 50.0, 3 * (1 + 0.3j)
DENT, RADIUS, NEAR = 5e-3, 12e-3, 20e-3
SITE_FROM = np.array([0.03, 0.02, 0.06])
"""The dent is where the surface is nearest to this point (m)."""
SIZES = {"hull": (14, 10, 8), "lattice": (14, 10), "conforming": (14, 10)}
QUICK = {"hull": (14, 11), "lattice": (16,), "conforming": ()}
LOOK = {"hull": ("#0072B2", "o-"), "lattice": ("#D55E00", "s-"), "conforming": ("#009E73", "^-")}
WAVE_UNKNOWNS = 150_000
"""A wave's factor has complex numbers: more would not fit."""


def stiffness(mesh: ngs.Mesh, labels: LabelMap, factor: complex = 1.0) -> ngs.CoefficientFunction:
    """Shear modulus (Pa) times a factor: by region, and in a hull by voxel."""
    volume = labels.volume
    table = np.array([MU["grey"], *(MU[name] for name in labels.regions)])
    first, last = volume.to_world(np.array([[0, 0, 0], np.array(volume.data.shape) - 1]))
    values = np.ascontiguousarray(factor * table[labels.numbered()].transpose(2, 1, 0))
    field = ngs.VoxelCoefficient(tuple(first), tuple(last), values, linear=False)
    return mesh.MaterialCF({name: factor * mu for name, mu in MU.items()} | {"brain": field})


def press(mesh: ngs.Mesh, mu: ngs.CoefficientFunction, site: np.ndarray, inwards: np.ndarray) -> dict:
    """Pressure (mmHg) on the dent and strain near it."""
    away = (ngs.x - site[0]) ** 2 + (ngs.y - site[1]) ** 2 + (ngs.z - site[2]) ** 2
    motion = ngs.exp(-away / RADIUS**2) * ngs.CF(tuple(inwards))
    outer = "skull|outer_.*"
    material = {".*": Material(NeoHooke(mu), BULK * mu)}
    body = Static(mesh, material, {outer: DENT * motion}, form="P2")
    body.solve()
    force = body.conjugate(motion, outer)
    area = ngs.Integrate(ngs.exp(-away / RADIUS**2), mesh, ngs.BND, definedon=mesh.Boundaries(outer))
    F = ngs.Id(3) + ngs.Grad(body.u)
    rule = mesh.MapToAllElements({ngs.TET: ngs.IntegrationRule(ngs.TET, 2)}, ngs.VOL)
    C = (F.trans * F)(rule).reshape(-1, 3, 3)
    near = ngs.sqrt(away)(rule).ravel() < NEAR
    volume = np.abs(ngs.Det(ngs.specialcf.JacobianMatrix(3))(rule).ravel())[near]
    strain = (np.linalg.eigvalsh(C[near])[:, 2] - 1) / 2
    order = np.argsort(strain)
    share = np.cumsum(volume[order]) / volume.sum()
    p95 = strain[order][np.searchsorted(share, 0.95)]
    return {"pressure_mmHg": float(to_mmHg(force / area)), "strain_p95": float(p95), "ndof": body.fes.ndof}


def shake(mesh: ngs.Mesh, g: ngs.CoefficientFunction, bulk: ngs.CoefficientFunction, points: np.ndarray) -> np.ndarray:
    """Displacement (points, 3) where the surface moves by 1 along x."""
    outer = "skull|outer_.*"
    fes = ngs.VectorH1(mesh, order=2, complex=True, dirichlet=outer)
    u, v = fes.TnT()
    e, f = ngs.Sym(ngs.Grad(u)), ngs.Sym(ngs.Grad(v))
    a = ngs.BilinearForm(fes, symmetric=True)
    a += (2 * g * ngs.InnerProduct(e, f) + bulk * ngs.Trace(e) * ngs.Trace(f)) * ngs.dx
    a += -DENSITY * (2 * np.pi * FREQUENCY) ** 2 * u * v * ngs.dx
    a.Assemble()
    gfu = ngs.GridFunction(fes)
    gfu.Set((1, 0, 0), definedon=mesh.Boundaries(outer))
    r = (-a.mat * gfu.vec).Evaluate()
    gfu.vec.data += a.mat.Inverse(fes.FreeDofs(), inverse="sparsecholesky") * r
    return np.array([gfu(mesh(*point)) for point in points])


def one(route: str, size: float, labels: LabelMap, place: tuple[np.ndarray, np.ndarray], points: np.ndarray) -> dict:
    """A record, and the wave under the key "wave"."""
    record = {"method": f"ngbrain:{route}", "size_mm": size, "order": 2, "converged": False, "reason": "", "wave": None}
    start = time.process_time()
    try:
        made: Elements = ROUTES[route].make(labels, Graded(size * 1e-3, size * 1e-3)).elements
        record |= {"n_tets": len(made.tets), "mesh_s": time.process_time() - start}
        mesh = made.mesh()
        mu = stiffness(mesh, labels)
        record |= press(mesh, mu, *place) | {"cpu_s": time.process_time() - start, "converged": True}
        if record["ndof"] <= WAVE_UNKNOWNS:
            started = time.process_time()
            g, bulk = (stiffness(mesh, labels, factor) for factor in (STIFFER, BULK * STIFFER.real + 0j))
            record["wave"] = shake(mesh, g, bulk, points)
            record["wave_s"] = record["mesh_s"] + time.process_time() - started
    except Exception as error:  # a failure is a record too
        record |= {"reason": str(error)[:160], "cpu_s": time.process_time() - start}
    return record


def measure(quick: bool) -> list[dict]:
    """All records; `quick` stays under a minute."""
    labels = LabelMap(tissues(mni152()), TISSUES)
    brain, _ = outlines(labels)
    middles = brain.outline().mean(axis=1)
    site = middles[np.linalg.norm(middles - SITE_FROM, axis=1).argmin()]
    inwards = -brain.normals(site[None])[0]
    grid = labels.volume.to_world(np.argwhere(labels.volume.data > 0)[::701])
    points = grid[brain(grid) < -8e-3]
    place = (site, inwards / np.linalg.norm(inwards))
    plan = QUICK if quick else SIZES
    records = [one(route, size, labels, place, points) for route in ROUTES for size in plan[route]]
    finest = max((r for r in records if r["converged"]), key=lambda r: r["ndof"])
    wave = max((r for r in records if r["wave"] is not None), key=lambda r: r["ndof"])
    for r in records:
        found, r["reference"], r["error"] = r.pop("wave") if r is not wave else None, r is finest, None
        if r["converged"]:
            r["error"] = abs(r["pressure_mmHg"] / finest["pressure_mmHg"] - 1)
            r["strain_error"] = abs(r["strain_p95"] / finest["strain_p95"] - 1)
        if found is not None:
            r["wave_error"] = float(np.linalg.norm(found - wave["wave"]) / np.linalg.norm(wave["wave"]))
    wave.pop("wave")
    return records


def chart(records: list[dict], path: str) -> None:
    """Differences from the finest mesh against CPU time, the number of tetrahedra at every mark."""
    plt = require("matplotlib.pyplot", "report")
    figure, panels = plt.subplots(1, 3, figsize=(12, 4.4), layout="constrained")
    for axes, key, spent, title in zip(
        panels,
        ("error", "strain_error", "wave_error"),
        ("cpu_s", "cpu_s", "wave_s"),
        ("mean pressure on the dent", "strain near the dent, 95th percentile", "50 Hz wave, relative L2"),
        strict=True,
    ):
        shown = [r[key] for r in records if r.get(key)]
        for route, (colour, style) in LOOK.items():
            rows = [r for r in records if r["method"] == f"ngbrain:{route}"]
            good = [r for r in rows if r.get(key)]
            axes.loglog([r[spent] for r in good], [r[key] for r in good], style, color=colour, label=route)
            for r in good:
                text = f"{r['n_tets'] / 1e3:.0f}k"
                axes.annotate(text, (r[spent], r[key]), (4, 4), textcoords="offset points", fontsize=7, color=colour)
            for r in rows:
                if not r["converged"]:
                    axes.plot(r["cpu_s"], 1.5 * max(shown), "x", color=colour, ms=9)
                    axes.annotate(r["reason"][:40], (r["cpu_s"], 1.5 * max(shown)), fontsize=6)
        axes.set(title=title, xlabel="CPU time (s), mesh included", ylabel="difference from the finest mesh")
        axes.grid(alpha=0.3, which="both")
        axes.legend(fontsize=8)
    figure.savefig(path, dpi=150)


def line(r: dict) -> str:
    """A record to read."""
    start = f"{r['method']:<20} {r['size_mm']:>4} mm"
    if not r["converged"]:
        return f"{start}  failed: {r['reason']}"
    wave = f"{r['wave_error']:.1%}" if r.get("wave_error") else "-"
    asked = f"{r['pressure_mmHg']:.2f} mmHg, strain {r['strain_p95']:.3f}, wave {wave}"
    return f"{start}  {r['n_tets']:7d} tets {r['ndof']:8d} unknowns  {r['cpu_s']:6.1f} s  {asked}"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
