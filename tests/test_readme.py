"""README is short, its links lead somewhere, and everything in it runs as printed and says what it says."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import nibabel
import pytest

from ngbrain import datasets
from ngbrain.io import write_waves

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PAGES = [
    *(README, ROOT / "CONTRIBUTING.md"),
    *sorted(ROOT.glob("benchmarks/results/*.md")),
]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.M | re.S)
LINK = re.compile(r"\]\(([^)\s]+)\)|src=\"([^\"]+)\"")
OUTPUT = re.compile(r"-o (\S+)")
SET_UP = re.compile(r"make \w+ ")
SECTION = re.compile(r"^## ([^\n]+)\n(.*?)(?=^## |\Z)", re.M | re.S)
OWN = re.compile(r"own T1|own waves")
"""Sections whose blocks belong together and need files of the reader's own; samples stand in for these."""
FILES = {"toml": "my.toml", "json": "waves.json"}
"""Language of a block that is a file → its name in the text."""
LONG = re.compile(r"^ngbrain (mesh|invert|simulate|calibrate|demo) |nb\.simulate\(|\binvert\(", re.M)
"""What takes more than a few seconds."""
OFF = 0.05
"""By which part a number may differ from the one that README prints: machines and versions differ in last digits, not in these."""


def sections():
    """Title and blocks (language, text) of the sections of `OWN`."""
    for match in SECTION.finditer(README.read_text()):
        if OWN.search(match[1]):
            yield match[1], FENCE.findall(match[2])


def blocks():
    """Language, text and what README says that it prints, of every block that is run by itself."""
    text = SECTION.sub(lambda match: "" if OWN.search(match[1]) else match[0], README.read_text())
    found = FENCE.findall(text)
    for (language, text), (following, output) in zip(found, [*found[1:], ("", "")], strict=True):
        if language != "text" and not SET_UP.match(text):
            long = [pytest.mark.slow] if LONG.search(text) else []
            name = re.sub(r"\W+", "-", text.strip().splitlines()[-1])[:40]
            yield pytest.param(language, text, output if following == "text" else None, id=name, marks=long)


def test_it_is_short_enough_to_read():
    assert len(README.read_text().splitlines()) <= 200


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page):
    dead = []
    for match in LINK.finditer(FENCE.sub("", page.read_text())):
        link = match[1] or match[2]
        if not link.startswith(("http://", "https://")) and not (page.parent / link.partition("#")[0]).exists():
            dead.append(link)
    assert not dead


def test_every_benchmark_is_in_the_table_of_results_beside_the_page_that_names_it():
    folder = ROOT / "benchmarks" / "results"
    listed = {}
    for line in (folder / "README.md").read_text().splitlines():
        if page := re.search(r"\]\((\w+\.md)\)", line):
            listed[page[1]] = re.findall(r"`(\w+)`", line.rpartition("](")[2])
    assert sorted(listed) == sorted(page.name for page in folder.glob("[!R]*.md"))
    scripts = sorted(path.stem for path in ROOT.glob("benchmarks/[!_]*.py"))
    assert sorted(script for each in listed.values() for script in each) == scripts
    for page, names in listed.items():
        text = (folder / page).read_text()
        assert [name for name in names if not re.search(rf"\b{name}\b", text)] == []


def test_only_setting_up_is_left_to_others():
    """What is not run here: make, which continuous integration runs."""
    found = FENCE.findall(README.read_text())
    left_out = [line for _, text in found if SET_UP.match(text) for line in text.splitlines()]
    assert len(left_out) == 2 and all(map(SET_UP.match, left_out))
    assert {language for language, _ in found} == {"sh", "python", "text", *FILES}


def run_block(language, text, folder):
    """Run a block in a folder, and look at the results that it writes."""
    script = folder / "block"
    script.write_text(text)
    command = {"sh": ["bash", "-eu"], "python": [sys.executable]}[language]
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        [*command, script.name],
        cwd=folder,
        env=os.environ | {"PATH": path, "MPLBACKEND": "Agg", "NGBRAIN_CACHE": str(folder / "cache")},
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.strip() and "Traceback" not in done.stderr
    for where in OUTPUT.findall(text):
        for name in ("result.json", "report.html"):
            assert (folder / where / name).stat().st_size > 0
    return done.stdout


def own_scan(folder):
    """A T1 where README has the reader's own."""
    (path,) = datasets.write("mni152", folder)
    path.rename(folder / "T1.nii.gz")


def own_waves(folder):
    """Waves where README has the reader's own, in the unit that its sidecar says; what that says of them is true of these."""
    waves = datasets.load_waves("waves_plane")
    write_waves(folder / "waves.nii.gz", waves)
    image = nibabel.load(folder / "waves.nii.gz")
    nibabel.save(nibabel.Nifti1Image(1e6 * image.get_fdata(dtype=complex), image.affine), folder / "waves.nii.gz")
    (folder / "waves.json").unlink()
    return {"frequency": waves.frequency.tolist(), "density": waves.density, "rheology": waves.rheology}


@pytest.mark.slow
@pytest.mark.parametrize("title, parts", [pytest.param(*each, id=each[0]) for each in sections()])
def test_what_needs_files_of_ones_own_runs_as_printed_on_others(title, parts, tmp_path):
    known = own_scan(tmp_path) if "T1" in title else own_waves(tmp_path)
    for language, text in parts:
        if language in FILES:
            assert FILES[language] in README.read_text()
            (tmp_path / FILES[language]).write_text(text)
        else:
            run_block(language, text, tmp_path)
    if known:
        told = json.loads((tmp_path / FILES["json"]).read_text())
        assert {name: told[name] for name in known} == known
        named = {
            name for section in README.read_text().split("## ") for name in re.findall(r"`(\w+\.nii\.gz)`", section)
        }
        assert {"storage.nii.gz", "storage_low.nii.gz"} <= named
        for name in ("storage", "loss", "storage_low", "loss_high"):
            assert (tmp_path / "maps" / f"{name}.nii.gz").exists()
    else:
        assert (tmp_path / "tube" / "preview.html").exists()
        assert json.loads((tmp_path / "tube" / "result.json").read_text())["first_answers"]["refined"]


@pytest.mark.parametrize("language, text, output", list(blocks()))
def test_it_runs_as_printed(language, text, output, tmp_path):
    shown = run_block(language, text, tmp_path)
    if output is not None:
        printed, promised = shown.split(), output.split()
        assert len(printed) == len(promised) and all(map(alike, printed, promised)), shown


def alike(one, other):
    """The same word, or numbers that are a little apart."""
    try:
        return float(one.rstrip(",%")) == pytest.approx(float(other.rstrip(",%")), rel=OFF)
    except ValueError:
        return one == other
