"""Forces on supports that share edges."""

import numpy as np
import pytest

from ngbrain.forward.common.loads import TractionLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.materials import NeoHooke
from ngbrain.mesh import block


def pressed():
    """A block that stands on its foot, rolls on its left side and is pressed by a plate that holds z alone."""
    mesh = block((0.02, 0.02, 0.02), 0.01)
    supports = {"bottom": 0, "left": (0.0, None, None), "top": (None, None, -1e-3)}
    body = Problem(mesh, {".*": Material(NeoHooke(1e3), 5e3)}, supports, element="P2")
    LoadPath(body).solve()
    return body


def test_together_forces_add_up():
    body = pressed()
    total = body.force("bottom|left|top")
    assert np.abs(total).max() < 1e-6 * np.abs(body.force("top")).max()


def test_a_boundary_has_no_force_where_it_is_free():
    body = pressed()
    load = np.abs(body.force("top")).max()
    assert abs(body.force("left")[2]) < 1e-12 * load and abs(body.force("top")[0]) < 1e-12 * load


def test_reactions_of_adjoining_supports_add_up_and_get_right():
    """Foot glued, left a roller: both hold x at their edge; with finer elements what the edge holds matters less."""
    body = pressed()
    parts = sum(body.force(name) for name in ("bottom", "left", "top"))
    assert np.abs(parts).max() < 1e-6 * np.abs(body.force("top")).max()


def test_a_load_is_felt_by_its_own_boundary_alone():
    mesh = block((0.02, 0.02, 0.02), 0.01)
    body = Problem(
        mesh, {".*": Material(NeoHooke(1e3), 5e3)}, {"bottom": 0}, [TractionLoad("top", (0, 0, 50.0))], element="P2"
    )
    LoadPath(body).solve()
    assert body.force("top")[2] == pytest.approx(50 * 0.02**2, rel=1e-6)
    assert np.abs(body.force("left")).max() == 0
    assert body.force("bottom")[2] == pytest.approx(-50 * 0.02**2, rel=1e-6)


def test_a_support_does_not_bear_what_a_load_puts_on_its_nodes():
    """A traction beside the foot: the foot bears all of it, and the loaded side what is put on it."""
    mesh = block((0.02, 0.02, 0.02), 0.01)
    pull = TractionLoad("right", (50.0, 0, 0))
    body = Problem(mesh, {".*": Material(NeoHooke(1e3), 5e3)}, {"bottom": 0}, [pull], element="P2")
    LoadPath(body).solve()
    assert body.force("bottom")[0] == pytest.approx(-50 * 0.02**2, rel=1e-6)
