"""How what a run shows changes with what its body is made of: forces over time, displacements at points and times.

Step n finds x with R(x; h, θ) = 0 and h⁺ = U(x, h; θ) (`step_forms`), data are d = B x + Z f of the tissue's nodal forces f
(`run_observables`). With K = ∂R/∂x, K_f = ∂f/∂x and R_h, R_θ that of the tissue,

    J δθ:   K δx = -(R_h δh + (R_θ + C_θ) δθ),  δd = B δx + Z (K_f δx + R_h δh + R_θ δθ),  δh⁺ = U_x δx + U_h δh + U_θ δθ
    Jᵀ w:   K λ = -(Bᵀw + K_f Zᵀw + U_xᵀ Λ),  Λ ← U_hᵀ Λ + R_hᵀ(λ + Zᵀw),  ∇ += U_θᵀ Λ + R_θᵀ(λ + Zᵀw) + C_θᵀ λ

with C_θ of the contacts, from the first step on and from the last one back; second derivatives by both, with two solves more a
step (`step_hessian`). What steps remember besides goes the same way: how far walls slipped and where the step began
(`friction_step`), velocities and accelerations (`inertia_step`). The grid of times is given and stays: an adaptive one would move
with θ. Contact is differentiated where it stands; its energy is smooth enough.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import TypeAlias

import numpy as np

from ngbrain.errors import ConvergenceError, InputError, shaped
from ngbrain.forward.contact.motion import Motion
from ngbrain.forward.observables.base import Observable
from ngbrain.forward.sensitivity.contact_work import ContactForms
from ngbrain.forward.sensitivity.parameter_blocks import Nodes, block, places
from ngbrain.forward.sensitivity.transient.friction_step import FrictionStep, SlidingTangents
from ngbrain.forward.sensitivity.transient.inertia_step import InertiaStep
from ngbrain.forward.sensitivity.transient.replay import TIGHT, Replay, Step
from ngbrain.forward.sensitivity.transient.run_observables import RunObservables
from ngbrain.forward.sensitivity.transient.step import Parameter, StepForms
from ngbrain.forward.sensitivity.transient.step_hessian import StepCurvature
from ngbrain.forward.sensitivity.transient.step_shape import StepShapes
from ngbrain.forward.sensitivity.transient.tangents import EXACT, FINER, Tangents
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.tangent import Solve
from ngbrain.solvers.newton import Newton

Array = np.ndarray
Carried: TypeAlias = FrictionStep | InertiaStep
TOGETHER = 40
"""Unknowns in θ up to which the columns of J are found together, with one factor of each step."""


class RunModel:
    """From a vector θ to what a run shows at some times.

    body        at rest at first; its materials are made of `parameters`
    motion      of its rigid bodies and of what its loads are made of
    grid        times (s) from 0 on at which steps end, such as `replay.times_of` an adaptive run finds
    parameters  name → GridFunction or Parameter that materials, rigid bodies and loads are made of, such as a factor of a blade's
                way, or `Nodes(mesh)`, where the mesh's nodes are; their values one after the other are θ
    observables  what is seen, see `ngbrain.forward.observables`
    times       (s) when; steps end there too. None: at the end of every step
    newton, every, states   see `Replay`

    >>> import ngsolve as ngs
    >>> from ngbrain.forward.common.material import Material
    >>> from ngbrain.forward.contact.rigid import Contact
    >>> from ngbrain.forward.solid.problem import Problem
    >>> from ngbrain.forward.observables import Force
    >>> from ngbrain.materials import NeoHooke, Prony
    >>> from ngbrain.mesh import block
    >>> from ngbrain.surgery.protocols import Drive, Protocol
    >>> drive = Drive(Protocol("press", (0.0, 2.0, 8.0), (0.0, 1e-3, 1e-3)))
    >>> plate = Contact("top", lambda x: 0.02 - drive.parameter - x[2], 1e8, 2e-5)
    >>> g, tau = ngs.Parameter(0.5), ngs.Parameter(3.0)
    >>> tissue = Material(Prony(NeoHooke(1000.0), [g], [tau]), 1e6)
    >>> cube = block((0.02, 0.02, 0.02), 0.02)
    >>> body = Problem(cube, {"tissue": tissue}, {"bottom": 0}, contacts=[plate], element="P2/P1")
    >>> model = RunModel(body, drive, [0.0, 1.0, 2.0, 8.0], {"g": g, "tau": tau}, [Force("top", (0, 0, 1))])
    >>> there = model.at(model.theta)
    >>> there.data.shape, there.gradient(there.data).shape
    ((3, 1), (2,))
    """

    def __init__(
        self,
        body: Problem,
        motion: Motion,
        grid: Sequence[float] | Array,
        parameters: Mapping[str, Parameter | Nodes],
        observables: Sequence[Observable],
        times: Sequence[float] | Array | None = None,
        newton: Newton = TIGHT,
        every: int | None = None,
        states: bool = True,
    ) -> None:
        grid = np.asarray(grid, float)
        times = grid[1:] if times is None else np.asarray(times, float)
        if not np.all((times > 0) & (times <= grid[-1])) or not np.all(np.diff(times) > 0):
            raise InputError(
                "times", np.array2string(times, threshold=4), f"increasing, after 0 and up to {grid[-1]:g} s"
            )
        apart = np.min(np.abs(grid[:, None] - times), axis=1) > 1e-9 * grid[-1]
        if not observables:
            raise InputError("observables", "none", "one or more: what is seen of a run")
        self.body, self.parameters, self.times = body, dict(parameters), times
        values = {name: of for name, of in self.parameters.items() if not isinstance(of, Nodes)}
        self.forms = StepForms(body, values)
        nodes = [(name, of) for name, of in self.parameters.items() if isinstance(of, Nodes)]
        self.shapes = {name: StepShapes(self.forms, of) for name, of in nodes}
        if (own := getattr(motion, "parameter", None)) is not None:
            for name, parameter in self.parameters.items():
                if parameter is own:
                    raise InputError(f"parameters.{name}", "what the motion sets", "another, such as a factor of it")
        self.parts = {name: block(name, of) for name, of in self.parameters.items()}
        sizes = [part.size for part in self.parts.values()]
        self.blocks, self.size = dict(zip(self.parts, places(sizes), strict=True)), sum(sizes)
        self.contacts = ContactForms(body, self.parts)
        self.carried: list[Carried] = []
        """What steps remember beside the tissue's history."""
        self.tangents: Tangents | SlidingTangents = Tangents(body)
        if body.friction.frictions:
            friction = FrictionStep(body, self.parts)
            self.carried, self.tangents = [friction], SlidingTangents(body, friction)
        if body.inertia is not None:
            self.carried.append(InertiaStep(body, self.parts))
        for name in self.shapes if self.carried else ():
            raise InputError(f"parameters.{name}", "nodes", "others, of a body that rubs or has mass")
        self.seen = RunObservables(body, observables, self.parts)
        self.observed = self.seen.slices
        """Where each observable is in a row of the data."""
        rubs = self.tangents if isinstance(self.tangents, SlidingTangents) else None
        steps = np.sort(np.concatenate([grid[apart], times]))
        self.replay = Replay(body, motion, steps, newton, every, states, rubs)
        self.row = {int(np.searchsorted(self.replay.grid, t)) - 1: i for i, t in enumerate(times)}
        """Which row of the data a step gives."""

    @property
    def theta(self) -> Array:
        """θ as the parameters are now."""
        return np.concatenate([part.value for part in self.parts.values()])

    @cached_property
    def curvature(self) -> StepCurvature:
        """What second derivatives need; made when first asked for."""
        return StepCurvature(self.forms, self.parts, self.contacts, self.seen)

    def at(self, theta: Array) -> Replayed:
        """The run at θ, and its derivatives; the parameters keep the values of the last call."""
        if np.shape(theta) != (self.size,):
            raise InputError("theta", f"of shape {np.shape(theta)}", f"{self.size} numbers")
        if not np.all(np.isfinite(theta)):
            raise ConvergenceError("parameters that are not finite have no run: a step too far")
        for name, part in self.parts.items():
            part.put(theta[self.blocks[name]])
        if self.shapes:
            self.forms.measure()
        if self.body.inertia is not None:
            self.body.inertia.weigh()
        return Replayed(self)

    def split(self, theta: Array) -> dict[str, Array]:
        """θ, or a change of it, by parameter."""
        return {name: theta[block] for name, block in self.blocks.items()}


class Replayed:
    """The run at one θ: `data` (times, numbers), and the products of J and Jᵀ. It is of use until the model moves on."""

    def __init__(self, model: RunModel) -> None:
        self.model = model
        self.data = np.zeros((len(model.times), model.seen.size))

        def seen(step: Step) -> None:
            if step.n in model.row:
                self.data[model.row[step.n]] = model.seen.value()

        try:
            with np.errstate(divide="raise", over="raise", invalid="raise"):
                model.replay.run(seen)
        except FloatingPointError as error:
            raise ConvergenceError(f"a run with parameters that it cannot have: {error}") from error

    def push(self, direction: Array) -> Array:
        """J δθ, as `data`."""
        if self.model.size > TOGETHER:
            return self._pushed(direction[None])[0]
        return np.tensordot(direction, self.jacobian, 1)

    def pull(self, w: Array) -> Array:
        """Jᵀ w, by the columns of J where there are few."""
        return self.gradient(w) if self.model.size > TOGETHER else np.asarray(np.tensordot(self.jacobian, w, 2))

    @cached_property
    def jacobian(self) -> Array:
        """J, (θ, times, numbers)."""
        return self._pushed(np.eye(self.model.size))

    def gradient(self, w: Array) -> Array:
        """Jᵀ w: a solve for each step, or nothing where J's columns are at hand."""
        shaped("w", np.shape(w), self.data.shape)
        if "jacobian" in vars(self):
            return np.asarray(np.tensordot(self.jacobian, w, 2))
        model, forms = self.model, self.model.forms
        weights, total = np.zeros((forms.size, len(forms.quadrature))), np.zeros(model.size)
        by_end, memory = np.zeros(model.body.fes.ndof), [np.zeros(each.size) for each in model.carried]
        for step in model.replay.backwards():
            adjoint, motion, _ = self._adjoint(step, w, weights, later=(by_end, memory))
            by_end = np.zeros_like(by_end)
            for i, each in enumerate(model.carried):
                by_start, memory[i], by_theta = each.back(adjoint + motion if each.felt else adjoint, memory[i])
                by_end, total = by_end + by_start, total + by_theta
            shifts = {name: shapes.slopes(adjoint + motion, weights) for name, shapes in model.shapes.items()}
            weights, slopes = forms.back(adjoint + motion, weights)
            slopes |= shifts
            total += np.concatenate([slopes[name] for name in model.parts]) + self._touched(adjoint)
            total += model.seen.by_theta(self._row(step, w))
        return total

    def second(self, w: Array, direction: Array) -> Array:
        """(w · data)'' δθ: what the curvature of a misfit has beside the Gauss-Newton matrix, with w the misfit's slope.

        Raises `InputError` for walls that close on each other and for node positions.
        """
        for name in self.model.shapes:
            raise InputError(f"parameters.{name}", "nodes", "others, for second derivatives")
        shaped("w", np.shape(w), self.data.shape)
        if self.model.carried:
            raise InputError("body", "with friction or inertia", "without, for second derivatives of a run")
        model, forms, curved = self.model, self.model.forms, self.model.curvature
        theta, total = model.split(direction), np.zeros(model.size)
        weights = turned = np.zeros((forms.size, len(forms.quadrature)))
        for step, x, history in self._changes_back(direction):
            adjoint, motion, solve = self._adjoint(step, w, weights, FINER)
            curved.aim(x, history, theta)
            model.seen.weigh(self._row(step, w))
            forces, bent, slopes = curved(adjoint, adjoint + motion, weights)
            change = -solve(forces + forms.remembered(turned))
            turned, more = forms.back(change, turned)
            turned = turned + bent
            weights, _ = forms.back(adjoint + motion, weights)
            total += slopes + np.concatenate(list(more.values())) + self._touched(change)
        return total

    def _adjoint(
        self,
        step: Step,
        w: Array,
        weights: Array,
        exact: float = EXACT,
        later: tuple[Array, Sequence[Array]] | None = None,
    ) -> tuple[Array, Array, Solve]:
        """λ and Zᵀw of a step at whose end the body stands, and the solver.

        `later`: how the next step changes with this end, and weights of what it is told besides.
        """
        model, solve = self.model, self._begin(step, 1, exact)
        row = self._row(step, w)
        b = model.seen.by_state(row, model.tangents.apply) + model.forms.remembered(weights)
        if later is not None:
            b += later[0] + sum((each.remembered(m) for each, m in zip(model.carried, later[1], strict=True)), 0.0)
        return -model.tangents.transposed(b), model.seen.motions.T @ row, solve

    def _row(self, step: Step, w: Array) -> Array:
        """Weights of what is seen at the end of a step."""
        return np.asarray(w[self.model.row[step.n]] if step.n in self.model.row else np.zeros(w.shape[1]))

    def _touched(self, adjoint: Array) -> Array:
        """C_θᵀ λ."""
        self.model.contacts.weigh(adjoint)
        return self.model.contacts.slopes()

    def _changes_back(self, direction: Array) -> Iterator[tuple[Step, Array, Array]]:
        """δx and δh of all steps, from the last one back, where the body stands; histories' changes are kept as these are."""
        replay, forms, theta = self.model.replay, self.model.forms, self.model.split(direction)
        history, kept, changes = np.zeros((forms.size, len(forms.quadrature))), dict[int, Array](), list[Array]()
        for step in replay.forwards():
            if step.n % replay.every == 0:
                kept[step.n] = history
            solve = self._begin(step, 1, FINER)
            changes.append(-solve(forms.changed(history, theta) + self.model.contacts.columns() @ direction))
            history = forms.moved(changes[-1])
        for steps in replay.segments():
            histories = [kept[steps[0].n]]
            for step in map(replay.stand, steps[:-1]):
                self._set(step)
                forms.aim(histories[-1], theta)
                histories.append(forms.moved(changes[step.n]))
            for step, history in zip(map(replay.stand, reversed(steps)), reversed(histories), strict=True):
                yield step, changes[step.n], history

    def _pushed(self, directions: Array) -> Array:
        """J times each of some directions, with one factor of each step."""
        model, forms = self.model, self.model.forms
        data = np.zeros((len(directions), *self.data.shape))
        histories = np.zeros((len(directions), forms.size, len(forms.quadrature)))
        ends = np.zeros((len(directions), model.body.fes.ndof))
        memory = [np.zeros((len(directions), each.size)) for each in model.carried]
        for step in model.replay.forwards():
            solve, contacts = self._begin(step, len(directions)), model.contacts.columns()
            shifted = {name: shapes.columns() for name, shapes in model.shapes.items()}
            seen = model.row.get(step.n)
            by_state, by_theta = model.seen.rows(model.tangents.apply) if seen is not None else (np.empty(0),) * 2
            for i, direction in enumerate(directions):
                theta = model.split(direction)
                r = forms.changed(histories[i], theta)
                r += sum(columns @ theta[name] for name, columns in shifted.items())
                outer = contacts @ direction
                for each, before in zip(model.carried, memory, strict=True):
                    change = each.changed(ends[i], before[i], list(theta.values()))
                    r, outer = (r + change, outer) if each.felt else (r, outer + change)
                x = -solve(r + outer)
                ends[i] = x
                for each, before in zip(model.carried, memory, strict=True):
                    before[i] = each.moved(x)
                if seen is not None:
                    data[i, seen] = by_state @ x + model.seen.motions @ r + by_theta @ direction
                histories[i] = forms.moved(x)
                histories[i] += sum(shapes.moved(theta[name]) for name, shapes in model.shapes.items())
        return data

    def _begin(self, step: Step, sides: int, exact: float = EXACT) -> Solve:
        """Forms and tangent of a step at whose end the body stands."""
        self._set(step)
        return self.model.tangents.here(sides, exact)

    def _set(self, step: Step) -> None:
        grid = self.model.replay.grid
        self.model.forms.begin(step.start.internal, grid[step.n + 1] - grid[step.n])
