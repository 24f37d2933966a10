"""Consensus regulariser: gradient by differences, and fields fitted to values at points."""

import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.forward.common.interpolation import evaluation
from ngbrain.inverse.objective.regularisation import smooth
from ngbrain.inverse.problem.field_values import fit_field
from ngbrain.inverse.subzones.consensus import ConsensusRegulariser
from ngbrain.mesh.geometry.structured import boxes


@pytest.fixture
def field(rng):
    """A space, points in it, and the matrix to values there."""
    line = np.linspace(0, 0.02, 3)
    space = ngs.H1(boxes(np.ones((2, 2, 2), bool), line, line, line), order=2)
    points = 0.02 * rng.random((300, 3))
    return space, points, evaluation(space, points)


def test_slope_and_matrix_are_those_of_the_energy(field, rng):
    space, _, at = field
    drawn = ConsensusRegulariser(smooth(space, 0.5), at, rng.random(300), 10 * rng.random(300))
    x, way = rng.random((2, space.ndof))
    step = 1e-4
    slope = (drawn.value(x + step * way) - drawn.value(x - step * way)) / (2 * step)
    assert drawn.gradient(x) @ way == pytest.approx(slope, rel=1e-6)
    np.testing.assert_allclose(drawn.gradient(x + way) - drawn.gradient(x), drawn.matrix(x) @ way, rtol=1e-9)


def test_it_pulls_towards_the_values(field):
    space, points, at = field
    values = points @ [10.0, 20.0, -30.0]
    drawn = ConsensusRegulariser(smooth(space, 0.0), at, values, np.full(300, 1e6))
    x = np.linalg.solve(drawn.matrix(np.zeros(space.ndof)).toarray(), -drawn.gradient(np.zeros(space.ndof)))
    np.testing.assert_allclose(at @ x, values, atol=1e-4)


def test_a_field_goes_through_values_and_stays_smooth_where_there_are_none(field):
    space, points, at = field
    values, left = points @ [10.0, 20.0, -30.0], points[:, 0] < 0.01
    x = fit_field(at[left], values[left], smooth(space, 0.0), np.zeros(space.ndof))
    np.testing.assert_allclose((at @ x)[left], values[left], atol=0.01)
    low, high = values[left].min(), values[left].max()
    assert (at @ x).min() > low - 0.1 and (at @ x).max() < high + 0.1
