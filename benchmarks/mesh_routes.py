"""Effect of mesh detail: the same indentation and the same 50 Hz wave on the MNI152 brain by each meshing route.

Every route gets the same labels and stiffness by tissue: as a field of voxels inside a hull, by region where interfaces
conform. Pressing: a smooth dent of 5 mm in the surface, 12 mm in radius, elastic, K/μ = 20, order 2; asked are the mean
pressure on the dent and the 95th percentile of the largest principal strain within 20 mm of it. Wave: the surface shaken
sideways, G = μ(1 + .3i) three times that (35 to 43 mm long in tissue, 15 mm in fluid), orders 2 and 3 on every mesh; asked is
the displacement at points in grey and white matter 8 mm below the surface or deeper. Errors are against the finest mesh of all
routes (`reference`; of waves that with the most unknowns), so they hold what routes differ by; `wave_own` is what order 3 changes
on the same mesh, elements' own error. CPU time is of mesh, assembly and solve.

    python benchmarks/mesh_routes.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/mesh_routes.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time

import ngsolve as ngs
import numpy as np
import scipy.sparse.linalg as sparse
from _command import main

from ngbrain.errors import require
from ngbrain.forward import LoadPath, Material, Problem
from ngbrain.image import LabelMap, label_tissues, mni152
from ngbrain.materials import NeoHooke
from ngbrain.mesh import ROUTES, Elements, RadialSizeField, outlines
from ngbrain.units import to_mmHg

MU = {"csf": 200.0, "grey": 1000.0, "white": 1500.0, "ventricles": 100.0}
"""Shear moduli (Pa)."""
BULK, DENSITY, FREQUENCY, STIFFER = 20.0, 1000.0, 50.0, 3 * (1 + 0.3j)
DENT, RADIUS, NEAR = 5e-3, 12e-3, 20e-3
SITE_FROM = np.array([0.03, 0.02, 0.06])
"""The dent is where the surface is nearest to this point (m)."""
ORDERS = (2, 3)
SIZES = {"hull": (14, 10, 7, 5), "lattice": (14, 10, 8), "conforming": (14, 10, 8, 6, 5)}
QUICK = {"hull": (16,), "lattice": (18,), "conforming": ()}
PRESSED = 65_000
"""Number of tetrahedra above which only the wave is computed."""
LOOK = {"hull": ("#0072B2", "o-"), "lattice": ("#D55E00", "s-"), "conforming": ("#009E73", "^-")}
RTOL, MOST = 1e-4, 200
"""Residual of waves that are shaken, and iterations to it before GMRES begins anew, once."""


def stiffness(mesh: ngs.Mesh, labels: LabelMap, factor: complex = 1.0) -> ngs.CoefficientFunction:
    """Shear modulus (Pa) times a factor: by region, and in a hull by voxel."""
    volume = labels.volume
    table = np.array([MU["grey"], *(MU[name] for name in labels.regions)])
    first, last = volume.to_world(np.array([[0, 0, 0], np.array(volume.data.shape) - 1]))
    values = np.ascontiguousarray(factor * table[labels.region_numbers()].transpose(2, 1, 0))
    field = ngs.VoxelCoefficient(tuple(first), tuple(last), values, linear=False)
    return mesh.MaterialCF({name: factor * mu for name, mu in MU.items()} | {"brain": field})


def press(mesh: ngs.Mesh, mu: ngs.CoefficientFunction, site: np.ndarray, inwards: np.ndarray) -> dict:
    """Pressure (mmHg) on the dent and strain near it."""
    away = (ngs.x - site[0]) ** 2 + (ngs.y - site[1]) ** 2 + (ngs.z - site[2]) ** 2
    motion = ngs.exp(-away / RADIUS**2) * ngs.CF(tuple(inwards))
    outer = "skull|outer_.*"
    material = {".*": Material(NeoHooke(mu), BULK * mu)}
    body = Problem(mesh, material, {outer: DENT * motion}, element="P2")
    LoadPath(body).solve()
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


def shake(
    mesh: ngs.Mesh, g: ngs.CoefficientFunction, bulk: ngs.CoefficientFunction, points: np.ndarray, order: int
) -> tuple[np.ndarray, int]:
    """Displacement (points, 3) where the surface moves by 1 along x, and unknowns.

    GMRES, preconditioned by a factor of the vertices' unknowns between two sweeps over blocks of those of an edge, its faces
    and its elements: a factor of order 2 of the finest of these meshes would not fit into 24 GiB.
    """
    outer = "skull|outer_.*"
    fes = ngs.VectorH1(mesh, order=order, complex=True, dirichlet=outer)
    u, v = fes.TnT()
    e, f = ngs.Sym(ngs.Grad(u)), ngs.Sym(ngs.Grad(v))
    a = ngs.BilinearForm(fes)
    a += (2 * g * ngs.InnerProduct(e, f) + bulk * ngs.Trace(e) * ngs.Trace(f)) * ngs.dx
    a += -DENSITY * (2 * np.pi * FREQUENCY) ** 2 * u * v * ngs.dx
    a.Assemble()
    gfu = ngs.GridFunction(fes)
    gfu.Set((1, 0, 0), definedon=mesh.Boundaries(outer))
    load = (-a.mat * gfu.vec).Evaluate()
    vertices, blocks = levels(mesh, fes)
    coarse, smoother = a.mat.Inverse(vertices, inverse="sparsecholesky"), a.mat.CreateBlockSmoother(blocks)
    free = np.array(list(fes.FreeDofs()))
    x, y, z = (load.CreateVector() for _ in range(3))

    def times(b: np.ndarray) -> np.ndarray:
        y.FV().NumPy()[:] = np.where(free, b, 0)
        z.data = a.mat * y
        return np.where(free, z.FV().NumPy(), b)

    def roughly(b: np.ndarray) -> np.ndarray:
        y.FV().NumPy()[:] = np.where(free, b, 0)
        x[:] = 0
        smoother.Smooth(x, y)
        z.data = y - a.mat * x
        x.data += coarse * z
        smoother.SmoothBack(x, y)
        return np.where(free, x.FV().NumPy(), b)

    n = fes.ndof
    matrix, inverse = (sparse.LinearOperator((n, n), each, dtype=complex) for each in (times, roughly))
    right = np.where(free, load.FV().NumPy(), 0)
    solution, _ = sparse.gmres(matrix, right, M=inverse, rtol=RTOL, restart=MOST, maxiter=2)
    left = float(np.linalg.norm(times(solution) - right) / np.linalg.norm(right))
    if left > 10 * RTOL:
        raise RuntimeError(f"GMRES got to {left:.1g} in {2 * MOST} iterations, not to {RTOL:g}")
    gfu.vec.FV().NumPy()[:] += np.where(free, solution, 0)
    return sampled(gfu, points), int(free.sum())


def levels(mesh: ngs.Mesh, fes: ngs.VectorH1) -> tuple[ngs.BitArray, list[list[int]]]:
    """Free unknowns of vertices; the others in blocks of an edge, its faces and its elements."""
    one, free = fes.components[0], fes.FreeDofs()
    vertices, blocks = ngs.BitArray(fes.ndof), []
    vertices.Clear()
    for k in range(3):
        for i in range(mesh.nv):
            vertices[k * one.ndof + i] = free[k * one.ndof + i]
    for edge in mesh.edges:
        parts = [edge, *edge.faces, *(ngs.NodeId(ngs.CELL, element.nr) for element in edge.elements)]
        mine = [i for part in parts for i in one.GetDofNrs(part)]
        blocks.append([k * one.ndof + i for k in range(3) for i in mine if free[k * one.ndof + i]])
    return vertices, [block for block in blocks if block]


def sampled(gfu: ngs.GridFunction, points: np.ndarray) -> np.ndarray:
    return np.array([gfu(gfu.space.mesh(*point)) for point in points])


def records_of(
    route: str, size: float, labels: LabelMap, place: tuple[np.ndarray, np.ndarray], points: np.ndarray
) -> list[dict]:
    """Records of a mesh, one for each order; the wave under the key "wave"."""
    start = time.process_time()
    record = {"method": f"ngbrain:{route}", "size_mm": size, "order": 2, "converged": False, "reason": "", "wave": None}
    try:
        made: Elements = ROUTES[route].make(labels, RadialSizeField(size * 1e-3, size * 1e-3)).elements
        mesh_s = time.process_time() - start
        record |= {"n_tets": len(made.tets), "mesh_s": mesh_s}
        mesh = made.mesh()
        if len(made.tets) < PRESSED:
            record |= press(mesh, stiffness(mesh, labels), *place) | {"cpu_s": time.process_time() - start}
        g, bulk = (stiffness(mesh, labels, factor) for factor in (STIFFER, BULK * STIFFER.real + 0j))
        waves = {}
        for order in ORDERS:
            began = time.process_time()
            waves[order] = (*shake(mesh, g, bulk, points, order), time.process_time() - began)
        own = float(np.linalg.norm(waves[2][0] - waves[3][0]) / np.linalg.norm(waves[3][0]))
        both = []
        for order, (wave, ndof, spent) in waves.items():
            also = {"wave": wave, "wave_ndof": ndof, "wave_s": mesh_s + spent, "wave_own": own if order == 2 else None}
            pressing = (
                record if order == 2 else {k: record[k] for k in ("method", "size_mm", "n_tets", "mesh_s", "reason")}
            )
            both.append({**pressing, "order": order, "converged": True, **also})
        return both
    except Exception as error:  # a failure is a record too
        return [record | {"reason": str(error)[:160], "cpu_s": time.process_time() - start}]


def measure(quick: bool) -> list[dict]:
    """All records; `quick` takes less than a minute."""
    labels = label_tissues(mni152()).labels
    brain = outlines(labels).brain
    middles = brain.outline().mean(axis=1)
    site = middles[np.linalg.norm(middles - SITE_FROM, axis=1).argmin()]
    inwards = -brain.normals(site[None])[0]
    tissue = np.isin(labels.region_numbers(), [labels.regions.index(name) + 1 for name in ("grey", "white")])
    grid = labels.volume.to_world(np.argwhere(tissue)[::601])
    points = grid[brain(grid) < -8e-3]
    place = (site, inwards / np.linalg.norm(inwards))
    plan = QUICK if quick else SIZES
    records = [r for route in ROUTES for size in plan[route] for r in records_of(route, size, labels, place, points)]
    finest = max((r for r in records if "strain_p95" in r), key=lambda r: r["ndof"])
    wave = max((r for r in records if r["wave"] is not None), key=lambda r: r["wave_ndof"])["wave"]
    for r in records:
        found, r["reference"], r["error"] = r.pop("wave"), r is finest, None
        if "strain_p95" in r:
            r["error"] = r["pressure_error"] = abs(r["pressure_mmHg"] / finest["pressure_mmHg"] - 1)
            r["strain_error"] = abs(r["strain_p95"] / finest["strain_p95"] - 1)
        if found is not None:
            r["wave_error"] = float(np.linalg.norm(found - wave) / np.linalg.norm(wave))
            if r["error"] is None:  # of the wave alone
                r |= {"error": r["wave_error"], "ndof": r["wave_ndof"], "cpu_s": r["wave_s"]}
    return records


def chart(records: list[dict], path: str) -> None:
    """Differences from the finest mesh against CPU time, the number of tetrahedra at every mark."""
    plt = require("matplotlib.pyplot", "report")
    figure, panels = plt.subplots(1, 3, figsize=(12, 5), layout="constrained")
    for axes, key, spent, title in zip(
        panels,
        ("pressure_error", "strain_error", "wave_error"),
        ("cpu_s", "cpu_s", "wave_s"),
        ("mean pressure on the dent", "strain near the dent, 95th percentile", "50 Hz wave, relative L2"),
        strict=True,
    ):
        shown = [r[key] for r in records if r.get(key)]
        for route, (colour, style) in LOOK.items():
            rows = [r for r in records if r["method"] == f"ngbrain:{route}"]
            for order, face in ((2, None), (3, "white")):
                good = [r for r in rows if r.get(key) and r["order"] == order]
                if good:
                    name = route if key != "wave_error" else f"{route}, order {order}"
                    axes.loglog(
                        [r[spent] for r in good],
                        [100 * r[key] for r in good],
                        style,
                        color=colour,
                        mfc=face,
                        label=name,
                    )
                for r in good:
                    text = f"{r['n_tets'] / 1e3:.0f}k"
                    axes.annotate(
                        text, (r[spent], 100 * r[key]), (4, 4), textcoords="offset points", fontsize=7, color=colour
                    )
            for r in rows:
                if not r["converged"]:
                    axes.plot(r["cpu_s"], 150 * max(shown), "x", color=colour, ms=9)
                    axes.annotate(r["reason"][:40], (r["cpu_s"], 150 * max(shown)), fontsize=6)
        axes.set(title=title, xlabel="CPU time (s), mesh included", ylabel="difference from the finest mesh (%)")
        axes.grid(alpha=0.3, which="both")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(lambda x, _: f"{x:g}" if f"{x:.0e}"[0] in "25" else "")
        axes.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncol=3)
    figure.savefig(path, dpi=150)


def line(r: dict) -> str:
    """One record as text."""
    start = f"{r['method']:<20} {r['size_mm']:>4} mm, order {r['order']}"
    if not r["converged"]:
        return f"{start}  failed: {r['reason']}"
    wave = f"no wave: {r['reason']}"
    if "wave_error" in r:
        wave = f"wave {r['wave_error']:.1%}, {r['wave_s']:.0f} s, {r['wave_ndof']} unknowns"
        wave += f", order 3 changes {r['wave_own']:.1%}" if r["wave_own"] else ""
    if "strain_p95" not in r:
        return f"{start}  {r['n_tets']:7d} tets  {wave}"
    asked = f"{r['pressure_mmHg']:.2f} mmHg ({r['error']:.1%}), strain {r['strain_p95']:.3f} ({r['strain_error']:.1%})"
    return f"{start}  {r['n_tets']:7d} tets {r['ndof']:8d} unknowns  {r['cpu_s']:6.1f} s  {asked}  {wave}"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
