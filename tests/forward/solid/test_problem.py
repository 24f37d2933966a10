"""The body's residual and tangent are derivatives of its energy; forces balance; bad names are refused."""

import numpy as np
import pytest

from ngbrain.adjoint.check import taylor
from ngbrain.errors import InputError
from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import NeoHooke
from ngbrain.mesh import block


@pytest.fixture
def loaded(make_body, plate, rng):
    """A relaxing body with a history, a contact and a state that is neither small nor special."""
    drive = plate((0, 1), (0, 1e-3))
    body = make_body(contacts=[drive.contact(1e6)], pointwise=1e3)
    drive.set(1.0)
    body.history.stress[:] = 30 * rng.standard_normal(body.history.stress.shape)
    body.history.overstress[:] = 20 * rng.standard_normal(body.history.stress.shape)
    body.begin(0.7)
    free = body.weights > 0
    x = np.where(body.is_u, 2e-4, 50.0) * rng.standard_normal(body.fes.ndof) * free
    dx = np.where(body.is_u, 2e-4, 50.0) * rng.standard_normal(body.fes.ndof) * free
    return body, x, dx


def energy(body, x):
    body.x = x
    return body.form.Energy(body.gfu.vec)


def test_residual_is_the_gradient_of_the_energy(loaded):
    body, x, dx = loaded
    rates = taylor(lambda y: energy(body, y), body.residual(x)[0], x, dx)
    assert np.all(np.abs(rates - 2) < 0.1), rates


def test_tangent_is_the_derivative_of_the_residual(loaded):
    body, x, dx = loaded
    body.x = x
    body.form.AssembleLinearization(body.gfu.vec)
    direction, product = body.gfu.vec.CreateVector(), body.gfu.vec.CreateVector()
    direction.FV().NumPy()[:] = dx
    product.data = body.form.mat * direction  # symmetric storage: the lower triangle stands for both
    slope = product.FV().NumPy().copy() * (body.weights > 0)
    rates = taylor(lambda y: body.residual(y)[0], lambda _: slope, x, dx)
    assert np.all(np.abs(rates - 2) < 0.1), rates


def test_history_moves_the_residual(loaded):
    # A term that Newton's method does not see is inert: a longer step must change the forces.
    body, x, _ = loaded
    short = body.residual(x)[0]
    body.begin(70.0)
    assert np.linalg.norm(body.residual(x)[0] - short) > 1e-2 * np.linalg.norm(short)


def test_smallest_determinant_sees_an_inverted_quadrature_point(make_body):
    body = make_body()
    x = np.zeros(body.fes.ndof)
    assert body.min_det(x) == pytest.approx(1.0)
    import ngsolve as ngs

    body.u.Set(ngs.CF((0, 0, -1.2 * ngs.z)))
    assert body.min_det(body.x) == pytest.approx(-0.2, abs=1e-9)


@pytest.mark.parametrize(
    ("materials", "fixed", "message"),
    [
        ({"tisue": Material(NeoHooke(1.0), 10.0)}, "bottom", "tissue"),
        ({"tissue": Material(NeoHooke(1.0), 10.0)}, "botom", "bottom"),
        ({}, "bottom", "tissue"),
        ({"[[:tissue:]]": Material(NeoHooke(1.0), 10.0)}, "bottom", "tissue region .*regular expression"),
        ({"tissue": Material(NeoHooke(1.0), 10.0)}, "[[:bottom:]]", "boundary .*regular expression"),
    ],
)
def test_names_that_match_nothing_are_refused(materials, fixed, message):
    with pytest.raises(InputError, match=message):
        Problem(block(maxh=0.04), materials, {fixed: 0}, element="P2/P1")


def test_patterns_that_share_a_region_are_refused():
    # Both energies would count there.
    tissue = Material(NeoHooke(1.0), 10.0)
    with pytest.raises(InputError, match=r"tissue region is '\.\*'; wanted: a pattern without tissue"):
        Problem(block(maxh=0.04), {"tissue": tissue, ".*": tissue}, {"bottom": 0}, element="P2/P1")


def test_a_boundary_that_is_held_and_touched_is_refused(plate):
    contacts = [plate((0, 1), (0, 1e-3)).contact()]
    with pytest.raises(InputError, match=r"boundary is 'bottom\|t\.\*'; wanted: a pattern without top"):
        Problem(
            block(maxh=0.04),
            {"tissue": Material(NeoHooke(1.0), 10.0)},
            {"bottom|t.*": 0},
            contacts=contacts,
            element="P2/P1",
        )


def test_held_elements_do_not_move(make_body, plate):
    drive = plate((0, 1), (0, 1e-3))
    body = make_body(contacts=[drive.contact()], maxh=0.01)
    low = np.array([max(body.mesh[v].point[2] for v in e.vertices) < 0.011 for e in body.mesh.Elements()])
    assert low.any() and not low.all()
    drive.set(1.0)
    body.begin(1.0)
    x = np.where(body.weights > 0, np.where(body.is_u, 1e-5, 5.0) * np.sin(np.arange(body.fes.ndof)), 0.0)
    before = body.residual(x)[0]
    body.hold(low)
    body.x = 0 * x
    step = body.factorise(body.x)(body.residual(body.x)[0])
    held = np.zeros(body.fes.ndof, bool)
    for element in body.mesh.Elements():
        if low[element.nr]:
            held[list(body.fes.GetDofNrs(element))] = True
    assert body.residual(x)[0][~held] == pytest.approx(before[~held], rel=1e-12, abs=1e-15)
    assert np.all(step[held] == 0) and np.all(body.weights[held] == 0) and np.abs(step[~held]).max() > 0
