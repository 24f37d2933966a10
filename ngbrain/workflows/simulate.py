"""Simulate a scene: the workflow of the verb `simulate`."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ngbrain import ladder, parallel
from ngbrain.errors import InputError
from ngbrain.ladder import Question
from ngbrain.ladder.levels import Model
from ngbrain.progress import log_progress
from ngbrain.scene import Scene
from ngbrain.scene.result import SceneResult
from ngbrain.surgery import model_selection, retraction
from ngbrain.workflows.quick import operation as quick_operation
from ngbrain.workflows.quick import search as quick_search

Callback = Callable[..., None]
"""Progress callback, with the arguments of the solver's."""


def simulate(
    scene: Scene | str | Path,
    folder: str | Path | None = None,
    *,
    as_described: bool = False,
    model: Model | None = None,
    richest: Model | None = None,
    threads: int = 1,
    resume: bool = False,
    checks: bool = True,
    quick: bool = False,
    callback: Callback = log_progress,
    checkpoint: Callable[[dict[str, Any]], None] | None = None,
    executor: parallel.AnyExecutor = None,
    questions: Sequence[Question] = (),
) -> SceneResult:
    """Compute a scene: a body under loads, or an operation.

    A scene with requested quantities is answered by the cheapest model within their tolerances. An operation without them, or any
    scene with `as_described`, is computed as it is written, an operation with verification runs.

    Parameters
    ----------
    scene : Scene or path
        The scene, or its file.
    folder : path, optional
        Where `result.json` and checkpoints go; by default nothing is written.
    as_described : bool
        Compute it as written: a body with finite strain, viscoelasticity, fibres and contact where it has them, with elements of
        `mesh.max_size_mm` and order `mesh.order`.
    model, richest : dict, optional
        Axis → level of a prescribed model, or the last level of the search.
    threads : int
        Threads for assembly; processes for the protocols of an operation as described.
    resume : bool
        Continue from the files in `folder`, for an operation as described.
    checks : bool
        Whether an operation as described has verification runs with other meshes, steps and laws.
    callback : callable
        Progress: see `ngbrain.ladder.solve` and `ngbrain.surgery.retraction.solve`.
    quick : bool
        First answers within a minute or two, with intervals in which the refined ones should lie (`first_answers` of the result):
        an operation as described is computed on large elements before, a body as described with elements of lower order. Model
        selection begins with the cheapest model in any case. A resumed run keeps its first answers.
    checkpoint : callable, optional
        Called with the present result: after each protocol of an operation as described and after each verification run, else after
        each model.
    executor : optional
        Computes independent tasks (`ngbrain.parallel`).
    questions : sequence of Question
        Observables of a body, in addition to the scene's quantities.

    Returns
    -------
    SceneResult
        With the contents of `result.json`.

    Raises
    ------
    InputError
        A scene that is not meaningful, or an option that does not apply.
    SolverError
        There is no solution.

    Examples
    --------
    >>> from ngbrain.scene import DisplacementBC, Geometry, Quantity, Tissue
    >>> scene = Scene(
    ...     geometry=Geometry(kind="block", size=(0.06, 0.06, 0.04)),
    ...     tissues=[Tissue(mu=1000.0, poissons_ratio=0.3)],
    ...     displacement_bcs=[DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=(0, 0, -1e-4))],
    ...     quantities=[Quantity(name="force", boundary="top", tolerance=0.5)],
    ... )
    >>> (force,) = simulate(scene, richest={"mesh": "0"})["answers"]
    >>> force["quantity"], force["unit"], force["value"] < 0
    ('force on top, end', 'N', True)
    """
    if not isinstance(scene, Scene):
        scene = Scene.from_toml(scene)
    if scene.is_operation and (as_described or not scene.quantities):
        if model or richest:
            raise InputError(
                "model", "given", "no model: an operation as described, or without a [[quantity]], has its own"
            )
        solve = (
            quick_operation.solve
            if quick or (resume and quick_operation.has_first_answers(folder))
            else retraction.solve
        )
        return solve(scene, folder, threads, resume, callback, checks, checkpoint, executor)
    if resume:
        raise InputError("resume", resume, "False: only an operation as described can be resumed")
    if scene.is_operation and questions:
        raise InputError("questions", "given", "none: an operation has those of its own [[quantity]]")
    if quick and model:
        raise InputError("quick", quick, "False with a prescribed model")
    growing = quick_search.SearchAnswers(folder, checkpoint) if quick else None
    watch = growing.add if growing else checkpoint
    if scene.is_operation:
        found = model_selection.solve(scene, folder, model, richest, threads, callback, executor, watch)
    else:
        solve = functools.partial(ladder.solve, scene, folder, threads=threads, callback=callback, executor=executor)
        if as_described and growing and (cheaper := quick_search.lower_order_model(scene)):
            growing.add(solve(model=cheaper, questions=questions).to_dict(), is_last=False)
        if as_described:
            model = quick_search.full_model(scene)
        found = solve(model=model, richest=richest, questions=questions, checkpoint=watch)
    return growing.result(found) if growing else found
