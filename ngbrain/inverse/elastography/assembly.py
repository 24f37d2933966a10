"""The assembly of an inversion's result: maps of each start, checks, and notes on noise, misfit and identifiability."""

from __future__ import annotations

import ngsolve as ngs
import numpy as np

from ngbrain.adjoint.reduced import Reduced
from ngbrain.forward.sensitivity.harmonic.wave_model import BOUNDARY
from ngbrain.inverse.data.plausibility import amplitude_notes, tissue_notes, wavelength_notes
from ngbrain.inverse.data.quality import (
    RelativeNoise,
    map_resolution,
    noise_for_misfit,
    octahedral_shear_strain,
    resonance_distance,
    rms_noise,
)
from ngbrain.inverse.data.ultrasound import is_tracked, map_notes
from ngbrain.inverse.elastography.derived_maps import (
    median_shear,
)
from ngbrain.inverse.elastography.identifiability import (
    anti_plane_notes,
    bulk_effect,
    bulk_modulus_note,
    exponent_note,
    fibre_notes,
    poorly_determined_notes,
    scale_notes,
)
from ngbrain.inverse.elastography.inverse_crime import is_inverse_crime
from ngbrain.inverse.elastography.result import FinalState, Inversion, StartResult
from ngbrain.inverse.objective.parameters import ParameterFields
from ngbrain.inverse.optimise.result import Iteration, OptimisationResult
from ngbrain.inverse.problem.boundary_data import free_boundary
from ngbrain.inverse.problem.properties import EXPONENT
from ngbrain.inverse.problem.wave_problem import ElastographyProblem
from ngbrain.result import Status

Array = np.ndarray


def start_result(name: str, problem: ElastographyProblem, reduced: Reduced, found: OptimisationResult) -> StartResult:
    """Return the result from one start.

    Parameters
    ----------
    name : str
        Name of the start.
    problem : ElastographyProblem
        The inverse problem.
    reduced : Reduced
        Its objective.
    found : OptimisationResult
        Where the optimisation ended.

    Returns
    -------
    StartResult
        Maps and misfit.
    """
    unknowns: ParameterFields = reduced.unknowns  # type: ignore[assignment]
    maps = problem.maps(unknowns, found.x)
    maps.pop(EXPONENT, None)
    level, cpu_s = found.level, found.history[-1].cpu_s
    return StartResult(name, maps, level.misfit, level.expected, found.objective, found.history, cpu_s, found.converged)


def build_inversion(
    problem: ElastographyProblem,
    reduced: Reduced,
    best: OptimisationResult,
    starts: list[StartResult],
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
    """Build the result of an inversion from the chosen start.

    Parameters
    ----------
    problem : ElastographyProblem
        The inverse problem.
    reduced : Reduced
        Its objective.
    best : OptimisationResult
        The chosen start.
    starts : list of StartResult
        All starts.
    chosen : str
        Name of the chosen start.
    noise : RelativeNoise
        Noise that the weights of the data stand for.
    stated : float
        Relative noise as given.
    floor : float
        Least relative noise: with less, the data are fitted as closely as the elements allow.
    regulariser, weight : str
        Their names.
    history : list of Iteration
        Iterations of all starts.
    notes : list of str
        Warnings so far.

    Returns
    -------
    Inversion
        Maps, checks and warnings.
    """
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
            "inverse crime, the data were computed in the elements of the inversion: errors are too optimistic, the more so the "
            "lower the noise"
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
        notes += anti_plane_notes(moved)
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
        starts=starts,
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


def convergence_notes(found: OptimisationResult) -> list[str]:
    """Return a note where an inversion stopped before it converged, with its misfit and the expected value."""
    if found.converged:
        return []
    number, level = len(found.history), found.level
    why = (
        "no step lowered the objective further"
        if found.status is Status.STALLED
        else "more iterations may change the maps"
    )
    return [
        f"stopped after {number} iteration{'s' if number > 1 else ''}, before fields and weights converged ({why}): "
        f"the misfit is {level.misfit:.4g}, its expected value {level.expected:.4g}"
    ]


def misfit_notes(ratio: float, noise: float, floor: float) -> list[str]:
    """Return a note where the misfit is far from its expected value.

    Parameters
    ----------
    ratio : float
        Misfit over its expected value.
    noise : float
        Relative noise.
    floor : float
        Least relative noise: with less, the data are fitted as closely as the elements allow.

    Returns
    -------
    list of str
        The note, or nothing.
    """
    if ratio > 1.25 or (ratio < 0.8 and noise > floor):
        return [
            f"the misfit is {ratio:.2f} times its expected value for noise of {100 * noise:.3g} %: the noise has another size"
        ]
    return []


def _mismatch(problem: ElastographyProblem) -> dict[str, float]:
    """Relative distance of the predicted waves of the true properties from the data, where the truth is known."""
    waves = problem.predict_from_truth()
    if waves is None:
        return {}
    off = np.nan_to_num(waves - problem.measured)
    return {"mismatch_at_truth": float(np.linalg.norm(off) / np.linalg.norm(np.nan_to_num(problem.measured)))}
