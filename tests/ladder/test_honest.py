"""What a cheaper model drops or turns is what the richer one has; an error that is stated was judged; nothing is asked of zero."""

import json

import numpy as np
import pytest

import ngbrain
from ngbrain.cli import main
from ngbrain.errors import InputError, SolverError
from ngbrain.ladder.bodies import Bench, Solution
from ngbrain.ladder.climb import ascend
from ngbrain.ladder.estimates import NOTHING
from ngbrain.ladder.keeper import Keeper
from ngbrain.ladder.levels import PresenceLevel
from ngbrain.ladder.rungs import AXES, axes_of, cheapest
from ngbrain.scene.loading import Ask, Course, Given, Loading, Piece, Pull, Stuff

CUBE = Piece(size=(0.02, 0.02, 0.02), cell=0.02)


def slab(fibre, by=-2e-3, gravity=None):
    """A block that cannot move along y, so that its strains are in the plane and the same everywhere: its section is exact."""
    sides = (Given(boundary="front", along="y"), Given(boundary="back", along="y"))
    ends = (Given(boundary="bottom", along="z"), Given(boundary="top", by=(0, 0, by), along="z"))
    left = Given(boundary="left", along="x")
    stuff = Stuff(mu=(400.0,), poisson=0.3, k1=100.0, k2=30.0, fibre=fibre)
    course = Course(gravity=gravity)
    return Loading(piece=CUBE, stuff=(stuff,), given=(*ends, left, *sides), course=course, ask=(Ask(boundary="top"),))


@pytest.mark.parametrize("fibre", [(0, 0, 1), (1, 0, 0), (0, 1, 0), (1, 0, 2)])
def test_fibres_lie_in_the_section_as_they_do_in_the_body(fibre):
    scene = slab(fibre, by=2e-3)
    bench, model = Bench(scene), cheapest(axes_of(scene)) | {"fibres": "all", "strain": "finite"}
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
    return Loading(
        piece=CUBE,
        stuff=(Stuff(mu=(400.0,), poisson=0.3, k1=100.0, k2=30.0, fibre=fibre),),
        given=(Given(boundary="bottom"), Given(boundary="left", by=of["displacement"]((1e-4, 0, 2e-4)))),
        pull=(Pull(boundary="top", traction=of["traction"]((5.0, 0, 9.0))),),
        course=Course(gravity=of["gravity"]((0, 0, -1))),
        ask=(Ask(boundary="bottom", direction=of["asked"]((0, 0, 1))),),
    )


def test_what_lies_in_the_section_has_one():
    scene = turned("")
    assert "space" in axes_of(scene)
    assert Bench(scene).mesh({"space": "plane", "mesh": "0"}).dim == 2


@pytest.mark.parametrize(
    ("part", "reason"),
    [
        ("fibre", "the fibre of '.*' is oblique"),
        ("displacement", "displacement of 'left' has a part along y"),
        ("traction", "traction on 'top' has a part along y"),
        ("gravity", "gravity has a part along y"),
        ("asked", "force on bottom along .* has a part along y"),
    ],
)
def test_the_section_declines_by_name_what_is_oblique_to_it(part, reason):
    scene = turned(part)
    assert "space" not in axes_of(scene)
    with pytest.raises(InputError, match=reason):
        Bench(scene).mesh({"space": "plane", "mesh": "0"})
    with pytest.raises(InputError, match=reason):
        axes_of(scene, {"space": "plane"})


def test_a_fibre_along_the_load_is_not_lost():
    """.75 N by all models in space, fibre along z; the section said .064 and "9 % missing"."""
    given = (Given(boundary="bottom"), Given(boundary="top", by=(0, 0, 3e-3)))
    stuff = Stuff(mu=(400.0,), poisson=0.3, k1=100.0, k2=30.0, fibre=(0, 0, 1))
    scene = Loading(piece=CUBE, stuff=(stuff,), given=given, ask=(Ask(boundary="top", tolerance=0.15),))
    result = ngbrain.solve(scene)
    assert result["answers"]["force on top, end"] == pytest.approx(0.7488, rel=0.2)


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
    found = ascend(axes, Keeper(Failing()), np.array([0.1]), lambda _: None)
    assert found.error.tolist() == [np.inf] and any("does not converge" in flag for flag in found.warnings)


def test_an_unknown_error_is_said_and_ends_with_3(tmp_path, capsys, monkeypatch):
    path = tmp_path / "scene.toml"
    path.write_text(
        "[piece]\nsize_mm=[20,20,20]\ncell_mm=20\n[[stuff]]\nmu_Pa=1000\npoisson=0.3\n[[given]]\nboundary='bottom'\n"
        "[[given]]\nboundary='top'\nby_mm=[0,0,-18]\n[[ask]]\nboundary='top'\ntolerance=0.01\n"
    )
    status = main(["solve", str(path), "-o", str(tmp_path / "out"), "-q"])
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    error = result["error"]["force on top, end"]
    assert (status == 3) == (error is None)
    if error is None:
        assert "is not known" in capsys.readouterr().err


@pytest.mark.parametrize("by", [(0, 0, -0.022), (0.021, 0, 0), (0, 0, 1.0)])
def test_displacements_beyond_the_body_are_refused(by):
    given = (Given(boundary="bottom"), Given(boundary="top", by=by))
    scene = Loading(piece=CUBE, stuff=(Stuff(mu=(1e3,)),), given=given, ask=(Ask(boundary="top"),))
    with pytest.raises(InputError, match=r"given#2\.by_mm.*less than the body, 20 x 20 x 20 mm"):
        ngbrain.solve(scene)


def test_two_conditions_on_one_boundary_are_refused():
    given = (Given(boundary="bottom|top"), Given(boundary="top", by=(0, 0, -1e-3), along="z"))
    scene = Loading(piece=CUBE, stuff=(Stuff(mu=(1e3,)),), given=given, ask=(Ask(boundary="top"),))
    with pytest.raises(InputError, match=r"given#2\.boundary.*given#1.*along z too.*one condition for 'top'"):
        ngbrain.solve(scene)
    apart = (
        Given(boundary="bottom"),
        Given(boundary="top", along="x"),
        Given(boundary="top", by=(0, 0, -1e-3), along="yz"),
    )
    ngbrain.solve(Loading(piece=CUBE, stuff=(Stuff(mu=(1e3,)),), given=apart, ask=(Ask(boundary="top", tolerance=1),)))


@pytest.mark.parametrize(
    "ask",
    [
        Ask(boundary="top", direction=(1, 0, 0), tolerance=0.1),
        Ask(quantity="displacement", point=(0, 0, 0.01), direction=(1, 0, 0), tolerance=0.1),
    ],
)
def test_what_is_zero_by_symmetry_ends(ask):
    given = (Given(boundary="bottom"), Given(boundary="top", by=(0, 0, -1e-3)))
    piece = Piece(size=(0.02, 0.02, 0.02), cell=0.01)
    scene = Loading(piece=piece, stuff=(Stuff(mu=(1e3,)),), given=given, ask=(ask,))
    result = ngbrain.solve(scene)
    along = Ask(boundary="top", tolerance=0.1) if ask.quantity == "force" else None
    largest = 1e-3 if along is None else abs(next(iter(ngbrain.solve(
        Loading(piece=piece, stuff=(Stuff(mu=(1e3,)),), given=given, ask=(along,))
    )["answers"].values())))  # fmt: skip
    (value,), (error,) = result["answers"].values(), result["error"].values()
    assert abs(value) < NOTHING * largest and error <= 0.1
    assert result["rungs"][-1]["ndof"] < 10_000
    assert any("nearly nothing" in flag and "part of" in flag for flag in result["flags"])


def test_what_elements_at_the_top_leave_is_in_the_error():
    """Bounded axes: what the last step changed says what is left, which no estimate does."""
    given = (Given(boundary="bottom"), Given(boundary="top", by=(0, 0, -2e-3)))
    scene = Loading(piece=CUBE, stuff=(Stuff(mu=(1e3,)),), given=given, ask=(Ask(boundary="top", tolerance=1e-4),))
    result = ngbrain.solve(scene, richest={"order": "1", "mesh": "1"})
    (error,) = result["error"].values()
    last, before = (rung["answers"][0] for rung in (result["rungs"][-1], next(
        rung for rung in reversed(result["rungs"]) if rung["model"]["mesh"] != result["model"]["mesh"]
    )))  # fmt: skip
    assert error >= abs(last / before - 1) * (AXES["mesh"].tail - 1) * 0.97 > 1e-3
    assert not any("leave 0 %" in flag for flag in result["flags"])
