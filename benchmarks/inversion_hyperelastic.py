"""The stiffness of a block with a stiff ball in it from two large deformations, by three optimisers, in units of forward solves.

A block of 10 cm, Neo-Hooke of 1 kPa with a ball (in the plane a disc) of 3 kPa, K = 50 kPa, between plates that do not slide:
pressed by 15 %, and sheared by 20 %. Simulated with third order on tetrahedra that know the ball; displacements at points and
the force on the plate with 1 and 2 % noise; inverted in P2/P1 on a coarse structured mesh that does not, for ln μ in P1 on it,
H1 regulariser, weights by the discrepancy principle, from a uniform start. `error` is ‖μ - truth‖/‖truth‖ in L2, `contrast` the
ball's median over the rest's (3 in truth), `forwards` the CPU time in cold forward solves of both loads.

    python benchmarks/inversion_hyperelastic.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/inversion_hyperelastic.py --chart FILE.png < records.json
"""

from __future__ import annotations

import sys
import time
from dataclasses import asdict, dataclass
from functools import cached_property

import netgen.occ as occ
import ngsolve as ngs
import numpy as np
from _command import main
from _front import figure
from _optimisers import COLOURS, OPTIMISERS
from ngsolve.meshes import MakeStructured2DMesh, MakeStructured3DMesh

from ngbrain.adjoint import Reduced
from ngbrain.forward import Displacements, Force, LoadCase, Material, Problem, StaticModel
from ngbrain.inverse import DiscrepancyPrinciple, LeastSquares, ParameterFields, Unknown, smooth
from ngbrain.materials import NeoHooke

Record = dict
SIDE, SOFT, STIFF, BULK, START = 0.1, 1e3, 3e3, 5e4, 1.5e3
CENTRE, RADIUS = (0.055, 0.05, 0.052), 0.022
PRESSED, SHEARED = 0.15 * SIDE, 0.2 * SIDE


@dataclass(frozen=True)
class Block:
    """A problem of it.

    dim     2 or 3
    fine    element size (m) of the simulation
    cells   along a side of the inversion's mesh
    points  along a side
    """

    dim: int
    fine: float
    cells: int
    points: int

    @property
    def loads(self) -> list[dict]:
        """Supports of both."""
        across = (0.0,) * (self.dim - 2)
        return [{"bottom": 0, "top": (0.0, *across, -PRESSED)}, {"bottom": 0, "top": (SHEARED, *across, 0.0)}]

    @cached_property
    def grid(self) -> np.ndarray:
        """Where displacements are measured (n, dim)."""
        line = (np.arange(self.points) + 0.5) * SIDE / self.points
        return np.stack(np.meshgrid(*[line] * self.dim), axis=-1).reshape(-1, self.dim)

    def inside(self, points: np.ndarray) -> np.ndarray:
        """Which points are in the ball."""
        return np.linalg.norm(points - np.array(CENTRE[: self.dim]), axis=1) < RADIUS

    def model(self, mesh: ngs.Mesh, mu: ngs.CoefficientFunction, form: str, parameters: dict) -> StaticModel:
        """Of both loads."""
        made = {".*": Material(NeoHooke(mu), BULK)}
        bodies = [Problem(mesh, made, supports, element=form) for supports in self.loads]
        return StaticModel(
            [LoadCase(body, [Displacements(self.grid), Force("top")]) for body in bodies], parameters, steps=2
        )

    def simulated(self) -> np.ndarray:
        """Data without noise."""
        mesh = ngs.Mesh(self._geometry().GenerateMesh(maxh=self.fine))
        mu = mesh.MaterialCF({"ball": STIFF}, default=SOFT)
        model = self.model(mesh, mu, "P3/P2", {"none": ngs.Parameter(0.0)})
        return model.evaluate(model.theta).data

    def measured(self, noise: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Noisy data and σ: a part of the rms displacement of each load, and of each force's size."""
        data, sigma = self._clean, np.empty_like(self._clean)
        for part in np.split(np.arange(len(data)), 2):
            moved, force = part[: -self.dim], part[-self.dim :]
            sigma[moved] = noise * np.sqrt(np.mean(data[moved] ** 2) * self.dim)
            sigma[force] = noise * np.linalg.norm(data[force])
        return data + sigma * np.random.default_rng(seed).normal(size=len(data)), sigma

    @cached_property
    def _clean(self) -> np.ndarray:
        return self.simulated()

    def coarse(self) -> ngs.Mesh:
        """The inversion's."""
        n = self.cells
        if self.dim == 2:
            return MakeStructured2DMesh(quads=False, nx=n, ny=n, mapping=lambda x, y: (SIDE * x, SIDE * y))
        return MakeStructured3DMesh(
            hexes=False, nx=n, ny=n, nz=n, mapping=lambda x, y, z: (SIDE * x, SIDE * y, SIDE * z)
        )

    def _geometry(self) -> occ.OCCGeometry:
        if self.dim == 2:
            whole, ball = occ.Rectangle(SIDE, SIDE).Face(), occ.Circle(occ.Pnt(*CENTRE[:2]), RADIUS).Face()
        else:
            whole, ball = occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(SIDE, SIDE, SIDE)), occ.Sphere(occ.Pnt(*CENTRE), RADIUS)
        up = occ.Y if self.dim == 2 else occ.Z
        sides = whole.edges if self.dim == 2 else whole.faces
        sides.name = "side"
        sides.Min(up).name, sides.Max(up).name = "bottom", "top"
        ball.mat("ball") if self.dim == 3 else setattr(ball.faces, "name", "ball")
        return occ.OCCGeometry(occ.Glue([whole - ball, ball]), dim=self.dim)


def inverted(block: Block, method: str, noise: float) -> Record:
    """By one method."""
    mesh = block.coarse()
    mu = ngs.GridFunction(ngs.H1(mesh, order=1))
    mu.vec[:] = START
    model = block.model(mesh, mu, "P2/P1", {"mu": mu})
    begun = time.process_time()
    model.evaluate(model.theta)
    forward = time.process_time() - begun
    data, sigma = block.measured(noise)
    fields = ParameterFields(model.theta, model.blocks, {"mu": Unknown(START)})
    reduced = Reduced(model, LeastSquares(data, sigma), fields, {"mu": smooth(mu.space, fields.start)}, {"mu": 10.0})
    begun = time.process_time()
    found = OPTIMISERS[method](reduced, fields.start, DiscrepancyPrinciple())
    cpu = time.process_time() - begun
    mu.vec.FV().NumPy()[:] = fields.theta(found.x)
    away = ngs.CF((ngs.x, ngs.y, ngs.z)[: block.dim]) - ngs.CF(CENTRE[: block.dim])
    truth = ngs.IfPos(RADIUS**2 - ngs.InnerProduct(away, away), STIFF, SOFT)
    wrong, all_of_it = (ngs.Integrate(f * ngs.dx(bonus_intorder=8), mesh) for f in ((mu - truth) ** 2, truth**2))
    values, core = mu(mesh(*block.grid.T)).ravel(), block.inside(block.grid)
    return {
        "method": f"ngbrain:{method}",
        "case": "plane" if block.dim == 2 else "space",
        "noise": noise,
        "order": 2,
        "ndof": model.equilibria[0].body.fes.ndof,
        "unknowns": len(found.x),
        "error": float(np.sqrt(wrong / all_of_it)),
        "contrast": float(np.median(values[core]) / np.median(values[~core])),
        "cpu_s": cpu,
        "forward_s": forward,
        "forwards": cpu / forward,
        "converged": found.converged,
        "misfit_over_expected": found.level.ratio,
        "rounds": len(found.history),
        "solves": asdict(model.solves),
    }


def measure(quick: bool) -> list[Record]:
    """All methods in the plane at two noises and in space at one; there one of them on a finer mesh too."""
    plane = Block(2, 0.008, 6 if quick else 8, 6 if quick else 8)
    space = Block(3, 0.03 if quick else 0.022, 2 if quick else 3, 5 if quick else 6)
    asked = [(plane, method, noise) for noise in ((0.01,) if quick else (0.01, 0.02)) for method in OPTIMISERS]
    asked += [(space, method, 0.01) for method in list(OPTIMISERS)[: 1 if quick else None]]
    asked += [] if quick else [(Block(3, 0.02, 5, 8), "Levenberg-Marquardt", 0.01)]
    records = []
    for block, method, noise in asked:
        records.append(inverted(block, method, noise))
        print(line(records[-1]), file=sys.stderr, flush=True)
    return records


def chart(records: list[Record], png: str) -> None:
    """Error against forward solves."""
    plt, made, axes = figure(9, 4.2, 2, sharey=True)
    for axis, case in zip(axes, ("plane", "space"), strict=True):
        for r in (r for r in records if r["case"] == case):
            method, size = r["method"].removeprefix("ngbrain:"), str(r["unknowns"])
            filled = {"fillstyle": "full" if r["noise"] == 0.01 else "none"}
            axis.plot(r["forwards"], r["error"], "o", color=COLOURS[method], **filled)
            axis.annotate(
                size, (r["forwards"], r["error"]), (0, 6), textcoords="offset points", ha="center", fontsize=6.5
            )
        axis.set(
            title=f"{case}; hollow: 2 % noise; with unknowns",
            xlabel="CPU time in forward solves",
            xscale="log",
            xlim=(7, 1000),
            ylim=(0, 0.4),
        )
    for method, colour in COLOURS.items():
        axes[0].plot([], [], "o", color=colour, label=method)
    axes[0].legend(fontsize=8, frameon=False, loc="lower right")
    axes[0].set_ylabel("relative error of μ")
    made.savefig(png, dpi=150)
    plt.close(made)


def line(r: Record) -> str:
    """One record as text."""
    how = f"error {r['error']:.3f}, contrast {r['contrast']:.2f}, misfit {r['misfit_over_expected']:.2f} of expected"
    cost = f"{r['cpu_s']:.1f} s = {r['forwards']:.0f} forward solves, {r['rounds']} rounds"
    return f"{r['case']} {r['noise']:.0%} {r['method']:28} {how}; {cost}, converged {r['converged']}, {r['solves']}"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
