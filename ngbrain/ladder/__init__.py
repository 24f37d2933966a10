"""Model no more than a scene needs: from the cheapest model up, until what is missing is within the tolerances that are asked for.

    from ngbrain.scene.loading import Loading
    result = ngbrain.solve(Loading.from_toml("palpation.toml"))
    result["answers"], result["model"], result["left_out"]

`Question` asks an observable of one's own beside what the scene asks. `rungs` has the axes as data, `climb` the loop,
`described` what comes of it as data, `estimates` what a step up would change; `bodies`, `waves` and `maps` what a model is.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

from ngsolve import ngsglobals

from ngbrain import parallel
from ngbrain.io import versions, write_json
from ngbrain.ladder.bodies import Bench
from ngbrain.ladder.climb import Climb, Rung, climb, stand
from ngbrain.ladder.described import AskedFor, described
from ngbrain.ladder.quantities import Asked, Question, unit_of
from ngbrain.ladder.rungs import Model, axes_of
from ngbrain.progress import logged, reporting
from ngbrain.result import Status
from ngbrain.scene.loading import DENSITY, Loading
from ngbrain.scene.result import SceneResult
from ngbrain.threads import threads as using

__all__ = ["AskedFor", "Bench", "Climb", "Loading", "Question", "Rung", "answered", "climb", "solve"]


class Asking(Protocol):
    """A scene, as far as its answer is described."""

    @property
    def title(self) -> str:
        """A line."""

    @property
    def warnings(self) -> list[str]:
        """What is assumed, and what to know of constants."""

    def to_dict(self) -> dict[str, Any]:
        """As plain data."""


@reporting()
def solve(
    scene: Loading,
    folder: str | Path | None = None,
    model: Model | None = None,
    richest: Model | None = None,
    threads: int = 1,
    tell: Callable[[Rung], None] = logged,
    executor: parallel.AnyExecutor = None,
    questions: Sequence[Question] = (),
) -> SceneResult:
    """The answers that a scene asks for, by the cheapest model that is good enough; it reads as `result.json` does.

    scene     what is loaded, and what is asked how accurately
    folder    where `result.json` goes; None writes nothing
    model     axis → level, of those that are not to be chosen: others stay at their cheapest, and nothing is climbed
    richest   axis → level that the climb does not pass; None: all there are
    tell      called after every rung
    executor  who solves the models that estimates of a rung ask for, side by side (`parallel.run`): by default this process. Bodies
              at rest without memory are solved here in any case: estimates go on from their states
    questions  observables of one's own, asked beside what the scene asks

    `quantities` lists what was asked with value, unit (SI), tolerance and estimated error; `answers` and `error`, the relative
    change that all steps left would make together, by the question's name; `model`; `left_out`: what the model lacks and how much
    that matters; `flags`: why the error may be larger than it says; `rungs`: the way.
    `warnings`: what is assumed of the tissues, and what to know of published constants.
    Raises `InputError` for a scene that means nothing, `SolverError` if the cheapest model has no answer.

    >>> from ngbrain.scene.loading import Ask, Given, Stuff
    >>> given = [Given(boundary="bottom"), Given(boundary="top", by=(0, 0, -1e-4))]
    >>> scene = Loading(stuff=[Stuff(mu=1000.0, poisson=0.3)], given=given, ask=[Ask(boundary="top", tolerance=0.5)])
    >>> result = solve(scene, richest={"mesh": "0"})
    >>> result["model"]["strain"], result["error"]["force on top, end"] < 0.5
    ('linear', True)
    """
    asked: list[Asked] = [*scene.ask, *questions]
    return answered(
        scene,
        folder,
        threads,
        lambda: (
            climb(scene, richest, tell, executor=executor, questions=questions)
            if model is None
            else stand(scene, model, executor, questions)
        ),
        [AskedFor(ask.name, unit_of(ask), ask.tolerance) for ask in asked],
        _assumed_density(scene),
    )


def _assumed_density(scene: Loading) -> list[str]:
    """A line for each tissue whose density counts and is not given."""
    course = scene.course
    if course.frequency is None and course.gravity is None and "inertia" not in axes_of(scene):
        return []
    said = f"density_kg_m3 is not given: {DENSITY:g} is assumed"
    return [f"stuff#{i} ({s.region}): {said}" for i, s in enumerate(scene.stuff, 1) if s.density is None]


def answered(
    scene: Asking,
    folder: str | Path | None,
    threads: int,
    find: Callable[[], Climb],
    questions: Sequence[AskedFor],
    warnings: Sequence[str] = (),
) -> SceneResult:
    """What `result.json` holds of the climb that is found, and written there; `warnings` beside the scene's own."""
    started = time.perf_counter()
    ngsglobals.msg_level = 0
    with using(threads):
        found = find()
    result = {
        "verb": "solve",
        "title": scene.title,
        "versions": versions(),
        "seed": 0,
        "threads": threads,
        "scene": scene.to_dict(),
        "warnings": [*scene.warnings, *warnings],
        **described(found, questions),
        "time_s": time.perf_counter() - started,
    }
    if folder is not None:
        Path(folder).mkdir(parents=True, exist_ok=True)
        write_json(Path(folder) / "result.json", result)
    return SceneResult(result, status=Status.CONVERGED, warnings=result["warnings"])
