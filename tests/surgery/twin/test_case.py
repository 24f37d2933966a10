"""The case file: base scene and plans as differences, and bad input in one line each."""

import pytest

from ngbrain.errors import InputError
from ngbrain.scene import Scene
from ngbrain.surgery.twin.case import Case, Craniotomy, Lesion
from ngbrain.surgery.twin.norms import Norm

PLANS = [{"name": "a"}, {"name": "b", "tool": {"travel_mm": 2.0}}]


def case(**more):
    return Case.from_dict({"scene": "idealised_fast", "plan": PLANS} | more)


def test_a_plan_is_the_base_scene_with_other_keys():
    base = Scene.shipped("idealised_fast")
    found = case().scenes()
    assert found["a"].tool == base.tool and len(found["a"].protocols) == 1
    assert found["b"].tool.travel == pytest.approx(2e-3) and found["b"].cleft == base.cleft


def test_a_target_replaces_the_base_one_and_a_protocol_the_base_ones():
    plan = {
        "name": "c",
        "cleft": {"target_mm": [20.0, 6.0, 26.0]},
        "protocol": {"kind": "staged", "stages": 2, "rest_s": 20.0},
    }
    scene = case(plan=[*PLANS, plan]).scenes()["c"]
    assert scene.operated.target == pytest.approx((0.02, 0.006, 0.026)) and scene.protocols[0].kind == "staged"


MAP = {"map": "m.nii", "sd": "s.nii", "frequency_Hz": 50.0}


def test_a_case_survives_writing(tmp_path):
    given = case(stiffness=MAP, lesion=[{"centre_mm": [1, 2, 3], "diameter_mm": 6.0}])
    (tmp_path / "case.toml").write_text(given.to_toml())
    again = Case.from_toml(tmp_path / "case.toml")
    assert again.lesions == given.lesions and again.plans == given.plans
    assert again.stiffness.map == str(tmp_path / "m.nii") and again.norm == "brain" and again.scene == "idealised_fast"


def test_files_of_a_case_are_relative_to_it(tmp_path):
    (tmp_path / "case.toml").write_text(case(scene="base.toml", norm="norm.toml").to_toml())
    found = Case.from_toml(tmp_path / "case.toml")
    assert (found.scene, found.norm) == (str(tmp_path / "base.toml"), str(tmp_path / "norm.toml"))


def test_the_template_is_a_case():
    import tomllib

    found = Case.from_dict(tomllib.loads(Case.template()))
    assert [plan.name for plan in found.plans] == ["gentle", "wide"]


@pytest.mark.parametrize(
    ("more", "line"),
    [
        ({"plan": PLANS[:1]}, "plan is given 1 time"),
        ({"plan": [{"name": "a"}, {"name": "a"}]}, "plan.name is 'a'"),
        ({"lesion": 2 * [{"centre_mm": [0, 0, 0], "diameter_mm": 6.0}]}, "lesion.name is 'lesion'"),
        ({"stiffness": {"map": "m.nii"}}, "stiffness.sd is missing; wanted: a volume of standard deviations"),
        ({"stiffness": {"map": "m.nii", "waves": "w.npz", "sd": "s.nii"}}, "wanted: the path of a map, or waves"),
        ({"stiffness": {"map": "m.nii", "low": "l.nii"}}, "wanted: this key and high"),
        (
            {"stiffness": {"map": "m.nii", "sd": "s.nii"}},
            "stiffness.frequency_Hz is missing; wanted: the frequency of the waves",
        ),
        ({"stiffness": {"waves": "w.npz", "frequency_Hz": 50.0}}, "wanted: this key only with stiffness.map"),
        ({"structures": "labels.nii"}, "scheme is missing; wanted: the numbering"),
        ({"link": {"exponent": [1.2, 0.5]}}, "link.exponent is"),
        ({"plan": [{"name": "a", "tool": [{}, {}]}, PLANS[1]]}, "wanted: one table"),
        ({"scene": "idealized"}, "scene is 'idealized'"),
    ],
)
def test_bad_input_is_one_line(more, line):
    with pytest.raises(InputError, match=r"^[^\n]*$") as error:
        case(**more).scenes()
    assert line in str(error.value)


def test_what_is_wrong_in_a_plan_names_it():
    plans = [PLANS[0], {"name": "wide", "tool": {"width_mm": 40.0}}]
    with pytest.raises(InputError, match=r"plan 'wide': tool#1.width_mm is 40"):
        case(plan=plans).scenes()


def test_a_plan_outside_the_craniotomy_is_refused_with_the_distance():
    import numpy as np

    with_opening = case(craniotomy={"centre_mm": [0.0, 0.0, 60.0], "diameter_mm": 30.0})
    assert with_opening.craniotomy == Craniotomy(centre=(0.0, 0.0, 0.06), diameter=0.03)
    with_opening.check_opening("a", np.array([0.0, 0.0, 0.06]), 0.012)
    with pytest.raises(InputError, match=r"plan 'a': cleft is 20.0 mm from the centre.*within 9.0 mm"):
        with_opening.check_opening("a", np.array([0.02, 0.0, 0.06]), 0.012)


def test_a_lesion_of_less_than_8_mm_is_not_resolved():
    assert (
        not Lesion(centre=(0, 0, 0), diameter=7.9e-3).is_resolved
        and Lesion(centre=(0, 0, 0), diameter=8e-3).is_resolved
    )


def test_a_frequency_without_a_norm_is_refused():
    norm = Norm.named("brain")
    norm.check_frequency(60.0)
    with pytest.raises(InputError, match=r"stiffness.frequency_Hz is 400; wanted: 20 to 100 Hz"):
        norm.check_frequency(400.0)
    with pytest.raises(InputError, match="norm is 'brian'"):
        Norm.named("brian")


def test_a_norm_follows_the_spring_pot_of_its_loss_tangent():
    white = Norm.named("brain").tissue("white")
    # tan(pi a/2) = .45 at a = .2690: |G*| at 100 Hz over that at 50 Hz is 2^.2690
    assert white.modulus_at_frequency(100.0) / white.modulus_at_frequency(50.0) == pytest.approx(1.2050, abs=2e-4)
    assert white.deviation(50.0) == 0 and white.deviation(100.0) == pytest.approx(0.1 * 0.6931, abs=1e-4)
