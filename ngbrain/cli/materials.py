"""The verb `materials`: the catalogue of published constants, and how a scene refers to an entry."""

from __future__ import annotations

import argparse
from pathlib import Path

from ngbrain.errors import InputError
from ngbrain.materials import CATALOGUE, lab
from ngbrain.materials.catalogue import Published, suggest
from ngbrain.materials.families import shear_modulus
from ngbrain.materials.lab.description import describe_law, describe_tissue, entry_rows, kPa
from ngbrain.materials.registry import REGISTRY, register
from ngbrain.materials.viscous import viscous
from ngbrain.scene.tissues import NEARLY_INCOMPRESSIBLE

PICTURES = (".png", ".pdf", ".svg")
MOST = 18
"""Largest number of distinguishable lines in a plot."""
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
        draw(found, arguments.plot, arguments.overwrite)
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
        raise InputError("--plot", f"{file}, which exists", "--overwrite to replace it, or another name")
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
        left = kPa(shear_modulus(law.equilibrium)) if law.branches else "-"
        least, most = entry.stretch
        data = f"{least:g} to {most:g}"
        rows.append(
            (entry.name, describe_law(law), describe_tissue(entry), kPa(entry.initial_modulus), left, data, entry.doi)
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


def describe_entry(entry: Published) -> str:
    """All data of an entry, and the lines for a scene."""
    rows = entry_rows(entry)
    lines = [
        f"  {name if i == 0 else '':<15}{line}"
        for name, text in rows.items()
        for i, line in enumerate(text.split("\n"))
    ]
    if entry.bulk or not entry.poisson:
        ratio = entry.bulk / entry.initial_modulus if entry.bulk else NEARLY_INCOMPRESSIBLE
        source = "the source's" if entry.bulk else "nearly incompressible"
        volume_line = f"bulk_to_shear_ratio = {ratio:<5.6g} # bulk modulus / initial shear modulus: {source}"
    else:
        volume_line = f"poissons_ratio = {entry.poisson:<10g} # from the source"
    region = '"ventricle.*"' if entry.region == "ventricles" else '"white"'
    snippet = SNIPPET.format(name=entry.name, region=region, volume=volume_line)
    return "\n".join([entry.name, *lines, "", snippet]).rstrip()
