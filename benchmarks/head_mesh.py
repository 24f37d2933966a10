"""Error against time of meshing a real head: ours against marching cubes and Netgen, at several sizes of element.

The outlines are those of the MNI152 brain and its ventricles. Error: distance between the mesh's surface and the outline,
root mean square over the triangles; beside it that of the volume. The peer is what one would write with the same
libraries: triangles by scikit-image's marching cubes in steps of some voxels, filled by Netgen. It gets the whole head
without a cleft, ours cuts the demo's cleft and is finer there.

    python benchmarks/head_mesh.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/head_mesh.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from _command import main

from ngbrain.errors import require
from ngbrain.image import mni152
from ngbrain.mesh import Elements, LevelSet, Sizes, Surface, routes, smallest_angles, surface
from ngbrain.scene import Scene
from ngbrain.surgery import ScannedHead

OURS, PEER = "ngbrain:hull", "marching cubes and Netgen"
REGIONS = (surface.head_outlines.BRAIN, surface.head_outlines.VENTRICLES)


def ours(scanned: ScannedHead, site: float, near: float, far: float) -> Elements:
    """Mesh with the demo's cleft, for these element sizes (mm)."""
    where = Scene.shipped("demo").cleft
    sizes = Sizes(site * 1e-3, near * 1e-3, far * 1e-3)
    return routes.cleft_head.head(scanned.outlines, where.slot(scanned), where.craniotomy, sizes).elements


def peer(scanned: ScannedHead, step: int) -> Elements:
    """Mesh by marching cubes with a step in voxels."""
    measure = require("skimage.measure", "mri")
    points, surfaces = [np.zeros((0, 3))], []
    shape = scanned.outlines
    for name, outline, sides in (("skull", shape.brain, (0, -1)), ("ventricle_wall", shape.ventricles, (1, 0))):
        corners, triangles, *_ = measure.marching_cubes(outline.values, 0.0, step_size=step)
        corners = outline.origin + outline.spacing * corners.astype(float)
        a, b, c = (corners[triangles[:, k]] for k in range(3))
        if np.einsum("ij,ij->", a, np.cross(b, c)) < 0:
            triangles = triangles[:, ::-1]
        surfaces.append(Surface(name, triangles + sum(map(len, points)), *sides))
        points.append(corners)
    return Elements.enclosed(np.concatenate(points), surfaces, REGIONS, 20e-3)


def deviation(elements: Elements, boundaries: tuple[str, ...], outline: LevelSet) -> float:
    """Root mean square distance (mm) of the middles of triangles and of their thirds from the outline, by area."""
    chosen = np.isin(elements.boundary, [elements.boundaries.index(name) for name in boundaries])
    x = elements.points[elements.triangles[chosen]]
    area = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1)
    weights = np.array([[1, 1, 1], [4, 1, 1], [1, 4, 1], [1, 1, 4]]) / [[3], [6], [6], [6]]
    squares = outline(np.einsum("qk,nkd->nqd", weights, x).reshape(-1, 3)).reshape(-1, 4) ** 2
    return 1e3 * float(np.sqrt(np.average(squares.mean(axis=1), weights=area)))


def record(method: str, size: str, scanned: ScannedHead, run: Callable[[], Elements]) -> dict:
    """One measurement; a failure is recorded too."""
    start = time.process_time()
    out = {"method": method, "size": size, "order": 1, "ndof": None, "error": None}
    try:
        made = run()
        spent = time.process_time() - start
        volumes = [made.volumes()[made.region == i].sum() for i in range(2)]
        if not min(volumes) > 0:
            raise ValueError("a region was left without tetrahedra")
        shape = scanned.outlines
        wanted = [(level.values < 0).sum() * level.spacing**3 for level in (shape.brain, shape.ventricles)]
        slot = Scene.shipped("demo").cleft
        cut = slot.opening * slot.width * slot.slot(scanned).depth if method == OURS else 0.0
        out |= {
            "n_tets": len(made.tets),
            "ndof": 3 * len(made.points),
            "error": abs((sum(volumes) + cut) / wanted[0] - 1),
            "error_mm": deviation(made, ("skull",), scanned.outlines.brain),
            "brain_volume_error": (sum(volumes) + cut) / wanted[0] - 1,
            "ventricle_volume_error": volumes[1] / wanted[1] - 1,
            "min_dihedral_deg": float(smallest_angles(made.points[made.tets]).min()),
            "converged": bool((made.volumes() > 0).all()),
        }
    except Exception as error:
        spent = time.process_time() - start
        out |= {"error_mm": None, "converged": False, "reason": str(error)[:160]}
    return out | {"cpu_s": spent}


def measure(quick: bool) -> list[dict]:
    """All records; `quick` takes less than a minute."""
    scanned = ScannedHead.from_scan(mni152())
    grids = [(4, 14, 28), (4, 10, 26)] if quick else [(4, 10, 26), (4, 10, 16), (2, 6, 12), (2, 6, 8.9), (2, 6, 7)]
    steps = (12, 8) if quick else (16, 12, 8, 6, 4, 3)
    records = [record(OURS, "{}, {}, {} mm".format(*g), scanned, lambda g=g: ours(scanned, *g)) for g in grids]
    return records + [record(PEER, f"{n} mm", scanned, lambda n=n: peer(scanned, n)) for n in steps]


def chart(records: list[dict], path: str) -> None:
    """Error against CPU time; the number of elements at every mark, failures as crosses at the top edge."""
    plt = require("matplotlib.pyplot", "report")
    figure, axes = plt.subplots(figsize=(8, 5), constrained_layout=True)
    top = 2 * max(r["error_mm"] for r in records if r["converged"])
    for method, colour, mark in ((OURS, "#0072B2", "o"), (PEER, "#D55E00", "s")):
        rows = [r for r in records if r["method"] == method]
        good, bad = ([r for r in rows if r["converged"] is state] for state in (True, False))
        axes.loglog([r["cpu_s"] for r in good], [r["error_mm"] for r in good], mark + "-", color=colour, label=method)
        axes.loglog(
            [r["cpu_s"] for r in bad],
            [top] * len(bad),
            "x",
            color=colour,
            ms=10,
            label=f"{method}: no mesh" if bad else None,
        )
        for r in good:
            angle = f"{r['min_dihedral_deg']:.0f}°" if r["min_dihedral_deg"] >= 1 else "< 1°"
            text = f"{r['size']}\n{r['n_tets']} tets, {angle}"
            beside = {"xytext": (-6, -12), "ha": "right"} if method == OURS else {"xytext": (5, 5)}
            where = (r["cpu_s"], r["error_mm"])
            axes.annotate(text, where, textcoords="offset points", fontsize=7, color=colour, **beside)
    axes.set(
        xlabel="CPU time (s)",
        ylabel="surface to outline, r.m.s. (mm)",
        title="Meshing the MNI152 brain (smallest angle between faces)",
    )
    ticks = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200]
    for axis, limits in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        chosen = [tick for tick in ticks if limits[0] <= tick <= limits[1]]
        axis.set_ticks(chosen, [f"{tick:g}" for tick in chosen])
        axis.set_ticks([], minor=True)
    axes.margins(0.18)
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=150)


def line(r: dict) -> str:
    """One record as text."""
    error = f"{r['error_mm']:.2f} mm" if r["converged"] else f"failed: {r.get('reason', 'inverted elements')}"
    return f"{r['method']:<26} {r['size']:<14} {r.get('n_tets', ''):>7}  {r['cpu_s']:6.1f} s  {error}"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
