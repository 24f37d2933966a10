"""Partition of wave data into zones, and merging of their maps: counts, shares and closed forms."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from planewaves import grid, shear_waves, waves

from ngbrain.inverse.data.quality import noise_deviation
from ngbrain.inverse.problem.voxel_lattice import VoxelLattice
from ngbrain.inverse.subzones.partition import FEWEST, cut_zones, disagreement, merge_values, zone_data

SPACING, SIZE, OVERLAP = 2e-3, 6, 2


def cells_of(data):
    """Cells of about two points along each side, over all points."""
    lines = [
        np.linspace(a, b, round((b - a) / 4e-3) + 1)
        for a, b in zip(data.points.min(0), data.points.max(0), strict=True)
    ]
    return VoxelLattice(tuple(lines), np.ones([len(line) - 1 for line in lines], bool), "P1")


def cut_up(data, size=SIZE, overlap=OVERLAP):
    return cut_zones(data, cells_of(data), np.full(3, size), np.full(3, overlap))


@pytest.fixture(scope="module")
def egg():
    """Points of an ellipsoid that lacks a piece, so that cuts do not line up, on a grid."""
    points = grid(30, 24, 20, spacing=SPACING)
    middle = points.mean(axis=0)
    mask = np.sum(((points - middle) / (middle + SPACING / 2)) ** 2, axis=1) < 1
    mask &= (points[:, 0] < middle[0]) | (points[:, 1] < 1.3 * middle[1])
    return waves(points, 1e-6 * np.ones((1, len(points), 3), complex), bulk=2e5, poisson=None, mask=mask)


def test_zones_are_small_even_and_share_every_point(egg):
    zones = cut_up(egg)
    total, count = np.zeros(len(egg.points)), np.zeros(len(egg.points), int)
    for zone in zones:
        total[zone.points] += zone.share
        count[zone.points] += 1
        assert all(np.any(zone.cells.cells, axis=other).sum() <= SIZE for other in ((1, 2), (0, 2), (0, 1)))
    np.testing.assert_allclose(total, egg.mask, atol=1e-12)
    sizes = [len(zone.points) for zone in zones]
    assert len(zones) > 8 and max(sizes) < 3 * min(sizes)
    assert count.max() >= 4  # where corners meet


def test_zones_are_cells_of_the_whole_around_their_points(egg):
    whole = cells_of(egg)
    for zone in cut_up(egg):
        points = egg.points[zone.points]
        for axis, plane in enumerate(zone.cells.planes):
            assert np.isin(plane, whole.planes[axis]).all()
            assert plane[0] - 1e-9 < points[:, axis].min() and points[:, axis].max() < plane[-1] + 1e-9
        at = [
            np.searchsorted(plane[1:-1], x, side="right") for plane, x in zip(zone.cells.planes, points.T, strict=True)
        ]
        counts = np.zeros(zone.cells.cells.shape, int)
        np.add.at(counts, tuple(at), 1)
        np.testing.assert_array_equal(zone.cells.cells, counts > 0)


def test_neighbours_share_as_many_cells_as_asked(egg):
    points = grid(30, 8, 8, spacing=SPACING)
    bar = waves(points, 1e-6 * np.ones((1, len(points), 3), complex), bulk=2e5, poisson=None)
    for overlap in (0, 1, 2, 3):
        planes = [zone.cells.planes[0] for zone in cut_up(bar, 5, overlap)]
        shared = [len(np.intersect1d(a, b)) - 1 for a, b in pairwise(planes)]
        assert shared == [overlap] * (len(planes) - 1) and len(planes) >= 3
        assert planes[0][0] == 0 and planes[-1][-1] == points[:, 0].max()


def test_shares_fall_to_nothing_at_cut_faces_and_are_whole_elsewhere(egg):
    whole, faces = cells_of(egg), 0
    for zone in cut_up(egg):
        points = egg.points[zone.points]
        others = egg.points[np.setdiff1d(np.flatnonzero(egg.mask), zone.points)]
        low, high = (np.array([plane[i] for plane in zone.cells.planes]) for i in (0, -1))
        for i in range(3):
            beside = np.delete((others > low) & (others < high), i, axis=1).all(axis=1)
            if np.any(beside & (others[:, i] > high[i])):
                at_face = high[i] - points[:, i] < SPACING
                assert zone.share[at_face].max() < 0.2
                faces += 1
        margin = OVERLAP * np.array([plane[1] for plane in whole.planes]) + 1e-9
        deep = np.all((points > low + margin) & (points < high - margin), axis=1)
        np.testing.assert_allclose(zone.share[deep], 1)
    assert faces > 8


def test_a_point_that_others_leave_out_is_all_of_its_zone():
    """A point on the face of a zone whose neighbour has only a small piece there."""
    points = grid(21, 8, 8, spacing=SPACING)
    column = np.round(points[:, 0] / SPACING).astype(int)
    rod = (column < 12) & np.all(points[:, 1:] < 3 * SPACING, axis=1)
    mask = (column < 8) | rod | (column > 13)
    data = waves(points, 1e-6 * np.ones((1, len(points), 3), complex), bulk=2e5, poisson=None, mask=mask)
    zones = cut_up(data, 7, 2)
    assert [column[zone.points].max() for zone in zones] == [10, 20] and column[zones[1].points].min() == 14
    total = np.zeros(len(points))
    for zone in zones:
        total[zone.points] += zone.share
    known = np.concatenate([zone.points for zone in zones])
    assert np.isfinite(total).all() and np.allclose(total[known], 1)


def test_without_overlap_zones_share_faces_alone(egg):
    count = np.zeros(len(egg.points), int)
    for zone in cut_up(egg, overlap=0):
        count[zone.points] += 1
        inner = [
            np.abs(x[:, None] - plane).min(axis=1) > 1e-6
            for x, plane in zip(egg.points[zone.points].T, zone.cells.planes, strict=True)
        ]
        assert np.all(zone.share[np.all(inner, axis=0)] == 1)
    assert np.array_equal(count > 0, egg.mask)


def test_a_piece_of_few_points_is_in_no_zone():
    points = grid(30, 8, 8, spacing=SPACING)
    column = np.round(points[:, 0] / SPACING).astype(int)
    mask = (column < 20) | (column > 26)  # 7 x 8 x 8 on one side, 3 x 8 x 8 on the other
    data = waves(points, 1e-6 * np.ones((1, len(points), 3), complex), bulk=2e5, poisson=None, mask=mask)
    kept = np.concatenate([zone.points for zone in cut_up(data, 100, 0)])
    assert 3 * 8 * 8 < FEWEST < 20 * 8 * 8 and column[kept].max() == 19
    assert not cut_up(replace(data, mask=column > 26, dirichlet=None), 100, 0)
    cube = np.all(points < 6 * SPACING - 1e-9, axis=1)  # 6 x 6 x 6: no spline can be laid through so few
    assert cube.sum() == FEWEST and not cut_up(replace(data, mask=cube, dirichlet=None), 100, 0)


def test_scattered_points(rng, egg):
    points = rng.random((4000, 3)) * 0.04
    data = waves(points, 1e-6 * np.ones((1, 4000, 3), complex), bulk=2e5, poisson=None)
    zones = cut_up(data, 8, 3)
    own, chosen = zone_data(data, zones[0])
    assert len(zones) == 8 and np.array_equal(chosen, zones[0].points) and own.mask.all()


def test_data_of_a_zone_are_a_grid_with_the_noise_of_all():
    points = grid(20, 8, 8, spacing=SPACING)
    u = shear_waves(points, 2500 + 500j)[None] * (1 + 100 * points[None, :, :1])
    data = waves(points, u, bulk=2e5, poisson=None, labels=np.arange(len(points)) % 3)
    zone = cut_up(data)[1]
    own, chosen = zone_data(data, zone)
    assert own.grid and own.grid.shape[1:] == (8, 8) and own.loads == 1
    np.testing.assert_array_equal(own.displacement, u[:, chosen])
    np.testing.assert_array_equal(own.labels, chosen % 3)
    np.testing.assert_array_equal(np.sort(chosen[own.mask]), zone.points)
    np.testing.assert_allclose(noise_deviation(own, 0.02), noise_deviation(data, 0.02))


def test_what_zones_agree_on_is_joined_unchanged_and_the_rest_by_shares(egg):
    zones = cut_up(egg)
    n, truth = len(egg.points), egg.points @ [1.0, 2.0, 3.0]
    values = [truth[zone.points] for zone in zones]
    np.testing.assert_allclose(merge_values(zones, values, n), np.where(egg.mask, truth, np.nan))
    assert disagreement(zones, values, n) < 1e-9
    values[0] = values[0] + 0.1
    off = merge_values(zones, values, n)[zones[0].points] - truth[zones[0].points]
    np.testing.assert_allclose(off, 0.1 * zones[0].share, atol=1e-12)
    values[0][:] = np.nan  # left to the others
    left = merge_values(zones, values, n)[zones[0].points]
    assert np.isnan(left[zones[0].share > 1 - 1e-9]).all() and np.isfinite(left[zones[0].share < 0.9]).all()


def test_disagreement_is_the_rms_difference_of_pairs():
    points = grid(20, 8, 8, spacing=SPACING)
    data = waves(points, 1e-6 * np.ones((1, len(points), 3), complex), bulk=2e5, poisson=None)
    zones = cut_up(data)
    assert len(zones) == 2
    values = [np.zeros(len(zones[0].points)), np.full(len(zones[1].points), 0.3)]
    assert disagreement(zones, values, len(points)) == pytest.approx(0.3)
