"""Structures of MNI152 (every second voxel, to be quick) and of Colin27, and of copies: sides, sizes, places, refusals."""

import numpy as np
import pytest
from colin import colin27, dice, seen, tilted
from resampled_scans import rotation
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image import Volume, mni152
from ngbrain.image.labelling import label_structures, label_tissues
from ngbrain.image.segment.tissue_classes import CSF, GREY, VENTRICLE, WHITE
from ngbrain.image.structures.midsurface import MidSurface
from ngbrain.image.structures.structures import CEREBELLUM, LEFT, PARTS, RIGHT, segment_structures


@pytest.fixture(scope="module")
def coarse():
    """T1 and tissues of the template on voxels of 2 mm."""
    scan = mni152()
    every = (slice(None, None, 2),) * 3
    affine = scan.volume.affine @ np.diag([2, 2, 2, 1.0])
    return Volume(scan.volume.data[every].copy(), affine), Volume(label_tissues(scan).volume.data[every].copy(), affine)


@pytest.fixture(scope="module")
def found(coarse):
    return segment_structures(*coarse)


def region(found, *names):
    return np.isin(found.labels.volume.data, [number for number, name in found.labels.names.items() if name in names])


def shares(found):
    """Shares of cerebrum, cerebellum and stem in grey and white matter."""
    ml = found.labels.volumes_ml()
    matter = {name: value for name, value in ml.items() if name not in ("csf", "ventricles")}
    total = sum(matter.values())
    little = sum(value for name, value in matter.items() if name.endswith("cerebellum")) / total
    return 1 - little - matter["brain_stem"] / total, little, matter["brain_stem"] / total


def test_shares_are_those_of_weighed_brains(found):
    # Azevedo et al. 2009, doi:10.1002/cne.21974: cerebral cortex with its white matter 81.8 %, cerebellum 10.2 %, and
    # 7.8 % for the rest, of which the stem is about a fifth to a third.
    cerebrum, cerebellum, stem = shares(found)
    assert 0.818 < cerebrum < 0.90 and 0.09 < cerebellum < 0.125 and 0.013 < stem < 0.026


def test_no_tissue_is_lost(coarse, found):
    old = coarse[1].data
    assert np.array_equal(region(found, "csf"), old == CSF) and np.array_equal(
        region(found, "ventricles"), old == VENTRICLE
    )
    assert np.array_equal(found.labels.volume.data > 0, old > 0) and np.array_equal(found.parts.data > 0, old > 0)
    whites = region(found, "white_left", "white_right", "white_cerebellum", "corpus_callosum")
    assert (old[whites] == WHITE).all()
    assert (old[region(found, "grey_left", "grey_right", "grey_cerebellum")] == GREY).all()


# Centres of regions in the atlas of Tzourio-Mazoyer et al. 2002, and points of the midbrain, pons and medulla.
PLACES = {
    "deep_grey_left": [(-11, -18, 8), (-24, 4, 2), (-12, 11, 9), (-18, 0, 0)],
    "deep_grey_right": [(13, -18, 8), (28, 5, 2), (15, 12, 9), (21, 0, 0)],
    "brain_stem": [(6, -29, -12), (-6, -29, -12), (0, -24, -30), (6, -26, -36), (0, -40, -56)],
    "corpus_callosum": [(0, 0, 27), (4, 28, 8), (-4, -37, 14)],
}
SIDES = {
    LEFT: [(-39, -6, 51), (-6, -80, 27), (-36, -78, -8), (-50, -28, -23), (-33, -40, -20), (-16, -68, -5)],
    RIGHT: [(41, -8, 52), (15, -79, 28), (38, -82, -8), (54, -31, -22), (34, -39, -20), (16, -67, -4)],
    CEREBELLUM: [(-36, -67, -29), (38, -67, -30), (-23, -59, -22), (25, -58, -24), (1, -52, -7), (1, -58, -25)],
}


def at(volume, points):
    return volume.interpolate(1e-3 * np.array(points, float), order=0)


def test_known_places(found):
    numbers = {name: number for number, name in found.labels.names.items()}
    for name, points in PLACES.items():
        here = [
            at(Volume((found.labels.volume.data == numbers[name]).astype(float), found.parts.affine), [p])
            for p in points
        ]
        assert np.all(here), (name, here)
    for part, points in SIDES.items():
        assert (at(found.parts, points) == part).all(), (PARTS[part], at(found.parts, points))


def test_parts_hang_together(found):
    for part in PARTS:
        assert ndimage.label(found.parts.data == part)[1] == 1
    for name in ("corpus_callosum", "deep_grey_left", "deep_grey_right"):
        assert ndimage.label(region(found, name))[1] == 1, name
    pieces = np.bincount(ndimage.label(region(found, "brain_stem"))[0].ravel())[1:]
    assert (
        pieces.max() > 0.999 * pieces.sum()
    )  # single voxels of tissue, in every other voxel, may stand alone in fluid


def test_left_is_where_the_affine_says(found):
    for name in ("grey", "white", "deep_grey"):
        for side, sign in (("left", -1), ("right", 1)):
            x = found.parts.to_world(np.argwhere(region(found, f"{name}_{side}")))[:, 0]
            assert (sign * x > -2.5e-3).all() and sign * x.mean() > 0.01


def hurt(coarse):
    """The brain with a hole in the left frontal lobe."""
    t1, tissue = coarse
    points = 1e3 * t1.to_world(np.argwhere(np.ones(t1.data.shape))).reshape(*t1.data.shape, 3)
    hole = (np.linalg.norm(points - [-35, 30, 25], axis=-1) < 14) & (tissue.data > 0)
    return np.where(hole, 0.3 * t1.data.max(), t1.data).astype(np.float32), np.where(hole, CSF, tissue.data)


@pytest.mark.slow
def test_of_a_mirrored_person_the_sides_are_swapped(coarse):
    t1, tissue = hurt(coarse)
    affine = coarse[0].affine
    one = segment_structures(Volume(t1, affine), Volume(tissue, affine)).labels.volumes_ml()
    mirror = np.diag([-1, 1, 1, 1.0]) @ affine
    other = segment_structures(Volume(t1, mirror), Volume(tissue, mirror)).labels.volumes_ml()
    assert one["white_left"] < 0.99 * one["white_right"]
    for name, ml in one.items():
        swapped = name.replace("left", "#").replace("right", "left").replace("#", "right")
        assert other[swapped] == pytest.approx(ml, rel=0.06), name  # floods in ties go another way round


@pytest.mark.slow
def test_flipped_voxels_and_a_turned_head_give_the_same_structures(coarse, found):
    t1, tissue = coarse
    flip = np.diag([-1, 1, 1, 1.0])
    flip[0, 3] = t1.data.shape[0] - 1
    same = segment_structures(
        Volume(t1.data[::-1].copy(), t1.affine @ flip), Volume(tissue.data[::-1].copy(), t1.affine @ flip)
    )
    assert min(dice(same.parts.data[::-1] == part, found.parts.data == part) for part in PARTS) > 0.98
    turn = np.eye(4)
    turn[:3, :3] = rotation(20, np.array([1, 0.4, 0.3]))
    turned = segment_structures(Volume(t1.data, turn @ t1.affine), Volume(tissue.data, turn @ t1.affine))
    assert min(dice(turned.parts.data == part, found.parts.data == part) for part in PARTS) > 0.98


def test_the_middle_follows_a_bent_fissure():
    points = 1e3 * 2e-3 * (np.indices((90, 110, 90)).reshape(3, -1).T - [45, 55, 45])
    bent = 2 + 0.05 * points[:, 1] + 1.5 * np.sin(points[:, 2] / 15)
    inside = np.linalg.norm(points / [65, 85, 60], axis=1) < 1
    picture = np.where(np.abs(points[:, 0] - bent) < 2, 0.3, 1.0) * inside
    affine = np.diag([2e-3, 2e-3, 2e-3, 1])
    affine[:3, 3] = -2e-3 * np.array([45, 55, 45])
    middle = MidSurface.fit(Volume(picture.reshape(90, 110, 90).astype(np.float32), affine), np.eye(4))
    deep = np.linalg.norm(points / [65, 85, 60], axis=1) < 0.8
    off = middle.right_of(points[deep]) - (points[deep, 0] - bent[deep])
    assert np.sqrt((off**2).mean()) < 0.6


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t1, tissue: (t1, Volume(tissue.data[1:], tissue.affine)), "tissues is on"),
        (lambda t1, tissue: (t1, Volume(np.minimum(tissue.data, CSF), tissue.affine)), "tissues is without grey"),
        (
            lambda t1, tissue: (Volume(1 + 0.1 * np.random.default_rng(1).random(t1.data.shape), t1.affine), tissue),
            "unlike the MNI152 template",
        ),
    ],
)
def test_refusals(coarse, change, words):
    with pytest.raises(InputError, match=words):
        segment_structures(*change(*coarse))


@pytest.fixture(scope="module")
def colin():
    return colin27()


@pytest.mark.slow
def test_colin27_has_the_volumes_of_an_adult(colin):
    made = label_structures(colin)
    cerebrum, cerebellum, stem = shares(made)
    ml = made.labels.volumes_ml()
    print({name: round(value, 1) for name, value in ml.items()})
    assert 0.818 < cerebrum < 0.90 and 0.09 < cerebellum < 0.125 and 0.013 < stem < 0.026
    for name in ("grey", "white", "deep_grey"):
        assert ml[f"{name}_left"] == pytest.approx(ml[f"{name}_right"], rel=0.06)
    assert all(ndimage.label(made.parts.data == part)[1] == 1 for part in PARTS)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["tilted", "flipped"])
def test_colin27_in_another_place(colin, kind):
    made = label_structures(colin)
    if kind == "tilted":
        copy, turn = tilted(colin.volume, 25, (1, 2, 0.5))
    else:
        flip = np.diag([-1, -1, 1, 1.0])
        flip[:2, 3] = np.array(colin.volume.data.shape[:2]) - 1
        copy, turn = seen(colin.volume.data[::-1, ::-1], colin.volume.affine @ flip), np.eye(4)
    other = label_structures(copy)
    index = np.argwhere(made.parts.data > 0)
    where = made.parts.to_world(index) @ turn[:3, :3].T + turn[:3, 3]
    scores = {
        name: dice(other.parts.interpolate(where, order=0) == part, made.parts.data[tuple(index.T)] == part)
        for part, name in PARTS.items()
    }
    print({name: round(float(score), 3) for name, score in scores.items()})
    assert min(scores.values()) > 0.95
