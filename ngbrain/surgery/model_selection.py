"""Model selection for operations: the axes of an operation's models, and the cheapest model within given tolerances.

All models have finite strain and contact, since an operation has no meaningful linear approximation. What can be left out is the
difference between tissues, their stiffening and relaxation, friction, and small elements. Steps are estimated by taking them on the
coarsest elements, element sizes by elastic tissue; this is expensive where the richest model is small.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain import parallel
from ngbrain.errors import InputError
from ngbrain.ladder import RequestedQuantity, run_search
from ngbrain.ladder.axes import Axis, check_levels, restrict
from ngbrain.ladder.levels import HALVINGS, MeshLevel, Model, PresenceLevel, TimeLevel, TissueLevel
from ngbrain.ladder.model_search import assess_along, search_along
from ngbrain.ladder.models.hierarchy import Solution
from ngbrain.ladder.quantities import BodyState
from ngbrain.ladder.search_result import Rung
from ngbrain.ladder.solutions import SolutionCache
from ngbrain.materials.families import NEO_HOOKE, is_neo_hooke
from ngbrain.progress import log_progress, reporting
from ngbrain.scene import Scene, Tissue
from ngbrain.scene.result import SceneResult
from ngbrain.surgery import answers
from ngbrain.surgery.head_models import Head, load_head
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.plausibility import check_moduli
from ngbrain.surgery.protocol_run import ProtocolRun

FACTORS = (2.0, math.sqrt(2), 1.0)
"""Element sizes of the levels, relative to the scene's."""
LARGEST = {"wall": 6e-3, "craniotomy": 14e-3, "largest": 36e-3}
"""Largest element sizes (m) of the levels, unless the scene's are larger: such elements would cut off parts of the brain."""
ALIKE = 0.85
"""Ratio of element sizes above which two meshes count as equal."""

AXES = {
    axis.name: axis
    for axis in (
        Axis("tissue", (TissueLevel.ONE, TissueLevel.EACH), ("that tissues differ",), ("coarse",), (1.2,)),
        Axis("stiffening", tuple(PresenceLevel), ("that tissue stiffens where it is strained",), ("coarse",), (1.5,)),
        Axis(
            "time",
            (TimeLevel.RELAXED, TimeLevel.FLOWING),
            ("how tissue relaxes after the first opening",),
            ("coarse",),
            (3.0,),
        ),
        Axis("friction", tuple(PresenceLevel), ("friction between blade and tissue",), ("coarse",), (1.5,)),
        Axis(
            "mesh",
            HALVINGS,
            ("smaller elements",) * 2,
            ("forgetful",) * 2,
            (2.5, 2.5),
            1.6,
        ),
    )
}


def axes_of(scene: Scene, richest: Model | None = None) -> dict[str, Axis]:
    """The axes that apply to an operation.

    Parameters
    ----------
    scene : Scene
    richest : mapping of str, optional
        Axis → its last level.

    Returns
    -------
    dict of Axis

    Raises
    ------
    InputError
        An unknown axis or level.
    """
    check_levels("richest", richest or {}, AXES)
    idle = {
        "tissue": len(scene.tissues) < 2,
        "stiffening": all(is_neo_hooke(tissue.law()) for tissue in scene.tissues),
        "time": not any(tissue.law().branches for tissue in scene.tissues),
        "friction": not scene.tool.friction,
    }
    found = {}
    for name, axis in AXES.items():
        last = axis.index((richest or {}).get(name, axis.levels[-1])) + 1
        if not idle.get(name):
            found[name] = restrict(axis, 0, min(last, len(_factors(scene))) if name == "mesh" else last)
    return found


@reporting()
def solve(
    scene: Scene,
    folder: str | Path | None = None,
    model: Model | None = None,
    richest: Model | None = None,
    threads: int = 1,
    callback: Callable[[Rung], None] = log_progress,
    executor: parallel.AnyExecutor = None,
    checkpoint: Callable[[dict[str, Any]], None] | None = None,
) -> SceneResult:
    """Answer the quantities that an operation asks for (`Scene.quantities`) by the cheapest model within their tolerances.

    Parameters
    ----------
    scene, folder, model, richest, threads, callback, executor, checkpoint
        See `ngbrain.ladder.solve`.

    Returns
    -------
    SceneResult
        As of `ngbrain.ladder.solve`; answers are in the units of their names.

    Raises
    ------
    InputError
        The scene has no quantities or cannot be built.
    SolverError
        The cheapest model has no solution.

    Examples
    --------
    Some minutes::

        from dataclasses import replace
        from ngbrain.scene import Quantity
        scene = replace(ngbrain.Scene.shipped("idealised_fast"), quantities=(Quantity(name="peak_force_N", tolerance=0.2),))
        result = ngbrain.simulate(scene)
        result["answers"], result["model"], result["left_out"]
    """
    operation = Operation(scene)
    axes, cache = axes_of(scene, richest), SolutionCache(operation, executor)
    check_moduli(operation.build_model({"mesh": "0"}))
    tolerances = np.array([quantity.tolerance for quantity in operation.questions])
    asked = [RequestedQuantity.from_quantity(quantity) for quantity in operation.questions]
    if model is None:
        return run_search(
            scene,
            folder,
            threads,
            lambda watch: search_along(axes, cache, tolerances, callback, watch),
            asked,
            checkpoint=checkpoint,
        )
    return run_search(scene, folder, threads, lambda _: assess_along(axes, cache, model), asked, checkpoint=checkpoint)


class Operation:
    """The head of a scene, read once, and its runs by any model."""

    def __init__(self, scene: Scene) -> None:
        if not scene.quantities:
            raise InputError("quantity", "missing", "one or more tables [[quantity]], each with a tolerance")
        self.scene, self.questions, self._made = scene, scene.quantities, dict[str, RetractionModel]()
        self.init_arguments = (scene,)

    def solve(self, model: Model, near: Mapping[str, BodyState] | None = None) -> Solution:
        """The requested numbers by one model.

        Parameters
        ----------
        model : mapping of str
            Axis → level.
        near : mapping, optional
            Not used: runs have no states to start from.

        Returns
        -------
        Solution

        Raises
        ------
        SolverError
            A run gives up.
        """
        begun = time.process_time()
        made = self.build_model(model)
        scene = made.scene
        names = {quantity.protocol or scene.protocols[0].name for quantity in self.questions}
        found, ndof = dict[str, dict[str, Any]](), 0
        for program in (made.program(scene, asked) for asked in scene.protocols if asked.name in names):
            elastic = made.elastic_materials(scene.time.ramp) if model.get("time") == "relaxed" else None
            run = ProtocolRun(made, program, None, materials=elastic).run()
            found[program.name], ndof = answers.answer(run.result(), scene.patient), run.transient.problem.fes.ndof
        values = [found[quantity.protocol or scene.protocols[0].name][quantity.name] for quantity in self.questions]
        return Solution(np.array(values, float), {}, ndof, time.process_time() - begun)

    def has_states(self, model: Model) -> bool:
        """Whether solutions have states to start from; here none has."""
        return False

    def build_model(self, model: Model) -> RetractionModel:
        """Mesh and laws of a model."""
        level = model["mesh"]
        if level not in self._made:
            sizes = replace(self.scene.mesh, **_sizes(self.scene, _factors(self.scene)[MeshLevel(level).halvings]))
            self._made[level] = RetractionModel.from_scene(replace(self.scene, mesh=sizes), self._head)
        made = self._made[level]
        tissues, tool = made.scene.tissues, made.scene.tool
        if model.get("tissue") == "one":
            tissues = tuple(replace(self._largest_tissue, region=tissue.region) for tissue in tissues)
        if model.get("stiffening") == "none":
            tissues = tuple(tissue.with_alpha(NEO_HOOKE) for tissue in tissues)
        if model.get("friction") == "none":
            tool = replace(tool, friction=0.0)
        return replace(made, scene=replace(made.scene, tissues=tissues, tools=(tool,)))

    @cached_property
    def _head(self) -> Head:
        return load_head(self.scene.geometry, self.scene.mesh.meshing_route)

    @cached_property
    def _largest_tissue(self) -> Tissue:
        """The tissue with the largest volume, without the ventricles."""
        made = self.build_model({"mesh": "0"})
        volumes = {name: ngs.Integrate(part.where, made.mesh) for name, part in made.parts().items()}
        name = max(volumes, key=lambda each: volumes[each])
        return next(tissue for tissue in self.scene.tissues if re.fullmatch(tissue.region, name))


def _sizes(scene: Scene, factor: float) -> dict[str, Any]:
    """Element sizes (m), multiplied by a factor and limited."""
    own = {name: getattr(scene.mesh, name) for name in LARGEST}
    return {name: max(size, min(factor * size, LARGEST[name])) for name, size in own.items()}


def _factors(scene: Scene) -> tuple[float, ...]:
    """The factors that differ enough from the next one; those of a coarse scene may all be nearly equal."""
    sizes = [np.array(list(_sizes(scene, factor).values())) for factor in FACTORS]
    return FACTORS[max(i for i, size in enumerate(sizes) if np.all(size > ALIKE * sizes[0])) :]
