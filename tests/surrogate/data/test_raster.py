"""From grid points to square cells and back, and squares that cover the measured points."""

from dataclasses import replace

import numpy as np
import pytest
from planewaves import grid

from ngbrain.errors import InputError
from ngbrain.io.waves import WaveData
from ngbrain.surrogate.data.raster import Raster, squares


def data(points, **changes):
    x, y = points.T[:2]
    u = 1e-5 * np.stack([np.sin(60 * x + 20 * y), np.cos(50 * y), 0 * x], axis=1)[None, :, : points.shape[1]]
    return WaveData(points, u, [50.0], 1000.0, "isotropic", "elastic", poisson=0.4, **changes)


def test_square_cells_are_taken_as_they_are():
    given = data(grid(30, 27))
    raster = Raster.from_data(given)
    assert raster.displacement.shape == (1, 27, 30, 2) and not raster.notes and raster.counts.all()
    np.testing.assert_array_equal(raster.displacement[0].reshape(-1, 2), given.displacement[0])
    np.testing.assert_array_equal(
        raster.interpolate_to_points(raster.displacement[0, ..., 1].real), given.displacement[0, :, 1].real
    )


def test_other_cells_are_resampled_and_said_to_be():
    fine, coarse = grid(40, 59), grid(40, 30) * [1, 2]
    raster = Raster.from_data(data(coarse))
    assert raster.displacement.shape == (1, 59, 40, 2)
    assert "2 × 4 mm are not square" in raster.notes[0] and "40 × 59" in raster.notes[0]
    exact = data(fine).displacement.reshape(1, 59, 40, 2)
    assert np.abs(raster.displacement - exact).max() < 1e-4 * np.abs(exact).max()
    back = raster.interpolate_to_points(raster.displacement[0, ..., 0].real)
    np.testing.assert_allclose(back, data(coarse).displacement[0, :, 0].real, atol=1e-12)


def test_gaps_stay_gaps():
    points = grid(40, 30) * [1, 2]
    given = data(points, mask=~((np.abs(points - [0.04, 0.06]) < 1e-3).all(axis=1)))
    raster = Raster.from_data(given)
    assert not raster.counts[0, 30, 20].any() and 0.9 < raster.counts.mean() < 1
    exact = data(grid(40, 59)).displacement.reshape(1, 59, 40, 2)
    off = np.where(raster.counts, np.abs(raster.displacement - exact), 0)
    assert off.max() < 2e-3 * np.abs(exact).max()


def test_components_turn_with_the_grid():
    """Rows along y and columns along -x, as images may be stored."""
    plain = data(grid(30, 27))
    order = np.arange(810).reshape(27, 30)[:, ::-1].T.ravel()  # y first, then x from its end
    turned = replace(
        plain, points=plain.points[order], displacement=plain.displacement[:, order], dirichlet=None, mask=None
    )
    raster = Raster.from_data(turned)
    np.testing.assert_allclose(raster.axes, [[0, 1], [-1, 0]], atol=1e-12)
    exact = plain.displacement.reshape(27, 30, 2)[:, ::-1].swapaxes(0, 1)[..., ::-1] * [1, -1]
    np.testing.assert_allclose(raster.displacement[0], exact, atol=1e-20)


def test_a_component_that_is_not_measured_does_not_spoil_the_other():
    plain = data(grid(30, 27))
    axial = replace(plain, displacement=plain.displacement * [np.nan, 1])
    raster = Raster.from_data(axial)
    assert raster.counts[..., 1].all() and not raster.counts[..., 0].any()
    turned = raster.transpose()
    assert turned.counts[..., 0].all() and turned.displacement.shape == (1, 30, 27, 2)
    np.testing.assert_array_equal(
        turned.interpolate_to_points(turned.displacement[0, ..., 0].real), plain.displacement[0, :, 1].real
    )
    flipped = raster.flip()
    np.testing.assert_array_equal(
        flipped.interpolate_to_points(flipped.displacement[0, ..., 1].real), plain.displacement[0, :, 1].real
    )


def test_a_layer_in_space_is_a_plane_and_a_volume_is_none():
    flat = np.column_stack([grid(30, 27), np.full(810, 0.02)])
    assert Raster.from_data(data(flat, dirichlet=np.zeros(810, bool))).displacement.shape == (1, 27, 30, 2)
    with pytest.raises(InputError, match="in space"):
        Raster.from_data(data(grid(9, 8, 8)))
    with pytest.raises(InputError, match="no grid"):
        Raster.from_data(data(np.random.default_rng(0).uniform(0, 0.1, (500, 2))))


def covered(counts, **options):
    seen = np.zeros(counts.shape, int)
    for i, j, n in squares(counts, **options):
        seen[i : i + n, j : j + n] += 1
    return seen


def test_squares_cover_a_disc_and_nothing_else():
    y, x = np.mgrid[-1:1:121j, -1:1:121j]
    disc = x**2 + y**2 < 0.9
    seen = covered(disc)
    assert not seen[~disc].any() and (seen[disc] > 0).mean() > 0.85


def test_squares_of_a_strip_lie_half_over_one_another():
    assert squares(np.ones((40, 40), bool)) == [(0, 0, 40)]
    seen = covered(np.ones((30, 100), bool))
    assert seen.all() and (seen > 1).mean() > 0.6
    assert {n for *_, n in squares(np.ones((60, 100), bool), most=35.0)} == {35}
    assert squares(np.ones((60, 60), bool), most=35.0) == [(0, 0, 60)]  # one that is whole stays so


def test_too_few_points():
    with pytest.raises(InputError, match="25 × 25"):
        squares(np.ones((25, 80), bool))
