"""A thin horn. Naive: one level for the whole smoothed outline leaves specks. Ours: volume kept from place to place."""

import numpy as np
import pytest
from scipy import ndimage

from ngbrain.mesh.geometry.level_set import LevelSet
from ngbrain.mesh.surface.head_outlines import AROUND, MARGIN, SMOOTHING
from ngbrain.mesh.surface.remeshing import SPECK, remesh_surface

VOXEL = 1e-3
ORIGIN = -15 * VOXEL
HORN = 12e-3
"""Where (m) the horn is clear of the ball."""


@pytest.fixture(scope="module")
def horned():
    """A ball of 10 mm with a horn of 6 mm by 1 to 3 mm, 46 mm long."""
    x, y, z = ORIGIN + VOXEL * np.indices((65, 31, 31))
    thick = 1e-3 + 0.6e-3 * np.sin(2 * np.pi * x / 10e-3)
    horn = (x > 0) & (x < 46e-3) & (np.abs(y) < 3e-3) & (np.abs(z - 0.1e-3) < thick)
    return (x**2 + y**2 + z**2 < 10e-3**2) | horn


def outline(horned, around):
    """The outline, volumes (m³) of its pieces, the smallest first, and the part of the horn's volume that is left."""
    level = LevelSet.of(horned, np.full(3, ORIGIN), VOXEL, SMOOTHING, MARGIN, around)
    pieces, _ = ndimage.label(level.values < 0)
    first = round((HORN - level.origin[0]) / VOXEL)
    left = (level.values[first:] < 0).sum() / horned[round((HORN - ORIGIN) / VOXEL) :].sum()
    print(np.sort(np.bincount(pieces.ravel())[1:]), "mm³,", f"{left:.0%} of the horn")
    return level, np.sort(np.bincount(pieces.ravel())[1:]) * VOXEL**3, left


def test_naive_smoothing_makes_specks_of_the_horn(horned):
    _, pieces, left = outline(horned, 0.0)
    assert len(pieces) >= 3 and (pieces[:-1] < 2 * SPECK).all()
    assert left < 0.2


def test_ours_keeps_it_in_one_piece_that_closes(horned):
    level, pieces, left = outline(horned, AROUND)
    assert len(pieces) == 1 and left > 0.9
    surface = remesh_surface(level, lambda points: np.full(len(points), 5e-3), np.zeros((0, 3)))
    assert np.abs(surface.changed[:, 3]).sum() < SPECK
    assert surface.points[:, 0].max() > 42e-3
