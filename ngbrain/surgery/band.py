"""How far the answer moves with what is not known: published moduli and exponents, beside the errors of the numerics."""

from __future__ import annotations

from typing import Any

from ngbrain.materials import CATALOGUE
from ngbrain.surgery.answers import Answer, Runs
from ngbrain.surgery.model import Model
from ngbrain.surgery.worth import Errors
from ngbrain.units import to_mmHg

MOVES = {"step": "half the time step", "order": "one order more", "mesh": "another size of elements"}
"""What numerics are changed by, in words."""


def published_moduli() -> dict[str, float]:
    """Name → initial shear modulus (Pa) of every published law for brain as a whole, fast and slow, swine to human.

    >>> published_moduli()["miller2002:brain"]
    842.0
    """
    return {name: entry.initial_modulus for name, entry in CATALOGUE.items() if entry.region == "brain"}


def modulus_near_site(model: Model, runs: Runs) -> float:
    """Initial shear modulus (Pa), mean over the tissue near the site."""
    near, parts = next(iter(runs.values())).peak.near, model.parts()
    return sum(near[name] * part.modulus for name, part in parts.items()) / sum(near.values())


def material_band(model: Model, runs: Runs, miller: Answer | None, errors: Errors) -> dict[str, Any]:
    """Peak pressure as given, with Miller's exponent, and as stiff as others have found brain; how much is extrapolated.

    On a given way of the blade, without inertia, all pressures are proportional to the moduli if those keep their ratios
    (bulk to shear, branch to branch, contact to tissue) and relaxation its times: no run is needed. A published modulus is
    compared with the mean of the scene's over the tissue near the site.

    runs   by protocols of a given way; miller: a hold with Miller's exponent; errors: of a hold, see `worth.errors`
    """
    first, parts = next(iter(runs.values())), model.parts()
    peak = max(float(to_mmHg(run.column("pressure").max())) for run in runs.values())
    modulus = modulus_near_site(model, runs)
    moduli = {name: mu / modulus * peak for name, mu in published_moduli().items()}
    laws = {"as given": peak, "Miller alpha -4.7": None if miller is None else miller["peak_pressure_mmHg"]}
    fitted = {name: part.fitted_strain for name, part in parts.items() if part.fitted_strain < float("inf")}
    beyond, tissue = sum(first.peak.beyond_fit.values()), sum(first.peak.tissue.values())
    known = [value for value in (*laws.values(), *moduli.values()) if value is not None]
    of_peak = errors.get("peak_pressure_mmHg", {})
    return {
        "peak_pressure_mmHg": laws,
        "modulus_near_site_Pa": modulus,
        "published_moduli_Pa": published_moduli(),
        "peak_pressure_by_modulus_mmHg": moduli,
        "peak_pressure_range_mmHg": [min(known), max(known)],
        "discretisation_error_mmHg": {words: of_peak.get(kind) for kind, words in MOVES.items()},
        "fitted_strain": min(fitted.values(), default=None),
        "fitted_strain_by_region": fitted,
        "beyond_fit_ml": beyond,
        "beyond_fit_percent": 100 * beyond / tissue,
    }
