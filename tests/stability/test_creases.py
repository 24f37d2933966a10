"""Compression beyond 35 %. Naive: Newton's method converges, in few steps, to states that no real body stays in.

Ours: the share of a body that is compressed so far is in the record, with the sign of the tangent's smallest eigenvalue and a
warning. A half-space of a Neo-Hookean solid pressed in plane strain has neighbours at a stretch of .5437 (Biot 1963).
"""

import warnings

import netgen.occ as occ
import ngsolve as ngs
import numpy as np
import pytest
from ngsolve.meshes import MakeStructured2DMesh
from statics import square

from ngbrain.errors import StabilityWarning
from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.materials import NeoHooke, UnsplitNeoHooke

BIOT = 1 - 0.5437


def half_space(depth, **options):
    """A square between smooth plates and a plane of symmetry, its elements smaller towards the free side."""
    mesh = MakeStructured2DMesh(quads=True, nx=6, ny=6, mapping=lambda x, y: (1 - (1 - x) ** 2, y))
    supports = {"bottom": (None, 0), "top": (None, -depth), "left": (0, None)}
    return Problem(mesh, {".*": Material(NeoHooke(1.0), 1e4)}, supports, element="P4/P3", **options)


@pytest.mark.parametrize(("depth", "sign"), [(0.4, "positive: stable"), (0.5, "negative: not stable")])
def test_a_flat_state_beyond_biot_is_reached_and_called_unstable(depth, sign):
    body = half_space(depth)
    with pytest.warns(StabilityWarning, match=rf"100% of its free surface are compressed by more than 35%.* {sign}"):
        record = LoadPath(body).solve()
    print(depth, "iterations", record.tried, "smallest eigenvalue", record.smallest_eigenvalue)
    assert record.converged and record.pressed == record.creased == pytest.approx(1)
    assert (record.smallest_eigenvalue > 0) == (depth < BIOT)


def test_the_eigenvalue_changes_its_sign_where_biot_says():
    values = []
    for depth in (0.985 * BIOT, 1.015 * BIOT):
        with pytest.warns(StabilityWarning):
            values.append(LoadPath(half_space(depth)).solve().smallest_eigenvalue)
    print("smallest eigenvalue on both sides of Biot's compression", values)
    assert values[0] > 0 > values[1]


def test_up_to_a_third_nothing_is_asked():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        record = LoadPath(half_space(0.33)).solve()
    assert record.pressed == 0 and np.isnan(record.smallest_eigenvalue)


def test_clamped_plates_press_the_middle_but_not_along_the_free_side():
    shares = {}
    for depth in (0.2, 0.35):
        plates = {"bottom": 0, "top": (0, -depth)}
        body = Problem(square(8), {".*": Material(UnsplitNeoHooke(1.0), 1e3)}, plates, element="P2/P1")
        record = LoadPath(body).solve()
        shares[depth] = record.pressed
        assert record.creased < 0.05 and np.isnan(record.smallest_eigenvalue) == (depth == 0.2)
    print(shares)
    assert 0 < shares[0.2] < 0.05 and shares[0.35] == pytest.approx(0.53, abs=0.01) and record.smallest_eigenvalue > 0


def test_walls_between_tissues_are_no_free_surface():
    halves = occ.WorkPlane().Rectangle(1, 1).Face()
    halves = occ.Glue([halves.Move((0, 0, 0)), halves.Move((1, 0, 0))])
    halves.edges.name = "held"
    for edge in halves.edges:
        if abs(edge.center.x - 1) < 1e-6:
            edge.name = "between"
    mesh = ngs.Mesh(occ.OCCGeometry(halves, dim=2).GenerateMesh(maxh=0.5))
    body = Problem(mesh, {".*": Material(NeoHooke(1.0), 1e3)}, {"held": (0, -0.45 * ngs.y)}, element="P2/P1")
    record = LoadPath(body).solve()
    print(record.pressed, record.creased)
    assert record.creased == 0


def test_iterations_cannot_say():
    mesh = square(4)
    supports = {"bottom": (None, 0), "top": (None, -0.38), "left": (0, None)}
    body = Problem(mesh, {".*": Material(NeoHooke(1.0), 3.0)}, supports, element="P2", solver="cg-amg")
    with pytest.warns(StabilityWarning, match="stability was not checked, as cg-amg"):
        record = LoadPath(body).solve()
    assert record.creased > 0.9 and np.isnan(record.smallest_eigenvalue)
