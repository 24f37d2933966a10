"""The verb `simulate`: one scene from a file to a result and a page."""

import json
import re

import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("jinja2")

from ngbrain.cli import main

BLOCK = """
[geometry]
kind = "block"
size_mm = [20, 20, 20]
[mesh]
max_size_mm = 20
[[displacement_bc]]
boundary = "bottom"
[[displacement_bc]]
boundary = "top"
value_mm = [0, 0, -0.1]
[[quantity]]
name = "force"
boundary = "top"
"""
RELAXING = "[[tissue]]\nmu_Pa = [400, 600]\neta_Pa_s = 1200\npoissons_ratio = 0.3\n[time]\nramp_s = 1\nend_s = 10\n"
SCENE = BLOCK + "tolerance = 0.12\n" + RELAXING
ELASTIC = BLOCK + "tolerance = 0.3\n[[tissue]]\nmu_Pa = 1000\npoissons_ratio = 0.3\n"


@pytest.mark.slow
def test_a_scene_is_solved_and_told(tmp_path, capsys):
    file = tmp_path / "scene.toml"
    file.write_text(SCENE)
    assert main(["simulate", str(file), "-o", str(tmp_path / "out"), "-q"]) == 0
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["cautions"] and capsys.readouterr() == (
        "",
        "".join(f"ngbrain: caution: {f}\n" for f in result["cautions"]),
    )
    (force,) = result["answers"]
    assert result["verb"] == "simulate" and force["quantity"] == "force on top, end" and force["unit"] == "N"
    assert force["error_estimate"] <= force["tolerance"] == 0.12 and force["model"] == result["model"]
    assert result["model"]["time"] == "relaxed" and result["model"]["strain"] == "linear"
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Omitted effects" in page and "finite strains and rotations" in page
    assert "http" not in re.sub(r"base64,[^\"]+|http-equiv", "", page)
    file.write_text(ELASTIC)
    assert main(["simulate", str(file), "-o", str(tmp_path / "out"), "--overwrite"]) == 0
    assert "omitted effect" in capsys.readouterr().out


def test_bad_input_is_one_line(tmp_path, capsys):
    file = tmp_path / "scene.toml"
    file.write_text(SCENE.replace("mu_Pa", "mu_kPa"))
    assert main(["simulate", str(file), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "mu_kPa" in said and said.count("\n") == 1 and not (tmp_path / "out").exists()
