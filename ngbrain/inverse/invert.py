"""The inversion of wave data from one call: noise, elements, starts, regularisers and weights are chosen and told.

start      fields from measured waves (`GaussNewton.from_waves`): every round a linear least-squares problem
regulariser  smooth fields, or fields with edges: the one with the smaller generalised cross-validation score
polish     down in J from there; and from uniform fields, for comparison. The lower J at equal weights is kept
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import ConvergenceError, InputError, SolverError, nearest
from ngbrain.forward.sensitivity import BOUNDARY, Solves
from ngbrain.inverse.answers import answers, by_label, derived
from ngbrain.inverse.crime import committed
from ngbrain.inverse.discretise import Discretisation, as_made, in_elements
from ngbrain.inverse.experiment import Experiment
from ngbrain.inverse.found import Found, Iteration
from ngbrain.inverse.gauss_newton import GaussNewton
from ngbrain.inverse.misfit import LeastSquares
from ngbrain.inverse.parameters import Fields
from ngbrain.inverse.quality import median_strain_snr, noise_level, noise_of, resolution, resonance_distance
from ngbrain.inverse.regularise import smooth, total_variation
from ngbrain.inverse.weights import Level
from ngbrain.io.waves import WaveData

Array = np.ndarray
REGULARISERS = ("smooth", "edges")
FIRST = 1e3
"""Weight to begin with; it settles where the data say."""
FAR = 1e4
"""The same from uniform fields: larger, as a far start has to see the whole first."""
EDGE = 0.1
"""Length of an edge, see `total_variation`, as a share of the body."""
FLOOR = 1e-5
"""Noise, relative to the waves' rms, below which data count as exact."""
LEVELS = 8
CLOSE = 0.15
BEYOND = 1.3
"""How often a level of noise that was not given is corrected by what the misfit says, and when (in ln) it agrees; one that was
given is raised when the misfit says this many times more, and never lowered."""
FEW = 5
"""Where the data determine fewer numbers of a field, its map is hardly more than uniform."""
SHORT = 12
"""Rounds from uniform fields: enough to arrive, or to be stuck."""
EASY = 1e-4
"""Noise that is assumed at least from there: with less, linear theory sees little of the way."""


@dataclass
class Row:
    """One way of inverting: its maps, misfit and expected misfit, J, what each round did, CPU seconds."""

    name: str
    maps: dict[str, Array]
    misfit: float
    expected: float
    value: float
    history: list[Iteration]
    cpu_s: float
    converged: bool


@dataclass
class Inversion:
    """What `invert` found.

    maps        name → (n,) at the points of the data, NaN where they are left out
    predicted   waves of these maps (loads, n, dim), m
    rows        the starts that were tried: "waves", "uniform", "both"
    noise       relative, that the weights of the data stand for; `noise_found` what the misfit says
    regulariser, weights, determined   which, how strong, and how many numbers of each field the data determine
    resolution  a hint at the finest detail of each map, m (see `quality`)
    checks      name → number: the data's strain over noise, distance of a resonance, misfit over its expected level
    notes       what a reader has to know, in words
    """

    data: WaveData
    maps: dict[str, Array]
    predicted: Array
    rows: list[Row]
    chosen: str
    noise: float
    noise_found: float
    regulariser: str
    weights: dict[str, float]
    determined: dict[str, float]
    resolution: dict[str, float]
    solves: Solves
    history: list[Iteration]
    model: dict[str, Any]
    checks: dict[str, float | bool]
    notes: list[str] = field(default_factory=list)

    @property
    def answers(self) -> dict[str, dict[str, float]]:
        """Of the maps, as in `result.json`."""
        return answers(self.data, self.maps)

    @property
    def by_label(self) -> dict[str, dict[int, dict[str, float]]]:
        """Name of a map → label → median and IQR; empty without labels."""
        labels = self.data.labels
        return {} if labels is None else {name: by_label(values, labels) for name, values in self.maps.items()}

    def arrays(self) -> dict[str, Array]:
        """Values at the points of the data, by name, SI: the maps, what follows from G*, the waves.

        points, measured, predicted, and residual: measured less predicted over the noise of real and of imaginary parts.
        `magnitude, phase, damping_ratio, stiffness` are those of `derived`; along and across fibres they stand for μ alone.
        """
        modulus = derived(self._shear())
        follows = {name: modulus[name] for name in ("magnitude", "phase", "damping_ratio", "stiffness")}
        measured = np.where(self.data.mask[:, None], self.data.displacement, np.nan)
        residual = (measured - self.predicted) / noise_of(self.data, self.noise)
        waves = {"measured": measured, "predicted": self.predicted, "residual": residual}
        return {"points": self.data.points, **self.maps, **follows, **waves}

    def _shear(self) -> Array:
        if "storage" in self.maps:
            return self.maps["storage"] + 1j * self.maps["loss"]
        return np.real(self.maps["mu"] if "mu" in self.maps else self.data.shear_of(self.maps["youngs"]))

    def result(self) -> dict[str, Any]:
        """All numbers of it, for JSON."""
        rows = {
            row.name: {
                "misfit": row.misfit,
                "expected_misfit": row.expected,
                "objective": row.value,
                "rounds": len(row.history),
                "cpu_s": row.cpu_s,
                "converged": row.converged,
                "answers": answers(self.data, row.maps),
                "misfit_over_expected": [each.misfit / each.expected for each in row.history],
                "weights": [each.weights for each in row.history],
            }
            for row in self.rows
        }
        return {
            "answers": self.answers,
            "by_label": self.by_label,
            "solves": asdict(self.solves),
            "checks": self.checks,
            "model": {
                **self.model,
                "regulariser": self.regulariser,
                "weights": self.weights,
                "determined": self.determined,
                "resolution_mm": {name: 1e3 * length for name, length in self.resolution.items()},
            },
            "noise": {"assumed": self.noise, "found": self.noise_found},
            "starts": rows,
            "chosen": self.chosen,
            "notes": self.notes,
        }


def invert(
    data: WaveData,
    elements: Discretisation | None = None,
    *,
    noise: float | None = None,
    model_error: float = 0.0,
    regulariser: str = "auto",
    uniform: bool = True,
    tell: Callable[[Iteration], None] = lambda _: None,
) -> Inversion:
    """Property maps of plane wave data.

    elements     see `discretise`; by default those that the data were made in, if they say so, else our own
    noise        relative to the rms of each component; by default what the data say, or what a smooth fit leaves over
    model_error  of the same kind: what the model cannot fit, such as another discretisation
    regulariser  smooth, edges, or auto: the better by cross-validation
    uniform      whether to try uniform fields as a start too

    Raises `InputError` for a regulariser that is none, negative noise, data that cannot be inverted.

    >>> import numpy as np
    >>> grid = np.array([[x, y] for y in range(12) for x in range(12)]) * 4e-3
    >>> k = 2 * np.pi * 60 * np.sqrt(1000 / (2500 + 500j))
    >>> u = 1e-5 * np.stack([np.exp(-1j * k * grid[:, 1]), np.exp(-1j * k * grid[:, 0])], axis=1)[None]
    >>> data = WaveData(grid, u, [60.0], 1000.0, "isotropic", "viscoelastic", poisson=0.4).with_noise(0.01, seed=0)
    >>> found = invert(data, uniform=False)
    >>> bool(abs(np.median(found.maps["storage"]) / 2500 - 1) < 0.03)
    True
    """
    if regulariser not in ("auto", *REGULARISERS):
        raise InputError("regulariser", repr(regulariser), nearest(regulariser, ("auto", *REGULARISERS)))
    for name, value in (("noise", noise), ("model_error", model_error)):
        if value is not None and not 0 <= value < np.inf:
            raise InputError(name, value, "a relative level of at least 0")
    notes: list[str] = []
    if elements is None:
        elements = as_made(data) if data.element else in_elements(data)
    level, note = noise_level(data, noise)
    notes += [note] if note else []
    total = max(float(np.hypot(level, model_error)), FLOOR)
    experiment = Experiment(data, elements)
    search = _Search(experiment, total, tell)
    tried = {name: search.from_waves(name) for name in (REGULARISERS if regulariser == "auto" else (regulariser,))}
    kind = min(tried, key=lambda name: tried[name][1].cross_validation)
    problem, start = tried[kind]
    both = search.descend(problem, start)
    for _ in range(LEVELS):
        found = max(total * float(np.sqrt(both.level.ratio)), FLOOR)
        if abs(np.log(found / total)) < CLOSE or (not note and found < total * BEYOND):
            break
        if not note:
            note = f"the misfit is {both.level.ratio:.3g} times what noise of {100 * total:.3g} % leaves"
            notes.append(f"{note}: the rest counts as model error")
        before = both.x if found < total else None  # what was fitted too closely is no start
        total = found
        search = _Search(experiment, total, tell, search)
        problem, start = search.from_waves(kind, before)
        both = search.descend(problem, start)
    rows = [search.row("waves", problem, start)]
    best, chosen = both, "both"
    if uniform:
        far = search.uniform(kind, problem)
        if far is not None:
            rows.append(search.row("uniform", problem, far))
            if far.value < both.value * (1 - 1e-6):
                best, chosen = far, "uniform"
                notes.append("uniform fields led to a lower objective than measured waves did")
        else:
            notes.append("from uniform fields no step lowered the objective")
    rows.append(search.row("both", problem, both))
    predicted = np.full(data.displacement.shape, np.nan, complex)
    state = experiment.model.at(problem.unknowns.theta(best.x))
    predicted[:, experiment.inside] = state.data
    mesh, determined = experiment.body.mesh, best.history[-1].determined
    checks = {
        "misfit_over_expected": best.level.ratio,
        "converged": bool(best.converged),
        "strain_snr": median_strain_snr(data, total),
        "resonance_distance": resonance_distance(data, state.factors),
    }
    ratio = best.level.ratio
    if not 0.8 < ratio < 1.25 and total > FLOOR:
        notes.append(f"the misfit is {ratio:.2f} times what noise of {100 * total:.3g} % leaves: it is not that")
    for name, number in determined.items():
        if number < FEW:
            notes.append(
                f"the data determine only {number:.1f} numbers of {name}: no detail of its map is to be believed"
            )
    crime = committed(data, experiment.body)
    if crime:
        notes.append(
            "the data were computed in the elements that invert them: errors flatter, the more the less noise there is"
        )
    notes += _unseen(experiment)
    return Inversion(
        data=data,
        maps=search.maps(problem, best),
        predicted=predicted,
        rows=rows,
        chosen=chosen,
        noise=total,
        noise_found=total * float(np.sqrt(ratio)),
        regulariser=kind,
        weights=best.weights,
        determined=determined,
        resolution=resolution(ngs.Integrate(ngs.CF(1), mesh), data.dim, determined),
        solves=experiment.model.solves,
        history=search.history,
        model={
            "form": elements.form,
            "n_elements": mesh.ne,
            "n_unknowns": experiment.body.fes.ndof,
            "n_parameters": sum(q.stop - q.start for name, q in problem.unknowns.blocks.items() if name != BOUNDARY),
            "inverse_crime": crime,
            **_mismatch(experiment),
        },
        checks={name: value for name, value in checks.items() if value is not None},
        notes=notes,
    )


class _Search:
    """Runs of one experiment from several starts and with several regularisers."""

    def __init__(
        self, experiment: Experiment, noise: float, tell: Callable[[Iteration], None], before: _Search | None = None
    ) -> None:
        self.experiment, self.noise, self._tell = experiment, noise, tell
        self.history: list[Iteration] = before.history if before else []
        self.sigma = noise_of(experiment.data, noise)
        self.unknowns = experiment.unknowns(self.sigma)
        self.misfit = LeastSquares(experiment.measured, self.sigma)

    def problem(self, kind: str) -> Reduced:
        """With a regulariser, at the first weight."""
        experiment, unknowns, regularisers = self.experiment, self.unknowns, {}
        points = experiment.model.points
        extent = float(np.max(np.ptp(points, axis=0)))
        for quantity in experiment.sought:
            reference = unknowns.start[unknowns.blocks[quantity.name]]
            regularisers[quantity.name] = (
                smooth(experiment.space, reference)
                if kind == "smooth"
                else total_variation(experiment.space, reference, EDGE * extent)
            )
        return Reduced(experiment.model, self.misfit, unknowns, regularisers, dict.fromkeys(regularisers, FIRST))

    def from_waves(self, kind: str, x: Array | None = None) -> tuple[Reduced, Found]:
        """From measured waves, and the fields of other unknowns x if there are any."""
        problem, start = self.problem(kind), self.unknowns.start.copy()
        if x is not None:
            fields = self.unknowns.blocks[BOUNDARY].start
            start[:fields] = x[:fields]
        return problem, self._newton(problem).from_waves(start, self.experiment.waves)

    def descend(self, problem: Reduced, start: Found) -> Found:
        """Down in J from a start, or the start itself where nothing is lower."""
        try:
            return self._newton(problem).descend(start.x)
        except ConvergenceError:
            point = problem.at(start.x)
            return replace(start, value=point.value, level=Level(2 * point.misfit, start.level.expected))

    def uniform(self, kind: str, judge: Reduced) -> Found | None:
        """From uniform fields, at weights of its own and noise of `EASY` at least; misfit and J are those of `judge`."""
        easy = self if self.noise >= EASY else _Search(self.experiment, EASY, self._tell, self)
        problem = easy.problem(kind)
        problem.weights = dict.fromkeys(problem.weights, FAR)
        try:
            found = easy._newton(problem).descend(easy.unknowns.start, SHORT)
        except SolverError:
            return None
        held = easy.unknowns.theta(found.x)[self.experiment.model.blocks[BOUNDARY]]
        x = found.x.copy()
        x[self.unknowns.blocks[BOUNDARY]] = self.unknowns.unknowns[BOUNDARY].transform.inverse(held)
        point = judge.at(x)
        return replace(found, x=x, value=point.value, level=Level(2 * point.misfit, found.level.expected))

    def row(self, name: str, problem: Reduced, found: Found) -> Row:
        last = found.history[-1]
        return Row(
            name,
            self.maps(problem, found),
            found.level.misfit,
            found.level.expected,
            found.value,
            found.history,
            last.cpu_s,
            found.converged,
        )

    def maps(self, problem: Reduced, found: Found) -> dict[str, Array]:
        unknowns: Fields = problem.unknowns  # type: ignore[assignment]
        return self.experiment.maps(unknowns, found.x)

    def _newton(self, problem: Reduced) -> GaussNewton:
        def tell(iteration: Iteration) -> None:
            self.history.append(iteration)
            self._tell(iteration)

        return GaussNewton(problem, tell=tell)


def _unseen(experiment: Experiment) -> list[str]:
    """Directions that the data cannot see, whatever their noise."""
    if np.any(experiment.data.frequency > 0) or experiment.data.bulk is not None:
        return []
    return ["all loads are quasi-static and only displacements are known: moduli are right up to one common factor"]


def _mismatch(experiment: Experiment) -> dict[str, float]:
    """How far our waves of the true properties are off the data, where the truth is known."""
    waves = experiment.of_truth()
    if waves is None:
        return {}
    off = np.nan_to_num(waves - experiment.measured)
    return {"mismatch_at_truth": float(np.linalg.norm(off) / np.linalg.norm(np.nan_to_num(experiment.measured)))}
