"""Positions under loads, while the shape without them changes."""

import numpy as np
import pytest
from equilibria import SIDE, tight
from statics import square

from ngbrain.adjoint.check import dot, taylor
from ngbrain.errors import InputError
from ngbrain.forward.common.loads import BodyForce
from ngbrain.forward.common.material import Material
from ngbrain.forward.observables import Displacements, Force
from ngbrain.forward.sensitivity.reference_shape import Positions
from ngbrain.forward.sensitivity.static_model import LoadCase, NodePositions, StaticModel
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import NeoHooke

SEEN = np.array([[0.02, 0.05], [0.05, 0.0], [0.08, 0.07]])


def hung(*seen):
    mesh = square(2, size=SIDE)
    nodes = NodePositions(mesh)
    bodies = [
        Problem(mesh, {".*": Material(NeoHooke(1e3), 5e3)}, {"top": 0}, [BodyForce((0, w))], element="P2")
        for w in (-3e3, 2e3)
    ]
    return StaticModel(
        [LoadCase(body, seen or [Displacements(SEEN)]) for body in bodies], {"nodes": nodes}, tight(bodies[0])
    )


def test_points_without_their_displacement_move_with_the_nodes():
    model = Positions(hung(), "nodes", SEEN)
    aside = np.zeros(model.model.size)
    aside[: len(aside) // 2] = 3e-3  # all nodes, to the right
    unloaded = model.evaluate(aside).data - model.model.evaluate(aside).data
    assert unloaded.reshape(2, -1, 2) == pytest.approx(np.array([SEEN + np.array([3e-3, 0])] * 2), rel=1e-12)


def test_derivatives(rng):
    model = Positions(hung(), "nodes", SEEN)
    theta = 2e-3 * rng.uniform(-1, 1, model.model.size)
    direction = 2e-3 * rng.uniform(-1, 1, model.model.size)
    there = model.evaluate(theta)
    w = rng.normal(size=len(there.data))
    up = there.gradient(w)
    assert there.vjp(w) == pytest.approx(up, rel=1e-8, abs=1e-10 * np.abs(up).max())
    assert dot(there.jvp, up, direction, w) < 1e-9
    rates = taylor(lambda x: float(w @ model.evaluate(x).data), up, theta, direction)
    assert rates == pytest.approx(2, abs=0.1)


def test_bad_input():
    with pytest.raises(InputError, match=r"nodes is 'mu'; wanted: the name of a parameter NodePositions\(mesh\)"):
        Positions(hung(), "mu", SEEN)
    for seen in ([Displacements(SEEN), Force("top")], [Displacements(SEEN[:2])]):
        with pytest.raises(InputError, match="other observables; wanted: only Displacements of the 3 points"):
            Positions(hung(*seen), "nodes", SEEN)
    with pytest.raises(InputError, match="other observables; wanted: only Displacements of the 1 points"):
        Positions(hung(Force("top")), "nodes", SEEN[:1])  # as many numbers
