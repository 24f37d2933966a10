"""Motion sampled over a period, as displacements and as wrapped phases, becomes the waves that it was made of."""

import json

import nibabel
import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.io.waves import read_waves
from ngbrain.io.waves.samples import samples_to_amplitudes

TIMES, SHAPE, H = 8, (20, 18), 2e-3
TURN = np.exp(2j * np.pi * np.arange(TIMES) / TIMES)
POINTS = np.indices(SHAPE).reshape(2, -1, order="F").T * H
WAVES = 1e-5 * np.stack([np.exp(-300j * POINTS[:, ::-1]), (1 - 2j) * np.cos(200 * POINTS)])
"""(loads, n, d) m."""
ENCODING = np.array([2e5, 1.2e5])
"""rad/m: amplitudes of 2.7 rad at most, so that no step of an eighth of a period is more than π."""


BENT = POINTS + 1e-4 * np.sin(1e5 * POINTS)


def keys(**changes):
    given = {"points": POINTS, "frequency": [50.0, 60.0], "density": 1000.0, "symmetry": "isotropic"}
    every = {**given, "rheology": "viscoelastic", "poisson": 0.4, **changes}
    return {name: value for name, value in every.items() if value is not None}


def samples():
    """Samples of a wave plus a static offset."""
    return (WAVES[..., None] * TURN).real + 3e-5 * np.sin(100 * POINTS)[None, :, :, None]


def phases():
    """Phases of a wave plus a static phase of up to 12 rad, wrapped to 0 to 2π as by a scanner."""
    still = (600 * POINTS[:, :1] - 400 * POINTS[:, 1:])[None, :, :, None]
    return np.mod(((ENCODING * WAVES)[..., None] * TURN).real + still, 2 * np.pi)


def read(tmp_path, **changes):
    np.savez(tmp_path / "waves.npz", **keys(**changes))
    return read_waves(tmp_path / "waves.npz")


def test_samples_become_amplitudes(tmp_path):
    found = read(tmp_path, samples=samples())
    np.testing.assert_allclose(found.displacement, WAVES, atol=1e-18)
    assert found.noise < 1e-9
    assert read(tmp_path, samples=samples()[..., ::2], noise=0.03).noise == 0.03
    assert read(tmp_path, samples=samples()[..., [0, 1, 2]]).noise is None  # three samples tell none


def test_noise_of_samples_is_that_of_amplitudes(tmp_path, rng):
    noisy = samples() + 3e-7 * rng.normal(size=(*WAVES.shape, TIMES))
    mask = POINTS[:, 0] > 0.01
    noisy[:, ~mask] *= rng.normal(size=noisy[:, ~mask].shape)
    found = read(tmp_path, samples=noisy, mask=mask)
    off = np.sqrt(np.mean(np.abs(found.displacement - WAVES)[:, mask] ** 2, axis=1))
    assert found.noise == pytest.approx(np.median(off / found.rms[:, 0]), rel=0.05)


def test_a_component_that_is_not_sampled_stays_so(tmp_path):
    axial, wrapped = samples(), phases()
    for values in (axial, wrapped):
        values[:, :, 0] = np.nan
    for given in ({"samples": axial}, {"phase": wrapped, "encoding": ENCODING}):
        found = read(tmp_path, **given)
        assert np.isnan(found.displacement[..., 0]).all() and found.noise < 1e-9
        np.testing.assert_allclose(found.displacement[..., 1], WAVES[..., 1], atol=1e-16)


@pytest.mark.parametrize("hole", [False, True])
def test_wrapped_phases_become_amplitudes(hole, tmp_path):
    mask = np.linalg.norm(POINTS - [0.02, 0.018], axis=1) > (0.006 if hole else 0)
    wrapped = np.where(mask[:, None, None], phases(), np.nan)
    found = read(tmp_path, phase=wrapped, encoding=ENCODING, mask=mask)
    np.testing.assert_allclose(found.displacement[:, mask], WAVES[:, mask], atol=1e-16)
    half = read(tmp_path, phase=wrapped, encoding=1e5, mask=mask).displacement[:, mask]  # one for both components
    np.testing.assert_allclose(half, (WAVES * ENCODING / 1e5)[:, mask], atol=1e-16)


def test_phases_in_an_image_with_its_magnitude(tmp_path):
    """Six axes: voxels, loads, components, times; the mask is where the magnitude is not dark."""
    tissue = np.linalg.norm(POINTS - [0.02, 0.018], axis=1) < 0.014
    image = np.moveaxis(np.where(tissue[:, None, None], phases(), 0.3), 0, 1).reshape(*SHAPE, 1, 2, 2, TIMES, order="F")
    affine = np.diag([2.0, 2.0, 2.0, 1.0])  # mm
    nibabel.save(nibabel.Nifti1Image(image, affine), tmp_path / "scan.nii.gz")
    bright = np.where(tissue, 800.0, 20.0) + 10 * np.cos(1e4 * POINTS[:, 0])
    nibabel.save(nibabel.Nifti1Image(bright.reshape(*SHAPE, 1, order="F"), affine), tmp_path / "bright.nii.gz")
    card = keys(points=None) | {"encoding": ENCODING.tolist(), "files": {"magnitude": "bright.nii.gz"}}
    (tmp_path / "scan.json").write_text(json.dumps(card))
    found = read_waves(tmp_path / "scan.nii.gz")
    assert found.affine is not None and np.mean(found.mask != tissue) < 0.02
    np.testing.assert_allclose(found.displacement[:, found.mask], WAVES[:, found.mask], atol=1e-12)
    card.pop("encoding")
    (tmp_path / "scan.json").write_text(json.dumps(card))
    with pytest.raises(InputError, match=r"displacement is 3\.97.* wanted: metres"):  # what they would be
        read_waves(tmp_path / "scan.nii.gz")


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"samples": samples(), "displacement": WAVES}, "samples is given beside displacement; wanted: one of them"),
        ({"samples": samples()[..., :2]}, "samples is float64 of shape (2, 360, 2, 2); wanted: real numbers (loads, 360, 2, "),
        ({"samples": samples()[:, 1:]}, "samples is float64 of shape (2, 359, 2, 8)"),
        ({"samples": samples() + 0j}, "samples is complex128"),
        ({"samples": samples(), "frequency": [50.0, 0.0]}, "samples is of a load at rest; wanted: frequencies above 0"),
        ({"phase": phases()}, "encoding is missing; wanted: rad of phase per m"),
        ({"phase": phases(), "encoding": 0.0}, "encoding is [0.0, 0.0]; wanted: rad/m, not 0"),
        ({"phase": phases(), "encoding": np.ones(3)}, "encoding is float64 of shape (3,); wanted: one number or 2"),
        ({"phase": phases(), "encoding": 1e5, "points": BENT}, "phase is given at points that are no grid"),
        ({"phase": phases()[..., :3] + [0, 2.3, 4.6], "encoding": 1e5}, "phase is of a motion too fast"),
        ({"displacement": WAVES, "magnitude": np.ones(7)}, "magnitude is float64 of shape (7,); wanted: finite"),
        ({"displacement": None}, "displacement is missing"),
        ({"samples": samples(), "mask": np.ones(7, bool)}, "mask is bool of shape (7,)"),
        ({"samples": samples(), "encodings": 1.0}, "key is 'encodings'; wanted: did you mean 'encoding'"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_named(changes, says, tmp_path):
    with pytest.raises(InputError) as error:
        read(tmp_path, **changes)
    assert f"waves.npz: {says}" in str(error.value)


@pytest.mark.parametrize("times", [4, 8])
def test_a_last_time_that_repeats_the_first_is_refused(times):
    points = np.array([[x, y] for y in range(6) for x in range(6)]) * 0.01
    rng = np.random.default_rng(0)
    u = 1e-6 * (rng.normal(size=(1, 36, 2)) + 1j * rng.normal(size=(1, 36, 2)))
    motion = np.real(u[..., None] * np.exp(2j * np.pi * np.arange(times) / times))
    noise = 3e-8 * rng.normal(size=(1, 36, 2, times + 1))
    keys = {"points": points, "frequency": [50.0], "samples": motion + noise[..., 1:]}
    assert samples_to_amplitudes(keys)["displacement"] == pytest.approx(u, abs=2e-7)
    keys["samples"] = np.concatenate([motion, motion[..., :1]], axis=-1) + noise
    with pytest.raises(InputError, match=f"samples is the same at the last time.*leave out the last of {times + 1}"):
        samples_to_amplitudes(keys)
