"""A brain in a head that is turned from prone to supine: how far deep targets move, by what lies between brain and skull.

Bennion's constants of the brain in vivo (Ogden, 670 Pa, α = -19, K = 148 kPa), which were identified from the same motion, on the
MNI152 average and on Colin27 without a fit. In eleven adults Zappalà et al. 2021 measured 0.52 to 0.77 mm at surgically relevant
structures. The supine shape is that of the scan; gravity turns by twice its size. `boundary`:

    bonded          the brain sticks to the skull
    sliding         it slides along the skull without parting
    film            subarachnoid tissue of Bennion's out-of-plane stiffness, 7.7 kPa; sideways a third of it
    film and pia    and a membrane of Bennion's 1.2 MPa on the brain

`fluid` says whether cerebrospinal fluid presses on the brain's surface and lifts it: on a surface that cannot move along its normal
it does no work. `median_mm` is over the targets, `whole_mm` over the brain's volume. `error` is the distance of the median from
the measured range, relative to its middle.

Assumed: film of 2 mm, pia of 0.1 mm, densities of 1040 and 1007 kg/m³, ventricles that are as soft as 50 Pa and as compressible as
brain; no falx, no tentorium, no sulci. The targets' places are approximate ones of the MNI space.

    python benchmarks/prone_to_supine.py [--quick] [--json] [--colin T1]      last line of --json: a list of records
    python benchmarks/prone_to_supine.py --chart FILE.png < records.json

References
----------
Zappalà et al. 2021, https://doi.org/10.1038/s41598-021-97150-5
Bennion et al. 2022, https://doi.org/10.1098/rsif.2022.0557
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ngsolve as ngs
import numpy as np
from _command import main

from ngbrain import datasets
from ngbrain.errors import SolverError, require
from ngbrain.forward import BodyForce, FluidPressure, LoadPath, Material, Problem, SlidingSupport
from ngbrain.ladder import models
from ngbrain.look import STYLE
from ngbrain.materials import NeoHooke, constants
from ngbrain.mesh import surface
from ngbrain.scene import Geometry

MEASURED = (0.52, 0.77)
"""Range (mm) of the displacement of deep targets, Zappalà et al. 2021."""
TARGETS = {
    "subthalamic nucleus": (12, -14, -6),
    "internal pallidum": (20, -7, -2),
    "ventral thalamus": (14, -18, 1),
    "hippocampus": (28, -20, -15),
}
"""Approximate places (mm) on the right in MNI space; their mirror images count too."""
BRAIN, FLUID = 1040.0, 1007.0
"""Densities (kg/m³)."""
TURNED, IMAGED = (0.0, 9.81, 0.0), (0.0, -9.81, 0.0)
"""Gravity (m/s²) along right, front, up: prone, and supine as in the scanner."""
FILM, FILM_THICKNESS, PIA, PIA_THICKNESS = 7.7e3, 2e-3, 1.2e6, 1e-4
"""Stiffness (Pa) and thickness (m)."""
SIZES, QUICK = {"MNI152": (40e-3, 30e-3), "Colin27": (30e-3,)}, 36e-3
BOUNDARIES = ("bonded", "sliding", "film", "film and pia")


@dataclass(frozen=True)
class Film:
    """Layer between brain and skull: springs along the normal, and weaker ones along the surface."""

    boundary: str
    normal: ngs.CoefficientFunction

    def energy(self, at: Any) -> ngs.comp.SumOfIntegrals:
        """Stored energy (J)."""
        out = ngs.InnerProduct(at.u, self.normal)
        stored = out**2 + (ngs.InnerProduct(at.u, at.u) - out**2) / 3
        return FILM / FILM_THICKNESS / 2 * stored * at.ds(self.boundary)


@dataclass(frozen=True)
class Membrane:
    """Neo-Hookean incompressible membrane, μ h/2 (tr C + 1/det C - 3) with the surface's C."""

    boundary: str

    def energy(self, at: Any) -> ngs.comp.SumOfIntegrals:
        """Stored energy (J)."""
        F = ngs.Id(3) + at.gradient(at.u)
        trace = ngs.InnerProduct(F, F) - 1.0  # the normal is not stretched by a tangential gradient
        stored = trace + at.area_ratio(at.u) ** -2 - 3
        return PIA / 3 * PIA_THICKNESS / 2 * stored * at.ds(self.boundary)


def geometry(head: str, colin: str | None, folder: Path) -> Geometry:
    """A head by name."""
    if head == "Colin27":
        return Geometry(kind="scan", image=colin or str(datasets.write("colin27", folder)[0]))
    return Geometry(kind={"MNI152": "mni152", "idealised": "idealised"}[head])


def problem(mesh: ngs.Mesh, boundary: str, fluid: bool) -> Problem:
    """The head of a mesh, turned."""
    entry = constants("bennion2022:brain")
    tissue = Material(entry.law(), entry.bulk)
    materials = {name: tissue for name in mesh.GetMaterials()}
    densities = dict.fromkeys(materials, BRAIN)
    for name in materials:
        if name.startswith(surface.head_outlines.VENTRICLES[:-1]):
            materials[name], densities[name] = Material(NeoHooke(50.0), entry.bulk), FLUID
    change = ngs.CF(tuple(a - b for a, b in zip(TURNED, IMAGED, strict=True)))
    loads: list[Any] = [BodyForce(mesh.MaterialCF(densities) * change)]
    if fluid:
        highest = [max(way[1] / 9.81 * -v.point[1] for v in mesh.vertices) for way in (TURNED, IMAGED)]
        loads.append(FluidPressure(TURNED, highest[0], drained=False, density=FLUID))
        loads.append(FluidPressure(IMAGED, highest[1], drained=False, density=-FLUID))
    slides = SlidingSupport.on(mesh, "skull", 1e5 * entry.initial_modulus)
    if boundary.startswith("film"):
        loads.append(Film("skull", slides.normal))
    if boundary == "film and pia":
        loads.append(Membrane("skull"))
    fixed = {"skull": 0} if boundary == "bonded" else {}
    return Problem(
        mesh, materials, fixed, loads, [slides] if boundary == "sliding" else [], element="P2/P1", history=False
    )


def shift(head: str, mesh: ngs.Mesh, size: float, boundary: str, fluid: bool) -> dict:
    """Record of a turned head."""
    start = time.process_time()
    record: dict[str, Any] = {"method": f"ngbrain:{boundary}", "head": head, "boundary": boundary, "fluid": fluid}
    record |= {"order": 2, "size_mm": 1e3 * size, "tets": mesh.ne}
    body = problem(mesh, boundary, fluid)
    record["ndof"] = body.fes.ndof
    try:
        LoadPath(body).solve()
    except SolverError as error:
        return record | {
            "converged": False,
            "error": None,
            "cpu_s": time.process_time() - start,
            "reason": str(error)[:120],
        }
    places = {
        f"{name}, {side}": (sign * x, y, z)
        for name, (x, y, z) in TARGETS.items()
        for side, sign in (("left", -1), ("right", 1))
    }
    moved = {name: 1e3 * np.array(body.u(mesh(*(1e-3 * np.array(place))))) for name, place in places.items()}
    sizes = {name: float(np.linalg.norm(u)) for name, u in moved.items()}
    median = float(np.median(list(sizes.values())))
    low, high = MEASURED
    off = max(low - median, median - high, 0.0) / (0.5 * (low + high))
    volumes = np.array(ngs.Integrate(ngs.CF(1), mesh, element_wise=True))
    means = np.array(ngs.Integrate(ngs.Norm(body.u), mesh, element_wise=True)) / volumes
    order = np.argsort(means)
    whole = float(1e3 * means[order][np.searchsorted(np.cumsum(volumes[order]), volumes.sum() / 2)])
    return record | {
        "converged": True, "error": off, "median_mm": median, "least_mm": min(sizes.values()), "most_mm": max(sizes.values()),
        "forwards_mm": float(np.median([u[1] for u in moved.values()])), "whole_mm": whole, "targets_mm": sizes,
        "cpu_s": time.process_time() - start,
    }  # fmt: skip


def measure(quick: bool, colin: str | None) -> list[dict]:
    """Every head, size and boundary."""
    found = []
    heads = {"idealised": (QUICK,)} if quick else SIZES
    with tempfile.TemporaryDirectory() as folder:
        for head, sizes in heads.items():
            where = geometry(head, colin, Path(folder))
            for size in sizes:
                mesh = models.geometry.Meshes(where, size).mesh(0, plane=False)
                cases = [(boundary, True) for boundary in BOUNDARIES] + [("film", False)]
                for boundary, fluid in cases[:2] if quick else cases:
                    found.append(shift(head, mesh, size, boundary, fluid))
    return found


def line(r: dict) -> str:
    """A record in a line."""
    said = f"{r['median_mm']:.3f} mm" if r["converged"] else r["reason"]
    fluid = "fluid" if r["fluid"] else "none"
    return f"{r['head']:10} {r['size_mm']:3.0f} mm {r['tets']:6} tets  {r['boundary']:13} {fluid:6} {said}  {r['cpu_s']:.1f} s"


def chart(found: list[dict], path: str) -> None:
    """Displacement of the targets by boundary, and over the time of a solution."""
    plt: Any = require("matplotlib.pyplot", "demo")
    with plt.style.context(STYLE):
        figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
        names = [*((b, True) for b in BOUNDARIES), ("film", False)]
        words = {
            ("film", True): "film, buoyant",
            ("film", False): "film, not\nbuoyant",
            ("film and pia", True): "film and pia,\nbuoyant",
        }
        heads = list(dict.fromkeys(r["head"] for r in found))
        for axis in (left, right):
            axis.axhspan(*MEASURED, color="0.87", label="measured, 11 adults")
        for i, head in enumerate(heads):
            mine = [r for r in found if r["head"] == head and r["converged"]]
            finest = min(r["size_mm"] for r in mine)
            for k, (boundary, fluid) in enumerate(names):
                for r in mine:
                    if (r["boundary"], r["fluid"], r["size_mm"]) == (boundary, fluid, finest):
                        spread = [[r["median_mm"] - r["least_mm"]], [r["most_mm"] - r["median_mm"]]]
                        left.errorbar(
                            k + 0.2 * i - 0.1,
                            r["median_mm"],
                            spread,
                            fmt="o",
                            color=f"C{i}",
                            label=head if not k else None,
                            capsize=3,
                        )
            for k, (boundary, fluid) in enumerate(names):
                of = sorted(
                    (r["cpu_s"], r["median_mm"]) for r in mine if (r["boundary"], r["fluid"]) == (boundary, fluid)
                )
                if not of:
                    continue
                right.plot(
                    *zip(*of, strict=True),
                    "os"[i] + "-",
                    color=f"C{k + 2}",
                    label=words.get((boundary, fluid), boundary).replace("\n", " ") if not i else None,
                )
        left.set_xticks(range(len(names)), [words.get(name, name[0]) for name in names])
        left.set_ylabel("displacement of deep targets, mm")
        right.set_xlabel("CPU time, s")
        right.set_ylabel("median, mm")
        for axis in (left, right):
            axis.set_ylim(bottom=0)
            axis.legend(fontsize=8)
        figure.savefig(path)


if __name__ == "__main__":
    main(__doc__, measure, chart, line, colin={"metavar": "T1", "help": "Colin27's raw T1; by default MRIcron's"})
