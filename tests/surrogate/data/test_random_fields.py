"""Families of stiffness maps: positive, of the stated contrast, the same from the same seed."""

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.surrogate.data.random_fields import BUMP, CONTRAST, FAMILIES, SHARP, SMOOTH, family

Y, X = np.meshgrid(np.linspace(0, 1, 61), np.linspace(0, 1, 61), indexing="ij")


def drawn(name: str, seed: int) -> np.ndarray:
    return family(name)(np.random.default_rng(seed), X, Y)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name == "slices")) for name in FAMILIES]
)
def test_maps_are_positive_and_each_seed_has_its_own(name):
    if name == "slices":
        pytest.importorskip("nibabel")
        pytest.importorskip("nilearn")
    first, same, other = drawn(name, 0), drawn(name, 0), drawn(name, 1)
    assert first.shape == X.shape and first.min() > 0.1
    assert np.array_equal(first, same) and not np.array_equal(first, other)


@pytest.mark.parametrize("name", SMOOTH)
def test_smooth_families_have_no_edges(name):
    """No difference of neighbours exceeds the steepest gradient of the family at 1/60 of the edge."""
    steps = [max(np.abs(np.diff(drawn(name, seed), axis=axis)).max() for axis in (0, 1)) for seed in range(20)]
    assert max(steps) < 0.35 * BUMP[1]


@pytest.mark.parametrize("name", SHARP)
def test_sharp_families_have_plateaus_within_the_contrast(name):
    for seed in range(20):
        values = np.unique(drawn(name, seed))
        assert len(values) <= 4
        assert values.min() >= min(CONTRAST[0], 1) and values.max() <= CONTRAST[1]
        assert 1.0 in values


def test_spots_of_the_published_width():
    """`gaussian_place` shifts the inclusion of the published cases, exp(-r²/400 mm²) on 120 mm."""
    for seed in range(5):
        excess = drawn("gaussian_place", seed) - 1
        row, column = np.unravel_index(np.abs(excess).argmax(), X.shape)
        far = np.hypot(X - X[row, column], Y - Y[row, column])
        expected = excess[row, column] * np.exp(-((0.12 * far) ** 2) / 4e-4)
        assert np.abs(excess - expected).max() < 0.15 * np.abs(excess).max()  # its top lies between points


def test_unknown_families_are_refused():
    with pytest.raises(InputError, match="sinusoidal"):
        family("sinusoid")
