"""A body that nothing holds is told by the motions that are left to it; kinds of failure are no words."""

import netgen.occ as occ
import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.errors import Breakdown, ConvergenceError, InputError, InvertedElementError, SolverError, solver_error
from ngbrain.forward.common.loads import Spring, TractionLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.forward.transient.time_stepper import run_load_history
from ngbrain.materials import NeoHooke
from ngbrain.mesh import block
from ngbrain.mesh.geometry.structured import rectangles
from ngbrain.result import Status
from ngbrain.solvers.newton import Newton

TISSUE = {".*": Material(NeoHooke(1e3), 5e3)}


def cube():
    return block((0.1, 0.1, 0.1), 0.1)


def refused(body):
    with pytest.raises(InputError) as caught:
        LoadPath(body).solve()
    assert "\n" not in str(caught.value)
    return str(caught.value)


ALONG = {"x": (0.0, None, None), "y": (None, 0.0, None), "z": (None, None, 0.0)}


@pytest.mark.parametrize(
    ("supports", "motions"),
    [
        ({"bottom": ALONG["z"], "top": ALONG["z"]}, ["translation along x", "translation along y", "rotation about z"]),
        ({"bottom": ALONG["z"], "left": ALONG["x"]}, ["translation along y"]),
        (
            {"bottom": ALONG["x"]},
            ["translation along y", "translation along z", "rotation about x", "rotation about y"],
        ),
        ({"bottom": (0.0, 0.0, None)}, ["translation along z", "rotation about x", "rotation about y"]),
    ],
)
def test_motions_that_nothing_prevents_are_named(supports, motions):
    said = refused(Problem(cube(), TISSUE, supports, element="P1"))
    assert said.split("insufficient against ")[1].split(";")[0].split(", ") == motions


def test_a_body_without_supports_has_all_six():
    said = refused(Problem(cube(), TISSUE, {}, [TractionLoad("top", (0, 0, 1.0))], element="P1"))
    assert all(f"translation along {axis}" in said and f"rotation about {axis}" in said for axis in "xyz")


def test_what_is_held_enough_is_solved():
    supports = {"bottom": ALONG["z"], "left": ALONG["x"], "front": ALONG["y"], "top": (None, None, -1e-3)}
    assert LoadPath(Problem(cube(), TISSUE, supports, element="P1")).solve().converged
    # A spring may hold.
    LoadPath(Problem(cube(), TISSUE, {"bottom": ALONG["z"]}, [Spring("bottom", 1e5)], element="P1")).solve()


def test_in_the_plane_and_through_time():
    mesh = rectangles(np.linspace(0, 0.1, 3), np.linspace(0, 0.1, 3))
    name = sorted(set(mesh.GetBoundaries()))[0]
    assert "rotation" in refused(Problem(mesh, TISSUE, {}, element="P1")) and "along y" in refused(
        Problem(mesh, TISSUE, {}, element="P1")
    )
    assert LoadPath(Problem(mesh, TISSUE, {name: 0}, element="P1")).solve().converged
    with pytest.raises(InputError, match="translation along x"):
        run_load_history(Problem(cube(), TISSUE, {"bottom": ALONG["z"]}, element="P1"), [0, 1], [0, 1], lambda t: t)


def test_a_region_that_hangs_loose_is_named():
    near, far = occ.Box((0, 0, 0), (0.1, 0.1, 0.1)), occ.Box((0.2, 0, 0), (0.3, 0.1, 0.1))
    near.mat("brain"), far.mat("tumour")
    near.faces.Min(occ.Z).name = "foot"
    mesh = ngs.Mesh(occ.OCCGeometry(occ.Compound([near, far])).GenerateMesh(maxh=0.1))
    said = refused(Problem(mesh, TISSUE, {"foot": 0}, element="P1"))
    assert "region tumour is not supported" in said and "rotation about z" in said


def test_an_oblique_axis_is_given_by_its_direction():
    """A ring of points along (1, 1, 0) that is all that is held."""
    wedge = occ.Prism(occ.WorkPlane().MoveTo(0, 0).LineTo(0.1, 0).LineTo(0, 0.1).Close().Face(), occ.Vec(0, 0, 0.1))
    mesh = ngs.Mesh(occ.OCCGeometry(wedge).GenerateMesh(maxh=0.05))
    names = [f"side{i}" for i in range(len(mesh.GetBoundaries()))]
    for i, name in enumerate(names):
        mesh.ngmesh.SetBCName(i, name)
    slope = next(
        name for name in names
        if abs(ngs.Integrate(ngs.specialcf.normal(3)[0] * ngs.ds(name), mesh)) > 1e-6
        and abs(ngs.Integrate(ngs.specialcf.normal(3)[1] * ngs.ds(name), mesh)) > 1e-6
    )  # fmt: skip
    normal = (None, None, 0.0)
    said = refused(Problem(mesh, TISSUE, {slope: normal}, element="P1"))
    assert "rotation about z" in said and "rotation about (" in said  # the side's own direction in the plane


def test_kinds_of_failure():
    error = solver_error("the last trial is upside down", Status.INVERTED)
    assert isinstance(error, InvertedElementError) and isinstance(
        solver_error("inverted", Status.STALLED), ConvergenceError
    )
    assert issubclass(Breakdown, SolverError) and issubclass(Breakdown, FloatingPointError)

    class Folded:
        weights = np.ones(1)

        def residual(self, x):
            return x, 1.0

        def factorise(self, x, r):
            raise Breakdown("no factor, nor inverted", Status.SINGULAR)

        def min_det(self, x):
            return float(x[0])

    assert Newton().solve(Folded(), -np.ones(1))[1].status is Status.INVERTED
    assert Newton().solve(Folded(), np.ones(1))[1].status is Status.SINGULAR


def test_settings_that_are_given_stay_as_they_are():
    kept = object()
    newton = Newton(inverse=kept, largest=7.0)
    body = Problem(cube(), TISSUE, {"bottom": 0, "top": (0, 0, -1e-3)}, element="P1")
    run_load_history(body, [0.0, 1.0], [0.0, 1.0], lambda t: t, newton)
    body = Problem(cube(), TISSUE, {"bottom": 0, "top": (0, 0, -1e-3)}, element="P1")
    LoadPath(body).solve(newton=newton)
    assert newton.inverse is kept and newton.largest == 7.0
