"""Outlines of labels: horns keep their volume; specks and parts that are too close are left out and reported."""

import numpy as np
import pytest
from phantoms import MM, grid

from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume
from ngbrain.mesh.geometry.level_set import LevelSet
from ngbrain.mesh.surface.head_outlines import AROUND, MARGIN, SMOOTHING, WALL, Repair, excessive, outlines
from ngbrain.mesh.surface.remeshing import SPECK


@pytest.fixture(scope="module")
def horned():
    """A ventricle (a ball of 10 mm radius with a horn of 2 mm) in a head of 40 mm, with a speck and an island."""
    points, affine = grid(46)
    x, y, z = np.moveaxis(points, -1, 0)
    away = np.linalg.norm(points - np.array([-12.0, 0, 0]), axis=-1)
    sheet = (x > -4) & (x < 22) & (np.abs(y) < 6) & (np.abs(z - 0.5) < 1)
    numbers = np.where(np.linalg.norm(points, axis=-1) < 40, 1, 0)
    numbers[(away < 10) | sheet] = 2
    numbers[(np.abs(points - np.array([0, 25, 0])) < 1.2).all(axis=-1) & (z > 0)] = 2
    numbers[(np.abs(points - np.array([44, 44, 44])) < 2.2).all(axis=-1)] = 1
    return LabelMap(Volume(numbers, affine), {1: "grey", 2: "ventricles"})


def volume_beyond(level, x):
    grid = level.origin + level.spacing * np.moveaxis(np.indices(level.values.shape), 0, -1)
    return 1e6 * ((level.values < 0) & (grid[..., 0] > x)).sum() * level.spacing**3


def test_a_thin_horn_keeps_its_volume_and_the_rest_its_own(horned):
    mask = horned.volume.data == 2
    origin = horned.volume.affine[:3, 3]
    wanted = 1e-3 * (mask & (np.indices(mask.shape)[0] * MM + origin[0] > 4 * MM)).sum()
    whole, local = (LevelSet.of(mask, origin, MM, SMOOTHING, MARGIN, around) for around in (0.0, AROUND))
    print(wanted, volume_beyond(whole, 4 * MM), volume_beyond(local, 4 * MM))
    assert volume_beyond(whole, 4 * MM) < 0.1 * wanted  # lost, and the ball is that much thicker
    assert volume_beyond(local, 4 * MM) == pytest.approx(wanted, rel=0.1)
    assert (whole.values < 0).sum() == (local.values < 0).sum() == mask.sum()


def test_what_is_left_out_is_told_with_its_place(horned):
    found = outlines(horned)
    assert set(found.inner) == {"ventricles"}
    kinds = {(repair.region, repair.kind): repair for repair in found.repairs}
    island, speck = kinds["brain", "left out"], kinds["ventricles", "left out"]
    assert len(found.repairs) == 2 and speck.ml < 1e6 * SPECK
    assert island.ml == pytest.approx(0.125) and np.array(island.at) == pytest.approx(44 * MM * np.ones(3), abs=MM)
    assert np.array(speck.at) == pytest.approx(np.array([0, 25, 1]) * MM, abs=MM)


def test_a_ventricle_at_the_surface_is_cut_and_it_is_told():
    points, affine = grid(46)
    beside = np.linalg.norm(points - np.array([30.0, 0, 0]), axis=-1)
    numbers = np.where(np.linalg.norm(points, axis=-1) < 40, np.where(beside < 12, 2, 1), 0)
    found = outlines(LabelMap(Volume(numbers, affine), {1: "grey", 2: "ventricles"}))
    (cut,) = found.repairs
    assert (cut.region, cut.kind) == ("ventricles", "cut")
    assert np.linalg.norm(cut.at) > 36 * MM and 0.5 < cut.ml < 2
    ventricles = found.ventricles
    inside = np.argwhere(ventricles.values < 0) * ventricles.spacing + ventricles.origin
    assert found.brain(inside).max() < -WALL + 1e-6
    assert excessive(found.repairs, {"ventricles": 6.0}) == {"ventricles": cut.ml}


def test_small_changes_are_passed_over_and_large_ones_are_not():
    at = (0.0, 0.0, 0.0)
    volumes = {"ventricles": 30.0, "brain": 1000.0, "lesion": 100.0}
    few = [
        Repair("ventricles", "cut", 0.1, at),
        Repair("ventricles", "closed", 0.09, at),
        Repair("brain", "cut", 9, at),
    ]
    assert excessive(few, volumes) == {}
    more = [
        Repair("ventricles", "left out", 0.02, at),
        Repair("brain", "left out", 2, at),
        Repair("lesion", "cut", 0.3, at),
    ]
    assert set(excessive([*few, *more], volumes)) == {"ventricles", "brain", "lesion"}
    assert excessive([Repair("ventricles", "left out", 0.05, at)], {"brain": 900.0}) == {"ventricles": 0.05}
