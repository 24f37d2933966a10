"""Gauss-Newton inversion of 3-D wave problems by preconditioned conjugate gradients, with checkpoints.

The wave operator is factorised once at each trial point; the factor serves the forward solves, the gradient and all products
of the step. Weights converge as in `gauss_newton`; the effective number of parameters is estimated by one more solve per step.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.adjoint.reduced import Point, Reduced
from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError
from ngbrain.forward.sensitivity.harmonic.wave_model import WaveLinearisation
from ngbrain.inverse.optimise.fingerprint import differing_parts, problem_fingerprint
from ngbrain.inverse.optimise.gauss_newton import MAX_ITERATIONS, GaussNewton, WaveInversionResult
from ngbrain.inverse.optimise.normal_equations import FORCING, MAX_CG_ITERATIONS, NormalEquations
from ngbrain.inverse.optimise.preconditioners import BoundaryExtensionPreconditioner
from ngbrain.inverse.optimise.regularisation_weight import Evidence, MisfitLevel, WeightPolicy
from ngbrain.inverse.optimise.result import Iteration, OptimisationResult
from ngbrain.reading import read_npz
from ngbrain.result import Status
from ngbrain.solvers.quasi_newton_preconditioner import QuasiNewtonPreconditioner

Array = np.ndarray
STILL, ALIKE = 5e-3, 1.5
"""Relative change of the misfit, and factor of change of any weight, at which the iterations end."""
SLOW, FALL = 2.0, 10.0
"""Of `approach`: least reduction factor of the misfit for another step to follow; factor by which the weights are lowered."""


NOWHERE = np.empty((0, 0), complex)
"""Waves of a checkpoint that needs none."""


class GaussNewtonCG(GaussNewton):
    """Gauss-Newton-CG optimiser of a reduced objective whose model is a `WaveModel` in 3-D or in the plane.

    The prescribed boundary displacements are unknown too where `reduced.unknowns` has the block "boundary".

    Parameters
    ----------
    reduced : Reduced
        Objective; its unknowns are `ParameterFields`.
    policy : WeightPolicy, optional
        Update of the regularisation weights. Default `Evidence`.
    forcing : float
        Relative residual at which conjugate gradients stop.
    max_cg_iterations : int
        Maximum number of conjugate-gradient iterations per step.
    checkpoint : path, optional
        .npz file that is written after each iteration.
    callback : callable
        Called with each `Iteration`.
    seed : int
        Seed of the random probes that estimate traces.

    References
    ----------
    Forcing: Eisenstat and Walker 1996, 10.1137/0917003. Hessian products: Petra et al. 2014, 10.1137/130934805.
    """

    def __init__(
        self,
        reduced: Reduced,
        policy: WeightPolicy | None = None,
        *,
        forcing: float = FORCING,
        max_cg_iterations: int = MAX_CG_ITERATIONS,
        checkpoint: str | os.PathLike[str] | None = None,
        callback: Callable[[Iteration], None] = lambda _: None,
        seed: int = 0,
    ) -> None:
        super().__init__(reduced, policy or Evidence(), callback, seed)
        self.forcing, self.max_cg_iterations, self.callback = forcing, max_cg_iterations, callback
        self.checkpoint = None if checkpoint is None else Path(checkpoint)
        self.directions, self.extensions = QuasiNewtonPreconditioner(), BoundaryExtensionPreconditioner()
        self.iterations: list[int] = []
        """Conjugate-gradient iterations of each solve: steps and probes in turn."""
        self.approach_result: OptimisationResult | None = None
        """Result of `approach`, if there was one; its expected misfit is the number of data."""

    @property
    def has_checkpoint(self) -> bool:
        """Whether there is a checkpoint to resume from."""
        return self.checkpoint is not None and self.checkpoint.exists()

    def resume(self, max_iterations: int = 4 * MAX_ITERATIONS) -> WaveInversionResult:
        """Resume `descend` from the checkpoint, as if it had never stopped; earlier iterations count.

        An inversion that had converged is not repeated: its result is returned after one forward solve.

        Parameters
        ----------
        max_iterations : int
            Maximum number of iterations, those before the checkpoint included.

        Returns
        -------
        WaveInversionResult

        Raises
        ------
        InputError
            If there is no checkpoint, if it belongs to another problem (the message says what differs, see
            `fingerprint.problem_fingerprint`), or if `approach` had not ended; then use `from_measured_waves`.
        """
        x, waves, notes = self._load_checkpoint()
        if len(waves):
            raise InputError("checkpoint", f"{self.checkpoint}, written before the descent began", "one of a descent")
        history = _history(notes["history"])
        self._ledger.started_s -= history[-1].cpu_s
        return self._minimise(self.reduced.evaluate(x), max_iterations - len(history), history, notes["settled"])

    def from_measured_waves(
        self, x: Array, waves: Array, approach_iterations: int, max_iterations: int
    ) -> WaveInversionResult:
        """Run `approach` and then `descend`, resuming from the checkpoint where there is one.

        After a resumed `approach` the preconditioners are rebuilt: the result is as good, but not identical to the last bit.

        Parameters
        ----------
        x : array (n,)
            Initial guess of the unknowns.
        waves : array (loads, ndof)
            Measured waves.
        approach_iterations : int
            Maximum number of iterations of `approach`.
        max_iterations : int
            Maximum number of iterations of `descend`.

        Returns
        -------
        WaveInversionResult
        """
        done, own = list[Iteration](), np.inf
        if self.has_checkpoint:
            saved, saved_waves, notes = self._load_checkpoint()
            if not len(saved_waves):
                return self.resume(max_iterations)
            x, waves, done, own = saved, saved_waves, _history(notes["done"]), notes["own"]
        return self._minimise(self.approach(x, waves, approach_iterations, done, own), max_iterations, [])

    def _step(self, x: Array, state: WaveLinearisation, balance: Array | None) -> tuple[NormalEquations, Array, Array]:
        point = Point(self.reduced, x, state)
        normal = NormalEquations(
            point, self.iterations, self.forcing, self.max_cg_iterations, self.directions, self.extensions
        )
        return normal, normal.solve(-normal.gradient()), np.zeros_like(state.waves)

    def _apply_step(self, x: Array, dx: Array, waves: Array) -> tuple[Array, Array]:
        return x + dx, waves

    def approach(
        self, x: Array, waves: Array, max_iterations: int, done: Sequence[Iteration] = (), before: float = np.inf
    ) -> Point:
        """Find an initial guess for `descend` from waves close to the data that need not fit the fields.

        The steps are those of `from_waves`. Each but the first lowers the weights by `FALL`. They end after `max_iterations`, or
        when the misfit of the waves of the current fields hardly decreases (`SLOW`).

        Parameters
        ----------
        x : array (n,)
            Initial guess of the unknowns.
        waves : array (loads, ndof)
            Measured waves.
        max_iterations : int
            Maximum number of iterations, those of `done` included.
        done : sequence of Iteration
            Iterations before a checkpoint.
        before : float
            Misfit of the last of these.

        Returns
        -------
        Point
            Point of the reduced objective to descend from.
        """
        begun, history, point = time.process_time(), list(done), None
        for number in range(len(history), max_iterations):
            state = self.model.linearise(self.unknowns.theta(x), waves)
            balance = [self.model.body.load_vector(k) - state.factors.apply(k, u) for k, u in enumerate(waves)]
            moved = np.array([state.factors.solve(k, b) for k, b in enumerate(balance)])
            own = WaveLinearisation(self.model, state.factors, waves + moved)  # waves of the current fields
            misfit = self.misfit.value(own.data)
            if misfit > before / SLOW:
                point = Point(self.reduced, x, own)
                break
            before, state.data = misfit, own.data
            for name in self.reduced.weights if number else ():
                self.reduced.weights[name] /= FALL
            normal, dx, _ = self._step(x, state, None)
            moved += state.state_derivative(normal.point.jacobian @ dx)
            step = self._step_bound(dx)
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

    def _is_stationary(self, history: list[Iteration]) -> bool:
        # Traces are estimates, so weights of what the data hardly determine never converge exactly.
        if len(history) < 2:
            return False
        before, now = history[-2:]
        turned = max(abs(float(np.log(now.weights[name] / before.weights[name]))) for name in now.weights)
        return bool(now.step == 1 and abs(now.misfit / before.misfit - 1) < STILL and turned < np.log(ALIKE))

    @cached_property
    def _problem(self) -> dict[str, str]:
        return problem_fingerprint(self.reduced)

    def _write_checkpoint(self, x: Array, history: list[Iteration], settled: bool) -> None:
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

    def _load_checkpoint(self) -> tuple[Array, Array, dict[str, Any]]:
        """x, waves (empty during a descent) and notes of the checkpoint; its weights and search directions are restored."""
        wanted = "a checkpoint that an inversion has written"
        if self.checkpoint is None or not self.has_checkpoint:
            raise InputError("checkpoint", str(self.checkpoint), wanted)
        try:
            saved = read_npz(self.checkpoint, "checkpoint")
            x, waves, begun, directions = (saved[name] for name in ("x", "waves", "begun", "directions"))
            notes = json.loads(str(saved["notes"]))
            recorded = notes.get("problem")
        except (KeyError, ValueError, AttributeError) as error:
            raise InputError("checkpoint", f"{self.checkpoint}, which is not one", wanted) from error
        if others := differing_parts(recorded, self._problem):
            found = f"{self.checkpoint}, of another problem: differs in {', '.join(others)}"
            raise InputError("checkpoint", found, "one of the same problem, or no file there")
        self.reduced.weights, self.directions.arrays = notes["weights"], directions
        if arrived := notes.get("arrived"):
            more = {"x": begun, "level": MisfitLevel(**arrived["level"]), "history": _history(arrived["history"])}
            more["status"] = Status(arrived["status"])
            self.approach_result = OptimisationResult(**(arrived | more))
        return x, waves, notes


def _history(entries: Sequence[dict[str, Any]]) -> list[Iteration]:
    return [Iteration(**entry) for entry in entries]
