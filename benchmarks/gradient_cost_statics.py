"""What a gradient costs over the equilibrium that it is of, by order: a cube, one shear modulus for each tetrahedron.

A cube of 10 cm bonded to plates, K/μ = 9.7 (ν = .45): Neo-Hooke pressed by 15 % and sheared by 10 %; pressed by .1 %, linear
elastic but for J ("small strain"); and linear elastic, whose tangent is that of Newton's method. 8³ points measured. P1 has
24 576 tetrahedra, others as many displacements (14 739; P3 12 288) or more. `ratio` is the CPU time of the gradient over that of
the equilibrium from rest, each the least of several runs, one thread; `symbols_s`, spent once for all gradients, is beside it.
Two ways to solve for the adjoint: with what is left of Newton's method, its last factor (of the linear cube), or as
preconditioner of GMRES with the tangent assembled anew; or with a factor made for it. Peers, of the linear cube, ½ ∫ u·u or a sum
over nodes for the points: dolfinx by hand with the factor kept, dolfinx-adjoint's tape (`make bench-peers`), torch-fem and JAX-FEM
(`make bench-peers-gradient`).
`error`: the gradient along a random direction against a central difference.

    python benchmarks/gradient_cost_statics.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/gradient_cost_statics.py --chart FILE.png < records.json
"""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable, Iterator

import _peers
import ngsolve as ngs
import numpy as np
from _command import main
from _front import figure
from ngsolve.meshes import MakeStructured3DMesh

from ngbrain.forward import Displacements, LoadCase, Material, Problem, StaticLinearisation, StaticModel, sensitivity
from ngbrain.materials import LinearElastic, NeoHooke

Record = dict
SIDE, MU, BULK, STEP = 0.1, 1e3, 9.67e3, 1e-3
LARGE, SMALL = (0.1 * SIDE, 0, -0.15 * SIDE), (1e-4 * SIDE, 0, -1e-3 * SIDE)
LINEAR = "linear"
CASES = {
    "large strain": (lambda mu: Material(NeoHooke(mu), BULK), LARGE),
    "small strain": (lambda mu: Material(LinearElastic(mu), BULK), SMALL),
    LINEAR: (lambda mu: Material(LinearElastic(mu, BULK - 2 / 3 * mu), 0.0), SMALL),
}
FORMS = (("P1", 16), ("P2", 8), ("P3", 5), ("P4", 4), ("P2/P1", 8), ("P2", 12))
"""Form and cells along a side."""
OLD, NEW = "ngbrain:adjoint", "ngbrain:adjoint, new factor"
PEERS = {
    "dolfinx": ("dolfinx_gradient.py", ("dolfinx by hand", "dolfinx-adjoint")),
    "torchfem": ("torchfem_gradient.py", ("torch-fem",)),
    "jaxfem": ("jaxfem_gradient.py", ("JAX-FEM",)),
}
"""Environment → script and methods."""
COLOURS = {OLD: "#0072B2", NEW: "#56B4E9", "dolfinx by hand": "#009E73", "dolfinx-adjoint": "#D55E00"}
COLOURS |= {"torch-fem": "#CC79A7", "JAX-FEM": "#E69F00"}


def model(case: str, form: str, n: int) -> StaticModel:
    """Moduli that vary by a fifth."""
    mesh = MakeStructured3DMesh(hexes=False, nx=n, ny=n, nz=n, mapping=lambda x, y, z: (SIDE * x, SIDE * y, SIDE * z))
    mu = ngs.GridFunction(ngs.L2(mesh, order=0))
    mu.vec.FV().NumPy()[:] = MU * (1 + 0.2 * np.random.default_rng(0).random(mesh.ne))
    material, moved = CASES[case]
    body = Problem(mesh, {".*": material(mu)}, {"bottom": 0, "top": moved}, element=form)
    line = (np.arange(8) + 0.5) / 8 * SIDE
    points = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3)
    return StaticModel([LoadCase(body, [Displacements(points)])], {"mu": mu})


def least(run: Callable[[], object], times: int) -> tuple[float, object]:
    """CPU time (s) of the fastest of so many runs, and what the last one gave."""
    spent = []
    for _ in range(times):
        begun = time.process_time()
        found = run()
        spent.append(time.process_time() - begun)
    return min(spent), found


def off(of: StaticModel, theta: np.ndarray, wanted: np.ndarray, slope: np.ndarray) -> float:
    """Of the gradient of ½ |d - wanted|² from a central difference along a random direction."""
    direction = theta * np.random.default_rng(2).normal(size=of.size)
    up, down = (0.5 * np.sum((of.evaluate(theta + s * STEP * direction).data - wanted) ** 2) for s in (1, -1))
    return float(abs((up - down) / (2 * STEP) / (slope @ direction) - 1))


def measured(case: str, form: str, n: int, times: int) -> Iterator[Record]:
    """Both ways."""
    of = model(case, form, n)
    theta, each = of.theta, of.equilibria[0]

    def equilibrium() -> StaticLinearisation:
        of.forget()
        return of.evaluate(theta)

    forward, there = least(equilibrium, times)
    factors, wanted = each.work.factorisations // times, 1.1 * there.data
    symbols, _ = least(lambda: each.parameter_gradient, 1)
    few = sensitivity.tangent_inverse.FEW
    ways = {OLD: few} if case == LINEAR else {OLD: few, NEW: 0}
    for method, allowed in ways.items():
        sensitivity.tangent_inverse.FEW = allowed
        gradient, slope = least(
            lambda: StaticLinearisation(of, theta, there.states).gradient(there.data - wanted), times
        )
        sensitivity.tangent_inverse.FEW = few
        yield {
            "method": method,
            "case": case,
            "form": form,
            "order": each.body.element.order,
            "tetrahedra": each.body.mesh.ne,
            "ndof": each.body.fes.ndof,
            "forward_s": forward,
            "factorisations": factors,
            "cpu_s": gradient,
            "symbols_s": symbols,
            "ratio": gradient / forward,
            "error": off(of, theta, wanted, slope),
            "converged": True,
        }
        equilibrium()


def peers(name: str, form: str, n: int, times: int) -> list[Record]:
    """What a peer measures of the linear cube; where it does not, why."""
    script, methods = PEERS[name]
    if python := _peers.python_of(name):
        command = [python, str(_peers.HERE / "peers" / script), str(n), form[1], str(times)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        return json.loads(done.stdout.splitlines()[-1])
    known = {"case": LINEAR, "form": form, "order": int(form[1]), "tetrahedra": 6 * n**3, "ndof": None}
    nothing = dict.fromkeys(("forward_s", "cpu_s", "ratio", "error"))
    missing = {"converged": False, "reason": "not installed: make bench-peers bench-peers-gradient"}
    return [{"method": method, **known, **nothing, **missing} for method in methods]


def measure(quick: bool) -> list[Record]:
    """All forms and both cases."""
    records: list[Record] = []
    for case in CASES:
        for form, n in FORMS[: 4 if quick else None]:
            if case == LINEAR and "/" in form:
                continue  # pressures of ours are those of J
            n, times = (n // 2, 1) if quick else (n, 3)
            records += measured(case, form, n, times)
            if case == LINEAR:
                for name in PEERS:
                    records += peers(name, form, n, times)
    return records


def chart(records: list[Record], png: str) -> None:
    """Bars by form; none where a method has no number."""
    plt, made, axes = figure(11, 4, len(CASES))
    for axis, case in zip(axes, CASES, strict=True):
        mine = [r for r in records if r["case"] == case]
        sizes = {(r["form"], r["tetrahedra"]): r["ndof"] for r in mine if r["method"] == OLD}
        methods = [method for method in COLOURS if any(r["method"] == method and r["converged"] for r in mine)]
        for k, method in enumerate(methods):
            heights = {
                (r["form"], r["tetrahedra"]): r["ratio"] for r in mine if r["method"] == method and r["converged"]
            }
            places = [i + 0.84 / len(methods) * (k + 0.5) - 0.42 for i, key in enumerate(sizes) if key in heights]
            axis.bar(
                places,
                list(heights.values()),
                0.8 / len(methods),
                color=COLOURS[method],
                label=method.removeprefix("ngbrain:"),
            )
        axis.axhline(0.2, color="#333333", lw=0.8, ls="--")
        axis.set(
            title=case, xticks=range(len(sizes)), xticklabels=[f"{form}\n{ndof}" for (form, _), ndof in sizes.items()]
        )
        axis.set_ylim(0, 1.3 * max(r["ratio"] for r in mine if r["converged"]))
        axis.legend(fontsize=8, frameon=False, ncols=2)
    axes[0].set_ylabel("gradient over equilibrium, CPU time")
    made.savefig(png, dpi=150)
    plt.close(made)


def line(r: Record) -> str:
    """One record as text."""
    begun = f"{r['case']:13} {r['form']:6}{r['tetrahedra']:7} tets{r['ndof'] or 0:8} {r['method']:28} "
    if not r["converged"]:
        return begun + r["reason"]
    spent = f"equilibrium {r['forward_s']:.2f} s, gradient {r['cpu_s']:.3f} s, {r['ratio']:.3f} of it"
    return f"{begun}{spent}; off {r['error']:.1e}"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
