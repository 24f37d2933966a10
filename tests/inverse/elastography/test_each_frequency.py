"""Inversion of each frequency: its own moduli, also in processes; an error names the frequency."""

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.inverse.elastography.each_frequency import invert_each_frequency
from ngbrain.inverse.elastography.invert import invert
from ngbrain.io.waves import WaveData

SHEAR = {50.0: 2000 + 400j, 70.0: 3000 + 900j}
HOW = {"uniform": False, "regulariser": "smooth", "max_iterations": 2, "drop_outliers": False}


def waves():
    """Plane waves; two loads of 70 Hz around one of 50 Hz."""
    points = np.array([[x, y] for y in range(12) for x in range(12)]) * 4e-3
    frequency = np.array([70.0, 50.0, 70.0])
    u = [np.exp(-2j * np.pi * f * np.sqrt(1000 / SHEAR[f]) * points[:, ::-1]) for f in frequency]
    u[2] = u[2] * [1, -1]
    data = WaveData(points, 1e-5 * np.array(u), frequency, 1000.0, "isotropic", "viscoelastic", poisson=0.4)
    return data.with_noise(0.01, seed=0)


@pytest.mark.one_thread
@pytest.mark.slow
def test_each_has_its_own_moduli_to_the_same_bits_in_processes(caplog):
    told = []
    found, apart = (invert_each_frequency(waves(), executor=who, callback=told.append, **HOW) for who in (None, 2))
    assert list(found) == [50.0, 70.0] and found[70.0].data.loads == 2
    for frequency, one in found.items():
        assert np.median(one.maps["storage"]) == pytest.approx(SHEAR[frequency].real, rel=0.03)
        np.testing.assert_array_equal(apart[frequency].maps["storage"], one.maps["storage"])
        assert apart[frequency].warnings == one.warnings
    assert {each.phase.split(",")[0] for each in told} == {"50 Hz", "70 Hz"}
    assert "in this process" not in caplog.text


def test_together_they_contradict_each_other():
    with pytest.raises(InputError, match="wanted: 'power'"):
        invert(waves(), dispersion="none", **HOW)


def test_what_invert_refuses_is_refused():
    with pytest.raises(InputError, match="regulariser"):
        invert_each_frequency(waves(), regulariser="smoth")
