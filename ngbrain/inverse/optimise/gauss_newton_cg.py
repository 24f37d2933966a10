"""Gauss-Newton inversion of problems in space: every step by preconditioned conjugate gradients, with a checkpoint.

The factor of the waves is made once for each point that is tried and serves its forward solves, its gradient and all the
products of its step. Weights settle as in `gauss_newton`; what the data determine is estimated by one more solve a step.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.adjoint.reduced import Point, Reduced
from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.sensitivity.harmonic.wave_model import WaveLinearisation
from ngbrain.inverse.optimise.fingerprint import differing_parts, problem_fingerprint
from ngbrain.inverse.optimise.gauss_newton import ROUNDS, GaussNewton, WaveInversionResult
from ngbrain.inverse.optimise.normal_equations import FORCING, MOST, NormalEquations
from ngbrain.inverse.optimise.preconditioners import BoundaryExtensionPreconditioner
from ngbrain.inverse.optimise.regularisation_weight import Evidence, MisfitLevel, WeightPolicy
from ngbrain.inverse.optimise.result import Iteration, OptimisationResult
from ngbrain.reading import read_npz
from ngbrain.result import Status
from ngbrain.solvers.quasi_newton_preconditioner import QuasiNewtonPreconditioner

Array = np.ndarray
STILL, ALIKE = 5e-3, 1.5
"""Change of the misfit, and of any weight (factor), at which iterations end."""
SLOW, FALL = 2.0, 10.0
"""Of `approach`: by how much a step is to lower the misfit for another one to follow; factor of the weights."""


NOWHERE = np.empty((0, 0), complex)
"""Waves of a checkpoint that needs none."""


class GaussNewtonCG(GaussNewton):
    """Steps of `reduced` whose model is a `WaveModel` in space (or in the plane).

    policy      what changes the weights, see `weights`
    forcing, most  where conjugate gradients stop: residual as a part of its start, iterations
    checkpoint  .npz that is written after each iteration, or None
    tell, seed  as for `GaussNewton`

    Held displacements are unknown too where `reduced.unknowns` has the block "boundary".
    Sources: Eisenstat and Walker 1996, 10.1137/0917003 (forcing); Petra et al. 2014, 10.1137/130934805 (products).
    """

    def __init__(
        self,
        reduced: Reduced,
        policy: WeightPolicy | None = None,
        *,
        forcing: float = FORCING,
        max_cg_iterations: int = MOST,
        checkpoint: str | os.PathLike[str] | None = None,
        callback: Callable[[Iteration], None] = lambda _: None,
        seed: int = 0,
    ) -> None:
        super().__init__(reduced, policy or Evidence(), callback, seed)
        self.forcing, self.max_cg_iterations, self.callback = forcing, max_cg_iterations, callback
        self.checkpoint = None if checkpoint is None else Path(checkpoint)
        self.directions, self.extensions = QuasiNewtonPreconditioner(), BoundaryExtensionPreconditioner()
        self.iterations: list[int] = []
        """Of conjugate gradients, for each solve: steps and probes in turn."""
        self.approach_result: OptimisationResult | None = None
        """Where `approach` ended, if there was one; its misfit is expected to be the number of data."""

    @property
    def has_checkpoint(self) -> bool:
        """Whether there is a checkpoint to go on from."""
        return self.checkpoint is not None and self.checkpoint.exists()

    def resume(self, max_iterations: int = 4 * ROUNDS) -> WaveInversionResult:
        """`descend` from the checkpoint, as if it had never stopped; its rounds count those done before.

        An inversion that had settled is not begun again: what it found comes back, for one forward solve.
        Raises `InputError` where there is no checkpoint, one of another problem (it says what differs, see `identity`), or one of
        a way that had not come to its end: `from_measured` goes on from that.
        """
        x, waves, notes = self._saved()
        if len(waves):
            raise InputError("checkpoint", f"{self.checkpoint}, on the way from measured waves", "one of a descent")
        history = _history(notes["history"])
        self._ledger.begun -= history[-1].cpu_s
        return self._down(self.reduced.evaluate(x), max_iterations - len(history), history, notes["settled"])

    def from_measured_waves(self, x: Array, waves: Array, approach: int, max_iterations: int) -> WaveInversionResult:
        """`approach` in so many rounds at most, then `descend`; from the checkpoint, if there is one, on either way.

        On the way, preconditioners are made anew: what follows is as good, but not the same to the last bit.
        """
        done, own = list[Iteration](), np.inf
        if self.has_checkpoint:
            saved, on_the_way, notes = self._saved()
            if not len(on_the_way):
                return self.resume(max_iterations)
            x, waves, done, own = saved, on_the_way, _history(notes["done"]), notes["own"]
        return self._down(self.approach(x, waves, approach, done, own), max_iterations, [])

    def _step(self, x: Array, state: WaveLinearisation, balance: Array | None) -> tuple[NormalEquations, Array, Array]:
        point = Point(self.reduced, x, state)
        normal = NormalEquations(
            point, self.iterations, self.forcing, self.max_cg_iterations, self.directions, self.extensions
        )
        return normal, normal.solve(-normal.gradient()), np.zeros_like(state.waves)

    def _moved(self, x: Array, dx: Array, waves: Array) -> tuple[Array, Array]:
        return x + dx, waves

    def approach(
        self, x: Array, waves: Array, max_iterations: int, done: Sequence[Iteration] = (), before: float = np.inf
    ) -> Point:
        """Where `descend` finds its way, from waves (loads, ndof) near the data that need not fit the fields.

        Steps of `from_waves`, each but the first with weights lower by `FALL`, for so many rounds or until the misfit of the
        fields' own waves hardly falls (`SLOW`). Of the rounds some may be `done`, the last from the misfit `before`.
        """
        begun, history, point = time.process_time(), list(done), None
        for number in range(len(history), max_iterations):
            state = self.model.linearise(self.unknowns.theta(x), waves)
            balance = [self.model.body.pushed(k) - state.factors.apply(k, u) for k, u in enumerate(waves)]
            moved = np.array([state.factors.solve(k, b) for k, b in enumerate(balance)])
            own = WaveLinearisation(self.model, state.factors, waves + moved)  # of waves that fit the fields
            misfit = self.misfit.value(own.data)
            if misfit > before / SLOW:
                point = Point(self.reduced, x, own)
                break
            before, state.data = misfit, own.data
            for name in self.reduced.weights if number else ():
                self.reduced.weights[name] /= FALL
            normal, dx, _ = self._step(x, state, None)
            moved += state.state_derivative(normal.point.jacobian @ dx)
            step = self._bounded(dx)
            x, waves = x + step * dx, waves + step * moved
            change = float(np.sqrt(np.mean((step * dx[: self._width]) ** 2)))
            cpu_s, weights = time.process_time() - begun, dict(self.reduced.weights)
            squares = self.misfit.weighted_squares(own.data)
            history.append(Iteration("waves", squares, self.misfit.count, weights, change, step, cpu_s))
            self.callback(history[-1])
            self._save(x, {"done": [asdict(entry) for entry in history], "own": misfit}, waves)
        point = point or self.reduced.evaluate(x)
        level, weights = (
            MisfitLevel(self.misfit.weighted_squares(point.state.data), self.misfit.count),
            dict(self.reduced.weights),
        )
        self.approach_result = OptimisationResult(
            point.x, point.value, level, weights, self.misfit.count, history=history
        )
        return point

    def _still(self, history: list[Iteration]) -> bool:
        # Traces are estimates, so what the data hardly determine never quite settles.
        if len(history) < 2:
            return False
        before, now = history[-2:]
        turned = max(abs(float(np.log(now.weights[name] / before.weights[name]))) for name in now.weights)
        return bool(now.step == 1 and abs(now.misfit / before.misfit - 1) < STILL and turned < np.log(ALIKE))

    @cached_property
    def _problem(self) -> dict[str, str]:
        return problem_fingerprint(self.reduced)

    def _keep(self, x: Array, history: list[Iteration], settled: bool) -> None:
        self._save(x, {"settled": settled, "history": [asdict(entry) for entry in history]})

    def _save(self, x: Array, more: dict[str, object], waves: Array = NOWHERE) -> None:
        if self.checkpoint is None:
            return
        notes = {"problem": self._problem, "weights": self.reduced.weights, **more}
        begun = NOWHERE.real
        if self.approach_result:
            begun, notes["arrived"] = self.approach_result.x, asdict(self.approach_result) | {"x": None}
        arrays = {"x": x, "waves": waves, "begun": begun, "directions": self.directions.arrays}

        def write(part: Path) -> None:
            with part.open("wb") as file:  # of any suffix
                np.savez(file, notes=json.dumps(notes), **arrays)  # type: ignore[arg-type]

        atomic_write(self.checkpoint, write)

    def _saved(self) -> tuple[Array, Array, dict[str, Any]]:
        """x, waves (none in a descent) and notes of the checkpoint, whose weights and directions are taken on."""
        wanted = "a file that an inversion has written"
        if self.checkpoint is None or not self.has_checkpoint:
            raise InputError("checkpoint", str(self.checkpoint), wanted)
        try:
            saved = read_npz(self.checkpoint, "checkpoint")
            x, waves, begun, directions = (saved[name] for name in ("x", "waves", "begun", "directions"))
            notes = json.loads(str(saved["notes"]))
            told = notes.get("problem")
        except (KeyError, ValueError, AttributeError) as error:
            raise InputError("checkpoint", f"{self.checkpoint}, which is none", wanted) from error
        if others := differing_parts(told, self._problem):
            found = f"{self.checkpoint}, of another problem: other {', '.join(others)}"
            raise InputError("checkpoint", found, "one of the same problem, or no file there")
        self.reduced.weights, self.directions.arrays = notes["weights"], directions
        if arrived := notes.get("arrived"):
            more = {"x": begun, "level": MisfitLevel(**arrived["level"]), "history": _history(arrived["history"])}
            more["status"] = Status(arrived["status"])
            self.approach_result = OptimisationResult(**(arrived | more))
        return x, waves, notes


def _history(entries: Sequence[dict[str, Any]]) -> list[Iteration]:
    return [Iteration(**entry) for entry in entries]


@dataclass(frozen=True)
class SolverCost:
    """What an inversion is expected to take.

    unknowns     complex, of one wave
    memory_gib   of the factor
    factor_s, solve_s   CPU time of a factorisation and of a back-substitution
    """

    unknowns: int
    memory_gib: float
    factor_s: float
    solve_s: float

    def step_s(self, loads: int, iterations: int) -> float:
        """CPU time of a step with so many iterations of conjugate gradients: two solves for each load and iteration."""
        return self.factor_s + 2 * loads * (iterations + 1) * self.solve_s


def estimate_solver_cost(body: HarmonicProblem) -> SolverCost:
    """Cost of a body's factor, extrapolated from heads meshed with P2; right within a factor of two or three.

    Measured on one core: 20 million entries, 4.7 s and .13 s with 45 000 unknowns, 143 million, 81 s and .79 s with 131 000.

    >>> from ngbrain.forward.harmonic.wave import Wave
    >>> from ngbrain.materials import Shearing
    >>> from ngbrain.mesh.geometry.structured import rectangles
    >>> mesh = rectangles(np.linspace(0, 0.1, 4), np.linspace(0, 0.1, 4))
    >>> estimate_solver_cost(HarmonicProblem(mesh, Shearing(2000 + 800j), [Wave(50.0)], bulk=2e5, form="P2")).unknowns
    98
    """
    n = body.fes.ndof / 131e3
    return SolverCost(body.fes.ndof, 143e6 * n**1.85 * 16 / 2**30, 81 * n**2.67, 0.79 * n**1.7)
