"""MR phases to displacements: closed forms, invalid input."""

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.image.mre.displacement import (
    first_harmonic,
    phase_to_displacement,
    remove_rigid_motion,
    tissue_mask,
    unwrap_phase,
    unwrap_phase_in_time,
    unwrap_phase_least_squares,
)


def wave(shape, peak=9.0):
    x = np.indices(shape) / np.array(shape)[:, None, None, None][:, *[0] * (3 - len(shape))]
    return peak * np.sin(5 * x[0] + 0.5) * np.cos(4 * x[1]) + (3 * x[2] ** 2 if len(shape) == 3 else 0)


def ring(shape):
    """A mask with a hole and a separate component."""
    away = np.linalg.norm(np.indices(shape[:2]) - np.array([14, 18])[:, None, None], axis=0)
    mask = (away < 12) & (away > 3)
    mask[-4:, :6] = True
    return mask if len(shape) == 2 else np.repeat(mask[:, :, None], shape[2], axis=2)


@pytest.mark.parametrize("way", [unwrap_phase, unwrap_phase_least_squares])
@pytest.mark.parametrize("shape", [(34, 36), (34, 36, 9)])
@pytest.mark.parametrize("masked", [False, True])
def test_unwrapping_gives_the_phase_but_for_a_constant(way, shape, masked, rng):
    true = wave(shape) + 0.1 * rng.normal(size=shape)
    mask = ring(shape) if masked else np.ones(shape, bool)
    wrapped = np.where(mask, np.angle(np.exp(1j * true)), np.nan)
    assert np.ptp(true[mask]) > 4 * np.pi
    found = way(wrapped, mask)
    assert np.isfinite(found).all() and not found[~mask].any()
    pieces = [mask] if not masked else [mask & (np.indices(shape)[0] < 28), mask & (np.indices(shape)[0] >= 30)]
    for piece in pieces:
        off = (found - true)[piece] / (2 * np.pi)
        assert np.ptp(off) < 1e-9 and abs(off[0] - round(off[0])) < 1e-9


@pytest.mark.parametrize("way", [unwrap_phase, unwrap_phase_least_squares])
def test_unwrapping_refuses_what_it_cannot_use(way):
    for wrong in (np.zeros(5), np.zeros((2, 2, 2, 2)), np.full((4, 4), np.nan)):
        with pytest.raises(InputError, match="phase"):
            way(wrong)
    with pytest.raises(InputError, match="phase"):
        way(np.zeros((4, 4)), np.zeros((3, 3), bool))


def test_unwrapping_through_time_is_off_by_one_constant_for_each_piece(rng):
    """Motion of 3.5 rad over a static phase, eight times a period; unwrapped separately, times differ by multiples of 2π."""
    mask, t = ring((34, 36)), 2 * np.pi * np.arange(8) / 8
    moving = 3.5 * np.exp(0.3j * np.indices((34, 36))[0])[..., None]
    true = wave((34, 36))[..., None] + (moving * np.exp(1j * t)).real + 4 * np.cos(t)
    true += 0.1 * rng.normal(size=true.shape)
    wrapped = np.where(mask[..., None], np.angle(np.exp(1j * true)), np.nan)
    found = unwrap_phase_in_time(wrapped, mask)
    for piece in (mask & (np.indices((34, 36))[0] < 28), mask & (np.indices((34, 36))[0] >= 30)):
        off = (found - true)[piece] / (2 * np.pi)
        assert np.ptp(off) < 1e-9 and abs(off[0, 0] - round(off[0, 0])) < 1e-9
    alone = np.stack([unwrap_phase(each, mask) for each in np.moveaxis(wrapped, -1, 0)], axis=-1)
    assert np.ptp((alone - true)[mask]) > 6
    fast = np.angle(np.exp(1j * (true + np.array([0, 2.5, 5, 7.5, 10, 12.5, 15, 17.5]))))
    with pytest.raises(InputError, match="too fast to be unwrapped through time"):
        unwrap_phase_in_time(fast, mask)


def test_tissue_is_the_largest_bright_piece_without_holes(rng):
    away = np.linalg.norm(np.indices((40, 40, 12)) - np.array([15, 18, 6])[:, None, None, None], axis=0)
    true = away < 12
    bright = np.where(true & (away > 3), 300.0, 0.0)
    bright[34:38, 34:38] = 320.0
    noisy = np.abs(bright + 20 * (rng.normal(size=bright.shape) + 1j * rng.normal(size=bright.shape)))
    np.testing.assert_array_equal(tissue_mask(noisy), true)


def test_the_first_harmonic_and_its_error(rng):
    n, sigma = 8, 0.2
    t = 2 * np.pi * np.arange(n) / n
    u = rng.normal(size=(4000, 1)) + 1j * rng.normal(size=(4000, 1))
    clean = (u * np.exp(1j * t)).real + 7.0
    found, error = first_harmonic(clean)
    assert np.allclose(found, u[:, 0]) and error.max() < 1e-12
    found, error = first_harmonic(clean + 0.3 * np.cos(2 * t))  # a second harmonic is error, not signal
    assert np.allclose(found, u[:, 0]) and error == pytest.approx(0.3 * np.sqrt(n / 2 / (n - 3)))
    found, error = first_harmonic(clean + sigma * rng.normal(size=clean.shape))
    assert np.sqrt((error**2).mean()) == pytest.approx(sigma, rel=0.02)
    assert np.std((found - u[:, 0]).real) == pytest.approx(sigma * np.sqrt(2 / n), rel=0.04)
    for wrong in (np.zeros((5, 2)), np.zeros((5, 4), complex)):
        with pytest.raises(InputError, match="samples"):
            first_harmonic(wrong)


def test_phases_become_displacements():
    assert phase_to_displacement(np.array([np.pi]), 2e5) == pytest.approx(np.pi / 2e5)
    with pytest.raises(InputError, match="encoding"):
        phase_to_displacement(np.zeros(3), 0.0)


@pytest.mark.parametrize("d", [2, 3])
def test_rigid_motion_is_taken_off_and_nothing_else(d, rng):
    x = 0.1 * rng.normal(size=(50, d))
    turn = rng.normal(size=(d, d)) + 1j * rng.normal(size=(d, d))
    rigid = (rng.normal(size=d) + 1j) + x @ (turn - turn.T)
    assert np.abs(remove_rigid_motion(rigid, x)).max() < 1e-12
    stretch = x @ np.diag(np.arange(1.0, d + 1))
    kept = remove_rigid_motion(rigid + stretch, x)
    assert np.allclose(remove_rigid_motion(kept, x), kept)
    strain = np.linalg.lstsq(np.c_[x, np.ones(50)], kept, rcond=None)[0][:d]
    assert (strain + strain.T) / 2 == pytest.approx(np.diag(np.arange(1.0, d + 1)))
    outlier = rigid.copy()
    outlier[0] += 5
    mask = np.arange(50) > 0
    assert np.abs(remove_rigid_motion(outlier, x, mask)[1:]).max() < 1e-12
    missing = np.where(np.arange(50)[:, None] % 7 == 0, np.nan, rigid)
    assert np.nanmax(np.abs(remove_rigid_motion(missing, x))) < 1e-12
