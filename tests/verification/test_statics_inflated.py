"""Thick spheres and cylinders under inner pressure: in space, in plane strain, as bodies of revolution; small and large strain.

Radii 1 and 2, initial shear modulus 1, without change of volume unless said otherwise.
"""

from math import inf, pi

import netgen.occ as occ
import numpy as np
import pytest
from finite_strain import CAVITY, eighth_of_a_shell, quarter_of_a_ring, refined
from statics import tight

from ngbrain.forward.common.kinematics import Axisymmetric
from ngbrain.forward.common.loads import CavityPressure, CavityVolume, PressureLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.materials import MooneyRivlin, NeoHooke

# Stretch of the cavity → pressure.
SPHERE = {1.1: 0.287155, 1.5: 0.755433, 2.0: 0.806927, 2.5: 0.726482}
SPHERE_MOONEY = {1.2: 0.491167, 2.0: 0.920378, 3.0: 0.874096}
RING = {1.1: 0.131562, 1.2: 0.233370, 1.5: 0.428228, 2.0: 0.574053, 3.0: 0.660417}
PLANES = {"x": (0, None, None), "y": (None, 0, None), "z": (None, None, 0)}
LINES = {"x": (0, None), "y": (None, 0)}


def rubber(law=None, bulk=inf):
    return {".*": Material(law or NeoHooke(1.0), bulk)}


def opened(mesh, supports, stretch, whole, form, law=None, **options):
    """Pressure that opens a cavity of the volume `whole`, as far as the mesh goes, to a stretch."""
    power = 2 if mesh.dim == 2 and not options else 3
    load = CavityVolume(CAVITY, whole * (stretch**power - 1))
    body = Problem(mesh, rubber(law), supports, [load], element=form, **options)
    record = LoadPath(body).solve(newton=tight())
    assert record.min_det_F > 0.5
    assert body.volume(CAVITY) == pytest.approx(whole * stretch**power, rel=5e-3)
    return body.cavity_pressures()[0]


@pytest.mark.parametrize("stretch", SPHERE)
def test_sphere_through_its_limit_point(stretch):
    found = opened(eighth_of_a_shell(0, 3), PLANES, stretch, pi / 6, "P3/P2")
    print(stretch, found / SPHERE[stretch] - 1)
    assert found == pytest.approx(SPHERE[stretch], rel=3e-3)


@pytest.mark.parametrize("stretch", SPHERE_MOONEY)
def test_mooney_rivlin_sphere(stretch):
    found = opened(eighth_of_a_shell(0, 3), PLANES, stretch, pi / 6, "P3/P2", MooneyRivlin(0.45, 0.05))
    print(stretch, found / SPHERE_MOONEY[stretch] - 1)
    assert found == pytest.approx(SPHERE_MOONEY[stretch], rel=4e-3)


@pytest.mark.parametrize("stretch", SPHERE)
def test_sphere_as_a_body_of_revolution(stretch):
    # A quarter of a disc: x is the axis, so half a sphere.
    mesh = quarter_of_a_ring(2, 4)
    found = opened(mesh, LINES, stretch, 2 * pi / 3, "P4/P3", kinematics=Axisymmetric())
    print(stretch, found / SPHERE[stretch] - 1)
    assert found == pytest.approx(SPHERE[stretch], abs=1.5e-6)


@pytest.mark.parametrize("stretch", RING)
def test_cylinder_in_plane_strain(stretch):
    found = opened(quarter_of_a_ring(2, 4), LINES, stretch, pi / 4, "P4/P3")
    print(stretch, found / RING[stretch] - 1)
    assert found == pytest.approx(RING[stretch], abs=1.5e-6)


def tube(level):
    """Half plane through a tube of length 1."""
    shape = occ.WorkPlane().MoveTo(1, 0).Rectangle(1, 1).Face()
    shape.edges.name = "end"
    shape.edges.Min(occ.X).name, shape.edges.Max(occ.X).name = CAVITY, "outside"
    return refined(shape, level, 1, dim=2)


@pytest.mark.parametrize("stretch", RING)
def test_cylinder_as_a_body_of_revolution(stretch):
    loads = [PressureLoad(CAVITY, RING[stretch])]
    body = Problem(tube(2), rubber(), {"end": (None, 0)}, loads, element="P4/P3", kinematics=Axisymmetric())
    LoadPath(body).solve(newton=tight())
    found = body.u(body.mesh(1, 0.3))[0] + 1
    slope = (ring(stretch + 1e-5) - ring(stretch - 1e-5)) / 2e-5  # what a digit that the table leaves out is worth
    print(stretch, found / stretch - 1)
    assert found == pytest.approx(stretch, abs=1e-6 * stretch + 1e-6 / slope)
    assert body.force("outside") == pytest.approx((0, 0), abs=1e-6)


def ring(stretch):
    outer = np.sqrt((stretch**2 + 3) / 4)
    return np.log(stretch / outer) + (outer**-2 - stretch**-2) / 2


LOAD = 1e-5
"""Small enough for linear theory to four digits."""


@pytest.mark.parametrize("nu", [0.3, 0.4999, 0.5])
def test_lames_cylinder(nu):
    bulk = inf if nu == 0.5 else 2 * (1 + nu) / (3 * (1 - 2 * nu))
    body = Problem(quarter_of_a_ring(2, 4), rubber(bulk=bulk), LINES, [PressureLoad(CAVITY, LOAD)], element="P4/P3")
    LoadPath(body).solve(newton=tight())
    for r in (1.0, 1.5, 2.0):
        wanted = LOAD / 6 * ((1 - 2 * nu) * r + 4 / r)
        found = body.u(body.mesh(0, r))[1]
        print(nu, r, found / wanted - 1)
        assert found == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize("nu", [0.3, 0.4999, 0.5])
def test_lames_sphere(nu):
    bulk = inf if nu == 0.5 else 2 * (1 + nu) / (3 * (1 - 2 * nu))
    loads = [CavityPressure(CAVITY, LOAD)]
    mesh = quarter_of_a_ring(2, 4)
    body = Problem(mesh, rubber(bulk=bulk), LINES, loads, element="P4/P3", kinematics=Axisymmetric())
    LoadPath(body).solve(newton=tight())
    E = 2 * (1 + nu)
    for r in (1.0, 1.5, 2.0):
        wanted = LOAD / (7 * E) * ((1 - 2 * nu) * r + (1 + nu) * 8 / (2 * r**2))
        found = body.u(body.mesh(r, 0))[0]
        print(nu, r, found / wanted - 1)
        assert found == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize("name", ["sphere", "cylinder", "sphere of revolution"])
def test_a_following_pressure_is_the_pressure_of_a_cavity(name):
    # Its tangent without symmetry, theirs with it; the same state.
    mesh, supports, options = {
        "sphere": (lambda: eighth_of_a_shell(0, 2), PLANES, {}),
        "cylinder": (lambda: quarter_of_a_ring(1, 2), LINES, {}),
        "sphere of revolution": (lambda: quarter_of_a_ring(1, 2), LINES, {"kinematics": Axisymmetric()}),
    }[name]
    states = []
    for load in (PressureLoad(CAVITY, 0.4), CavityPressure(CAVITY, 0.4)):
        body = Problem(mesh(), rubber(bulk=1e3), supports, [load], element="P2/P1", **options)
        LoadPath(body).solve(newton=tight())
        print(name, type(load).__name__, body.solver)
        states.append(body.x[body.is_u])
    assert np.linalg.norm(states[0] - states[1]) < 1e-8 * np.linalg.norm(states[1])
    assert np.max(np.abs(states[1])) > 0.1
