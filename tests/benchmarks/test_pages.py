"""Pages of results say what records and measurements by hand say, and no number of theirs comes from elsewhere."""

import ast
import json
import re
import shutil
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
TOPICS = sorted(path.stem for path in (BENCHMARKS / "pages").glob("*.md"))
DECIMAL = re.compile(r"(?<![\w.])\d*\.\d")
CODE = re.compile(r"^```.*?^```$|`[^`]*`|\]\([^)]*\)", re.M | re.S)


@pytest.fixture
def pages(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import _pages

    return _pages


@pytest.mark.parametrize("topic", TOPICS)
def test_page_is_that_of_its_records(pages, topic):
    assert (BENCHMARKS / "results" / f"{topic}.md").read_text() == pages.page(topic)


@pytest.mark.parametrize("topic", TOPICS)
def test_no_number_with_a_decimal_point_is_written_in_a_template(topic):
    found = DECIMAL.findall(CODE.sub("", (BENCHMARKS / "pages" / f"{topic}.md").read_text()))
    functions = BENCHMARKS / "pages" / f"{topic}.py"
    if functions.exists():
        tree = ast.parse(functions.read_text())
        formats = {id(n) for f in ast.walk(tree) if isinstance(f, ast.FormattedValue) and f.format_spec
                   for n in ast.walk(f.format_spec)}  # fmt: skip
        texts = [n.value for n in ast.walk(tree) if isinstance(n, ast.Constant) and isinstance(n.value, str)
                 and id(n) not in formats]  # fmt: skip
        found += [number for text in texts for number in DECIMAL.findall(text)]
    assert not found


def test_another_number_in_the_records_makes_another_page(pages, monkeypatch, tmp_path):
    records = json.loads((BENCHMARKS / "statics_cook.json").read_text())
    shutil.copytree(BENCHMARKS / "pages", tmp_path / "pages")
    for path in BENCHMARKS.glob("statics_*.json"):
        shutil.copy(path, tmp_path)
    records[0]["error"] *= 1.001
    (tmp_path / "statics_cook.json").write_text(json.dumps(records))
    monkeypatch.setattr(pages, "FOLDER", tmp_path)
    pages._load.cache_clear()
    changed = pages.page("statics")
    pages._load.cache_clear()
    assert changed != (BENCHMARKS / "results" / "statics.md").read_text()


def test_the_chart_of_the_overview_is_of_the_records(pages):
    import _overview

    assert _overview.fresh()


def test_a_section_that_no_template_draws_is_refused(pages, monkeypatch, tmp_path):
    (tmp_path / "lost.md").write_text("# Lost\n\n{{measured: Drawn}}\n")
    one = {"what": "a", "value": 1, "unit": "s", "how": "by hand", "date": ""}
    (tmp_path / "lost.json").write_text(json.dumps({"Drawn": [one]}))
    monkeypatch.setattr(pages, "PAGES", tmp_path)
    assert "| a | 1 s | by hand |" in pages.page("lost")
    (tmp_path / "lost.json").write_text(json.dumps({"Drawn": [one], "Forgotten": [one]}))
    with pytest.raises(ValueError, match="leaves out Forgotten"):
        pages.page("lost")
