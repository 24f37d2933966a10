"""The documentation site, as far as it can be looked at without being built; `.ci/run` builds it with warnings as errors."""

import ast
import posixpath
import re
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
GUIDE = ROOT / "tutorials/guide"
TOCTREE = re.compile(r"^```\{toctree\}\n(.*?)^```$", re.M | re.S)
SHELL = re.compile(r"^```(?:sh|bash)?\n(.*?)^```$", re.M | re.S)
ELSEWHERE = {"results/index", "project/contributing", "project/changelog"}
"""Pages that lie elsewhere in the repository."""


@pytest.fixture(scope="module")
def stage():
    sys.path.insert(0, str(GUIDE / "builder"))
    try:
        import stage

        yield stage
    finally:
        sys.path.remove(str(GUIDE / "builder"))


def listed():
    """Pages that tables of contents name."""
    for path in sorted(GUIDE.rglob("*.md")):
        folder = path.parent.relative_to(GUIDE).as_posix()
        for block in TOCTREE.findall(path.read_text()):
            for line in block.splitlines():
                if line and not line.startswith(":"):
                    yield posixpath.normpath(posixpath.join(folder, line))


def test_every_page_of_the_guide_is_in_a_table_of_contents_once(stage):
    pages = [page for page in listed() if not re.match(r"lessons/\d", page)]
    own = {path.relative_to(GUIDE).with_suffix("").as_posix() for path in GUIDE.rglob("*.md")} - {"index"}
    generated = {f"reference/{page.partition('.')[0]}" for page in stage.GENERATED}
    assert sorted(pages) == sorted(own | generated | ELSEWHERE)


def test_every_lesson_is_listed_once():
    lessons = [page for page in listed() if re.match(r"lessons/\d", page)]
    assert sorted(lessons) == [f"lessons/{path.stem}" for path in sorted((ROOT / "tutorials").glob("[0-9]*.py"))]


def test_every_verb_has_a_page_that_shows_how_it_is_used():
    from ngbrain.cli.options.common import parsers

    pages = [*(GUIDE / "howto").glob("*.md"), GUIDE / "install.md"]
    used = set(re.findall(r"ngbrain (\w+)", "\n".join(path.read_text() for path in pages)))
    assert set(parsers()) <= used


def test_commands_of_the_guide_have_verbs_and_options_that_exist():
    from ngbrain.cli.options.common import parsers

    known = {
        verb: {option for action in each._actions for option in action.option_strings}
        for verb, each in parsers().items()
    }
    wrong = []
    for path in sorted(GUIDE.rglob("*.md")):
        for block in SHELL.findall(path.read_text()):
            for verb, rest in re.findall(r"^ngbrain (\w+)((?:[^#\n\\]|\\\n)*)", block, re.M):
                options = re.findall(r"(?<!\S)--?[a-z][\w-]*", rest)
                wrong += [f"{path.name}: {verb} {option}" for option in options if option not in known.get(verb, ())]
    assert wrong == []


def test_links_between_pages_lead_to_pages_or_to_files(stage):
    """Those in the repository; in the site a link to a file that is no page keeps its words alone."""
    pages = stage.mapping()
    for source in pages:
        if source.endswith(".md"):
            text = (ROOT / source).read_text() if (ROOT / source).exists() else ""
            for match in stage.links(text):
                to = match["to"].partition("#")[0]
                target = posixpath.normpath(posixpath.join(posixpath.dirname(source), to))
                leads = stage.is_elsewhere(match["to"]) or target in pages or (ROOT / target).exists()
                assert leads, f"{source}: {match['to']}"


def test_links_of_the_repository_become_links_of_the_site(stage, tmp_path):
    pages = stage.Pages(tmp_path)
    text = "[lesson](../../14_a_cohort.py), [part](../reference/scene.md#tool), [script](../../../benchmarks/gpu.py), `[x](y.md)`"
    assert pages.relink(text, "tutorials/guide/howto/cohort.md", "howto/cohort.md") == (
        "[lesson](../lessons/14_a_cohort.ipynb), [part](../reference/scene.md#tool), script, `[x](y.md)`"
    )
    picture = pages.relink("![m](../gpu.png)", "benchmarks/results/gpu.md", "results/gpu.md")
    assert picture == "![m](../_pictures/benchmarks/gpu.png)"
    assert (tmp_path / "_pictures/benchmarks/gpu.png").read_bytes() == (ROOT / "benchmarks/gpu.png").read_bytes()


def test_what_a_browser_would_fetch_is_found(stage):
    import offline

    html = '<script src="https://cdn.org/a.js"></script><style>a { background: url(//b.org/c.png) }</style>'
    links = '<a href="https://fine.org">x</a><link rel="stylesheet" href="http://d.org/e.css"><img src="own.png">'
    assert offline.addresses(html + links) == ["https://cdn.org/a.js", "//b.org/c.png", "http://d.org/e.css"]


def test_the_catalogue_page_draws_every_law(stage):
    import catalogue

    from ngbrain.materials import CATALOGUE
    from ngbrain.materials.registry import REGISTRY

    assert set(catalogue.SHOWN) == set(REGISTRY)
    assert sorted(entry.name for _, entries in catalogue.groups() for entry in entries) == sorted(CATALOGUE)


def test_plain_text_of_docstrings_stays_plain_and_names_become_references(stage, monkeypatch):
    import docstrings

    monkeypatch.setitem(docstrings.KNOWN, "Problem", "ngbrain.forward.Problem")
    text = [
        "|G*| of W_∞ of a `Problem`, `Other`s too:",
        "",
        "    W_∞ + *W",
        "",
        "two   columns",
        "      go on",
        "",
        "The end",
    ]
    assert docstrings.prepare(text) == [
        r"\|G\*\| of W\_∞ of a :py:obj:`Problem <ngbrain.forward.Problem>`, `Other`\ s too:",
        "",
        "::",
        "",
        "    W_∞ + *W",
        "",
        "    two   columns",
        "          go on",
        "",
        "The end",
    ]


def test_formulas_can_be_drawn_by_browsers(stage):
    """Those of docutils' own translation to MathML: a page with another one would show its LaTeX."""
    from docutils.utils.math.latex2mathml import tex2mathml

    formula = re.compile(r"\$\$(.+?)\$\$|\$([^$\n]+?)\$", re.S)
    found = [match for path in GUIDE.rglob("*.md") for match in formula.finditer(stage.FENCE.sub("", path.read_text()))]
    assert len(found) > 50
    for match in found:
        assert tex2mathml(match[1] or match[2], as_block=bool(match[1])).startswith("<math")


def test_names_of_the_package_in_the_guide_exist():
    missing = []
    for path in sorted(GUIDE.rglob("*.md")):
        text = path.read_text()
        named = re.findall(r"(?:`|\")(ngbrain(?:\.\w+)+)", text)
        for block in re.findall(r"^```python\n(.*?)^```$", text, re.M | re.S):
            for node in ast.walk(ast.parse(block)):
                if isinstance(node, ast.ImportFrom) and str(node.module).startswith("ngbrain"):
                    named += [f"{node.module}.{alias.name}" for alias in node.names]
        missing += [f"{path.name}: {name}" for name in named if not exists(name)]
    assert missing == []


def exists(name):
    """Whether a name of the package can be imported, or got from what can be."""
    try:
        import_module(name)
    except ModuleNotFoundError:
        module, _, last = name.rpartition(".")
        return hasattr(import_module(module), last) if exists(module) else False
    return True
