"""Relaxing bodies under loads and given displacements over time: `Static` with a memory, one equilibrium for each time step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import ConvergenceError, InputError
from ngbrain.forward.held import check_held
from ngbrain.forward.history import History
from ngbrain.forward.inertia import Inertia
from ngbrain.forward.loads import Load
from ngbrain.forward.material import Material
from ngbrain.forward.static import Static
from ngbrain.forward.supports import Support
from ngbrain.materials.base import Deformation
from ngbrain.solvers.newton import Newton
from ngbrain.solvers.record import Work
from ngbrain.tensors import isochoric, right_cauchy_green

Array = np.ndarray
HALVINGS = 6
"""How often a step that has no equilibrium is halved before the run gives up."""


@dataclass(frozen=True)
class Remembering(Material):
    """A relaxing material in the step that its history has begun."""

    history: History | None = None

    def energy(self, at: Deformation, p: CoefficientFunction | None) -> CoefficientFunction:
        """What a step minimises (Pa): see `ngbrain.materials.viscous`."""
        law, history = self.viscous, self.history
        assert history is not None
        energy = law.density(at, history.shares[: len(law.hereditary)]) + history.energy(law, at.shape)
        return energy + self.of_volume(at.J, p)


class Relaxing(Static):
    """A body whose supports and loads grow with a factor a(t), and whose tissue relaxes.

    Arguments as those of `Static`, but materials may relax (`Prony`, `Maxwell` branches): every step of time is an
    equilibrium of the energy that the history makes of them, or, with `Inertia` among the loads, a step of motion. The time steps
    are the caller's; they are second order.

    >>> from ngbrain.materials import NeoHooke, Prony
    >>> from ngbrain.mesh import block
    >>> tissue = Material(Prony(NeoHooke(1e3), [0.5], [1.0]), 1e5)
    >>> body = Relaxing(block((0.1, 0.1, 0.1), 0.1), {".*": tissue}, {"bottom": 0, "top": (0, 0, -1e-4)}, form="P2/P1")
    >>> forces = body.run([0, 0.01, 10, 30], [0, 1, 1, 1], lambda t: body.force("top")[2])
    >>> round(float(forces[-1] / forces[0]), 2)
    0.5
    """

    def __init__(
        self,
        mesh: ngs.Mesh,
        materials: Mapping[str, Material],
        supports: Mapping[str, Support],
        loads: Sequence[Load] = (),
        **kwargs: Any,
    ) -> None:
        at_once = {p: Material(m.viscous.instantaneous, m.bulk, m.pointwise, m.change) for p, m in materials.items()}
        super().__init__(mesh, at_once, supports, loads, **kwargs)
        self.history = History(mesh, {p: m.viscous for p, m in materials.items()}, max(self.form.order - 1, 1))
        self.rules = self.history.rules
        self._points = mesh.MapToAllElements(dict(self.rules), ngs.VOL)
        F = self.kinematics.gradient(self.u, ngs.Grad(self.u))
        self.history.follow(isochoric(right_cauchy_green(F)))
        self.materials = {
            p: Remembering(m.law, m.bulk, m.pointwise, m.change, self.history) for p, m in materials.items()
        }
        self.masses = [load for load in loads if isinstance(load, Inertia)]
        self.work = Work()
        self._make_forms()

    def run(
        self,
        times: Sequence[float] | Array,
        factors: Sequence[float] | Array,
        seen: Callable[[float], Any],
        newton: Newton | None = None,
    ) -> list[Any]:
        """From rest at times[0] through the times (s) with the load factor at each; what `seen` gives after every step.

        A step without an equilibrium is halved. Raises `ConvergenceError` when halves get too short.
        """
        times, factors = np.asarray(times, float), np.asarray(factors, float)
        if times.ndim != 1 or times.shape != factors.shape or len(times) < 2 or not np.all(np.diff(times) > 0):
            raise InputError("times", np.array2string(times, threshold=4), "increasing, with a factor for each")
        if not self.masses:
            check_held(self.supports, self.loads, self.kinematics)
        newton = replace(newton or self.newton(), inverse=None, largest=0.0)  # the caller's stays as it is
        found = []
        for t, end in pairwise(times):
            self._pass(newton, t, end, lambda s: float(np.interp(s, times, factors)), 0)
            found.append(seen(end))
        return found

    def _pass(self, newton: Newton, t: float, end: float, factor: Callable[[float], float], halved: int) -> None:
        """From t to `end` in one step, or in two."""
        before = self.state
        self.history.begin(end - t)
        for mass in self.masses:
            mass.begin(before[self.is_u], end - t)
        self._at = np.empty(0)
        lifted = self.load(before, factor(end))
        guess = lifted
        if newton.inverse is not None and not np.array_equal(lifted, before):
            self.load(before, factor(t))
            r = self.residual(before)[0]
            near = self.load(before, factor(t) + 1e-3 * (factor(end) - factor(t)))
            rate = (self.residual(near)[0] - r) * 1e3
            guess = lifted - newton.inverse(rate)
            self.load(before, factor(end))
            if not self.min_det(guess) > newton.min_det:
                guess = lifted
        x, record = newton.solve(self, guess)
        self.work += record.work
        if record.converged:
            self.state = x
            self._flow(x)
            self.history.finish()
            for mass in self.masses:
                mass.finish(x[self.is_u])
            return
        self.state = before
        if halved == HALVINGS:
            raise ConvergenceError(
                f"the time step of {end - t:.2g} s at t = {t:.3g} s fails: {record.reason}; try a finer mesh or less load"
            )
        middle = (t + end) / 2
        self._pass(newton, t, middle, factor, halved + 1)
        self._pass(newton, middle, end, factor, halved + 1)

    _at: Array = np.empty(0)
    _stiff = False

    def _flow(self, x: Array) -> None:
        """Let the Maxwell branches flow to where they rest with a state."""
        if self.history.flows and not np.array_equal(x, self._at):
            self.state = x
            self.history.relax()
            self._at, self._stiff = x.copy(), False

    def residual(self, x: Array) -> tuple[Array, float]:
        """As `Static`'s, with branches that flowed."""
        self._flow(x)
        return super().residual(x)

    def factorise(self, x: Array, r: Array) -> Any:
        """As `Static`'s, with the stiffness of branches that flow."""
        self._flow(x)
        if self.history.flows and not self._stiff:
            self.history.flows.stiffen()
            self._stiff = True
        return super().factorise(x, r)
