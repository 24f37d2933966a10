"""Randomised eigenvalues: accurate above the threshold, none missing, few products."""

import numpy as np
import pytest

from ngbrain.inverse.uncertainty.randomised_eigenvalues import OVERSAMPLING, eigenpairs

SIZE = 300


def matrix(values, rng):
    basis = np.linalg.qr(rng.normal(size=(SIZE, SIZE)))[0]
    return basis @ np.diag(values) @ basis.T


FALLING = {"fast": 1e4 * 0.8 ** np.arange(SIZE), "slowly": 1e4 / np.arange(1, SIZE + 1) ** 2.5}


@pytest.mark.parametrize("fall", FALLING)
def test_all_above_the_least(fall, rng):
    values, products = FALLING[fall], []
    A = matrix(values, rng)

    def apply(v):
        products.append(1)
        return A @ v

    found, vectors = eigenpairs(apply, SIZE, 0.1, np.random.default_rng(0))
    wanted = values[values > 0.1]
    assert abs(len(found) - len(wanted)) <= 0.05 * len(wanted)
    informed = int(np.sum(wanted > 1))
    assert found[:informed] == pytest.approx(wanted[:informed], rel=0.01)
    assert found == pytest.approx(wanted[: len(found)], rel=0.15)
    assert np.abs(vectors.T @ vectors - np.eye(len(found))).max() < 1e-12
    assert len(products) <= 2 * (len(wanted) + 32 + OVERSAMPLING)


@pytest.mark.parametrize("fall", FALLING)
def test_an_inverse_is_never_too_small(fall, rng):
    A = matrix(FALLING[fall], rng)
    found, vectors = eigenpairs(lambda v: A @ v, SIZE, 0.1, np.random.default_rng(0))
    inverse = np.eye(SIZE) - vectors @ np.diag(found / (1 + found)) @ vectors.T
    root = np.linalg.cholesky(np.eye(SIZE) + A)
    factors = np.linalg.eigvalsh(root.T @ inverse @ root)
    assert factors[0] > 1 - 1e-10 and factors[-1] < 1.13


def test_all_of_them(rng):
    values = np.logspace(3, -6, SIZE)
    A = matrix(values, rng)
    found, vectors = eigenpairs(lambda v: A @ v, SIZE, 0.0, np.random.default_rng(0))
    assert found[:250] == pytest.approx(values[:250], rel=1e-6)
    assert np.abs(vectors @ np.diag(found) @ vectors.T - A).max() < 1e-10


def test_fewer_than_vectors(rng):
    values = np.zeros(SIZE)
    values[:3] = [5.0, 5.0, 2.0]
    A = matrix(values, rng)
    found, _ = eigenpairs(lambda v: A @ v, SIZE, 0.1, np.random.default_rng(0))
    assert found == pytest.approx([5.0, 5.0, 2.0], rel=1e-10)


def test_nothing_to_find():
    found, vectors = eigenpairs(lambda v: v, 0, 0.1, np.random.default_rng(0))
    assert found.shape == (0,) and vectors.shape == (0, 0)
