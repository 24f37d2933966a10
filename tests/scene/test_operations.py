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

from ngbrain.errors import InputError
from ngbrain.materials import NeoHooke, Viscous, constants
from ngbrain.scene import (
    CleftSpec,
    DisplacementBC,
    Fluid,
    Geometry,
    Gravity,
    MeshSize,
    Patient,
    Protocol,
    Quantity,
    Scene,
    Time,
    Tissue,
    Tool,
    Traction,
    operation,
)
from ngbrain.schema import document
from ngbrain.surgery.measures import observer
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.protocols import ForceProtocol

NAMES = ["demo", "demo_fast", "idealised", "idealised_fast"]
SMALLEST = {
    "geometry": {"kind": "idealised"},
    "tissue": [{"region": ".*", "mu_Pa": 500}],
    "cleft": {"target_mm": [17, 5.9, 26.2]},
}
DELETED = object()
MEAN, INTRA = "mean_arterial_pressure_mmHg", "intracranial_pressure_mmHg"
PARTS = [
    Geometry, MeshSize, Tissue, DisplacementBC, Traction, Gravity, Fluid, CleftSpec, Time, Tool, Protocol, Quantity, Patient,
]  # fmt: skip


def text_of(name):
    return (resources.files("ngbrain.scenes") / f"{name}.toml").read_text("utf-8")


@pytest.fixture
def demo():
    """The demo with the numbers that the tests below count on, whatever the shipped one is tuned to."""
    data = tomllib.loads(text_of("idealised"))
    data["geometry"] = {"kind": "idealised"}
    data["mesh"] = {"wall_size_mm": 2.0, "craniotomy_size_mm": 6.0, "max_size_mm": 20.0, "order": 2}
    data["cleft"] |= {"width_mm": 12.0, "gap_mm": 4.0, "craniotomy_diameter_mm": 40.0}
    data["tool"] = {
        "travel_mm": 5.0,
        "width_mm": 10.0,
        "edge_radius_mm": 1.0,
        "tip_clearance_mm": 4.0,
        "thickness_mm": 2.0,
    }
    data["time"] = {"ramp_s": 10.0, "end_s": 900.0}
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
    demo["tool"] = {"width_mm": 10, "edge_radius_mm": 1.5, "tip_clearance_mm": 4.0, "thickness_mm": 2.0}
    scene = Scene.from_dict(demo)
    assert scene.tool == Tool(width=0.010, edge_radius=0.0015, tip_clearance=0.004, thickness=0.002)
    assert scene.cleft.target == pytest.approx(np.array(demo["cleft"]["target_mm"]) / 1000, rel=1e-12)
    assert (scene.cleft.trajectory, scene.cleft.wall_normal) == (None, None)
    assert (scene.tool.travel, scene.time.ramp, scene.time.end) == (0.005, 10.0, 900.0)
    assert [tissue.region for tissue in scene.tissues] == ["cortex", "white", "ventricle.*"]
    assert (scene.tissues[1].material, scene.tissues[2].mu) == ("griffiths2024:white_matter", (50.0,))
    assert (scene.protocols[1].hold, scene.protocols[1].rest, scene.protocols[2].stages) == (230.0, 90.0, 5)
    assert scene.displacement_bcs == (DisplacementBC(boundary="skull"),) and scene.time.max_step_hold == 60.0


@pytest.mark.parametrize("name", NAMES)
def test_shipped_scenes_compare_three_protocols(name):
    scene = Scene.shipped(name)
    kinds = ["continuous", "intermittent", "staged"]
    assert [p.kind for p in scene.protocols] == [p.name for p in scene.protocols] == kinds


@pytest.mark.parametrize("name", NAMES)
def test_shipped_intermittent_ends_exactly_with_a_hold(name):
    scene = Scene.shipped(name)
    hold, rest = next((p.hold, p.rest) for p in scene.protocols if p.kind == "intermittent")
    holds = (scene.time.end + rest) / (scene.time.ramp + hold + rest)
    assert holds == int(holds) >= 2


@pytest.mark.parametrize("name", NAMES)
def test_shipped_scenes_spell_out_what_decides_their_numbers(name):
    written, full = tomllib.loads(text_of(name)), Scene.shipped(name).to_dict()
    for section in ("geometry", "mesh", "cleft", "tool", "time"):
        assert written[section] == full[section]


def test_the_smallest_scene_falls_back_on_the_defaults():
    scene = Scene.from_dict(SMALLEST)
    assert scene.tool == Tool(width=0.010, edge_radius=0.002, tip_clearance=0.004, thickness=0.004)
    assert scene.tool.travel == 0.005 and scene.time == Time(ramp=10.0, end=900.0)
    assert scene.protocols == (Protocol(kind="continuous"),)
    assert (
        scene.tissues[0].bulk_to_shear_ratio is None
        and scene.tissues[0].bulk == 1000.0 * 500
        and scene.displacement_bcs == (DisplacementBC(boundary="skull"),)
        and scene.mesh.order == 2
    )
    demo = Scene.shipped("idealised")
    assert (scene.mesh, scene.tool, scene.cleft) == (demo.mesh, demo.tool, demo.cleft)
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
    demo["protocol"].append({"kind": "program", "name": "mine", "times_s": [0, 1, 900], "travel_mm": [-1, 3.3, 3.3]})
    demo["tissue"].append({"region": "x", "mu_Pa": [1.1, 2.2], "alpha": [-4.7, 3.0], "eta_Pa_s": [7.7]})
    demo["cleft"] |= {"trajectory": [0, 0, 1], "wall_normal": [1, 0.5, 0]}
    demo["patient"] = {"mean_arterial_pressure_mmHg": 85.3, "intracranial_pressure_mmHg": 0.0}
    scene = Scene.from_dict(demo)
    assert scene.to_dict()["patient"] == demo["patient"]
    assert Scene.from_dict(tomllib.loads(scene.to_toml())) == scene
    assert scene.protocols[3].travel == (-0.001, 0.0033, 0.0033) and scene.protocols[3].times == (0, 1, 900)
    assert scene.cleft.wall_normal == (1.0, 0.5, 0.0)


def test_a_given_force_alone_or_over_time(demo):
    demo["protocol"] = [
        {"kind": "force", "force_gf": 30},
        {"kind": "force", "name": "let go", "times_s": [0, 10, 20, 30, 900], "force_gf": [0, 30, 30, 0, 0]},
    ]
    scene = Scene.from_dict(demo)
    assert Scene.from_dict(tomllib.loads(scene.to_toml())) == scene
    held, let_go = (RetractionModel.program(scene, asked) for asked in scene.protocols)
    assert held == ForceProtocol("force", (0.0, 10.0, 900.0), (0.0, 0.2941995, 0.2941995)) and held.working_s == 890
    assert (
        let_go.times == (0, 10, 20, 30, 900)
        and [let_go.value(15), 2 * held.value(5)] == pytest.approx([held.value(10)] * 2)
        and let_go.value(800) == 0
    )


def test_any_length_survives_the_way_to_millimetres_and_back(rng):
    for width in [*rng.uniform(1e-3, 1e-1, 2000), *(k * 1e-4 for k in range(20, 500)), math.pi * 1e-2]:
        blade = Tool(width=float(width), edge_radius=1e-3)
        assert blade.width == pytest.approx(width, rel=1e-15, abs=0)
        assert Tool(width=blade.toml_value("width") / 1000).width == blade.width


def test_what_is_written_is_what_was_read():
    for k in range(0, 30000, 7):
        target = [k / 10, -k / 100, k / 8]
        assert CleftSpec(target=[c / 1000 for c in target]).to_dict()["target_mm"] == target
    for target in ([5.9, -26.2, 0.1 + 0.2], [1 / 3, 2 / 3, 1e-7]):
        assert (
            Scene.from_dict(put(SMALLEST, "cleft.target_mm", target)).to_dict()["cleft"]["target_mm"][:2] == target[:2]
        )


def test_integers_numpy_numbers_arrays_and_lists_do_in_python():
    cleft = CleftSpec(target=np.array([0.017, 0, 0.026]), width=np.float32(0.0125), wall_normal=[1, 0, 0])
    assert cleft == CleftSpec(target=(0.017, 0.0, 0.026), width=float(np.float32(0.0125)), wall_normal=(1.0, 0.0, 0.0))
    assert Tissue(region="x", mu=500).mu == (500.0,) and hash(cleft)


def test_replace_gives_a_checked_scene():
    demo = Scene.shipped("idealised")
    wide = dataclasses.replace(demo, cleft=dataclasses.replace(demo.cleft, width=0.02, craniotomy_diameter=0.05))
    assert wide.cleft.width == 0.02 and wide.tool == demo.tool
    with pytest.raises(InputError, match=r"^tool#1\.width_mm is 14\.0; .*12, cleft\.width_mm"):
        dataclasses.replace(demo, tools=(Tool(width=0.014),))
    with pytest.raises(InputError, match=r"^tool\.width_mm is -14\.0"):
        Tool(width=-0.014)
    with pytest.raises(InputError, match=r"^tool#1 is 3; wanted: a table"):
        dataclasses.replace(demo, tools=3)
    with pytest.raises(dataclasses.FrozenInstanceError):
        demo.tool.width = 1.0


# Tissue.


@pytest.mark.parametrize("name", ["cortex", "white_matter"])
def test_tissue_from_the_catalogue(name):
    tissue, published = Tissue(region="x", material=f"griffiths2024:{name}"), constants(f"griffiths2024:{name}")
    assert tissue.law() == published.law() and isinstance(tissue.law(), Viscous)
    ratio = 2 * 1.49 / (3 * 0.02)  # the source's Poisson's ratio
    assert tissue.initial_modulus == published.initial_modulus
    assert tissue.bulk == pytest.approx(ratio * published.initial_modulus)
    assert tissue.published is published


def test_tissue_by_lists_is_the_tissue_by_name():
    lists = {"mu": (420.0, 1400.0, 560.0), "alpha": (-21.27, -14.66, -23.76), "eta": (3050.0, 289370.0)}
    tissue = Tissue(region="x", **lists, bulk_to_shear_ratio=50.0)
    assert tissue.law() == constants("griffiths2024:cortex").law() and tissue.bulk == 50 * 2380
    assert tissue.published is None


def test_a_single_modulus_is_neo_hooke_and_has_no_exponent_to_replace():
    tissue = Tissue(region="ventricle.*", mu=50.0, bulk_to_shear_ratio=10.0)
    assert tissue.law() == Viscous(NeoHooke(50.0)) and tissue.bulk == 500.0
    assert tissue.with_alpha(-4.7) == tissue


def test_with_alpha_keeps_moduli_and_times():
    tissue = Tissue(region="x", material="griffiths2024:cortex")
    other = tissue.with_alpha(-4.7)
    assert other.alpha == (-4.7,) * 3 and other.law().equilibrium.alpha == -4.7
    assert other.initial_modulus == tissue.initial_modulus and other.bulk == tissue.bulk
    assert [b.tau for b in other.law().branches] == pytest.approx([b.tau for b in tissue.law().branches], rel=1e-8)
    assert [b.law.mu for b in other.law().branches] == [b.law.mu for b in tissue.law().branches]
    assert other.published is None and other.region == "x"


@pytest.mark.parametrize("given", [{"material": "griffiths2024:cortex"}, {"mu": 50.0}, {"mu": 50.0, "alpha": -4.0}])
def test_scaled_doubles_moduli_and_keeps_times(given):
    tissue = Tissue(region="x", **given)
    double = tissue.with_scale(2.0)
    assert double.initial_modulus == 2 * tissue.initial_modulus and double.bulk == 2 * tissue.bulk
    law, twice = tissue.law(), double.law()
    assert [b.tau for b in twice.branches] == pytest.approx([b.tau for b in law.branches], rel=1e-8)
    assert twice.equilibrium == dataclasses.replace(law.equilibrium, mu=2 * law.equilibrium.mu)
    assert double.published is tissue.published and tissue.with_scale(2.0).with_scale(3.0).scale == 6.0
    with pytest.raises(InputError, match="scale"):
        tissue.with_scale(-1.0)


# What is refused: where, what to put there, and what the line must say.

BAD = [
    ("tool.widht_mm", 10.0, r"^case.toml: tool#1\.widht_mm is not a known key; wanted: did you mean 'width_mm'\?$"),
    ("tool.width_cm", 1.0, r"tool#1\.width_cm is not a known key; .*'width_mm'"),
    ("tolo", {}, r"^case.toml: tolo is not a known key; wanted: did you mean 'tool'\?$"),
    ("tissue.1.mu_kPa", 1.0, r"tissue#2\.mu_kPa is not a known key; .*'mu_Pa'"),
    ("protocol.1.hold", 1.0, r"protocol#2\.hold is not a known key; .*'hold_s'"),
    ("geometry.two\nlines", 1, r"geometry\.'two\\nlines' is not a known key"),
    ("geometry.kind", "real", r"geometry\.kind is 'real'; wanted: one of block, idealised, mni152, scan, mesh"),
    ("geometry.stiffness_map", "a.nii", r"geometry\.stiffness_map is 'a\.nii'; wanted: .*the head of a person"),
    ("geometry.stiffness_map_space", "head", r"geometry\.stiffness_map_space is 'head'; wanted: this key only with a map"),
    (
        "geometry",
        {"kind": "scan", "image": "t1.nii", "stiffness_map": "a.nii"},
        r"geometry\.stiffness_map_space is missing; wanted: head or mni152",
    ),
    ("mesh.order", 5, r"mesh\.order is 5; wanted: a whole number from 2 to 4"),
    ("mesh.order", 2.0, r"mesh\.order is 2\.0; wanted: a whole number"),
    ("mesh.order", True, r"mesh\.order is True"),
    ("mesh.wall_size_mm", 12.0, r"mesh\.craniotomy_size_mm is .*; wanted: at least 12, mesh\.wall_size_mm"),
    ("mesh.wall_size_mm", 0.003, r"mesh\.wall_size_mm is 0\.003; wanted: a length in mm of at least 0\.2"),
    ("mesh.max_size_mm", 0.1, r"mesh\.max_size_mm is 0\.1; wanted: .*at least 0\.5"),
    ("mesh.craniotomy_size_mm", 30.0, r"mesh\.max_size_mm is .*; wanted: at least 30, mesh\.craniotomy_size_mm"),
    ("tissue", [], r"tissue is \[\]; wanted: one or more tables \[\[tissue\]\]"),
    ("tissue", 3, r"tissue#1 is 3; wanted: a table"),
    ("tissue", DELETED, r"tissue is missing; .*\[\[tissue\]\]"),
    ("tissue.0.region", "(", r"tissue#1\.region is '\('; wanted: a name or a regular expression"),
    ("tissue.0.region", "(?i)cortex", r"tissue#1\.region is '\(\?i\)cortex'; wanted: .*ECMAScript"),
    ("tissue.0.region", "c{,9}ortex", r"tissue#1\.region is 'c\{,9\}ortex'; wanted: .*ECMAScript"),
    ("tissue.0.region", "cortex" + "|a" * 100, r"tissue#1\.region is 'cortex.*; wanted: .*up to 200 characters"),
    ("tissue.0.region", " ", r"tissue#1\.region is ' '"),
    ("tissue.1.region", "cortex", r"tissue#2\.region is 'cortex'; .*not used before"),
    ("tissue.0.material", "griffiths2024:cortx", r"tissue#1\.material is .*; wanted: .*griffiths2024:cortex"),
    ("tissue.0.material", DELETED, r"tissue#1\.material is missing; wanted: .*mu_Pa"),
    ("tissue.0.mu_Pa", 1.0, r"tissue#1\.mu_Pa is \[1\.0\]; .*not both"),
    ("tissue.2.mu_Pa", -50.0, r"tissue#3\.mu_Pa is -50\.0; wanted: a modulus in Pa greater than 0"),
    ("tissue.2.mu_Pa", [1.0, 2.0], r"tissue#3\.eta_Pa_s is missing; .*one value fewer than mu_Pa: 1"),
    ("tissue.2.mu_Pa", [], r"tissue#3\.mu_Pa is \[\]"),
    ("tissue.2", {"region": "v", "alpha": [1.0]}, r"tissue#3\.mu_Pa is missing"),
    ("tissue.2", {"region": "v", "mu_Pa": 1.0, "alpha": 0.0}, r"tissue#3\.alpha is \[0\.0\]; .*none of them 0"),
    ("tissue.2", {"region": "v", "mu_Pa": 1.0, "alpha": 1e300}, r"#3\.alpha is \[1e\+300\]; wanted: .* 0\.001 to 1000"),
    ("tissue.2", {"region": "v", "mu_Pa": 1.0, "alpha": 1e-9}, r"#3\.alpha is \[1e-09\]; wanted: .* 0\.001 to 1000"),
    ("tissue.2", {"region": "v", "mu_Pa": [1.0, 1.0], "alpha": [1.0]}, r"tissue#3\.alpha is \[1\.0\]; .*mu_Pa, 2"),
    ("tissue.2.poissons_ratio", 0.4, r"tissue#3\.poissons_ratio is 0\.4; wanted: this key or bulk_to_shear_ratio"),
    ("tissue.2", {"region": "v", "mu_Pa": 1.0, "eta_Pa_s": [1.0]}, r"tissue#3\.eta_Pa_s is \[1\.0\]; .*fewer"),
    ("tissue.2", {"region": "v", "mu_Pa": 1e300}, r"tissue#3\.mu_Pa is \[1e\+300\]; wanted: moduli of 0\.001 to 1e9 Pa"),
    ("tissue.2.bulk_to_shear_ratio", 1e300, r"tissue#3\.bulk_to_shear_ratio is 1e\+300; wanted: a ratio of 0\.001 to 1e9"),
    ("tissue.2.bulk_to_shear_ratio", 0, r"tissue#3\.bulk_to_shear_ratio is 0; wanted: a number greater than 0"),
    ("displacement_bc.0.boundary", 3, r"displacement_bc#1\.boundary is 3; wanted: a name"),
    ("displacement_bc.0.value_mm", [0, 0, 1.0], r"displacement_bc#1\.value_mm is .*; wanted: all 0"),
    ("displacement_bc.0.components", "z", r"displacement_bc#1\.components is 'z'; wanted: 'xyz'"),
    ("displacement_bc.0.contact", "frictionless", r"displacement_bc#1\.contact is .*; wanted: bonded or sliding"),
    ("traction", [{"boundary": "skull", "value_Pa": [0, 0, 1]}], r"traction is given; wanted: this table left out"),
    ("tool", [{}, {}], r"tool is given 2 times; wanted: one table \[\[tool\]\]"),
    ("geometry", {"kind": "block", "size_mm": [60, 60, 40]}, r"cleft is given; wanted: geometry\.kind a head"),
    ("quantity", [{"name": "force", "boundary": "skull"}], r"quantity#1\.name is 'force'; wanted: one of peak_pressure"),
    ("cleft", DELETED, r"tool is given; wanted: this table left out: without a \[cleft\] there is no operation"),
    ("cleft.target_mm", DELETED, r"cleft\.target_mm is missing; .*length in mm in each of 3 places"),
    ("cleft.target_mm", [1.0, 2.0], r"cleft\.target_mm is \[1\.0, 2\.0\]; .*3 places"),
    ("cleft.target_mm", [1.0, math.nan, 2.0], r"cleft\.target_mm is \[1\.0, nan, 2\.0\]"),
    ("cleft.target_mm", 3.0, r"cleft\.target_mm is 3\.0"),
    ("cleft.target_mm", [0, 0, 99], r"cleft\.target_mm is .*99.*; wanted: a point inside the brain"),
    ("cleft.target_mm", [0, 0, 1e290], r"cleft\.target_mm is .*; wanted: a point inside the brain"),
    ("cleft.target_mm", [14, 0, 6], r"cleft\.target_mm is .*; wanted: .*not in a ventricle"),
    ("cleft.target_mm", [0, 0, 0], r"cleft\.trajectory is missing; wanted: a direction: .*cleft\.target_mm = \[0, 0, 0\]"),
    ("cleft.target_mm", [60, 0, 0], r"tool#1\.tip_clearance_mm is 4\.0; wanted: 5 or more below 5\.98.*cleft\.target_mm"),
    ("cleft.gap_mm", 1e-9, r"cleft\.gap_mm is 1e-09; wanted: .*at least 0\.1"),
    ("cleft.craniotomy_diameter_mm", 13.0, r"cleft\.craniotomy_diameter_mm is 13\.0; wanted: at least 2 more than 12\.65"),
    ("cleft.craniotomy_diameter_mm", 81.0, r"cleft\.craniotomy_diameter_mm is 81\.0; wanted: at most 80"),
    ("cleft.trajectory", [1e200, 0, 0], r"cleft\.trajectory is \[1e\+200, 0\.0, 0\.0\]; wanted: a direction: .*beyond 1000"),
    ("cleft.wall_normal", [0, 1e-200, 0], r"cleft\.wall_normal is \[0\.0, 1e-200, 0\.0\]; wanted: a direction: not all 0"),
    ("cleft.craniotomy_diameter_mm", 12.0, r"cleft\.craniotomy_diameter_mm is 12\.0; .*12\.65.*cleft\.width_mm.*cleft\.gap_mm"),
    ("cleft.trajectory", [0, 0, 0], r"cleft\.trajectory is \[0\.0, 0\.0, 0\.0\]; wanted: a direction"),
    ("cleft.width_mm", -12.0, r"cleft\.width_mm is -12\.0; wanted: a length in mm greater than 0"),
    ("cleft.width_mm", "12 mm", r"cleft\.width_mm is '12 mm'"),
    ("cleft.width_mm", True, r"cleft\.width_mm is True"),
    ("cleft.width_mm", math.inf, r"cleft\.width_mm is inf"),
    ("cleft.width_mm", math.nan, r"cleft\.width_mm is nan"),
    ("cleft.width_mm", 10**400, r"cleft\.width_mm is 1000"),
    ("cleft.width_mm", 10**5000, r"cleft\.width_mm is a number of thousands of digits"),
    ("cleft.width_mm", [12.0], r"cleft\.width_mm is \[12\.0\]"),
    ("tool.kind", "spatual", r"tool#1\.kind is 'spatual'; wanted: one of spatula, two spatulas, plate, tube, ball, surface"),
    ("tool.tip_width_mm", 3.0, r"tool#1\.tip_width_mm is 3\.0; wanted: at least 4, and .*at most 10, tool\.width_mm"),
    ("tool.face_radius_mm", 9.0, r"tool#1\.face_radius_mm is 9\.0; wanted: at least .*, the height of the wall"),
    ("tool", {"kind": "tube", "face_radius_mm": 60.0}, r"tool#1\.face_radius_mm is 60\.0; wanted: this key left out"),
    ("tool", {"kind": "tube", "edge_radius_mm": 3.0}, r"tool#1\.edge_radius_mm is 3\.0; wanted: at most 2, half of cleft"),
    ("cleft.width_mm", 9.0, r"tool#1\.width_mm is 10\.0; wanted: at most 9, cleft\.width_mm: .*wider than the cleft"),
    ("tool", 3, r"tool#1 is 3; wanted: a table"),
    ("tool.width_mm", 1.5, r"tool#1\.width_mm is 1\.5; .*tool\.edge_radius_mm"),
    ("tool.width_mm", 3.0, r"tool#1\.width_mm is 3\.0; wanted: at least 4, and twice tool\.edge_radius_mm = 1"),
    ("tool.friction", 1.5, r"tool#1\.friction is 1\.5; wanted: at most 1"),
    ("tool.friction", -0.1, r"tool#1\.friction is -0\.1; wanted: .*at least 0"),
    ("tool.tip_clearance_mm", 25.1, r"tool#1\.tip_clearance_mm is 25\.1; wanted: 5 or more below 29\.95, the height of the wall"),
    ("tool.edge_radius_mm", 0.5, r"tool#1\.edge_radius_mm is 0\.5; wanted: .*at least 1"),
    ("tool.tip_clearance_mm", 0.0, r"tool#1\.tip_clearance_mm is 0\.0; wanted: .*greater than 0"),
    ("tool.thickness_mm", 5.0, r"tool#1\.thickness_mm is 5\.0; wanted: at most 4, cleft\.gap_mm"),
    ("time.ramp_s", -1.0, r"time\.ramp_s is -1\.0; wanted: a time in s greater than 0"),
    ("time.ramp_s", 900.0, r"time\.end_s is 900\.0; wanted: more than 900, time\.ramp_s"),
    ("time.end_s", 950.0, r"#2\.hold_s .*rest_s = 90, .*ramp_s = 10 .*end_s = 950; such as 246\.667"),
    ("tool.travel_mm", 500.0, r"tool#1\.travel_mm is 500\.0; wanted: at most 29\.95, the height of the wall"),
    ("tool.travel_mm", 1e-9, r"tool#1\.travel_mm is 1e-09; wanted: .*at least 0\.01"),
    ("time.ramp_s", 1e-3, r"time\.ramp_s is 0\.001; wanted: at least 0\.009, time\.end_s / 100000"),
    ("time.ramp_s", 80.0, r"protocol#2\.rest_s is 90\.0; wanted: more than 112, .*travel_mm = 5 .*ramp_s = 80"),
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
    ("protocol.1.hold_s", 900.0, r"#2\.hold_s is 900\.0; wanted: a duration with which the run ends during a hold.*; such as 395$"),
    ("protocol.1", {"kind": "intermittent", "hold_s": 440, "rest_s": 14}, r"#2\.rest_s is 14\.0; wanted: more than 14, "),
    ("protocol.1.hold_s", 1e-9, r"protocol#2\.hold_s is 1e-09"),
    ("protocol.1", {"kind": "intermittent", "hold_s": 1e-9, "rest_s": 1e-9}, r"protocol#2\.hold_s"),
    ("protocol.2.stages", 1, r"protocol#3\.stages is 1; wanted: a whole number from 2"),
    ("protocol.2.rest_s", 1e-300, r"protocol#3\.rest_s is 1e-300; wanted: at least 0\.009, time\.end_s / 100000"),
    ("protocol.2.rest_s", 300.0, r"protocol#3\.rest_s is 300\.0; .*stages = 5 .*time\.end_s = 900"),
    ("time.max_step_contact_s", 0, r"time\.max_step_contact_s is 0"),
    ("time.max_step_contact_s", 1e-3, r"time\.max_step_contact_s is 0\.001; wanted: at least 0\.009, time\.end_s / 100000"),
    ("time.max_step_hold_s", 1e-300, r"time\.max_step_hold_s is 1e-300; wanted: at least 0\.009"),
    ("time.max_step_contact_s", datetime.date(2024, 1, 1), r"time\.max_step_contact_s is "),
    ("time.step_tolerance", 0.0, r"time\.step_tolerance is 0\.0; wanted: a number greater than 0"),
    ("time.step_tolerance", 0.5, r"time\.step_tolerance is 0\.5; wanted: a relative error of 1e-6 to 0\.1"),
    ("patient", {MEAN: -1.0}, r"patient\.mean_.*_mmHg is -1\.0; wanted: a pressure in mmHg greater than 0"),
    ("patient", {MEAN: 0.1}, r"patient\.mean_.*_mmHg is 0\.1; wanted: a pressure of 20 to 300 mmHg"),
    ("patient", {MEAN: 80.0, INTRA: -1.0}, r"patient\.intra.*_mmHg is -1\.0; wanted: .*mmHg of at least 0"),
    ("patient", {MEAN: 80.0, INTRA: 90.0}, r"patient\.intra.*_mmHg is 90\.0; wanted: less than .*mmHg, 80"),
    ("patient", {INTRA: 10.0}, r"patient\.intra.*_mmHg is 10\.0; wanted: a value only with patient\.mean_.*_mmHg"),
    ("patient", {MEAN.lower(): 80.0}, r"patient\.mean_.*_mmhg is not a known key; .*'mean_arterial_pressure_mmHg'"),
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
        ({"times_s": [0, 1]}, r"times_s is \[0\.0, 1\.0\]; .*time\.end_s = 900"),
        ({"times_s": [1, 900]}, r"times_s is .*start at 0"),
        ({"times_s": [0, 5, 5, 900]}, r"times_s is .*increase"),
        ({"times_s": 900}, r"times_s is \[900\.0\]"),
        ({"travel_mm": [0, 5]}, r"travel_mm is \[0\.0, 5\.0\]; wanted: 3 values"),
        ({"travel_mm": [1, 5, 5]}, r"travel_mm is .*the first 0"),
        ({"travel_mm": [0, 0, -1]}, r"travel_mm is .*some greater"),
        ({"times_s": [0, 1e-30, 900]}, r"times_s is .*increase by 0\.009 or more"),
        ({"travel_mm": [0, 5e6, 5]}, r"travel_mm is .*none beyond 29\.95, the height of the wall"),
        ({"travel_mm": [-1e290, 5, 5]}, r"travel_mm is .*none beyond"),
        ({"stages": 3}, r"stages is 3; .*left out"),
    ],
)
def test_a_program_that_is_none(demo, change, line):
    program = {"kind": "program", "times_s": [0, 10, 900], "travel_mm": [0, 5, 5]}
    Scene.from_dict(put(demo, "protocol.0", program))
    assert re.search(r"^protocol#1\." + line, str(refusal(put(demo, "protocol.0", program | change))))


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"force_gf": [0, 30]}, r"force_gf is \[0\.0, 30\.0\]; wanted: 3 values, as many as times_s"),
        ({"force_gf": [5, 30, 30]}, r"force_gf is .*the first 0"),
        ({"force_gf": [0, -30, 30]}, r"force_gf is .*wanted: a force in gf of at least 0"),
        ({"force_gf": [0, 0, 0]}, r"force_gf is .*some greater"),
        ({"times_s": [0, 10, 800]}, r"times_s is .*time\.end_s = 900"),
        ({"times_s": None}, r"force_gf is .*one force above 0, or times_s too"),
        ({"force_gf": None}, r"force_gf is missing; .*kind 'force' has kind, name, times_s, force_gf"),
        ({"travel_mm": 5}, r"travel_mm is \[5\.0\]; .*left out"),
        ({"force_mN": 5}, r"force_mN is not a known key; .*'force_gf'"),
    ],
)
def test_a_force_that_is_none(demo, change, line):
    force = {"kind": "force", "times_s": [0, 10, 900], "force_gf": [0, 30, 30]}
    Scene.from_dict(put(demo, "protocol.0", force))
    changed = {key: value for key, value in (force | change).items() if value is not None}
    assert re.search(r"^protocol#1\." + line, str(refusal(put(demo, "protocol.0", changed))))


def test_a_tube_has_no_force_along_one_way(demo):
    data = put(put(demo, "protocol.0", {"kind": "force", "force_gf": 30}), "tool.kind", "tube")
    assert re.search(r"^protocol#1\.kind is 'force'; .*tool\.kind = 'tube'", str(refusal(data)))


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
        (b"", r"geometry is missing"),
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
    data = put(put(demo, "time.ramp_s", 1.0), "protocol.2", {"kind": "staged", "stages": 200, "rest_s": 1.0})
    assert str(refusal(put(data, "protocol.1", {"kind": "continuous", "name": "x"}))).startswith(
        "protocol#3.stages is 200; wanted: at most 111, for time.ramp_s = 1 and time.end_s = 900"
    )


def test_a_wall_that_would_begin_outside_the_brain(demo):
    demo["cleft"] |= {"target_mm": [0, 0, 58], "trajectory": [1, 0, 0], "wall_normal": [0, 0, 1]}
    assert re.match(r"cleft\.gap_mm is 4\.0; wanted: so small that the walls begin in tissue", str(refusal(demo)))


def test_the_narrowest_blade_has_a_face_off_its_edges():
    assert operation.NARROWEST / 2 > observer.PATCH_MARGIN


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
        data = put(demo, "time", {"ramp_s": ramp, "end_s": end})
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
    demo["time"]["ramp_s"] = 0.1
    line = str(refusal(put(demo, "protocol.1", {"kind": "intermittent", "hold_s": 0.1, "rest_s": 0.1})))
    assert re.search(r"^protocol#2\.hold_s is 0\.1; wanted: .* to the 1000th, .*end_s = 900$", line), line


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
    entries = [entry for part in PARTS for entry in document.entries(part).values()]
    assert len(entries) > 40 and all(entry.wanted and entry.key for entry in entries)
    for entry, (unit, (per_si, _)) in itertools.product(entries, document.UNITS.items()):
        if entry.key.endswith(f"_{unit}") and not (unit == "s" and entry.key.endswith("_Pa_s")):
            assert entry.per_si == per_si


def test_protocol_name_defaults_to_its_kind():
    assert Protocol(kind="staged", stages=3, rest=1.0).name == "staged"
    assert Protocol(kind="staged", name="gentle 2", stages=3, rest=1.0).name == "gentle 2"


def test_the_template_explains_every_key_and_what_it_comments_out_is_a_scene():
    text = Scene.template()
    keys = {entry.key for part in PARTS for entry in document.entries(part).values()}
    both = text + Scene.template("body")
    assert {key for key in keys if not re.search(rf"\b{key}\b", both)} == set()
    head, program = text.split('# [[protocol]]\n# kind = "program"')
    scene = Scene.from_dict(tomllib.loads(head + '[[protocol]]\nkind = "program"' + program.replace("\n# ", "\n", 3)))
    assert scene.protocols[-1].kind == "program" and scene.protocols[:3] == Scene.shipped("demo").protocols
    head, force = text.split('# [[protocol]]\n# kind = "force"')
    scene = Scene.from_dict(tomllib.loads(head + '[[protocol]]\nkind = "force"' + force.replace("\n# ", "\n", 3)))
    assert scene.protocols[-1].kind == "force" and max(scene.protocols[-1].force_gf) == 50
    head, patient = text.split("# [patient]")
    scene = Scene.from_dict(tomllib.loads(head + "[patient]" + patient.replace("\n# ", "\n")))
    assert scene.patient == Patient(mean_arterial_pressure=85.0, intracranial_pressure=10.0)
    head, asked = text.split("# [[quantity]]")
    scene = Scene.from_dict(tomllib.loads(head + "[[quantity]]" + re.sub(r"(?m)^# (?=name|protocol|toler)", "", asked)))
    assert scene.quantities == (Quantity(name="peak_pressure_mmHg", protocol="continuous", tolerance=0.1),)
    assert not Scene.shipped("demo").quantities
    with_ways = re.sub(r"(?m)^# (trajectory|wall_normal) = ", r"\1 = ", text)
    assert with_ways.count("\ntrajectory") == with_ways.count("\nwall_normal") == 1
    assert Scene.from_dict(tomllib.loads(with_ways)).cleft.wall_normal == (0.0, 1.0, 0.0)


def test_a_tube_has_to_fit_between_the_ends_of_the_cleft(demo):
    demo["tool"]["kind"] = "tube"
    assert Scene.from_dict(demo).tool.kind == "tube"
    demo["tool"]["travel_mm"] = 9.0
    with pytest.raises(
        InputError, match=r"tool#1\.kind is 'tube'; wanted: a spatula: a tube of 13 mm, .*width_mm = 12$"
    ):
        Scene.from_dict(demo)


def test_a_tool_of_given_force_may_rub():
    scene = Scene.shipped("idealised_fast")
    tool, force = dataclasses.replace(scene.tool, friction=0.1), Protocol(kind="force", force_gf=30.0)
    made = dataclasses.replace(scene, tools=(tool,), protocols=(force,))
    assert Scene.from_dict(made.to_dict()) == made and made.tool.friction == 0.1
