"""A whole Levenberg–Marquardt inversion of waves, factorised and solved on the processor or a GPU, and where its time goes.

Two problems, boundaries held at what was measured there, fields of half the elements' order, weights as given: CV-G, a published
square of 12 cm (51 points across, 1 % noise) in elements of order 4, and a block of 6 cm with a ball of 15 mm, twice as stiff, in
hexahedra of order 2 (one load at 50 Hz, simulated with third order on tetrahedra, points
5 mm apart, 2 % noise). `phases` are seconds: assembly
(matrices, ∂A/∂θ u, slopes), factor, solves (with copies to a GPU and back) and the rest; CPU time of one thread for the
processor, wall time for the others, as the processor waits there. `error` is of the complex modulus, rms relative to the truth;
`difference` how far the fields found on a GPU are from those of the processor.
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

from ngbrain.adjoint import Reduced
from ngbrain.forward import HarmonicProblem, WaveLinearisation, sensitivity
from ngbrain.inverse import (
    Discretisation,
    ElastographyProblem,
    FixedWeights,
    LeastSquares,
    ParameterFields,
    Phantom,
    levenberg_marquardt,
    noise_deviation,
    phantoms,
    smooth,
)
from ngbrain.io import WaveData
from ngbrain.mesh import rectangles
from ngbrain.solvers import Device, Factor

Array = np.ndarray
Record = dict
BLOCK = BallInBlock(0.06, (0.032, 0.028, 0.030), 7.5e-3, (2400 + 1000j, 4800 + 2000j), 50.0, 0.011)
PLANE, SPACE = "CV-G, order 4", "block, order 2"
ORDERS = {PLANE: 4, SPACE: 2}
QUICK = ((PLANE, 6), (SPACE, 4))
"""Elements along a side of the small forms."""
WEIGHTS = {PLANE: 1e3, SPACE: 1e5}
MATNLI_S = 68 * 4.2
"""CPU seconds of MatNLI in GNU Octave on CV-G with 1 % noise, to its least error in G′ (2.7 %): evaluations times their time."""


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
        for owner, name in (
            (HarmonicProblem, "factorise"),
            (WaveLinearisation, "_sensitivity"),
            (sensitivity.harmonic.field_gradients.FieldGradient, "__call__"),
        ):
            stack.enter_context(patch.object(owner, name, clock.counting("assembly", getattr(owner, name))))
        yield


def waves(case: str, quick: bool) -> WaveData:
    """As they are measured."""
    if case == PLANE:
        return Phantom.from_name("CV-G", 25 if quick else 51).simulate_measurements(0.01).data()
    data = BLOCK.waves(*((2, 5e-3) if quick else (3, 5e-3)), 0.02)
    return replace(data, displacement=data.displacement[:1], frequency=data.frequency[:1])


def problem(case: str, data: WaveData, n: int, device: Device) -> tuple[ElastographyProblem, Reduced]:
    """In n elements along a side."""
    line = np.linspace(0, phantoms.benchmark.SIDE, n + 1)
    every = np.ones(len(data.points), bool)
    plane = case == PLANE
    elements = (
        Discretisation(rectangles(line, line), "P4", 2, None, every) if plane else BLOCK.hexahedra(2, n, len(every))
    )
    experiment = ElastographyProblem(data, elements, device=device)
    assert data.noise is not None
    sigma = noise_deviation(data, data.noise)
    whole = experiment.unknowns(sigma)
    moduli = {
        name: unknown for name, unknown in whole.unknowns.items() if name != sensitivity.harmonic.wave_model.BOUNDARY
    }
    fields = ParameterFields(whole.theta(whole.start), experiment.model.blocks, moduli)
    regularisers = {name: smooth(experiment.space, fields.start[fields.blocks[name]]) for name in moduli}
    weights = dict.fromkeys(moduli, WEIGHTS[case])
    return experiment, Reduced(
        experiment.model, LeastSquares(experiment.measured, sigma), fields, regularisers, weights
    )


def inversions(case: str, n: int) -> tuple[Record, dict[str, Callable[[], Record]]]:
    """What the records of a problem share, and an inversion for each device; `quick` sizes are those of `QUICK`."""
    quick = (case, n) in QUICK
    data, found = waves(case, quick), dict[str, Array]()

    def invert(name: str) -> Record:
        if name == "cuda":
            from _gpu_cells import need_cudss

            need_cudss()
        device = Device.from_name(name)
        clock = Clock(device)
        experiment, reduced = problem(case, data, n, timed(device, clock))
        clock.seconds.clear()
        begun = clock.now()
        with assembly(clock):
            end = levenberg_marquardt(reduced, reduced.unknowns.start, FixedWeights(), max_dense=0)
        seconds, spent = clock.now() - begun, dict(clock.seconds)
        maps = experiment.maps(reduced.unknowns, end.x)
        modulus, truth = maps["storage"] + 1j * maps["loss"], data.truth["shear"]
        found[name] = end.x
        processor = found.get("cpu")
        return {
            "ndof": experiment.body.fes.ndof,
            "n_parameters": len(end.x),
            "error": float(np.linalg.norm(modulus - truth) / np.linalg.norm(truth)),
            "error_allowed": 1.0,
            "difference": None
            if processor is None
            else float(np.linalg.norm(end.x - processor) / np.linalg.norm(processor)),
            "misfit": end.level.ratio,
            "rounds": len(end.history),
            "factorisations": experiment.model.solves.factorisations,
            "solves": experiment.model.solves.back_substitutions,
            "solve_s": seconds,
            "phases": spent | {"rest": seconds - sum(spent.values())},
            "over_matnli": seconds / MATNLI_S if (case, n) == (PLANE, 12) else None,
            "converged": end.converged,
            "reason": "" if end.converged else "it had not settled when its rounds were over",
        }

    names = {"processor": "cpu", "cudss, device": "cuda", "cholesky, device": "ngsolve"}
    return {"order": ORDERS[case], "ndof": None}, {
        name: lambda device=device: invert(device) for name, device in names.items()
    }
