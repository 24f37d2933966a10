"""A scene to its result: what the verb `simulate` does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ngbrain import ladder, parallel
from ngbrain.errors import InputError
from ngbrain.ladder import Question, axes
from ngbrain.ladder.levels import Model
from ngbrain.progress import log_progress
from ngbrain.scene import Scene
from ngbrain.scene.result import SceneResult
from ngbrain.surgery import model_selection, retraction

Callback = Callable[..., None]
"""What is told of progress, in the words of the solver."""


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
    callback: Callback = log_progress,
    checkpoint: Callable[[dict[str, Any]], None] | None = None,
    executor: parallel.AnyExecutor = None,
    questions: Sequence[Question] = (),
) -> SceneResult:
    """Compute a scene: a body under loads, or an operation.

    Where it asks quantities with tolerances, the cheapest model that is within them answers; an operation that asks none, or
    `as_described`, is computed as it is written, an operation with the checks of its numbers.

    Parameters
    ----------
    scene : Scene or path
        What is computed, or its file.
    folder : path, optional
        Where `result.json` and checkpoints go; without it nothing is written.
    as_described : bool
        Compute it as it is written: a body with finite strain, memory, fibres and contact where it has them, on elements of
        `mesh.max_size_mm` and of order `mesh.order`.
    model, richest : dict, optional
        Axis → level of the model that is taken, or that the search does not pass.
    threads : int
        For assembly, or of an operation as described the processes that its protocols run in.
    resume : bool
        Go on with what is in `folder`, of an operation as described.
    checks : bool
        Whether an operation as described is run on other meshes, steps and laws too.
    callback : callable
        How far it has come: see `ngbrain.ladder.solve` and `ngbrain.surgery.retraction.solve`.
    callback : callable, optional
        Called with the result's data as far as it is known: when the protocols of an operation as described are done and after each
        check, else after each model.
    executor : optional
        Who computes what is independent (`ngbrain.parallel`).
    questions : sequence of Question
        Observables of one's own, asked of a body beside the scene's quantities.

    Returns
    -------
    SceneResult
        Reads as `result.json` does.

    Raises
    ------
    InputError
        A scene that means nothing, or an option that it does not have.
    SolverError
        Where there is no solution.

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
        return retraction.solve(scene, folder, threads, resume, callback, checks, checkpoint, executor)
    if resume:
        raise InputError("resume", resume, "False: only an operation as described can be resumed")
    if scene.is_operation:
        if questions:
            raise InputError("questions", "given", "none: an operation has those of its own [[quantity]]")
        return model_selection.solve(scene, folder, model, richest, threads, callback, executor, checkpoint)
    if as_described:
        model = full_model(scene)
    return ladder.solve(scene, folder, model, richest, threads, callback, executor, questions, checkpoint)


def full_model(scene: Scene) -> Model:
    """The model of a body that leaves nothing out, on the scene's own elements."""
    return {**axes.richest(axes.axes_of(scene)), "mesh": "0", "order": str(scene.mesh.order)}
