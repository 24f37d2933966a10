"""Phantoms: the published waves to the printed digits, noise of the stated size, the published inversion."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.inverse.phantoms.benchmark import PHANTOMS, Phantom

RMS = {
    "CE-G": (0.9115, 0.6472),
    "CE-B": (1.0233, 0.7042),
    "CV-G": (0.7078, 0.3288),
    "CV-B": (0.6207, 0.2354),
    "NE-G": (0.9371, 0.9288),
    "NV-G": (0.6213, 0.1730),
}
"""Published values of the two components (mm)."""


@pytest.mark.parametrize("name", RMS)
def test_published_waves(name):
    assert Phantom.from_name(name).simulate_measurements().rms.ravel() * 1e3 == pytest.approx(RMS[name], abs=5.001e-5)


def test_published_waves_along_fibres():
    assert Phantom.from_name("TI").simulate_measurements().rms[1].ravel() * 1e3 == pytest.approx(
        (5.4739, 1.6210), abs=5.001e-5
    )


def test_several_frequencies_are_those_of_one_each():
    body = Phantom.from_name("TI", 7)
    several = replace(body, frequency=(30.0, 50.0)).simulate_measurements()
    each = [replace(body, frequency=f).simulate_measurements().displacement for f in (30.0, 50.0)]
    assert several.displacement == pytest.approx(np.concatenate(each), rel=1e-12)
    assert several.data().frequency.tolist() == [30.0, 30.0, 50.0, 50.0]
    inversion = several.inversion(start=several.truth)
    assert np.abs(inversion.reduced.evaluate(inversion.start).state.data - several.displacement).max() < 1e-9


def test_noise_is_as_large_as_stated():
    clean, noisy = (Phantom.from_name("CV-G").simulate_measurements(noise, 3) for noise in (0.0, 0.02))
    off = (noisy.displacement - clean.displacement) / clean.rms
    assert np.sqrt(np.mean(np.abs(off) ** 2)) == pytest.approx(0.02, rel=0.03)
    truth = noisy.inversion().reduced.misfit
    assert 2 * truth.value(clean.displacement) == pytest.approx(truth.count, rel=0.05)


def test_published_inversion_starts_as_published_and_its_misfit_falls():
    start = Phantom.from_name("CV-G").simulate_measurements()
    inversion = start.inversion()
    misfit = 5e5 * np.sum(np.abs(inversion.reduced.evaluate(inversion.start).state.data - start.displacement) ** 2)
    assert misfit == pytest.approx(25.99276698574, rel=1e-6)
    falls = [
        iterate.misfit
        for iterate in islice(Phantom.from_name("CV-G", 9).simulate_measurements().published_iterations(), 10)
    ]
    assert np.all(np.diff(falls) < 0)


@pytest.mark.parametrize("name", PHANTOMS)
def test_wave_data(name):
    data = Phantom.from_name(name, 5).simulate_measurements(0.01).data()
    assert data.noise == 0.01 and data.element in ("q4", "q4p0") and data.truth


def test_another_name_is_refused():
    with pytest.raises(InputError, match="CV-G"):
        Phantom.from_name("CVG")
