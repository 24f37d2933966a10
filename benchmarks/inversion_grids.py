"""Inversions of larger and larger grids in the plane: in their elements at once, and by way of coarser elements.

A hard and a soft disc (2.5 and .5 times the background of 2100 + 700i Pa) in nearly incompressible tissue at 55 Hz, simulated
with fourth order on curved triangles, 3 % noise. `invert` chooses everything; `method` says whether its elements or coarser
ones came first. Errors are relative L2 of the storage modulus over all points, and of the discs' medians. Records with `factor`
are one factorisation of the first optimality conditions, by nested dissection of the elements and by NGSolve's sparse Cholesky
factor, which orders by minimum degree. CPU time of one thread.

    python benchmarks/inversion_grids.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/inversion_grids.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from functools import partial

import netgen.occ as occ
import ngsolve as ngs
import numpy as np
from _command import main
from _front import figure

from ngbrain.adjoint import Reduced
from ngbrain.forward import HarmonicProblem, Wave, evaluation, sensitivity
from ngbrain.inverse import (
    ElastographyProblem,
    LeastSquares,
    coarse_discretisation,
    discretise,
    invert,
    noise_deviation,
    optimise,
    smooth,
)
from ngbrain.io import WaveData
from ngbrain.materials import Shearing
from ngbrain.solvers import CpuFactor, Device

Record = dict
WIDTH, HEIGHT, MARGIN = 0.118, 0.099, 0.02
DISCS = {"hard": ((0.04, 0.055), 0.012, 2.5), "soft": ((0.085, 0.035), 0.014, 0.5)}
BACKGROUND, FREQUENCY, BULK, NOISE = 2100 + 700j, 55.0, 2.2e6, 0.03
GRIDS = (27, 40, 53, 79)
"""Points along x."""
ORDER = 3
"""Of the displacements' elements, as `invert` chooses it."""
FACTORS = {
    "nested dissection": Device.from_name("cpu"),
    "NGSolve": Device("NGSolve", partial(CpuFactor, kind="sparsecholesky")),
}
COLOURS = {"at once": "#0072B2", "coarser first": "#009E73", "nested dissection": "#0072B2", "NGSolve": "#E69F00"}


def measure(quick: bool) -> list[Record]:
    """All grids, and the smallest where it has to be quick."""
    wave = simulated()
    return [record for n in (GRIDS[:1] if quick else GRIDS) for record in rows(sampled(wave, n))]


def simulated() -> ngs.GridFunction:
    """Displacement in the whole body."""
    body = occ.MoveTo(-MARGIN, -MARGIN).Rectangle(WIDTH + 2 * MARGIN, HEIGHT + 2 * MARGIN).Face()
    body.edges.name, body.faces.name = "free", "background"
    body.edges.Min(occ.X).name = "left"
    pieces = []
    for name, (centre, radius, _) in DISCS.items():
        disc = occ.Circle(occ.Pnt(*centre), radius).Face()
        disc.faces.name, body = name, body - disc
        pieces.append(disc)
    mesh = ngs.Mesh(occ.OCCGeometry(occ.Glue([body, *pieces]), dim=2).GenerateMesh(maxh=8e-3)).Curve(4)
    stiff = mesh.MaterialCF({name: factor for name, (_, _, factor) in DISCS.items()}, default=1.0)
    height = ngs.y / HEIGHT
    drive = {"left": (1e-5 * (1 + 0.4 * height), 2e-5 * (1 - 0.3 * height**2))}
    law = Shearing(stiff * BACKGROUND.real + 1j * stiff * BACKGROUND.imag)
    problem = HarmonicProblem(mesh, law, [Wave(FREQUENCY, drive)], bulk=BULK, form="P4/P3", dirichlet="left")
    return problem.solve()[0].components[0]


def sampled(wave: ngs.GridFunction, n: int) -> WaveData:
    """Noisy data on a grid of n points along x, with the true modulus."""
    m = 1 + round((n - 1) * HEIGHT / WIDTH)
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(0, WIDTH, n), np.linspace(0, HEIGHT, m)))
    points, mesh = np.stack([x, y], axis=1), wave.space.mesh
    matrix = evaluation(ngs.H1(mesh, order=4), points)
    u = (matrix @ wave.vec.FV().NumPy().reshape(2, -1).T)[None]
    shear = np.full(len(points), BACKGROUND)
    for centre, radius, factor in DISCS.values():
        shear[np.hypot(*(points - centre).T) < radius] *= factor
    truth = {"shear": shear}
    data = WaveData(points, u, [FREQUENCY], 1000.0, "isotropic", "viscoelastic", bulk=BULK, truth=truth)
    return data.with_noise(NOISE, seed=1)


def rows(data: WaveData) -> list[Record]:
    """The inversions and factorisations of one grid."""
    elements, made = discretise(data, ORDER), []
    ways = {"at once": elements}
    if coarse_discretisation(data, ORDER) is not None:
        ways["coarser first"] = None
    common = {"points": len(data.points), "n_elements": elements.mesh.ne, "order": ORDER}
    for name, given in ways.items():
        begun = time.process_time()
        found = invert(data, given)
        spent, storage = time.process_time() - begun, found.maps["storage"]
        true = data.truth["shear"].real
        errors = {"storage": float(np.linalg.norm(storage - true) / np.linalg.norm(true))}
        for disc, (centre, radius, factor) in DISCS.items():
            inside = np.hypot(*(data.points - centre).T) < radius - 2e-3
            errors[disc] = abs(float(np.median(storage[inside])) / (factor * BACKGROUND.real) - 1)
        record = {"method": name, "error": errors["storage"], "errors": errors, "cpu_s": spent}
        record |= {"ndof": found.model["n_unknowns"], "factorisations": found.solves.factorisations}
        record |= {"converged": found.converged}
        made.append(common | record | {"regulariser": found.regulariser})
    return made + [common | factorisation(data, name) for name in FACTORS]


def factorisation(data: WaveData, name: str) -> Record:
    """CPU time of the first optimality conditions with one kind of factor, assembly included, and their size."""
    problem = ElastographyProblem(data, discretise(data, ORDER), device=FACTORS[name])
    sigma = noise_deviation(data, NOISE, problem.inside)
    unknowns, misfit = problem.unknowns(sigma), LeastSquares(problem.measured, sigma)
    boundary = sensitivity.harmonic.wave_model.BOUNDARY
    fields = [block for block in unknowns.blocks if block != boundary]
    priors = {block: smooth(problem.space, unknowns.start[unknowns.blocks[block]]) for block in fields}
    reduced = Reduced(problem.model, misfit, unknowns, priors, dict.fromkeys(priors, 1e3))
    x, width = unknowns.start, max(unknowns.blocks[block].stop for block in fields)
    state = problem.model.linearise(unknowns.theta(x), problem.waves)
    jacobian = unknowns.jacobian(x)[: problem.model.blocks[boundary].start, :width]
    begun = time.process_time()
    system = optimise.kkt.KKTSystem(
        state, jacobian, reduced.regular_matrix(x)[:width, :width], misfit.weight(state.data), False
    )
    spent, before = time.process_time() - begun, problem.model.solves.refinements
    system.step(reduced.regular_gradient(x)[:width], np.where(misfit.known, misfit.measured - state.data, 0))
    record = {"method": name, "ndof": system.n_unknowns, "error": None, "cpu_s": spent, "converged": True}
    return record | {"refinements": problem.model.solves.refinements - before}


def chart(records: list[Record], png: str) -> None:
    """Error against CPU time of every inversion, and CPU time of a factorisation by size."""
    plt, made, (left, right) = figure(9, 4, 2)
    for name in ("at once", "coarser first"):
        found = [r for r in records if r["method"] == name]
        for r in found:
            face = COLOURS[name] if r["converged"] else "none"
            label = name if r is found[0] else None
            left.plot(r["cpu_s"], 100 * r["error"], "o", color=COLOURS[name], mfc=face, label=label)
            left.annotate(
                f"{r['points']}", (r["cpu_s"], 100 * r["error"]), (4, 4), textcoords="offset points", fontsize=8
            )
        left.plot([r["cpu_s"] for r in found], [100 * r["error"] for r in found], color=COLOURS[name])
    left.set(xscale="log", xlabel="CPU time, s", ylabel="error of G′, %", title="inversions, by number of points")
    for name in FACTORS:
        found = [r for r in records if r["method"] == name]
        right.plot([r["ndof"] for r in found], [r["cpu_s"] for r in found], "o-", color=COLOURS[name], label=name)
    right.set(
        xscale="log", yscale="log", xlabel="unknowns and equations", ylabel="CPU time, s", title="one factorisation"
    )
    right.set_xticks([7e3, 14e3, 28e3, 56e3])
    for axis in (right.xaxis, right.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter("")
    for axis in (left, right):
        axis.grid(True, alpha=0.3)
        axis.legend(fontsize=8)
    made.savefig(png, dpi=140)
    plt.close(made)


def line(r: Record) -> str:
    """One record as text."""
    if "errors" not in r:
        return f"{r['points']:6} points, {r['ndof']} unknowns: {r['method']:18} {r['cpu_s']:.2f} s"
    errors = ", ".join(f"{name} {100 * value:.3g} %" for name, value in r["errors"].items())
    return f"{r['points']:6} points, {r['method']:14} {errors}; {r['factorisations']} factors, {r['cpu_s']:.0f} s"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
