"""Loaded bodies as plain data: read, written, refused."""

import pytest

from ngbrain.errors import InputError
from ngbrain.materials import constants
from ngbrain.scene import Scene

TOML = """
title = "Palpation"
[geometry]
kind = "block"
size_mm = [60, 60, 40]
plate_mm = [20, 20]
[[tissue]]
material = "griffiths2024:cortex"
[[displacement_bc]]
boundary = "bottom"
[[displacement_bc]]
boundary = "plate"
value_mm = [0, 0, -0.2]
[time]
ramp_s = 1
end_s = 1
[[quantity]]
name = "force"
boundary = "plate"
tolerance = 0.2
"""

HEAVY = (
    "[time]",
    """[gravity]
acceleration_m_s2 = [0, 0, -9.81]
imaged_acceleration_m_s2 = [0, 9.81, 0]
[fluid]
density_kg_m3 = 1007
drained_to_mm = 20
[time]""",
)


def read(tmp_path, text):
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return Scene.from_toml(path)


def test_a_file_is_read_in_its_units_and_written_back(tmp_path):
    scene = read(tmp_path, TOML)
    assert scene.displacement_bcs[1].value == (0, 0, -0.0002) and scene.geometry.plate == (0.02, 0.02)
    assert scene.tissues[0].law() == constants("griffiths2024:cortex").law()
    assert read(tmp_path, scene.to_toml()) == scene


def test_gravity_fluid_and_swelling_are_read_and_written_back(tmp_path):
    text = TOML.replace(*HEAVY).replace('"griffiths2024:cortex"', '"griffiths2024:cortex"\nswelling_percent = -7.7')
    scene = read(tmp_path, text)
    assert scene.gravity.imaged == (0, 9.81, 0) and scene.fluid.drained_to == 0.02
    assert scene.tissues[0].swelling == -7.7 / 100 and scene.is_preloaded
    assert read(tmp_path, scene.to_toml()) == scene and "swelling_percent = -7.7" in scene.to_toml()
    assert "1 gravity, 1 fluid, 1 swelling" in scene.summary()["conditions"]


def test_gravity_or_swelling_alone_load_a_body(tmp_path):
    held = TOML.replace('[[displacement_bc]]\nboundary = "plate"\nvalue_mm = [0, 0, -0.2]\n', "")
    assert not read(tmp_path, held).is_preloaded
    assert read(tmp_path, held.replace('cortex"', 'cortex"\nswelling_percent = 3')).is_preloaded


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[20, 20]", "[80, 20]", "geometry.plate_mm"),
        ('kind = "block"\nsize_mm = [60, 60, 40]', 'kind = "idealised"', "only a block"),
        ("size_mm = [60, 60, 40]\n", "", "geometry.size_mm is missing; wanted: a value for kind = 'block'"),
        ("plate_mm", "slot_mm = [4, 20]\nplate_mm", "not both"),
        ("plate_mm", "lesion_radius_mm = 30\nlesion_centre_mm = [0, 0, 20]\nplate_mm", "geometry.lesion_radius_mm"),
        ("plate_mm", "lesion_radius_mm = 3\nplate_mm", "geometry.lesion_centre_mm is missing"),
        (
            '"block"\nsize_mm = [60, 60, 40]\nplate_mm = [20, 20]',
            '"mni152"\nstiffness_map = "map.nii"',
            "geometry.stiffness_map .* a head under loads does not have it yet",
        ),
        ("value_mm = [0, 0, -0.2]", "contact = 'frictionless'", "value_mm"),
        ("[0, 0, -0.2]", "[0, 0, -0.2]\ncontact = 'sliding'", "value_mm .* all 0: the surface along which"),
        ("[time]", "[fluid]\ndensity_kg_m3 = 1007\n[time]", "fluid.density_kg_m3 .* .gravity. to go with it"),
        (
            HEAVY[0],
            HEAVY[1].replace("1007", "1e5"),
            "fluid.density_kg_m3 is 100000.*; wanted: a density of 100 to 5000",
        ),
        (
            HEAVY[0],
            HEAVY[1].replace("= 20", "= 1e6"),
            "fluid.drained_to_mm is 1.*; wanted: a height of at most 2000 mm",
        ),
        (HEAVY[0], HEAVY[1].replace("[0, 9.81, 0]", "[0, 1e9, 0]"), "gravity.imaged_acceleration_m_s2"),
        (
            '"griffiths2024:cortex"',
            '"griffiths2024:cortex"\nswelling_percent = -50',
            "tissue#1.swelling_percent is -50.*; wanted: a change of volume of -30 to 100",
        ),
        (
            '"griffiths2024:cortex"\n',
            '"griffiths2024:cortex"\nswelling_percent = 3\n[time]\nfrequency_Hz = 5\n#',
            "swelling_percent|time",
        ),
        ("-0.2]", "-0.2]\ncomponents = 'z'\ncontact = 'frictionless'", "components"),
        ("end_s = 1", "end_s = 0.5", "time.end_s"),
        ("[time]", "[gravity]\nacceleration_m_s2 = [0, 0, 9.81]\n[time]\nfrequency_Hz = 50", "gravity"),
        ("[time]", "[gravity]\nacceleration_m_s2 = [0, 0, 0]\n[time]", "gravity.acceleration_m_s2"),
        (
            "[time]",
            "[[tool]]\n[time]",
            "tool is given; wanted: this table left out: without a .cleft. there is no operation",
        ),
        ('[[quantity]]\nname = "force"\nboundary = "plate"\ntolerance = 0.2', "", "quantity is missing"),
        ('name = "force"', "name = 'peak_force_N'", "quantity#1.name is 'peak_force_N'; wanted: one of force"),
        ('material = "griffiths2024:cortex"', "poissons_ratio = 0.4", "mu_Pa"),
        ('material = "griffiths2024:cortex"', "mu_Pa = 1000\nalpha = [1, 2]", "alpha"),
        ('material = "griffiths2024:cortex"', "mu_Pa = 1e300", "moduli of 0.001 to 1e9 Pa"),
        ('material = "griffiths2024:cortex"', "mu_Pa = 1e-300", "moduli of 0.001 to 1e9 Pa"),
        ('material = "griffiths2024:cortex"', "mu_Pa = 1000\nalpha = 1e300", "exponents of size 0.001 to 1000"),
        (
            "value_mm = [0, 0, -0.2]",
            "value_mm = [0, 0, 'q*t']",
            "displacement_bc#2.value_mm is .* wanted: one of pi, t, x, y, z",
        ),
        (
            "value_mm = [0, 0, -0.2]",
            "value_mm = [0, 0, 'open(t)']",
            "displacement_bc#2.value_mm is .* wanted: one of sin",
        ),
        (
            "value_mm = [0, 0, -0.2]",
            "value_mm = [0, 0, true]",
            "a length in mm, or a formula of x, y, z .mm. and t .s.",
        ),
        ("value_mm = [0, 0, -0.2]", "rotation_deg = 5", "displacement_bc#2.axis is missing"),
        ("value_mm = [0, 0, -0.2]", "rotation_deg = 'x'\naxis = [0, 0, 1]", "rotation_deg is .* wanted: one of pi, t"),
        ("value_mm = [0, 0, -0.2]", "rotation_deg = 999\naxis = [0, 0, 1]", "at most 720 degrees"),
        ("value_mm = [0, 0, -0.2]", "centre_mm = [0, 0, 1]", "centre_mm"),
        (
            "-0.2]",
            "'-x']\ncontact = 'frictionless'",
            "value_mm .* numbers: a frictionless face moves along a straight line",
        ),
        ("-0.2]\n[time]", "'t']\n[time]\nfrequency_Hz = 5", "value_mm .* in a harmonic problem they are amplitudes"),
        ("[time]", "[[pressure]]\nboundary = 'top'\nvalue_Pa = 1e12\n[time]", "pressure#1.value_Pa .* at most 1e.09"),
        ("[time]", "[[pressure]]\nboundary = 'top'\nvalue_Pa = 1\n[time]\nfrequency_Hz = 5", "a ..traction.."),
        (
            "[time]",
            "[[contact]]\nboundary = 'top'\nshape = 'ball'\npoint_mm = [0, 0, 9]\n[time]",
            "contact#1.radius_mm",
        ),
        (
            "[time]",
            "[[contact]]\nboundary = 'top'\nshape = 'plane'\npoint_mm = [0, 0, 9]\n[time]",
            "contact#1.direction",
        ),
        ("[time]", "[[traction]]\nboundary = 'plate'\nvalue_Pa = [0, 0, 1e12]\n[time]", "at most 1e.09 Pa"),
        ('material = "griffiths2024:cortex"', "mu_Pa = 1000\neta_Pa_s = 10", "eta_Pa_s"),
        ('material = "griffiths2024:cortex"', "mu_Pa = 1000\npoissons_ratio = 0.5", "poissons_ratio"),
        ('material = "griffiths2024:cortex"', "mu_Pa = 1000\nfibre_stiffness_Pa = 10", "fibre"),
        ("tolerance = 0.2", "tolerance = 3", "tolerance"),
        ('name = "force"\nboundary = "plate"', "name = 'displacement'", "point_mm"),
        ("tolerance = 0.2", "direction = [0, 0, 0]", "direction"),
        ("[[quantity]]", "[[quantiy]]", "quantiy"),
        ("[[quantity]]", "[[quantity]]\nname = 'force'\nboundary = 'plate'\n[[quantity]]", "not used before"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, old, new, said):
    assert old in TOML
    with pytest.raises(InputError, match=said):
        read(tmp_path, TOML.replace(old, new))


def test_questions_have_names_of_their_own(tmp_path):
    second = "[[quantity]]\nname = 'force'\nboundary = 'plate'\ndirection = [1, 0, 0]\n[[quantity]]"
    names = [quantity.label for quantity in read(tmp_path, TOML.replace("[[quantity]]", second)).quantities]
    assert names == ["force on plate along 1, 0, 0, end", "force on plate, end"]


def test_times_that_are_assumed_are_said(tmp_path):
    """Where tissue relaxes, which griffiths2024:cortex does; not where a scene gives its times."""
    untimed = TOML.replace("[time]\nramp_s = 1\nend_s = 1\n", "")
    assert untimed != TOML
    said = "time is not given: time.ramp_s = 10 and time.end_s = 900 are assumed"
    assert said in read(tmp_path, untimed).warnings and not any("time is" in w for w in read(tmp_path, TOML).warnings)
    elastic = untimed.replace('material = "griffiths2024:cortex"', "mu_Pa = 900")
    assert said not in read(tmp_path, elastic).warnings
