"""A model or an objective as a function y = f(x) of one real vector: the common basis of `interop`.

    a `Model`     x = θ,  y = d, its data, real or complex
    a `Reduced`   x,      y = J(x), a number

w are weights of y: derivatives of complex y are those of Re Σ w̄ y.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Protocol
from weakref import WeakValueDictionary

import numpy as np

from ngbrain.adjoint.reduced import LinearisedState, Model, Point, Reduced
from ngbrain.errors import InputError, SolverError

Array = np.ndarray


class Function(Protocol):
    """A function y = f(x); repeated calls at the last x do not solve again."""

    def value(self, x: Array) -> Array:
        """y = f(x), a copy."""

    def jvp(self, x: Array, direction: Array) -> Array:
        """Jacobian-vector product f'(x) δx.

        Parameters
        ----------
        x, direction : array (n,)
            Point and direction δx.

        Returns
        -------
        array
            Of the shape of y.
        """

    def vjp(self, x: Array, w: Array) -> Array:
        """Gradient of Re Σ w̄ y: one adjoint solve for each load.

        Parameters
        ----------
        x : array (n,)
            Point.
        w : array
            Weights, of the shape of y.

        Returns
        -------
        array (n,)
        """

    def hvp(self, x: Array, w: Array, direction: Array) -> Array:
        """Hessian-vector product (Re Σ w̄ y)'' δx.

        Parameters
        ----------
        x : array (n,)
            Point.
        w : array
            Weights, of the shape of y.
        direction : array (n,)
            Direction δx.

        Returns
        -------
        array (n,)

        Raises
        ------
        InputError
            Where the model has no second derivatives.
        """


def function(of: Model | Reduced) -> Function:
    """A model or an objective as a `Function`."""
    return ObjectiveFunction(of) if isinstance(of, Reduced) else DataFunction(of)


class DataFunction:
    """Data of a model. Raises what the model raises: `SolverError` where it has no solution."""

    def __init__(self, model: Model) -> None:
        self._kept = state_cache(model)

    def value(self, x: Array) -> Array:
        """Data d."""
        with self._kept.evaluate(x) as state:
            return np.array(state.data)

    def jvp(self, x: Array, direction: Array) -> Array:
        """J δθ.

        Parameters
        ----------
        x, direction : array (n,)
            θ and the direction δθ.

        Returns
        -------
        array
            Of the shape of the data.
        """
        with self._kept.evaluate(x) as state:
            return state.jvp(direction)

    def vjp(self, x: Array, w: Array) -> Array:
        """Re(Jᵀ w̄).

        Parameters
        ----------
        x : array (n,)
            θ.
        w : array
            Weights, of the shape of the data.

        Returns
        -------
        array (n,)
        """
        with self._kept.evaluate(x) as state:
            return state.gradient(w)

    def hvp(self, x: Array, w: Array, direction: Array) -> Array:
        """(Re Σ w̄ d)'' δθ.

        Parameters
        ----------
        x : array (n,)
            θ.
        w : array
            Weights, of the shape of the data.
        direction : array (n,)
            Direction δθ.

        Returns
        -------
        array (n,)

        Raises
        ------
        InputError
            For a model without second derivatives.
        """
        with self._kept.evaluate(x) as state:
            if not hasattr(state, "hvp"):
                raise InputError(
                    "model", type(self._kept.model).__name__, "one with second derivatives: `LinearisedState.hvp`"
                )
            return state.hvp(w, direction)


class ObjectiveFunction:
    """Reduced objective J, with the regularisation weights that the `Reduced` has at each call.

    Raises what its model raises, and `SolverError` where θ(x) overflows.

    Examples
    --------
    >>> from ngbrain.inverse.phantoms.benchmark import Phantom
    >>> inversion = Phantom.from_name("CV-G", 5).simulate_measurements(0.02).inversion()
    >>> J, x = ObjectiveFunction(inversion.reduced), inversion.start
    >>> float(J.jvp(x, np.ones(len(x))) / (J.vjp(x, 1.0) @ np.ones(len(x))))
    1.0
    """

    def __init__(self, reduced: Reduced) -> None:
        self.reduced, self._kept = reduced, state_cache(reduced.model)
        self._point: Point | None = None
        self._weights: dict[str, float] = {}

    @contextmanager
    def _at(self, x: Array) -> Iterator[Point]:
        with np.errstate(over="ignore"):
            theta = self.reduced.unknowns.theta(x)
        if not np.all(np.isfinite(theta)):
            raise SolverError("θ(x) is not finite: a step too far")
        with self._kept.evaluate(theta) as state:
            known = self._point
            if (
                known is None
                or known.state is not state
                or not np.array_equal(x, known.x)
                or self._weights != self.reduced.weights
            ):
                known = self._point = Point(self.reduced, np.array(x, float), state)
                self._weights = dict(self.reduced.weights)
            yield known

    def value(self, x: Array) -> Array:
        """Objective J."""
        with self._at(x) as point:
            return np.array(point.value)

    def jvp(self, x: Array, direction: Array) -> Array:
        """∇J · δx.

        Parameters
        ----------
        x, direction : array (n,)
            Point and direction δx.

        Returns
        -------
        array ()
        """
        with self._at(x) as point:
            return np.array(point.gradient() @ direction)

    def vjp(self, x: Array, w: Array | float) -> Array:
        """w ∇J.

        Parameters
        ----------
        x : array (n,)
            Point.
        w : float
            Weight.

        Returns
        -------
        array (n,)
        """
        with self._at(x) as point:
            return w * point.gradient()

    def hvp(self, x: Array, w: Array, direction: Array) -> Array:
        """w ∇²J δx, the full Hessian.

        Parameters
        ----------
        x : array (n,)
            Point.
        w : float
            Weight.
        direction : array (n,)
            Direction δx.

        Returns
        -------
        array (n,)

        Raises
        ------
        InputError
            For a model without second derivatives.
        """
        with self._at(x) as point:
            return w * point.hessian(direction)

    def product(self, x: Array, direction: Array) -> Array:
        """Product of the Gauss-Newton matrix with δx: two solves for each load.

        Parameters
        ----------
        x, direction : array (n,)
            Point and direction δx.

        Returns
        -------
        array (n,)
        """
        with self._at(x) as point:
            return point.product(direction)


class StateCache:
    """A model and its last linearised state, with the factorisation in it.

    A state is valid until its model is evaluated at another θ. Hence there is one cache for each model (`state_cache`), a lock,
    as callbacks may come from several threads, and a check of the model's own `theta` (where it has one), which other callers of
    the model change.
    """

    def __init__(self, model: Model) -> None:
        self.model, self._lock = model, Lock()
        self._theta = self._left = np.empty(0)
        self._state: LinearisedState | None = None

    @contextmanager
    def evaluate(self, theta: Array) -> Iterator[LinearisedState]:
        """Linearised state at θ; solved for unless it is the last one."""
        with self._lock:
            known = np.array_equal(theta, self._theta) and np.array_equal(self._now(), self._left)
            if self._state is None or not known:
                self._state = None
                self._state, self._theta = self.model.evaluate(theta), np.array(theta)
                self._left = np.array(self._now())
            yield self._state

    def _now(self) -> Array:
        """θ as the model has it."""
        return getattr(self.model, "theta", np.empty(0))


_KEPT: WeakValueDictionary[int, StateCache] = WeakValueDictionary()


def state_cache(model: Model) -> StateCache:
    """The `StateCache` of a model; the same one as long as a function refers to it."""
    return _KEPT.setdefault(id(model), StateCache(model))
