"""Static equilibria as a model from parameters to data, with first and second derivatives.

Equilibrium R(u; θ) = 0 with u = g on the boundary, data d = B(u, θ):

    J δθ = B_u δu + B_θ δθ ,   K δu = -R_θ δθ - K δg        one solve a load case
    Jᵀ w:  Kᵀ λ = B_uᵀ w ,     -R_θᵀ λ + B_θᵀ w             one solve a load case
    (w·d)'' δθ:                two more solves, `StaticLinearisation.hvp`

R, K, R_θ and all second derivatives are symbolic derivatives of the energies of materials and loads (`virtual_work`). Second
derivatives with respect to node positions are finite differences of first ones (`differences`).

References
----------
Plessix 2006, https://doi.org/10.1111/j.1365-246X.2006.02978.x (adjoint-state method).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import ConvergenceError, InputError, check_shape
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.forward.sensitivity.node_positions import NodePositions
from ngbrain.forward.sensitivity.parameter_blocks import ParameterBlock, PrescribedDisplacement, block_slices
from ngbrain.forward.sensitivity.parameters import Parameter, parameter_block
from ngbrain.forward.sensitivity.static_equilibrium import Equilibrium, LoadCase
from ngbrain.forward.sensitivity.tangent_inverse import TangentInverse
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import WorkIntegral
from ngbrain.solvers.newton import Newton

__all__ = ["LoadCase", "NodePositions", "PrescribedDisplacement", "StaticLinearisation", "StaticModel"]

Array = np.ndarray


class StaticModel:
    """Model from a parameter vector θ to observations of bodies in static equilibrium (real data).

    Each equilibrium is found by continuation from the last one. The same θ may have other equilibria.

    Parameters
    ----------
    cases : sequence of LoadCase
        Bodies under their loads, with observables; they share parameters.
    parameters : dict
        Name → parameter; their values one after the other are θ. A GridFunction (all its degrees of freedom) or `ngs.Parameter`
        of materials or loads, `PrescribedDisplacement(body, boundary)` or `NodePositions(mesh)`.
    newton : Newton, optional
        Settings; by default tight enough for derivatives exact to ten digits.
    steps : int
        Load steps from rest, for the first equilibrium and wherever continuation fails.

    Attributes
    ----------
    blocks : dict of str to slice
        Where each parameter is in θ.
    size : int
        Length of θ.
    solves : Solves
        Counts of solves and factorisations.

    Raises
    ------
    InputError
        For parameters that cannot be used, and for cases without observables.

    Examples
    --------
    >>> import ngsolve as ngs
    >>> from ngbrain.forward.common.material import Material
    >>> from ngbrain.forward.observables import Displacements, Force
    >>> from ngbrain.materials import NeoHooke
    >>> from ngbrain.mesh import block
    >>> cube = block((0.1, 0.1, 0.1), 0.1)
    >>> mu = ngs.GridFunction(ngs.L2(cube, order=0)); mu.Set(1e3)
    >>> body = Problem(cube, {".*": Material(NeoHooke(mu), 5e3)}, {"bottom": 0, "top": (0, 0, -0.01)}, element="P2")
    >>> model = StaticModel([LoadCase(body, [Displacements([[0.05, 0.05, 0.05]]), Force("top")])], {"mu": mu})
    >>> there = model.evaluate(model.theta)
    >>> len(there.data), len(there.gradient(there.data)) == cube.ne
    (6, True)
    """

    def __init__(
        self,
        cases: Sequence[LoadCase],
        parameters: Mapping[str, Parameter],
        newton: Newton | None = None,
        steps: int = 1,
    ) -> None:
        if not cases or not all(case.observations for case in cases):
            raise InputError("cases", "without observables", "one or more bodies, each with one or more observables")
        self.parts = {name: parameter_block(name, of) for name, of in parameters.items()}
        sizes = [part.size for part in self.parts.values()]
        self.blocks, self.size = dict(zip(self.parts, block_slices(sizes), strict=True)), sum(sizes)
        for name, part in self.parts.items():
            for case in cases:
                if not isinstance(part, NodePositions):
                    _check_supports(name, part, case.body)
        self.equilibria = [Equilibrium(case, self.parts, newton, steps) for case in cases]
        self.slices = block_slices([each.size for each in self.equilibria])
        self.observation_slices = block_slices([seen.size for each in self.equilibria for seen in each.observables])
        """Where each observation is in the data."""
        self.solves = Solves()
        self._now: StaticLinearisation | None = None
        self._last: StaticLinearisation | None = None

    @property
    def theta(self) -> Array:
        """Present parameters θ of the bodies."""
        return np.concatenate([part.value for part in self.parts.values()])

    def evaluate(self, theta: Array) -> StaticLinearisation:
        """Equilibria at θ, with their derivatives; raises `ConvergenceError` or `InvertedElementError` where there is none."""
        theta = np.array(theta, float)
        if theta.shape != (self.size,):
            raise InputError("theta", f"of shape {theta.shape}", f"{self.size} numbers")
        if not np.all(np.isfinite(theta)):
            raise ConvergenceError("parameters are not finite; reduce the step")
        last, states = self._last, []
        if last is not None and last is self._now:
            last.hand_over()
        self._now = None

        def put(s: float) -> None:
            self.set_parameters(theta if s == 1 or last is None else last.theta + s * (theta - last.theta))

        for k, each in enumerate(self.equilibria):
            done = each.work.factorisations
            try:
                states.append(each.solve(put, None if last is None else last.states[k]))
            finally:
                self.solves.factorisations += each.work.factorisations - done
        self.solves.count("forward", len(states))
        self._now = self._last = StaticLinearisation(self, theta, states)
        return self._now

    def forget(self) -> None:
        """Start the next equilibrium from rest."""
        self._last = None
        for each in self.equilibria:
            each.inverse = None

    def set_parameters(self, theta: Array) -> None:
        """Set the bodies' parameters to θ."""
        for name, part in self.parts.items():
            part.set_value(theta[self.blocks[name]])

    def restore(self, there: StaticLinearisation) -> None:
        """Restore the parameters and states of an earlier linearisation."""
        if self._now is there:
            return
        changed = self._now is None or not np.array_equal(self._now.theta, there.theta)
        self.set_parameters(there.theta)
        for each, x in zip(self.equilibria, there.states, strict=True):
            each.body.x = each.body.load(x, 1.0)
            if changed:
                each.body.invalidate_tangent()
        there.assemble()
        self._now = there

    def split(self, data: Array) -> list[list[Array]]:
        """Data by load case and observable."""
        return [[data[of][s] for s in each.slices] for of, each in zip(self.slices, self.equilibria, strict=True)]


class StaticLinearisation:
    """Equilibria at one θ: data, and products with first and second derivatives.

    Parameters
    ----------
    model : StaticModel
        The model.
    theta : array (size,)
        Parameters.
    states : list of array
        Equilibrium of each load case, all degrees of freedom.

    Attributes
    ----------
    data : array (m,)
        Data of all load cases, one after the other.
    """

    def __init__(self, model: StaticModel, theta: Array, states: list[Array]) -> None:
        self.model, self.theta, self.states = model, theta, states
        self.data = np.concatenate([each.values() for each in model.equilibria])
        self._inverses: dict[int, TangentInverse] = {}
        self._adjoints: tuple[Array, list[Array]] | None = None

    def jvp(self, direction: Array) -> Array:
        """Jacobian-vector product J δθ (m,)."""
        changes = []
        for change, (by_state, by_theta) in zip(
            self.state_derivative(direction), self.observation_jacobians, strict=True
        ):
            changes.append(by_state @ change + by_theta @ direction)
        return np.concatenate(changes)

    def state_derivative(self, direction: Array) -> list[Array]:
        """Derivative of each body's state along a direction of θ."""
        return [self._state_derivative(k, direction) for k in self._cases()]

    def vjp(self, w: Array) -> Array:
        """Vector-Jacobian product Jᵀ w (size,), by the matrices that `jvp` uses."""
        total = np.zeros(self.model.size)
        check_shape("w", np.shape(w), self.data.shape)
        for k in self._cases():
            by_state, by_theta = self.observation_jacobians[k]
            part = w[self.model.slices[k]]
            b = by_state.T @ part
            adjoint = self._inverse(k).solve_transpose(b)
            total += by_theta.T @ part - self.sensitivities[k].T @ adjoint
            self._add_prescribed(k, total, lambda k=k, b=b, a=adjoint: b + self._by_state(k, a))  # type: ignore[misc]
        self.model.solves.count("incremental", len(self.states))
        return total

    def gradient(self, w: Array) -> Array:
        """As `vjp`, by one linear form a block: cheaper for a single product."""
        total, adjoints = np.zeros(self.model.size), self._solved(w)
        for k in self._cases():
            each = self.model.equilibria[k]
            self._set(k, w, adjoints[k])
            total += each.parameter_gradient()
            part = w[self.model.slices[k]]
            self._add_prescribed(
                k,
                total,
                lambda each=each, part=part: each.observation_gradient(part) + each.state_gradient(),  # type: ignore[misc]
            )
        return total

    def hvp(self, w: Array, direction: Array) -> Array:
        """Product of the second derivative of w · d with a direction.

        With w the derivative of a misfit, it is what the misfit's Hessian has beside the Gauss-Newton matrix.

        Parameters
        ----------
        w : array (m,)
            Weights of the data.
        direction : array (size,)
            δθ.

        Returns
        -------
        array (size,)
            (w · d)'' δθ.
        """
        total, adjoints = np.zeros(self.model.size), self._solved(w)
        for name, part in self.model.parts.items():
            part.set_direction(direction[self.model.blocks[name]])
        for k in self._cases():
            each = self.model.equilibria[k]
            _put(each.change, self._state_derivative(k, direction))
            self._set(k, w, adjoints[k])
            b, slopes = each.gradient_derivative()
            total += slopes
            adjoint = self._inverse(k).solve_transpose(b)
            self._set(k, None, adjoint)
            total += each.parameter_gradient()
            self._add_prescribed(k, total, lambda each=each, b=b: b + each.state_gradient())  # type: ignore[misc]
        self.model.solves.count("incremental", len(self.states))
        return total

    def influence(self, seed: int = 0) -> dict[str, float]:
        """Relative influence of each parameter on the data, 1 for the largest.

        One adjoint solve with random weights (`seed`). Parameters with 1e-8 or less are not identifiable from the data.
        """
        observed = [part for case in self.model.split(self.data) for part in case]
        sizes = np.concatenate([np.full(len(part), np.abs(part).max() or 1.0) for part in observed])
        slope = self.gradient(np.random.default_rng(seed).normal(size=len(sizes)) / sizes) * self.theta
        found = {name: float(np.linalg.norm(slope[where])) for name, where in self.model.blocks.items()}
        most = max(found.values()) or 1.0
        return {name: size / most for name, size in found.items()}

    @cached_property
    def sensitivities(self) -> Sequence[sp.csr_array]:
        """∂R/∂θ of each body (ndof, size), assembled at first use."""
        return [self.model.equilibria[k].sensitivity() for k in self._cases()]

    @cached_property
    def observation_jacobians(self) -> Sequence[tuple[sp.csr_array, sp.csr_array]]:
        """∂B/∂u and ∂B/∂θ of each body."""
        return [self._rows(k) for k in self._cases()]

    def hand_over(self) -> None:
        """Pass the factorisations to Newton's method, for the next θ."""
        for k, inverses in self._inverses.items():
            self.model.equilibria[k].inverse = inverses.factor or self.model.equilibria[k].inverse

    def assemble(self) -> None:
        """Assemble the tangents at the bodies' states again."""
        for inverses in self._inverses.values():
            inverses.assemble()

    def _cases(self) -> range:
        self.model.restore(self)
        return range(len(self.states))

    def _inverse(self, k: int) -> TangentInverse:
        if k not in self._inverses:
            each = self.model.equilibria[k]
            self._inverses[k] = TangentInverse(each.body, self.model.solves, each.quadratic)
        return self._inverses[k]

    def _state_derivative(self, k: int, direction: Array) -> Array:
        each = self.model.equilibria[k]
        b, driven = -(self.sensitivities[k] @ direction), np.zeros(len(self.states[k]))
        for part, where in self._prescribed(k):
            driven[part.dofs] = direction[where]
        if driven.any():
            _put(each.change, driven)
            b -= each.tangent_product()
        self.model.solves.count("incremental")
        return self._inverse(k).solve(b) + driven

    def _solved(self, w: Array) -> list[Array]:
        """Adjoint states for weights of the data; the last ones are stored."""
        check_shape("w", np.shape(w), self.data.shape)
        if self._adjoints is None or not np.array_equal(self._adjoints[0], w):
            found = []
            for k in self._cases():
                each = self.model.equilibria[k]
                b = each.observation_gradient(w[self.model.slices[k]])
                if not each.linear:
                    self._set(k, w, None)
                    b += each.state_gradient()
                found.append(self._inverse(k).solve_transpose(b))
            self.model.solves.count("adjoint", len(found))
            self._adjoints = np.array(w), found
        return self._adjoints[1]

    def _rows(self, k: int) -> tuple[sp.csr_array, sp.csr_array]:
        each = self.model.equilibria[k]
        by_state, by_theta = [], []
        for seen, where in zip(each.observables, each.slices, strict=True):
            if seen.matrix is not None or not seen.symbolic:
                rows = [seen.gradient(unit) for unit in np.eye(seen.size)] if seen.matrix is None else []
                by_state.append(sp.csr_array(np.array(rows)) if seen.matrix is None else seen.matrix)
                by_theta.append(sp.csr_array((seen.size, self.model.size)))
                continue
            for i in range(where.start, where.stop):
                _put(each.adjoint, 0.0)
                each.set_weights(np.eye(each.size)[i])
                by_state.append(sp.csr_array(each.state_gradient()[None]))
                by_theta.append(sp.csr_array(each.parameter_gradient()[None]))
        return sp.csr_array(sp.vstack(by_state)), sp.csr_array(sp.vstack(by_theta))

    def _by_state(self, k: int, adjoint: Array) -> Array:
        """-Kᵀ λ."""
        self._set(k, None, adjoint)
        return self.model.equilibria[k].state_gradient()

    def _set(self, k: int, w: Array | None, adjoint: Array | None) -> None:
        each = self.model.equilibria[k]
        each.set_weights(np.zeros(each.size) if w is None else w[self.model.slices[k]])
        _put(each.adjoint, 0.0 if adjoint is None else adjoint)

    def _prescribed(self, k: int) -> list[tuple[PrescribedDisplacement, slice]]:
        body = self.model.equilibria[k].body
        parts = self.model.parts.items()
        return [
            (part, self.model.blocks[name])
            for name, part in parts
            if isinstance(part, PrescribedDisplacement) and part.body is body
        ]

    def _add_prescribed(self, k: int, total: Array, left: Callable[[], Array]) -> None:
        """Add ∂L/∂u at prescribed degrees of freedom to the gradient."""
        if prescribed := self._prescribed(k):
            rest = left()
            for part, where in prescribed:
                total[where] += rest[part.dofs]


def _put(gfu: ngs.GridFunction, values: Array | float) -> None:
    gfu.vec.FV().NumPy()[:] = values


def _check_supports(name: str, part: ParameterBlock, body: Problem) -> None:
    """Supports are interpolated once, so they cannot depend on other parameters."""
    for pattern, components in body.supports.values.items():
        made = [WorkIntegral(ngs.CF(value), ngs.ds) for value in components if value is not None]
        if part.directional_derivative(made):
            wanted = f"PrescribedDisplacement(body, {pattern!r}) as a separate parameter"
            raise InputError(f"parameters.{name}", f"part of the support of {pattern!r}", wanted)
