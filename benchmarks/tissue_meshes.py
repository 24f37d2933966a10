"""Meshes of all tissues of the MNI152 brain: interface error and element quality against CPU time.

Routes `lattice` and `conforming` of ngbrain, even and graded (2 mm within 20 mm of a site, 10.5 for a lattice, 8 mm away),
against the peer that needs no library: cubes of voxels cut into six tetrahedra each. Error: mean of the first-order distance
|φ|/|∇φ| of triangles between regions from where the labels' smoothed shares are equal (at most 5 mm), over a voxel of 1 mm;
beside it its 95th percentile, within 20 mm of the site for graded meshes, the smallest dihedral angle, slivers, and the
regions' volumes.

    python benchmarks/tissue_meshes.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/tissue_meshes.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache

import numpy as np
from _command import main, sweep

from ngbrain import parallel
from ngbrain.errors import require
from ngbrain.image import LabelMap, label_tissues, mni152
from ngbrain.mesh import (
    ROUTES,
    Elements,
    Indicators,
    Quality,
    RadialSizeField,
    deviations,
    named_elements,
    volume_errors,
)

SITE, NEAR = (0.03, 0.0, 0.05), 20e-3
CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
SIX = np.array([[0, 4, 6, 7], [0, 6, 2, 7], [0, 2, 3, 7], [0, 3, 1, 7], [0, 1, 5, 7], [0, 5, 4, 7]])
"""Kuhn triangulation of a cube."""
LOOK = {
    "ngbrain:lattice": ("#D55E00", "s-"),
    "ngbrain:conforming": ("#009E73", "o-"),
    "voxels in six": ("#999999", "v--"),
}


def voxels(labels: LabelMap, stride: int) -> Elements:
    """Six tetrahedra in every cube of `stride` voxels a side, with its most frequent label."""
    data = labels.region_numbers()
    shape = -(-np.array(data.shape) // stride)
    data = np.pad(data, [(0, n * stride - m) for n, m in zip(shape, data.shape, strict=True)])
    blocks = data.reshape(shape[0], stride, shape[1], stride, shape[2], stride)
    counts = [(blocks == k).sum(axis=(1, 3, 5)) for k in range(len(labels.regions) + 1)]
    cubes = np.argmax(counts, axis=0)
    at = np.argwhere(cubes > 0)
    nodes = np.ravel_multi_index(np.moveaxis(at[:, None] + CORNERS, 2, 0), shape + 1)
    tets = nodes[:, SIX].reshape(-1, 4)
    grid = stride * np.indices(shape + 1).reshape(3, -1).T - 0.5
    points = labels.volume.to_world(grid)
    x = points[tets[:6]]
    if np.linalg.det(x[:, 1:] - x[:, :1])[0] > 0:
        tets = tets[:, [1, 0, 2, 3]]
    return named_elements(points, tets, np.repeat(cubes[tuple(at.T)] - 1, 6), labels.regions)


def record(method: str, size: str, make: Callable[[], Elements], labels: LabelMap, graded: bool) -> dict:
    """One measurement; a failure is recorded too."""
    found = {
        "method": method,
        "size": size,
        "graded": graded,
        "order": 1,
        "converged": False,
        "reason": "",
        "error": None,
    }
    start = time.process_time()
    try:
        made = make()
        found["cpu_s"] = time.process_time() - start
        where = (lambda points: np.linalg.norm(points - np.array(SITE), axis=1) < NEAR) if graded else None
        off = 1e3 * np.concatenate(list(deviations(made, Indicators.of(labels), where).values()))
        return found | {
            "ndof": len(made.points), "n_tets": len(made.tets), "error": float(off.mean()), "mean_mm": float(off.mean()),
            "p95_mm": float(np.percentile(off, 95)), "volume_errors": volume_errors(made, labels),
            **Quality.of(made).summary(), "converged": bool((made.volumes() > 0).all()),
        }  # fmt: skip
    except Exception as error:
        return found | {"cpu_s": time.process_time() - start, "reason": str(error)[:160]}


def measure(quick: bool, executor: parallel.AnyExecutor = None) -> list[dict]:
    """All records; `quick` takes less than a minute."""
    even = {"lattice": (7,), "conforming": (8,)} if quick else {"lattice": (6, 4, 3.1, 2.5), "conforming": (6, 4, 2.5)}
    cases: list[tuple[str, float | None]] = []
    for route, sizes in even.items():
        cases += [(route, size) for size in sizes] + ([] if quick else [(route, None)])
    cases += [("voxels", stride) for stride in ((4,) if quick else (4, 3, 2))]
    return sweep(case, {f"{route} {size}": (route, size) for route, size in cases}, executor)


def case(route: str, size: float | None) -> dict:
    """Mesh by a route with uniform elements (mm), or graded without a size; or of voxel cubes."""
    labels = _labels()
    if route == "voxels":
        return record("voxels in six", f"{size} mm", lambda: voxels(labels, size), labels, False)
    made = ROUTES[route]
    field = (
        RadialSizeField(2e-3, 8e-3, SITE, radius=made.radius)
        if size is None
        else RadialSizeField(size * 1e-3, size * 1e-3)
    )
    name = "2 to 8 mm" if size is None else f"{size:g} mm"
    return record(f"ngbrain:{route}", name, lambda: made.make(labels, field).elements, labels, size is None)


@cache
def _labels() -> LabelMap:
    return label_tissues(mni152()).labels


def chart(records: list[dict], path: str) -> None:
    """Distance against CPU time and the worst angle against tetrahedra; open marks are graded meshes near their site."""
    plt = require("matplotlib.pyplot", "report")
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained")
    for method, (colour, style) in LOOK.items():
        rows = [r for r in records if r["method"] == method and r["converged"]]
        even = [r for r in rows if not r["graded"]]
        left.loglog([r["cpu_s"] for r in even], [r["mean_mm"] for r in even], style, color=colour, label=method)
        left.loglog([r["cpu_s"] for r in even], [r["p95_mm"] for r in even], style[0], color=colour, alpha=0.35, ms=4)
        right.semilogx(
            [r["n_tets"] for r in even], [r["min_dihedral_deg"] for r in even], style, color=colour, label=method
        )
        for r in rows:
            if r["graded"]:
                left.plot(r["cpu_s"], r["mean_mm"], style[0], color=colour, mfc="white", ms=8)
                right.plot(r["n_tets"], r["min_dihedral_deg"], style[0], color=colour, mfc="white", ms=8)
            text = f"{r['size']}, {r['n_tets'] / 1e3:.0f}k"
            beside = {"xytext": (5, 4)} if "lattice" not in method else {"xytext": (-6, -9), "ha": "right"}
            beside = {"xytext": (-6, 3), "ha": "right"} if r["graded"] else beside
            left.annotate(
                text, (r["cpu_s"], r["mean_mm"]), textcoords="offset points", fontsize=7, color=colour, **beside
            )
    left.set(
        xlabel="CPU time (s)", ylabel="distance from where tissues meet (mm)", title="mean, and small: 95th percentile"
    )
    left.set_xlim(right=400)  # room for the last label
    left.yaxis.set_major_formatter("{x:g}")
    left.yaxis.set_minor_formatter(lambda y, _: f"{y:g}" if f"{y:g}"[-1] in "23 5" else "")
    right.set(xlabel="tetrahedra", ylabel="smallest dihedral angle (°)", title="the worst element", ylim=(0, None))
    for axes in (left, right):
        axes.grid(alpha=0.3, which="both")
    left.legend(fontsize=8)
    right.legend(fontsize=8, loc="center right")
    figure.savefig(path, dpi=150)


def line(r: dict) -> str:
    """One record as text."""
    start = f"{r['method']:<20} {r['size']:<10} {r['cpu_s']:6.1f} s"
    if not r["converged"]:
        return f"{start}  failed: {r['reason']}"
    volumes = ", ".join(f"{name} {100 * error:+.1f}" for name, error in r["volume_errors"].items())
    quality = f"{r['min_dihedral_deg']:5.1f}°, flat {r['fraction_radius_ratio_below_0_1']:.3%}"
    return f"{start} {r['n_tets']:8d} tets  {r['mean_mm']:.3f} mm, 95 % {r['p95_mm']:.2f}  {quality}  {volumes} %"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
