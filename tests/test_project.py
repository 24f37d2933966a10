"""What stands beside the code: citation, changelog, templates, what is packed."""

import configparser
import re
from pathlib import Path

import ngbrain

ROOT = Path(__file__).parents[1]
CITATION = (ROOT / "CITATION.cff").read_text()


def test_the_citation_names_papers_that_the_code_or_the_guide_names():
    sources = [*ROOT.glob("ngbrain/**/*.py"), *ROOT.glob("tutorials/guide/**/*.md")]
    text = "\n".join(path.read_text() for path in sources)
    found = re.findall(r'doi: "(.+)"', CITATION)
    found += [url.replace("%3C", "<").replace("%3E", ">") for url in re.findall(r"url: https://doi.org/(.+)", CITATION)]
    assert len(found) == CITATION.count("- type: ") > 25 and len(set(found)) == len(found)
    assert [doi for doi in found if doi not in text] == []


def test_versions_agree_and_the_changelog_has_one_entry():
    version = ngbrain.__version__
    assert f"\nversion: {version}\n" in CITATION
    assert re.findall(r"^## \[(.+)\]", (ROOT / "CHANGELOG.md").read_text(), re.M) == [version]


def test_commands_of_the_changelog_exist():
    from ngbrain.cli.options.common import parsers

    text = (ROOT / "CHANGELOG.md").read_text()
    assert set(re.findall(r"`ngbrain (\w+)", text)) == set(parsers())
    for name in re.findall(r"`nb\.(\w+)`", text):
        assert hasattr(ngbrain, name), name


def test_classifiers_are_those_of_the_least_version_and_above():
    config = configparser.ConfigParser()
    config.read(ROOT / "setup.cfg")
    least = re.fullmatch(r">=3\.(\d+)", config["options"]["python_requires"])[1]
    named = re.findall(r"Python :: 3\.(\d+)", config["metadata"]["classifiers"])
    assert named[0] == least and list(map(int, named)) == list(range(int(named[0]), int(named[-1]) + 1))


def test_templates_ask_for_what_helps():
    fault = (ROOT / ".github/ISSUE_TEMPLATE/fault.yml").read_text()
    assert "`ngbrain doctor`" in fault and "patient" in fault
    assert "ngbrain/" not in re.sub(r"tutorials/\S+", "", fault)
    assert "Taylor test" in (ROOT / ".github/PULL_REQUEST_TEMPLATE.md").read_text()
