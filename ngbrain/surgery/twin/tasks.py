"""What is computed for a plan: its linearised run, whole runs with draws of the patient, a run on other elements.

Tasks of `ngbrain.parallel`: their arguments are plain data, from which another process makes the plan again.
"""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from ngbrain.errors import SolverError
from ngbrain.parallel import Callback, share_threads
from ngbrain.scene import Scene
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.tools import make_tools
from ngbrain.surgery.twin.plan_model import STEPS, PlanModel
from ngbrain.surgery.twin.prior import Prior
from ngbrain.surgery.twin.response import MEASURES
from ngbrain.surgery.twin.stiffness import RelativeStiffness
from ngbrain.surgery.uncertainty.verification_runs import other_mesh

Array = np.ndarray
RESPONSE, RUNS, MESH = "linearised: ", "whole runs: ", "other elements: "
"""Beginnings of the names of tasks."""
QUICK_STEPS = 5
"""Time steps of a quick linearised run."""
SHARED = 4
"""Largest number of meshes that are kept for several tasks."""
_MESHES: dict[str, RetractionModel] = {}


def linearise_plan(
    name: str, toml: str, stiffness: RelativeStiffness, patient: Prior, quick: bool, *, callback: Callback
) -> dict[str, Any]:
    """The run of a plan at the prior's centre, and its gradients: a task.

    Parameters
    ----------
    name : str
        Plan.
    toml : str
        Its scene.
    stiffness : RelativeStiffness
    patient : Prior
    quick : bool
        Whether the linearised run has few time steps.
    callback : callable
        Progress: name, time (s), share done.

    Returns
    -------
    dict
        `answer`, and the fields of a `Response`.
    """
    with share_threads(callback) as told:
        plan = make_plan(name, toml, stiffness, patient)
        task = RESPONSE + name
        answer = plan.run(patient.centre, lambda _, t, share: told(task, t, 0.3 * share))
        found = plan.linearise(answer, QUICK_STEPS if quick else STEPS)
        told(task, 0.0, 1.0)
        return {"answer": answer, **vars(found)}


def whole_runs(
    name: str, toml: str, stiffness: RelativeStiffness, patient: Prior, draws: Array, task: str, *, callback: Callback
) -> list[dict[str, float] | None]:
    """Whole nonlinear runs of a plan with draws of the patient: a task.

    Parameters
    ----------
    name, toml, stiffness, patient
        As of `linearise_plan`.
    draws : (n, numbers) array
    task : str
        Name of the task, for progress.
    callback : callable
        As of `linearise_plan`.

    Returns
    -------
    list of dict
        Measures of each draw; None where a run gave up.
    """
    found = list[dict[str, float] | None]()
    with share_threads(callback) as told:
        plan = make_plan(name, toml, stiffness, patient)
        for i, draw in enumerate(draws):

            def step(_: str, t: float, share: float, done: int = i) -> Any:
                return told(task, t, (done + share) / len(draws))

            try:
                answer = plan.run(draw, step)
            except SolverError:
                found.append(None)
                continue
            found.append({key: float(answer[key]) for key in MEASURES})
        told(task, 0.0, 1.0)
    return found


def other_elements(
    name: str, toml: str, stiffness: RelativeStiffness, patient: Prior, *, callback: Callback
) -> dict[str, float]:
    """The measures of a plan at the prior's centre on other elements: a task.

    Parameters
    ----------
    name, toml, stiffness, patient, callback
        As of `linearise_plan`.

    Returns
    -------
    dict of float
        By measure.
    """
    scene = _read(toml)
    with share_threads(callback) as told:
        plan = make_plan(name, replace(scene, mesh=other_mesh(scene.mesh)).to_toml(), stiffness, patient)
        answer = plan.run(patient.centre, lambda _, t, share: told(MESH + name, t, share))
    return {key: float(answer[key]) for key in MEASURES}


def _read(toml: str) -> Scene:
    return Scene.from_dict(tomllib.loads(toml))


def make_plan(name: str, toml: str, stiffness: RelativeStiffness, patient: Prior) -> PlanModel:
    """A plan from the text of its scene.

    Parameters
    ----------
    name, toml, stiffness, patient
        As of `linearise_plan`.

    Returns
    -------
    PlanModel
    """
    return PlanModel(name, make_model(toml), stiffness, patient)


@lru_cache(maxsize=8)
def make_model(toml: str) -> RetractionModel:
    """The model of a scene; plans with one corridor share its mesh."""
    scene = _read(toml)
    if (shared := _MESHES.get(_corridor(scene))) is None:
        _MESHES.clear() if len(_MESHES) >= SHARED else None
        shared = _MESHES[_corridor(scene)] = RetractionModel.from_scene(scene)
    scene.check_on(shared.head)
    return replace(shared, scene=scene, blades=make_tools(scene.tool, shared.cleft))


def _corridor(scene: Scene) -> str:
    """What a mesh is made from, as text."""
    given = scene.to_dict()
    return json.dumps({key: given.get(key) for key in ("geometry", "mesh", "tissue", "cleft", "displacement_bc")})
