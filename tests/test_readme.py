"""README is short, its links lead somewhere, and everything in it runs as printed and says what it says."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

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
LONG = re.compile(r"^ngbrain (mesh|invert|simulate|calibrate|demo) |nb\.simulate\(|\binvert\(", re.M)
"""What takes more than a few seconds."""
OFF = 0.05
"""By which part a number may differ from the one that README prints: machines and versions differ in last digits, not in these."""


def blocks():
    """Language, text and what README says that it prints, of every block that is run."""
    found = [match.groups() for match in FENCE.finditer(README.read_text())]
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
    assert {language for language, _ in found} == {"sh", "python", "text"}


@pytest.mark.parametrize("language, text, output", list(blocks()))
def test_it_runs_as_printed(language, text, output, tmp_path):
    script = tmp_path / "block"
    script.write_text(text)
    command = {"sh": ["bash", "-eu"], "python": [sys.executable]}[language]
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        [*command, script.name],
        cwd=tmp_path,
        env=os.environ | {"PATH": path, "MPLBACKEND": "Agg", "NGBRAIN_CACHE": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.strip() and "Traceback" not in done.stderr
    for where in OUTPUT.findall(text):
        folder = tmp_path / where if Path(where).suffix == "" else (tmp_path / where).parent
        for name in ("result.json", "report.html"):
            assert (folder / name).stat().st_size > 0
    if output is not None:
        printed, promised = done.stdout.split(), output.split()
        assert len(printed) == len(promised) and all(map(alike, printed, promised)), done.stdout


def alike(one, other):
    """The same word, or numbers that are a little apart."""
    try:
        return float(one.rstrip(",%")) == pytest.approx(float(other.rstrip(",%")), rel=OFF)
    except ValueError:
        return one == other
