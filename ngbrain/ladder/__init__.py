"""Model no more than a scene needs: from the cheapest model up, until what is missing is within the tolerances that are asked for.

    result = ngbrain.simulate(ngbrain.Scene.from_toml("palpation.toml"))
    result["answers"], result["model"], result["left_out"]

`Question` asks an observable of one's own beside what the scene asks. `rungs` has the axes as data, `climb` the loop,
`described` what comes of it as data, `estimates` what a step up would change; `bodies`, `waves` and `maps` what a model is.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ngsolve import ngsglobals

from ngbrain import parallel
from ngbrain.io import versions, write_json
from ngbrain.ladder.axes import axes_of
from ngbrain.ladder.levels import Model
from ngbrain.ladder.model_search import Climb, Rung, assess, climb
from ngbrain.ladder.models.hierarchy import ModelHierarchy
from ngbrain.ladder.quantities import Asked, Question
from ngbrain.ladder.summary import AskedFor, summarise
from ngbrain.progress import log_progress, reporting
from ngbrain.result import Status
from ngbrain.scene import Scene
from ngbrain.scene.result import SceneResult
from ngbrain.scene.tissues import DENSITY
from ngbrain.threads import threads as using

__all__ = ["AskedFor", "Climb", "ModelHierarchy", "Question", "Rung", "climb", "run_search", "solve"]


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
    """The answers that a scene asks for, by the cheapest model that is good enough; it reads as `result.json` does.

    scene     what is loaded, and what is asked how accurately
    folder    where `result.json` goes; None writes nothing
    model     axis → level, of those that are not to be chosen: others stay at their cheapest, and nothing is climbed
    richest   axis → level that the climb does not pass; None: all there are
    callback      called after every rung
    executor  who solves the models that estimates of a rung ask for, side by side (`parallel.run`): by default this process. Bodies
              at rest without memory are solved here in any case: estimates go on from their states
    questions  observables of one's own, asked beside what the scene asks
    callback  called with the result as it is known after each rung; `result.json` is written then too, so that what is stopped
              leaves what it has

    `answers` lists what was asked with value, unit (SI), tolerance and estimated error, the relative change that all steps left
    would make together; `model`; `left_out`: what the model lacks and how much that matters; `flags`: why the error may be larger
    than it says; `rungs`: the way.
    `warnings`: what is assumed of the tissues, and what to know of published constants.
    Raises `InputError` for a scene that means nothing, `SolverError` if the cheapest model has no answer.

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
            climb(scene, richest, callback, executor=executor, questions=questions, watch=watch)
            if model is None
            else assess(scene, model, executor, questions)
        ),
        [AskedFor.from_quantity(quantity) for quantity in asked],
        _assumed_density(scene),
        checkpoint,
    )


def _assumed_density(scene: Scene) -> list[str]:
    """A line for each tissue whose density counts and is not given."""
    if scene.time.frequency is None and scene.gravity is None and "inertia" not in axes_of(scene):
        return []
    said = f"density_kg_m3 is not given: {DENSITY:g} is assumed"
    return [f"tissue#{i} ({s.region}): {said}" for i, s in enumerate(scene.tissues, 1) if s.density is None]


def run_search(
    scene: Scene,
    folder: str | Path | None,
    threads: int,
    find: Callable[[Callable[[Climb], Any]], Climb],
    questions: Sequence[AskedFor],
    warnings: Sequence[str] = (),
    checkpoint: Callable[[dict[str, Any]], None] | None = None,
) -> SceneResult:
    """What `result.json` holds of the climb that is found, and written there; `warnings` beside the scene's own.

    `find` is given what to call with a climb that is under way; the result so far is written then, and given to `callback`.
    """
    started = time.perf_counter()
    ngsglobals.msg_level = 0

    def written(found: Climb) -> dict[str, Any]:
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
    return SceneResult(result, status=Status.CONVERGED, warnings=result["warnings"])


def _result(
    scene: Scene, threads: int, found: Climb, questions: Sequence[AskedFor], warnings: Sequence[str], seconds: float
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
