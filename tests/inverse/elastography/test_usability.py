"""Data that are not waves of a body are rejected with the reason, good data accepted; warnings on the range of a tissue."""

from dataclasses import replace

import numpy as np
import pytest
from planewaves import grid, wave_number, waves

from ngbrain.errors import InputError
from ngbrain.inverse.data.outliers import screen_outliers
from ngbrain.inverse.data.plausibility import TISSUES, amplitude_notes, tissue_notes
from ngbrain.inverse.data.quality import octahedral_shear_strain
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.elastography.usability import reasons_against
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.io.waves.data import TISSUES as NAMES
from ngbrain.io.waves.data import WaveData


@pytest.fixture(scope="module")
def data():
    return replace(Phantom.from_name("CV-G", 17).simulate_measurements(0.01).data(), truth={})


def inverted(data):
    return invert(data, uniform=False, regulariser="smooth", max_iterations=6)


def of_nonsense(data, kind, other):
    """Corrupted waves; `other` is another scan of the same points."""
    u, rng, across = data.displacement, np.random.default_rng(0), np.ptp(data.points, axis=0)
    if kind == "shuffled":
        return replace(data, displacement=u[:, rng.permutation(len(data.points))])
    if kind == "noise":
        size = np.sqrt(np.mean(np.abs(u) ** 2))
        return replace(data, displacement=size * (rng.normal(size=u.shape) + 1j * rng.normal(size=u.shape)))
    if kind == "swapped":
        return replace(data, displacement=u[:, :, ::-1])
    if kind == "real":
        return replace(data, displacement=u.real)
    if kind == "imaginary":
        return replace(data, displacement=1j * u.imag)
    if kind == "conjugated":
        return data.conjugate()
    if kind == "mm for m":
        return replace(data, points=1e3 * data.points)
    if kind == "phase":
        x, y = (2 * np.pi * (data.points / across).T)[:2]
        return replace(data, displacement=u * np.exp(3j * np.sin(x) * np.cos(y))[None, :, None])
    assert kind == "half of another"
    chosen = (rng.random(len(data.points)) < 0.5)[None, :, None]
    return replace(data, displacement=np.where(chosen, u, other.displacement))


KINDS = ["shuffled", "noise", "swapped", "real", "imaginary", "conjugated", "mm for m", "phase", "half of another"]


def test_good_waves_are_usable(data):
    found = inverted(data)
    assert found.usable and found.to_dict()["usable"] and found.to_dict()["reasons"] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["CE-G", "CE-B", "CV-B", "NE-G", "NV-G"])
def test_no_published_case_is_rejected(name):
    found = invert(
        replace(Phantom.from_name(name, 25).simulate_measurements(0.01).data(), truth={}),
        uniform=False,
        regulariser="smooth",
    )
    print(name, found.noise_found, found.stated, found.reasons)
    assert found.usable


@pytest.mark.parametrize("size", [1, -1])
def test_a_quarter_turn_of_the_displacement_alone_is_no_shear(size):
    """Components swapped and one turned make waves of pressure, which tissue 51 times as soft explains as well as 7 % of noise."""
    data = replace(Phantom.from_name("NV-G", 21).simulate_measurements(0.02).data(), truth={})
    good = inverted(data)
    assert good.usable and good.strain.volume < 0.2
    u = size * np.stack([-data.displacement[:, :, 1], data.displacement[:, :, 0]], axis=2)
    found = inverted(replace(data, displacement=u))
    assert found.noise_found < 4 * found.stated
    (reason,) = found.reasons
    assert "|curl u|" in reason and found.strain.volume > 3


def test_good_waves_whose_rim_lost_points_keep_their_volume():
    """Sums over all points would be decided by a few derivatives at the rim: the ratio would be 52."""
    data, notes, _ = screen_outliers(
        replace(Phantom.from_name("NE-G", 25).simulate_measurements(0.01).data(), truth={})
    )
    assert notes and octahedral_shear_strain(data, 0.01).volume < 0.1


def test_compressible_tissue_may_change_its_volume(data):
    maps = {"storage": np.full(289, 1e4), "loss": np.full(289, 1e3)}
    assert reasons_against(replace(data, poisson=0.3), maps, 0.01, 0.012, 2.0) == []
    assert len(reasons_against(replace(data, poisson=0.49), maps, 0.01, 0.012, 2.0)) == 1


def rejected(spoilt, kind, inverted):
    try:
        found = inverted(spoilt())
    except InputError as error:
        print(kind, error)
        return True
    print(kind, found.noise_found, found.stated, found.reasons)
    return not found.usable


@pytest.mark.parametrize("kind", KINDS)
def test_nonsense_is_not(data, kind):
    other = Phantom.from_name("CV-B", 17).simulate_measurements(0.01).data()
    assert rejected(lambda: of_nonsense(data, kind, other), kind, inverted)


def block(shear=2500 + 800j, turn=(1.0, 0.8)):
    """Waves in three directions through a block of 27 mm, two loads, 2 % noise."""
    points, k = grid(10, 10, 10, spacing=3e-3), wave_number(shear, 80.0)
    first = np.stack([np.exp(-1j * k * points[:, i]) for i in (1, 2, 0)], axis=1)
    second = np.stack([np.exp(1j * k * points[:, i]) for i in (2, 0, 1)], axis=1)
    u = 1e-5 * np.stack([turn[0] * first, turn[1] * second])
    return waves(points, u, (80.0, 80.0), poisson=None, bulk=2e5).with_noise(0.02, seed=0)


def in_space(data):
    return invert(data, max_iterations=4)


@pytest.mark.slow
def test_good_waves_in_space_are_usable_whatever_the_sign_of_a_load():
    """The sign of a load is arbitrary, as its equation is linear."""
    data = block()
    found = in_space(data)
    turned = in_space(replace(data, displacement=data.displacement * np.array([1, -1])[:, None, None]))
    for each in (found, turned):
        assert each.usable
        assert np.median(each.maps["storage"]) == pytest.approx(2500, rel=0.02)
        assert np.median(each.maps["loss"]) == pytest.approx(800, rel=0.04)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_nonsense_in_space_is_not(kind):
    other = block(6000 + 900j, (0.7j, 1.2))
    assert rejected(lambda: of_nonsense(block(), kind, other), kind, in_space)


@pytest.mark.slow
def test_a_patch_off_by_a_wrap_is_left_out_or_rejected():
    data, encoding = block(), 2 * np.pi / 2.5e-5  # rad/m: a wrap is 25 µm
    patch = np.linalg.norm(data.points - 13e-3, axis=1) < 6e-3
    u = data.displacement.copy()
    u[0, patch, 1] += 2 * np.pi / encoding
    found = in_space(replace(data, displacement=u))
    print(found.warnings, found.reasons, np.nanmedian(found.maps["storage"]))
    right = abs(np.nanmedian(found.maps["storage"]) / 2500 - 1) < 0.1
    assert not found.usable or (right and any("gross errors" in note for note in found.warnings))


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


def map_of(storage):
    return {"storage": storage, "loss": 0.1 * storage}


def test_the_median_alone_does_not_make_a_map_usable(data):
    """As for a measured slice with the median of a brain, but a quarter of its points above 10.9 kPa and 5 % above 260."""
    storage = np.full(289, 2600.0)
    storage[:72], storage[:15] = 12e3, 300e3
    brain = replace(data, tissue="brain")
    assert reasons_against(data, map_of(storage), 0.1, 0.1) != []
    (reason,) = reasons_against(brain, map_of(storage), 0.1, 0.1)
    assert (
        "5.2 % of the moduli are more than 5.2 times off their median of 2.61 kPa: no brain varies like that" in reason
    )
    storage[:72], storage[:14] = 12e3, 300e3  # 4.8 %
    assert reasons_against(brain, map_of(storage), 0.1, 0.1) == []
    storage[:72] = 15e3  # more than 5.2 times the median
    assert "25 % of the moduli" in reasons_against(brain, map_of(storage), 0.1, 0.1)[0]
    assert reasons_against(data, map_of(storage), 0.1, 0.1) == []
    storage[:20] = 2e6
    reasons = reasons_against(data, map_of(storage), 0.1, 0.1)
    assert (
        "6.9 % of the moduli are outside the range of soft tissue, 50 Pa to 1 MPa" in reasons[0] and len(reasons) == 2
    )


@pytest.mark.parametrize("lump", [0.3, 5.0])
def test_a_lump_is_no_reason_against_a_map(data, lump):
    """A tenth of a brain as soft or as stiff as the published extremes."""
    storage = np.full(289, 2600.0)
    storage[:29] *= lump
    assert reasons_against(replace(data, tissue="brain"), map_of(storage), 0.1, 0.1) == []


def test_points_that_are_left_out_or_have_no_map_count_for_nothing(data):
    storage, mask = np.full(289, 2600.0), np.ones(289, bool)
    storage[:50], storage[50:100], mask[:50] = 1e6, np.nan, False
    masked = replace(data, mask=mask, dirichlet=None)
    assert reasons_against(masked, map_of(storage), 0.1, 0.1) == []


def test_moduli_out_of_the_range_of_a_tissue_are_warned_of(data):
    assert set(TISSUES) == set(NAMES)
    brain = replace(data, tissue="brain")
    assert tissue_notes(brain, 2e3) == [] and tissue_notes(data, 1e9) == []
    (note,) = tissue_notes(brain, 80e3)  # rad/s in place of Hz makes 2 kPa into this
    assert "10 times above what brain has" in note and "rad/s" in note
    with pytest.raises(InputError, match="tissue is 'bran'; wanted: did you mean 'brain'"):
        replace(data, tissue="bran")


def test_computed_waves_near_a_resonance_may_be_larger_than_the_body(data):
    large = replace(data, displacement=300 * data.displacement)
    (note,) = amplitude_notes(large)
    assert "in a region of 0.12 m" in note and amplitude_notes(data) == []
    with pytest.raises(InputError, match="10 times the size of the region"):
        WaveData(data.points, 3e4 * data.displacement, data.frequency, 1000.0, "isotropic", "elastic", poisson=0.4)
