"""Conversions against numbers that do not come from ngbrain."""

import ngsolve
import numpy as np
import pytest
from scipy import constants

from ngbrain import units


@pytest.mark.parametrize(
    ("to_si", "value", "si"),
    [
        (units.mm, 12.0, 0.012),
        (units.kPa, 1.2, 1200.0),
        (units.mmHg, 760.0, constants.atm),
        (units.ml, 250.0, 250 * constants.centi**3),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_into_si_and_back(to_si, value, si):
    back = getattr(units, f"to_{to_si.__name__}")
    assert to_si(value) == pytest.approx(si, rel=3e-6)  # a mmHg is 133.322387... Pa, here rounded to 133.322
    assert back(to_si(value)) == pytest.approx(value, rel=1e-12)
    assert back(si) == pytest.approx(value, rel=4e-6)


def test_minutes():
    assert units.to_minutes(constants.hour) == 60


@pytest.mark.parametrize("convert", [units.mm, units.to_kPa, units.mmHg, units.to_mmHg, units.ml, units.to_minutes])
def test_arrays_and_coefficient_functions_pass_through(convert, rng):
    values = rng.standard_normal((3, 2))
    assert convert(values) == pytest.approx(np.vectorize(convert)(values), rel=1e-12)

    mesh = ngsolve.Mesh(ngsolve.unit_square.GenerateMesh(maxh=2))
    assert convert(3 * ngsolve.x)(mesh(0.5, 0.25)) == pytest.approx(convert(1.5), rel=1e-12)
