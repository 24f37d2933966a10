"""Loaded bodies as plain data: read, written, refused."""

import pytest

from ngbrain.errors import InputError
from ngbrain.materials import constants
from ngbrain.scene.loading import Loading

TOML = """
title = "Palpation"
[piece]
plate_mm = [20, 20]
[[stuff]]
constants = "griffiths2024:cortex"
[[given]]
boundary = "bottom"
[[given]]
boundary = "plate"
by_mm = [0, 0, -0.2]
[course]
ramp_s = 1
elapsed_s = 1
[[ask]]
boundary = "plate"
tolerance = 0.2
"""


def read(tmp_path, text):
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return Loading.from_toml(path)


def test_a_file_is_read_in_its_units_and_written_back(tmp_path):
    scene = read(tmp_path, TOML)
    assert scene.given[1].by == (0, 0, -0.0002) and scene.piece.plate == (0.02, 0.02)
    assert scene.stuff[0].law() == constants("griffiths2024:cortex").law()
    assert read(tmp_path, scene.to_toml()) == scene


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[20, 20]", "[80, 20]", "piece.plate_mm"),
        ("[piece]", "[piece]\nshape = 'head'", "only a block"),
        ("[piece]", "[piece]\nslot_mm = [4, 20]", "not both"),
        ("[piece]", "[piece]\nlesion_mm = 30", "piece.lesion_mm"),
        ("by_mm = [0, 0, -0.2]", "hold = 'touching'", "hold"),
        ("by_mm = [0, 0, -0.2]", "by_mm = [0, 0, -0.2]\nalong = 'z'\nhold = 'touching'", "hold"),
        ("elapsed_s = 1", "elapsed_s = 0.5", "course.elapsed_s"),
        ("ramp_s = 1", "ramp_s = 1\nfrequency_Hz = 50\ngravity = [0, 0, 1]", "course.gravity"),
        ('constants = "griffiths2024:cortex"', "poisson = 0.4", "mu_Pa"),
        ('constants = "griffiths2024:cortex"', "mu_Pa = 1000\nalpha = [1, 2]", "alpha"),
        ('constants = "griffiths2024:cortex"', "mu_Pa = 1e300", "moduli of 0.001 to 1e9 Pa"),
        ('constants = "griffiths2024:cortex"', "mu_Pa = 1e-300", "moduli of 0.001 to 1e9 Pa"),
        ('constants = "griffiths2024:cortex"', "mu_Pa = 1000\nalpha = 1e300", "exponents of size 0.001 to 1000"),
        ("[course]", "[[pull]]\nboundary = 'plate'\ntraction_Pa = [0, 0, 1e12]\n[course]", "at most 1e.09 Pa"),
        ('constants = "griffiths2024:cortex"', "mu_Pa = 1000\neta_Pa_s = 10", "eta_Pa_s"),
        ('constants = "griffiths2024:cortex"', "mu_Pa = 1000\npoisson = 0.5", "poisson"),
        ('constants = "griffiths2024:cortex"', "mu_Pa = 1000\nk1_Pa = 10", "fibre"),
        ("tolerance = 0.2", "tolerance = 3", "tolerance"),
        ("tolerance = 0.2", "quantity = 'displacement'", "point_mm"),
        ("tolerance = 0.2", "direction = [0, 0, 0]", "direction"),
        ("[[ask]]", "[[aks]]", "aks"),
        ("[[ask]]", "[[ask]]\nboundary = 'plate'\n[[ask]]", "asked already"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, old, new, said):
    assert old in TOML
    with pytest.raises(InputError, match=said):
        read(tmp_path, TOML.replace(old, new))


def test_questions_have_names_of_their_own(tmp_path):
    second = "[[ask]]\nboundary = 'plate'\ndirection = [1, 0, 0]\n[[ask]]"
    names = [ask.name for ask in read(tmp_path, TOML.replace("[[ask]]", second)).ask]
    assert names == ["force on plate along 1, 0, 0, end", "force on plate, end"]
