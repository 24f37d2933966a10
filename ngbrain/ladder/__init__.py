"""Model selection: from the cheapest model up, until the estimated model error is within the requested tolerances.

    result = ngbrain.simulate(ngbrain.Scene.from_toml("palpation.toml"))
    result["answers"], result["model"], result["left_out"]

- the search: `solve` a scene, or its parts: `search_models` (a `SearchResult` of `Rung`s), `ModelHierarchy` with a
  `SolutionCache`, `run_search`
- what may be enriched: `axes_of` a scene, its `cheapest` and `richest` model
- a `Question` asks for an observable of your own, in addition to the scene's quantities; a result says of each what
  `RequestedQuantity` holds
- `relative_difference` of answers

Modules
-------
- `axes`, `levels`: The axes along which a model can be enriched, and their levels.
- `model_search`: The search itself; `next_step`: which axes it enriches next; `search_result`, `summary`: its result.
- `estimates`: Estimates of the change by one step along an axis; `solutions`: a cache of solutions.
- `models`: The models of a scene: geometry, materials, motions, contacts, waves.
- `quantities`: The requested quantities of a solved body.
- `adaptivity`: Refinement of the elements that matter to a quantity.
- `singular_edges`: Edges at which forces diverge.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ngsolve import ngsglobals

from ngbrain import parallel
from ngbrain.errors import InputError
from ngbrain.io import versions, write_json
from ngbrain.ladder.axes import axes_of, cheapest, richest
from ngbrain.ladder.estimates import relative_difference
from ngbrain.ladder.levels import Model
from ngbrain.ladder.model_search import assess, search_models
from ngbrain.ladder.models.hierarchy import ModelHierarchy
from ngbrain.ladder.quantities import BODY, Asked, Question, deformed_state, write_state
from ngbrain.ladder.search_result import Rung, SearchResult
from ngbrain.ladder.solutions import SolutionCache
from ngbrain.ladder.summary import RequestedQuantity, summarise
from ngbrain.lazy import lazy_names
from ngbrain.progress import log_progress, reporting
from ngbrain.result import Status
from ngbrain.scene import Scene
from ngbrain.scene.result import SceneResult
from ngbrain.scene.tissues import DENSITY
from ngbrain.threads import threads as using

if TYPE_CHECKING:
    from ngbrain.ladder import (
        adaptivity,
        axes,
        estimates,
        levels,
        model_search,
        models,
        next_step,
        quantities,
        search_result,
        singular_edges,
        solutions,
        summary,
    )
else:
    __getattr__, __dir__ = lazy_names(__name__)

__all__ = [
    "ModelHierarchy",
    "Question",
    "RequestedQuantity",
    "Rung",
    "SearchResult",
    "SolutionCache",
    "adaptivity",
    "axes",
    "axes_of",
    "cheapest",
    "estimates",
    "levels",
    "model_search",
    "models",
    "next_step",
    "quantities",
    "relative_difference",
    "richest",
    "run_search",
    "search_models",
    "search_result",
    "singular_edges",
    "solutions",
    "solve",
    "summary",
]


@reporting()
def solve(
    scene: Scene,
    folder: str | Path | None = None,
    model: Model | None = None,
    richest: Model | None = None,
    threads: int = 1,
    callback: Callable[[Rung], None] = log_progress,
    executor: parallel.AnyExecutor = None,
    questions: Sequence[Question] = (),
    checkpoint: Callable[[dict[str, Any]], None] | None = None,
) -> SceneResult:
    """Answer a scene's quantities by the cheapest model whose estimated error is within the tolerances.

    Parameters
    ----------
    scene : Scene
        The loads, and the requested quantities with their tolerances.
    folder : str or Path, optional
        Where `result.json` goes, and `body.vtkhdf` with displacement (m) and largest principal strain of the answer's model at the
        end, where it is an elastic body in space; None writes nothing.
    model : mapping of str, optional
        Axis → level of a prescribed model, without a search; other axes are at their cheapest level.
    richest : mapping of str, optional
        Axis → last level of the search; by default all levels.
    threads : int
        For assembly.
    callback : callable
        Called after every model with its `Rung`.
    executor : int or concurrent.futures.Executor, optional
        Solves the models that estimates need side by side (`parallel.run`); by default this process. Elastic bodies at rest are
        always solved here: estimates continue from their states.
    questions : sequence of Question
        Observables in addition to the scene's quantities.
    checkpoint : callable, optional
        Called with the present result after every model. `result.json` is written then too, so that an interrupted search leaves
        it.

    Returns
    -------
    SceneResult
        Reads as `result.json`: `answers` with value, unit (SI), tolerance and estimated error (the relative change that all
        remaining steps would make together); `model`; `left_out`: what the model leaves out and the estimated effect; `cautions`:
        why the error may be larger than estimated; `models`: all models; `warnings`: assumptions on the tissues and notes on
        published constants.

    Raises
    ------
    InputError
        A scene that is not meaningful.
    SolverError
        The cheapest model has no solution.

    Examples
    --------
    >>> from ngbrain.scene import DisplacementBC, Geometry, Quantity, Tissue
    >>> scene = Scene(
    ...     geometry=Geometry(kind="block", size=(0.06, 0.06, 0.04)),
    ...     tissues=[Tissue(mu=1000.0, poissons_ratio=0.3)],
    ...     displacement_bcs=[DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=(0, 0, -1e-4))],
    ...     quantities=[Quantity(name="force", boundary="top", tolerance=0.5)],
    ... )
    >>> result = solve(scene, richest={"mesh": "0"})
    >>> (force,) = result["answers"]
    >>> force["quantity"], result["model"]["strain"], force["error_estimate"] < 0.5
    ('force on top, end', 'linear', True)
    """
    asked: list[Asked] = [*scene.quantities, *questions]
    return run_search(
        scene,
        folder,
        threads,
        lambda watch: (
            search_models(scene, richest, callback, executor=executor, questions=questions, watch=watch)
            if model is None
            else assess(scene, model, executor, questions)
        ),
        [RequestedQuantity.from_quantity(quantity) for quantity in asked],
        _assumed_density(scene),
        checkpoint,
    )


def _assumed_density(scene: Scene) -> list[str]:
    """A warning for each tissue whose density matters and is not given."""
    if scene.time.frequency is None and scene.gravity is None and "inertia" not in axes_of(scene):
        return []
    said = f"density_kg_m3 is not given: {DENSITY:g} is assumed"
    return [f"tissue#{i} ({s.region}): {said}" for i, s in enumerate(scene.tissues, 1) if s.density is None]


def run_search(
    scene: Scene,
    folder: str | Path | None,
    threads: int,
    find: Callable[[Callable[[SearchResult], Any]], SearchResult],
    questions: Sequence[RequestedQuantity],
    warnings: Sequence[str] = (),
    checkpoint: Callable[[dict[str, Any]], None] | None = None,
) -> SceneResult:
    """Run a search, and write and return its result.

    Parameters
    ----------
    scene : Scene
    folder : str or Path, optional
        Where `result.json` goes.
    threads : int
    find : callable
        Runs the search; its argument is to be called with an unfinished search, whose result is written and given to `checkpoint`.
    questions : sequence of RequestedQuantity
        The requested quantities.
    warnings : sequence of str
        In addition to the scene's.
    checkpoint : callable, optional

    Returns
    -------
    SceneResult
    """
    started = time.perf_counter()
    ngsglobals.msg_level = 0

    def written(found: SearchResult) -> dict[str, Any]:
        result = _result(scene, threads, found, questions, warnings, time.perf_counter() - started)
        if folder is not None:
            Path(folder).mkdir(parents=True, exist_ok=True)
            write_json(Path(folder) / "result.json", result)
        if checkpoint is not None:
            checkpoint(result)
        return result

    with using(threads):
        found = find(written)
    result = written(found)
    if folder is not None and (state := deformed_state(found.states)) is not None:
        with suppress(InputError):  # a mesh that was refined in place has no file
            write_state(Path(folder) / BODY, state)
    return SceneResult(result, status=Status.CONVERGED, warnings=result["warnings"])


def _result(
    scene: Scene,
    threads: int,
    found: SearchResult,
    questions: Sequence[RequestedQuantity],
    warnings: Sequence[str],
    seconds: float,
) -> dict[str, Any]:
    return {
        "verb": "simulate",
        "title": scene.title,
        "versions": versions(),
        "seed": 0,
        "threads": threads,
        "scene": scene.to_dict(),
        "warnings": [*scene.warnings, *warnings],
        **summarise(found, questions),
        "time_s": seconds,
    }
