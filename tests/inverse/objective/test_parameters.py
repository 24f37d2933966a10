"""Transforms: inverses and derivatives, fields of few values, refusals."""

import numpy as np
import pytest
import scipy.sparse as sp

from ngbrain.errors import InputError
from ngbrain.inverse.objective.parameters import (
    BoundedTransform,
    LogTransform,
    ParameterFields,
    ScaledTransform,
    Unknown,
)

TRANSFORMS = [LogTransform(), LogTransform(-0.75), BoundedTransform(-1.0, 4.0), ScaledTransform(2e-3)]
THETA = np.array([0.3, 1.0, 2.5])


@pytest.mark.parametrize("transform", TRANSFORMS, ids=str)
def test_inverse_and_slope(transform):
    x = transform.inverse(THETA)
    assert transform.value(x) == pytest.approx(THETA, rel=1e-12)
    h = 1e-6 * np.maximum(1, np.abs(x))
    secant = (transform.value(x + h) - transform.value(x - h)) / (2 * h)
    assert transform.gradient(x) == pytest.approx(secant, rel=1e-7)


@pytest.mark.parametrize(
    ("transform", "theta"),
    [(LogTransform(), 0.0), (LogTransform(-1.0), -1.0), (BoundedTransform(0, 1), 1.0), (BoundedTransform(0, 1), -2.0)],
)
def test_what_cannot_be_is_refused(transform, theta):
    with pytest.raises(InputError, match="start"):
        transform.inverse(np.array([theta]))


@pytest.mark.parametrize("transform", TRANSFORMS[:3], ids=str)
def test_no_step_leaves_what_is_allowed(transform):
    low = {0: 0.0, 1: -0.75, 2: -1.0}[TRANSFORMS.index(transform)]
    assert np.all(transform.value(np.array([-30.0, 30.0])) > low)


def two_labels():
    labels = sp.csr_array(np.array([[1.0, 0], [1, 0], [0, 1]]))
    blocks = {"mu": slice(0, 3), "loss": slice(3, 6), "rest": slice(6, 7)}
    unknowns = {"mu": Unknown(np.array([1e3, 2e3]), LogTransform(), labels), "loss": Unknown(100.0)}
    return ParameterFields(np.arange(7.0), blocks, unknowns)


def test_labels_share_a_value():
    fields = two_labels()
    assert fields.theta(fields.start) == pytest.approx([1e3, 1e3, 2e3, 100, 100, 100, 6])
    assert {name: (b.start, b.stop) for name, b in fields.blocks.items()} == {"mu": (0, 2), "loss": (2, 5)}
    assert fields.values(fields.start)["mu"] == pytest.approx([1e3, 1e3, 2e3])


def test_jacobian(rng):
    fields = two_labels()
    x, dx = fields.start, rng.normal(size=5)
    secant = (fields.theta(x + 1e-6 * dx) - fields.theta(x - 1e-6 * dx)) / 2e-6
    assert fields.jacobian(x) @ dx == pytest.approx(secant, rel=1e-6, abs=1e-9)


def test_an_unknown_that_is_no_block_is_refused():
    with pytest.raises(InputError, match="zeta"):
        ParameterFields(np.zeros(1), {"mu": slice(0, 1)}, {"zeta": Unknown(1.0)})
