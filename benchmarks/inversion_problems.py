"""Three inverse problems end to end: the unloaded shape of a body under its weight, μ and α of an Ogden tissue, fibres.

Each from data of a finer mesh in elements of another order with 1 % noise (of the rms displacement, and of a force's size),
inverted in P2/P1 by Levenberg and Marquardt with an H1 regulariser.

unloaded shape   a bulged, skewed block of 10 cm hangs from its top (Neo-Hooke, plane strain, 2.4 cm down in the rms), of which
                 nodes are seen. Wanted are those of the block without weight; the search begins with a plain square. `error`
                 is the rms distance from them over the rms displacement. Beside it what is done instead: the seen shape for
                 the unloaded one, its computed displacement taken back from it, and 15 rounds of Sellier's
                 fixed point (2011, Journal of Fluids and Structures 27)
Ogden            cube between plates that do not slide, μ and α fields that vary by half across it in different directions; from
                 one small load, and from sets of large ones (pressed, pulled by a fifth, sheared by a quarter). `error_mu`,
                 `error_alpha` in L2, `error` their rms; `left_alpha` is the share of the variance assumed of α that data leave.
                 (In plane strain an incompressible Ogden law is even in α: its sign is seen in space only.)
fibres           a square with a field of fibre angles (30° to 80°) and k₁, Holzapfel-Gasser-Ogden, from one to three loads and
                 six starts each; `error` is the rms sine of the angle that they are off, `chosen` the start of the best fit

Each of them, from its richest loads, by three optimisers too, and with twice the noise: `sets` is the CPU time in all equilibria
from rest.

    python benchmarks/inversion_problems.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/inversion_problems.py --chart FILE.png < records.json
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import ngsolve as ngs
import numpy as np
from _command import main
from _front import figure
from _hanging import NOISE, SIDE, Hanging, meshed, rms
from _optimisers import COLOURS, OPTIMISERS

from ngbrain.adjoint import Reduced
from ngbrain.errors import ConvergenceError
from ngbrain.forward import Displacements, Force, LoadCase, Material, Problem, StaticModel
from ngbrain.inverse import (
    BoundedTransform,
    EvidenceWithModelError,
    LeastSquares,
    OptimisationResult,
    ParameterFields,
    Posterior,
    ScaledTransform,
    Unknown,
    ridge,
    smooth,
)
from ngbrain.materials import HolzapfelGasserOgden, Ogden

Record = dict
Array = np.ndarray
OURS = "ngbrain:Levenberg-Marquardt"
SEARCHES: dict[str, Callable[..., OptimisationResult]] = {
    f"ngbrain:{name}": search for name, search in OPTIMISERS.items()
}


def lattice(n: int, dim: int) -> Array:
    """Points (n^dim, dim) at which displacements are observed."""
    line = (np.arange(n) + 0.5) * SIDE / n
    return np.stack(np.meshgrid(*[line] * dim), axis=-1).reshape(-1, dim)


def off(found: ngs.CoefficientFunction, truth: ngs.CoefficientFunction, mesh: ngs.Mesh) -> float:
    """‖found - truth‖/‖truth‖ in L2."""
    wrong, whole = (ngs.Integrate(f * ngs.dx(bonus_intorder=6), mesh) for f in ((found - truth) ** 2, truth**2))
    return float(np.sqrt(wrong / whole))


def record(problem: str, method: str, found: OptimisationResult | None, model: StaticModel, begun: float) -> Record:
    """Entries common to all problems."""
    return {
        "problem": problem,
        "method": method,
        "order": 2,
        "ndof": model.equilibria[0].body.fes.ndof,
        "unknowns": len(found.x) if found else 0,
        "cpu_s": time.process_time() - begun,
        "converged": bool(found and found.converged),
        "misfit_over_expected": found.level.ratio if found else None,
        "rounds": len(found.history) if found else 0,
        "solves": asdict(model.solves),
    }


def resting(model: StaticModel) -> float:
    """CPU time (s) of all of a model's equilibria from rest."""
    model.forget()
    begun = time.process_time()
    model.evaluate(model.theta)
    return time.process_time() - begun


def shapes(cells: int, fine: int) -> list[Record]:
    """Records by all methods."""
    of, records = Hanging(cells, fine), []
    inner = of.model.model
    for method in ("seen shape", "displacement taken back", "fixed point", OURS):
        begun, found, settled = time.process_time(), None, True
        if method == OURS:
            shape, found = of.found()
        elif method == "fixed point":
            shape, change = of.fixed_point()
            settled = bool(change < of.sigma)
        else:
            shape = of.seen if method == "seen shape" else of.taken_back()
        made = record("unloaded shape", method, found, inner, begun)
        made["converged"] = found.converged if found else settled
        records.append(made | {"loads": "weight", "error": of.error(shape)})
    return records


# What tissue is made of, from several loads.


@dataclass(frozen=True)
class Loaded:
    """A block between plates: one body for each load, observed at points and by the force on its plate.

    dim     2 or 3
    loads   name → how the upper plate moves (m)
    points  along a side
    """

    dim: int
    loads: dict[str, tuple[float, ...]]
    points: int

    def model(self, mesh: ngs.Mesh, material: Material, names: Sequence[str], form: str, of: dict) -> StaticModel:
        """The model for some of the loads."""
        seen = [Displacements(lattice(self.points, self.dim)), Force("top")]
        bodies = [Problem(mesh, {".*": material}, {"bottom": 0, "top": self.loads[n]}, element=form) for n in names]
        return StaticModel([LoadCase(body, seen) for body in bodies], of, steps=2)

    def measured(
        self, mesh: ngs.Mesh, material: Material, seed: int = 0, noise: float = NOISE
    ) -> dict[str, LeastSquares]:
        """Load → its noisy data."""
        model = self.model(mesh, material, list(self.loads), "P3/P2", {"none": ngs.Parameter(0.0)})
        random, found = np.random.default_rng(seed), {}
        for name, (moved, force) in zip(self.loads, model.split(model.evaluate(model.theta).data), strict=True):
            sizes = rms(moved.reshape(-1, self.dim)), np.linalg.norm(force)
            sigma = noise * np.repeat(sizes, (len(moved), len(force)))
            data = np.concatenate([moved, force])
            found[name] = LeastSquares(data + sigma * random.normal(size=len(data)), sigma)
        return found


def together(misfits: Sequence[LeastSquares]) -> LeastSquares:
    """Joint data of several loads."""
    return LeastSquares(*(np.concatenate([getattr(m, what) for m in misfits]) for what in ("measured", "sigma")))


MU = 1e3 * (1 + 0.5 * ngs.sin(np.pi * ngs.x / SIDE))
ALPHA = -10 + 5 * ngs.cos(np.pi * ngs.y / SIDE)
LARGE = {"press": (0, 0, -0.02), "pull": (0, 0, 0.02), "shear": (0.025, 0, 0)}
CUBE = Loaded(3, {"small": (0, 0, -0.001)} | LARGE, 5)


def cube_data(fine: int, noise: float = NOISE) -> dict[str, LeastSquares]:
    """The data of all loads."""
    return CUBE.measured(meshed(fine, 3), Material(Ogden(MU, ALPHA), 2e4), noise=noise)


def ogden(
    data: dict[str, LeastSquares], names: Sequence[str], cells: int, rounds: int = 30, method: str = OURS
) -> Record:
    """μ and α from some of the loads."""
    mesh = meshed(cells, 3)
    space = ngs.H1(mesh, order=1)
    mu, alpha = ngs.GridFunction(space), ngs.GridFunction(space)
    mu.vec[:], alpha.vec[:] = 1500.0, -4.0
    of = {"mu": mu, "alpha": alpha}
    model = CUBE.model(mesh, Material(Ogden(mu, alpha), 2e4), names, "P2/P1", of)
    unit, begun = resting(model), time.process_time()
    fields = ParameterFields(
        model.theta, model.blocks, {"mu": Unknown(1500.0), "alpha": Unknown(-4.0, BoundedTransform(-30, -0.5))}
    )
    drawn = {name: smooth(space, fields.start[block]) for name, block in fields.blocks.items()}
    reduced = Reduced(model, together([data[n] for n in names]), fields, drawn, dict.fromkeys(of, 10.0))
    found = SEARCHES[method](reduced, fields.start, EvidenceWithModelError(), max_iterations=rounds)
    made = record("Ogden", method, found, model, begun)
    point = reduced.evaluate(found.x)
    posterior = Posterior(point)
    errors = {"error_mu": off(mu, MU, mesh), "error_alpha": off(alpha, ALPHA, mesh)}
    left = {f"left_{name}": value for name, value in posterior.remaining_variance.items()}
    influence = {f"influence_{name}": value for name, value in point.state.influence().items()}
    return (
        made
        | {"loads": "+".join(names), "unit_s": unit, "error": float(np.sqrt(np.mean(np.square(list(errors.values())))))}
        | (errors | left | influence)
    )


ANGLE, K1 = np.radians(55) + np.radians(25) * ngs.sin(np.pi * (ngs.x / SIDE - 0.5)), 2e3
SQUARE = Loaded(2, {"pull": (0, 0.02), "right": (0.025, 0), "left": (-0.025, 0)}, 8)


def fibred(angle: ngs.CoefficientFunction, k1: float | ngs.Parameter) -> Material:
    """Tissue with fibres in the plane."""
    return Material(HolzapfelGasserOgden(500.0, k1, 5.0, 0.0, ngs.CF((ngs.cos(angle), ngs.sin(angle), 0))), 2e4)


def square_data(fine: int, noise: float = NOISE) -> dict[str, LeastSquares]:
    """The data of all loads."""
    return SQUARE.measured(meshed(fine), fibred(ANGLE, K1), noise=noise)


def fibres(
    data: dict[str, LeastSquares],
    names: Sequence[str],
    cells: int,
    degrees: float,
    rounds: int = 25,
    method: str = OURS,
) -> Record:
    """Angles and k₁ from some of the loads, from uniform angles."""
    mesh = meshed(cells)
    angle, k1 = ngs.GridFunction(ngs.H1(mesh, order=1)), ngs.Parameter(K1 / 2)
    angle.vec[:] = np.radians(degrees)
    model = SQUARE.model(mesh, fibred(angle, k1), names, "P2/P1", {"angle": angle, "k1": k1})
    unit, begun, found = resting(model), time.process_time(), None
    fields = ParameterFields(
        model.theta, model.blocks, {"angle": Unknown(np.radians(degrees), ScaledTransform()), "k1": Unknown(K1 / 2)}
    )
    drawn = {"angle": smooth(angle.space, np.radians(degrees)), "k1": ridge(fields.start[fields.blocks["k1"]])}
    reduced = Reduced(model, together([data[n] for n in names]), fields, drawn, {"angle": 10.0, "k1": 0.01})
    try:
        found = SEARCHES[method](reduced, fields.start, EvidenceWithModelError(), max_iterations=rounds)
    except ConvergenceError:
        pass  # it stays where it started
    model.set_parameters(fields.theta(fields.start if found is None else found.x))
    turned = ngs.Integrate(ngs.sin(angle - ANGLE) ** 2 * ngs.dx(bonus_intorder=6), mesh)
    return record("fibres", method, found, model, begun) | {
        "loads": "+".join(names),
        "unit_s": unit,
        "start_degrees": degrees,
        "error": float(np.sqrt(turned)) / SIDE,
        "error_k1": abs(k1.Get() / K1 - 1),
    }


def searched(quick: bool) -> list[Record]:
    """Each problem by all optimisers, and by the first with twice the noise; times in sets of equilibria from rest."""
    records = []
    for noise, methods in ((NOISE, list(SEARCHES)[: 1 if quick else None]), (2 * NOISE, [OURS])):
        of = Hanging(6, 16, noise=noise)
        cube, square = cube_data(3 if quick else 5, noise), square_data(10 if quick else 16, noise)
        for method in methods:
            unit, begun = resting(of.model.model), time.process_time()
            shape, found = of.found(SEARCHES[method])
            made = record("unloaded shape", method, found, of.model.model, begun)
            records += [
                made | {"loads": "weight", "error": of.error(shape), "unit_s": unit},
                ogden(cube, list(LARGE), 2 if quick else 3, method=method),
                fibres(square, list(SQUARE.loads), 6, 60, method=method),
            ]
            for made in records[-3:]:
                made |= {"noise": noise, "sets": made["cpu_s"] / made["unit_s"], "case": "search"}
                print(line(made), file=sys.stderr, flush=True)
    return records


def chosen(records: list[Record]) -> list[Record]:
    """Index of the best fit of several initial guesses."""
    best = min(records, key=lambda r: np.inf if r["misfit_over_expected"] is None else r["misfit_over_expected"])
    return [r | {"chosen": r is best} for r in records]


def measure(quick: bool) -> list[Record]:
    """All records."""
    records: list[Record] = []

    def told(made: list[Record]) -> None:
        records.extend(made)
        print(*map(line, made), sep="\n", file=sys.stderr, flush=True)

    for cells, fine in ((6, 16),) if quick else ((6, 16), (10, 28)):
        told(shapes(cells, fine))
    sets = (
        [("small",), tuple(LARGE)]
        if quick
        else [("small",), ("press",), ("press", "pull"), ("press", "shear"), tuple(LARGE)]
    )
    cube = cube_data(3 if quick else 5)
    for names in sets:
        told([ogden(cube, names, 2 if quick else 3)])
    square = square_data(10 if quick else 16)
    loads = list(SQUARE.loads)
    for number in (2,) if quick else (1, 2, 3):
        starts = (60, 150) if quick else range(0, 180, 30)
        told(chosen([fibres(square, loads[:number], 6, start) for start in starts]))
    return records + searched(quick)


def chart(records: list[Record], png: str) -> None:
    """Errors, a panel for each problem."""
    plt, made, (shape, tissue, fibre, search) = figure(17, 4.2, 4)
    compared = [r for r in records if r.get("case") == "search"]
    records = [r for r in records if r.get("case") != "search"]
    colours, names = list(COLOURS.values()), list(dict.fromkeys(r["problem"] for r in compared))
    for r in compared:
        k, doubled = list(SEARCHES).index(r["method"]), r["noise"] > NOISE
        where = names.index(r["problem"]) + 0.15 * (len(SEARCHES) if doubled else k) - 0.37
        method = r["method"].removeprefix("ngbrain:") + (f", {r['noise']:.0%} noise" if doubled else "")
        label = method if r["problem"] == names[0] else None
        search.bar(where, r["sets"], 0.14, edgecolor=colours[k], color="none" if doubled else colours[k], label=label)
        search.text(where, r["sets"] + 4, f"{r['error']:.1%}", ha="center", fontsize=5.5, rotation=90)
    search.set_xticks(range(len(names)), names)
    search.set(title="optimisers, with errors", ylabel="CPU time in sets of equilibria")
    search.set_ylim(top=1.6 * max(r["sets"] for r in compared))
    search.legend(frameon=False, fontsize=7, loc="upper left", ncols=2)
    rows = [r for r in records if r["problem"] == "unloaded shape"]
    rows = [r for r in rows if r["ndof"] == rows[-1]["ndof"]]
    shape.barh([r["method"].removeprefix("ngbrain:") for r in rows], [r["error"] for r in rows], color="#0072B2")
    for r in rows:
        shape.annotate(
            f" {r['error']:.1%}", (r["error"], r["method"].removeprefix("ngbrain:")), va="center", fontsize=8
        )
    shape.set(title="shape without weight", xlabel="rms distance / rms displacement")
    shape.margins(x=0.25)
    rows = [r for r in records if r["problem"] == "Ogden"]
    for shift, name, colour in ((-0.2, "mu", "#0072B2"), (0.2, "alpha", "#D55E00")):
        tissue.bar(np.arange(len(rows)) + shift, [r[f"error_{name}"] for r in rows], 0.38, color=colour, label=name)
    tissue.set_xticks(range(len(rows)), [r["loads"].replace("+", "\n") for r in rows], fontsize=7)
    tissue.set(title="Ogden: two fields", ylabel="relative error")
    tissue.legend(frameon=False, fontsize=8)
    rows = [r for r in records if r["problem"] == "fibres"]
    for loads, colour in zip(dict.fromkeys(r["loads"] for r in rows), ("#009E73", "#0072B2", "#D55E00"), strict=False):
        mine = [r for r in rows if r["loads"] == loads]
        fibre.plot([r["start_degrees"] for r in mine], [r["error"] for r in mine], "o-", color=colour, label=loads)
        fibre.plot(
            *zip(*[(r["start_degrees"], r["error"]) for r in mine if r["chosen"]], strict=True),
            "*",
            color=colour,
            ms=16,
        )
    fibre.set(title="fibre angles; star: the best fit", xlabel="start (°)", ylabel="rms sine of the angle off")
    fibre.set(yscale="log", xticks=range(0, 180, 30))
    fibre.legend(frameon=False, fontsize=8)
    made.savefig(png, dpi=150)
    plt.close(made)


def line(r: Record) -> str:
    """One record as text."""
    errors = ", ".join(f"{key} {value:.3f}" for key, value in r.items() if key.startswith(("error", "left", "infl")))
    start = f" from {r['start_degrees']}°{'*' if r['chosen'] else ''}" if "chosen" in r else ""
    fit = "" if r["misfit_over_expected"] is None else f", misfit {r['misfit_over_expected']:.2f} of expected"
    how = f"{r['rounds']} rounds, {r['cpu_s']:.1f} s, converged {r['converged']}"
    sets = f" ({r['sets']:.0f} sets of equilibria), noise {r['noise']:.0%}" if "sets" in r else ""
    return f"{r['problem']:15} {r['method']:28} {r['loads']}{start}, {r['ndof']}: {errors}{fit}; {how}{sets}"


if __name__ == "__main__":
    main(__doc__ or "", measure, chart, line)
