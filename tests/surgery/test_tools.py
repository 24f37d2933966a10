"""Tools of every kind: one signed distance for contact, pictures and checks; a closed surface equals its original shape."""

from dataclasses import replace

import meshio
import ngsolve as ngs
import numpy as np
import pytest
from netgen.occ import Box, OCCGeometry, Pnt, Sphere

from ngbrain.errors import InputError
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.io.surfacefile import read_surface
from ngbrain.materials import NeoHooke
from ngbrain.mesh import Cleft, block
from ngbrain.report.pictures.tool import tool_drawings
from ngbrain.report.render.surface import area
from ngbrain.scene import Scene, Tool
from ngbrain.surgery.tools import Ball, ClosedSurface, Spatula, make_tools

CLEFT = Cleft(np.zeros(3), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), 30e-3, 6e-3, 14e-3)
TURNED = Cleft(np.array([1e-2, 2e-2, -1e-2]), np.array([0.6, 0, 0.8]), np.array([0.0, 1.0, 0]), 30e-3, 6e-3, 14e-3)
KINDS = {
    "spatula": Tool(thickness=3e-3),
    "two spatulas": Tool(kind="two spatulas", thickness=2e-3),
    "plate": Tool(kind="plate", height=12e-3),
    "tube": Tool(kind="tube"),
    "ball": Tool(kind="ball", width=6e-3),
}


def stl(path, shape, maxh=1.0):
    """The surface of a shape (mm)."""
    mesh = OCCGeometry(shape).GenerateMesh(maxh=maxh)
    triangles = [[v.nr - 1 for v in element.vertices] for element in mesh.Elements2D()]
    meshio.write(path, meshio.Mesh(mesh.Coordinates(), [("triangle", np.array(triangles))]))
    return path


@pytest.fixture(scope="module")
def ball_file(tmp_path_factory):
    return stl(tmp_path_factory.mktemp("tools") / "ball.stl", Sphere(Pnt(7, -5, 3), 3.0), 0.4)


def around(rng, tool, advance, n=400, beyond=2e-3):
    low, high = tool.bounds(advance)
    return rng.uniform(low - beyond, high + beyond, (n, 3))


@pytest.mark.parametrize(("kind", "cleft"), [(kind, TURNED if kind == "ball" else CLEFT) for kind in KINDS])
def test_what_is_drawn_is_what_contact_sees(kind, cleft):
    """Every point of picture and section is on the tool, and in front of its face also on the contact surface."""
    tools, advance = make_tools(KINDS[kind], cleft), 4e-3
    blade = {"kind": kind} | {
        f"{name}_m": getattr(KINDS[kind], name)
        for name in ("width", "thickness", "edge_radius", "tip_clearance", "height")
    }
    shown = tool_drawings(blade, cleft, advance)
    assert len(shown) == (2 if kind == "two spatulas" else 1)
    for each, tool in zip(shown, tools.values(), strict=False):
        points, triangles = each.solid()
        at = tool.cleft.coordinates(points)
        gone = advance / len(tools)
        assert np.abs(tool.signed_distance(gone, at)).max() < 0.2e-3  # at sharp edges, of steps of .5 mm
        low, high = tool.bounds(gone)
        assert np.all(at > low - 1e-4) and np.all(at < high + 1e-4)
        front = at[at[:, 0] > cleft.opening / 2]
        assert len(front) and area(points, triangles) > 0.5 * np.pi * 36e-6
        profile = each.profile()
        flat = np.column_stack(
            [profile[:, 0] * np.sign(tool.cleft.across @ cleft.across), 0 * profile[:, 0], profile[:, 1]]
        )
        assert np.abs(tool.signed_distance(gone, flat)).max() < 0.08e-3
        assert np.allclose(profile[0], profile[-1])


def test_a_ball_has_the_area_of_one():
    (shown,) = tool_drawings({"kind": "ball", "width_m": 6e-3}, CLEFT, 2e-3)
    assert area(*shown.solid()) == pytest.approx(np.pi * 36e-6, rel=0.015)
    assert shown.across(4e-3 + 3e-3) == pytest.approx(2e-3, abs=1e-4)


def test_a_plate_ends_where_a_spatula_goes_on():
    spatula, plate = (make_tools(KINDS[kind], CLEFT)["wall_plus"] for kind in ("spatula", "plate"))
    at = np.array([[2e-3, 0, 10e-3], [2e-3, 0, 25e-3]])
    assert plate.signed_distance(1e-3, at)[0] == pytest.approx(-2e-3, abs=1e-6)
    assert (
        spatula.signed_distance(1e-3, at)[1] < 0 < plate.signed_distance(1e-3, at)[1] == pytest.approx(9e-3, abs=1e-6)
    )
    assert plate.top == 16e-3 and plate.middle == 10e-3


def test_a_surfaces_distance_is_that_of_its_shape(ball_file, rng):
    """A ball of triangles of .4 mm against the formula, near its surface and away from it, in a rotated cleft."""
    made = ClosedSurface.from_mesh(read_surface(ball_file), TURNED, 4e-3)
    ball = Ball(TURNED, 6e-3, 4e-3)
    assert made.bounds(1e-3)[1] == pytest.approx(ball.bounds(1e-3)[1], abs=1e-4)
    at = around(rng, ball, 1e-3)
    off = made.signed_distance(1e-3, at) - ball.signed_distance(1e-3, at)
    near = np.abs(ball.signed_distance(1e-3, at)) < 1.5e-3
    assert np.abs(off[near]).max() < 0.1e-3
    far = np.array([[20e-3, 0, 7e-3]])
    assert made.signed_distance(1e-3, far) == pytest.approx(
        ball.signed_distance(1e-3, far), rel=0.1
    )  # straight on from the grid's corner


def pressed(tool, way=None):
    """A block whose top is pressed by the tool, with the contact energy."""
    mesh = block((0.03, 0.03, 0.02), 0.005)
    cleft = Cleft(np.array([0.008, 0.015, 0.023]), np.array([1.0, 0, 0]), np.array([0, 0, -1.0]), 0.03, 6e-3, 14e-3)
    way = ngs.Parameter(0.0) if way is None else way
    contact = RigidContact("top", tool(cleft).distance(way), 1e6, 1e-5, travel=way)
    material = {".*": Material(NeoHooke(1e3), 1e4)}
    return Problem(mesh, material, {"bottom": 0}, contacts=[contact], element="P2/P1"), way


def test_pressing_by_a_surface_is_pressing_by_its_shape(ball_file):
    """The force at 2 mm of a triangulated ball is within 3 % of that of the formula."""
    surface, forces = read_surface(ball_file), []
    gaps = []
    for tool in (lambda cleft: ClosedSurface.from_mesh(surface, cleft, 4e-3), lambda cleft: Ball(cleft, 6e-3, 4e-3)):
        body, way = pressed(tool)
        way.Set(1e-3)
        body.x = body.x
        gaps.append(body.min_gap())
        for advance in (0.7e-3, 1.4e-3, 2e-3):
            way.Set(advance)
            record = LoadPath(body).solve()
            assert record.converged
        forces.append(body.force("bottom")[2])
    print(forces, gaps)
    assert gaps[0] == pytest.approx(gaps[1], abs=0.05e-3) and gaps[1] < -0.2e-3
    assert forces[0] == pytest.approx(forces[1], rel=0.03) and forces[1] > 0.01


def test_what_is_looked_up_has_its_derivatives(ball_file, rng):
    """Derivatives by displacements and by the tool's travel, against differences of energies."""
    surface = read_surface(ball_file)
    body, way = pressed(lambda cleft: ClosedSurface.from_mesh(surface, cleft, 4e-3))
    way.Set(1.5e-3)
    x = body.x
    along = 1e-5 * rng.normal(size=len(x)) * body.is_u
    forces = body.residual(x)[0]

    def energy(x):
        body.residual(x)
        return body.energy

    tried, wanted = energy(x + along) - energy(x - along), 2 * forces @ along
    assert tried == pytest.approx(wanted, rel=5e-3)
    body.residual(x)
    contact = body.contacts[0]
    driving = ngs.Integrate(contact.driving_force(body.u) * contact.measure(), body.mesh)

    def stored(at):
        way.Set(at)
        body.x = x
        return ngs.Integrate(contact.energy(body.u) * contact.measure(), body.mesh)

    assert driving == pytest.approx((stored(1.501e-3) - stored(1.499e-3)) / 2e-6, rel=5e-3) and driving > 0


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        (Box(Pnt(0, 0, 0), Pnt(9, 4, 10)), "tool.file is .*9 mm; wanted: at most 6: cleft.gap_mm, along x"),
        (Box(Pnt(0, 0, 0), Pnt(4, 20, 10)), "tool.file is .*20 mm; wanted: at most 14: cleft.width_mm, along y"),
    ],
)
def test_a_surface_that_does_not_fit_is_refused(tmp_path, shape, said):
    path = stl(tmp_path / "large.stl", shape, 5.0)
    with pytest.raises(InputError, match=said):
        make_tools(Tool(kind="surface", file=str(path)), CLEFT)


@pytest.mark.parametrize(
    ("tool", "said"),
    [
        (Tool(kind="plate"), "tool#1.height_mm is .*; wanted: a value for kind = 'plate'"),
        (Tool(height=0.01), "tool#1.height_mm is 10.*; wanted: a value for kind = 'plate', and no other kind"),
        (Tool(kind="plate", height=3e-3), "tool#1.height_mm is 3.*; wanted: at least 5"),
        (Tool(kind="surface"), "tool#1.file is .*; wanted: a value for kind = 'surface'"),
        (Tool(kind="ball", width=8e-3), "tool#1.width_mm is 8.*; wanted: at most 4, cleft.gap_mm: not a ball"),
        (Tool(kind="ball", width=4e-3, face_radius=0.1), "face_radius_mm .*: a ball has no face"),
    ],
)
def test_tools_that_mean_nothing_are_refused(tool, said):
    with pytest.raises(InputError, match=said):
        replace(Scene.shipped("idealised_fast"), tools=(tool,))


def test_a_spatula_is_one_of_either_side():
    one, other = make_tools(KINDS["two spatulas"], CLEFT).values()
    assert isinstance(one, Spatula) and one == replace(other, cleft=one.cleft)
