"""One modulus for several frequencies: kept where it fits, refused or given an exponent where the waves contradict it."""

from dataclasses import replace

import numpy as np
import pytest
from planewaves import RHO, grid, shear_waves

from ngbrain.errors import InputError
from ngbrain.inverse.data.dispersion import contradiction
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.io.waves import WaveData

LOW, HIGH, SHEAR = 40.0, 60.0, 2500 + 500j


def waves(exponent, noise=0.0, shape=(20, 20)):
    """Plane waves at two frequencies, G* with frequency to the power of the exponent."""
    points = grid(*shape, spacing=3e-3)
    u = np.stack([shear_waves(points, SHEAR * (f / LOW) ** exponent, f) for f in (LOW, HIGH)])
    kind = "isotropic", "viscoelastic"
    return WaveData(points, u, [LOW, HIGH], RHO, *kind, poisson=0.49).with_noise(noise, seed=1)


@pytest.mark.parametrize("noise", [0.0, 0.03])
def test_the_same_modulus_at_both_frequencies_contradicts_nothing(noise):
    assert contradiction(waves(0.0, noise)) == ""


def test_nor_does_an_inclusion():
    several = replace(Phantom.from_name("CV-G", 25), frequency=(40.0, 60.0))
    assert contradiction(several.simulate_measurements(0.01).data()) == ""


@pytest.mark.parametrize("shape", [(20, 20), (10, 10, 10)])
def test_moduli_that_double_do(shape):
    said = contradiction(waves(1.7, 0.01, shape))
    assert "kPa at 40 Hz" in said and "kPa at 60 Hz" in said


def test_one_modulus_is_refused_then():
    with pytest.raises(InputError, match=r"dispersion is none, while waves suggest .*; wanted: 'power'"):
        invert(waves(1.7, 0.01), dispersion="none")
    with pytest.raises(InputError, match="one frequency at a time"):
        invert(waves(1.7, 0.01, (10, 10, 10)))


def test_gross_errors_hide_nothing():
    """Outliers are removed before frequencies are compared, by `invert` or beforehand."""
    data = waves(1.7, 0.01)
    u = data.displacement.copy()
    wrong = np.arange(0, len(data.points), 7)
    u[1, wrong] += 30 * data.rms.max() * np.exp(1j * wrong)[:, None]
    spoilt = replace(data, displacement=u)
    assert contradiction(spoilt) == ""
    with pytest.raises(InputError, match="waves suggest"):
        invert(spoilt, dispersion="none")


def test_an_exponent_is_found():
    found = invert(waves(1.2, 0.01), noise=0.01, uniform=False, regulariser="smooth", max_iterations=12)
    assert found.checks["exponent"] == pytest.approx(1.2, abs=0.1)
    assert any("an exponent of frequency is an unknown" in note for note in found.warnings)
    assert np.median(found.maps["storage"]) == pytest.approx(SHEAR.real, rel=0.05)
