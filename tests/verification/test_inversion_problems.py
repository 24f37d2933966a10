"""Inverse problems end to end, small: a shape without weight, an Ogden tissue's two fields, fibres and their stiffness."""

import numpy as np
import pytest
from problems import of


def test_the_found_shape_hangs_as_it_was_seen():
    hanging = of.Hanging(4, 8, seed=1)
    shape, found = hanging.found()
    missed = of.rms(hanging.loaded(shape) - hanging.seen) / (np.sqrt(2) * hanging.sigma)
    print(missed, hanging.error(shape), found.level.ratio)
    assert missed < 1.3  # of the noise
    assert hanging.error(shape) < 0.05


@pytest.fixture(scope="module")
def cube():
    return of.cube_data(3)


def test_a_small_load_says_nothing_of_alpha(cube):
    found = of.ogden(cube, ["small"], 2, rounds=6)
    print(of.line(found))
    assert found["error_mu"] < 0.2
    assert found["left_alpha"] > 0.99 and found["influence_alpha"] < 0.02
    assert found["error_alpha"] == pytest.approx(0.657, abs=0.01)  # as it was at the start


def test_large_loads_say_both(cube):
    found = of.ogden(cube, ["press", "pull"], 2, rounds=6)
    print(of.line(found))
    assert found["left_alpha"] < 0.05
    assert found["error_mu"] < 0.25 and found["error_alpha"] < 0.3


def test_fibres_from_two_loads_and_a_start_where_they_bear_nothing():
    data = of.square_data(8)
    stuck, found = of.fibres(data, ["pull"], 4, 0), of.fibres(data, ["pull", "right"], 4, 60, rounds=12)
    print(of.line(stuck | {"chosen": False}), of.line(found | {"chosen": True}), sep="\n")
    assert stuck["error"] > 0.7 and stuck["misfit_over_expected"] > 50
    assert found["error"] < 0.1 and found["error_k1"] < 0.05
