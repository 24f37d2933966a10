"""Spread of the answers over published moduli and exponents, beside the discretisation errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ngbrain.look import BriefText
from ngbrain.materials import CATALOGUE, Viscous
from ngbrain.materials.catalogue import Published
from ngbrain.materials.families import law_after, shear_modulus
from ngbrain.materials.viscous import viscous
from ngbrain.scene import Tissue
from ngbrain.surgery.answers import Answer, Runs
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.uncertainty.error_budget import Errors
from ngbrain.units import to_mmHg

MOVES = {"step": "half the time step", "order": "one order more", "mesh": "another size of elements"}
"""Kind of a verification run → its change, in words."""
HUMAN, WHOLE = "human", "brain"
MATTER = {
    "grey": {"grey", "cortex", "deep_grey", "basal_ganglia"},
    "white": {"white", "white_matter", "corona_radiata", "corpus_callosum"},
}
"""Kinds of tissue → names of scenes' tissues and of the catalogue's regions."""
LIKE_STRAIN, LEAST_STRAIN = (0.5, 3.0), 0.05
"""Range of comparable data strains relative to the scene's own, and the lowest strain where that has none."""
SUDDEN = 1.0
"""Ramp (s) up to which a law of instantaneous strain is comparable."""
SOFTENED = 0.5
"""Weight of preconditioned tissue."""


@dataclass(frozen=True, repr=False)
class Comparable(BriefText):
    """Published shear moduli that the scene's own modulus at the site is compared with.

    Parameters
    ----------
    tissue : str
        The tissue with the largest volume near the site.
    modulus : float
        Its shear modulus (Pa) at the end of the opening ramp.
    moduli : dict of float
        Catalogue name → the same modulus of that entry (Pa).
    weights : dict of float
        Catalogue name → weight.
    left_out : dict of str
        Catalogue name → reason for exclusion.
    rule : tuple of str
        The selection rule, in sentences.
    """

    tissue: str
    modulus: float
    moduli: dict[str, float]
    weights: dict[str, float]
    left_out: dict[str, str]
    rule: tuple[str, ...]

    @property
    def factors(self) -> dict[str, float]:
        """Catalogue name → modulus relative to the scene's."""
        return {name: modulus / self.modulus for name, modulus in self.moduli.items()}

    @property
    def spread(self) -> tuple[float, float]:
        """Weighted geometric mean of the factors, and their geometric standard deviation."""
        if not self.moduli:
            return 1.0, 1.0
        logs, weights = np.log(list(self.factors.values())), list(self.weights.values())
        mean = np.average(logs, weights=weights)
        return float(np.exp(mean)), float(np.exp(np.sqrt(np.average((logs - mean) ** 2, weights=weights))))


def comparable_moduli(name: str, tissue: Tissue, ramp: float) -> Comparable:
    """The catalogue's entries for a tissue of comparable time scale, strain and species.

    Parameters
    ----------
    name : str
        Name of the tissue, such as "grey" of a scan or "cortex" of the idealised head.
    tissue : Tissue
        The scene's tissue.
    ramp : float
        Time (s) in which the tool opens the cleft.

    Returns
    -------
    Comparable

    Examples
    --------
    >>> found = comparable_moduli("white", Tissue(region="white", material="griffiths2024:white_matter"), ramp=10.0)
    >>> sorted(found.moduli)[:2], found.left_out["miller2002:brain"]
    (['bennion2022:brain', 'budday2017:corona_radiata'], 'of swine, not human')
    """
    own = tissue.published
    group = next((kind for kind, regions in MATTER.items() if name in regions), None)
    if group is None and own:
        group = next((kind for kind, regions in MATTER.items() if own.region in regions), None)
    regions = {WHOLE, *(MATTER[group] if group else set().union(*MATTER.values()))}
    species = own.species if own and own.species != "none" else HUMAN
    low, high = (own.fitted_strain * times for times in LIKE_STRAIN) if own else (LEAST_STRAIN, np.inf)
    moduli, weights, left_out = dict[str, float](), dict[str, float](), dict[str, str]()
    for entry in CATALOGUE.values():
        if entry.region not in regions:
            continue
        if why := _exclusion_reason(entry, species, low, high, ramp):
            left_out[entry.name] = why
            continue
        moduli[entry.name] = _modulus_after(viscous(entry.law()), ramp)
        weights[entry.name] = SOFTENED if entry.preconditioned else 1.0
    strains = f"measured to strains of {100 * low:.3g} % at least" + (
        "" if np.isinf(high) else f", {100 * high:.3g} % at most"
    )
    return Comparable(
        name,
        _modulus_after(tissue.law(), ramp),
        moduli,
        weights,
        left_out,
        (
            f"published for {f'{group} matter' if group else 'brain tissue'} or for brain as a whole, {species}, {strains}",
            f"moduli are those after the ramp of {ramp:g} s; laws of instantaneous strain are excluded if it is longer than "
            f"{SUDDEN:g} s, laws of the drained skeleton always",
            "numbers quoted from memory, and laws of compression or tension alone, are excluded",
            f"preconditioned tissue, which is softer, has the weight {SOFTENED:g} in the mean",
            "in addition, one run has the exponent -4.7 of Miller for swine, with the scene's own moduli",
        ),
    )


def _exclusion_reason(entry: Published, species: str, low: float, high: float, ramp: float) -> str:
    """Reason for excluding an entry; empty if it is comparable."""
    least, most = entry.stretch
    if entry.species != species:
        return f"of {entry.species}, not {species}"
    if entry.evidence == "recalled":
        return "recalled"
    if least >= 1 or most <= 1:
        return f"of {'tension' if least >= 1 else 'compression'} alone"
    if not low <= entry.fitted_strain <= high:
        return f"measured to {100 * entry.fitted_strain:.3g} % strain"
    if entry.pace == "drained" or (entry.pace == "sudden" and ramp > SUDDEN):
        return f"of {'a drained skeleton' if entry.pace == 'drained' else 'an instantaneous strain alone'}"
    return ""


def _modulus_after(law: Viscous, ramp: float) -> float:
    """Shear modulus (Pa) after a single step of `ramp` seconds from rest."""
    return float(shear_modulus(law_after(law, ramp)))


def moduli_near_site(model: RetractionModel, runs: Runs) -> Comparable:
    """`comparable_moduli` for the tissue with the largest volume near the site.

    Parameters
    ----------
    model : RetractionModel
    runs : dict of ProtocolResult

    Returns
    -------
    Comparable
    """
    near = next(iter(runs.values())).peak.near
    name = max(near, key=lambda each: near[each])
    return comparable_moduli(name, model.tissue(name), model.scene.time.ramp)


def compute_material_uncertainty(
    model: RetractionModel, runs: Runs, miller: Answer | None, errors: Errors
) -> dict[str, Any]:
    """Range of the peak pressure over Miller's exponent and published moduli, and the volume strained beyond the data.

    For a prescribed tool motion without inertia, all pressures are proportional to the moduli if their ratios (bulk to shear,
    branch to branch, contact to tissue) and the relaxation times stay: no run is needed. Published moduli are compared with that
    of the tissue with the largest volume near the site (`moduli_near_site`).

    Parameters
    ----------
    model : RetractionModel
    runs : dict of ProtocolResult
        Protocols with prescribed motion.
    miller : dict, optional
        Answer of a hold with Miller's exponent.
    errors : dict
        Error budget of a hold, see `error_budget.errors`.

    Returns
    -------
    dict
        The part `material_uncertainty` of `result.json`.
    """
    first, parts = next(iter(runs.values())), model.parts()
    peak = max(float(to_mmHg(run.column("pressure").max())) for run in runs.values())
    others = moduli_near_site(model, runs)
    mean, by = others.spread
    moduli = {name: factor * peak for name, factor in others.factors.items()}
    laws = {"as given": peak, "Miller alpha -4.7": None if miller is None else miller["peak_pressure_mmHg"]}
    fitted = {name: part.fitted_strain for name, part in parts.items() if part.fitted_strain < float("inf")}
    beyond, tissue = sum(first.peak.beyond_fit.values()), sum(first.peak.tissue.values())
    known = [value for value in (*laws.values(), *moduli.values()) if value is not None]
    of_peak = errors.get("peak_pressure_mmHg", {})
    return {
        "peak_pressure_mmHg": laws,
        "tissue_near_site": others.tissue,
        "modulus_near_site_Pa": others.modulus,
        "published_moduli_Pa": others.moduli,
        "published_weights": others.weights,
        "published_left_out": others.left_out,
        "published_rule": list(others.rule),
        "published_mean_factor": mean,
        "published_sd_factor": by,
        "peak_pressure_by_modulus_mmHg": moduli,
        "peak_pressure_range_mmHg": [min(known), max(known)],
        "discretisation_error_mmHg": {words: of_peak.get(kind) for kind, words in MOVES.items()},
        "fitted_strain": min(fitted.values(), default=None),
        "fitted_strain_by_region": fitted,
        "beyond_fit_ml": beyond,
        "beyond_fit_percent": 100 * beyond / tissue,
    }
