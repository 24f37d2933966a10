"""The interface of all observables: of any problem, and of one."""

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
    """An observable of one problem, at the state where it stands.

    Attributes
    ----------
    size : int
        How many numbers it is.
    matrix : csr_array (size, n), optional
        Values as matrix @ x; None where they are not linear in the unknowns x.
    motions : array (size, n), optional
        Motions of the unknowns for which the values are the work of forces; None of what is no force.
    symbolic : bool
        Whether `functional` gives integrals.
    twice : bool
        Whether these give second derivatives too, with what `bent` adds.
    shaped : bool
        Whether they give derivatives by node positions.
    """

    size: int
    symbolic = True
    twice = True
    shaped = True
    matrix: sp.csr_array | None = None
    motions: Array | None = None

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    @abstractmethod
    def value(self) -> Array:
        """Its numbers (size,)."""

    @abstractmethod
    def gradient(self, weights: Array) -> Array:
        """How weights · value changes with the unknowns (n,)."""

    def weigh(self, weights: Array) -> None:  # noqa: B027  (what has no integrals weighs none)
        """Set the weights of `functional`."""

    def functional(self, state: Motion, *along: Motion) -> Terms:
        """Integrals whose sum is weights · value at a state, or for motions its derivative along them, to be differentiated on.

        Empty where there is a matrix. Raises `InputError` where there are none, as of a percentile.
        """
        raise InputError(type(self).__name__, "asked for second derivatives", "an observable that is an integral")

    def aim(self, change: Array, along: Along) -> None:  # noqa: B027  (most have no such weights)
        """Take the way of second derivatives where weights of integrals depend on the state; after `weigh`.

        Parameters
        ----------
        change : array (n,)
            Of the unknowns.
        along : callable
            From integrals to what gives their change with parameters.
        """

    def weight_change(self, state: Motion, *along: Motion) -> Terms:
        """As `functional`, with the change of the weights along the direction of `aim`; empty where they are constant."""
        return []


class SymbolicObservable(ProblemObservable):
    """An observable with a `functional`, whose gradient follows from that."""

    def gradient(self, weights: Array) -> Array:
        """By symbolic differentiation."""
        self.weigh(weights)
        return self._slope()

    @cached_property
    def _slope(self) -> Callable[[], Array]:
        return slope(self.problem, self.functional(self.problem.fes.TrialFunction()))


class Observable(ABC):
    """Some numbers of the state of any problem.

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
        """This observable of one problem."""

    def value(self, problem: Problem, state: State | None = None) -> Array:
        """Its numbers.

        Parameters
        ----------
        problem : Problem
        state : State, optional
            The problem is put there; None: where it stands.

        Returns
        -------
        array (size,)
        """
        if state is not None:
            problem.set_state(state)
        return self.on(problem).value()

    def gradient(self, problem: Problem, state: State | None = None, weights: Sequence[float] | Array = ()) -> Array:
        """How it changes with the unknowns, at fixed parameters and histories.

        Parameters
        ----------
        problem : Problem
        state : State, optional
            The problem is put there; None: where it stands.
        weights : sequence, optional
            Of its numbers, all 1 by default.

        Returns
        -------
        array (n,)
            The derivative of weights · value by each unknown of the problem's space.
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
        """None are needed."""
        return []
