"""What a cheaper model drops or turns is what the richer one has; an error that is stated was judged; nothing is asked of zero."""

import json
from dataclasses import replace

import numpy as np
import pytest

import ngbrain
from ngbrain.cli import main
from ngbrain.errors import InputError, SolverError
from ngbrain.ladder.axes import AXES, axes_of, cheapest
from ngbrain.ladder.estimates import NOTHING
from ngbrain.ladder.levels import PresenceLevel
from ngbrain.ladder.model_search import search_along
from ngbrain.ladder.models.hierarchy import ModelHierarchy, Solution
from ngbrain.ladder.solutions import SolutionCache
from ngbrain.scene import DisplacementBC, Geometry, Gravity, MeshSize, Quantity, Scene, Time, Tissue, Traction

CUBE = Geometry(kind="block", size=(0.02, 0.02, 0.02))


def slab(fibre, by=-2e-3):
    """A block that cannot move along y, so that its strains are in the plane and the same everywhere: its section is exact."""
    sides = (DisplacementBC(boundary="front", components="y"), DisplacementBC(boundary="back", components="y"))
    ends = (
        DisplacementBC(boundary="bottom", components="z"),
        DisplacementBC(boundary="top", value=(0, 0, by), components="z"),
    )
    left = DisplacementBC(boundary="left", components="x")
    stuff = Tissue(mu=(400.0,), poissons_ratio=0.3, fibre_stiffness=100.0, fibre_exponent=30.0, fibre=fibre)
    return Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(stuff,),
        displacement_bcs=(*ends, left, *sides),
        quantities=(Quantity(name="force", boundary="top"),),
    )


@pytest.mark.parametrize("fibre", [(0, 0, 1), (1, 0, 0), (0, 1, 0), (1, 0, 2)])
def test_fibres_lie_in_the_section_as_they_do_in_the_body(fibre):
    scene = slab(fibre, by=2e-3)
    bench, model = ModelHierarchy(scene), cheapest(axes_of(scene)) | {"fibres": "all", "strain": "finite"}
    forces = []
    for space in ("plane", "solid"):
        try:
            forces.append(bench.solve({**model, "space": space}).answers[0])
        except SolverError:
            pytest.skip("no equilibrium")
    if fibre == (1, 0, 2):  # shears too
        assert forces[0] == pytest.approx(forces[1], rel=0.5)
    else:
        assert forces[0] == pytest.approx(forces[1], rel=1e-7)


def oblique(vector):
    """Turned by 37 degrees about (1, 2, 3)."""
    axis, angle = np.array([1.0, 2.0, 3.0]) / np.sqrt(14), np.radians(37)
    v = np.array(vector, float)
    turned = v * np.cos(angle) + np.cross(axis, v) * np.sin(angle) + axis * (axis @ v) * (1 - np.cos(angle))
    return tuple(turned.tolist())


def turned(part):
    """A scene that lies in its section, and one with one thing turned out of it."""
    turn = oblique if part else tuple
    of = {name: turn if name == part else tuple for name in ("fibre", "displacement", "traction", "gravity", "asked")}
    fibre = of["fibre"]((0, 0, 1))
    return Scene(
        mesh=MeshSize(largest=0.02),
        gravity=Gravity(acceleration=of["gravity"]((0, 0, -9.81))),
        geometry=CUBE,
        tissues=(Tissue(mu=(400.0,), poissons_ratio=0.3, fibre_stiffness=100.0, fibre_exponent=30.0, fibre=fibre),),
        displacement_bcs=(
            DisplacementBC(boundary="bottom"),
            DisplacementBC(boundary="left", value=of["displacement"]((1e-4, 0, 2e-4))),
        ),
        tractions=(Traction(boundary="top", value=of["traction"]((5.0, 0, 9.0))),),
        time=Time(),
        quantities=(Quantity(name="force", boundary="bottom", direction=of["asked"]((0, 0, 1))),),
    )


def test_what_lies_in_the_section_has_one():
    scene = turned("")
    assert "space" in axes_of(scene)
    assert ModelHierarchy(scene).mesh({"space": "plane", "mesh": "0"}).dim == 2


@pytest.mark.parametrize(
    ("part", "reason"),
    [
        ("fibre", "the fibre of '.*' is oblique"),
        ("displacement", "displacement of 'left' has a component along y"),
        ("traction", "traction on 'top' has a component along y"),
        ("gravity", "gravity has a component along y"),
        ("asked", "force on bottom along .* has a component along y"),
    ],
)
def test_the_section_declines_by_name_what_is_oblique_to_it(part, reason):
    scene = turned(part)
    assert "space" not in axes_of(scene)
    with pytest.raises(InputError, match=reason):
        ModelHierarchy(scene).mesh({"space": "plane", "mesh": "0"})
    with pytest.raises(InputError, match=reason):
        axes_of(scene, {"space": "plane"})


def test_a_fibre_along_the_load_is_not_lost():
    """.75 N by all models in space, fibre along z; the section said .064 and "9 % missing"."""
    given = (DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=(0, 0, 3e-3)))
    stuff = Tissue(mu=(400.0,), poissons_ratio=0.3, fibre_stiffness=100.0, fibre_exponent=30.0, fibre=(0, 0, 1))
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(stuff,),
        displacement_bcs=given,
        quantities=(Quantity(name="force", boundary="top", tolerance=0.15),),
    )
    result = ngbrain.simulate(scene)
    assert result.value["force on top, end"] == pytest.approx(0.7488, rel=0.2)


def test_a_judge_that_fails_is_an_unknown_error():
    class Failing:
        questions = (None,)

        def solve(self, model, near=None):
            if model["contact"] == "all":
                raise SolverError("it does not converge")
            return Solution(np.array([1.0]), {}, 1, 0.0)

    axes = {"contact": AXES["contact"]}
    axes["contact"] = type(axes["contact"])(
        "contact", tuple(PresenceLevel), ("that tissue slides",), ("solve",), (2.0,)
    )
    found = search_along(axes, SolutionCache(Failing()), np.array([0.1]), lambda _: None)
    assert found.error.tolist() == [np.inf] and any("does not converge" in flag for flag in found.warnings)


@pytest.mark.slow
def test_an_unknown_error_is_said_and_ends_with_3(tmp_path, capsys, monkeypatch):
    path = tmp_path / "scene.toml"
    path.write_text(
        "[geometry]\nkind='block'\nsize_mm=[20,20,20]\n[mesh]\nmax_size_mm=20\n[[tissue]]\nmu_Pa=1000\npoissons_ratio=0.3\n"
        "[[displacement_bc]]\nboundary='bottom'\n"
        "[[displacement_bc]]\nboundary='top'\nvalue_mm=[0,0,-18]\n[[quantity]]\nname='force'\nboundary='top'\ntolerance=0.01\n"
    )
    status = main(["simulate", str(path), "-o", str(tmp_path / "out"), "-q"])
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    error = result["answers"][0]["error_estimate"]
    assert (status == 3) == (error is None)
    if error is None:
        assert "are not known" in capsys.readouterr().err


@pytest.mark.parametrize("by", [(0, 0, -0.022), (0.021, 0, 0), (0, 0, 1.0)])
def test_displacements_beyond_the_body_are_refused(by):
    given = (DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=by))
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(Tissue(poissons_ratio=0.49, mu=(1e3,)),),
        displacement_bcs=given,
        quantities=(Quantity(name="force", boundary="top"),),
    )
    with pytest.raises(InputError, match=r"displacement_bc#2\.value_mm.*less than the body, 20 x 20 x 20 mm"):
        ngbrain.simulate(scene)


def test_two_conditions_on_one_boundary_are_refused():
    given = (DisplacementBC(boundary="bottom|top"), DisplacementBC(boundary="top", value=(0, 0, -1e-3), components="z"))
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(Tissue(poissons_ratio=0.49, mu=(1e3,)),),
        displacement_bcs=given,
        quantities=(Quantity(name="force", boundary="top"),),
    )
    with pytest.raises(
        InputError, match=r"displacement_bc#2\.boundary.*displacement_bc#1.*along z too.*one condition for 'top'"
    ):
        ngbrain.simulate(scene)
    apart = (
        DisplacementBC(boundary="bottom"),
        DisplacementBC(boundary="top", components="x"),
        DisplacementBC(boundary="top", value=(0, 0, -1e-3), components="yz"),
    )
    ngbrain.simulate(
        Scene(
            mesh=MeshSize(largest=0.02),
            geometry=CUBE,
            tissues=(Tissue(poissons_ratio=0.49, mu=(1e3,)),),
            displacement_bcs=apart,
            quantities=(Quantity(name="force", boundary="top", tolerance=1),),
        )
    )


@pytest.mark.parametrize(
    "quantity",
    [
        Quantity(name="force", boundary="top", direction=(1, 0, 0), tolerance=0.1),
        Quantity(name="displacement", point=(0, 0, 0.01), direction=(1, 0, 0), tolerance=0.1),
    ],
)
def test_what_is_zero_by_symmetry_ends(quantity):
    given = (DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=(0, 0, -1e-3)))
    piece = Geometry(kind="block", size=(0.02, 0.02, 0.02))
    scene = Scene(
        mesh=MeshSize(largest=0.01),
        geometry=piece,
        tissues=(Tissue(poissons_ratio=0.49, mu=(1e3,)),),
        displacement_bcs=given,
        quantities=(quantity,),
    )
    result = ngbrain.simulate(scene)
    along = Quantity(name="force", boundary="top", tolerance=0.1) if quantity.name == "force" else None
    largest = 1e-3
    if along is not None:
        (largest,) = map(abs, ngbrain.simulate(replace(scene, quantities=(along,))).value.values())
    (value,), (error,) = result.value.values(), result.errors.values()
    assert abs(value) < NOTHING * largest and error <= 0.1
    assert result["models"][-1]["ndof"] < 10_000
    assert any("nearly zero" in flag and "relative to" in flag for flag in result["cautions"])


def test_what_elements_at_the_top_leave_is_in_the_error():
    """Bounded axes: what the last step changed says what is left, which no estimate does."""
    given = (DisplacementBC(boundary="bottom"), DisplacementBC(boundary="top", value=(0, 0, -2e-3)))
    scene = Scene(
        mesh=MeshSize(largest=0.02),
        geometry=CUBE,
        tissues=(Tissue(poissons_ratio=0.49, mu=(1e3,)),),
        displacement_bcs=given,
        quantities=(Quantity(name="force", boundary="top", tolerance=1e-4),),
    )
    result = ngbrain.simulate(scene, richest={"order": "1", "mesh": "1"})
    (error,) = result.errors.values()
    last, before = (rung["answers"][0] for rung in (result["models"][-1], next(
        rung for rung in reversed(result["models"]) if rung["model"]["mesh"] != result["model"]["mesh"]
    )))  # fmt: skip
    assert error >= abs(last / before - 1) * (AXES["mesh"].tail - 1) * 0.97 > 1e-3
    assert not any("leave 0 %" in flag for flag in result["cautions"])
