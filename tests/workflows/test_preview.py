"""A scene drawn before it is computed."""

import base64
import io
import re
import tomllib

import numpy as np
import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("jinja2")

from ngbrain import preview
from ngbrain.cli import main
from ngbrain.errors import InputError
from ngbrain.report.pages.preview import KINDS, TOOL
from ngbrain.scene import (
    CleftSpec,
    Contact,
    DisplacementBC,
    Geometry,
    MeshSize,
    Pressure,
    Quantity,
    Scene,
    Tissue,
    Traction,
)

FOOT = DisplacementBC(boundary="bottom")


def body(*bcs, **more):
    given = {
        "geometry": Geometry(kind="block", size=(0.06, 0.06, 0.04), lesion_radius=0.008, lesion_centre=(0, 0, 0.02)),
        "mesh": MeshSize(largest=0.02),
        "tissues": [Tissue(region="tissue", mu=1000.0), Tissue(region="lesion", mu=3000.0)],
        "displacement_bcs": bcs,
        "quantities": [Quantity(name="displacement", point=(0, 0, 0.02))],
    }
    return Scene(**given | more)


def seen(page, colour, picture):
    """Share of a picture's pixels with a colour, also under a thin overlay."""
    import matplotlib.colors
    import matplotlib.image

    texts = re.findall(r'base64,([A-Za-z0-9+/=]+)"', page.read_text())
    pixels = matplotlib.image.imread(io.BytesIO(base64.b64decode(texts[picture])))[..., :3]
    return float(np.mean(np.abs(pixels - matplotlib.colors.to_rgb(colour)).max(axis=-1) < 0.03))


def test_what_acts_where_is_in_the_pictures_and_in_words(tmp_path):
    """Slices (3-D view first, then x, y, z) show a line in the colour of a boundary's condition, and none without one."""
    moved = DisplacementBC(boundary="top", value=(0, 0, -0.002))
    page = preview(body(FOOT, moved), tmp_path / "moved")
    held = preview(body(FOOT, DisplacementBC(boundary="top", value=(0, 0, 0))), tmp_path / "held")
    for picture in (1, 2):
        assert seen(page, KINDS["moved"], picture) > 0.002 and seen(held, KINDS["moved"], picture) == 0
        assert seen(page, KINDS["fixed"], picture) == pytest.approx(seen(held, KINDS["fixed"], picture) / 2, rel=0.2)
    assert seen(page, KINDS["moved"], 3) == 0  # the middle plane meets neither
    text = page.read_text()
    assert "moved by 0, 0, -2 mm" in text and "lesion" in text and "z = 20.0 mm" in text
    assert "initial modulus 3000 Pa" in text and "http" not in text.replace("http-equiv", "")


def test_all_that_can_act_is_drawn(tmp_path):
    turned = DisplacementBC(boundary="bottom", rotation="5*t", axis=(0, 0, 1))
    made = body(
        turned,
        tractions=[Traction(boundary="left", value=("x", 0, 0))],
        pressures=[Pressure(boundary="right", value=100.0)],
        contacts=[
            Contact(boundary="top", shape="ball", point=(0, 0, 0.06), radius=0.02, travel=(0, 0, -0.004)),
            Contact(boundary="front", shape="cylinder", point=(0, -0.04, 0.02), radius=0.01, direction=(1, 0, 0)),
            Contact(boundary="back", shape="plane", point=(0, 0.03, 0.02), direction=(0, -1, 0)),
        ],
    )
    page = preview(made, tmp_path)
    for kind in ("rotated", "traction", "pressure", "contact"):
        assert any(seen(page, KINDS[kind], picture) > 0.001 for picture in (1, 2)), kind
    assert seen(page, TOOL, 1) > 0.002 and "rotated by 5*t° about (0, 0, 1)" in page.read_text()


def test_what_a_run_refuses_is_refused(tmp_path):
    twice = DisplacementBC(boundary="bot.*", value=(1e-3, 0, 0))
    with pytest.raises(InputError, match=r"displacement_bc#2.boundary is 'bot.\*', which displacement_bc#1"):
        preview(body(FOOT, twice), tmp_path)
    assert not (tmp_path / "preview.html").exists()


def test_the_template_is_drawn_from_the_command_line(tmp_path, capsys):
    file = tmp_path / "scene.toml"
    file.write_text(Scene.template("body"))
    assert main(["simulate", str(file), "--preview", "-o", str(tmp_path / "out")]) == 0
    assert (
        "preview.html" in capsys.readouterr().out
        and "A plate on grey matter" in (tmp_path / "out/preview.html").read_text()
    )
    assert sorted(each.name for each in (tmp_path / "out").iterdir()) == ["preview.html"]
    file.write_text(Scene.template("body").replace('boundary = "plate"', 'boundary = "plait"', 1))
    assert main(["simulate", str(file), "--preview", "-o", str(tmp_path / "other")]) == 2
    assert "scene.toml: displacement_bc.boundary is 'plait'" in capsys.readouterr().err


@pytest.mark.slow
def test_an_operation_is_drawn(tmp_path):
    data = tomllib.loads(Scene.shipped("idealised_fast").to_toml())
    page = preview(Scene.from_dict(data), tmp_path)
    assert seen(page, KINDS["walls of the cleft"], 2) > 1e-4 and seen(page, TOOL, 2) > 1e-4
    assert seen(page, KINDS["fixed"], 1) > 2e-3 and "last position" in page.read_text()


@pytest.mark.slow
def test_where_large_elements_cannot_be_made_its_own_are_drawn(tmp_path):
    """A wide cleft beside a large craniotomy's elements: Netgen gives up on the preview's sizes."""
    scene = Scene(
        geometry=Geometry(kind="idealised"),
        mesh=MeshSize(wall=4e-3, craniotomy=10e-3, largest=30e-3),
        tissues=[Tissue(region=".*", mu=1000.0)],
        cleft=CleftSpec(target=(0.018, 0, 0.022), gap=6e-3, width=14e-3),
    )
    text = preview(scene, tmp_path).read_text()
    assert "The mesh is drawn in large elements" not in text and "blade" in text
