"""Values at quadrature points, on one thread and on several."""

import ngsolve as ngs
import numpy as np
import pytest
from ngsolve.comp import IntegrationRuleSpace
from ngsolve.meshes import MakeStructured3DMesh

from ngbrain.materials.points import Points
from ngbrain.mesh import block
from ngbrain.threads import threads


@pytest.fixture(scope="module")
def points():
    mesh = block(maxh=0.02)
    space = IntegrationRuleSpace(mesh, order=1)
    assert mesh.ne % 2 and mesh.ne % 3  # threads do not share the elements evenly
    return Points(space, mesh.MapToAllElements(dict(space.GetIntegrationRules()), ngs.VOL))


def crowded(hexes, order):
    """Elements with more points than NGSolve evaluates a function at together."""
    mesh = MakeStructured3DMesh(hexes=hexes, nx=2, ny=2, nz=1)
    space = IntegrationRuleSpace(mesh, order=order)
    return Points(space, mesh.MapToAllElements(dict(space.GetIntegrationRules()), ngs.VOL))


@pytest.mark.parametrize("hexes, order, each", [(True, 2, 27), (False, 3, 24), (True, 3, 64)])
@pytest.mark.parametrize("n", [1, 2])
def test_fields_of_many_points_in_an_element_are_read_where_they_are(hexes, order, each, n):
    points = crowded(hexes, order)
    assert len(points.mapped) == each * points.space.mesh.ne
    values = np.arange(3.0 * len(points.mapped)).reshape(3, -1)
    field, some = (
        points.field(values),
        points.share_element(np.arange(len(points.mapped)), np.arange(len(points.mapped)) < 5),
    )
    with threads(n):
        assert np.array_equal(points(field), values)
        assert np.array_equal(points(2 * field[1], some), 2 * values[1:2, some])


@pytest.mark.parametrize("n", [1, 2, 3])
def test_fields_are_read_where_they_are_on_any_number_of_threads(points, n):
    values = np.arange(2.0 * len(points.mapped)).reshape(2, -1)
    field = points.field(values)
    some = points.share_element(np.arange(len(points.mapped)), np.arange(len(points.mapped)) % 28 == 0)
    with threads(n):
        assert np.array_equal(points(field), values)
        assert np.array_equal(points(2 * field, some), 2 * values[:, some])
        assert points(field, np.zeros_like(some)).shape == (2, 0)


def test_naive_a_thread_that_begins_inside_an_element_reads_others_values(points):
    values = np.arange(len(points.mapped), dtype=float)[None]
    with threads(2):
        assert not np.array_equal(np.ravel(points.field(values)(points.mapped)), values[0])
