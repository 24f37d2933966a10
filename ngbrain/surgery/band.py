"""How far the answer moves with what is not known: published moduli and exponents, beside the errors of the numerics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ngbrain.materials import CATALOGUE
from ngbrain.surgery.model import Model
from ngbrain.units import to_mmHg

if TYPE_CHECKING:
    from ngbrain.surgery.retraction import Outcome


def published_moduli() -> dict[str, float]:
    """Name → initial shear modulus (Pa) of every published law for brain as a whole, fast and slow, swine to human.

    >>> published_moduli()["miller2002:brain"]
    842.0
    """
    return {name: entry.initial_modulus for name, entry in CATALOGUE.items() if entry.region == "brain"}


def material_band(
    model: Model, runs: dict[str, Outcome], miller: float | None, checks: dict[str, float | None]
) -> dict[str, Any]:
    """Peak pressure as given, with Miller's exponent, and as stiff as others have found brain; how much is extrapolated.

    On a given way of the blade, without inertia, all pressures are proportional to the moduli if those keep their ratios
    (bulk to shear, branch to branch, contact to tissue) and relaxation its times: no run is needed. A published modulus is
    compared with the mean of the scene's over the tissue near the site.

    miller   peak pressure (Pa) with Miller's exponent; checks: relative errors by name, see `answers.checks`
    """
    first, parts = next(iter(runs.values())), model.parts()
    peak = max(float(to_mmHg(run.column("pressure").max())) for run in runs.values())
    near = first.peak.near
    modulus = sum(near[name] * part.modulus for name, part in parts.items()) / sum(near.values())
    moduli = {name: mu / modulus * peak for name, mu in published_moduli().items()}
    laws = {"as given": peak, "Miller alpha -4.7": None if miller is None else float(to_mmHg(miller))}
    fitted = {name: part.fitted for name, part in parts.items() if part.fitted < float("inf")}
    beyond, tissue = sum(first.peak.beyond_fit.values()), sum(first.peak.tissue.values())
    known = [value for value in (*laws.values(), *moduli.values()) if value is not None]
    errors = {"half the time step": checks["dt_halving"], "one order more": checks["order_plus_one"]}
    return {
        "peak_pressure_mmHg": laws,
        "modulus_near_site_Pa": modulus,
        "published_moduli_Pa": published_moduli(),
        "peak_pressure_by_modulus_mmHg": moduli,
        "peak_pressure_range_mmHg": [min(known), max(known)],
        "discretisation_error_mmHg": {name: None if e is None else e * peak for name, e in errors.items()},
        "fitted_strain": min(fitted.values(), default=None),
        "fitted_strain_by_region": fitted,
        "beyond_fit_ml": beyond,
        "beyond_fit_percent": 100 * beyond / tissue,
    }
