"""What an inversion found, and what there is to say of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.adjoint.reduced import Reduced
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.forward.sensitivity.harmonic.wave_model import BOUNDARY
from ngbrain.inverse.data.plausibility import amplitude_notes, tissue_notes, wavelength_notes
from ngbrain.inverse.data.quality import (
    OctahedralShearStrain,
    RelativeNoise,
    map_resolution,
    noise_deviation,
    noise_for_misfit,
    octahedral_shear_strain,
    resonance_distance,
    rms_noise,
)
from ngbrain.inverse.data.ultrasound import is_tracked, map_notes
from ngbrain.inverse.elastography.derived_maps import (
    DERIVED,
    map_statistics,
    maps_from_shear,
    median_shear,
    shear_modulus_map,
    statistics_by_label,
)
from ngbrain.inverse.elastography.identifiability import (
    anti_plane_notes,
    bulk_effect,
    bulk_modulus_note,
    exponent_note,
    fibre_notes,
    fibre_shear_moduli,
    poorly_determined_notes,
    scale_notes,
)
from ngbrain.inverse.elastography.inverse_crime import is_inverse_crime
from ngbrain.inverse.elastography.usability import reasons_against
from ngbrain.inverse.objective.parameters import ParameterFields
from ngbrain.inverse.optimise.result import Iteration, OptimisationResult
from ngbrain.inverse.problem.boundary_data import free_boundary
from ngbrain.inverse.problem.properties import EXPONENT, MODULI
from ngbrain.inverse.problem.property_fields import property_fields
from ngbrain.inverse.problem.wave_problem import ElastographyProblem
from ngbrain.io.waves import WaveData
from ngbrain.look import maps as drawn
from ngbrain.result import Result, Status

Array = np.ndarray


@dataclass
class StartResult:
    """One way of inverting: its maps, misfit and expected misfit, J, what each round did, CPU seconds."""

    name: str
    maps: dict[str, Array]
    misfit: float
    expected: float
    value: float
    history: list[Iteration]
    cpu_s: float
    converged: bool


@dataclass(frozen=True, eq=False)
class FinalState:
    """Where an inversion ended: its problem, at unknowns x."""

    problem: ElastographyProblem
    reduced: Reduced
    x: Array


@dataclass(repr=False, eq=False)
class Inversion(Result):
    """What `invert` found.

    maps        name → (n,) at the points of the data, NaN where they are left out
    predicted   waves of these maps (loads, n, dim), m
    rows        the starts that were tried: "waves", "uniform", "both"
    noise       relative, that the weights of the data stand for; `noise_found` what the misfit says of its rms
    regulariser, weights, determined   which, how strong, and how many numbers of each field the data determine
    resolution  a hint at the finest detail of each map, m (see `quality`)
    strain      octahedral shear strain of the data, and over its noise
    checks      name → number: the data's strain over noise (median), distance of a resonance, misfit over its expected level
    stated      noise relative to the rms as it was given, or as a smooth fit leaves it
    end         where error bars start from (`uncertainty`); None of zones
    """

    data: WaveData
    maps: dict[str, Array]
    predicted: Array
    starts: list[StartResult]
    chosen: str
    noise: RelativeNoise
    noise_found: float
    regulariser: str
    weights: dict[str, float]
    determined: dict[str, float]
    resolution: dict[str, float]
    solves: Solves
    model: dict[str, Any]
    checks: dict[str, float | bool]
    strain: OctahedralShearStrain
    stated: float = np.nan
    final_state: FinalState | None = field(default=None, repr=False)

    @property
    def chosen_start(self) -> StartResult:
        """The start that was kept."""
        return next(row for row in self.starts if row.name == self.chosen)

    @property
    def answers(self) -> dict[str, dict[str, float]]:
        """Of the maps, as in `result.json`."""
        return map_statistics(self.data, self.maps)

    @property
    def reasons(self) -> list[str]:
        """What speaks against using the maps, see `verdict`."""
        return reasons_against(
            self.data, self.maps, self.stated, self.noise_found, self.strain.volume, self.strain.discontinuity_share
        )

    @property
    def value(self) -> dict[str, Array]:
        """The maps."""
        return self.maps

    def plot(self) -> Any:
        """The maps."""
        return drawn(self.data.points, self.maps, MODULI)

    @property
    def headline(self) -> str:
        """Medians of the maps."""
        return ", ".join(f"{name} {of['median']:.4g}" for name, of in self.answers.items())

    @property
    def statistics(self) -> dict[str, float]:
        """Of all starts."""
        return {"iterations": len(self.history), **{name: n for name, n in asdict(self.solves).items() if n}}

    @property
    def by_label(self) -> dict[str, dict[int, dict[str, float]]]:
        """Name of a map, or of what follows from the maps → label → median and IQR; empty without labels."""
        labels = self.data.labels
        if labels is None:
            return {}
        return {
            name: statistics_by_label(values, labels) for name, values in {**self.maps, **self.derived_maps}.items()
        }

    @property
    def derived_maps(self) -> dict[str, Array]:
        """Maps (n,) that follow from those found: of G*, or of μ where there are fibres, and of fibres `fibre_shear_moduli`."""
        return compute_derived_maps(self.data, self.maps)

    def arrays(self) -> dict[str, Array]:
        """Values at the points of the data, by name, SI: the maps, what follows from G*, the waves.

        points, measured, predicted, and residual: measured less predicted over the noise of real and of imaginary parts.
        `magnitude, phase, damping_ratio, stiffness` are those of `maps_from_shear`; along and across fibres they stand for μ alone,
        and `shear_along`, `shear_stretch` (Pa) are what waves tell best (`fibre_shear_moduli`). `oss` and `oss_snr` (loads, n) are
        the data's octahedral shear strain, and over its noise, NaN where a component is not measured.
        """
        measured = np.where(self.data.mask[:, None], self.data.displacement, np.nan)
        residual = (measured - self.predicted) / noise_deviation(self.data, self.noise)
        waves = {"measured": measured, "predicted": self.predicted, "residual": residual}
        strain = {"oss": self.strain.oss, "oss_snr": self.strain.snr}
        return {"points": self.data.points, **self.maps, **self.derived_maps, **waves, **strain}

    def _range(self) -> dict[str, list[float]]:
        if not np.ndim(self.noise):
            return {}
        known = np.asarray(self.noise)[self.data.mask]
        return {"range": [float(known.min()), float(known.max())]}

    def to_dict(self) -> dict[str, Any]:
        """All numbers of it, for JSON."""
        rows = {
            row.name: {
                "misfit": row.misfit,
                "expected_misfit": row.expected,
                "objective": row.value,
                "rounds": len(row.history),
                "cpu_s": row.cpu_s,
                "converged": row.converged,
                "answers": map_statistics(self.data, row.maps),
                "misfit_over_expected": [each.misfit / each.expected for each in row.history],
                "weights": [each.weights for each in row.history],
            }
            for row in self.starts
        }
        fields = property_fields(self.maps, self.data.labels)
        return {
            "status": str(self.status),
            "usable": self.usable,
            "reasons": self.reasons,
            "answers": self.answers,
            "by_label": self.by_label,
            "solves": asdict(self.solves),
            "checks": self.checks,
            "model": {
                **self.model,
                "regulariser": self.regulariser,
                "weights": self.weights,
                "fields": {name: asdict(fields[name]) for name in self.weights if name in fields},
                "determined": self.determined,
                "resolution_mm": {name: 1e3 * length for name, length in self.resolution.items()},
            },
            "noise": {
                "stated": self.stated,
                "assumed": rms_noise(self.data, self.noise),
                "found": self.noise_found,
                **self._range(),
            },
            "starts": rows,
            "chosen": self.chosen,
            "warnings": self.warnings,
        }


def start_result(name: str, problem: ElastographyProblem, reduced: Reduced, found: OptimisationResult) -> StartResult:
    """One way of inverting, by where it ended."""
    unknowns: ParameterFields = reduced.unknowns  # type: ignore[assignment]
    maps = problem.maps(unknowns, found.x)
    maps.pop(EXPONENT, None)
    level, cpu_s = found.level, found.history[-1].cpu_s
    return StartResult(name, maps, level.misfit, level.expected, found.objective, found.history, cpu_s, found.converged)


def build_inversion(
    problem: ElastographyProblem,
    reduced: Reduced,
    best: OptimisationResult,
    rows: list[StartResult],
    chosen: str,
    *,
    noise: RelativeNoise,
    stated: float,
    floor: float,
    regulariser: str,
    weight: str,
    history: list[Iteration],
    notes: list[str],
) -> Inversion:
    """All that follows from the end of the best way; data with less noise than `floor` are fitted as well as elements can."""
    data, unknowns = problem.data, reduced.unknowns
    assert isinstance(unknowns, ParameterFields)
    predicted = np.full(data.displacement.shape, np.nan, complex)
    state = problem.model.evaluate(unknowns.theta(best.x))
    predicted[:, problem.inside] = state.data
    mesh, determined = problem.body.mesh, best.history[-1].determined
    strain, free = octahedral_shear_strain(data, noise), free_boundary(mesh)
    checks = {
        "misfit_over_expected": best.level.ratio,
        "converged": bool(best.converged),
        "strain_snr": strain.median,
        "resonance_distance": resonance_distance(data, state.factors),
    }
    ratio = best.level.ratio
    notes[:0] = convergence_notes(best)
    notes += misfit_notes(ratio, rms_noise(data, noise), floor)
    maps = problem.maps(unknowns, best.x)
    of_plane, combined = fibre_notes(data, maps)
    notes += poorly_determined_notes(determined) + of_plane
    crime = is_inverse_crime(data, problem.body)
    if crime:
        notes.append(
            "the data were computed in the elements that invert them: errors flatter, the more the less noise there is"
        )
    with problem.model.solves.spent_on("checks"):
        mismatch = _mismatch(problem)
        if problem.body.bulk is not None:
            effect = bulk_effect(problem, unknowns.theta(best.x), noise)
            checks["bulk_change_over_noise"] = effect
            notes.append(bulk_modulus_note(effect))
    median = median_shear(data, maps)
    notes += [
        *scale_notes(data),
        *wavelength_notes(data, median),
        *tissue_notes(data, median),
        *amplitude_notes(data),
    ]
    if data.motion == "anti_plane":
        moved = problem.model.boundary_values(unknowns.theta(best.x))[:, -1] if problem.body.translation else None
        notes += anti_plane_notes(data, moved)
    if is_tracked(data):
        notes += map_notes(data, maps["youngs"])
    if EXPONENT in maps:
        power = float(np.nanmedian(maps.pop(EXPONENT)))
        checks[EXPONENT] = power
        notes.append(exponent_note(data, power))
    return Inversion(
        data=data,
        maps=maps,
        predicted=predicted,
        starts=rows,
        chosen=chosen,
        noise=noise,
        noise_found=rms_noise(data, noise_for_misfit(data, noise, ratio)),
        regulariser=regulariser,
        weights=best.weights,
        determined=determined,
        resolution=map_resolution(ngs.Integrate(ngs.CF(1), mesh), data.dim, determined),
        solves=problem.model.solves,
        history=history,
        model={
            "form": problem.elements.form,
            "n_elements": mesh.ne,
            "n_unknowns": problem.body.fes.ndof,
            "n_parameters": sum(q.stop - q.start for name, q in unknowns.blocks.items() if name != BOUNDARY),
            "inverse_crime": crime,
            "weight": weight,
            **({"free_boundary": free} if free else {}),
            **({"errors_of_moduli": combined} if combined else {}),
            **mismatch,
        },
        checks={name: value for name, value in checks.items() if value is not None},
        strain=strain,
        stated=stated,
        warnings=notes + ([strain.note] if strain.note else []),
        status=best.status,
        final_state=FinalState(problem, reduced, best.x),
    )


def compute_derived_maps(data: WaveData, maps: Mapping[str, Array]) -> dict[str, Array]:
    """What follows from maps that an inversion gives, see `Inversion.following`."""
    modulus = maps_from_shear(shear_modulus_map(data, maps))
    return {**fibre_shear_moduli(maps), **{name: modulus[name] for name in DERIVED}}


def convergence_notes(found: OptimisationResult) -> list[str]:
    """That an inversion stopped before it had settled, and where its misfit is against its expected level."""
    if found.converged:
        return []
    number, level = len(found.history), found.level
    why = "no step lowered the objective any more" if found.status is Status.STALLED else "more may change the maps"
    return [
        f"stopped after {number} round{'s' if number > 1 else ''}, before fields and weights had settled ({why}): "
        f"the misfit is {level.misfit:.4g}, expected are {level.expected:.4g}"
    ]


def misfit_notes(ratio: float, noise: float, floor: float) -> list[str]:
    """What a misfit far from where it is expected means; data with less noise than `floor` are fitted as well as elements can."""
    if ratio > 1.25 or (ratio < 0.8 and noise > floor):
        return [f"the misfit is {ratio:.2f} times what noise of {100 * noise:.3g} % leaves: it is not that"]
    return []


def _mismatch(problem: ElastographyProblem) -> dict[str, float]:
    """How far our waves of the true properties are off the data, where the truth is known."""
    waves = problem.predict_from_truth()
    if waves is None:
        return {}
    off = np.nan_to_num(waves - problem.measured)
    return {"mismatch_at_truth": float(np.linalg.norm(off) / np.linalg.norm(np.nan_to_num(problem.measured)))}
