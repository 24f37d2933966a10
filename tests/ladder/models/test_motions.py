"""What is prescribed by formulas of place and time, by rotations, and pressures that follow: against closed forms."""

from dataclasses import replace

import netgen.occ as occ
import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.ladder import search_models
from ngbrain.ladder.axes import axes_of
from ngbrain.ladder.models.hierarchy import ModelHierarchy
from ngbrain.ladder.models.motions import characteristic_time
from ngbrain.ladder.models.section import not_in_section
from ngbrain.scene import Contact, DisplacementBC, Geometry, MeshSize, Pressure, Quantity, Scene, Time, Tissue, Traction

BLOCK = Geometry(kind="block", size=(0.02, 0.02, 0.02))
FOOT = DisplacementBC(boundary="bottom")
PLAIN = {"strain": "linear", "pressure": "none", "order": "2", "mesh": "0"}
FORCE = Quantity(name="force", boundary="top", direction=(1, 0, 0), tolerance=0.02)


def scene(*bcs, tissue=None, **more):
    given = {
        "geometry": BLOCK,
        "tissues": (tissue or Tissue(mu=1000.0, poissons_ratio=0.3),),
        "mesh": MeshSize(largest=0.02),
        "displacement_bcs": bcs,
        "time": Time(ramp=1.0, end=5.0),
        "quantities": (FORCE,),
    }
    return Scene(**given | more)


def answers(made, **levels):
    return ModelHierarchy(made).solve({**PLAIN, **levels}).answers


def sheared(value, tissue=None, **more):
    return scene(FOOT, DisplacementBC(boundary="top", value=(value, 0, 0)), tissue=tissue, **more)


def test_a_formula_is_what_it_says():
    """Of place on the whole boundary: an affine map is the solution, whose strain is known; numbers give the same bits."""
    A = 0.1 * np.array([[0.1, 0.05, 0], [0, -0.05, 0.02], [0.03, 0, 0.04]])
    rows = tuple(f"{a}*x + {b}*y + {c}*z" for a, b, c in A)
    point = Quantity(name="displacement", point=(0.004, -0.002, 0.007), direction=(0, 0, 1))
    made = scene(DisplacementBC(boundary=".*", value=rows), quantities=(Quantity(name="strain"), point))
    F = np.eye(3) + A
    strain = np.linalg.eigvalsh((F.T @ F - np.eye(3)) / 2)[-1]
    assert answers(made, strain="finite", space="solid") == pytest.approx([strain, A[2] @ point.point], rel=1e-6)
    for way in ("-0.5", "-t/10"):
        other = sheared(way)
        assert answers(other, space="plane") == pytest.approx(answers(sheared(-0.0005), space="plane"), rel=1e-9)


@pytest.mark.parametrize("way", ["0.2*sin(t)", "0.2*min(t, 1)"])
def test_relaxing_tissue_remembers_the_course(way):
    """Linear tissue in shear has the convolution of the course with what relaxes: f = μ∞ γ(T) + μ₁ ∫ e^((s - T)/τ) γ' ds."""
    elastic = answers(sheared(0.0002, Tissue(mu=1.0, bulk_to_shear_ratio=2000.0)), space="plane")[0]
    tissue = Tissue(mu=(500.0, 500.0), tau=(2.0,), bulk_to_shear_ratio=2000.0)
    found = answers(sheared(way, tissue), space="plane", time="prony")[0] / elastic
    s = np.linspace(0, 5, 100_001)
    course = np.sin(s) if "sin" in way else np.minimum(s, 1)
    kernel = np.exp((s - 5) / 2)
    convolved = np.sum((kernel[1:] + kernel[:-1]) / 2 * np.diff(course))
    assert found == pytest.approx(500 * course[-1] + 500 * convolved, rel=2e-3)


def test_a_load_by_a_formula_grows_as_it_says():
    """100 t within a ramp of 1 s is what a load of 100 does: relaxing tissue remembers the way."""
    tissue, time = Tissue(mu=(300.0, 700.0), tau=(0.3,), poissons_ratio=0.3), Time(ramp=1.0, end=1.0)
    asked = (Quantity(name="displacement", point=(0, 0, 0.02), direction=(1, 0, 0)),)
    pulled = [
        scene(
            FOOT, tissue=tissue, time=time, tractions=[Traction(boundary="top", value=(pull, 0, 0))], quantities=asked
        )
        for pull in (50.0, "50*t")
    ]
    one, other = (answers(made, space="plane", time="prony")[0] for made in pulled)
    assert one == pytest.approx(other, rel=2e-3) and one > 1e-4  # in six steps and in seven


def test_each_moment_has_its_own_answer():
    both = tuple(replace(FORCE, when=when) for when in ("end", "ramp"))
    made = sheared("0.2*sin(t)", quantities=both)
    unit = answers(sheared(0.0002), space="plane")[0]
    assert answers(made, space="plane") / unit == pytest.approx(np.sin([5.0, 1.0]), rel=1e-6)


@pytest.fixture(scope="module")
def shaft(tmp_path_factory):
    """A cylinder of radius and length 10 mm."""
    body = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=0.01, h=0.01)
    body.faces.Min(occ.Z).name, body.faces.Max(occ.Z).name = "bottom", "top"
    body.mat("tissue")
    file = tmp_path_factory.mktemp("shaft") / "shaft.vol"
    occ.OCCGeometry(body).GenerateMesh(maxh=0.0035, parallel_meshing=False).Save(str(file))
    return Geometry(kind="mesh", unit="m", file=str(file))


def test_a_twisted_shaft_pushes_its_ends_apart(shaft):
    """Poynting's effect: of Neo-Hooke N = -π/4 μ κ² a⁴ (Rivlin 1948), at any angle; a chord's corners make it less."""
    tissue, turned = (
        Tissue(mu=1000.0, bulk_to_shear_ratio=1e4),
        DisplacementBC(boundary="top", rotation=60, axis=(0, 0, 2)),
    )
    along = Quantity(name="force", boundary="top", tolerance=0.1)
    made = scene(FOOT, turned, tissue=tissue, geometry=shaft, quantities=(along,))
    found = answers(made, strain="finite", pressure="unknown", order="1")[0]
    assert found == pytest.approx(-np.pi / 4 * 1000 * np.radians(60) ** 2 * 0.01**2, rel=0.06)


@pytest.mark.slow
def test_what_poor_elements_cannot_solve_is_tried_in_better_ones(tmp_path):
    """Those of first order without pressures lock, and fold when they are twisted."""
    body = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=0.01, h=0.02)
    body.faces.Min(occ.Z).name, body.faces.Max(occ.Z).name = "bottom", "top"
    occ.OCCGeometry(body).GenerateMesh(maxh=0.005, parallel_meshing=False).Save(str(tmp_path / "long.vol"))
    made = scene(
        FOOT,
        DisplacementBC(boundary="top", rotation=60, axis=(0, 0, 2)),
        tissue=Tissue(mu=1000.0, bulk_to_shear_ratio=1e4),
        geometry=Geometry(kind="mesh", unit="m", file=str(tmp_path / "long.vol")),
        quantities=(Quantity(name="force", boundary="top", tolerance=0.1),),
    )
    found = search_models(made, {"mesh": "0"})
    assert [rung.next_axes for rung in found.history[:3]] == [("strain",), ("pressure",), ("strain",)]
    assert found.chosen.model["strain"] == "finite"


@pytest.mark.slow
def test_the_ladder_sees_that_a_twist_is_finite(shaft):
    """Small strains do not push at all."""
    turned = DisplacementBC(boundary="top", rotation=60, axis=(0, 0, 2))
    along = Quantity(name="force", boundary="top", tolerance=0.1)
    made = scene(FOOT, turned, tissue=Tissue(mu=1000.0, bulk_to_shear_ratio=1e4), geometry=shaft, quantities=(along,))
    found = search_models(made, {"mesh": "0"}).chosen
    timed = replace(made, displacement_bcs=(FOOT, replace(turned, rotation="12*t")))
    assert ModelHierarchy(timed).solve(found.model).answers == pytest.approx(found.answers, rel=1e-6)
    assert found.model["strain"] == "finite" and found.model["pressure"] == "unknown"
    assert found.answers[0] == pytest.approx(-np.pi / 4 * 1000 * np.radians(60) ** 2 * 0.01**2, rel=0.1)


def test_a_pressure_follows():
    """All around, of a body on rollers: p on the area as it is then, J = 1 - p/K."""
    rollers = [DisplacementBC(boundary=b, components=c) for b, c in (("bottom", "z"), ("left", "x"), ("front", "y"))]
    asked = (
        Quantity(name="force", boundary="bottom"),
        Quantity(name="displacement", point=(0.01, 0.01, 0.02), direction=(1, 0, 0)),
    )
    made = scene(*rollers, pressures=[Pressure(boundary="top|right|back", value=300.0)], quantities=asked)
    (force, moved), long = answers(made, strain="finite"), (1 - 300 / made.tissues[0].bulk) ** (1 / 3)
    assert force == pytest.approx(300 * (0.02 * long) ** 2, rel=1e-6) and moved == pytest.approx(
        0.02 * (long - 1), rel=1e-6
    )
    timed = replace(made, pressures=(Pressure(boundary="top|right|back", value="60*t"),))
    assert answers(timed, strain="finite") == pytest.approx([force, moved], rel=1e-6)
    dead = replace(made, pressures=(), tractions=(Traction(boundary="top", value=(0, 0, -300)),))
    pushed = replace(made, pressures=(Pressure(boundary="top", value="300*(1 + 0*x)"),))
    assert answers(pushed) == pytest.approx(answers(dead), rel=1e-3)  # of small strains they are alike


@pytest.mark.parametrize(
    ("bc", "said"),
    [
        ({"value": ("y", 0, 0)}, "varies along y"),
        ({"value": (0, "x", 0)}, "has a component along y"),
        ({"value": ("x*sin(t)", 0, "z")}, None),
        ({"rotation": 5, "axis": (0, 1, 1)}, "is not about y"),
        ({"rotation": "5*t", "axis": (0, -2, 0)}, None),
    ],
)
def test_a_section_has_what_lies_in_it(bc, said):
    made = scene(FOOT, DisplacementBC(boundary="top", **bc))
    assert not_in_section(made) == (said and f"the {'rotation' if 'axis' in bc else 'displacement'} of 'top' {said}")
    assert ("space" in axes_of(made)) == (said is None)


def test_a_load_on_a_side_that_a_section_lacks_is_not_left_out():
    made = scene(FOOT, tractions=(Traction(boundary="top|back", value=(1, 0, 0)),))
    assert not_in_section(made) == "a section has no 'back'"


def test_a_turned_section_goes_the_way_of_its_body():
    turned = DisplacementBC(boundary="top", rotation=10, axis=(0, 1, 0), centre=(0, 0, 0.02))
    asked = (Quantity(name="displacement", point=(0.008, 0, 0.018)),)
    flat, solid = (
        answers(scene(FOOT, turned, quantities=asked), strain="finite", space=space)[0] for space in ("plane", "solid")
    )
    assert flat == pytest.approx(solid, rel=0.1) and solid < -0.001


def test_axes_of_what_goes_fast():
    """Mass counts where a course is fast, whatever the ramp; and moduli of one moment stand for no course."""
    stiff = Tissue(mu=(1000.0, 500.0), tau=(1.0,), bulk_to_shear_ratio=2000.0)
    slow, fast = sheared("0.2*sin(t)", stiff), sheared("0.2*sin(2*pi*50*t)", stiff, time=Time(ramp=1.0, end=900.0))
    assert characteristic_time(slow, 5.0) == pytest.approx(1, rel=1e-3) and characteristic_time(
        fast, 900.0
    ) == pytest.approx(1 / (100 * np.pi), rel=0.01)
    assert "inertia" not in axes_of(slow) and "inertia" in axes_of(fast)
    assert axes_of(slow)["time"].levels == ("prony",)
    assert axes_of(sheared(0.0002, stiff))["time"].levels == ("instantaneous", "relaxed", "prony")


def test_a_region_of_interest_has_all_of_what_varies():
    plate = Geometry(kind="block", size=(0.1, 0.1, 0.02), plate=(0.01, 0.01))
    on = {
        name: scene(FOOT, DisplacementBC(boundary=name, value=(0, 0, "0.1*x*t")), geometry=plate)
        for name in ("top", "plate")
    }
    assert "extent" in axes_of(on["plate"]) and "extent" not in axes_of(on["top"])


@pytest.mark.parametrize(
    ("bcs", "said"),
    [
        ([{"value": ("0.2*cos(t)", 0, 0)}], "displacement_bc#2.value_mm .*0 at t = 0"),
        ([{"value": ("100*x", 0, 0)}], "displacement_bc#2.value_mm .*less than the body, 20 x 20 x 20 mm"),
        ([{"value": ("log(z - 100)", 0, 0)}], "displacement_bc#2.value_mm .*finite values all over 'top'"),
        ([{"value": ("sqrt(abs(x)-10)", 0, 0)}], "finite values all over"),
        ([{"rotation": "5 + t", "axis": (0, 1, 0)}], "displacement_bc#2.rotation_deg is 5 . t; wanted: .*0 at t = 0"),
        (
            [{}, {"value": (0.001, 0, 0), "components": "x"}],
            "displacement_bc#3.* displacement_bc#2 .'top'. prescribes along x",
        ),
    ],
)
def test_what_cannot_be_is_refused(bcs, said):
    made = scene(FOOT, *(DisplacementBC(boundary="top", **bc) for bc in bcs))
    with pytest.raises(InputError, match=said):
        answers(made, space="solid")


def test_loads_begin_at_rest_and_steps_end():
    for load, said in (
        ({"tractions": [Traction(boundary="top", value=(0, 0, "1 + t"))]}, "traction#1.value_Pa .*0 at t = 0"),
        ({"pressures": [Pressure(boundary="top", value="1/(t - 5)")]}, "pressure#1.value_Pa .*finite values all over"),
    ):
        with pytest.raises(InputError, match=said):
            answers(scene(FOOT, **load), space="solid")
    relaxing = Tissue(mu=(500.0, 500.0), tau=(2.0,), poissons_ratio=0.3)
    fast = sheared("0.2*sin(2*pi*50*t)", relaxing, time=Time(ramp=1.0, end=900.0))
    with pytest.raises(
        InputError, match=r"time.end_s is 900.0; wanted: at most .*which takes 5000 steps of a motion this fast"
    ):
        answers(fast, time="prony", space="plane")


def test_two_tissues_of_one_region_are_refused_by_name():
    made = scene(FOOT, DisplacementBC(boundary="top", value=(1e-4, 0, 0)), tractions=())
    made = replace(made, tissues=(Tissue(mu=1e3), Tissue(region="tis.*", mu=2e3)))
    with pytest.raises(
        InputError, match=r"tissue#2.region is 'tis.\*', which has region 'tissue' as tissue#1 \('.\*'\) does"
    ):
        answers(made, space="solid")


def test_a_wave_has_amplitudes_of_place():
    """Of a bar that is shaken along itself all over its boundary as a plane wave goes, the wave itself."""
    moved = DisplacementBC(boundary=".*", value=("0.1*cos(0.1*z)", 0, 0))
    asked = (Quantity(name="displacement", point=(0.0, 0.0, 0.01), direction=(1, 0, 0)),)
    speed, k = 1.0, 100.0
    made = scene(moved, tissue=Tissue(mu=1000.0, poissons_ratio=0.3, density=1000.0), time=Time(frequency=k * speed / (2 * np.pi)),
                 quantities=asked)  # fmt: skip
    found = ModelHierarchy(made).solve({"inertia": "all", "order": "4", "mesh": "0", "space": "solid"}).answers[0]
    assert found == pytest.approx(1e-4 * np.cos(1.0), rel=1e-3)


ROLLERS = [DisplacementBC(boundary=b, components=c) for b, c in (("bottom", "z"), ("left", "x"), ("front", "y"))]
PLANE = {"boundary": "top", "shape": "plane", "point": (0, 0, 0.021), "direction": (0, 0, -1)}


def test_a_plane_presses_as_a_prescribed_displacement_does():
    """Over a gap of 1 mm, on rollers: the block stays a block."""
    asked = (Quantity(name="force", boundary="top"),)
    pressed = scene(*ROLLERS, contacts=[Contact(**PLANE, travel=(0, 0, -0.003))], quantities=asked)
    moved = scene(*ROLLERS, DisplacementBC(boundary="top", value=(0, 0, -0.002), components="z"), quantities=asked)
    found, exact = (answers(made, strain="finite")[0] for made in (pressed, moved))
    assert found == pytest.approx(exact, rel=2e-3) and exact < -0.1
    timed = replace(pressed, contacts=(Contact(**PLANE, travel=(0, 0, "-3*t/5")),))
    assert answers(timed, strain="finite")[0] == pytest.approx(found, rel=1e-6)
    short = replace(pressed, contacts=(Contact(**PLANE, travel=(0, 0, -0.0009)),))
    assert abs(answers(short, strain="finite")[0]) < 1e-12


def test_what_slides_is_dragged_with_its_coefficient():
    """A plane that goes down and then along: tangential over normal force is Coulomb's, once all of it slides."""
    way = ("4*max(t - 1, 0)", 0, "-1 - min(t, 1)")
    both = tuple(Quantity(name="force", boundary="top", direction=along) for along in ((1, 0, 0), (0, 0, 1)))
    made = scene(
        FOOT, contacts=[Contact(**PLANE, travel=way, friction=0.2)], time=Time(ramp=1.0, end=2.0), quantities=both
    )
    assert made.is_timed and "friction" in axes_of(made)
    with pytest.raises(InputError, match=r"contact#1.travel_mm .*0 at t = 0"):
        answers(made)
    made = replace(made, contacts=(replace(made.contacts[0], travel=(way[0], 0, "-2*min(t, 1)")),))
    along, down = answers(made, strain="finite", friction="all", space="plane")
    assert along / -down == pytest.approx(0.2, rel=1e-3) and down < -0.05
    along, down = answers(made, strain="finite", friction="none", space="plane")
    assert abs(along) < 1e-6 * abs(down)


@pytest.mark.slow
def test_a_ball_presses_as_hertz_says():
    """4/3 E* √R d^1.5 (Hertz 1882), of a half space; a block of ten contact radii is a little stiffer."""
    block = Geometry(kind="block", size=(0.04, 0.04, 0.02), plate=(0.008, 0.008))
    ball = Contact(boundary="plate", shape="ball", point=(0, 0, 0.04), radius=0.02, travel=(0, 0, -4e-4))
    asked = (Quantity(name="force", boundary="plate"),)
    made = scene(FOOT, geometry=block, mesh=MeshSize(largest=0.004), contacts=[ball], quantities=asked)
    stiffness = 2 * 1000 / (1 - 0.3)
    found = answers(made, strain="finite")[0]
    assert found == pytest.approx(-4 / 3 * stiffness * 0.02**0.5 * 4e-4**1.5, rel=0.25)


def test_the_ladder_climbs_what_touches():
    made = scene(
        FOOT, contacts=[Contact(**PLANE, travel=(0, 0, -0.0015))], quantities=(Quantity(name="force", boundary="top"),)
    )
    axes = axes_of(made)
    assert axes["strain"].levels == ("finite",) and axes["mesh"].levels == ("0", "1", "2") and "extent" not in axes
    found = search_models(made, {"mesh": "1", "order": "2"}).chosen
    best = answers(made, strain="finite", space="solid", order="3", mesh="1", pressure="unknown")[0]
    assert abs(found.answers[0] / best - 1) < 0.05 and {each.method for each in found.estimates.values()} <= {
        "solved",
        "on the coarsest elements",
    }


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (
            {"shape": "ball", "point": (0, 0, 0.04), "radius": 0.02},
            "the ball on 'top' has no section, or moves out of it",
        ),
        ({"shape": "cylinder", "point": (0, 0, 0.04), "radius": 0.02, "direction": (0, 1, 0)}, None),
        (
            {"shape": "cylinder", "point": (0, 0, 0.04), "radius": 0.02, "direction": (1, 0, 0)},
            "the cylinder on 'top' has no section",
        ),
        (
            {"shape": "plane", "point": (0, 0, 0.04), "direction": (0, 0, -1), "travel": (0, 1e-3, 0)},
            "the plane on 'top' has no section",
        ),
    ],
)
def test_a_section_has_bodies_that_go_on_along_y(body, said):
    found = not_in_section(scene(FOOT, contacts=[Contact(boundary="top", **body)]))
    assert found is None if said is None else found.startswith(said)


@pytest.mark.slow
def test_a_body_that_is_turned_half_around_goes_around(shaft):
    """Both ends by 180°, one 30° further: the same twist, and no way straight through the axis, where it would vanish."""
    asked = (Quantity(name="force", boundary="top", tolerance=0.1),)

    def twisted(foot, top):
        ends = [
            DisplacementBC(boundary=name, rotation=angle, axis=(0, 0, 1))
            for name, angle in (("bottom", foot), ("top", top))
        ]
        made = scene(*ends, tissue=Tissue(mu=1000.0, poissons_ratio=0.4), geometry=shaft, quantities=asked)
        return answers(made, strain="finite", order="1")[0]

    assert twisted(180.0, 210.0) == pytest.approx(twisted(1e-9, 30.0), rel=1e-5)
