"""Implausible moduli, and waves shorter than their sampling resolves."""

import re

import numpy as np
import pytest
from planewaves import grid, shear_waves, waves

from ngbrain.errors import InputError
from ngbrain.inverse.data.plausibility import wavelength_notes
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.problem.properties import select_properties
from ngbrain.inverse.subzones.invert import invert_by_subzones


def shaken(shear, frequency, said=None, shape=(16, 16), spacing=2e-3):
    points = grid(*shape, spacing=spacing)
    return waves(points, shear_waves(points, shear, frequency), (said or frequency,))


@pytest.mark.parametrize("shape", [(16, 16), (9, 9, 9)])
@pytest.mark.parametrize(("said", "size", "unit"), [(60e3, 3.0, "GPa"), (0.06, 3e-3, "Pa")])
def test_a_frequency_in_other_units_is_refused(shape, said, size, unit):
    """60 Hz in thousandths or as thousands: 3 kPa, waves of 28.9 mm, become 3 GPa or 3 mPa."""
    with pytest.raises(InputError) as error:
        select_properties(shaken(3e3, 60.0, said, shape), "moduli")
    found = re.fullmatch(
        r"frequency is (\S+), so that waves of (\S+) mm mean a shear modulus of (\S+) (\S+); wanted: .*",
        str(error.value),
    )
    assert found is not None and float(found[1]) == said and float(found[2]) == pytest.approx(28.9, rel=0.1)
    assert found[4] == unit and float(found[3]) == pytest.approx(size, rel=0.2)


def test_zones_are_refused_at_once():
    with pytest.raises(InputError, match=r"^frequency is 60000, so that"):
        invert_by_subzones(shaken(3e3, 60.0, 60e3, (9, 9, 9)))


def test_data_as_fast_as_kilohertz_are_more_points_than_a_wave():
    """Waves at 60 kHz are undersampled by points 2 mm apart."""
    points = grid(16, 16)
    random = np.random.default_rng(0).normal(size=(1, 256, 2)) * 1e-6
    with pytest.raises(InputError, match=r"^frequency is 60000"):
        select_properties(waves(points, random, (60e3,)), "moduli")


@pytest.mark.parametrize(
    ("shear", "frequency", "words"),
    [
        (3e3, 60.0, []),
        (2e6, 60.0, ["at 60 Hz waves of 745 mm mean a shear modulus of 2 MPa, which few tissues have"]),
        (20.0, 6.0, ["mean a shear modulus of 20 Pa, which few tissues have"]),
        (3e3, 300.0, ["at 300 Hz waves of 5.77 mm mean a shear modulus of 3 kPa, and 2.9 distances between points"]),
    ],
)
def test_what_is_said_of_a_frequency(shear, frequency, words):
    notes = wavelength_notes(shaken(3e3, 60.0, frequency), shear)
    assert len(notes) == len(words) and all(word in note for word, note in zip(words, notes, strict=True))


def test_an_inversion_says_so():
    """Waves with 3.5 points per wavelength, slightly disturbed."""
    data = shaken(3e3, 60.0, shape=(12, 12), spacing=8.25e-3).with_noise(0.01, 0)
    found = invert(data, uniform=False, regulariser="smooth")
    assert sum("distances between points" in note for note in found.warnings) == 1
    fine = shaken(3e3, 60.0).with_noise(0.01, 0)
    assert not any("at 60 Hz" in note for note in invert(fine, uniform=False, regulariser="smooth").warnings)
