"""What waves cannot tell, whatever is done with them, and what the answer therefore rests on: sentences for its notes.

bulk    waves of shear hardly move with the bulk modulus K: at K/G = 100 ten per cent of it is 0.2 % of them. It is given, never
        looked for; how much it matters is measured by one more wave.
scale   at rest, driven by displacements alone, a body moves alike for all moduli times any number; a bulk modulus that is known
        tells that number only where it is compressed and all components are measured
fibres  in plane strain near K/μ → ∞ the energy knows μ(1+φ), of shear along fibres, and μ(1+ζ), of stretch along them, alone:
        c₁₁ + c₂₂ - 2c₁₂ = 4μ(1+ζ), c₄₄ = μ(1+φ). What μ itself is, compression along fibres has to tell.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ngbrain.inverse.data.quality import RelativeNoise, noise_deviation
from ngbrain.inverse.elastography.derived_maps import relative_l2_error
from ngbrain.inverse.problem.discretisation import has_unknown_scale, measures_all_components
from ngbrain.inverse.problem.wave_problem import ElastographyProblem
from ngbrain.io.waves import WaveData

Array = np.ndarray
STIFFER = 0.1
"""Share of the bulk modulus by which it is changed to see whether that matters."""
FLAT = "a component is never measured, all loads are quasi-static: what is stiff comes out too soft beside its surroundings"
FEW = 5
"""Where the data determine fewer numbers of a field, its map is hardly more than uniform."""


def bulk_effect(problem: ElastographyProblem, theta: Array, noise: RelativeNoise) -> float:
    """How far waves move with `STIFFER` more of the bulk modulus, over their noise (rms); one factorisation a frequency.

    theta   of `problem.model`
    noise   relative, as `noise_deviation` takes it
    """
    before = problem.model.evaluate(theta).data
    try:
        problem.bulk_factor.Set(1 + STIFFER)
        moved = problem.model.evaluate(theta).data - before
    finally:
        problem.bulk_factor.Set(1.0)
    sigma = noise_deviation(problem.data, noise, problem.inside)
    return float(np.sqrt(np.mean(np.abs(moved / (np.sqrt(2) * sigma)) ** 2)))


def bulk_modulus_note(effect: float) -> str:
    """What `bulk_effect` means."""
    moves = f"{100 * STIFFER:.0f} % more of the bulk modulus moves the waves by {effect:.2g} times their noise"
    if effect < 1:
        return f"{moves}: they do not tell it, it is taken as given, and an error in it does little harm"
    return f"{moves}: it is taken as given, and an error in it is an error of the maps"


def scale_notes(data: WaveData) -> list[str]:
    """Whether all moduli may be off by one factor, and their contrast too low."""
    if not has_unknown_scale(data):
        return []
    notes = [
        "all loads are quasi-static and only displacements are known: moduli are right up to one common factor, "
        "and errors are without it"
    ]
    if not measures_all_components(data):
        notes.append(FLAT)
    return notes


def anti_plane_notes(data: WaveData, translations: np.ndarray | None) -> list[str]:
    """What motion through a plane tells, and what it does not; `translations` (loads,) m, complex, where some were looked for."""
    notes = [
        "anti-plane shear takes tissue and waves as the same through the slice: a wave at an angle t to it reads as G/cos²t "
        "(1.33 times at 30 degrees), so that these are apparent moduli; and they go with the square of the pixels' size, which is "
        "taken as given"
    ]
    if translations is not None:
        size = ", ".join(f"{1e6 * each:.3g}" for each in np.abs(translations))
        notes.append(
            "a uniform displacement of the slice is an unknown of each wave, as motion of the whole head that was subtracted and "
            f"phases that are known up to 2π leave it out: {size} µm were found"
        )
    return notes


def exponent_note(data: WaveData, exponent: float) -> str:
    """What an exponent of frequency means."""
    low, high = data.frequency.min(), data.frequency.max()
    return (
        f"the maps are those of {low:g} Hz: G* goes with frequency to the power {exponent:.3g}, the same everywhere "
        f"({(high / low) ** exponent:.3g} times as much at {high:g} Hz)"
    )


def poorly_determined_notes(determined: dict[str, float]) -> list[str]:
    """Fields of which the data determine next to nothing."""
    few = {name: number for name, number in determined.items() if number < FEW}
    return [
        f"the data determine only {few[name]:.1f} numbers of {name}: no detail of its map is to be believed"
        for name in few
    ]


def fibre_shear_moduli(maps: Mapping[str, Array]) -> dict[str, Array]:
    """The two moduli of shear in a plane of fibres (Pa): `shear_along` μ(1+φ) and `shear_stretch` μ(1+ζ); none without fibres.

    >>> found = fibre_shear_moduli({"mu": np.array([2e3]), "zeta": np.array([0.5]), "phi": np.array([0.2])})
    >>> float(found["shear_along"][0]), float(found["shear_stretch"][0])
    (2400.0, 3000.0)
    """
    mu = maps.get("mu", maps.get("storage"))
    if mu is None or not {"zeta", "phi"} <= set(maps):
        return {}
    return {"shear_along": mu * (1 + maps["phi"]), "shear_stretch": mu * (1 + maps["zeta"])}


def fibre_notes(data: WaveData, maps: dict[str, Array]) -> tuple[list[str], dict[str, float]]:
    """What can be believed of maps of a body with fibres; errors of `fibre_shear_moduli` where the truth is known."""
    found = fibre_shear_moduli(maps)
    if not found:
        return [], {}
    truth = fibre_shear_moduli({name: np.real(values) for name, values in data.truth_views.items()})
    errors = {
        name: relative_l2_error(values[data.mask], truth[name][data.mask]) for name, values in found.items() if truth
    }
    known = "".join(f", off by {100 * errors[name]:.2g} %" if errors else "" for name in found)
    return [
        "in a plane of fibres waves tell the shear moduli mu (1 + phi) and mu (1 + zeta); how they part into mu, zeta and "
        "phi only the bulk modulus tells: trust shear_along and shear_stretch first" + known
    ], errors
