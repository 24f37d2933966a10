"""Cutting wave data into zones, and joining what they say: by counts, shares and closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from planewaves import grid, shear_waves, waves

from ngbrain.inverse.quality import noise_of
from ngbrain.inverse.zones import FEWEST, cut, disagreement, joined, part

SPACING, SIZE, OVERLAP = 2e-3, 0.024, 0.008


@pytest.fixture(scope="module")
def egg():
    """Points of an ellipsoid that lacks a piece, so that cuts do not line up, on a grid."""
    points = grid(30, 24, 20, spacing=SPACING)
    middle = points.mean(axis=0)
    mask = np.sum(((points - middle) / (middle + SPACING / 2)) ** 2, axis=1) < 1
    mask &= (points[:, 0] < middle[0]) | (points[:, 1] < 1.3 * middle[1])
    return waves(points, 1e-6 * np.ones((1, len(points), 3), complex), bulk=2e5, poisson=None, mask=mask)


def test_zones_are_small_even_and_share_every_point(egg):
    zones = cut(egg, SIZE, OVERLAP)
    total, count = np.zeros(len(egg.points)), np.zeros(len(egg.points), int)
    for zone in zones:
        total[zone.points] += zone.share
        count[zone.points] += 1
        assert np.all(np.ptp(egg.points[zone.points], axis=0) < SIZE + 1e-9)
    np.testing.assert_allclose(total, egg.mask, atol=1e-12)
    sizes = [len(zone.points) for zone in zones]
    assert len(zones) > 8 and max(sizes) < 2.5 * min(sizes)
    assert count.max() >= 4  # where corners meet


def test_shares_fall_to_nothing_at_cut_faces_and_are_whole_elsewhere(egg):
    faces = 0
    for zone in cut(egg, SIZE, OVERLAP):
        points = egg.points[zone.points]
        others = egg.points[np.setdiff1d(np.flatnonzero(egg.mask), zone.points)]
        for i in range(3):
            beside = np.delete((others > zone.low) & (others < zone.high), i, axis=1).all(axis=1)
            if np.any(beside & (others[:, i] > zone.high[i])):
                at_face = zone.high[i] - points[:, i] < SPACING
                assert zone.share[at_face].max() < 0.15
                faces += 1
        deep = np.all((points > zone.low + OVERLAP) & (points < zone.high - OVERLAP), axis=1)
        np.testing.assert_allclose(zone.share[deep], 1)
    assert faces > 8


def test_without_overlap_every_point_is_in_one_zone(egg):
    zones = cut(egg, SIZE, 0.0)
    numbers = np.concatenate([zone.points for zone in zones])
    assert np.array_equal(np.sort(numbers), np.flatnonzero(egg.mask))
    assert all(np.all(zone.share == 1) for zone in zones)


def test_a_piece_of_few_points_is_in_no_zone():
    points = grid(30, 8, 8, spacing=SPACING)
    column = np.round(points[:, 0] / SPACING).astype(int)
    mask = (column < 20) | (column > 26)  # 7 x 8 x 8 on one side, 3 x 8 x 8 on the other
    data = waves(points, 1e-6 * np.ones((1, len(points), 3), complex), bulk=2e5, poisson=None, mask=mask)
    kept = np.concatenate([zone.points for zone in cut(data, 1.0, 0.0)])
    assert 3 * 8 * 8 < FEWEST < 20 * 8 * 8 and column[kept].max() == 19
    assert not cut(replace(data, mask=column > 26, dirichlet=None), 1.0, 0.0)
    cube = np.all(points < 6 * SPACING - 1e-9, axis=1)  # 6 x 6 x 6: no spline can be laid through so few
    assert cube.sum() == FEWEST and not cut(replace(data, mask=cube, dirichlet=None), 1.0, 0.0)


def test_scattered_points(rng, egg):
    points = rng.random((4000, 3)) * 0.04
    data = waves(points, 1e-6 * np.ones((1, 4000, 3), complex), bulk=2e5, poisson=None)
    zones = cut(data, 0.03, 0.01)
    own, chosen = part(data, zones[0])
    assert len(zones) == 8 and np.array_equal(chosen, zones[0].points) and own.mask.all()


def test_data_of_a_zone_are_a_grid_with_the_noise_of_all():
    points = grid(20, 8, 8, spacing=SPACING)
    u = shear_waves(points, 2500 + 500j)[None] * (1 + 100 * points[None, :, :1])
    data = waves(points, u, bulk=2e5, poisson=None, labels=np.arange(len(points)) % 3)
    zone = cut(data, SIZE, OVERLAP)[1]
    own, chosen = part(data, zone)
    assert own.structured and own.structured.shape[1:] == (8, 8) and own.loads == 1
    np.testing.assert_array_equal(own.displacement, u[:, chosen])
    np.testing.assert_array_equal(own.labels, chosen % 3)
    np.testing.assert_array_equal(np.sort(chosen[own.mask]), zone.points)
    np.testing.assert_allclose(noise_of(own, 0.02), noise_of(data, 0.02))


def test_what_zones_agree_on_is_joined_unchanged_and_the_rest_by_shares(egg):
    zones = cut(egg, SIZE, OVERLAP)
    n, truth = len(egg.points), egg.points @ [1.0, 2.0, 3.0]
    values = [truth[zone.points] for zone in zones]
    np.testing.assert_allclose(joined(zones, values, n), np.where(egg.mask, truth, np.nan))
    assert disagreement(zones, values, n) < 1e-9
    values[0] = values[0] + 0.1
    off = joined(zones, values, n)[zones[0].points] - truth[zones[0].points]
    np.testing.assert_allclose(off, 0.1 * zones[0].share, atol=1e-12)
    values[0][:] = np.nan  # left to the others
    left = joined(zones, values, n)[zones[0].points]
    assert np.isnan(left[zones[0].share > 1 - 1e-9]).all() and np.isfinite(left[zones[0].share < 0.9]).all()


def test_disagreement_is_the_rms_difference_of_pairs():
    points = grid(20, 8, 8, spacing=SPACING)
    data = waves(points, 1e-6 * np.ones((1, len(points), 3), complex), bulk=2e5, poisson=None)
    zones = cut(data, SIZE, OVERLAP)
    assert len(zones) == 2
    values = [np.zeros(len(zones[0].points)), np.full(len(zones[1].points), 0.3)]
    assert disagreement(zones, values, len(points)) == pytest.approx(0.3)
