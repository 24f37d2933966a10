"""What is no body's waves is said not to be usable, with the reason; what is, is usable; ranges of tissue are warned of."""

from dataclasses import replace

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.inverse.believable import TISSUES, of_size, of_tissue
from ngbrain.inverse.invert import invert
from ngbrain.inverse.phantoms import Phantom
from ngbrain.inverse.verdict import reasons_against
from ngbrain.io.waves.data import TISSUES as NAMES
from ngbrain.io.waves.data import WaveData


@pytest.fixture(scope="module")
def data():
    return replace(Phantom.named("CV-G", 17).measured(0.01).data(), truth={})


def inverted(data):
    return invert(data, uniform=False, regulariser="smooth", rounds=6)


def of_nonsense(data, kind):
    u, rng = data.displacement, np.random.default_rng(0)
    if kind == "shuffled":
        return replace(data, displacement=u[:, rng.permutation(len(data.points))])
    if kind == "noise":
        return replace(data, displacement=1e-4 * (rng.normal(size=u.shape) + 1j * rng.normal(size=u.shape)))
    if kind == "swapped":
        return replace(data, displacement=u[:, :, ::-1])
    if kind == "real":
        return replace(data, displacement=u.real)
    if kind == "phase":
        turn = 3 * np.sin(2 * np.pi * data.points[:, 0] / 0.12) * np.cos(2 * np.pi * data.points[:, 1] / 0.12)
        return replace(data, displacement=u * np.exp(1j * turn)[None, :, None])
    other = Phantom.named("CV-B", 17).measured(0.01).data().displacement
    return replace(data, displacement=np.where((rng.random(len(data.points)) < 0.5)[None, :, None], u, other))


def test_good_waves_are_usable(data):
    found = inverted(data)
    assert found.usable and found.result()["usable"] and found.result()["reasons"] == []


@pytest.mark.parametrize("kind", ["shuffled", "noise", "swapped", "real", "phase", "half of another"])
def test_nonsense_is_not(data, kind):
    try:
        found = inverted(of_nonsense(data, kind))
    except InputError:
        return
    print(kind, found.noise_found, found.stated, found.reasons)
    assert not found.usable


def test_each_reason_by_itself(data):
    maps = {"storage": np.full(289, 1e4), "loss": np.full(289, 1e3)}
    assert reasons_against(data, maps, 0.01, 0.012) == []
    assert reasons_against(data, maps, 0.05, 0.15) == []
    for stated, found, words in ((0.01, 0.1, "noise of 1 %"), (0.12, 0.6, "60 % of the displacements")):
        (reason,) = reasons_against(data, maps, stated, found)
        assert words in reason
    (reason,) = reasons_against(data, {name: 1e4 * values for name, values in maps.items()}, 0.01, 0.01)
    assert "the median modulus is 100 MPa" in reason
    (reason,) = reasons_against(replace(data, displacement=data.displacement.real), maps, 0.01, 0.01)
    assert "imaginary parts are missing" in reason


def test_moduli_out_of_the_range_of_a_tissue_are_warned_of(data):
    assert set(TISSUES) == set(NAMES)
    brain = replace(data, tissue="brain")
    assert of_tissue(brain, 2e3) == [] and of_tissue(data, 1e9) == []
    (note,) = of_tissue(brain, 80e3)  # rad/s in place of Hz makes 2 kPa into this
    assert "10 times above what brain has" in note and "rad/s" in note
    with pytest.raises(InputError, match="tissue is 'bran'; wanted: did you mean 'brain'"):
        replace(data, tissue="bran")


def test_computed_waves_near_a_resonance_may_be_larger_than_the_body(data):
    large = replace(data, displacement=300 * data.displacement)
    (note,) = of_size(large)
    assert "in a region of 0.12 m" in note and of_size(data) == []
    with pytest.raises(InputError, match="10 times the size of the region"):
        WaveData(data.points, 3e4 * data.displacement, data.frequency, 1000.0, "isotropic", "elastic", poisson=0.4)
