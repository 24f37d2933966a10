"""Solutions of models, each found once; where others compute, all that several estimates ask for next at the same time."""

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
"""Axes along which bodies are in other places."""
Key = tuple[tuple[str, str], ...]
Result = TypeVar("Result")


class ModelSolver(Protocol):
    """Interface of a solver of models, such as `ModelHierarchy`; `init_arguments` rebuild it in another process."""

    init_arguments: tuple[Any, ...]

    def solve(self, model: Model, near: Mapping[str, BodyState] | None = None) -> Solution:
        """The model's answers, from states near its own if they are known. `SolverError` where it has none."""

    def has_states(self, model: Model) -> bool:
        """Whether its solution has states, which cannot be sent."""


class SolutionCache:
    """Solves each model once, from where the model that has most in common with it came to rest.

    With an executor, models without states are solved by it where estimates ask for several (`at_once`).
    """

    def __init__(self, solver: ModelSolver, executor: parallel.AnyExecutor = None) -> None:
        self.solver, self.kept = solver, dict[Key, Solution]()
        self._executor, self._elsewhere, self._failed = executor, 0.0, dict[Key, SolverError]()

    def __call__(self, model: Model) -> Solution:
        """The model's solution."""
        key = _key(model)
        if key in self._failed:
            raise self._failed[key]
        if key not in self.kept:
            self.kept[key] = self.solver.solve(model, self._near(model))
        return self.kept[key]

    def _near(self, model: Model) -> Mapping[str, BodyState] | None:
        """States of finite strain in the same place; None where no such model was solved, or strains are small.

        Of what slides in the same elements, too: from others it takes a quarter longer than from rest.
        """
        if model.get("strain") != "finite":
            return None
        like = ("strain", *PLACE, *(ELEMENTS if model.get("contact") == "all" else ()))
        same = {axis: model[axis] for axis in like if axis in model}
        others = [
            (dict(key), found.states) for key, found in self.kept.items() if found.states and same.items() <= set(key)
        ]
        return max(others, key=lambda other: len(other[0].items() & model.items()), default=(None, None))[1]

    def clock(self) -> float:
        """Computing time (s), here and of what others solved."""
        return time.process_time() + self._elsewhere

    def run_estimates(self, estimates: Mapping[str, Callable[[Solved], Result]]) -> dict[str, Result]:
        """What functions of solutions return, by name, the same as one after the other.

        With an executor, all are first called with the solutions that are kept. Those that come to an end have their result; what
        the others ask for is solved side by side, until it is what has to be solved here.
        """
        done = dict[str, Result]()
        while self._executor is not None:
            wanted = dict[Key, Model]()
            for name, function in estimates.items():
                if name not in done:
                    try:
                        done[name] = function(self._if_solved)
                    except _NotSolved as unknown:
                        if not self.solver.has_states(unknown.model):
                            wanted[_key(unknown.model)] = unknown.model
            if not wanted:
                break
            self._fetch(wanted)
        return {name: done[name] if name in done else function(self) for name, function in estimates.items()}

    def _if_solved(self, model: Model) -> Solution:
        if (key := _key(model)) not in self.kept and key not in self._failed:
            raise _NotSolved(model)
        return self(model)

    def _fetch(self, models: Mapping[Key, Model]) -> None:
        sent = pickle.dumps(self.solver.init_arguments)
        tasks = [
            parallel.Task(", ".join(map(" ".join, key)), _solve, (type(self.solver), sent, model))
            for key, model in models.items()
        ]
        found = parallel.run(tasks, self._executor, on_error="return")
        for key, solution in zip(models, found.values(), strict=True):
            if isinstance(solution, Solution):
                self.kept[key] = solution
                self._elsewhere += solution.cost_s
            elif isinstance(solution, SolverError) and not isinstance(solution, parallel.TaskLost):
                self._failed[key] = solution
            else:
                raise solution


class _NotSolved(Exception):
    """A model whose solution is not kept."""

    def __init__(self, model: Model) -> None:
        super().__init__()
        self.model = dict(model)


def _key(model: Model) -> Key:
    return tuple(sorted(model.items()))


def _solve(
    kind: Callable[..., ModelSolver], init_arguments: bytes, model: Model, *, callback: parallel.Callback
) -> Solution:
    return _rebuilt(kind, init_arguments).solve(model)


@lru_cache(maxsize=1)
def _rebuilt(kind: Callable[..., ModelSolver], init_arguments: bytes) -> ModelSolver:
    """Made once in each process, with its meshes."""
    ngsglobals.msg_level = 0
    return kind(*pickle.loads(init_arguments))
