"""Equilibrium of one load case for any θ, and the forms that its derivatives need.

With state u, data d = B(u, θ), weights w of the data and an adjoint λ, all derivatives are those of one Lagrangian,

    L(u, θ; w, λ) = w · B(u, θ) - R(u; θ)[λ] .

∂L/∂u = 0 determines λ, and ∂L/∂θ is then the gradient of w · d.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import InputError, solver_error
from ngbrain.forward.observables.base import Observable
from ngbrain.forward.sensitivity.node_positions import NodePositions
from ngbrain.forward.sensitivity.parameter_blocks import ParameterBlock, block_slices
from ngbrain.forward.solid.advance import newton_for
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import Motion, Terms, VirtualWork, slope, vector
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.solvers.linear import Solve
from ngbrain.solvers.newton import Newton
from ngbrain.solvers.record import SolverWork

Array = np.ndarray
RTOL, XTOL = 1e-10, 1e-9
"""Tolerances of Newton's method: derivatives are as accurate as the equilibria."""
SHORTEST = 1 / 16
"""Smallest step of continuation, as a fraction of the change of θ."""
FACTORISATIONS = 5
"""Factorisations allowed in each of these steps."""


@dataclass(frozen=True, eq=False)
class LoadCase:
    """A body under its loads, and its observables.

    Parameters
    ----------
    body : Problem
        Body with supports and loads.
    observations : sequence of Observable
        Observables of its state.
    """

    body: Problem
    observations: Sequence[Observable]


class Equilibrium:
    """The equilibrium of a load case as θ changes.

    Parameters
    ----------
    case : LoadCase
        Body and observables.
    blocks : dict of str to ParameterBlock
        Parameters of the body.
    newton : Newton, optional
        Settings; by default tight ones.
    steps : int
        Load steps from rest.

    Raises
    ------
    InputError
        For node positions where an observable has no derivative with respect to them.
    """

    def __init__(self, case: LoadCase, blocks: Mapping[str, ParameterBlock], newton: Newton | None, steps: int) -> None:
        self.body, self.blocks, self.steps = case.body, blocks, steps
        self.newton = newton or newton_for(self.body, rtol=RTOL, xtol=XTOL)
        self.observables = [observation.on(self.body) for observation in case.observations]
        self.slices = block_slices([observable.size for observable in self.observables])
        self.size = sum(observable.size for observable in self.observables)
        self.linear = all(observable.matrix is not None for observable in self.observables)
        """Whether all data are linear in u."""
        for observable in self.observables:
            if not (observable.symbolic and observable.has_shape_derivative) and any(
                isinstance(block, NodePositions) for block in blocks.values()
            ):
                raise InputError(
                    "parameters",
                    "of type NodePositions",
                    f"others: {type(observable).__name__} has no shape derivative",
                )
        self.adjoint, self.change = ngs.GridFunction(self.body.fes), ngs.GridFunction(self.body.fes)
        self.inverse: Solve | None = None
        """The last factorisation, with which Newton's method starts."""
        self.work = SolverWork()
        self._work, self._now = VirtualWork(self.body), self.body.gfu
        self._trial, self._test = self.body.fes.TnT()

    # Solution.

    def solve(self, set_parameters: Callable[[float], None], last: Array | None) -> Array:
        """Find the equilibrium, by continuation from a known one and, where that fails, by load steps from rest.

        Parameters
        ----------
        set_parameters : callable
            Sets the parameters at a fraction of their change: 0 are those of the known equilibrium, 1 the new ones.
        last : array (ndof,), optional
            The known equilibrium; None: from rest.

        Returns
        -------
        array (ndof,)
            The state.

        Raises
        ------
        InvertedElementError, ConvergenceError
            Where no equilibrium is found.
        """
        with np.errstate(over="ignore", invalid="ignore"):  # overflow gives an energy that is not finite
            state = None if last is None else self._continue(set_parameters, last)
            return self._from_rest(set_parameters) if state is None else state

    def _from_rest(self, set_parameters: Callable[[float], None]) -> Array:
        set_parameters(1.0)
        self.body.invalidate_tangent()
        newton = replace(self.newton)
        state, record = LoadPath(self.body).follow(newton, self.steps)
        self.work += record.work
        self.inverse = newton.inverse
        if not record.converged:
            said = f"no equilibrium: {record.reason}; try parameters closer to the last ones with an equilibrium"
            raise solver_error(said, record.status, record)
        return state

    def _continue(self, set_parameters: Callable[[float], None], x: Array) -> Array | None:
        at, step = 0.0, 1.0
        while step >= SHORTEST:
            goal = min(1.0, at + step)
            set_parameters(goal)
            self.body.invalidate_tangent()
            newton = replace(self.newton, inverse=self.inverse, max_factorisations=FACTORISATIONS)
            state, record = newton.solve(self.body, self.body.load(x, 1.0))
            self.work += record.work
            self.inverse = newton.inverse
            if not record.converged:
                step /= 2
                continue
            x, at = state, goal
            if at >= 1:
                return x
        return None

    # Data and derivatives, all at the body's state.

    def values(self) -> Array:
        """Data (size,)."""
        return np.concatenate([observable.value() for observable in self.observables])

    def set_weights(self, w: Array) -> None:
        """Set the weights w (size,) of L."""
        for observable, where in zip(self.observables, self.slices, strict=True):
            if observable.symbolic:
                observable.set_weights(w[where])

    def lagrangian(self, state: Motion, *along: Motion) -> Terms:
        """L at a state, or its derivative along motions; only observables that are integrals are included."""
        parts = [
            term
            for observable in self.observables
            if observable.symbolic
            for term in observable.functional(state, *along)
        ]
        return parts + [term.times(-1) for term in self._work(state, self.adjoint, *along)]

    @cached_property
    def state_gradient(self) -> Callable[[], Array]:
        """∂L/∂u (ndof,)."""
        return slope(self.body, self.lagrangian(self._trial))

    @cached_property
    def parameter_gradient(self) -> Callable[[], Array]:
        """∂L/∂θ (θ,)."""
        return self._parameter_gradient(self.lagrangian(self._now))

    @cached_property
    def tangent_product(self) -> Callable[[], Array]:
        """K times `change` (ndof,)."""
        return vector(self.body.fes, self._work(self._now, self._test, self.change))

    @cached_property
    def quadratic(self) -> bool:
        """Whether the energy is quadratic in the state (linear elasticity), so that the tangent is constant."""
        forces, tangent = self._work(self._trial, self.adjoint), self._work(self._trial, self.adjoint, self.change)
        # Forces always depend on the state: where the test misses that, its result for the tangent is not used either.
        return any(term.follows_trial for term in forces) and not any(term.follows_trial for term in tangent)

    def gradient_derivative(self) -> tuple[Array, Array]:
        """Derivatives of ∂L/∂u (ndof,) and ∂L/∂θ (θ,) along `change` of u and the blocks' directions of θ."""
        for observable in self.observables:
            if not observable.has_second_derivative:
                raise InputError(
                    type(observable).__name__, "without second derivatives", "an observable that is an integral"
                )
            observable.set_direction(np.array(self.change.vec.FV().NumPy()), self._parameter_change)
        by_state, by_theta = (of() for of in self._gradient_derivatives)
        for block in self.blocks.values():
            if isinstance(block, NodePositions):
                shape_part = block.finite_difference(
                    lambda: np.concatenate([self.state_gradient(), self.parameter_gradient()]), self._smallest_softness
                )
                by_state, by_theta = by_state + shape_part[: len(by_state)], by_theta + shape_part[len(by_state) :]
        return by_state, by_theta

    @property
    def _smallest_softness(self) -> float:
        """Smallest softening depth (m) of the contacts, which limits finite differences."""
        soft = [part.softness for part in (*self.body.contacts, *self.body.loads) if hasattr(part, "softness")]
        return min((float(each.Get() if isinstance(each, ngs.Parameter) else each) for each in soft), default=np.inf)

    @cached_property
    def _gradient_derivatives(self) -> tuple[Callable[[], Array], Callable[[], Array]]:
        return slope(self.body, self._gradient_derivative_terms(self._trial)), self._parameter_gradient(
            self._gradient_derivative_terms(self._now)
        )

    def _gradient_derivative_terms(self, state: Motion) -> Terms:
        weight_terms = [
            term for observable in self.observables if observable.symbolic for term in observable.weight_change(state)
        ]
        return self.lagrangian(state, self.change) + self._along_blocks(self.lagrangian(state)) + weight_terms

    def _parameter_change(self, parts: Terms) -> Callable[[], float]:
        """Derivative along the blocks' directions of θ."""
        integrals = [term.integral for term in self._along_blocks(parts)]
        return lambda: sum(float(ngs.Integrate(part, self.body.mesh)) for part in integrals)

    def sensitivity(self) -> sp.csr_array:
        """∂R/∂θ (ndof, θ)."""
        return sp.csr_array(sp.hstack([columns() for columns in self._columns]))

    @cached_property
    def _columns(self) -> list[Callable[[], sp.csr_array]]:
        parts = self._work(self._now, self._test)
        return [block.jacobian(self.body.fes, parts) for block in self.blocks.values()]

    def _along_blocks(self, parts: Terms) -> Terms:
        return [
            term
            for b in self.blocks.values()
            if not isinstance(b, NodePositions)
            for term in b.directional_derivative(parts)
        ]

    def _parameter_gradient(self, parts: Terms) -> Callable[[], Array]:
        slopes = [block.gradient(parts, self.body.mesh) for block in self.blocks.values()]
        return lambda: np.concatenate([slope() for slope in slopes])

    # Observables that are linear maps, or no integrals, are left out of L.

    def observation_gradient(self, w: Array) -> Array:
        """State gradient of w · d for observables that are linear maps or no integrals (ndof,)."""
        b = np.zeros(self.body.fes.ndof)
        for observable, where in zip(self.observables, self.slices, strict=True):
            if observable.matrix is not None or not observable.symbolic:
                b += observable.gradient(w[where])
        return b
