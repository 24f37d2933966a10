"""A real head with its skull, Colin27: brain mask against two other programs, tissues, and copies of lower quality."""

import time

import numpy as np
import pytest
from colin import colin27, cropped, dice, masks, rician, seen, slow_field, tilted
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image import Volume, find_brain, mni152
from ngbrain.image.preprocess.bias_field import correct_bias_field
from ngbrain.image.preprocess.registration import align
from ngbrain.image.preprocess.skull_strip import skull_strip
from ngbrain.image.segment.tissue_classes import CSF, GREY, VENTRICLE, WHITE, segment

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def scan():
    return colin27()


@pytest.fixture(scope="module")
def brain(scan):
    return find_brain(scan)


@pytest.fixture(scope="module")
def tissue(scan, brain):
    return segment(correct_bias_field(scan.volume, brain), brain, place(scan.volume, brain))


def place(volume, brain):
    """Alignment of the template with a brain."""
    return align(Volume(np.where(brain, volume.data, 0), volume.affine), mni152().volume).affine


def without_ventricles(labels):
    return np.where(labels == VENTRICLE, CSF, labels)


def overlap(heads, found, brain, turn=None):
    """Dice of a mask found in a copy of the head with the head's own."""
    at = heads[0].volume.to_world(np.argwhere(np.ones_like(brain)))
    if turn is not None:
        at = at @ turn[:3, :3].T + turn[:3, 3]
    return dice(
        Volume(found.astype(np.uint8), heads[1].volume.affine).interpolate(at, order=0).reshape(brain.shape) > 0.5,
        brain,
    )


@pytest.mark.parametrize("program", ["deepbet", "robex"])
def test_the_brain_is_that_of_other_programs(brain, program):
    theirs = masks()
    print(f"Dice with {program} {dice(brain, theirs[program]):.4f}; theirs {dice(*theirs.values()):.4f}")
    assert dice(brain, theirs[program]) > 0.97


def test_the_brain_is_one_piece_without_holes(brain):
    assert ndimage.label(brain)[1] == 1 and np.array_equal(ndimage.binary_fill_holes(brain), brain)


def test_volumes_are_those_of_an_adult(tissue):
    ml = tissue.volumes_ml()
    print({name: round(value) for name, value in ml.items()})
    assert 150 < ml["csf"] < 350 and 880 < ml["grey"] < 1000 and 670 < ml["white"] < 760
    assert 15 < ml["ventricle"] < 30


@pytest.mark.slow
def test_tissue_under_noise_and_a_field(tissue, rng):
    # Colin27's own labels at the means that they have in the scan, white matter 1; Rician noise of 5 %, a field of 20 %.
    truth = tissue.volume.data
    clean = ndimage.gaussian_filter(np.array([0, 0.44, 0.76, 1, 0.44])[truth], 0.5) * slow_field(truth.shape, 0.2)
    image = np.where(truth > 0, rician(clean, 0.05, rng), 0).astype(np.float32)
    begun = time.process_time()
    even = correct_bias_field(Volume(image, tissue.volume.affine), truth > 0)
    found = segment(even, truth > 0, place(even, truth > 0)).volume.data
    found, truth = without_ventricles(found), without_ventricles(truth)
    scores = {name: dice(found == tissue, truth == tissue) for name, tissue in (("grey", GREY), ("white", WHITE))}
    print({name: round(score, 4) for name, score in scores.items()}, f"in {time.process_time() - begun:.0f} s")
    assert min(scores.values()) > 0.95


@pytest.mark.slow
@pytest.mark.parametrize(("degrees", "axis"), [(25, (1, 0, 0)), (-25, (1, 0, 0)), (25, (1, 2, 0.5))])
def test_a_tilted_head(scan, brain, degrees, axis):
    copy, turn = tilted(scan.volume, degrees, axis)
    score = overlap((scan, copy), skull_strip(copy), brain, turn)
    print(f"Dice {score:.4f}")
    assert score > 0.985


def worse(kind, volume, rng):
    data, affine = volume.data, volume.affine
    if kind == "noise":
        return seen(rician(data, 6.5, rng), affine)  # 5 % of white matter and more
    if kind == "field":
        return seen(data * slow_field(data.shape, 0.2), affine)
    if kind == "field and noise":
        return seen(rician(data * slow_field(data.shape, 0.4), 6.5, rng), affine)
    if kind == "surface coil":  # three times as bright in front as behind
        return seen(data * (0.6 + 1.2 * np.linspace(0, 1, data.shape[1])[:, None] ** 2), affine)
    if kind == "thick":
        affine = affine @ np.diag([1, 1, 3.0, 1])
        affine[:3, 3] += [0, 0, 1e-3]
        return seen(data[:, :, :180].reshape(181, 217, 60, 3).mean(axis=3), affine)
    if kind == "fine":
        affine = affine @ np.diag([0.5, 0.5, 0.5, 1])
        affine[:3, 3] -= 0.25e-3
        return seen(ndimage.zoom(data, 2, order=1, grid_mode=True, mode="grid-constant"), affine)
    if kind == "no face":
        data = data.copy()
        data[:, 168:, :40] = 0
        return seen(data, affine)
    return cropped(volume, (8, 172), (12, 202), (6, 181))


KINDS = ("noise", "field", "field and noise", "surface coil", "thick", "fine", "no face", "cropped")


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_worse_picture_of_the_head(scan, brain, rng, kind):
    copy = worse(kind, scan.volume, rng)
    score = overlap((scan, copy), skull_strip(copy), brain)
    print(f"Dice {score:.4f}")
    assert score > 0.985


@pytest.mark.slow
@pytest.mark.parametrize(
    ("side", "ranges"),
    [
        ("top", ((0, 181), (0, 217), (0, 140))),
        ("front", ((0, 181), (0, 185), (0, 181))),
        ("left", ((30, 181), (0, 217), (0, 181))),
        ("bottom", ((0, 181), (0, 217), (25, 181))),
    ],
)
def test_a_brain_cut_by_the_field_of_view_is_refused(scan, side, ranges):
    with pytest.raises(InputError, match=f"image is cut off at the {side} of the brain; wanted: the whole brain"):
        find_brain(cropped(scan.volume, *ranges))
