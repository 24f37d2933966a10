"""Interfaces of observables: `Observable` of any problem, `ProblemObservable` of one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp

from ngbrain.errors import InputError
from ngbrain.forward.common.state import State
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import Motion, Terms, slope

Array = np.ndarray
Along: TypeAlias = Callable[[Terms], Callable[[], float]]


class ProblemObservable(ABC):
    """An observable of one problem, at its current state.

    Attributes
    ----------
    size : int
        Number of components.
    matrix : csr_array (size, n), optional
        Values as matrix @ x; None where they are not linear in the unknowns x.
    motions : array (size, n), optional
        Virtual motions of the unknowns on which the forces do the work that is the value; None where it is no force.
    symbolic : bool
        Whether `functional` gives integrals.
    twice : bool
        Whether second derivatives follow from `functional` and `weight_change`.
    shaped : bool
        Whether derivatives with respect to node positions follow from `functional`.
    """

    size: int
    symbolic = True
    has_second_derivative = True
    has_shape_derivative = True
    matrix: sp.csr_array | None = None
    motions: Array | None = None

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    @abstractmethod
    def value(self) -> Array:
        """The value (size,)."""

    @abstractmethod
    def gradient(self, weights: Array) -> Array:
        """Gradient of weights · value with respect to the unknowns (n,)."""

    def set_weights(self, weights: Array) -> None:  # noqa: B027  (an observable without integrals has no weights)
        """Set the weights of `functional`."""

    def functional(self, state: Motion, *along: Motion) -> Terms:
        """Integrals whose sum is weights · value at a state, or its derivative along motions; they can be differentiated further.

        Empty where `matrix` is set. Raises `InputError` for an observable without integrals, such as a percentile.
        """
        raise InputError(type(self).__name__, "asked for second derivatives", "an observable that is an integral")

    def set_direction(self, change: Array, along: Along) -> None:  # noqa: B027  (most have no such weights)
        """Set the direction of second derivatives, for weights of integrals that depend on the state; call `set_weights`
        before.

        Parameters
        ----------
        change : array (n,)
            Change of the unknowns.
        along : callable
            From integrals to a callable that gives their change with the parameters.
        """

    def weight_change(self, state: Motion, *along: Motion) -> Terms:
        """As `functional`, with the weights' derivative along the direction of `set_direction`; empty where they are
        constant."""
        return []


class SymbolicObservable(ProblemObservable):
    """An observable whose gradient follows from its `functional`."""

    def gradient(self, weights: Array) -> Array:
        """By symbolic differentiation."""
        self.set_weights(weights)
        return self._slope()

    @cached_property
    def _slope(self) -> Callable[[], Array]:
        return slope(self.problem, self.functional(self.problem.fes.TrialFunction()))


class Observable(ABC):
    """A quantity of the state of any problem, with one or more components.

    Attributes
    ----------
    name, unit : str
        Name for reports, and SI unit.
    """

    unit: str

    @property
    @abstractmethod
    def name(self) -> str:
        """Name for reports."""

    @abstractmethod
    def on(self, problem: Problem) -> ProblemObservable:
        """The observable of one problem."""

    def value(self, problem: Problem, state: State | None = None) -> Array:
        """The value.

        Parameters
        ----------
        problem : Problem
        state : State, optional
            State to set first; None: the current one.

        Returns
        -------
        array (size,)
        """
        if state is not None:
            problem.set_state(state)
        return self.on(problem).value()

    def gradient(self, problem: Problem, state: State | None = None, weights: Sequence[float] | Array = ()) -> Array:
        """Gradient with respect to the unknowns, at fixed parameters and internal variables.

        Parameters
        ----------
        problem : Problem
        state : State, optional
            State to set first; None: the current one.
        weights : sequence, optional
            Weights of the components, all 1 by default.

        Returns
        -------
        array (n,)
            Derivative of weights · value with respect to each unknown of the problem's space.
        """
        if state is not None:
            problem.set_state(state)
        observed = self.on(problem)
        return observed.gradient(np.asarray(weights, float) if len(weights) else np.ones(observed.size))


class LinearObservable(ProblemObservable):
    """Linear observable, B x.

    Parameters
    ----------
    problem : Problem
    matrix : csr_array (size, n)
        B.
    """

    matrix: sp.csr_array

    def __init__(self, problem: Problem, matrix: sp.csr_array) -> None:
        super().__init__(problem)
        self.matrix, self.size = matrix, matrix.shape[0]

    def value(self) -> Array:
        """B x."""
        return np.asarray(self.matrix @ self.problem.x[: self.matrix.shape[1]])

    def gradient(self, weights: Array) -> Array:
        """Bᵀ w."""
        return np.asarray(self.matrix.T @ weights)

    def functional(self, state: Motion, *along: Motion) -> Terms:
        """Empty: the matrix is enough."""
        return []
