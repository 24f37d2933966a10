"""A scene is what its file says, both ways; whatever is wrong with one is an InputError of one line that names it."""

import copy
import dataclasses
import datetime
import itertools
import json
import math
import random
import re
import tomllib
from importlib import resources

import numpy as np
import pytest

from ngbrain import fields
from ngbrain import scene as room
from ngbrain.errors import InputError
from ngbrain.materials import NeoHooke, Viscous, constants
from ngbrain.scene import Blade, Cleft, Protocol, Scene, Tissue
from ngbrain.scene.programs import Ask
from ngbrain.surgery import observe
from ngbrain.surgery.model import Model
from ngbrain.surgery.protocols import Force

NAMES = ["demo", "demo_fast", "idealised", "idealised_fast"]
SMALLEST = {"tissue": [{"region": ".*", "mu_Pa": 500}], "cleft": {"target_mm": [17, 5.9, 26.2]}}
DELETED = object()


def text_of(name):
    return (resources.files("ngbrain.scenes") / f"{name}.toml").read_text("utf-8")


@pytest.fixture
def demo():
    """The demo with the numbers that the tests below count on, whatever the shipped one is tuned to."""
    data = tomllib.loads(text_of("idealised"))
    data["body"] = {"head": "idealised", "site_mm": 2.0, "near_mm": 6.0, "far_mm": 20.0, "order": 2}
    data["cleft"] |= {"width_mm": 12.0, "opening_mm": 4.0, "craniotomy_mm": 40.0}
    data["blade"] = {"width_mm": 10.0, "edge_radius_mm": 1.0, "tip_mm": 4.0, "thickness_mm": 2.0}
    data["retraction"] = {"opening_mm": 5.0, "ramp_s": 10.0, "elapsed_s": 900.0}
    data["protocol"][1:] = [
        {"kind": "intermittent", "hold_s": 230.0, "rest_s": 90.0},
        {"kind": "staged", "stages": 5, "rest_s": 30.0},
    ]
    return data


def put(data, path, value):
    """A copy of nested tables with one entry replaced, added or DELETED; in the path, list items count from 0."""
    data = copy.deepcopy(data)
    *way, last = [int(step) if step.isdigit() else step for step in path.split(".")] if isinstance(path, str) else path
    at = data
    for step in way:
        at = at[step]
    if value is DELETED:
        del at[last]
    else:
        at[last] = value
    return data


def refusal(data, file=None):
    with pytest.raises(InputError) as caught:
        Scene.from_dict(data, file)
    assert len(str(caught.value).splitlines()) == 1
    return caught.value


# What a file says, in SI.


def test_a_file_in_si_units(demo):
    demo["blade"] = {"width_mm": 10, "edge_radius_mm": 1.5, "tip_mm": 4.0, "thickness_mm": 2.0}
    scene = Scene.from_dict(demo)
    assert scene.blade == Blade(width=0.010, edge_radius=0.0015, tip=0.004, thickness=0.002)
    assert scene.cleft.target == pytest.approx(np.array(demo["cleft"]["target_mm"]) / 1000, rel=1e-12)
    assert (scene.cleft.approach, scene.cleft.across) == (None, None)
    assert (scene.retraction.opening, scene.retraction.ramp, scene.retraction.elapsed) == (0.005, 10.0, 900.0)
    assert [tissue.region for tissue in scene.tissues] == ["cortex", "white", "ventricle.*"]
    assert (scene.tissues[1].constants, scene.tissues[2].mu) == ("griffiths2024:white_matter", (50.0,))
    assert (scene.protocols[1].hold, scene.protocols[1].rest, scene.protocols[2].stages) == (230.0, 90.0, 5)
    assert scene.support.fixed == "skull" and scene.steps.longest == 60.0


@pytest.mark.parametrize("name", NAMES)
def test_shipped_scenes_compare_three_protocols(name):
    scene = Scene.shipped(name)
    kinds = ["continuous", "intermittent", "staged"]
    assert [p.kind for p in scene.protocols] == [p.name for p in scene.protocols] == kinds


@pytest.mark.parametrize("name", NAMES)
def test_shipped_intermittent_ends_exactly_with_a_hold(name):
    scene = Scene.shipped(name)
    hold, rest = next((p.hold, p.rest) for p in scene.protocols if p.kind == "intermittent")
    holds = (scene.retraction.elapsed + rest) / (scene.retraction.ramp + hold + rest)
    assert holds == int(holds) >= 2


@pytest.mark.parametrize("name", NAMES)
def test_shipped_scenes_spell_out_every_section_and_key_that_has_a_default(name):
    written, full = tomllib.loads(text_of(name)), Scene.shipped(name).to_dict()
    for p in full["protocol"]:
        del p["name"]
    full["tissue"][2]["mu_Pa"] = full["tissue"][2]["mu_Pa"][0]
    assert written == full


def test_the_smallest_scene_falls_back_on_the_defaults():
    scene = Scene.from_dict(SMALLEST)
    assert scene.blade == Blade(width=0.010, edge_radius=0.002, tip=0.004, thickness=0.004)
    assert scene.retraction == room.Retraction(opening=0.005, ramp=10.0, elapsed=900.0)
    assert scene.protocols == (
        Protocol(kind="continuous"),
        Protocol(kind="intermittent", hold=230.0, rest=90.0),
        Protocol(kind="staged", stages=5, rest=30.0),
    )
    assert (
        scene.tissues[0].bulk_ratio is None
        and scene.tissues[0].bulk == 1000.0 * 500
        and scene.support.fixed == "skull"
        and scene.body.order == 2
    )
    demo = Scene.shipped("idealised")
    assert (scene.body, scene.blade, scene.cleft, scene.steps) == (demo.body, demo.blade, demo.cleft, demo.steps)
    single = SMALLEST | {"tissue": SMALLEST["tissue"][0]}
    assert Scene.from_dict(single) == scene  # [tissue] for [[tissue]]


# There and back.


@pytest.mark.parametrize("name", NAMES)
def test_round_trips(name, tmp_path):
    scene = dataclasses.replace(Scene.shipped(name), title='A "title" with \\ and é, α, 🧠')
    assert Scene.from_dict(scene.to_dict()) == scene
    assert Scene.from_dict(json.loads(json.dumps(scene.to_dict()))) == scene
    (tmp_path / "case.toml").write_text(scene.to_toml(), "utf-8")
    assert Scene.from_toml(tmp_path / "case.toml") == scene
    assert tomllib.loads(scene.to_toml()) == scene.to_dict()


def test_round_trip_of_a_scene_with_everything_there_is(demo):
    demo["protocol"].append({"kind": "program", "name": "mine", "t_s": [0, 1, 900], "opening_mm": [-1, 3.3, 3.3]})
    demo["tissue"].append({"region": "x", "mu_Pa": [1.1, 2.2], "alpha": [-4.7, 3.0], "eta_Pa_s": [7.7]})
    demo["cleft"] |= {"approach": [0, 0, 1], "across": [1, 0.5, 0]}
    demo["patient"] = {"map_mmHg": 85.3, "icp_mmHg": 0.0}
    scene = Scene.from_dict(demo)
    assert scene.to_dict()["patient"] == demo["patient"]
    assert Scene.from_dict(tomllib.loads(scene.to_toml())) == scene
    assert scene.protocols[3].opening == (-0.001, 0.0033, 0.0033) and scene.protocols[3].times == (0, 1, 900)
    assert scene.cleft.across == (1.0, 0.5, 0.0)


def test_a_given_force_alone_or_over_time(demo):
    demo["protocol"] = [
        {"kind": "force", "force_gf": 30},
        {"kind": "force", "name": "let go", "t_s": [0, 10, 20, 30, 900], "force_gf": [0, 30, 30, 0, 0]},
    ]
    scene = Scene.from_dict(demo)
    assert Scene.from_dict(tomllib.loads(scene.to_toml())) == scene
    held, let_go = (Model.program(scene, asked) for asked in scene.protocols)
    assert held == Force("force", (0.0, 10.0, 900.0), (0.0, 0.2941995, 0.2941995)) and held.working_s == 890
    assert (
        let_go.times == (0, 10, 20, 30, 900)
        and [let_go.at(15), 2 * held.at(5)] == pytest.approx([held.at(10)] * 2)
        and let_go.at(800) == 0
    )


def test_any_length_survives_the_way_to_millimetres_and_back(rng):
    for width in [*rng.uniform(1e-3, 1e-1, 2000), *(k * 1e-4 for k in range(20, 500)), math.pi * 1e-2]:
        blade = Blade(width=float(width), edge_radius=1e-3)
        assert blade.width == pytest.approx(width, rel=1e-15, abs=0)
        assert Blade(width=blade.shown("width") / 1000).width == blade.width


def test_what_is_written_is_what_was_read():
    for k in range(0, 30000, 7):
        target = [k / 10, -k / 100, k / 8]
        assert Cleft(target=[c / 1000 for c in target]).to_dict()["target_mm"] == target
    for target in ([5.9, -26.2, 0.1 + 0.2], [1 / 3, 2 / 3, 1e-7]):
        assert (
            Scene.from_dict(put(SMALLEST, "cleft.target_mm", target)).to_dict()["cleft"]["target_mm"][:2] == target[:2]
        )


def test_integers_numpy_numbers_arrays_and_lists_do_in_python():
    cleft = Cleft(target=np.array([0.017, 0, 0.026]), width=np.float32(0.0125), across=[1, 0, 0])
    assert cleft == Cleft(target=(0.017, 0.0, 0.026), width=float(np.float32(0.0125)), across=(1.0, 0.0, 0.0))
    assert Tissue(region="x", mu=500).mu == (500.0,) and hash(cleft)


def test_replace_gives_a_checked_scene():
    demo = Scene.shipped("idealised")
    wide = dataclasses.replace(demo, cleft=dataclasses.replace(demo.cleft, width=0.02, craniotomy=0.05))
    assert wide.cleft.width == 0.02 and wide.blade == demo.blade
    with pytest.raises(InputError, match=r"^blade\.width_mm is 14\.0; .*12, cleft\.width_mm"):
        dataclasses.replace(demo, blade=Blade(width=0.014))
    with pytest.raises(InputError, match=r"^blade\.width_mm is -14\.0"):
        Blade(width=-0.014)
    with pytest.raises(InputError, match=r"^blade is 3; wanted: a table"):
        dataclasses.replace(demo, blade=3)
    with pytest.raises(dataclasses.FrozenInstanceError):
        demo.blade.width = 1.0


# Tissue.


@pytest.mark.parametrize("name", ["cortex", "white_matter"])
def test_tissue_from_the_catalogue(name):
    tissue, published = Tissue(region="x", constants=f"griffiths2024:{name}"), constants(f"griffiths2024:{name}")
    assert tissue.law() == published.law() and isinstance(tissue.law(), Viscous)
    assert tissue.initial_modulus == published.initial_modulus and tissue.bulk == 1000 * published.initial_modulus
    assert tissue.published is published


def test_tissue_by_lists_is_the_tissue_by_name():
    lists = {"mu": (420.0, 1400.0, 560.0), "alpha": (-21.27, -14.66, -23.76), "eta": (3050.0, 289370.0)}
    tissue = Tissue(region="x", **lists, bulk_ratio=50.0)
    assert tissue.law() == constants("griffiths2024:cortex").law() and tissue.bulk == 50 * 2380
    assert tissue.published is None


def test_a_single_modulus_is_neo_hooke_and_has_no_exponent_to_replace():
    tissue = Tissue(region="ventricle.*", mu=50.0, bulk_ratio=10.0)
    assert tissue.law() == Viscous(NeoHooke(50.0)) and tissue.bulk == 500.0
    assert tissue.with_alpha(-4.7) == tissue


def test_with_alpha_keeps_moduli_and_times():
    tissue = Tissue(region="x", constants="griffiths2024:cortex")
    other = tissue.with_alpha(-4.7)
    assert other.alpha == (-4.7,) * 3 and other.law().equilibrium.alpha == -4.7
    assert other.initial_modulus == tissue.initial_modulus and other.bulk == tissue.bulk
    assert [b.tau for b in other.law().branches] == pytest.approx([b.tau for b in tissue.law().branches], rel=1e-8)
    assert [b.law.mu for b in other.law().branches] == [b.law.mu for b in tissue.law().branches]
    assert other.published is None and other.region == "x"


@pytest.mark.parametrize("given", [{"constants": "griffiths2024:cortex"}, {"mu": 50.0}, {"mu": 50.0, "alpha": -4.0}])
def test_scaled_doubles_moduli_and_keeps_times(given):
    tissue = Tissue(region="x", **given)
    double = tissue.scaled(2.0)
    assert double.initial_modulus == 2 * tissue.initial_modulus and double.bulk == 2 * tissue.bulk
    law, twice = tissue.law(), double.law()
    assert [b.tau for b in twice.branches] == pytest.approx([b.tau for b in law.branches], rel=1e-8)
    assert twice.equilibrium == dataclasses.replace(law.equilibrium, mu=2 * law.equilibrium.mu)
    assert double.published is tissue.published and tissue.scaled(2.0).scaled(3.0).scale == 6.0
    with pytest.raises(InputError, match="scale"):
        tissue.scaled(-1.0)


# What is refused: where, what to put there, and what the line must say.

BAD = [
    ("blade.widht_mm", 10.0, r"^case.toml: blade\.widht_mm is not a known key; wanted: did you mean 'width_mm'\?$"),
    ("blade.width_cm", 1.0, r"blade\.width_cm is not a known key; .*'width_mm'"),
    ("balde", {}, r"^case.toml: balde is not a known key; wanted: did you mean 'blade'\?$"),
    ("tissue.1.mu_kPa", 1.0, r"tissue#2\.mu_kPa is not a known key; .*'mu_Pa'"),
    ("protocol.1.hold", 1.0, r"protocol#2\.hold is not a known key; .*'hold_s'"),
    ("body.two\nlines", 1, r"body\.'two\\nlines' is not a known key"),
    ("body.head", "real", r"body\.head is 'real'; wanted: one of idealised, mni152, scan"),
    ("body.shear_modulus_map", "a.nii", r"body\.shear_modulus_map is 'a\.nii'; wanted: .*idealised head"),
    ("body.shear_modulus_space", "head", r"body\.shear_modulus_space is 'head'; wanted: this key only with a map"),
    (
        "body",
        {"head": "scan", "image": "t1.nii", "shear_modulus_map": "a.nii"},
        r"body\.shear_modulus_space is missing; wanted: head or mni152",
    ),
    ("body.order", 5, r"body\.order is 5; wanted: a whole number from 2 to 4"),
    ("body.order", 2.0, r"body\.order is 2\.0; wanted: a whole number"),
    ("body.order", True, r"body\.order is True"),
    ("body.site_mm", 12.0, r"body\.near_mm is .*; wanted: at least 12, body\.site_mm"),
    ("body.site_mm", 0.003, r"body\.site_mm is 0\.003; wanted: a length in mm of at least 0\.2"),
    ("body.far_mm", 1.0, r"body\.far_mm is 1\.0; wanted: .*at least 2"),
    ("body.near_mm", 30.0, r"body\.far_mm is .*; wanted: at least 30, body\.near_mm"),
    ("tissue", [], r"tissue is \[\]; wanted: one or more tables \[\[tissue\]\]"),
    ("tissue", 3, r"tissue#1 is 3; wanted: a table"),
    ("tissue", DELETED, r"tissue is missing; .*\[\[tissue\]\]"),
    ("tissue.0.region", DELETED, r"tissue#1\.region is missing"),
    ("tissue.0.region", "(", r"tissue#1\.region is '\('; wanted: a name or a regular expression"),
    ("tissue.0.region", "(?i)cortex", r"tissue#1\.region is '\(\?i\)cortex'; wanted: .*ECMAScript"),
    ("tissue.0.region", "c{,9}ortex", r"tissue#1\.region is 'c\{,9\}ortex'; wanted: .*ECMAScript"),
    ("tissue.0.region", "cortex" + "|a" * 100, r"tissue#1\.region is 'cortex.*; wanted: .*up to 200 characters"),
    ("tissue.0.region", " ", r"tissue#1\.region is ' '"),
    ("tissue.1.region", "cortex", r"tissue#2\.region is 'cortex'; .*not used before"),
    ("tissue.0.constants", "griffiths2024:cortx", r"tissue#1\.constants is .*; wanted: .*griffiths2024:cortex"),
    ("tissue.0.constants", DELETED, r"tissue#1\.constants is missing; wanted: .*mu_Pa"),
    ("tissue.0.mu_Pa", 1.0, r"tissue#1\.mu_Pa is \[1\.0\]; .*not both"),
    ("tissue.2.mu_Pa", -50.0, r"tissue#3\.mu_Pa is -50\.0; wanted: a modulus in Pa greater than 0"),
    ("tissue.2.mu_Pa", [1.0, 2.0], r"tissue#3\.alpha is missing; .*mu_Pa, 2"),
    ("tissue.2.mu_Pa", [], r"tissue#3\.mu_Pa is \[\]"),
    ("tissue.2", {"region": "v", "alpha": [1.0]}, r"tissue#3\.mu_Pa is missing"),
    ("tissue.2", {"region": "v", "mu_Pa": 1.0, "alpha": 0.0}, r"tissue#3\.alpha is \[0\.0\]; .*none of them 0"),
    ("tissue.2", {"region": "v", "mu_Pa": 1.0, "alpha": 1e300}, r"#3\.alpha is \[1e\+300\]; wanted: .* 0\.001 to 1000"),
    ("tissue.2", {"region": "v", "mu_Pa": 1.0, "alpha": 1e-9}, r"#3\.alpha is \[1e-09\]; wanted: .* 0\.001 to 1000"),
    ("tissue.2", {"region": "v", "mu_Pa": [1.0, 1.0], "alpha": [1.0, 1.0]}, r"tissue#3\.eta_Pa_s is missing; .*1"),
    ("tissue.2", {"region": "v", "mu_Pa": 1.0, "eta_Pa_s": [1.0]}, r"tissue#3\.eta_Pa_s is \[1\.0\]; .*fewer"),
    ("tissue.2", {"region": "v", "mu_Pa": 1e300}, r"tissue#3\.mu_Pa is \[1e\+300\]; wanted: moduli of 0\.001 to 1e9 Pa"),
    ("tissue.2.bulk_ratio", 1e300, r"tissue#3\.bulk_ratio is 1e\+300; wanted: a ratio of 0\.001 to 1e9"),
    ("tissue.2.bulk_ratio", 0, r"tissue#3\.bulk_ratio is 0; wanted: a number greater than 0"),
    ("support.fixed", 3, r"support\.fixed is 3; wanted: a name"),
    ("cleft", DELETED, r"cleft is missing"),
    ("cleft.target_mm", DELETED, r"cleft\.target_mm is missing; .*length in mm in each of 3 places"),
    ("cleft.target_mm", [1.0, 2.0], r"cleft\.target_mm is \[1\.0, 2\.0\]; .*3 places"),
    ("cleft.target_mm", [1.0, math.nan, 2.0], r"cleft\.target_mm is \[1\.0, nan, 2\.0\]"),
    ("cleft.target_mm", 3.0, r"cleft\.target_mm is 3\.0"),
    ("cleft.target_mm", [0, 0, 99], r"cleft\.target_mm is .*99.*; wanted: a point inside the brain"),
    ("cleft.target_mm", [0, 0, 1e290], r"cleft\.target_mm is .*; wanted: a point inside the brain"),
    ("cleft.target_mm", [14, 0, 6], r"cleft\.target_mm is .*; wanted: .*not in a ventricle"),
    ("cleft.target_mm", [0, 0, 0], r"cleft\.approach is missing; wanted: a direction: .*cleft\.target_mm = \[0, 0, 0\]"),
    ("cleft.target_mm", [60, 0, 0], r"blade\.tip_mm is 4\.0; wanted: 5 or more below 5\.98.*cleft\.target_mm"),
    ("cleft.opening_mm", 1e-9, r"cleft\.opening_mm is 1e-09; wanted: .*at least 0\.1"),
    ("cleft.craniotomy_mm", 13.0, r"cleft\.craniotomy_mm is 13\.0; wanted: at least 2 more than 12\.65"),
    ("cleft.craniotomy_mm", 81.0, r"cleft\.craniotomy_mm is 81\.0; wanted: at most 80"),
    ("cleft.approach", [1e200, 0, 0], r"cleft\.approach is \[1e\+200, 0\.0, 0\.0\]; wanted: a direction: .*beyond 1000"),
    ("cleft.across", [0, 1e-200, 0], r"cleft\.across is \[0\.0, 1e-200, 0\.0\]; wanted: a direction: not all 0"),
    ("cleft.craniotomy_mm", 12.0, r"cleft\.craniotomy_mm is 12\.0; .*12\.65.*cleft\.width_mm.*cleft\.opening_mm"),
    ("cleft.approach", [0, 0, 0], r"cleft\.approach is \[0\.0, 0\.0, 0\.0\]; wanted: a direction"),
    ("cleft.width_mm", -12.0, r"cleft\.width_mm is -12\.0; wanted: a length in mm greater than 0"),
    ("cleft.width_mm", "12 mm", r"cleft\.width_mm is '12 mm'"),
    ("cleft.width_mm", True, r"cleft\.width_mm is True"),
    ("cleft.width_mm", math.inf, r"cleft\.width_mm is inf"),
    ("cleft.width_mm", math.nan, r"cleft\.width_mm is nan"),
    ("cleft.width_mm", 10**400, r"cleft\.width_mm is 1000"),
    ("cleft.width_mm", 10**5000, r"cleft\.width_mm is a number of thousands of digits"),
    ("cleft.width_mm", [12.0], r"cleft\.width_mm is \[12\.0\]"),
    ("blade.kind", "spatual", r"blade\.kind is 'spatual'; wanted: one of spatula, two spatulas, tube"),
    ("blade.tip_width_mm", 3.0, r"blade\.tip_width_mm is 3\.0; wanted: at least 4, and .*at most 10, blade\.width_mm"),
    ("blade.bend_radius_mm", 9.0, r"blade\.bend_radius_mm is 9\.0; wanted: at least .*, the height of the wall"),
    ("blade", {"kind": "tube", "bend_radius_mm": 60.0}, r"blade\.bend_radius_mm is 60\.0; wanted: this key left out"),
    ("blade", {"kind": "tube", "edge_radius_mm": 3.0}, r"blade\.edge_radius_mm is 3\.0; wanted: at most 2, half of cleft"),
    ("cleft.width_mm", 9.0, r"blade\.width_mm is 10\.0; wanted: at most 9, cleft\.width_mm: .*wider than the cleft"),
    ("blade", 3, r"blade is 3; wanted: a table"),
    ("blade.width_mm", 1.5, r"blade\.width_mm is 1\.5; .*blade\.edge_radius_mm"),
    ("blade.width_mm", 3.0, r"blade\.width_mm is 3\.0; wanted: at least 4, and twice blade\.edge_radius_mm = 1"),
    ("blade.friction", 1.5, r"blade\.friction is 1\.5; wanted: at most 1"),
    ("blade.friction", -0.1, r"blade\.friction is -0\.1; wanted: .*at least 0"),
    ("blade.tip_mm", 25.1, r"blade\.tip_mm is 25\.1; wanted: 5 or more below 29\.95, the height of the wall"),
    ("blade.edge_radius_mm", 0.5, r"blade\.edge_radius_mm is 0\.5; wanted: .*at least 1"),
    ("blade.tip_mm", 0.0, r"blade\.tip_mm is 0\.0; wanted: .*greater than 0"),
    ("blade.thickness_mm", 5.0, r"blade\.thickness_mm is 5\.0; wanted: at most 4, cleft\.opening_mm"),
    ("retraction.ramp_s", -1.0, r"retraction\.ramp_s is -1\.0; wanted: a time in s greater than 0"),
    ("retraction.ramp_s", 900.0, r"retraction\.elapsed_s is 900\.0; wanted: more than 900, retraction\.ramp_s"),
    ("retraction.elapsed_s", 950.0, r"#2\.hold_s .*rest_s = 90, .*ramp_s = 10 .*elapsed_s = 950; such as 246\.667"),
    ("retraction.opening_mm", 500.0, r"retraction\.opening_mm is 500\.0; wanted: at most 29\.95, the height of the wall"),
    ("retraction.opening_mm", 1e-9, r"retraction\.opening_mm is 1e-09; wanted: .*at least 0\.01"),
    ("retraction.ramp_s", 1e-3, r"retraction\.ramp_s is 0\.001; wanted: at least 0\.009, retraction\.elapsed_s / 100000"),
    ("retraction.ramp_s", 80.0, r"protocol#2\.rest_s is 90\.0; wanted: more than 112, .*opening_mm = 5 .*ramp_s = 80"),
    ("protocol", [], r"protocol is \[\]; wanted: one or more tables \[\[protocol\]\]"),
    ("protocol.0", 3, r"protocol#1 is 3; wanted: a table"),
    ("protocol.0.kind", DELETED, r"protocol#1\.kind is missing; .*continuous, intermittent, staged, program"),
    ("protocol.0.kind", "continous", r"protocol#1\.kind is 'continous'; wanted: one of continuous"),
    ("protocol.0.kind", ["continuous"], r"protocol#1\.kind is \['continuous'\]"),
    ("protocol.0.name", "staged", r"protocol#3\.name is 'staged'; .*not used before"),
    ("protocol.0.name", "Staged", r"protocol#3\.name is 'staged'; .*not used before"),
    ("protocol.0.name", "x" * 51, r"protocol#1\.name is 'xxx.*; wanted: up to 50 letters"),
    ("protocol.0.name", "..", r"protocol#1\.name is '\.\.'"),
    ("protocol.0.name", "", r"protocol#1\.name is ''"),
    ("protocol.0.name", "../x", r"protocol#1\.name is '\.\./x'"),
    ("protocol.0.hold_s", 3.0, r"#1\.hold_s is 3\.0; wanted: this key left out: kind 'continuous' has kind, name"),
    ("protocol.1.rest_s", DELETED, r"#2\.rest_s is missing; wanted: a value: .* has kind, name, hold_s, rest_s"),
    ("protocol.1.hold_s", 900.0, r"#2\.hold_s is 900\.0; wanted: holds of which one, not the first.*; such as 395$"),
    ("protocol.1", {"kind": "intermittent", "hold_s": 440, "rest_s": 14}, r"#2\.rest_s is 14\.0; wanted: more than 14, "),
    ("protocol.1.hold_s", 1e-9, r"protocol#2\.hold_s is 1e-09"),
    ("protocol.1", {"kind": "intermittent", "hold_s": 1e-9, "rest_s": 1e-9}, r"protocol#2\.hold_s"),
    ("protocol.2.stages", 1, r"protocol#3\.stages is 1; wanted: a whole number from 2"),
    ("protocol.2.rest_s", 1e-300, r"protocol#3\.rest_s is 1e-300; wanted: at least 0\.009, retraction\.elapsed_s / 100000"),
    ("protocol.2.rest_s", 300.0, r"protocol#3\.rest_s is 300\.0; .*stages = 5 .*retraction\.elapsed_s = 900"),
    ("steps.contact_s", 0, r"steps\.contact_s is 0"),
    ("steps.contact_s", 1e-3, r"steps\.contact_s is 0\.001; wanted: at least 0\.009, retraction\.elapsed_s / 100000"),
    ("steps.longest_s", 1e-300, r"steps\.longest_s is 1e-300; wanted: at least 0\.009"),
    ("steps.contact_s", datetime.date(2024, 1, 1), r"steps\.contact_s is "),
    ("steps.tolerance", 0.0, r"steps\.tolerance is 0\.0; wanted: a number greater than 0"),
    ("steps.tolerance", 0.5, r"steps\.tolerance is 0\.5; wanted: a relative error of 1e-6 to 0\.1"),
    ("patient", {"map_mmHg": -1.0}, r"patient\.map_mmHg is -1\.0; wanted: a pressure in mmHg greater than 0"),
    ("patient", {"map_mmHg": 0.1}, r"patient\.map_mmHg is 0\.1; wanted: a pressure of 20 to 300 mmHg"),
    ("patient", {"map_mmHg": 80.0, "icp_mmHg": -1.0}, r"patient\.icp_mmHg is -1\.0; wanted: .*mmHg of at least 0"),
    ("patient", {"map_mmHg": 80.0, "icp_mmHg": 90.0}, r"patient\.icp_mmHg is 90\.0; wanted: less than .*map_mmHg, 80"),
    ("patient", {"icp_mmHg": 10.0}, r"patient\.icp_mmHg is 10\.0; wanted: a value only with patient\.map_mmHg"),
    ("patient", {"map_mmhg": 80.0}, r"patient\.map_mmhg is not a known key; .*'map_mmHg'"),
    ("title", "two\nlines", r"title is 'two\\nlines'; wanted: one line of text"),
]  # fmt: skip


@pytest.mark.parametrize(("path", "value", "line"), BAD, ids=[path for path, _, _ in BAD])
def test_bad_input_is_one_line_that_says_where_what_and_what_is_wanted(demo, path, value, line):
    error = refusal(put(demo, path, value), "case.toml")
    assert str(error).startswith("case.toml: ") and error.file == "case.toml"
    assert re.search(line, str(error)), str(error)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"t_s": [0, 1]}, r"t_s is \[0\.0, 1\.0\]; .*retraction\.elapsed_s = 900"),
        ({"t_s": [1, 900]}, r"t_s is .*start at 0"),
        ({"t_s": [0, 5, 5, 900]}, r"t_s is .*increase"),
        ({"t_s": 900}, r"t_s is \[900\.0\]"),
        ({"opening_mm": [0, 5]}, r"opening_mm is \[0\.0, 5\.0\]; wanted: 3 values"),
        ({"opening_mm": [1, 5, 5]}, r"opening_mm is .*the first 0"),
        ({"opening_mm": [0, 0, -1]}, r"opening_mm is .*some greater"),
        ({"t_s": [0, 1e-30, 900]}, r"t_s is .*increase by 0\.009 or more"),
        ({"opening_mm": [0, 5e6, 5]}, r"opening_mm is .*none beyond 29\.95, the height of the wall"),
        ({"opening_mm": [-1e290, 5, 5]}, r"opening_mm is .*none beyond"),
        ({"stages": 3}, r"stages is 3; .*left out"),
    ],
)
def test_a_program_that_is_none(demo, change, line):
    program = {"kind": "program", "t_s": [0, 10, 900], "opening_mm": [0, 5, 5]}
    Scene.from_dict(put(demo, "protocol.0", program))
    assert re.search(r"^protocol#1\." + line, str(refusal(put(demo, "protocol.0", program | change))))


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"force_gf": [0, 30]}, r"force_gf is \[0\.0, 30\.0\]; wanted: 3 values, as many as t_s"),
        ({"force_gf": [5, 30, 30]}, r"force_gf is .*the first 0"),
        ({"force_gf": [0, -30, 30]}, r"force_gf is .*wanted: a force in gf of at least 0"),
        ({"force_gf": [0, 0, 0]}, r"force_gf is .*some greater"),
        ({"t_s": [0, 10, 800]}, r"t_s is .*retraction\.elapsed_s = 900"),
        ({"t_s": None}, r"force_gf is .*one force above 0, or t_s too"),
        ({"force_gf": None}, r"force_gf is missing; .*kind 'force' has kind, name, t_s, force_gf"),
        ({"opening_mm": 5}, r"opening_mm is \[5\.0\]; .*left out"),
        ({"force_mN": 5}, r"force_mN is not a known key; .*'force_gf'"),
    ],
)
def test_a_force_that_is_none(demo, change, line):
    force = {"kind": "force", "t_s": [0, 10, 900], "force_gf": [0, 30, 30]}
    Scene.from_dict(put(demo, "protocol.0", force))
    changed = {key: value for key, value in (force | change).items() if value is not None}
    assert re.search(r"^protocol#1\." + line, str(refusal(put(demo, "protocol.0", changed))))


def test_a_tube_has_no_force_along_one_way(demo):
    data = put(put(demo, "protocol.0", {"kind": "force", "force_gf": 30}), "blade.kind", "tube")
    assert re.search(r"^protocol#1\.kind is 'force'; .*blade\.kind = 'tube'", str(refusal(data)))


@pytest.mark.parametrize("data", [None, 3, [], "text"])
def test_a_scene_that_is_no_table(data):
    assert str(refusal(data)).endswith("wanted: a table of keys and values")


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"[blade\nwidth_mm = 3", r"file is unreadable \(.*line 1.*\); wanted: a scene in TOML"),
        (b"title = 'x'\ntitle = 'y'", r"file is unreadable"),
        (b"\x89PNG\r\n\x1a\n\x00\xff", r"file is not UTF-8 in line 1"),
        (b"a = " + b"[" * 20000, r"file is unreadable"),
        (b"order = " + b"9" * 5000, r"file is unreadable"),
        (b"#" * 1_000_001, r"file is a file of 1,000,001 bytes; wanted: at most 1,000,000 bytes"),
        (b"", r"tissue is missing"),
        (text_of("idealised").partition("5.9,")[0].encode(), r"file is unreadable \(.*end of document"),
        (None, r"file is missing"),
    ],
)
def test_files_that_cannot_be_read(tmp_path, content, line):
    path = tmp_path / "case.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        Scene.from_toml(path)
    assert str(caught.value).startswith(f"{path}: ") and re.search(line, str(caught.value))
    assert len(str(caught.value).splitlines()) == 1


def test_a_folder_is_no_scene_and_a_byte_order_mark_does_no_harm(tmp_path):
    with pytest.raises(InputError, match="unreadable"):
        Scene.from_toml(tmp_path)
    (tmp_path / "case.toml").write_bytes(b"\xef\xbb\xbf" + text_of("idealised").replace("\n", "\r\n").encode())
    assert Scene.from_toml(str(tmp_path / "case.toml")) == Scene.shipped("idealised")


@pytest.mark.parametrize(
    ("one", "other"),
    [("Slow", "slow"), ("straße", "STRASSE"), ("\N{ANGSTROM SIGN}", "å"), ("x", "\N{FULLWIDTH LATIN SMALL LETTER X}")],
)
def test_names_that_some_file_systems_take_for_one_are_refused(demo, one, other):
    data = put(put(demo, "protocol.0.name", one), "protocol.1.name", other)
    assert str(refusal(data)) == f"protocol#2.name is {other!r}; wanted: one that is not used before"


def test_too_many_stages_for_the_time(demo):
    data = put(put(demo, "retraction.ramp_s", 1.0), "protocol.2", {"kind": "staged", "stages": 200, "rest_s": 1.0})
    assert str(refusal(put(data, "protocol.1", {"kind": "continuous", "name": "x"}))).startswith(
        "protocol#3.stages is 200; wanted: at most 111, for retraction.ramp_s = 1 and retraction.elapsed_s = 900"
    )


def test_a_wall_that_would_begin_outside_the_brain(demo):
    demo["cleft"] |= {"target_mm": [0, 0, 58], "approach": [1, 0, 0], "across": [0, 0, 1]}
    assert re.match(r"cleft\.opening_mm is 4\.0; wanted: so small that the walls begin in tissue", str(refusal(demo)))


def test_the_narrowest_blade_has_a_face_off_its_edges():
    assert room.NARROWEST / 2 > observe.PATCH_MARGIN


@pytest.mark.parametrize(
    ("name", "hint"),
    [("demofast", "'demo_fast'"), ("__init__", "demo, demo_fast, idealised, idealised_fast"), (3, "demo")],
)
def test_an_unknown_shipped_scene_names_the_nearest(name, hint):
    with pytest.raises(InputError, match=f"^scene is {name!r}; wanted: .*{hint}"):
        Scene.shipped(name)


def test_intermittent_is_taken_if_and_only_if_the_end_falls_in_a_hold_that_is_not_the_first(demo):
    """Against a walk through the cycles, for ends a step apart and exactly on the changes; what is advised is taken."""
    ramp, hold, rest = 10.0, 25.0, 40.0
    for end in [10.5 + k for k in range(230)] + [35.0, 110.0, 185.0, 75.0, 85.0, 160.0]:
        fine = any(c + ramp < end <= c + ramp + hold for c in (75.0 * k for k in range(1, 5)))
        data = put(demo, "retraction", {"ramp_s": ramp, "elapsed_s": end})
        data["protocol"] = [{"kind": "intermittent", "hold_s": hold, "rest_s": rest}]
        if fine:
            Scene.from_dict(data)
        else:
            line = str(refusal(data))
            advice = re.search(r"such as (\S+)$", line)
            assert line.startswith("protocol#1.hold_s is 25.0") and (advice or end <= 2 * (ramp + 1) + rest), line
            if advice:
                Scene.from_dict(put(data, "protocol.0.hold_s", float(advice[1])))


def test_more_holds_than_anyone_could_compute_are_refused(demo):
    demo["retraction"]["ramp_s"] = 0.1
    line = str(refusal(put(demo, "protocol.1", {"kind": "intermittent", "hold_s": 0.1, "rest_s": 0.1})))
    assert re.search(r"^protocol#2\.hold_s is 0\.1; wanted: .* at most 1000, .*elapsed_s = 900$", line), line


# Whatever comes: a scene, or one line that names the field.

VALUES = [
    True, False, 0, -1, 1, 2, 3, 5, 0.5, -0.0, 1e-320, 1e300, 1.7e308, math.nan, math.inf, -math.inf, 10**400,
    "", " ", "x", "(", "[[", "a\nb", "\u2028", "\ud800", "ä" * 500, [], [[]], [1.0], [1.0, 2.0, 3.0], [0, 0, 0], ["a"],
    [math.nan] * 3, {}, {"a": 1}, [{}], None, b"bytes", 3j, datetime.date(2024, 1, 1), {1: 2}, np.zeros((2, 2)),
    object(),
]  # fmt: skip


def paths(data, way=()):
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in items:
        yield (*way, key)
        if isinstance(value, (dict, list)):
            yield from paths(value, (*way, key))


def mutated(data, random):
    """One entry changed, gone, misspelt or new; with the name that a refusal has to mention."""
    path = random.choice(list(paths(data)))
    name = next(step for step in reversed(path) if isinstance(step, str))
    kind = random.randrange(5)
    if kind == 0:
        return put(data, path, DELETED), name
    if kind == 1 and isinstance(path[-1], str):
        typo = path[-1][:-1] + random.choice("xyz_")
        return put(put(data, path, DELETED), (*path[:-1], typo), 1.0), typo
    if kind == 2 and isinstance(path[-1], str):
        return put(data, (*path[:-1], "surprise_mm"), random.choice(VALUES)), "surprise_mm"
    value = data
    for step in path:
        value = value[step]
    if kind == 3 and isinstance(value, float):
        return put(data, path, value * random.choice([-1, 1e-3, 0.1, 0.9, 1.1, 10, 1e3])), name
    return put(data, path, random.choice(VALUES)), name


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("name", NAMES)
def test_fuzzed_scenes_parse_or_are_refused_by_name(name, seed):
    random_, data = random.Random(seed), tomllib.loads(text_of(name))
    outcomes = {"taken": 0, "refused": 0}
    for _ in range(100):
        changed, field = mutated(data, random_)
        try:
            scene = Scene.from_dict(changed, "case.toml")
        except InputError as error:
            line = str(error)
            assert len(line.splitlines()) == 1 and line.startswith("case.toml: ") and len(line) < 400, line
            assert field in line, (field, line)
            outcomes["refused"] += 1
        else:
            assert Scene.from_dict(tomllib.loads(scene.to_toml())) == scene
            outcomes["taken"] += 1
    assert min(outcomes.values()) >= 5


def test_fuzzed_files_parse_or_are_refused_in_one_line(tmp_path):
    random_, text, path = random.Random(1), text_of("idealised").encode(), tmp_path / "case.toml"
    refused = 0
    for _ in range(300):
        broken = bytearray(text)
        for _ in range(random_.randrange(1, 4)):
            at = random_.randrange(len(broken))
            broken[at : at + random_.randrange(3)] = random_.choice(
                [b"", b"\x00", b"\xff", b"]", b'"', b"\n", b"e", b"-", b"9"]
            )
        path.write_bytes(broken)
        try:
            Scene.from_toml(path)
        except InputError as error:
            assert len(str(error).splitlines()) == 1 and str(error).startswith(f"{path}: ")
            refused += 1
    assert 50 < refused < 300


def test_every_field_of_every_part_says_how_it_stands_in_toml():
    parts = [value for value in vars(room).values() if isinstance(value, type) and issubclass(value, room.Section)]
    entries = [
        f.metadata["entry"] for part in parts if dataclasses.is_dataclass(part) for f in dataclasses.fields(part)
    ]
    assert len(entries) > 40 and all(entry.wanted and entry.key for entry in entries)
    for entry, (unit, (per_si, _)) in itertools.product(entries, fields.UNITS.items()):
        if entry.key.endswith(f"_{unit}") and not (unit == "s" and entry.key.endswith("_Pa_s")):
            assert entry.per_si == per_si


def test_protocol_name_defaults_to_its_kind():
    assert Protocol(kind="staged", stages=3, rest=1.0).name == "staged"
    assert Protocol(kind="staged", name="gentle 2", stages=3, rest=1.0).name == "gentle 2"


def test_the_template_explains_every_key_and_what_it_comments_out_is_a_scene():
    text = Scene.template()
    parts = [room.Body, Tissue, room.Support, Cleft, Blade, room.Retraction, Protocol, room.Steps, room.Patient, Ask]
    keys = {entry.key for part in parts for entry in fields.entries(part).values()}
    assert {key for key in keys if not re.search(rf"\b{key}\b", text)} == set()
    head, program = text.split('# [[protocol]]\n# kind = "program"')
    scene = Scene.from_dict(tomllib.loads(head + '[[protocol]]\nkind = "program"' + program.replace("\n# ", "\n", 3)))
    assert scene.protocols[-1].kind == "program" and scene.protocols[:3] == Scene.shipped("demo").protocols
    head, force = text.split('# [[protocol]]\n# kind = "force"')
    scene = Scene.from_dict(tomllib.loads(head + '[[protocol]]\nkind = "force"' + force.replace("\n# ", "\n", 3)))
    assert scene.protocols[-1].kind == "force" and max(scene.protocols[-1].force_gf) == 50
    head, patient = text.split("# [patient]")
    scene = Scene.from_dict(tomllib.loads(head + "[patient]" + patient.replace("\n# ", "\n")))
    assert scene.patient == room.Patient(map_mmHg=85.0, icp_mmHg=10.0)
    head, ask = text.split("# [[ask]]")
    scene = Scene.from_dict(tomllib.loads(head + "[[ask]]" + ask.replace("\n# ", "\n", 3)))
    assert scene.ask == (Ask(protocol="continuous"),) and Scene.shipped("demo").ask is None
    with_ways = re.sub(r"(?m)^# (approach|across) = ", r"\1 = ", text)
    assert with_ways.count("\napproach") == with_ways.count("\nacross") == 1
    assert Scene.from_dict(tomllib.loads(with_ways)).cleft.across == (0.0, 1.0, 0.0)


def test_a_tube_has_to_fit_between_the_ends_of_the_cleft(demo):
    demo["blade"]["kind"] = "tube"
    assert Scene.from_dict(demo).blade.kind == "tube"
    demo["retraction"]["opening_mm"] = 9.0
    with pytest.raises(
        InputError, match=r"blade\.kind is 'tube'; wanted: a spatula: a tube of 13 mm, .*width_mm = 12$"
    ):
        Scene.from_dict(demo)


def test_a_blade_of_given_force_may_rub():
    scene = Scene.shipped("idealised_fast")
    blade, force = dataclasses.replace(scene.blade, friction=0.1), Protocol(kind="force", force_gf=30.0)
    made = dataclasses.replace(scene, blade=blade, protocols=(force,))
    assert Scene.from_dict(made.to_dict()) == made and made.blade.friction == 0.1
