"""Calibration of a patient's tissue stiffness from a retraction: displacements of landmarks and the force of the blade.

    minimise  ½ Σ |(d(s) - m)/σ|² + ½ Σ_l (ln s_l / ln r)²      over a factor s_l > 0 for each tissue

s_l multiplies all moduli and viscosities of a tissue, so that its relaxation times stay; r is the spread of published constants. d
is computed by a complete run, with finite strain, contact and viscoelasticity, on the time steps that an adaptive run of the
scene's own tissues has chosen. Gradients are those of the run (`forward.sensitivity.transient`).

Elements that resolve the contact poorly bias the stiffness by more than noise does. The difference to finer elements at s is
subtracted from the data, to first order (`inverse.fitting.defect_correction`), and the resulting change of a factor is added to its
standard deviation: for errors proportional to the square of the element size, the same amount remains.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.adjoint.reduced import LinearisedState, Point, Reduced
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
"""An optimiser of `ngbrain.inverse`: from an objective, a starting point and a rule for the weights to a minimiser."""
SPREAD = 3.0
"""r, the factor by which published moduli of brain differ from one another (one standard deviation)."""


@dataclass(repr=False, eq=False)
class Calibration(Result):
    """Calibrated stiffness factors of tissues.

    Parameters
    ----------
    factors : dict of Band
        Tissue → its factor s with standard deviation and interval. A misfit beyond the noise, for example due to coarse elements,
        counts as additional noise.
    scene : Scene
        The scene with the calibrated tissues; bulk moduli are unchanged.
    fitted : (m, 3n + 1) array
        Computed measurements, as `Observations.data`.
    level : Level
        The misfit and its expected value.
    moved : dict of float, optional
        Tissue → the factor's change by finer elements; None where they were not used.
    """

    factors: dict[str, CredibleInterval]
    scene: Scene
    fitted: Array
    level: MisfitLevel
    moved: dict[str, float] | None = None

    def plot(self) -> Any:
        """The misfit over the iterations."""
        return plot_misfit_history(self.history)

    @property
    def value(self) -> dict[str, CredibleInterval]:
        """The factors."""
        return self.factors

    @property
    def headline(self) -> str:
        """The factors with their intervals."""
        bands = [f"{name} {band.value:.3g} ({band.low:.3g} to {band.high:.3g})" for name, band in self.factors.items()]
        return ", ".join([*bands, f"misfit {self.level.ratio:.3g} times its expected value"])

    @property
    def statistics(self) -> dict[str, float]:
        """Number of iterations."""
        return {"iterations": len(self.history)}


class CalibrationModel:
    """Forward model of a calibration: from tissue factors to landmark displacements and blade force of one protocol.

    `run` is the `RunModel`, `factors` its parameters.

    Parameters
    ----------
    model : RetractionModel
    landmarks : (n, 3) array
        Positions (m) before retraction.
    times : (m,) array
        Times (s) of the measurements.
    tissues : sequence of str, optional
        The `region` of the tissues; by default all, in the order of the scene.
    protocol : int
        Index of the protocol.
    grid : array, optional
        Times (s) of the steps; by default those of an adaptive run of the scene.

    Raises
    ------
    InputError
        A force-controlled blade, friction, times outside the protocol, a landmark outside the mesh, or an unknown tissue.
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
            raise InputError(
                "scene", "with a prescribed force or friction", "a prescribed travel of the blade, without friction"
            )
        if not (np.min(times) > 0 and np.max(times) <= program.times[-1]):
            between = f"{np.min(times):g} to {np.max(times):g} s"
            raise InputError("times", between, f"after 0 and up to {program.times[-1]:g} s, when {program.name} ends")
        if np.any(outside := ~points_in_mesh(model.mesh, landmarks)):
            raise InputError("landmarks", f"{np.sum(outside)} outside of the mesh", "points in the head's tissue")
        names = tissues or [tissue.region for tissue in scene.tissues]
        if mapped := [tissue.region for tissue in scene.tissues if tissue.shear_modulus_map and tissue.region in names]:
            raise InputError(
                "tissues", f"{mapped[0]}, which has a shear_modulus_map", "tissues without a shear_modulus_map"
            )
        model.check_rest()
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
    grid: Array | None = None,
) -> Calibration:
    """Calibrate stiffness factors of a scene's tissues from measurements of one of its protocols.

    A tissue that the data do not determine keeps the factor 1, with an interval given by `spread`.

    Parameters
    ----------
    scene : Scene or RetractionModel
        The operation, with the tissues from which the search starts.
    seen : Observations
        The measurements.
    tissues : sequence of str, optional
        The `region` of the tissues to calibrate; by default all.
    protocol : int
        Index of the protocol that was measured.
    spread : float
        r, the prior standard deviation of a factor, as a factor above 1.
    level : float
        Probability of the intervals.
    start : mapping of float, optional
        Tissue → initial factor (1).
    callback : callable
        Called after every iteration with the present factors, from which another search can start.
    search : callable
        The optimiser, such as `inverse.optimise.quasi_newton.l_bfgs`.
    finer : bool
        Whether to correct for the discretisation error, by one more run on elements 0.7 times as large, and to include it in the
        intervals.
    grid : array, optional
        Times (s) of the steps, as for `CalibrationModel`.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError
        As for `CalibrationModel`.
    ConvergenceError
        No step from the start reduces the objective.

    Examples
    --------
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
    retracted = CalibrationModel(
        model, np.asarray(seen.landmarks, float), np.asarray(seen.times, float), tissues, protocol, grid
    )
    run = retracted.run
    fields = ParameterFields(run.theta, run.blocks, {name: Unknown(1.0, LogTransform()) for name in retracted.factors})
    priors = {name: ridge(fields.start[place]) for name, place in fields.blocks.items()}
    weights = dict.fromkeys(priors, 1 / math.log(spread) ** 2)

    def record(iteration: Iteration) -> None:
        callback(iteration, {name: factor.Get() for name, factor in retracted.factors.items()})

    first = np.log([(start or {}).get(name, 1.0) for name in retracted.factors])
    searched = _LastState(run, seen.misfit(), fields, priors, weights)
    found = search(searched, first, FixedWeights(), record)
    excess = math.sqrt(max(1.0, found.level.ratio))
    point = Point(Reduced(run, seen.misfit(excess), fields, priors, weights), found.x, searched.state_at(found.x))
    posterior = Posterior(point, min_eigenvalue=0.0)
    moved, fitted, notes = np.zeros(len(found.x)), point.state.data, list[str]()
    if finer:
        try:
            moved, fitted = _finer(model, retracted, point, posterior)
        except (InputError, SolverError) as error:
            notes.append(
                f"intervals do not include the discretisation error: the run on finer elements failed ({error})"
            )
    off = np.sqrt(posterior.variance(np.eye(len(found.x))) + moved**2)
    bands = {
        name: _scalar(
            CredibleInterval.from_gaussian((found.x + moved)[place], off[place], fields.unknowns[name].transform, level)
        )
        for name, place in fields.blocks.items()
    }
    parts = [_scaled(t, float(bands[t.region].value)) if t.region in bands else t for t in model.scene.tissues]
    calibrated = replace(model.scene, tissues=tuple(parts))
    by = {name: float(np.exp(moved[place])[0]) for name, place in fields.blocks.items()}
    return Calibration(
        bands,
        calibrated,
        fitted,
        found.level,
        by if finer and not notes else None,
        status=found.status,
        history=found.history,
        warnings=notes,
    )


class _LastState(Reduced):
    """An objective that keeps its last state, which is mostly that of the result: a run with its derivatives is dear."""

    last: Point | None = None

    def evaluate(self, x: Array) -> Point:
        self.last = super().evaluate(x)
        return self.last

    def state_at(self, x: Array) -> LinearisedState:
        """The model linearised at θ(x)."""
        point = self.last
        return point.state if point is not None and np.array_equal(point.x, x) else self.evaluate(x).state


def _finer(
    model: RetractionModel, retracted: CalibrationModel, point: Point, posterior: Posterior
) -> tuple[Array, Array]:
    """Change of ln s due to finer elements, and the measurements that they would give, to first order."""
    scene = replace(model.scene, mesh=model.scene.mesh.with_scale(1 / math.sqrt(2)))
    other = CalibrationModel(
        RetractionModel.from_scene(scene, model.head),
        retracted.landmarks,
        retracted.times,
        list(retracted.factors),
        retracted.protocol,
        retracted.grid,
    )
    return defect_correction_step(point, posterior, other.run.evaluate(point.reduced.unknowns.theta(point.x)).data)


def _scaled(tissue: Tissue, factor: float) -> Tissue:
    """A tissue with another stiffness and the same bulk modulus, as in the search."""
    return replace(tissue.with_scale(factor), bulk_to_shear_ratio=tissue.volume_ratio / factor, poissons_ratio=None)


def _scalar(band: CredibleInterval) -> CredibleInterval:
    """An interval of scalars from one of arrays with a single value."""
    return CredibleInterval(*(float(np.ravel(value)[0]) for value in (band.value, band.deviation, band.low, band.high)))
