"""Laws of J: rest, bulk modulus, collapse; mixed forms against what they are of; the displacement form."""

import numpy as np
import pytest
from states import energy, stress, tangent

from ngbrain.errors import InputError
from ngbrain.materials import (
    Compressible,
    Deformation,
    NeoHooke,
    logarithmic,
    perturbed_lagrangian,
    perturbed_logarithm,
    quadratic,
    squared_log,
)
from ngbrain.materials.points import Points

BULK = 7.0
LAWS = {
    quadratic: lambda J: BULK / 2 * (J - 1) ** 2,
    logarithmic: lambda J: BULK / 4 * (J**2 - 1 - 2 * np.log(J)),
    squared_log: lambda J: BULK / 2 * np.log(J) ** 2,
}


def at(function, *values):
    """Values and first and second derivative by the first argument."""
    points = Points.line(np.size(values[0]))
    fields = [points.field(np.atleast_2d(value))[0].MakeVariable() for value in values]
    energy = function(*fields, BULK)
    return [points(f)[0] for f in (energy, energy.Diff(fields[0]), energy.Diff(fields[0]).Diff(fields[0]))]


@pytest.mark.parametrize("law", LAWS)
def test_formula_rest_and_bulk_modulus(law):
    J = np.array([0.5, 0.9, 1.0, 1.2, 2.0])
    assert at(law, J)[0] == pytest.approx(LAWS[law](J), rel=1e-12, abs=1e-12 * BULK)
    value, slope, curvature = (x[0] for x in at(law, np.array([1.0])))
    assert max(abs(value), abs(slope)) < 1e-12 * BULK and curvature == pytest.approx(BULK, rel=1e-12)


def test_only_logarithms_keep_a_body_from_collapsing():
    J = np.array([1e-3, 1e-6, 1e-12])
    assert at(quadratic, J)[0] == pytest.approx([BULK / 2] * 3, rel=3e-3)
    for law in (logarithmic, squared_log):
        assert np.all(np.diff(at(law, J)[0]) > BULK)


def test_squared_logarithm_softens_beyond_e():
    below, beyond = at(squared_log, np.array([0.99 * np.e, 1.01 * np.e]))[2]
    assert below > 0 > beyond


@pytest.mark.parametrize(
    ("mixed", "pressure", "law"),
    [
        (perturbed_lagrangian, lambda J: BULK * (J - 1), quadratic),
        (perturbed_logarithm, lambda J: BULK * np.log(J), squared_log),
    ],
)
def test_a_mixed_form_is_its_law_at_its_pressure(mixed, pressure, law):
    J = np.array([0.8, 1.0, 1.3])
    assert at(mixed, J, pressure(J))[0] == pytest.approx(at(law, J)[0], rel=1e-12, abs=1e-12 * BULK)
    by_p = at(lambda p, J, bulk: mixed(J, p, bulk), pressure(J), J)
    assert by_p[1] == pytest.approx(0, abs=1e-12) and by_p[2] == pytest.approx(-1 / BULK)


@pytest.mark.parametrize("law", LAWS)
def test_displacement_form(law, rng):
    F = np.eye(3) + 0.2 * rng.uniform(-1, 1, (20, 3, 3))
    J, tissue = np.linalg.det(F), NeoHooke(1.3) + Compressible(BULK, law)
    shape = 1.3 / 2 * (J ** (-2 / 3) * np.einsum("nij,nij->n", F, F) - 3)
    assert energy(tissue, F) == pytest.approx(shape + LAWS[law](J), rel=1e-12)
    pressed = np.cbrt(1.1) * np.eye(3)
    mean = np.trace(stress(tissue, pressed)[0] @ pressed.T) / 3 / 1.1
    assert mean == pytest.approx(at(law, np.array([1.1]))[1][0], rel=1e-12)
    K = tangent(tissue, np.eye(3))[0].reshape(3, 3, 3, 3)
    assert K[0, 0, 0, 0] == pytest.approx(BULK + 4 / 3 * 1.3) and K[0, 0, 1, 1] == pytest.approx(BULK - 2 / 3 * 1.3)
    assert K[0, 1, 0, 1] == pytest.approx(1.3)


def test_of_c_alone_it_is_the_same(rng):
    F = np.eye(3) + 0.2 * rng.uniform(-1, 1, (5, 3, 3))
    points = Points.line(5)
    C = points.field((F.transpose(0, 2, 1) @ F).reshape(5, 9).T.copy()).Reshape((3, 3))
    assert points(Compressible(BULK).energy(C))[0] == pytest.approx(energy(Compressible(BULK), F), rel=1e-12)
    held = points(Compressible(BULK).density(Deformation.from_stretch(C)))[0]
    assert held == pytest.approx(0, abs=1e-12)  # a state known to keep its volume


def test_refuses():
    with pytest.raises(InputError, match=r"Compressible\.bulk is -1\.0"):
        Compressible(-1.0)
