"""Laws and published materials in words: name, energy, parameters with units, shear modulus, source."""

from __future__ import annotations

from typing import Any

import ngsolve as ngs
from ngsolve import CoefficientFunction

from ngbrain.errors import NgbrainError
from ngbrain.materials.base import Law, Scaled, Sum
from ngbrain.materials.catalogue import Published
from ngbrain.materials.families import instantaneous_law, relaxation_time, shear_modulus
from ngbrain.materials.maxwell import Maxwell
from ngbrain.materials.points import initial_modulus, varies
from ngbrain.materials.viscous import Branch, Viscous, viscous
from ngbrain.units import to_kPa

NAMES = {"NeoHooke": "Neo-Hooke", "Polynomial": "polynomial"}
"""Class of a law → its name, where that differs."""
SYMBOLS = {
    "mu": "μ", "alpha": "α", "jm": "J_m", "lam": "λ", "bulk": "K", "c10": "c₁₀", "c01": "c₀₁", "k1": "k₁", "k2": "k₂",
    "kappa": "κ", "zeta": "ζ", "phi": "φ", "eta": "η", "tau": "τ",
}  # fmt: skip
"""Parameter of a law → its symbol, where that differs from its name."""
UNITS = dict.fromkeys(("mu", "lam", "bulk", "c10", "c01", "c", "k1"), "Pa") | {"eta": "Pa s", "tau": "s"}
"""Parameter of a law → its unit, unless it is dimensionless."""
EVIDENCE = {
    "source": "numbers read at the source",
    "transcription": "numbers from others' public code",
    "refit": "fitted for this package to the source's curves",
    "recalled": "recalled: check the numbers at the source before quoting them",
}


def describe_law(law: Viscous) -> str:
    """A law in a few words.

    Examples
    --------
    >>> from ngbrain.materials import CATALOGUE
    >>> describe_law(viscous(CATALOGUE["miller2002:brain"].law()))
    'Ogden, 2 hereditary branches (Prony)'
    """
    kind = {"Maxwell branches": len(law.maxwell_branches), "hereditary branches (Prony)": len(law.hereditary_branches)}
    return ", ".join([_named(law.equilibrium), *(f"{count} {words}" for words, count in kind.items() if count)])


def describe_tissue(entry: Published) -> str:
    """Species and region of an entry."""
    region = entry.region.replace("_", " ")
    return region if entry.species == "none" else f"{entry.species} {region}"


def law_rows(law: Law | Viscous | Maxwell | Branch) -> dict[str, str]:
    """Name, energy, parameters and shear modulus of a law, for its card.

    Examples
    --------
    >>> from ngbrain.materials import Gent
    >>> law_rows(Gent(900.0, 0.5))["parameters"], law_rows(Gent(900.0, 0.5))["shear modulus"]
    ('μ = 900 Pa, J_m = 0.5', '0.9 kPa')
    """
    if isinstance(law, Maxwell | Branch):
        own = f"η = {_number(law.eta)} Pa s" if isinstance(law, Maxwell) else f"τ = {_number(law.tau)} s"
        return law_rows(law.law) | {"branch": own}
    material = viscous(law)
    energy = (type(_unscaled(material.equilibrium)).__doc__ or "").partition("\n")[0].rstrip(".")
    modulus = _modulus(material)
    return {
        "law": describe_law(material),
        "energy": energy,
        "parameters": "; ".join(_constants(material)),
    } | ({"shear modulus": modulus} if modulus else {})


def entry_rows(entry: Published) -> dict[str, str]:
    """All data of a published material, by name; constants in several lines, one for each part."""
    law, modulus = viscous(entry.law()), f"{kPa(entry.initial_modulus)} kPa initially"
    if law.branches:
        modulus += f"; {kPa(shear_modulus(law.equilibrium))} kPa in the long term"
    volume = [f"K = {entry.bulk:.4g} Pa"] if entry.bulk else []
    volume += [f"Poisson's ratio {entry.poisson:g}"] if entry.poisson else []
    rows = {
        "tissue": describe_tissue(entry),
        "law": describe_law(law),
        "energy": (type(_unscaled(law.equilibrium)).__doc__ or "").partition("\n")[0].rstrip("."),
        "constants": "\n".join(_constants(law)),
        "shear modulus": modulus,
        "volume": ", ".join(volume) or "not in the source",
        "measured": f"{entry.protocol}; stretches {entry.stretch[0]:g} to {entry.stretch[1]:g}",
        "source": f"{entry.source}, https://doi.org/{entry.doi}",
        "evidence": EVIDENCE[entry.evidence],
        "convention": "" if entry.convention == "as here" else entry.convention,
        "note": entry.note,
        "caution": "; ".join(entry.cautions),
    }
    return {name: text for name, text in rows.items() if text}


def kPa(modulus: Any) -> str:  # noqa: N802
    """Text of a modulus (Pa) in kPa with three digits, without exponent."""
    return f"{float(f'{to_kPa(float(modulus)):.3g}'):.10g}"


def _unscaled(law: Law) -> Law:
    return _unscaled(law.law) if isinstance(law, Scaled) else law


def _named(law: Law) -> str:
    if isinstance(law, Sum):
        return " + ".join(map(_named, law.parts))
    name = type(_unscaled(law)).__name__
    return NAMES.get(name, name)


def _constants(law: Viscous) -> list[str]:
    """A line for each part; for a Prony series the instantaneous law and its relaxing fractions."""
    stays = law.equilibrium
    if isinstance(stays, Scaled) and law.branches:
        shares = [branch.law.factor for branch in law.hereditary_branches if isinstance(branch.law, Scaled)]
        series = zip(shares, law.hereditary_branches, strict=True)
        return [
            f"instantaneous: {_values(stays.law)}",
            *(f"branch {k}: g = {g:g}, τ = {branch.tau:g} s" for k, (g, branch) in enumerate(series, 1)),
        ]
    found = [("equilibrium: " if law.branches else "") + _values(stays)]
    for k, branch in enumerate(law.branches, 1):
        eta = f"η = {branch.eta:g} Pa s, " if isinstance(branch, Maxwell) else ""
        found.append(f"branch {k}: {_values(branch.law)}, {eta}τ = {float(relaxation_time(branch)):.4g} s")
    return found


def _values(law: Law) -> str:
    """Constants of a law with their symbols and units."""
    if isinstance(law, Sum):
        return " + ".join(f"{_named(part)}: {_values(part)}" for part in law.parts)
    if isinstance(law, Scaled):
        return f"{_number(law.factor)} × ({_values(law.law)})"
    found = []
    for name, value in getattr(law, "__dict__", {}).items():
        if isinstance(value, dict):
            found += [f"c{i}{j} = {_number(c)} Pa" for (i, j), c in value.items()]
        elif isinstance(value, int | float | complex | CoefficientFunction | list | tuple):
            unit = f" {UNITS[name]}" if name in UNITS and not _varies(value) else ""
            found.append(f"{SYMBOLS.get(name, name)} = {_number(value)}{unit}")
    return ", ".join(found)


def _number(value: Any) -> str:
    """A constant; a field by that word."""
    if isinstance(value, list | tuple):
        return ", ".join(map(_number, value))
    if isinstance(value, ngs.Parameter):
        return f"{value.Get():.6g}"
    return f"{value:.6g}" if isinstance(value, int | float | complex) else "a field"


def _varies(value: Any) -> bool:
    """Whether a constant is a field; a `Parameter` has one value."""
    return isinstance(value, CoefficientFunction) and not isinstance(value, ngs.Parameter)


def _modulus(material: Viscous) -> str:
    """Initial and long-term shear modulus; empty where they are no numbers, or the law has no isotropic modulus."""
    try:
        law = instantaneous_law(material)
        if varies(law) or isinstance(getattr(law, "mu", 0.0), complex):
            return ""
        first = f"{kPa(initial_modulus(law))} kPa"
        if not material.branches:
            return first
        return f"{first} initially; {kPa(initial_modulus(material.equilibrium))} kPa in the long term"
    except (NgbrainError, TypeError, ValueError):
        return ""
