"""The verb `materials`: the list, all about one entry, what it gives to paste, and names that are none."""

import re
import tomllib

import pytest

from ngbrain.cli import main
from ngbrain.materials import CATALOGUE, constants
from ngbrain.scene import Tissue


def said(capsys, *arguments):
    assert main(["materials", *arguments]) == 0
    return capsys.readouterr().out


def test_the_list_has_a_line_for_each_entry(capsys):
    heading, *lines = said(capsys).splitlines()
    assert heading.split("  ")[0] == "name" and len(lines) == len(CATALOGUE) + 3
    for line, entry in zip(lines, CATALOGUE.values(), strict=False):
        name, law, tissue, modulus, left, doi = re.split(r"\s{2,}", line)
        assert (name, doi) == (entry.name, entry.doi) and law and tissue
        assert 1e3 * float(modulus) == pytest.approx(entry.initial_modulus, rel=5e-3)
        assert (left != "-") == entry.name.startswith(("griffiths", "miller"))
    assert 1e3 * float(re.split(r"\s{2,}", lines[0])[4]) == 420


def test_a_part_of_a_name_lists_those_that_have_it(capsys):
    lines = said(capsys, "Miller").splitlines()
    assert [line.split()[0] for line in lines[1:3]] == ["miller1997:brain", "miller2002:brain"] and not lines[3]


@pytest.mark.parametrize("name", CATALOGUE)
def test_all_about_an_entry_and_what_to_paste(capsys, name):
    entry, text = CATALOGUE[name], said(capsys, name)
    for part in (entry.source, entry.doi, entry.protocol, entry.note, *entry.cautions):
        assert part in text
    (toml,) = re.split(r"In a .*:\n", text)[1:]
    made = Tissue.read(tomllib.loads(toml)["tissue"][0], "tissue")
    assert made.published is entry and (not entry.bulk or made.bulk == pytest.approx(entry.bulk, rel=1e-5))
    assert not entry.poisson or entry.bulk or made.poissons_ratio == entry.poisson


def test_constants_are_shown_as_the_law_has_them(capsys):
    text = said(capsys, "griffiths2024:cortex")
    assert (
        "stays: μ = 420 Pa, α = -21.27" in text
        and "branch 1: μ = 1400 Pa, α = -14.66, η = 3050 Pa s, τ = 2.179 s" in text
    )
    text = said(capsys, "miller1997:brain")
    assert (
        "at once: c10 = 263 Pa, c01 = 263 Pa, c20 = 491 Pa, c02 = 491 Pa" in text
        and "branch 2: g = 0.365, τ = 50 s" in text
    )
    assert "μ = 2249.3, 4575.84 Pa, α = 4.309, 7.736" in said(capsys, "franceschini2006:brain")
    law = constants("franceschini2006:brain").law()
    assert law.mu == pytest.approx([2249.3, 4575.84], rel=1e-5) and law.alpha == [4.309, 7.736]


def test_a_misspelt_name_is_one_line_with_the_nearest(capsys):
    assert main(["materials", "griffiths2024:cortx"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "such as 'griffiths2024:cortex'" in error
