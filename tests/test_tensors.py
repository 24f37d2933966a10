"""Kinematics against numpy."""

import ngsolve as ngs
import numpy as np
import pytest
from netgen.occ import unit_cube

from ngbrain import tensors

MESH = ngs.Mesh(unit_cube.GenerateMesh(maxh=2.0))
POINT = MESH(0.3, 0.3, 0.2)


def cf(A):
    return ngs.CF(tuple(np.ravel(A)), dims=(3, 3))


def value(expression):
    return np.array(expression(POINT))


def test_principal_values_match_numpy(rng):
    for _ in range(50):
        A = rng.standard_normal((3, 3))
        C = A.T @ A + 0.1 * np.eye(3)
        ours = [value(v) for v in tensors.principal_values(cf(C))]
        assert np.allclose(ours, np.linalg.eigvalsh(C)[::-1], rtol=1e-9, atol=1e-9)


def test_principal_values_at_equal_stretches_are_shifted_by_no_more_than_the_guard():
    ours = [float(v(POINT)) for v in tensors.principal_values(ngs.Id(3))]
    assert np.allclose(ours, 1.0, atol=2.1e-6)


def test_isochoric_has_determinant_one_and_deviators_no_trace(rng):
    A = rng.standard_normal((3, 3))
    C = A.T @ A + np.eye(3)
    assert np.linalg.det(value(tensors.isochoric(cf(C))).reshape(3, 3)) == pytest.approx(1.0)
    assert np.trace(value(tensors.deviator(cf(A))).reshape(3, 3)) == pytest.approx(0.0, abs=1e-12)
    dev = value(tensors.lagrangian_deviator(cf(A), cf(C))).reshape(3, 3)
    assert np.sum(dev * C) == pytest.approx(0.0, abs=1e-10)


def test_octahedral_shear_of_pure_shear():
    # Engineering shear γ: ε = ±γ/2, and the measure is 2/3 √(3/2) γ... by its definition.
    gamma = 0.2
    exact = 2 / 3 * np.sqrt(gamma**2 + 2 * (gamma / 2) ** 2)
    assert tensors.octahedral_shear(np.array([[-gamma / 2, 0.0, gamma / 2]]))[0] == pytest.approx(exact)
