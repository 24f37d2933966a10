"""The verb `materials`: the list, one entry in full with its snippet, and unknown names."""

import re
import tomllib

import pytest

from ngbrain.cli import main
from ngbrain.materials import CATALOGUE, constants, lab
from ngbrain.materials.viscous import viscous
from ngbrain.scene import Tissue


def said(capsys, *arguments):
    assert main(["materials", *arguments]) == 0
    return capsys.readouterr().out


def test_the_list_has_a_line_for_each_entry(capsys):
    heading, *lines = said(capsys).splitlines()
    assert heading.split("  ")[0] == "name" and len(lines) == len(CATALOGUE) + 3
    for line, entry in zip(lines, CATALOGUE.values(), strict=False):
        name, law, tissue, modulus, left, stretch, doi = re.split(r"\s{2,}", line)
        assert tuple(map(float, stretch.split(" to "))) == pytest.approx(entry.stretch, rel=1e-5)
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
        "equilibrium: μ = 420 Pa, α = -21.27" in text
        and "branch 1: μ = 1400 Pa, α = -14.66, η = 3050 Pa s, τ = 2.179 s" in text
    )
    text = said(capsys, "miller1997:brain")
    assert (
        "instantaneous: c10 = 263 Pa, c01 = 263 Pa, c20 = 491 Pa, c02 = 491 Pa" in text
        and "branch 2: g = 0.365, τ = 50 s" in text
    )
    assert "μ = 2249.3, 4575.84 Pa, α = 4.309, 7.736" in said(capsys, "franceschini2006:brain")
    law = constants("franceschini2006:brain").law()
    assert law.mu == pytest.approx([2249.3, 4575.84], rel=1e-5) and law.alpha == [4.309, 7.736]


@pytest.mark.parametrize(("name", "lines"), [("griffiths2024:cortex", (2, 2)), ("cortex", (11, 3)), ("skull", (1, 1))])
def test_a_picture_of_what_is_listed(capsys, tmp_path, monkeypatch, name, lines):
    """A line for each entry over the stretches of its data, and a thin one of the long-term stress where it relaxes."""
    pytest.importorskip("matplotlib")
    pages = []
    drawn = lab.plot_catalogue
    monkeypatch.setattr(lab, "plot_catalogue", lambda entries: pages.append(drawn(entries)) or pages[0])
    file = tmp_path / "plot.png"
    assert str(file) in said(capsys, name, "--plot", str(file)) and file.read_bytes()[:4] == b"\x89PNG"
    tension, shear = (axes.lines[:-2] for axes in pages[0].axes)
    assert (len(tension), len(shear)) == lines
    entries = [CATALOGUE[name]] if name in CATALOGUE else [entry for known, entry in CATALOGUE.items() if name in known]
    for entry in entries:
        (line,) = [each for each in tension if each.get_label() == entry.name]
        at, law = line.get_xdata(), viscous(entry.law())
        assert (at[0], at[-1]) == pytest.approx(entry.stretch)
        assert 1e3 * line.get_ydata() == pytest.approx(
            lab.stress(law.instantaneous, "uniaxial", at), rel=1e-9, abs=1e-9
        )
    assert main(["materials", name, "--plot", str(file)]) == 2 and "--overwrite" in capsys.readouterr().err
    assert main(["materials", name, "--plot", str(tmp_path / "plot.jpg")]) == 2 and ".svg" in capsys.readouterr().err
    assert main(["materials", name, "--plot", str(file), "--overwrite"]) == 0


def test_a_picture_of_everything_is_refused(capsys, tmp_path):
    assert main(["materials", "--plot", str(tmp_path / "plot.png")]) == 2
    assert f"NAME is of {len(CATALOGUE)} entries; wanted: a part of the names of at most 18" in capsys.readouterr().err


def test_a_misspelt_name_is_one_line_with_the_nearest(capsys):
    assert main(["materials", "griffiths2024:cortx"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "such as 'griffiths2024:cortex'" in error
