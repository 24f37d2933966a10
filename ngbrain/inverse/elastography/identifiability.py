"""What waves cannot determine, whatever the method: sentences for the notes of an inversion.

bulk    Shear waves hardly depend on the bulk modulus K: at K/G = 100, ten per cent of K change them by 0.2 %. K is given, never
        unknown. One more wave computation measures how much it matters.
scale   A quasi-static body that displacements alone drive moves alike for all moduli times any factor. A known bulk modulus
        determines that factor only where it is compressed and all components are measured.
fibres  In plane strain near K/μ → ∞ the energy depends only on μ(1+φ), of shear along fibres, and μ(1+ζ), of stretch
        along them: c₁₁ + c₂₂ - 2c₁₂ = 4μ(1+ζ), c₄₄ = μ(1+φ). Only compression along fibres determines μ itself.
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
"""Relative change of the bulk modulus that shows whether it matters."""
FLAT = "a component is never measured, all loads are quasi-static: stiff regions come out too soft relative to their surroundings"
FEW = 5
"""Where the data determine fewer parameters of a field, its map is hardly more than uniform."""


def bulk_effect(problem: ElastographyProblem, theta: Array, noise: RelativeNoise) -> float:
    """Return the change of the waves with `STIFFER` more of the bulk modulus, over their noise (rms).

    It takes one factorisation a frequency.

    Parameters
    ----------
    problem : ElastographyProblem
        The inverse problem.
    theta : numpy.ndarray
        Parameters of `problem.model`.
    noise : RelativeNoise
        As `noise_deviation` takes it.

    Returns
    -------
    float
        The change.
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
    """Return a sentence on a result of `bulk_effect`."""
    sensitivity = f"a bulk modulus {100 * STIFFER:.0f} % larger changes the waves by {effect:.2g} times their noise"
    if effect < 1:
        return f"{sensitivity}: it is not identifiable and kept fixed; an error in it hardly affects the maps"
    return f"{sensitivity}: it is kept fixed, and an error in it is an error of the maps"


def scale_notes(data: WaveData) -> list[str]:
    """Return notes where all moduli may be off by one factor, and their contrast too low."""
    if not has_unknown_scale(data):
        return []
    notes = [
        "all loads are quasi-static and only displacements are known: moduli are right up to one common factor, "
        "and errors are computed without it"
    ]
    if not measures_all_components(data):
        notes.append(FLAT)
    return notes


def anti_plane_notes(translations: np.ndarray | None) -> list[str]:
    """Return notes on what motion through a plane determines.

    Parameters
    ----------
    translations : numpy.ndarray or None
        (loads,) complex uniform displacements (m) where they are unknowns.

    Returns
    -------
    list of str
        The notes.
    """
    notes = [
        "anti-plane shear assumes tissue and waves that are uniform through the slice: a wave at an angle t to it reads as G/cos²t "
        "(1.33 times at 30 degrees), so these are apparent moduli. They scale with the square of the pixels' size, which is "
        "taken as given"
    ]
    if translations is not None:
        size = ", ".join(f"{1e6 * each:.3g}" for each in np.abs(translations))
        notes.append(
            "a uniform displacement of the slice is an unknown of each wave, because motion of the whole head that was subtracted "
            f"and phases that are known up to 2π remove it: {size} µm were found"
        )
    return notes


def exponent_note(data: WaveData, exponent: float) -> str:
    """Return a sentence on the exponent of frequency.

    Parameters
    ----------
    data : WaveData
        Data of several frequencies.
    exponent : float
        a in G*(ω) = G*(ω₀) (ω/ω₀)^a.

    Returns
    -------
    str
        The sentence.
    """
    low, high = data.frequency.min(), data.frequency.max()
    return (
        f"the maps are those of {low:g} Hz: G* goes with frequency to the power {exponent:.3g}, the same everywhere "
        f"({(high / low) ** exponent:.3g} times as much at {high:g} Hz)"
    )


def poorly_determined_notes(determined: dict[str, float]) -> list[str]:
    """Return notes on fields of which the data determine next to nothing, from field → determined parameters."""
    few = {name: number for name, number in determined.items() if number < FEW}
    return [
        f"the data determine only {few[name]:.1f} parameters of {name}: details of its map are not reliable"
        for name in few
    ]


def fibre_shear_moduli(maps: Mapping[str, Array]) -> dict[str, Array]:
    """Return the two shear moduli in a plane of fibres (Pa): `shear_along` μ(1+φ) and `shear_stretch` μ(1+ζ); none without fibres.

    Examples
    --------
    >>> found = fibre_shear_moduli({"mu": np.array([2e3]), "zeta": np.array([0.5]), "phi": np.array([0.2])})
    >>> float(found["shear_along"][0]), float(found["shear_stretch"][0])
    (2400.0, 3000.0)
    """
    mu = maps.get("mu", maps.get("storage"))
    if mu is None or not {"zeta", "phi"} <= set(maps):
        return {}
    return {"shear_along": mu * (1 + maps["phi"]), "shear_stretch": mu * (1 + maps["zeta"])}


def fibre_notes(data: WaveData, maps: dict[str, Array]) -> tuple[list[str], dict[str, float]]:
    """Return notes on maps of a body with fibres, and errors of `fibre_shear_moduli` where the truth is known.

    Parameters
    ----------
    data : WaveData
        The data.
    maps : dict of str to numpy.ndarray
        Parameter → (n,)

    Returns
    -------
    notes : list of str
        The notes.
    errors : dict of str to float
        Relative L2 errors.
    """
    found = fibre_shear_moduli(maps)
    if not found:
        return [], {}
    truth = fibre_shear_moduli({name: np.real(values) for name, values in data.truth_views.items()})
    errors = {
        name: relative_l2_error(values[data.mask], truth[name][data.mask]) for name, values in found.items() if truth
    }
    known = "".join(f", off by {100 * errors[name]:.2g} %" if errors else "" for name in found)
    return [
        "in a plane of fibres waves determine the shear moduli mu (1 + phi) and mu (1 + zeta); how they part into mu, zeta and "
        "phi only the bulk modulus determines: trust shear_along and shear_stretch first" + known
    ], errors
