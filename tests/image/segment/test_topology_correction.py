"""Topology correction of masks of known topology and of random ones, against counts of cells and triangles."""

import numpy as np
import pytest
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image.segment.topology_correction import NEIGHBOURS, OFFSETS, correct_topology, largest_filled_component


def away(n, centre=(0.0, 0.0, 0.0)):
    return np.indices((n, n, n)) - (n - 1) / 2 - np.reshape(centre, (3, 1, 1, 1))


def torus(n=41, ring=12.0, tube=5.0):
    x, y, z = away(n)
    return np.hypot(np.hypot(x, y) - ring, z) < tube


def characteristic(mask):
    """χ of the complex of Kuhn's triangulation with the voxels inside as corners: of edges, triangles and tetrahedra."""
    inside = np.pad(mask, 1)
    total = int(inside.sum())
    steps = [o for o in OFFSETS if o.min() >= 0]

    def chains(at, reach, length):
        # Paths of growing steps within a cube are the simplices.
        nonlocal total
        for step in steps:
            if (reach & step).any():
                continue
            now = reach + step
            joined = at & np.roll(inside, tuple(-now), (0, 1, 2))
            total += (-1) ** length * int(joined.sum())
            chains(joined, now, length + 1)

    chains(inside, np.zeros(3, int), 1)
    return total


def pieces(mask):
    return ndimage.label(mask, NEIGHBOURS)[1]


def is_ball(mask):
    return pieces(mask) == 1 and pieces(~np.pad(mask, 1)) == 1 and characteristic(mask) == 1


def test_the_count_of_cells_knows_balls_rings_and_shells():
    x = np.linalg.norm(away(21), axis=0)
    assert characteristic(x < 8) == 1 and characteristic(torus()) == 0 and characteristic((x < 8) & (x > 4)) == 2


def test_a_ball_stays_as_it_is():
    mask = np.linalg.norm(away(31), axis=0) < 12.3
    assert np.array_equal(correct_topology(mask), mask)


def test_a_ring_is_cut_once_by_few_voxels():
    mask = torus()
    found = correct_topology(mask)
    left = (mask & ~found).sum()
    print(mask.sum(), left)
    assert is_ball(found) and not (found & ~mask).any()
    assert left < 1.6 * np.pi * 5**2  # a slice of the tube has π 5² voxels


def test_a_thin_handle_is_cut_where_it_is_thin():
    x, y, z = away(41)
    mask = (np.linalg.norm(away(41), axis=0) < 10) | ((np.abs(x) < 1) & (np.abs(np.hypot(y, z - 10) - 7) < 1))
    assert characteristic(mask) == 0
    found = correct_topology(mask)
    assert is_ball(found) and (mask & ~found).sum() <= 4


@pytest.mark.parametrize("fault", ["tunnel", "cavity", "island", "shell"])
def test_faults_of_a_ball(fault):
    r = np.linalg.norm(away(31), axis=0)
    x, y, _ = away(31)
    whole = r < 12
    mask = {
        "tunnel": whole & (np.hypot(x, y) > 1.5),
        "cavity": whole & (r > 3),
        "island": whole | (np.linalg.norm(away(31, (13, 13, 13)), axis=0) < 1.5),
        "shell": whole & (r > 9.8),
    }[fault]
    found = correct_topology(mask)
    print(fault, mask.sum(), found.sum())
    assert is_ball(found)
    if fault == "tunnel":
        assert 0 < (mask & ~found).sum() < 12 * 24
    else:
        assert np.array_equal(found, whole)


@pytest.mark.parametrize("seed", range(3))
def test_random_masks_become_balls(seed):
    noise = ndimage.gaussian_filter(np.random.default_rng(seed).random((30, 32, 34)), seed / 2)
    mask = noise < np.median(noise)
    found = correct_topology(mask)
    assert is_ball(found) and found.sum() > 0.4 * mask.sum() and not (found & ~largest_filled_component(mask)).any()


def test_an_empty_mask_is_refused():
    with pytest.raises(InputError, match="mask is empty; wanted: a region of at least a voxel"):
        correct_topology(np.zeros((3, 3, 3), bool))
