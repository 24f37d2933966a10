"""Betti numbers of known shapes; removal of islands and holes."""

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.image import Volume
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.segment.topology import Topology, clean_labels, remove_islands

MM = np.diag([1e-3, 1e-3, 1e-3, 1])
x, y, z = np.indices((30, 30, 30)) - 14.5
RADIUS = np.sqrt(x**2 + y**2 + z**2)
TORUS = np.hypot(np.hypot(x, y) - 9, z) < 3.5
SHAPES = {
    "ball": (RADIUS < 10, (1, 0, 0)),
    "hollow ball": ((RADIUS < 10) & (RADIUS > 5), (1, 0, 1)),
    "torus": (TORUS, (1, 1, 0)),
    "two tori": (TORUS | (np.hypot(np.hypot(y - 9, z) - 9, x) < 2), None),
    "drilled ball": ((RADIUS < 10) & (np.hypot(x, y) > 2) & (np.hypot(x, z) > 2), (1, 5 - 2, 0)),
    "to the faces of the picture": (np.ones((4, 5, 6), bool), (1, 0, 0)),
    "nothing": (np.zeros((3, 3, 3), bool), (0, 0, 0)),
}


@pytest.mark.parametrize("neighbours", [6, 26])
@pytest.mark.parametrize("name", [name for name in SHAPES if SHAPES[name][1]])
def test_known_shapes(name, neighbours):
    mask, (pieces, tunnels, cavities) = SHAPES[name]
    found = Topology.from_mask(mask, neighbours)
    assert found == Topology(pieces, tunnels, cavities)
    assert found.euler == pieces - tunnels + cavities


def test_voxels_that_share_an_edge_or_a_corner():
    for where in ((1, 1, 0), (1, 1, 1)):
        mask = np.zeros((2, 2, 2), bool)
        mask[0, 0, 0] = mask[where] = True
        assert Topology.from_mask(mask, 6) == Topology(2, 0, 0) and Topology.from_mask(mask, 26) == Topology(1, 0, 0)
    # The outside hangs together the other way round: by 26 neighbours no way leads in between the two.
    solid = np.ones((4, 4, 4), bool)
    solid[1, 1, 1] = solid[0, 0, 1] = False
    assert Topology.from_mask(solid, 6).cavities == 0 and Topology.from_mask(solid, 26).cavities == 1


def test_noise_obeys_the_sum_over_a_cut(rng):
    # χ(A ∪ B) = χ(A) + χ(B) - χ(A ∩ B), of closed cubes: the two halves meet in the cubes of one layer.
    noise = rng.random((12, 13, 14)) < 0.4
    for neighbours in (6, 26):
        whole, left, right, both = (
            Topology.from_mask(part, neighbours).euler for part in (noise, noise[:7], noise[6:], noise[6:7])
        )
        assert whole == left + right - both


def test_other_neighbours_are_refused():
    with pytest.raises(InputError, match="neighbours is 18; wanted: 6 or 26"):
        Topology.from_mask(np.ones((2, 2, 2)), 18)


def test_islands_and_holes_go_and_all_else_stays():
    data = np.where(RADIUS < 12, 1, 0).astype(np.uint8)
    data[RADIUS < 7] = 2
    clean = data.copy()
    data[14, 14, 14:16] = 0  # a hole in the white
    data[16, 16, 16] = 1  # an island of grey in it
    data[1, 1, 1] = 2  # and one of white in the air
    found, told = clean_labels(LabelMap(Volume(data, MM), {1: "grey", 2: "white"}))
    assert np.array_equal(found.volume.data, clean) and found.volume.data.dtype == np.uint8
    assert told.moved == 4
    assert told.before["white"] == Topology(2, 0, 2) and told.after["white"] == Topology(1, 0, 0)
    assert told.before["grey"].pieces == 2 and told.after["grey"] == Topology(1, 0, 1)
    again, told = clean_labels(found)
    assert told.moved == 0 and again.volume.digest() == found.volume.digest()


def test_a_hole_is_filled_and_a_cavity_stays():
    for radius, left in ((4.0, 0), (7.0, 1)):  # 0.3 and 1.4 ml
        data = ((RADIUS < 12) & (radius <= RADIUS)).astype(np.uint8)
        _, told = clean_labels(LabelMap(Volume(data, MM), {1: "grey"}))
        assert told.before["grey"].cavities == 1 and told.after["grey"].cavities == left
        assert (told.moved == 0) == bool(left)


def test_an_island_is_what_is_smaller_than_asked():
    for island, gone in ((8, False), (9, True)):
        data = np.where(RADIUS < 12, 1, 0).astype(np.uint8)
        data[14:16, 14:16, 14:16] = 2
        remove_islands(data, 2, island)
        assert (2 in data) is not gone
