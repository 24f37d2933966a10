"""A model or an objective as y = f(x) of one real vector: what all faces of `interop` stand on.

    a `Model`     x = θ,  y = d, its data, real or complex
    a `Reduced`   x,      y = J(x), a number

w weighs y: derivatives of complex y are those of Re Σ w̄ y.
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
    """y = f(x). What is asked for at the x of the last question is not solved for again."""

    def value(self, x: Array) -> Array:
        """y, a copy."""

    def jvp(self, x: Array, direction: Array) -> Array:
        """f'(x) δx, of y's shape."""

    def vjp(self, x: Array, w: Array) -> Array:
        """The gradient of Re Σ w̄ y: one adjoint solve for each load."""

    def hvp(self, x: Array, w: Array, direction: Array) -> Array:
        """(Re Σ w̄ y)'' δx; `InputError` where nobody knows it."""


def function(of: Model | Reduced) -> Function:
    """The function that a model or an objective is."""
    return ObjectiveFunction(of) if isinstance(of, Reduced) else DataFunction(of)


class DataFunction:
    """A model's data. Raises what the model raises: `SolverError` where it has no solution."""

    def __init__(self, model: Model) -> None:
        self._kept = state_cache(model)

    def value(self, x: Array) -> Array:
        """d."""
        with self._kept.evaluate(x) as state:
            return np.array(state.data)

    def jvp(self, x: Array, direction: Array) -> Array:
        """J δθ."""
        with self._kept.evaluate(x) as state:
            return state.jvp(direction)

    def vjp(self, x: Array, w: Array) -> Array:
        """Re(Jᵀ w̄)."""
        with self._kept.evaluate(x) as state:
            return state.gradient(w)

    def hvp(self, x: Array, w: Array, direction: Array) -> Array:
        """(Re Σ w̄ d)'' δθ."""
        with self._kept.evaluate(x) as state:
            if not hasattr(state, "hvp"):
                raise InputError(
                    "model", type(self._kept.model).__name__, "one with second derivatives: `LinearisedState.hvp`"
                )
            return state.hvp(w, direction)


class ObjectiveFunction:
    """J, with the weights that the `Reduced` has at each call. Raises what its model raises, and `SolverError`
    where θ(x) overflows.

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
        """J."""
        with self._at(x) as point:
            return np.array(point.value)

    def jvp(self, x: Array, direction: Array) -> Array:
        """∇J · δx."""
        with self._at(x) as point:
            return np.array(point.gradient() @ direction)

    def vjp(self, x: Array, w: Array | float) -> Array:
        """w ∇J."""
        with self._at(x) as point:
            return w * point.gradient()

    def hvp(self, x: Array, w: Array, direction: Array) -> Array:
        """w ∇²J δx, the whole Hessian; `InputError` for a model without second derivatives."""
        with self._at(x) as point:
            return w * point.hessian(direction)

    def product(self, x: Array, direction: Array) -> Array:
        """The Gauss-Newton matrix times δx: two solves for each load."""
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
        """The State at θ, solved for unless it is the last one."""
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
    """The `StateCache` of a model, the same as long as a function holds it."""
    return _KEPT.setdefault(id(model), StateCache(model))
