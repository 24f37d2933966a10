"""Waves that gain energy are refused; waves without loss, noisy or at rest are not."""

from dataclasses import replace

import numpy as np
import pytest
from planewaves import grid, shear_waves, waves

from ngbrain.errors import InputError
from ngbrain.inverse.data.direct_inversion import loss_tangent
from ngbrain.inverse.data.time_convention import check_passive
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.phantoms.benchmark import PHANTOMS, Phantom
from ngbrain.io.waves import read_waves
from ngbrain.io.waves.files import to_keys

LOSSY = [name for name in PHANTOMS if name.startswith(("CV", "NV"))]


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("name", LOSSY)
def test_published_waves_lose_energy_and_their_conjugates_gain_it(name, noise):
    data = Phantom.from_name(name, 25).simulate_measurements(noise).data()
    check_passive(data)
    with pytest.raises(InputError, match="gain energy"):
        check_passive(data.conjugate())


@pytest.mark.parametrize("shape", [(24, 22), (12, 11, 10)])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_the_loss_tangent_and_none(shape, noise):
    points = grid(*shape)
    for shear, wanted in ((2000 + 400j, 0.2), (2000, 0.0)):
        data = waves(points, shear_waves(points, shear)).with_noise(noise, seed=3)
        tangent, error = loss_tangent(data)
        assert tangent == pytest.approx(wanted, abs=0.02 + 4 * error)
        check_passive(data)


def test_without_loss_or_at_rest_nothing_is_asked():
    points = grid(20, 20)
    elastic = waves(points, shear_waves(points, 2000 + 400j), rheology="elastic").conjugate()
    check_passive(elastic)
    still = waves(points, shear_waves(points, 2000), frequency=(0.0,))
    check_passive(still)
    check_passive(replace(elastic, rheology="viscoelastic").conjugate())


def test_invert_refuses_them():
    points = grid(20, 20)
    with pytest.raises(InputError, match="gain energy"):
        invert(waves(points, shear_waves(points, 2000 + 400j)).conjugate())


def test_a_file_may_say_that_it_is_conjugate(tmp_path):
    points = grid(20, 20)
    data = waves(points, shear_waves(points, 2000 + 400j))
    np.savez(tmp_path / "waves.npz", **to_keys(data.conjugate()), conjugate=True)
    np.testing.assert_array_equal(read_waves(tmp_path / "waves.npz").displacement, data.displacement)
    np.savez(tmp_path / "waves.npz", **to_keys(data), conjugate=2)
    with pytest.raises(InputError, match="conjugate is 2; wanted: true or false"):
        read_waves(tmp_path / "waves.npz")
