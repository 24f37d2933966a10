"""Directions of conjugate gradients that are kept: what they do to a preconditioner."""

import numpy as np
import pytest

from ngbrain.solvers.krylov import truncated_cg
from ngbrain.solvers.quasi_newton_preconditioner import QuasiNewtonPreconditioner

N = 40


@pytest.fixture
def matrices(rng):
    """G of a few large eigenvalues, and a diagonal R."""
    half = rng.normal(size=(N, 5))
    return 100 * half @ half.T, np.diag(rng.uniform(1, 2, N))


def plain(r):
    return r


def learnt(G, R, b, most=N):
    found = QuasiNewtonPreconditioner()
    truncated_cg(lambda s: (G + R) @ s, plain, b, 1e-10, most, lambda s, image: found.add(s, image - R @ s))
    return found


def test_the_next_system_is_short(matrices, rng):
    G, R = matrices
    b, other = rng.normal(size=(2, N))
    found = learnt(G, R, b)
    changed = 3 * R  # such as a weight that has grown
    corrected = found.correct(plain, lambda s: changed @ s)
    _, alone, _ = truncated_cg(lambda s: (G + changed) @ s, plain, other, 1e-6, 200)
    x, helped, _ = truncated_cg(lambda s: (G + changed) @ s, corrected, other, 1e-6, 200)
    assert helped < alone / 2
    assert (G + changed) @ x == pytest.approx(other, abs=1e-3)


def test_symmetric_positive_definite_and_exact_for_the_last(matrices, rng):
    G, R = matrices
    found = learnt(G, R, rng.normal(size=N), 12)
    apply = found.correct(plain, lambda s: R @ s)
    P = np.column_stack([apply(e) for e in np.eye(N)])
    assert np.abs(P - P.T).max() < 1e-10 * np.abs(P).max()
    assert np.linalg.eigvalsh(0.5 * (P + P.T)).min() > 0
    s, image = found.arrays[-1]
    assert apply(image + R @ s) == pytest.approx(s, abs=1e-10)


def test_no_more_are_kept_than_asked_for_and_they_come_back(rng):
    found = QuasiNewtonPreconditioner(3)
    for s in rng.normal(size=(5, N)):
        found.add(s, 2 * s)
    assert found.arrays.shape == (3, 2, N)
    again = QuasiNewtonPreconditioner(3)
    again.arrays = found.arrays
    r = rng.normal(size=N)
    assert np.array_equal(again.correct(plain, plain)(r), found.correct(plain, plain)(r))


def test_a_direction_of_no_length_teaches_nothing():
    found = QuasiNewtonPreconditioner()
    found.add(np.zeros(N), np.zeros(N))
    assert len(found.arrays) == 0
    assert found.correct(plain, plain) is plain
