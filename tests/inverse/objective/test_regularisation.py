"""Regularisers: energies of fields whose integrals are known, slopes, matrices, independence of size and mesh."""

import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.adjoint.check import taylor
from ngbrain.errors import InputError
from ngbrain.inverse.objective.regularisation import MASS_SHARE, matern, smooth, total_variation
from ngbrain.mesh.geometry.structured import rectangles


def space_of(cells, side, order=1):
    return ngs.H1(rectangles(*2 * [np.linspace(0, side, cells + 1)]), order=order)


def of(space, f):
    field = ngs.GridFunction(space)
    field.Set(f)
    return field.vec.FV().NumPy().copy()


@pytest.mark.parametrize("side", [0.1, 2.0])
@pytest.mark.parametrize("order", [1, 2])
def test_smooth_energy_of_a_ramp_has_no_unit(side, order):
    space = space_of(4, side, order)
    assert smooth(space, 0.0).value(of(space, ngs.x / side)) == pytest.approx(0.5 * (1 + MASS_SHARE / 3), rel=1e-10)


def test_total_variation_of_a_ramp():
    side, edge = 0.1, 0.02
    space = space_of(4, side)
    steep, floor = 1 / side, 1 / edge
    wanted = side**2 * floor * (np.sqrt(steep**2 + floor**2) - floor) + 0.5 * MASS_SHARE / 3
    assert total_variation(space, 0.0, edge).value(of(space, ngs.x / side)) == pytest.approx(wanted, rel=1e-10)


def test_a_step_costs_total_variation_less_than_a_slope_and_smoothness_more():
    space = space_of(40, 1.0)
    ramp, step = of(space, 20 * ngs.x), of(space, ngs.IfPos(ngs.x - 0.5, 20.0, 0.0))
    assert total_variation(space, 0.0, 1.0).value(step) < 1.1 * total_variation(space, 0.0, 1.0).value(ramp)
    assert smooth(space, 0.0).value(step) > 10 * smooth(space, 0.0).value(ramp)


KINDS = [smooth, lambda s, x: matern(s, x, 0.1), lambda s, x: total_variation(s, x, 0.1)]


@pytest.mark.parametrize("kind", KINDS)
def test_slope_on_quadrilaterals(kind, rng):
    space = space_of(5, 0.3)
    made = kind(space, rng.normal(size=space.ndof))
    x, dx = rng.normal(size=space.ndof), rng.normal(size=space.ndof)
    assert np.all(np.abs(taylor(made.value, made.gradient(x), x, dx) - 2) < 0.1)


@pytest.mark.parametrize("kind", KINDS)
def test_matrix_is_positive_and_nothing_is_free(kind, rng):
    space = space_of(5, 0.3)
    matrix = kind(space, 0.0).matrix(rng.normal(size=space.ndof)).toarray()
    assert np.allclose(matrix, matrix.T, atol=1e-12 * np.abs(matrix).max()) and np.linalg.eigvalsh(matrix)[0] > 0


@pytest.mark.parametrize("kind", [matern, total_variation])
def test_no_length_is_refused(kind):
    with pytest.raises(InputError, match="length"):
        kind(space_of(2, 1.0), 0.0, 0.0)
