"""The inversion of wave data from one call: noise, elements, starts, regularisers and weights are chosen and told.

start      fields from measured waves (`GaussNewton.from_waves`): every round a linear least-squares problem
regulariser  smooth fields, or fields with edges: the one with the smaller generalised cross-validation score (`priors`)
weight     settles as the fields do, or is the corner of an L-curve (`weighting`)
polish     down in J from there; and from uniform fields of one level or several. The lower J at equal weights is kept
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import ConvergenceError, InputError, SolverError
from ngbrain.forward.sensitivity import BOUNDARY, Solves
from ngbrain.inverse.answers import answers, by_label, derived
from ngbrain.inverse.crime import committed
from ngbrain.inverse.discretise import Discretisation, as_made, in_elements
from ngbrain.inverse.experiment import Experiment
from ngbrain.inverse.found import Found, Iteration
from ngbrain.inverse.misfit import LeastSquares
from ngbrain.inverse.parameters import Fields
from ngbrain.inverse.priors import PRIORS, Prior, priors
from ngbrain.inverse.quality import median_strain_snr, noise_level, noise_of, resolution, resonance_distance
from ngbrain.inverse.unseen import bulk_effect, moduli_of_fibres, of_bulk, of_few, of_fibres, of_scale
from ngbrain.inverse.weighting import Settling, weighting
from ngbrain.inverse.weights import Level
from ngbrain.io.waves import WaveData

Array = np.ndarray
REGULARISERS = tuple(PRIORS)
FIRST = 1e3
"""Weight to begin with; it settles where the data say."""
FAR = 1e4
"""The same from uniform fields: larger, as a far start has to see the whole first."""
FLOOR = 1e-5
"""Noise, relative to the waves' rms, below which data count as exact."""
OURS = 2e-3
"""The same in elements of our own: below it fields fit the error of the elements, by wiggles at the edges. At 41 points across
two waves that error is .02 to .05 % of the waves; a modulus without noise is .4 % off with .2 % assumed, .7 % with .1 %."""
LEVELS = 8
CLOSE = 0.15
BEYOND = 1.3
"""How often a level of noise that was not given is corrected by what the misfit says, and when (in ln) it agrees; one that was
given is raised when the misfit says this many times more, and never lowered."""
ASTRAY = 100.0
"""Times its expected level that the misfit of a start's fields is, beyond which its level of noise is corrected before any way
down: nearly exact data are seen from afar first, as those of ten times the noise are, then closer and closer."""
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
        `magnitude, phase, damping_ratio, stiffness` are those of `derived`; along and across fibres they stand for μ alone,
        and `shear_along`, `shear_stretch` (Pa) are what waves tell best (`moduli_of_fibres`).
        """
        modulus = derived(self._shear())
        follows = {name: modulus[name] for name in ("magnitude", "phase", "damping_ratio", "stiffness")}
        measured = np.where(self.data.mask[:, None], self.data.displacement, np.nan)
        residual = (measured - self.predicted) / noise_of(self.data, self.noise)
        waves = {"measured": measured, "predicted": self.predicted, "residual": residual}
        return {"points": self.data.points, **self.maps, **moduli_of_fibres(self.maps), **follows, **waves}

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
    regulariser: str | Prior = "auto",
    weight: str = "evidence",
    uniform: bool = True,
    levels: Sequence[float] = (1.0,),
    tell: Callable[[Iteration], None] = lambda _: None,
) -> Inversion:
    """Property maps of plane wave data.

    elements     see `discretise`; by default those that the data were made in, if they say so, else our own
    noise        relative to the rms of each component; by default what the data say, or what a smooth fit leaves over
    model_error  of the same kind: what the model cannot fit, such as another discretisation
    regulariser  one of `priors.PRIORS`, a prior of one's own, or auto: smooth or edges, the better by cross-validation
    weight       one of `weighting.WEIGHTINGS`: evidence, discrepancy or l-curve
    uniform      whether to try uniform fields as a start too
    levels       where these start, as multiples of the modulus that the waves suggest; the lowest J is kept

    Raises `InputError` for a regulariser or weight that is none, negative noise, data that cannot be inverted.

    >>> import numpy as np
    >>> grid = np.array([[x, y] for y in range(12) for x in range(12)]) * 4e-3
    >>> k = 2 * np.pi * 60 * np.sqrt(1000 / (2500 + 500j))
    >>> u = 1e-5 * np.stack([np.exp(-1j * k * grid[:, 1]), np.exp(-1j * k * grid[:, 0])], axis=1)[None]
    >>> data = WaveData(grid, u, [60.0], 1000.0, "isotropic", "viscoelastic", poisson=0.4).with_noise(0.01, seed=0)
    >>> found = invert(data, uniform=False)
    >>> bool(abs(np.median(found.maps["storage"]) / 2500 - 1) < 0.03)
    True
    """
    kinds, settling = priors(regulariser), weighting(weight)
    for name, value in (("noise", noise), ("model_error", model_error)):
        if value is not None and not 0 <= value < np.inf:
            raise InputError(name, value, "a relative level of at least 0")
    if not all(0 < each < np.inf for each in levels):
        raise InputError("levels", list(levels), "positive multiples of the modulus that the waves suggest")
    notes: list[str] = []
    if elements is None:
        elements = as_made(data) if data.element else in_elements(data)
    level, note = noise_level(data, noise)
    notes += [note] if note else []
    floor = FLOOR if elements.nodal else OURS
    total = max(float(np.hypot(level, model_error)), floor)
    experiment = Experiment(data, elements)
    search = _Search(experiment, total, settling, tell)
    tried = {name: search.from_waves(prior) for name, prior in kinds.items()}
    kind = min(tried, key=lambda name: tried[name][1].cross_validation)
    problem, start = tried[kind]
    both = search.descend(problem, start)
    stated = floor if note else total
    for _ in range(LEVELS):
        found = max(total * float(np.sqrt(both.level.ratio)), stated)
        if abs(np.log(found / total)) < CLOSE or (not note and found < total * BEYOND):
            break
        if not note:
            note = f"the misfit is {both.level.ratio:.3g} times what noise of {100 * total:.3g} % leaves"
            notes.append(f"{note}: the rest counts as model error")
        before = both.x if found < total else None  # what was fitted too closely is no start
        total = found
        search = _Search(experiment, total, settling, tell, search)
        problem, start = search.from_waves(kinds[kind], before)
        both = search.descend(problem, start)
    rows = [search.row("waves", problem, start)]
    best, chosen = both, "both"
    if uniform and levels:
        ends = {level: search.uniform(kinds[kind], problem, level) for level in levels}
        arrived = {level: end for level, end in ends.items() if end is not None}
        if arrived:
            least = min(arrived, key=lambda level: arrived[level].value)
            far = arrived[least]
            if len(levels) > 1:
                values = ", ".join(f"{end.value:.5g} from {level:g}" for level, end in arrived.items())
                notes.append(
                    f"uniform fields ended at an objective of {values} times the suggested modulus: the least is shown"
                )
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
    if ratio > 1.25 or (ratio < 0.8 and total > floor):
        notes.append(f"the misfit is {ratio:.2f} times what noise of {100 * total:.3g} % leaves: it is not that")
    maps = search.maps(problem, best)
    of_plane, combined = of_fibres(data, maps)
    notes += of_few(determined) + of_plane
    crime = committed(data, experiment.body)
    if crime:
        notes.append(
            "the data were computed in the elements that invert them: errors flatter, the more the less noise there is"
        )
    effect = bulk_effect(experiment, problem.unknowns.theta(best.x), total)
    notes += [*of_scale(data), of_bulk(effect)]
    checks["bulk_change_over_noise"] = effect
    return Inversion(
        data=data,
        maps=maps,
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
            "weight": weight,
            **({"errors_of_moduli": combined} if combined else {}),
            **_mismatch(experiment),
        },
        checks={name: value for name, value in checks.items() if value is not None},
        notes=notes,
    )


class _Search:
    """Runs of one experiment from several starts and with several regularisers."""

    def __init__(
        self,
        experiment: Experiment,
        noise: float,
        settling: Settling,
        tell: Callable[[Iteration], None],
        before: _Search | None = None,
    ) -> None:
        self.experiment, self.noise, self.settling = experiment, noise, settling
        self.history: list[Iteration] = before.history if before else []
        self._told = tell
        self.sigma = noise_of(experiment.data, noise)
        self.unknowns = experiment.unknowns(self.sigma)
        self.misfit = LeastSquares(experiment.measured, self.sigma)

    def problem(self, prior: Prior) -> Reduced:
        """With a regulariser, at the first weight."""
        space, regularisers = self.experiment.space, {}
        for quantity in self.experiment.sought:
            regularisers[quantity.name] = prior(space, self.unknowns.start[self.unknowns.blocks[quantity.name]])
        weights = dict.fromkeys(regularisers, FIRST)
        return Reduced(self.experiment.model, self.misfit, self.unknowns, regularisers, weights)

    def from_waves(self, prior: Prior, x: Array | None = None) -> tuple[Reduced, Found]:
        """From measured waves, and the fields of other unknowns x if there are any."""
        problem, start = self.problem(prior), self.unknowns.start.copy()
        if x is not None:
            fields = self.unknowns.blocks[BOUNDARY].start
            start[:fields] = x[:fields]
        return problem, self.settling.from_waves(problem, start, self.experiment.waves, self._tell)

    def descend(self, problem: Reduced, start: Found) -> Found:
        """Down in J from a start, or the start itself where nothing is lower or it is `ASTRAY`."""
        point = problem.at(start.x)
        level = Level(2 * point.misfit, start.level.expected)
        if level.ratio < ASTRAY:
            try:
                return self.settling.descend(problem, start.x, self._tell)
            except ConvergenceError:
                pass
        return replace(start, value=point.value, level=level, converged=start.converged and level.ratio < ASTRAY)

    def uniform(self, prior: Prior, judge: Reduced, level: float) -> Found | None:
        """From uniform fields, at weights of its own and noise of `EASY` at least; misfit and J are those of `judge`."""
        easy = self if self.noise >= EASY else _Search(self.experiment, EASY, self.settling, self._told, self)
        problem = easy.problem(prior)
        problem.weights = dict.fromkeys(problem.weights, FAR)
        try:
            found = Settling().descend(problem, self.experiment.uniform(easy.unknowns, level), self._tell, SHORT)
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

    def _tell(self, iteration: Iteration) -> None:
        self.history.append(iteration)
        self._told(iteration)


def _mismatch(experiment: Experiment) -> dict[str, float]:
    """How far our waves of the true properties are off the data, where the truth is known."""
    waves = experiment.of_truth()
    if waves is None:
        return {}
    off = np.nan_to_num(waves - experiment.measured)
    return {"mismatch_at_truth": float(np.linalg.norm(off) / np.linalg.norm(np.nan_to_num(experiment.measured)))}
