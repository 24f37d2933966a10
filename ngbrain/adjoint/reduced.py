"""The objective of an inversion as a function of its unknowns alone: value, gradient and Gauss-Newton products.

    J(x) = Φ(d(θ(x))) + ½ Σ_b α_b (x_b - x̄_b)·R_b (x_b - x̄_b)

d are a model's data, Φ a misfit, θ(x) a change of variables, R_b regularisers of blocks of x. The gradient takes one
adjoint solve for each load whatever the number of unknowns; a Gauss-Newton product two, with the factor of the forward solve;
one with the whole Hessian five.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp

from ngbrain.errors import InputError, check_shape

Array = np.ndarray


class LinearisedState(Protocol):
    """A model linearised at one θ: its data and the products of their derivatives.

    `hvp(w, direction)`, (Re Σ w̄ · data)'' δθ, is optional; `Point.hessian` needs it.
    """

    data: Array

    def jvp(self, direction: Array) -> Array:
        """Jacobian-vector product J δθ."""

    def vjp(self, w: Array) -> Array:
        """Vector-Jacobian product Re(Jᵀ w̄), cheap for many w."""

    def gradient(self, w: Array) -> Array:
        """Vector-Jacobian product Re(Jᵀ w̄), cheap for one w."""

    # optional: `hvp(w, direction)`, (Re Σ w̄ · data)'' δθ, for `Point.hessian`


class Model(Protocol):
    """Forward model: from a parameter vector θ to data."""

    def evaluate(self, theta: Array) -> Any:
        """Solve at θ: the `LinearisedState` there."""


class Unknowns(Protocol):
    """Parametrisation: from the unknowns x of an inversion to the model's parameters θ."""

    @property
    def start(self) -> Array:
        """Initial guess of x."""

    @property
    def blocks(self) -> Mapping[str, slice]:
        """Name → range in x."""

    def theta(self, x: Array) -> Array:
        """θ(x)."""

    def jacobian(self, x: Array) -> sp.csr_array:
        """∂θ/∂x."""

    def curvature_product(self, x: Array, slope: Array, direction: Array) -> Array:
        """Second-order term of the parametrisation, Σ_i slope_i (∂²θ_i/∂x²) δx.

        Parameters
        ----------
        x : array (n,)
            Unknowns.
        slope : array
            Gradient with respect to θ.
        direction : array (n,)
            Direction δx.

        Returns
        -------
        array (n,)
        """


class Misfit(Protocol):
    """Misfit Φ of data to measurements, weighted by their noise."""

    def value(self, data: Array) -> float:
        """Φ(d)."""

    def gradient(self, data: Array) -> Array:
        """w with dΦ = Re Σ w̄ · δdata."""

    def gauss_newton_product(self, data: Array, change: Array) -> Array:
        """Product of the (positive semi-definite) Gauss-Newton Hessian of Φ with a change of the data.

        Parameters
        ----------
        data, change : array
            Data and their change.

        Returns
        -------
        array
            Of the shape of the data.
        """

    def hvp(self, data: Array, change: Array) -> Array:
        """Product of the full Hessian of Φ with a change of the data.

        Parameters
        ----------
        data, change : array
            Data and their change.

        Returns
        -------
        array
            Of the shape of the data.
        """


class Regulariser(Protocol):
    """Regulariser R of a block of unknowns."""

    def matrix(self, block: Array) -> sp.csr_array:
        """R at a block's values: positive semi-definite; the gradient of the energy is R (x - x̄)."""

    def value(self, block: Array) -> float:
        """Energy, ½ (x - x̄)·R (x - x̄) where R is constant."""

    def gradient(self, block: Array) -> Array:
        """Gradient of the energy."""

    def hvp(self, block: Array, direction: Array) -> Array:
        """Hessian-vector product of the energy; R times the direction where R is constant.

        Parameters
        ----------
        block, direction : array
            Values of the block and a direction.

        Returns
        -------
        array
            Of the shape of the block.
        """


class Reduced:
    """Reduced objective J(x) of an inversion: misfit plus weighted regularisers, with the forward problem eliminated.

    The linearised state of a model is valid until the model is evaluated at another θ, and so is a `Point`.

    Parameters
    ----------
    model : Model
        Forward model.
    misfit : Misfit
        Misfit of its data.
    unknowns : Unknowns
        Parametrisation θ(x).
    regularisers : dict
        Block → `Regulariser`; blocks without one are determined by the data alone.
    weights : dict
        Block → regularisation weight α; may change between calls, as a search lowers the weight.

    Raises
    ------
    InputError
        For a regulariser of an unknown block, or one without a weight.
    """

    def __init__(
        self,
        model: Model,
        misfit: Misfit,
        unknowns: Unknowns,
        regularisers: Mapping[str, Regulariser],
        weights: Mapping[str, float],
    ) -> None:
        for name in regularisers:
            if name not in unknowns.blocks:
                raise InputError(f"regularisers.{name}", "of nothing", f"one of {', '.join(unknowns.blocks)}")
            if name not in weights:
                raise InputError(f"weights.{name}", "missing", "a weight for each regulariser")
        self.model, self.misfit, self.unknowns = model, misfit, unknowns
        self.regularisers, self.weights = dict(regularisers), dict(weights)

    def evaluate(self, x: Array) -> Point:
        """Evaluate at x: one forward solve for each load."""
        check_shape("x", np.shape(x), self.unknowns.start.shape)
        return Point(self, np.array(x, float), self.model.evaluate(self.unknowns.theta(x)))

    def value(self, x: Array) -> float:
        """Objective J(x)."""
        return self.evaluate(x).value

    def regular(self, x: Array) -> float:
        """Regularisation energy Σ α R."""
        return sum(self.weights[b] * r.value(x[self.unknowns.blocks[b]]) for b, r in self.regularisers.items())

    def regular_gradient(self, x: Array) -> Array:
        """Gradient of the regularisation energy."""
        slope = np.zeros(len(x))
        for name, regulariser in self.regularisers.items():
            block = self.unknowns.blocks[name]
            slope[block] += self.weights[name] * regulariser.gradient(x[block])
        return slope

    def regular_matrix(self, x: Array) -> sp.csr_array:
        """Σ α R as one block-diagonal matrix."""
        parts = []
        for name, block in self.unknowns.blocks.items():
            size = block.stop - block.start
            regulariser = self.regularisers.get(name)
            parts.append(
                sp.csr_array((size, size)) if regulariser is None else self.weights[name] * regulariser.matrix(x[block])
            )
        return sp.csr_array(sp.block_diag(parts))


class Point:
    """Reduced objective at one x, with its derivatives.

    Parameters
    ----------
    reduced : Reduced
        The objective.
    x : array (n,)
        Unknowns.
    state : LinearisedState
        The model linearised at θ(x).

    Attributes
    ----------
    misfit, regular : float
        The two parts of J.
    jacobian : csr_array
        ∂θ/∂x.
    """

    def __init__(self, reduced: Reduced, x: Array, state: LinearisedState) -> None:
        self.reduced, self.x, self.state = reduced, x, state
        self.misfit = reduced.misfit.value(state.data)
        self.regular = reduced.regular(x)
        self.jacobian = reduced.unknowns.jacobian(x)

    @property
    def value(self) -> float:
        """Objective J."""
        return self.misfit + self.regular

    @cached_property
    def regular_matrix(self) -> sp.csr_array:
        """Σ α R at x, with the regularisation weights at the first call."""
        return self.reduced.regular_matrix(self.x)

    def gradient(self) -> Array:
        """Gradient ∇J: one adjoint solve for each load."""
        slope = self.state.gradient(self.reduced.misfit.gradient(self.state.data))
        return self.jacobian.T @ slope + self.reduced.regular_gradient(self.x)

    def product(self, direction: Array) -> Array:
        """Product of the Gauss-Newton matrix JᵀWJ + Σ α R with a direction: two solves for each load."""
        change = self.state.jvp(self.jacobian @ direction)
        back = self.state.vjp(self.reduced.misfit.gauss_newton_product(self.state.data, change))
        return self.jacobian.T @ back + self.regular_matrix @ direction

    def hessian(self, direction: Array) -> Array:
        """Product of the full Hessian ∇²J with a direction: curvature of model, misfit, parametrisation and regularisers.

        Unlike the Gauss-Newton matrix it may be indefinite. Raises `InputError` for a model without second derivatives.

        Examples
        --------
        >>> from ngbrain.inverse.phantoms.benchmark import Phantom
        >>> inversion = Phantom.from_name("CV-G", 5).simulate_measurements(0.02).inversion()
        >>> point, rng = inversion.reduced.evaluate(inversion.start), np.random.default_rng(0)
        >>> a, b = rng.normal(size=(2, len(inversion.start)))
        >>> bool(abs(a @ point.hessian(b) - b @ point.hessian(a)) < 1e-9 * abs(a @ point.hessian(b)))
        True
        """
        if not hasattr(self.state, "hvp"):
            found = type(self.reduced.model).__name__
            raise InputError("model", found, "one whose states have second derivatives, `hvp(w, direction)`")
        misfit, unknowns, data = self.reduced.misfit, self.reduced.unknowns, self.state.data
        w, moved = misfit.gradient(data), self.jacobian @ direction
        curved = self.state.vjp(misfit.hvp(data, self.state.jvp(moved))) + self.state.hvp(w, moved)
        bent = unknowns.curvature_product(self.x, self.state.gradient(w), direction)
        for name, regulariser in self.reduced.regularisers.items():
            block = unknowns.blocks[name]
            bent[block] += self.reduced.weights[name] * regulariser.hvp(self.x[block], direction[block])
        return np.asarray(self.jacobian.T @ curved + bent)
