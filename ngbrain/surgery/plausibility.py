"""Plausibility checks of a scene: shear moduli far from all published values for brain."""

from __future__ import annotations

import warnings

from ngbrain.errors import ImplausibleWarning, InputError
from ngbrain.materials import CATALOGUE
from ngbrain.surgery.model import RetractionModel

BRAIN = {"brain", "cortex", "white_matter", "corona_radiata", "corpus_callosum", "deep_grey", "basal_ganglia"}
"""Regions in the catalogue that were sampled from brain tissue."""
BEYOND = 100.0
"""Factor beyond the published range that is refused; moduli entered in kPa are a thousand times too small."""


def check_moduli(model: RetractionModel) -> list[str]:
    """Warn of tissues whose initial shear modulus lies outside of what has been published for brain.

    Parameters
    ----------
    model : Model
        Of a scene; the filling of its ventricles does not count.

    Returns
    -------
    list of str
        The warnings, which are also issued as `ImplausibleWarning`.

    Raises
    ------
    InputError
        A modulus is more than `BEYOND` times smaller or larger than any published one.
    """
    published = [entry.initial_modulus for entry in CATALOGUE.values() if entry.region in BRAIN]
    low, high = min(published), max(published)
    moduli = {name: part.modulus for name, part in model.parts().items()}
    for name, modulus in moduli.items():
        if not low / BEYOND <= modulus <= BEYOND * high:
            wanted = (
                f"{low:.0f} to {high:.0f} Pa, as published for brain, or up to {BEYOND:g} times beyond; Pa, not kPa"
            )
            raise InputError(f"initial shear modulus of {name} (mu_Pa)", f"{modulus:.3g} Pa", wanted)
    odd = [f"{name} {modulus:.3g} Pa" for name, modulus in moduli.items() if not low <= modulus <= high]
    if not odd:
        return []
    text = (
        f"initial shear moduli outside of the {low:.0f} to {high:.0f} Pa published for brain: {', '.join(odd)} "
        "(mu_Pa is in Pa, not kPa); pressures and forces are in proportion to them"
    )
    warnings.warn(text, ImplausibleWarning, stacklevel=3)
    return [text]
