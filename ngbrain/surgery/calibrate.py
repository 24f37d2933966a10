"""How stiff a patient's tissues are, from what a retraction was seen to do: landmarks that moved, and the force that it took.

    least  ½ Σ |(d(s) - m)/σ|² + ½ Σ_l (ln s_l / ln r)²      over a factor s_l > 0 for each tissue

s_l multiplies all moduli and viscosities of a tissue, so that it relaxes as quickly; r is how far published constants are
apart. d are a whole run's: finite strains, contact and memory, on times that an adaptive run of the scene's own tissues chose.
Derivatives are those of the run (`forward.sensitivity.transient`).

Elements that resolve the contact poorly make the same tissue look stiffer or softer, by more than noise does. What finer ones would
have computed at s is taken off the data, to first order (`inverse.defect`), and by how much that moved a factor is one standard
deviation more of it: of errors that go with the square of the elements' size as much again is left.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.adjoint.reduced import Point, Reduced
from ngbrain.errors import InputError, SolverError
from ngbrain.forward.common.interpolation import points_in_mesh
from ngbrain.forward.observables import Displacements, Force, Observable
from ngbrain.forward.sensitivity.transient.replay import accepted_times
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.inverse.fitting.defect_correction import defect_correction_step
from ngbrain.inverse.objective.parameters import LogTransform, ParameterFields, Unknown
from ngbrain.inverse.objective.regularisation import ridge
from ngbrain.inverse.optimise.levenberg_marquardt import levenberg_marquardt
from ngbrain.inverse.optimise.regularisation_weight import FixedWeights, MisfitLevel, WeightPolicy
from ngbrain.inverse.optimise.result import Iteration, OptimisationResult, plot_misfit_history
from ngbrain.inverse.uncertainty.interval import LEVEL, CredibleInterval
from ngbrain.inverse.uncertainty.posterior import Posterior
from ngbrain.progress import log_progress, reporting
from ngbrain.result import Result
from ngbrain.scene import Scene, Tissue
from ngbrain.surgery.model import WALLS, RetractionModel
from ngbrain.surgery.observations import Observations
from ngbrain.surgery.plausibility import check_moduli
from ngbrain.surgery.protocols import ToolMotion

Array = np.ndarray
Search = Callable[[Reduced, Array, WeightPolicy, Callable[[Iteration], None]], OptimisationResult]
"""An optimiser of `inverse`: from an objective and where to begin down, weights as a policy has them."""
SPREAD = 3.0
"""r: by what factor published moduli of brain are to either side of one another (one standard deviation)."""


@dataclass(repr=False, eq=False)
class Calibrated(Result):
    """What was found.

    factors  tissue → its factor s, with deviation and interval; what is missed beyond the noise, as by elements that are too
             coarse, counts as more noise
    scene    with tissues that are so stiff, their bulk moduli as they were
    fitted   what would be seen of it, as `Observations.data`
    level    the misfit and what it should be
    moved    tissue → by what finer elements multiplied its factor; None where they were not tried
    """

    factors: dict[str, CredibleInterval]
    scene: Scene
    fitted: Array
    level: MisfitLevel
    moved: dict[str, float] | None = None

    def plot(self) -> Any:
        """The misfit over iterations."""
        return plot_misfit_history(self.history)

    @property
    def value(self) -> dict[str, CredibleInterval]:
        """Factors."""
        return self.factors

    @property
    def headline(self) -> str:
        """Factors with their intervals."""
        bands = [f"{name} {band.value:.3g} ({band.low:.3g} to {band.high:.3g})" for name, band in self.factors.items()]
        return ", ".join([*bands, f"misfit {self.level.ratio:.3g} times what is expected"])

    @property
    def statistics(self) -> dict[str, float]:
        """Of the search."""
        return {"iterations": len(self.history)}


class Retracted:
    """A scene's run of one protocol as a model: from factors of tissues to displacements of landmarks and the blade's force.

    tissues  their `region`; all by default, in the order of the scene
    grid     times (s) at which steps end; by default those of an adaptive run as the scene asks for it

    `run` is the `RunModel`, `factors` its parameters. Raises `InputError` for a blade of given force or with friction, times when
    nothing is done, a landmark outside of the mesh, an unknown tissue.
    """

    def __init__(
        self,
        model: RetractionModel,
        landmarks: Array,
        times: Array,
        tissues: Sequence[str] = (),
        protocol: int = 0,
        grid: Array | None = None,
    ) -> None:
        scene = model.scene
        program = model.program(scene, scene.protocols[protocol])
        if not isinstance(program, ToolMotion) or scene.tool.friction:
            raise InputError("scene", "with a blade of given force or with friction", "a given way, without friction")
        if not (np.min(times) > 0 and np.max(times) <= program.times[-1]):
            between = f"{np.min(times):g} to {np.max(times):g} s"
            raise InputError("times", between, f"after 0 and up to {program.times[-1]:g} s, when {program.name} ends")
        if np.any(outside := ~points_in_mesh(model.mesh, landmarks)):
            raise InputError("landmarks", f"{np.sum(outside)} outside of the mesh", "points in the head's tissue")
        names = tissues or [tissue.region for tissue in scene.tissues]
        if mapped := [tissue.region for tissue in scene.tissues if tissue.shear_modulus_map and tissue.region in names]:
            raise InputError(
                "tissues", f"{mapped[0]}, which has a shear_modulus_map", "tissues whose level is not measured already"
            )
        self.factors = {name: ngs.Parameter(1.0) for name in names}
        run = model.run(program, materials=model.scaled_materials(self.factors))
        self.landmarks, self.times, self.protocol = landmarks, times, protocol
        self.grid = accepted_times(model.run(program)) if grid is None else grid
        x, y, z = (float(c) for c in model.cleft.across)
        observables: list[Observable] = [Displacements(landmarks)] if len(landmarks) else []
        observables.append(Force(WALLS[0], (x, y, z)))
        assert run.motion is not None  # a blade moves
        self.run = RunModel(run.problem, run.motion, self.grid, self.factors, observables, times)


@reporting()
def calibrate(
    scene: Scene | RetractionModel,
    seen: Observations,
    tissues: Sequence[str] = (),
    protocol: int = 0,
    spread: float = SPREAD,
    level: float = LEVEL,
    start: Mapping[str, float] | None = None,
    callback: Callable[[Iteration, dict[str, float]], None] = log_progress,
    search: Search = levenberg_marquardt,
    finer: bool = True,
) -> Calibrated:
    """Factors of a scene's tissues from what was seen of one of its protocols.

    scene    the operation, with the tissues that the search begins with; or its `Model`, when there is one
    tissues  `region` of those that are looked for; all by default
    spread   r, by what factor a tissue may well differ from the scene's constants
    level    probability of the intervals
    start    tissue → factor where the search begins (1)
    callback     called after every round with the factors by then, from which another search may go on
    search   the optimiser, such as `inverse.quasi_newton.l_bfgs`
    finer    whether the error of elements is taken off and counts in the intervals, by one run more, on elements 0.7 times as large

    A tissue that the data say nothing of keeps a factor of 1 and an interval as wide as `spread` has it. Raises `InputError` as
    `Retracted` does, `ConvergenceError` where no step from the start fits better.

    >>> scene = Scene.shipped("idealised_fast")
    >>> found = calibrate(scene, seen, ["cortex", "white"])  # doctest: +SKIP
    >>> found.factors["white"].low, found.factors["white"].high, found.scene  # doctest: +SKIP
    """
    if not spread > 1:
        raise InputError("spread", spread, "a factor above 1")
    if not all(factor > 0 for factor in (start or {}).values()):
        raise InputError("start", start, "factors above 0")
    model = scene if isinstance(scene, RetractionModel) else RetractionModel.from_scene(scene)
    check_moduli(model)
    retracted = Retracted(model, np.asarray(seen.landmarks, float), np.asarray(seen.times, float), tissues, protocol)
    run = retracted.run
    fields = ParameterFields(run.theta, run.blocks, {name: Unknown(1.0, LogTransform()) for name in retracted.factors})
    held = {name: ridge(fields.start[place]) for name, place in fields.blocks.items()}
    weights = dict.fromkeys(held, 1 / math.log(spread) ** 2)

    def told(iteration: Iteration) -> None:
        callback(iteration, {name: factor.Get() for name, factor in retracted.factors.items()})

    first = np.log([(start or {}).get(name, 1.0) for name in retracted.factors])
    found = search(Reduced(run, seen.misfit(), fields, held, weights), first, FixedWeights(), told)
    missed = math.sqrt(max(1.0, found.level.ratio))
    point = Reduced(run, seen.misfit(missed), fields, held, weights).evaluate(found.x)
    posterior = Posterior(point, min_eigenvalue=0.0)
    moved, fitted, notes = np.zeros(len(found.x)), point.state.data, list[str]()
    if finer:
        try:
            moved, fitted = _finer(model, retracted, point, posterior)
        except (InputError, SolverError) as error:
            notes.append(f"intervals are without the error of elements, of which finer ones give none: {error}")
    off = np.sqrt(posterior.variance(np.eye(len(found.x))) + moved**2)
    bands = {
        name: _single(
            CredibleInterval.from_gaussian((found.x + moved)[place], off[place], fields.unknowns[name].transform, level)
        )
        for name, place in fields.blocks.items()
    }
    parts = [_stiff(t, float(bands[t.region].value)) if t.region in bands else t for t in model.scene.tissues]
    stiff = replace(model.scene, tissues=tuple(parts))
    by = {name: float(np.exp(moved[place])[0]) for name, place in fields.blocks.items()}
    return Calibrated(
        bands,
        stiff,
        fitted,
        found.level,
        by if finer and not notes else None,
        status=found.status,
        history=found.history,
        warnings=notes,
    )


def _finer(model: RetractionModel, retracted: Retracted, point: Point, posterior: Posterior) -> tuple[Array, Array]:
    """How far ln s moves by what finer elements compute there, and what they would compute then, to first order."""
    sizes = {name: size / math.sqrt(2) for name, size in vars(model.scene.mesh).items() if name != "order"}
    scene = replace(model.scene, mesh=replace(model.scene.mesh, **sizes))
    other = Retracted(
        RetractionModel.from_scene(scene, model.head),
        retracted.landmarks,
        retracted.times,
        list(retracted.factors),
        retracted.protocol,
        retracted.grid,
    )
    return defect_correction_step(point, posterior, other.run.evaluate(point.reduced.unknowns.theta(point.x)).data)


def _stiff(tissue: Tissue, factor: float) -> Tissue:
    """With its bulk modulus, as in the search."""
    return replace(tissue.with_scale(factor), bulk_to_shear_ratio=tissue.volume_ratio / factor, poissons_ratio=None)


def _single(band: CredibleInterval) -> CredibleInterval:
    return CredibleInterval(*(float(np.ravel(value)[0]) for value in (band.value, band.deviation, band.low, band.high)))
