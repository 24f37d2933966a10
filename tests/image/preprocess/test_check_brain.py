"""Check of a complete, skull-stripped brain: accepted and refused images, with the reason."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image import Scan, Volume, check_extracted, mni152

SIDES = ("left", "right", "back", "front", "bottom", "top")
WANTED = r"wanted: a brain-extracted T1 \(e.g. from HD-BET, SynthStrip or BET\)"


@pytest.fixture(scope="module")
def scan():
    return mni152()


@pytest.fixture(scope="module")
def coarse(scan):
    """Every other voxel of the scan, for an eighth of the work."""
    affine = scan.file_affine @ np.diag([2.0, 2.0, 2.0, 1.0])
    data = np.ascontiguousarray(scan.volume.data[::2, ::2, ::2])
    return Scan(Volume(data, affine), affine, data.shape, "case/t1.nii.gz")


def seen(data, like):
    """A scan whose file has exactly these voxels, with the affine of `like`."""
    return Scan(Volume(np.asarray(data, np.float32), like.file_affine), like.file_affine, data.shape, "case/t1.nii.gz")


def refused(scan, message):
    with pytest.raises(InputError, match=message) as caught:
        check_extracted(scan)
    assert str(caught.value).startswith("case/t1.nii.gz: image is ") and "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def head(scan):
    """MNI152's brain in bone of 6 mm and scalp of 5 mm, both of which end with the lowest slice."""
    depth = ndimage.distance_transform_edt(scan.volume.data == 0)
    data = scan.volume.data.copy()
    data[(depth > 0) & (depth <= 6)] = 0.08
    data[(depth > 6) & (depth <= 11)] = 0.9
    return data


def test_mni152_passes(scan):
    mask = check_extracted(scan)
    assert mask.dtype == bool and np.array_equal(mask, scan.volume.data != 0)
    assert mask.sum() == 1886539


def test_specks_threads_and_holes(coarse):
    data = coarse.volume.data.copy()
    inside = (slice(47, 50), slice(65, 68), slice(45, 48))
    data[inside] = 0  # a hole
    data[2:6, 2:6, 50:54] = 1  # a speck
    data[49, 50, 70:90] = 1  # a thread on top of the brain
    mask = check_extracted(seen(data, coarse))
    clean = coarse.volume.data != 0
    assert mask[inside].all() and not mask[2:6, 2:6, 50:54].any() and not mask[49, 50, 80:].any()
    assert (mask ^ clean).sum() < 10


@pytest.mark.parametrize("background", [0.0, -3.0])
def test_standardised_values_pass(coarse, background):
    # Mean 0 and spread 1 in the brain: the rim is negative, and the background not always the darkest.
    data, brain = coarse.volume.data.copy(), coarse.volume.data != 0
    data[brain] = (data[brain] - data[brain].mean()) / data[brain].std() + 1e-4
    data[~brain] = background
    assert check_extracted(seen(data, coarse)).sum() == pytest.approx(brain.sum(), rel=1e-3)


@pytest.mark.parametrize("floor", [0.0, 0.1])  # with 0.1 bone is exact background as well, and the brain lies loose
def test_a_head_with_its_skull_is_refused(head, scan, floor):
    refused(seen(np.where(head < floor, 0, head), scan), "image is a head with its skull; " + WANTED)


def test_a_noisy_background_is_refused(coarse, rng):
    noisy = np.abs(coarse.volume.data + rng.normal(scale=0.02, size=coarse.volume.data.shape))
    refused(seen(noisy, coarse), r"image is without a constant background: its commonest value, .* 0 % .*; " + WANTED)


def test_too_large_a_head_is_refused(coarse):
    grown = ndimage.grey_dilation(coarse.volume.data, size=(5, 5, 5))
    refused(seen(grown, coarse), r"image is a head of 2\.\d\d litres; " + WANTED)


def test_too_small_a_brain_is_refused(coarse):
    affine = coarse.file_affine * [0.7, 0.7, 0.7, 1]  # the same picture, but voxels of 1.4 mm
    small = Scan(Volume(coarse.volume.data, affine), affine, coarse.file_shape, "case/t1.nii.gz")
    refused(small, r"image is a brain of 0.65 litres; wanted: a whole adult brain, at least 0.7")


@pytest.mark.parametrize("side", range(6))
def test_a_brain_that_is_cut_is_refused_by_its_side(coarse, side):
    axis, far = divmod(side, 2)
    ends = np.flatnonzero((coarse.volume.data != 0).any(axis=tuple({0, 1, 2} - {axis})))[[0, -1]]
    cut = [slice(None)] * 3
    cut[axis] = slice(None, ends[1] - 9) if far else slice(ends[0] + 10, None)
    refused(
        seen(coarse.volume.data[tuple(cut)], coarse),
        f"image is cut off at the {SIDES[side]} of the brain; wanted: the whole",
    )


def test_a_brain_in_a_tight_box_is_not_cut(scan):
    tight = scan.volume.data[ndimage.find_objects((scan.volume.data != 0).astype(np.uint8))[0]]
    assert check_extracted(seen(tight, scan)).sum() == np.count_nonzero(tight)


def test_sides_are_those_of_the_file_where_it_is_slanted(coarse):
    # The file saw only what lies below a plane that falls to the right; straightening has put air above it.
    angle = np.radians(15)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    affine, shape = np.eye(4), (260, 260, 200)
    affine[:3, :3] = -1e-3 * turn  # flipped, too
    affine[:3, 3] = np.array([0, -0.018, 0.0]) - affine[:3, :3] @ [130, 130, 50]
    volume = coarse.volume
    points = volume.to_world(
        np.stack(np.meshgrid(*map(np.arange, volume.data.shape), indexing="ij"), -1).reshape(-1, 3)
    )
    third = (points - affine[:3, 3]) @ np.linalg.inv(affine[:3, :3])[2]
    data = np.where(third.reshape(volume.data.shape) < -0.5, 0, volume.data)
    slanted = replace(seen(data, coarse), file_affine=affine, file_shape=shape)
    refused(slanted, "image is cut off at the top of the brain")
    # The same picture, had the file seen all of it, is a brain with a flat top.
    check_extracted(seen(data, coarse))


def test_an_empty_picture_is_refused(coarse):
    refused(seen(np.zeros((40, 40, 40)), coarse), "a brain of 0.00 litres")
