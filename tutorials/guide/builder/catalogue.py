"""The page of materials: the laws that have names, and the published constants, each with its curve."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from typing import Any

import stage
import tables

from ngbrain.materials import CATALOGUE, lab
from ngbrain.materials.catalogue import Published
from ngbrain.materials.families import shear_modulus
from ngbrain.materials.lab.description import EVIDENCE, describe_law, describe_tissue
from ngbrain.materials.registry import REGISTRY
from ngbrain.materials.viscous import viscous
from ngbrain.units import to_kPa

SHOWN: dict[str, list[dict[str, Any]]] = {
    "NeoHooke": [{"mu": 1e3}],
    "UnsplitNeoHooke": [{"mu": 1e3}],
    "MooneyRivlin": [{"c10": 500.0 - c, "c01": c} for c in (100.0, 300.0, 500.0)],
    "Yeoh": [{"c1": 500.0, "c2": c, "c3": 0.0} for c in (0.0, 500.0, 2000.0)],
    "Gent": [{"mu": 1e3, "jm": j} for j in (0.5, 1.0, 5.0)],
    "Demiray": [{"mu": 1e3, "b": b} for b in (0.5, 2.0, 5.0)],
    "Ogden": [{"mu": 1e3, "alpha": alpha} for alpha in (-20.0, -5.0, 5.0)],
}
"""Constants that the curves of a law are drawn with, all of 1 kPa at rest."""
MODES = ("uniaxial", "shear")


def add(pages: stage.Pages) -> None:
    """Stage the page and its pictures."""
    parts = [
        "# Materials",
        "A law is an energy density W of the isochoric right Cauchy-Green tensor C, J^(-2/3) FᵀF; stress, tangent and derivatives "
        "by parameters follow from it. [Tissue of any law](../howto/laws.md) says how a scene takes one, and one of your own.",
        "## Laws by name",
        '`material = { name = "Gent", mu_Pa = 900.0, jm = 0.5 }` in a scene. Curves are nominal stress of incompressible tissue of '
        "1 kPa at rest, for some values of the other constants.",
    ]
    for name, entry in REGISTRY.items():
        keys = [
            f"`{each.key}`" + ("" if each.default is None else f" (left out: {each.default:g})")
            for each in entry.parameters
        ]
        parts += [f"### `{name}`", tables.escape(entry.about), f"Keys: {', '.join(keys)}."]
        if name in SHOWN:
            laws = {_label(given): entry.make(**given) for given in SHOWN[name]}
            parts.append(_picture(pages, f"law-{name}", lab.plot(laws, modes=MODES), f"Stress of {name}"))
    parts += [
        "## Published constants",
        f'{len(CATALOGUE)} entries. `material = "NAME"` in a scene; `ngbrain materials NAME` says all about one of '
        "them. μ₀ is the shear modulus of a sudden small strain, μ∞ what is left of it in the end. In curves a relaxing law has "
        "two lines, thick at once and thin in the end, over the stretches of its data.",
    ]
    for heading, entries in groups():
        parts += [
            f"### {heading}",
            tables.table(("name", "tissue", "law", "μ₀ kPa", "μ∞ kPa", "stretch", "source"), map(_row, entries)),
        ]
        parts.append(
            _picture(pages, entries[0].name.replace(":", "-"), lab.plot_catalogue(entries), f"Stress of {heading}")
        )
        said = {each.name: [each.note, *each.cautions] for each in entries}
        parts += [
            f"- `{name}`: {tables.escape('; '.join(filter(None, notes)))}" for name, notes in said.items() if any(notes)
        ]
    pages.write("reference/materials.md", "\n\n".join(parts) + "\n")


def groups() -> Iterator[tuple[str, list[Published]]]:
    """Entries of one source, and where there are many of one source and region, to be drawn together."""
    found = dict[tuple[str, str], list[Published]]()
    many = [name.partition(":")[0] for name in CATALOGUE]
    for entry in CATALOGUE.values():
        short = entry.name.partition(":")[0]
        region = entry.region.replace("_", " ") if many.count(short) > 12 else ""
        found.setdefault((entry.source, region), []).append(entry)
    for (source, region), entries in found.items():
        yield f"{source}{': ' * bool(region)}{region}", entries


def _row(entry: Published) -> Sequence[str]:
    law = viscous(entry.law())
    left = f"{to_kPa(float(shear_modulus(law.equilibrium))):.3g}" if law.branches else "–"
    least, most = entry.stretch
    words = EVIDENCE[entry.evidence]
    return (
        f"`{entry.name}`", describe_tissue(entry), describe_law(law), f"{to_kPa(entry.initial_modulus):.3g}", left,
        f"{least:g} to {most:g}", f"[{entry.doi}](https://doi.org/{entry.doi}); {words}",
    )  # fmt: skip


def _label(given: dict[str, Any]) -> str:
    symbols = {"mu": "μ", "alpha": "α", "jm": "J_m"}
    others = (f"{symbols.get(name, name)} = {value:g}" for name, value in given.items() if name != "mu")
    return ", ".join(others) or "μ = 1 kPa"


def _picture(pages: stage.Pages, name: str, figure: Any, words: str) -> str:
    file = io.BytesIO()
    figure.savefig(file, dpi=100, format="png", metadata={"Software": None})
    pages.write(f"_pictures/materials/{name}.png", file.getvalue())
    return f"![{words}](../_pictures/materials/{name}.png)"
