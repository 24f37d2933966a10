"""The whole computation of a twin: from a case to answers, differences and decisions."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain import parallel
from ngbrain.errors import InputError
from ngbrain.image.read.label_file import read_labels
from ngbrain.io import FinishedWork, versions
from ngbrain.look import BriefText
from ngbrain.parallel import Callback, Task
from ngbrain.scene import Scene
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.plausibility import check_moduli
from ngbrain.surgery.retraction import geometry
from ngbrain.surgery.twin import comparison, credibility
from ngbrain.surgery.twin.case import Case
from ngbrain.surgery.twin.crossings import corridor_crossings
from ngbrain.surgery.twin.norms import Norm
from ngbrain.surgery.twin.plan_model import PlanModel
from ngbrain.surgery.twin.prior import Prior, patient_prior
from ngbrain.surgery.twin.response import MEASURES, Response
from ngbrain.surgery.twin.slices import head_slices
from ngbrain.surgery.twin.spectrum import rank_by_spectrum
from ngbrain.surgery.twin.stiffness import MeasuredMap, RelativeStiffness, choose_places
from ngbrain.surgery.twin.tasks import MESH, RESPONSE, RUNS, linearise_plan, make_model, other_elements, whole_runs

Array = np.ndarray
QUICK = {"wall": 8e-3, "craniotomy": 20e-3, "largest": 50e-3}
"""Element sizes (m) of a quick first answer, at least."""
TOGETHER = 3
"""Whole runs in one task: so many are lost when a command is stopped."""


@dataclass(frozen=True, eq=False, repr=False)
class PatientModel(BriefText):
    """One patient: plans on a head, relative stiffness and prior.

    Parameters
    ----------
    models : dict of RetractionModel
        By plan.
    stiffness : RelativeStiffness
    prior : Prior
    found : dict
        What the stiffness data say: `measured`, `ratio_median` and more, see `RelativeStiffness.check_on`.
    """

    models: dict[str, RetractionModel]
    stiffness: RelativeStiffness
    prior: Prior
    found: dict[str, float]


def build_patient(case: Case, measured: MeasuredMap | None, quick: bool = False) -> PatientModel:
    """Read head and data of a case, mesh its plans, and check that all of it belongs together.

    Parameters
    ----------
    case : Case
    measured : MeasuredMap, optional
        The patient's stiffness.
    quick : bool
        Whether elements are coarse.

    Returns
    -------
    PatientModel

    Raises
    ------
    InputError
        Plans outside the craniotomy, a map of another place or unit, a frequency or tissues without a norm.
    """
    norm = Norm.named(case.norm)
    if measured is not None:
        norm.check_frequency(measured.frequency)
    scenes = {name: coarse_scene(scene) if quick else scene for name, scene in case.scenes().items()}
    models = dict[str, RetractionModel]()
    for name, scene in scenes.items():
        try:
            models[name] = make_model(scene.to_toml())
            cleft = models[name].cleft
            case.check_opening(name, cleft.entry, math.hypot(cleft.width, cleft.opening))
        except InputError as error:
            field = error.field if error.field.startswith("plan") else f"plan {name!r}: {error.field}"
            raise InputError(field, error.value, error.wanted) from None
    first = next(iter(models.values()))
    normal = {tissue.region: norm.tissue(_name(first, tissue.region)) for tissue in first.scene.tissues}
    points = np.concatenate([_solid_points(model, normal) for model in models.values()])
    sites = np.array([model.cleft.target + model.cleft.depth / 2 * model.cleft.out for model in models.values()])
    data = case.stiffness
    correlation = data.correlation if data is not None else 2 * choice_distance(points)
    stiffness = RelativeStiffness(
        normal,
        choose_places(points, sites, correlation),
        correlation,
        measured,
        case.lesions,
        math.log(data.map_factor) if data is not None and measured is not None else 0.0,
    )
    found = stiffness.check_on(points)
    patient = patient_prior(first.scene.tissues, first.scene.time.ramp, case.link, stiffness, data)
    return PatientModel(models, stiffness, patient, found)


def choice_distance(points: Array) -> float:
    """Default length (m) over which people differ alike: an eighth of a body's largest extent."""
    return float(np.ptp(points, axis=0).max()) / 8


def coarse_scene(scene: Scene) -> Scene:
    """A scene with the elements of a quick answer."""
    time = replace(scene.time, step_tolerance=max(scene.time.step_tolerance, 0.1))
    return replace(scene, mesh=scene.mesh.with_minimum(QUICK), time=time)


def _name(model: RetractionModel, pattern: str) -> str:
    """The first tissue of a head that a pattern matches, the pattern itself where there is none."""
    names = [name for shares in model.head.mixtures(model.mesh, 2).values() for name in shares]
    return next((name for name in names if re.fullmatch(pattern, name)), pattern)


def _solid_points(model: RetractionModel, normal: Mapping[str, Any]) -> Array:
    """Vertices (m) of elements in tissue with a norm."""
    fluid = [region for region, of in normal.items() if of is None]
    mesh = model.mesh
    corners: set[int] = set()
    for name in set(mesh.GetMaterials()):
        if not any(re.fullmatch(each, name) for each in fluid):
            corners |= {v.nr for element in mesh.Materials(name).Elements() for v in element.vertices}
    return np.array([vertex.point for vertex in mesh.vertices])[sorted(corners)]


def solve(
    case: Case,
    measured: MeasuredMap | None,
    folder: Path | None,
    draws: int,
    quick: bool,
    executor: parallel.AnyExecutor,
    callback: Callback,
    checkpoint: Callable[[dict[str, Any]], None] | None = None,
    seed: int = 0,
) -> dict[str, Any]:
    """Compare the plans of a case.

    Parameters
    ----------
    case : Case
    measured : MeasuredMap, optional
        The patient's stiffness.
    folder : Path, optional
        Where finished work is kept, from which a stopped command goes on.
    draws : int
        Whole runs of each plan.
    quick : bool
        Coarse elements, no whole runs, no numerical bound.
    executor : int or Executor, optional
        As of `ngbrain.parallel.run`.
    callback : callable
        Progress: task, time (s), share done.
    checkpoint : callable, optional
        Called with the result when all plans are linearised, and again when it is complete.
    seed : int
        Of the draws.

    Returns
    -------
    dict
        The contents of `result.json`.
    """
    started = time.perf_counter()
    patient = build_patient(case, measured, quick)
    warned = check_moduli(next(iter(patient.models.values())))
    drawn = patient.prior.draws(max(comparison.LINEAR, draws), seed)
    count = 0 if quick else draws
    tasks, of_plan = list[Task](), dict[str, tuple[Any, ...]]()
    for name, model in patient.models.items():
        of_plan[name] = (name, model.scene.to_toml(), patient.stiffness, patient.prior)
        tasks.append(Task(RESPONSE + name, linearise_plan, (*of_plan[name], quick)))
    for first in range(0, count, TOGETHER):
        for name, given in of_plan.items():
            some = drawn[first : min(first + TOGETHER, count)]
            task = f"{RUNS}{name} {first + 1}"
            tasks.append(Task(task, whole_runs, (*given, some, task)))
    tasks += [Task(MESH + name, other_elements, given) for name, given in of_plan.items() if not quick]
    done = dict[str, Any]()

    def finished(name: str, outcome: Any) -> None:
        done[name] = outcome
        if checkpoint and sum(key.startswith(RESPONSE) for key in done) == len(of_plan) and name.startswith(RESPONSE):
            checkpoint(_result(case, patient, done, drawn, 0, quick, warned, started, seed))

    store = None if folder is None else FinishedWork(folder)
    parallel.run(tasks, executor, callback=callback, finished=finished, store=store)
    result = _result(case, patient, done, drawn, count, quick, warned, started, seed)
    if checkpoint:
        checkpoint(result)
    return result


def _result(
    case: Case,
    patient: PatientModel,
    done: Mapping[str, Any],
    drawn: Array,
    count: int,
    quick: bool,
    warned: Sequence[str],
    started: float,
    seed: int,
) -> dict[str, Any]:
    """The contents of `result.json`, of what is done so far."""
    responses, linear = dict[str, Response](), dict[str, dict[str, Array]]()
    plans = {name: PlanModel(name, model, patient.stiffness, patient.prior) for name, model in patient.models.items()}
    for name, plan in plans.items():
        found = done[RESPONSE + name]
        responses[name] = Response(*(found[key] for key in ("values", "theta", "gradients", "nodes")))
        linear[name] = responses[name].log_values(np.array([plan.theta(draw) for draw in drawn]))
    runs, lost = _whole(list(patient.models), done, count)
    at_whole = {plan: {key: values[:count][runs.used] for key, values in of.items()} for plan, of in linear.items()}
    corrected = comparison.correct(linear, runs.logs, at_whole, seed)
    moved = {
        name: {key: math.log(done[MESH + name][key] / responses[name].values[key]) for key in MEASURES}
        for name in patient.models
        if MESH + name in done
    }
    differences = comparison.compare(corrected, runs.logs, moved, MEASURES)
    answers = {
        name: {
            key: comparison.summarise(corrected[name][key], responses[name].values[key], moved.get(name, {}).get(key))
            | {"linearised_interval_95": comparison.summarise(linear[name][key], 1.0, None)["interval_95"]}
            | {"unit": comparison.unit(key), "runs": np.exp(runs.logs[name][key]).tolist()}
            for key in MEASURES
        }
        for name in patient.models
    }
    shares = _shares(patient, linear, corrected, drawn)
    warnings = list(warned)
    tangent = case.stiffness.loss_tangent if case.stiffness is not None else None
    second = None if patient.stiffness.measured is None else rank_by_spectrum(plans, responses, tangent)
    if lost:
        warnings.append(f"{lost} of {count} whole runs gave up and are left out for all plans")
    structures = _structures(case)
    fluids = [region for region, of in patient.stiffness.normal.items() if of is None]
    return {
        "verb": "twin",
        "title": case.title,
        "versions": versions(),
        "seed": seed,
        "case": case.to_dict(),
        "quick": quick,
        "stiffness": {
            "source": patient.stiffness.measured.note if patient.stiffness.measured else "the catalogue alone",
            "reference_Pa": patient.stiffness.reference,
            **patient.found,
        },
        "prior": {
            "numbers": len(patient.prior.numbers),
            "places": len(patient.stiffness.places),
            "notes": list(patient.prior.notes),
        },
        "draws": {"linearised": len(drawn), "whole_runs": len(runs.used), "lost": lost},
        "answers": answers,
        "differences": [each.to_dict() for each in differences],
        "conclusion": credibility.conclusion(differences, second),
        "second_way": second,
        "variance_shares": shares,
        "residuals": _residuals(runs.logs, at_whole),
        "at_centre": {name: _brief(done[RESPONSE + name]["answer"]) for name in patient.models},
        "corridors": {
            name: corridor_crossings(model, fluids, structures) | {"geometry": geometry(model)}
            for name, model in patient.models.items()
        },
        "sections": head_slices(patient.models, patient.stiffness),
        "question": credibility.QUESTION,
        "context_of_use": credibility.CONTEXT,
        "thresholds": credibility.thresholds(),
        "credibility": credibility.evidence(bool(count), bool(moved), patient.stiffness.measured is not None),
        "assumptions": credibility.assumptions(case, patient.prior, patient.stiffness),
        "model": {name: {"n_tets": model.mesh.ne} for name, model in patient.models.items()},
        "warnings": warnings,
        "checks": {},
        "time_s": time.perf_counter() - started,
    }


@dataclass(frozen=True, eq=False)
class _Whole:
    """Whole runs: logarithms by plan and measure, and indices of the draws that all plans finished."""

    logs: dict[str, dict[str, Array]]
    used: Array


def _whole(plans: list[str], done: Mapping[str, Any], count: int) -> tuple[_Whole, int]:
    found: dict[str, list[Any]] = {name: [] for name in plans}
    for first in range(0, count, TOGETHER):
        for name in plans:
            found[name] += done[f"{RUNS}{name} {first + 1}"]
    used = np.array([i for i in range(count) if all(found[name][i] is not None for name in plans)], int)
    logs = {
        name: {key: np.log(np.array([found[name][i][key] for i in used], float)) for key in MEASURES} for name in plans
    }
    return _Whole(logs, used), count - len(used)


def _shares(
    patient: PatientModel,
    linear: Mapping[str, Mapping[str, Array]],
    corrected: Mapping[str, Mapping[str, Array]],
    drawn: Array,
) -> dict[str, Any]:
    """Shares of the variance of each measure of the first plan, and of the ratio of each pair."""
    sources, plans = patient.prior.sources, list(linear)
    found: dict[str, Any] = {"answers": {}, "differences": []}
    for name in plans:
        found["answers"][name] = {
            key: comparison.variance_shares(linear[name][key], drawn, sources, corrected[name][key] - linear[name][key])
            for key in MEASURES
        }
    for i, first in enumerate(plans):
        for second in plans[i + 1 :]:
            for key in MEASURES:
                ratio = linear[first][key] - linear[second][key]
                rest = corrected[first][key] - corrected[second][key] - ratio
                shares = comparison.variance_shares(ratio, drawn, sources, rest)
                found["differences"].append({"first": first, "second": second, "measure": key, "shares": shares})
    return found


def _residuals(whole: comparison.Logs, at_whole: comparison.Logs) -> dict[str, Any]:
    """Whole runs less the linearisation: mean and standard deviation of the logarithm."""
    found: dict[str, Any] = {}
    for plan, measures in whole.items():
        found[plan] = {}
        for key, values in measures.items():
            left = values - at_whole[plan][key]
            found[plan][key] = {"mean": float(left.mean()), "sd": float(left.std())} if len(left) else None
    return found


def _brief(answer: Mapping[str, Any]) -> dict[str, Any]:
    """An answer without what only figures need."""
    return {key: value for key, value in answer.items() if key not in ("volume_mps_above_by_region_ml",)}


def _structures(case: Case) -> Any:
    return None if case.structures is None else read_labels(case.structures, case.scheme)
