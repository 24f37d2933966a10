"""Bodies whose energy is quadratic in the state: their tangent is that of Newton's method, and derivatives cost no other."""

import numpy as np
import pytest
from equilibria import SIDE, field, seen, tight, verify, weights
from statics import cube, square

from ngbrain.forward.common.loads import BodyForce, PressureLoad, RigidFace, TractionLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.sensitivity.static_model import LoadCase, StaticModel
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import LinearElastic

MESHES = {"plane": lambda: square(2, size=SIDE), "space": lambda: cube(2, size=SIDE)}


def linear(where, loads=(), bulk=0.0):
    """A body of fields mu and lam, pressed and sheared."""
    mesh = MESHES[where]()
    fields = {"mu": field(mesh, 1e3), "lam": field(mesh, 4e3)}
    down = {"bottom": 0, "top": (0.006, *[0.002] * (mesh.dim - 2), -0.012)}
    body = Problem(mesh, {".*": Material(LinearElastic(fields["mu"], fields["lam"]), bulk)}, down, loads, element="P2")
    return StaticModel([LoadCase(body, seen(mesh.dim))], fields, tight(body))


def assemblies(of, monkeypatch):
    """How often the tangent is assembled from now on, in a list of one."""
    form, count = of.equilibria[0].body.form, [0]
    real = form.AssembleLinearization

    class Counting:
        def __getattr__(self, name):
            return getattr(form, name)

        def AssembleLinearization(self, vec):  # noqa: N802
            count[0] += 1
            return real(vec)

    monkeypatch.setattr(of.equilibria[0].body, "_form", Counting())
    return count


@pytest.mark.parametrize("where", MESHES)
def test_derivatives_are_right_and_take_no_tangent(where, rng, monkeypatch):
    dim = 2 if where == "plane" else 3
    of = linear(where, [BodyForce((0, -9810.0, 0)[:dim]), TractionLoad("right", (20.0, 0, 0)[:dim])])
    assert of.equilibria[0].quadratic
    there = of.evaluate(of.theta)
    made, count = of.solves.factorisations, assemblies(of, monkeypatch)
    w = weights(there, rng)
    there.gradient(w), there.jvp(of.theta), there.vjp(w)
    assert of.solves.factorisations == made and count == [0]
    verify(of, rng)


def test_other_parameters_have_a_tangent_of_their_own(rng):
    """Along a path Newton's method begins with the factor of before; and a state of before has one that has gone."""
    of = linear("space")
    theta = of.theta
    first = of.evaluate(theta)
    w = weights(first, rng)
    moved = theta * rng.uniform(0.7, 1.4, len(theta))
    second = of.evaluate(moved)
    for there, at in ((second, moved), (first, theta)):
        wanted = linear("space").evaluate(at).gradient(w)
        assert there.gradient(w) == pytest.approx(wanted, rel=1e-9, abs=1e-9 * np.abs(wanted).max())


def test_what_bends_is_not_taken_for_quadratic():
    """A change of volume by J, a pressure that follows, a face that pushes on one side."""
    assert not linear("plane", bulk=1e3).equilibria[0].quadratic
    assert not linear("space", [PressureLoad("right", 50.0)]).equilibria[0].quadratic
    assert not linear("space", [RigidFace("right", (0, -0.002, 0), 1e6)]).equilibria[0].quadratic
