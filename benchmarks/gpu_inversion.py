"""A whole Levenberg-Marquardt inversion of waves, factorised and solved on the processor or a GPU, and where its time goes.

Two problems, boundaries held at what was measured there, fields of half the elements' order, weights as given: CV-G, a published
square of 12 cm (51 points across, 1 % noise) in elements of order 4, and a block of 6 cm with a ball of 15 mm, twice as stiff, in
hexahedra of order 2, at two sizes (one load at 50 Hz, simulated with third order on tetrahedra, 2 % noise). `phases` are seconds:
assembly (matrices, ∂A/∂θ u, slopes), factor, solves (with copies to a GPU and back) and the rest; CPU time of one thread for
cpu, time on the clock for the others, as the processor waits there. `error` is of the complex modulus, rms relative to the truth;
`apart` how far the fields found on a GPU are from those of the processor. A device that is not there is not measured, and says so.

    python benchmarks/gpu_inversion.py [--quick] [--json]      last line of --json: a list of records
    python benchmarks/gpu_inversion.py --chart FILE.png < records.json
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from unittest.mock import patch

import numpy as np
from _ball_waves import BallInBlock
from _command import main
from _front import PHASES, figure

from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import InputError, MissingExtra
from ngbrain.forward.harmonic import Harmonic
from ngbrain.forward.sensitivity import BOUNDARY, Linearised
from ngbrain.forward.slopes import Slope
from ngbrain.inverse.discretise import Discretisation
from ngbrain.inverse.experiment import Experiment
from ngbrain.inverse.levenberg_marquardt import levenberg_marquardt
from ngbrain.inverse.misfit import LeastSquares
from ngbrain.inverse.parameters import Fields
from ngbrain.inverse.phantoms import SIDE, Phantom
from ngbrain.inverse.quality import noise_of
from ngbrain.inverse.regularise import smooth
from ngbrain.inverse.weights import Given
from ngbrain.io.waves import WaveData
from ngbrain.mesh.grid import rectangles
from ngbrain.solvers.device import DEVICES, Device, Factor

Array = np.ndarray
Record = dict
BLOCK = BallInBlock(0.06, (0.032, 0.028, 0.030), 7.5e-3, (2400 + 1000j, 4800 + 2000j), 50.0, 0.011)
PLANE, SPACE = "CV-G, order 4", "block, order 2"
ORDERS = {PLANE: 4, SPACE: 2}
SIZES = ((PLANE, 12), (SPACE, 10), (SPACE, 15))
"""Elements along a side."""
QUICK = ((PLANE, 6), (SPACE, 4))
WEIGHTS = {PLANE: 1e3, SPACE: 1e5}
SHADES = {
    "assembly": PHASES["assemble"],
    "factor": PHASES["factor"],
    "solves": PHASES["solve"],
    "rest": PHASES["other"],
}


class Clock:
    """Seconds by phase, of one that is not inside another."""

    def __init__(self, device: Device) -> None:
        self.now = time.process_time if device.name == "cpu" else time.perf_counter
        self.seconds: dict[str, float] = defaultdict(float)

    @contextmanager
    def __call__(self, phase: str) -> Iterator[None]:
        """Count what is done inside."""
        begun = self.now()
        yield
        self.seconds[phase] += self.now() - begun

    def counting(self, phase: str, call: Callable) -> Callable:
        """The same function, counted."""

        def counted(*arguments: object) -> object:
            with self(phase):
                return call(*arguments)

        return counted


@dataclass
class Timed:
    """A factor whose solves are counted."""

    factor: Factor
    clock: Clock

    def solve(self, b: Array) -> Array:
        """A⁻¹b."""
        with self.clock("solves"):
            return self.factor.solve(b)


def timed(device: Device, clock: Clock) -> Device:
    """The same device, its factors and solves counted."""
    make = clock.counting("factor", device.make)
    return replace(device, make=lambda matrix, free: Timed(make(matrix, free), clock))


@contextmanager
def assembly(clock: Clock) -> Iterator[None]:
    """Count what is assembled inside."""
    with ExitStack() as stack:
        for owner, name in ((Harmonic, "factorised"), (Linearised, "_sensitivity"), (Slope, "__call__")):
            stack.enter_context(patch.object(owner, name, clock.counting("assembly", getattr(owner, name))))
        yield


def waves(case: str, quick: bool) -> WaveData:
    """As they are measured."""
    if case == PLANE:
        return Phantom.named("CV-G", 25 if quick else 51).measured(0.01).data()
    data = BLOCK.waves(*((2, 5e-3) if quick else (3, 2.5e-3)), 0.02)
    return replace(data, displacement=data.displacement[:1], frequency=data.frequency[:1])


def problem(case: str, data: WaveData, n: int, device: Device) -> tuple[Experiment, Reduced]:
    """In n elements along a side."""
    line = np.linspace(0, SIDE, n + 1)
    every = np.ones(len(data.points), bool)
    plane = case == PLANE
    elements = (
        Discretisation(rectangles(line, line), "P4", 2, None, every) if plane else BLOCK.hexahedra(2, n, len(every))
    )
    experiment = Experiment(data, elements, device=device)
    assert data.noise is not None
    sigma = noise_of(data, data.noise)
    whole = experiment.unknowns(sigma)
    moduli = {name: unknown for name, unknown in whole.unknowns.items() if name != BOUNDARY}
    fields = Fields(whole.theta(whole.start), experiment.model.blocks, moduli)
    regularisers = {name: smooth(experiment.space, fields.start[fields.blocks[name]]) for name in moduli}
    weights = dict.fromkeys(moduli, WEIGHTS[case])
    return experiment, Reduced(
        experiment.model, LeastSquares(experiment.measured, sigma), fields, regularisers, weights
    )


def absent(case: str, n: int, name: str, why: str) -> Record:
    """Of what is not measured."""
    about = {"method": f"ngbrain:lm:{name}", "case": case, "n": n, "order": ORDERS[case], "ndof": None}
    about |= {"error": None, "phases": None, "cpu_s": None}
    return about | {"converged": False, "reason": f"not measured: {why}"}


def measured(case: str, n: int, quick: bool = False) -> Iterator[Record]:
    """A record for each device."""
    data, found = waves(case, quick), dict[str, Array]()
    for name in DEVICES:
        about = absent(case, n, name, "")
        try:
            device = Device.named(name)
        except (InputError, MissingExtra) as missing:
            yield absent(case, n, name, str(missing))
            continue
        clock = Clock(device)
        experiment, reduced = problem(case, data, n, timed(device, clock))
        clock.seconds.clear()
        begun, cpu = clock.now(), time.process_time()
        with assembly(clock):
            end = levenberg_marquardt(reduced, reduced.unknowns.start, Given(), dense=0)
        seconds, cpu_s, spent = clock.now() - begun, time.process_time() - cpu, dict(clock.seconds)
        maps = experiment.maps(reduced.unknowns, end.x)
        modulus, truth = maps["storage"] + 1j * maps["loss"], data.truth["shear"]
        found[name] = end.x
        apart = float(np.linalg.norm(end.x - found["cpu"]) / np.linalg.norm(found["cpu"]))
        yield about | {
            "ndof": experiment.body.fes.ndof,
            "n_parameters": len(end.x),
            "error": float(np.linalg.norm(modulus - truth) / np.linalg.norm(truth)),
            "apart": apart if name != "cpu" else None,
            "misfit": end.level.ratio,
            "rounds": len(end.history),
            "factorisations": experiment.model.solves.factorisations,
            "solves": experiment.model.solves.back_substitutions,
            "seconds": seconds,
            "cpu_s": cpu_s,
            "phases": spent | {"rest": seconds - sum(spent.values())},
            "converged": end.converged,
            "reason": "" if end.converged else "it had not settled when its rounds were over",
        }


def measure(quick: bool) -> list[Record]:
    """All problems, or small ones."""
    return [record for case, n in (QUICK if quick else SIZES) for record in measured(case, n, quick)]


def chart(records: list[Record], png: str) -> None:
    """A bar for each inversion, by phase, as long as it takes beside the processor's."""
    plt, made, axes = figure(9, 1.4 + 0.45 * len(records))
    done = {(r["method"], r["case"], r["n"]): r["seconds"] for r in records if r["phases"]}
    for k, r in enumerate(records):
        left, text = 0.0, "not measured"
        if r["phases"]:
            unit = done.get(("ngbrain:lm:cpu", r["case"], r["n"]), r["seconds"])
            for phase, colour in SHADES.items():
                axes.barh(k, r["phases"][phase] / unit, 0.7, left, color=colour)
                left += r["phases"][phase] / unit
            text = f"{r['seconds']:.3g} s" + (f", {r['reason']}" if r["reason"] else "")
        axes.text(left + 0.01, k, text, va="center", fontsize=8)
    for phase, colour in SHADES.items():
        axes.barh(0, 0, color=colour, label=phase)
    size = {(r["case"], r["n"]): f", {r['ndof']} unknowns" for r in records if r["ndof"]}
    names = [
        f"{r['case']}, {r['n']} across{size.get((r['case'], r['n']), '')}: {r['method'].rpartition(':')[2]}"
        for r in records
    ]
    axes.set(yticks=range(len(records)), yticklabels=names, ylim=(len(records) - 0.5, -0.5))
    axes.set(xlim=(0, 1.4), xlabel="time over the processor's")
    axes.grid(axis="x", alpha=0.25)
    axes.legend(fontsize=8, frameon=False, loc="lower right")
    made.suptitle("A whole Levenberg-Marquardt inversion of waves, by phase", fontsize=10)
    made.savefig(png, dpi=150)
    plt.close(made)


def line(r: Record) -> str:
    """One record in words."""
    head = f"{r['method']:16} {r['case']} {r['n']:3}"
    if not r["phases"]:
        return f"{head}: {r['reason']}"
    phases = ", ".join(f"{phase} {seconds:.2f}" for phase, seconds in r["phases"].items())
    done = f"{r['rounds']} rounds, {r['factorisations']} factors, {r['solves']} solves, misfit {r['misfit']:.2f}"
    apart = "" if r["apart"] is None else f", {r['apart']:.1e} from the processor's"
    return f"{head} {r['ndof']:6} unknowns: {r['seconds']:.1f} s ({phases}); {done}; off {r['error']:.3f}{apart} {r['reason']}"


if __name__ == "__main__":
    main(__doc__, measure, chart, line)
