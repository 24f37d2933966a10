"""A cache of model solutions; with an executor, independent solutions that estimates need are computed side by side."""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, Protocol, TypeVar

from ngsolve import ngsglobals

from ngbrain import parallel
from ngbrain.errors import SolverError
from ngbrain.ladder.axes import ELEMENTS
from ngbrain.ladder.estimates import Solved
from ngbrain.ladder.levels import Model
from ngbrain.ladder.models.hierarchy import Solution
from ngbrain.ladder.quantities import BodyState

PLACE = ("space", "extent")
"""Axes whose levels are bodies of different geometry."""
Key = tuple[tuple[str, str], ...]
Result = TypeVar("Result")


class ModelSolver(Protocol):
    """Interface of a solver of models, such as `ModelHierarchy`.

    Attributes
    ----------
    init_arguments : tuple
        Constructor arguments with which another process rebuilds it.
    """

    init_arguments: tuple[Any, ...]

    def solve(self, model: Model, near: Mapping[str, BodyState] | None = None) -> Solution:
        """Solve a model.

        Parameters
        ----------
        model : mapping of str
            Axis → level.
        near : mapping of BodyState, optional
            States of a similar model, as an initial guess.

        Returns
        -------
        Solution

        Raises
        ------
        SolverError
            There is no solution.
        """

    def has_states(self, model: Model) -> bool:
        """Whether its solution has states, which cannot be sent to another process."""


class SolutionCache:
    """Solves each model once, with the most similar known state as the initial guess.

    Parameters
    ----------
    solver : ModelSolver
    executor : int or concurrent.futures.Executor, optional
        Solves models without states where estimates need several (`run_estimates`).
    """

    def __init__(self, solver: ModelSolver, executor: parallel.AnyExecutor = None) -> None:
        self.solver, self.solutions = solver, dict[Key, Solution]()
        self._executor, self._elsewhere, self._failed = executor, 0.0, dict[Key, SolverError]()

    def __call__(self, model: Model) -> Solution:
        """The solution of a model."""
        key = _key(model)
        if key in self._failed:
            raise self._failed[key]
        if key not in self.solutions:
            self.solutions[key] = self.solver.solve(model, self._similar_states(model))
        return self.solutions[key]

    def _similar_states(self, model: Model) -> Mapping[str, BodyState] | None:
        """States of the most similar finite-strain model in the same place; None without one, or for small strain. With sliding
        contact the elements have to be the same: from others the solution takes a quarter longer than from rest.
        """
        if model.get("strain") != "finite":
            return None
        like = ("strain", *PLACE, *(ELEMENTS if model.get("contact") == "all" else ()))
        same = {axis: model[axis] for axis in like if axis in model}
        others = [
            (dict(key), found.states)
            for key, found in self.solutions.items()
            if found.states and same.items() <= set(key)
        ]
        return max(others, key=lambda other: len(other[0].items() & model.items()), default=(None, None))[1]

    def clock(self) -> float:
        """Computing time (s), including that of other processes."""
        return time.process_time() + self._elsewhere

    def run_estimates(self, estimates: Mapping[str, Callable[[Solved], Result]]) -> dict[str, Result]:
        """Evaluate functions of solutions, with the same results as one after the other.

        With an executor, all are first called with the known solutions. Models that are missing are then solved side by side,
        until only those remain that have to be solved here.
        """
        done = dict[str, Result]()
        while self._executor is not None:
            wanted = dict[Key, Model]()
            for name, function in estimates.items():
                if name not in done:
                    try:
                        done[name] = function(self._known_or_raise)
                    except _NotSolved as unknown:
                        if not self.solver.has_states(unknown.model):
                            wanted[_key(unknown.model)] = unknown.model
            if not wanted:
                break
            self._solve_missing(wanted)
        return {name: done[name] if name in done else function(self) for name, function in estimates.items()}

    def _known_or_raise(self, model: Model) -> Solution:
        if (key := _key(model)) not in self.solutions and key not in self._failed:
            raise _NotSolved(model)
        return self(model)

    def _solve_missing(self, models: Mapping[Key, Model]) -> None:
        sent = pickle.dumps(self.solver.init_arguments)
        tasks = [
            parallel.Task(", ".join(map(" ".join, key)), _solve, (type(self.solver), sent, model))
            for key, model in models.items()
        ]
        found = parallel.run(tasks, self._executor, on_error="return")
        for key, solution in zip(models, found.values(), strict=True):
            if isinstance(solution, Solution):
                self.solutions[key] = solution
                self._elsewhere += solution.cost_s
            elif isinstance(solution, SolverError) and not isinstance(solution, parallel.TaskLost):
                self._failed[key] = solution
            else:
                raise solution


class _NotSolved(Exception):
    """A model without a known solution."""

    def __init__(self, model: Model) -> None:
        super().__init__()
        self.model = dict(model)


def _key(model: Model) -> Key:
    return tuple(sorted(model.items()))


def _solve(
    kind: Callable[..., ModelSolver], init_arguments: bytes, model: Model, *, callback: parallel.Callback
) -> Solution:
    return _rebuild(kind, init_arguments).solve(model)


@lru_cache(maxsize=1)
def _rebuild(kind: Callable[..., ModelSolver], init_arguments: bytes) -> ModelSolver:
    """A solver made once in each process, with its meshes."""
    ngsglobals.msg_level = 0
    return kind(*pickle.loads(init_arguments))
