"""Time-dependent runs as a model from parameters to data: forces over time, displacements at points and times.

Step n solves R(x; h, θ) = 0 and updates the internal variables h⁺ = U(x, h; θ) (`step`). Data are d = B x + Z f with the tissue's
nodal forces f (`run_observables`). With K = ∂R/∂x, K_f = ∂f/∂x, R_h and R_θ of the tissue, and C_θ of contacts and loads,

    J δθ:   K δx = -(R_h δh + (R_θ + C_θ) δθ),  δd = B δx + Z (K_f δx + R_h δh + R_θ δθ),  δh⁺ = U_x δx + U_h δh + U_θ δθ
    Jᵀ w:   Kᵀ λ = -(Bᵀw + K_f Zᵀw + U_xᵀ Λ),  Λ ← U_hᵀ Λ + R_hᵀ(λ + Zᵀw),  ∇ += U_θᵀ Λ + R_θᵀ(λ + Zᵀw) + C_θᵀ λ

forwards in time for J δθ and backwards for Jᵀ w. Second derivatives use both, with two more solves a step (`step_hessian`).
Frictional slip (`friction_step`) and velocities and accelerations (`inertia_step`) are further internal variables. A
force-controlled tool adds its displacement as an unknown and its force balance as an equation, which border K (`tangents`).
Prescribed displacements enter through K; the adjoint's residual at these degrees of freedom is the derivative with respect to
them. The time grid is fixed, as an adaptive one would depend on θ. Contact is smooth enough to be differentiated as it stands.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TypeAlias

import numpy as np

from ngbrain.errors import ConvergenceError, InputError
from ngbrain.forward.contact.motion import Motion
from ngbrain.forward.observables.base import Observable
from ngbrain.forward.sensitivity.contact_work import ContactForms
from ngbrain.forward.sensitivity.node_positions import NodePositions
from ngbrain.forward.sensitivity.parameter_blocks import ParameterBlock, PrescribedDisplacement, Scalar, block_slices
from ngbrain.forward.sensitivity.parameters import parameter_block
from ngbrain.forward.sensitivity.transient.friction_step import FrictionStep
from ngbrain.forward.sensitivity.transient.inertia_step import InertiaSensitivity
from ngbrain.forward.sensitivity.transient.replay import TIGHT, Replay, ReplayStep
from ngbrain.forward.sensitivity.transient.run_linearisation import RunLinearisation
from ngbrain.forward.sensitivity.transient.run_observables import RunObservables
from ngbrain.forward.sensitivity.transient.step import Parameter, StepForms
from ngbrain.forward.sensitivity.transient.step_hessian import StepHessian
from ngbrain.forward.sensitivity.transient.step_shape import StepShapeDerivatives
from ngbrain.forward.sensitivity.transient.tangents import BorderedTangents, PivotedTangents, Tangents, TangentSystem
from ngbrain.forward.solid.advance import LoadHistory
from ngbrain.forward.solid.problem import Problem
from ngbrain.solvers.newton import Newton

Array = np.ndarray
Carried: TypeAlias = FrictionStep | InertiaSensitivity


class RunModel:
    """Model from a parameter vector θ to observations of a run at given times.

    Parameters
    ----------
    body : Problem
        At rest at first; its materials depend on `parameters`.
    motion : Motion
        Motion of its rigid bodies and of what its loads depend on.
    grid : sequence of float
        Times (s) from 0 at which steps end, such as those of an adaptive run by `replay.accepted_times`.
    parameters : dict
        Name → parameter; their values one after the other are θ. A GridFunction or `ngs.Parameter` of materials, rigid bodies or
        loads, such as a factor of a blade's displacement; `PrescribedDisplacement(body, boundary)` at load factor 1; or
        `NodePositions(mesh)`.
    observables : sequence of Observable
        Observables, see `ngbrain.forward.observables`.
    times : sequence of float, optional
        Times (s) of the observations, added to the grid; None: the end of every step.
    newton : Newton
        As in `Replay`.
    every : int, optional
        As in `Replay`.
    states : bool
        As in `Replay`.
    loads : LoadHistory, optional
        As in `Replay`.

    Raises
    ------
    InputError
        For times, observables, parameters or motions that cannot be used.

    Examples
    --------
    >>> import ngsolve as ngs
    >>> from ngbrain.forward.common.material import Material
    >>> from ngbrain.forward.contact.rigid import RigidContact
    >>> from ngbrain.forward.solid.problem import Problem
    >>> from ngbrain.forward.observables import Force
    >>> from ngbrain.materials import NeoHooke, Prony
    >>> from ngbrain.mesh import block
    >>> from ngbrain.surgery.protocols import Drive, ToolMotion
    >>> drive = Drive(ToolMotion("press", (0.0, 2.0, 8.0), (0.0, 1e-3, 1e-3)))
    >>> plate = RigidContact("top", lambda x: 0.02 - drive.parameter - x[2], 1e8, 2e-5)
    >>> g, tau = ngs.Parameter(0.5), ngs.Parameter(3.0)
    >>> tissue = Material(Prony(NeoHooke(1000.0), [g], [tau]), 1e6)
    >>> cube = block((0.02, 0.02, 0.02), 0.02)
    >>> body = Problem(cube, {"tissue": tissue}, {"bottom": 0}, contacts=[plate], element="P2/P1")
    >>> model = RunModel(body, drive, [0.0, 1.0, 2.0, 8.0], {"g": g, "tau": tau}, [Force("top", (0, 0, 1))])
    >>> there = model.evaluate(model.theta)
    >>> there.data.shape, there.gradient(there.data).shape
    ((3, 1), (2,))
    """

    tool_block = "travel of the tool"
    """Name of the block of a force-controlled tool's displacement."""

    def __init__(
        self,
        body: Problem,
        motion: Motion,
        grid: Sequence[float] | Array,
        parameters: Mapping[str, Parameter | PrescribedDisplacement | NodePositions],
        observables: Sequence[Observable],
        times: Sequence[float] | Array | None = None,
        newton: Newton = TIGHT,
        every: int | None = None,
        states: bool = True,
        loads: LoadHistory | None = None,
    ) -> None:
        grid = np.asarray(grid, float)
        times = grid[1:] if times is None else np.asarray(times, float)
        if not np.all((times > 0) & (times <= grid[-1])) or not np.all(np.diff(times) > 0):
            raise InputError(
                "times", np.array2string(times, threshold=4), f"increasing, after 0 and up to {grid[-1]:g} s"
            )
        apart = np.min(np.abs(grid[:, None] - times), axis=1) > 1e-9 * grid[-1]
        if not observables:
            raise InputError("observables", "none", "one or more observables")
        self.body, self.parameters, self.times = body, dict(parameters), times
        values = {
            name: of
            for name, of in self.parameters.items()
            if not isinstance(of, (PrescribedDisplacement, NodePositions))
        }
        self.forms = StepForms(body, values)
        nodes = [(name, of) for name, of in self.parameters.items() if isinstance(of, NodePositions)]
        self.shapes = {name: StepShapeDerivatives(self.forms, of) for name, of in nodes}
        if (own := getattr(motion, "parameter", None)) is not None:
            for name, parameter in self.parameters.items():
                if parameter is own:
                    raise InputError(
                        f"parameters.{name}", "the motion's own parameter", "another one, such as a factor of it"
                    )
        self.parts = {name: parameter_block(name, of) for name, of in self.parameters.items()}
        sizes = [part.size for part in self.parts.values()]
        self.blocks, self.size = dict(zip(self.parts, block_slices(sizes), strict=True)), sum(sizes)
        made_of: dict[str, ParameterBlock] = dict(self.parts)
        if body.tool is not None:
            self._check_tool(grid)
            made_of[self.tool_block] = Scalar(body.tool.prescribed.parameter)
        self.prescribed_blocks = [
            (of, self.blocks[name]) for name, of in self.parameters.items() if isinstance(of, PrescribedDisplacement)
        ]
        self.n = len(body.x)
        """Unknowns of the body, with the displacement of a force-controlled tool."""
        self._made_of, self.contacts = made_of, ContactForms(body, made_of)
        friction = FrictionStep(body, made_of) if body.friction.frictions else None
        self.carried: list[Carried] = [] if friction is None else [friction]
        """Further internal variables: friction and inertia."""
        if body.inertia is not None:
            self.carried.append(InertiaSensitivity(body, made_of))
        for name in self.shapes if self.carried else ():
            raise InputError(
                f"parameters.{name}", "of type NodePositions", "others, for a body with friction or inertia"
            )
        pivots = friction is not None or body.pivots or body.form.condense
        inner = PivotedTangents(body, friction) if pivots else Tangents(body)
        self.tangents = inner if body.tool is None else BorderedTangents(inner, self.contacts, friction)
        self.observables = RunObservables(body, observables, made_of)
        self.observation_slices = self.observables.slices
        """Where each observable is in a row of the data."""
        system = None if friction is None else TangentSystem(body, self.tangents)
        steps = np.sort(np.concatenate([grid[apart], times]))
        self.replay = Replay(body, motion, steps, newton, every, states, system, loads)
        self.row = {int(np.searchsorted(self.replay.grid, t)) - 1: i for i, t in enumerate(times)}
        """Row of the data of a step."""

    @property
    def theta(self) -> Array:
        """Present parameters θ."""
        return np.concatenate([part.value for part in self.parts.values()])

    @cached_property
    def curvature(self) -> StepHessian:
        """Second derivatives of a time step, made at first use."""
        return StepHessian(self.forms, self._made_of, self.contacts, self.observables)

    def evaluate(self, theta: Array) -> RunLinearisation:
        """The run at θ, with its derivatives; the parameters keep the values of the last call."""
        if np.shape(theta) != (self.size,):
            raise InputError("theta", f"of shape {np.shape(theta)}", f"{self.size} numbers")
        if not np.all(np.isfinite(theta)):
            raise ConvergenceError("parameters are not finite; reduce the step")
        for name, part in self.parts.items():
            part.set_value(theta[self.blocks[name]])
        if self.shapes:
            self.forms.update_quadrature()
        if self.body.inertia is not None:
            self.body.inertia.update_density()
        return RunLinearisation(self)

    def split(self, theta: Array) -> dict[str, Array]:
        """θ, or a change of it, by parameter."""
        return {name: theta[block] for name, block in self.blocks.items()}

    def prescribed_force_gradient(self, step: ReplayStep) -> Array:
        """Derivative of the prescribed tool force at the end of a step with respect to θ (size,)."""
        found, tool = np.zeros(self.size), self.body.tool
        if tool is not None:
            for name, of in self.parameters.items():
                found[self.blocks[name]] += tool.prescribed.gradient(self.replay.grid[step.n + 1], of)
        return found

    def _check_tool(self, grid: Array) -> None:
        """Refuse a tool that leaves contact and returns, with friction: its position without contact is not differentiated."""
        assert self.body.tool is not None
        prescribed, travel = self.body.tool.prescribed, self.body.tool.prescribed.parameter
        presses = np.array([prescribed.prescribed_force(t) > 0 for t in grid[1:]])
        again = np.any(presses[np.argmin(presses) :]) and not presses.all()
        if again and any(f.moves and f.contact.travel is travel for f in self.body.friction.frictions):
            wanted = "a force that stays positive, as friction depends on the tool's path: derivatives of a run need it"
            raise InputError("motion", "a force that returns after it was zero", wanted)
