"""Start values of an inversion from given maps, and the comparison of several starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from ngbrain import parallel
from ngbrain.errors import InputError
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.inverse.data.direct_inversion import uniform_modulus
from ngbrain.inverse.objective.parameters import ParameterFields
from ngbrain.inverse.objective.regularisation import smooth
from ngbrain.inverse.optimise.result import OptimisationResult
from ngbrain.inverse.problem.field_values import field_observations, fit_field
from ngbrain.inverse.problem.properties import as_polar
from ngbrain.inverse.problem.wave_problem import ElastographyProblem
from ngbrain.io.waves import WaveData
from ngbrain.look import BriefText

Array = np.ndarray
LOWER = 1e-6
"""Relative reduction of J by which another start has to be better to be chosen."""


@dataclass(repr=False)
class SelectedStart(BriefText):
    """The chosen start.

    Parameters
    ----------
    best : OptimisationResult
        Its result.
    chosen : str
        Its name.
    uniform : OptimisationResult, optional
        The best result from uniform fields.
    notes : list of str
        Notes on the choice.
    """

    best: OptimisationResult
    chosen: str = "both"
    uniform: OptimisationResult | None = None
    notes: list[str] = field(default_factory=list)


def run_starts(
    problem: ElastographyProblem,
    runs: Mapping[str, tuple[Callable[..., Any], tuple[Any, ...]]],
    executor: parallel.AnyExecutor = None,
    callback: parallel.Callback | None = None,
    memory: float = 0.0,
) -> list[Any]:
    """Run an inversion from several starts.

    One start alone, or all without an executor, run in this process one after the other. An executor runs each on one thread,
    with a problem that is built anew from the same data and elements and gives the same bits. Its linear solves are counted
    in this problem.

    Parameters
    ----------
    problem : ElastographyProblem
        The inverse problem.
    runs : mapping of str to tuple
        Name → (function, arguments). A function is called with the problem before the arguments, and with `callback`.
    executor : int or executor, optional
        As `parallel.run` takes it.
    callback : callable, optional
        Is called with each `Iteration`.
    memory : float
        Memory (bytes) of each run, as `parallel.Task` takes it.

    Returns
    -------
    list
        Their results.
    """
    callback = callback or (lambda *_: None)
    if executor in (None, 1) or len(runs) < 2:
        return [function(problem, *args, callback=callback) for function, args in runs.values()]
    tasks = [parallel.Task(name, _run, (problem, *run), memory=memory) for name, run in runs.items()]
    found = parallel.run(tasks, executor, callback=callback).values()
    own = problem.model.solves
    for _, spent in found:
        for each in fields(Solves) if spent is not own else ():
            setattr(own, each.name, getattr(own, each.name) + getattr(spent, each.name))
    return [end for end, _ in found]


def _run(
    problem: ElastographyProblem, function: Callable[..., Any], args: tuple[Any, ...], *, callback: parallel.Callback
) -> tuple[Any, Solves]:
    return function(problem, *args, callback=callback), problem.model.solves


def check_levels(levels: Sequence[float]) -> tuple[float, ...]:
    """Return levels of uniform fields, as multiples of the modulus that the waves suggest, without doubles.

    Raises `InputError` unless all are positive and finite.
    """
    if not all(0 < each < np.inf for each in levels):
        raise InputError("levels", list(levels), "positive multiples of the modulus that the waves suggest")
    return tuple(dict.fromkeys(float(each) for each in levels))


def check_iterations(max_iterations: int) -> None:
    """Raise `InputError` unless there is at least one iteration."""
    if max_iterations < 1:
        raise InputError("max_iterations", max_iterations, "at least 1")


def assumed_start_notes(data: WaveData) -> list[str]:
    """Return a note where the start modulus is an assumption, not an estimate from the waves."""
    note = uniform_modulus(data).note
    return [note] if note else []


def select_start(both: OptimisationResult, ends: Mapping[float, OptimisationResult | None]) -> SelectedStart:
    """Choose between the result from measured waves and those from uniform fields by their objective J.

    Parameters
    ----------
    both : OptimisationResult
        Result from measured waves.
    ends : mapping of float to OptimisationResult or None
        MisfitLevel of uniform fields → result; None where no step lowered J.

    Returns
    -------
    SelectedStart
        The result with the lowest J.
    """
    kept = SelectedStart(both)
    arrived = {level: end for level, end in ends.items() if end is not None}
    if ends and not arrived:
        kept.notes.append("from uniform fields no step lowered the objective")
    if arrived:
        kept.uniform = min(arrived.values(), key=lambda end: end.objective)
        if len(ends) > 1:
            values = ", ".join(f"{end.objective:.5g} from {level:g}" for level, end in arrived.items())
            words = f"uniform fields ended at an objective of {values} times the suggested modulus: the least is shown"
            kept.notes.append(words)
        if kept.uniform.objective < both.objective * (1 - LOWER):
            kept.best, kept.chosen = kept.uniform, "uniform"
            kept.notes.append("uniform fields led to a lower objective than measured waves did")
    return kept


def unknowns_from_maps(problem: ElastographyProblem, unknowns: ParameterFields, maps: Mapping[str, Array]) -> Array:
    """Return x of fields that fit maps and are smooth where these are NaN.

    Parameters
    ----------
    problem : ElastographyProblem
        The inverse problem.
    unknowns : ParameterFields
        Its unknowns.
    maps : mapping of str to numpy.ndarray
        Property → (n,) at the points of the data.

    Returns
    -------
    numpy.ndarray
        (unknowns,)

    Raises
    ------
    InputError
        A property of the material is missing, of another shape, NaN everywhere, or out of its bounds.
    """
    n = len(problem.data.points)
    for name, values in maps.items():
        if np.shape(values) != (n,) or np.iscomplexobj(values):
            raise InputError(f"start {name}", f"of shape {np.shape(values)}", f"real values at {n} points")
    polar = any(quantity.name == "magnitude" for quantity in problem.properties)
    given, variables = as_polar(maps) if polar and "storage" in maps else dict(maps), dict[str, Array]()
    for quantity in problem.properties:
        if quantity.name not in given:
            wanted = ", ".join(each.name for each in problem.properties)
            raise InputError("start", f"of {', '.join(maps) or 'nothing'}", f"maps of {wanted}")
        values = np.asarray(given[quantity.name], float)
        known = np.isfinite(values) & problem.inside
        if not known.any() or not quantity.contains(values[known]):
            low = values[known].min() if known.any() else "known nowhere"
            raise InputError(f"start {quantity.name}", low, f"values above {quantity.lower:g} at points that count")
        variables[quantity.name] = np.full(n, np.nan)
        variables[quantity.name][known] = quantity.transform.inverse(values[known])
    x = unknowns.start.copy()
    for part, _, at, values in field_observations(problem, variables):
        block = unknowns.blocks[part.name]
        x[block] = fit_field(at, values, smooth(problem.space, unknowns.start[block]), x[block])
    return x
