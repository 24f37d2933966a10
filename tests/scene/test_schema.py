"""What a scene's file may hold: the JSON schema and the reference page say what the code takes; paths are relative to the file."""

import json
import tomllib
from pathlib import Path

import pytest

import ngbrain
from ngbrain.cli import main
from ngbrain.errors import InputError
from ngbrain.scene import Scene
from ngbrain.scene.schema import descriptions, json_schema, reference
from ngbrain.schema.document import entries
from ngbrain.surgery.twin.case import Case

ROOT = Path(__file__).parents[2]
TOML = [*sorted(ROOT.glob("ngbrain/scenes/*.toml")), *sorted(ROOT.glob("ngbrain/samples/*.toml"))]
FILES = {file: Scene for file in TOML if "[geometry]" in file.read_text()}
FILES |= {file: Case for file in TOML if "[[plan]]" in file.read_text()}
KINDS = {"object": dict, "string": str, "number": (int, float), "integer": int, "array": list}


def breaks(value, rule):
    """What of a value a schema does not allow, in words; the part of JSON Schema that ours uses."""
    if "anyOf" in rule:
        said = [breaks(value, each) for each in rule["anyOf"]]
        return "" if "" in said else "; ".join(said)
    if "enum" in rule:
        return "" if value in rule["enum"] else f"{value!r} of {len(rule['enum'])}"
    if not isinstance(value, KINDS[rule["type"]]):
        return f"{value!r} is no {rule['type']}"
    if isinstance(value, dict):
        properties = rule.get("properties", {})
        unknown = set(value) - set(properties) if rule.get("additionalProperties") is False else set()
        missing = set(rule.get("required", ())) - set(value)
        inner = [breaks(value[key], properties[key]) for key in set(value) & set(properties)]
        return "; ".join(filter(None, [*map(str, unknown), *map(str, missing), *inner]))
    if isinstance(value, list):
        fits = rule.get("minItems", 0) <= len(value) <= rule.get("maxItems", 99)
        return "; ".join(
            filter(None, ["" if fits else f"{len(value)} items", *(breaks(v, rule["items"]) for v in value)])
        )
    if isinstance(value, str):
        return ""
    low = rule.get("minimum", value) <= value and rule.get("exclusiveMinimum", value - 1) < value
    return "" if low and value <= rule.get("maximum", value) else f"{value} out of bounds"


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_shipped_scenes_and_cases_keep_to_the_schema(file):
    assert breaks(tomllib.loads(file.read_text()), json_schema(FILES[file])) == ""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('kind = "block"', 'kind = "blok"'),
        ("size_mm = [60.0, 60.0, 40.0]", "size_mm = [60.0, 60.0]"),
        ("max_size_mm = 20.0", "max_size_mm = -1"),
        ("order = 2", "order = 5"),
        ("tolerance = 0.1", "tolerence = 0.1"),
        ('kind = "block"', ""),
    ],
)
def test_what_the_code_refuses_the_schema_does_too(old, new):
    text = Scene.template("body")
    data = tomllib.loads(text.replace(old, new, 1))
    with pytest.raises(InputError):
        Scene.from_dict(data)
    assert breaks(data, Scene.schema())


def test_every_key_is_described():
    for entry in entries(Scene).values():
        if entry.table:
            said = descriptions(entry.table)
            assert {name for name in entries(entry.table) if not said.get(name)} == set(), entry.key
            assert set(json_schema(entry.table)["properties"]) == {each.key for each in entries(entry.table).values()}


def test_the_page_is_what_the_code_says():
    assert (ROOT / "tutorials" / "guide" / "reference" / "scene.md").read_text() == reference(Scene)


def test_templates_and_schema_are_printed(capsys):
    for kind, options in (("operation", []), ("body", ["body"])):
        with pytest.raises(SystemExit) as ended:
            main(["simulate", "--template", *options])
        assert ended.value.code == 0 and capsys.readouterr().out == Scene.template(kind)
        Scene.from_dict(tomllib.loads(Scene.template(kind)))
    with pytest.raises(SystemExit):
        main(["simulate", "--schema"])
    assert json.loads(capsys.readouterr().out) == Scene.schema()
    with pytest.raises(InputError, match="operation"):
        Scene.template("operatoin")


def test_paths_are_relative_to_the_scenes_file(tmp_path, monkeypatch):
    text = Scene.template().replace('kind = "mni152"', 'kind = "scan"\nimage = "T1.nii.gz"')
    (tmp_path / "case").mkdir()
    (tmp_path / "case" / "scene.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    scene = Scene.from_toml("case/scene.toml")
    assert scene.geometry.image == "case/T1.nii.gz" and Scene.from_dict(scene.to_dict()) == scene
    monkeypatch.chdir(tmp_path / "case")
    assert Scene.from_toml("scene.toml").geometry.image == "T1.nii.gz"
    away = (tmp_path / "case" / "scene.toml").read_text().replace("T1.nii.gz", "/data/T1.nii.gz")
    (tmp_path / "case" / "scene.toml").write_text(away)
    assert Scene.from_toml("scene.toml").geometry.image == "/data/T1.nii.gz"


def test_a_scene_as_described_is_of_its_own_elements_with_everything_in_it():
    data = tomllib.loads(Scene.template("body"))
    data["geometry"] = {"kind": "block", "size_mm": [20, 20, 20]}
    data["displacement_bc"][1] |= {"boundary": "top", "value_mm": [0, 0, -0.2]}
    data["quantity"][0] |= {"boundary": "top"}
    result = ngbrain.simulate(Scene.from_dict(data), as_described=True)
    model = result["model"]
    assert (model["mesh"], model["order"], model["strain"], model["time"]) == ("0", "2", "finite", "flowing")
    assert len(result["models"]) == 1 and set(result["answers"][0]) >= {"value", "unit", "error_estimate", "tolerance"}
    with pytest.raises(InputError, match="resume"):
        ngbrain.simulate(Scene.from_dict(data), resume=True)
