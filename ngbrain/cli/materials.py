"""The verb `materials`: the catalogue of published constants, and how a scene refers to an entry."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ngbrain.errors import InputError
from ngbrain.materials import CATALOGUE, Law, Maxwell, Scaled, Viscous, lab
from ngbrain.materials.catalogue import Published, suggest
from ngbrain.materials.families import relaxation_time, shear_modulus
from ngbrain.materials.registry import REGISTRY, register
from ngbrain.materials.viscous import viscous
from ngbrain.scene.tissues import NEARLY_INCOMPRESSIBLE
from ngbrain.units import to_kPa

PICTURES = (".png", ".pdf", ".svg")
MOST = 18
"""Largest number of distinguishable lines in a plot."""
NAMES = {"NeoHooke": "Neo-Hooke", "Polynomial": "polynomial"}
"""Class of a law → its name, where that differs."""
SYMBOLS = {"mu": "μ", "alpha": "α", "b": "b", "jm": "J_m"}
"""Constant of a law → its symbol; those of `mu` are in Pa."""
EVIDENCE = {
    "source": "numbers read at the source",
    "transcription": "numbers from others' public code",
    "refit": "fitted for this package to the source's curves",
    "recalled": "recalled: check the numbers at the source before quoting them",
}
SNIPPET = """\
In a scene of `ngbrain simulate`:

[[tissue]]
region = {region:<18} # of a scan "grey", "white", "ventricle.*"; of the idealised head "cortex", "white", "ventricle.*"
material = "{name}"
{volume}
"""


def run(arguments: argparse.Namespace) -> None:
    """Print the list, or one entry."""
    name = arguments.name
    if arguments.laws is not None:
        if arguments.laws:
            register(arguments.laws)
        print(law_table())
        return
    found = [entry for known, entry in CATALOGUE.items() if not name or name.casefold() in known]
    if not found:
        raise InputError("NAME", repr(name), suggest(name))
    if name in CATALOGUE:
        found = [CATALOGUE[name]]
    if arguments.plot:
        draw(found, arguments.plot, arguments.force)
    print(describe_entry(found[0]) if name in CATALOGUE else catalogue_table(found))


def draw(entries: list[Published], file: Path, replace: bool) -> None:
    """Plot stress against stretch to a file.

    Parameters
    ----------
    entries : list of Published
    file : Path
    replace : bool
        Overwrite an existing file.

    Raises
    ------
    InputError
        A file that cannot be written or exists already, or too many entries.
    """
    if file.suffix.casefold() not in PICTURES:
        raise InputError("--plot", str(file), f"a name that ends in {', '.join(PICTURES)}")
    if file.exists() and not replace:
        raise InputError("--plot", f"{file}, which exists", "--force to replace it, or another name")
    if len(entries) > MOST:
        raise InputError(
            "NAME", f"of {len(entries)} entries", f"a part of the names of at most {MOST}, such as a region"
        )
    lab.plot_catalogue(entries).savefig(file, dpi=150)
    print(f"plot: {file}\n")


def law_table() -> str:
    """The laws that a scene can name, with their parameters."""
    rows = [("name", "parameters of material = { name = ..., ... }", "law")]
    for name, entry in REGISTRY.items():
        given = [p.key if p.default is None else f"{p.key} ({p.default:g})" for p in entry.parameters]
        rows.append((name, ", ".join(given), entry.about))
    widths = [max(len(row[i]) for row in rows) for i in range(2)]
    return "\n".join("  ".join((row[0].ljust(widths[0]), row[1].ljust(widths[1]), row[2])) for row in rows)


def catalogue_table(entries: list[Published]) -> str:
    """A line for each entry: name, law, tissue, initial and long-term shear modulus, stretches of the data, source."""
    rows = [("name", "law", "tissue", "μ₀ kPa", "μ∞ kPa", "stretch", "DOI")]
    for entry in entries:
        law = viscous(entry.law())
        left = _kPa(shear_modulus(law.equilibrium)) if law.branches else "-"
        least, most = entry.stretch
        data = f"{least:g} to {most:g}"
        rows.append(
            (entry.name, describe_law(law), describe_tissue(entry), _kPa(entry.initial_modulus), left, data, entry.doi)
        )
    widths = [max(len(row[i]) for row in rows) for i in range(6)]
    lines = ["  ".join(text.ljust(width) for text, width in zip(row, (*widths, 0), strict=True)) for row in rows]
    return "\n".join(
        [
            *lines,
            "",
            "μ₀: initial shear modulus at small strain; μ∞: long-term shear modulus, for laws that relax.",
            "`ngbrain materials NAME` shows an entry in full, with the lines for a scene.",
        ]
    )


def describe_law(law: Viscous) -> str:
    """A law in a few words.

    Examples
    --------
    >>> describe_law(viscous(CATALOGUE["miller2002:brain"].law()))
    'Ogden, 2 hereditary branches (Prony)'
    """
    kind = {"Maxwell branches": len(law.maxwell_branches), "hereditary branches (Prony)": len(law.hereditary_branches)}
    return ", ".join([_named(law.equilibrium), *(f"{count} {words}" for words, count in kind.items() if count)])


def describe_tissue(entry: Published) -> str:
    """Species and region of an entry."""
    region = entry.region.replace("_", " ")
    return region if entry.species == "none" else f"{entry.species} {region}"


def describe_entry(entry: Published) -> str:
    """All data of an entry, and the lines for a scene."""
    law, modulus = viscous(entry.law()), f"{_kPa(entry.initial_modulus)} kPa initially"
    if law.branches:
        modulus += f"; {_kPa(shear_modulus(law.equilibrium))} kPa in the long term"
    volume = [f"K = {entry.bulk:.4g} Pa"] if entry.bulk else []
    volume += [f"Poisson's ratio {entry.poisson:g}"] if entry.poisson else []
    rows = [
        ("tissue", describe_tissue(entry)),
        ("law", describe_law(law)),
        ("energy", (type(_plain(law.equilibrium)).__doc__ or "").partition("\n")[0].rstrip(".")),
        *(("constants" if i == 0 else "", line) for i, line in enumerate(_constants(law))),
        ("shear modulus", modulus),
        ("volume", ", ".join(volume) or "not in the source"),
        ("measured", f"{entry.protocol}; stretches {entry.stretch[0]:g} to {entry.stretch[1]:g}"),
        ("source", f"{entry.source}, https://doi.org/{entry.doi}"),
        ("evidence", EVIDENCE[entry.evidence]),
        ("convention", "" if entry.convention == "as here" else entry.convention),
        ("note", entry.note),
        ("caution", "; ".join(entry.cautions)),
    ]
    lines = [f"  {name:<15}{text}" for name, text in rows if text]
    if entry.bulk or not entry.poisson:
        ratio = entry.bulk / entry.initial_modulus if entry.bulk else NEARLY_INCOMPRESSIBLE
        source = "the source's" if entry.bulk else "nearly incompressible"
        volume_line = f"bulk_to_shear_ratio = {ratio:<5.6g} # bulk modulus / initial shear modulus: {source}"
    else:
        volume_line = f"poissons_ratio = {entry.poisson:<10g} # from the source"
    region = '"ventricle.*"' if entry.region == "ventricles" else '"white"'
    snippet = SNIPPET.format(name=entry.name, region=region, volume=volume_line)
    return "\n".join([entry.name, *lines, "", snippet]).rstrip()


def _kPa(modulus: Any) -> str:  # noqa: N802
    """A modulus in kPa with three digits, without exponent."""
    return f"{float(f'{to_kPa(float(modulus)):.3g}'):.10g}"


def _plain(law: Law) -> Law:
    return _plain(law.law) if isinstance(law, Scaled) else law


def _named(law: Law) -> str:
    name = type(_plain(law)).__name__
    return NAMES.get(name, name)


def _constants(law: Viscous) -> list[str]:
    """A line for each part; for a Prony series the instantaneous law and its relaxing fractions."""
    stays = law.equilibrium
    if isinstance(stays, Scaled):
        shares = [branch.law.factor for branch in law.hereditary_branches if isinstance(branch.law, Scaled)]
        series = zip(shares, law.hereditary_branches, strict=True)
        return [
            f"instantaneous: {_values(stays.law)}",
            *(f"branch {k}: g = {g:g}, τ = {branch.tau:g} s" for k, (g, branch) in enumerate(series, 1)),
        ]
    found = [("stays: " if law.branches else "") + _values(stays)]
    for k, branch in enumerate(law.branches, 1):
        eta = f"η = {branch.eta:g} Pa s, " if isinstance(branch, Maxwell) else ""
        found.append(f"branch {k}: {_values(branch.law)}, {eta}τ = {float(relaxation_time(branch)):.4g} s")
    return found


def _values(law: Law) -> str:
    """Constants of a law with their symbols."""
    found = []
    for name, value in vars(law).items():
        if isinstance(value, dict):
            found += [f"c{i}{j} = {c:g} Pa" for (i, j), c in value.items()]
        else:
            many = isinstance(value, list | tuple)
            shown = ", ".join(f"{each:.6g}" for each in value) if many else f"{value:.6g}"
            found.append(f"{SYMBOLS[name]} = {shown}" + (" Pa" if name == "mu" else ""))
    return ", ".join(found)
