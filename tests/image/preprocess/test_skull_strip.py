"""Skull stripping of a synthetic head with a known brain, and of images that are no head."""

import numpy as np
import pytest
from colin import dice
from resampled_scans import rotation
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image import Scan, Volume, check_extracted, find_brain, mni152
from ngbrain.image.preprocess.registration import align
from ngbrain.image.preprocess.skull_strip import skull_strip

UNLIKE = r"unlike a brain \(correlation .*, at least 0.4 needed\); wanted: a T1 of a whole head"
ALIKE = (
    "an image in which white matter is hardly brighter than grey .*; wanted: a T1, in which white matter is brightest"
)
ORDER = "an image in which .* is brightest and .* darkest; wanted: a T1, in which white matter is brightest"


def seen(data, affine):
    return Scan(Volume(data.astype(np.float32), affine), affine, data.shape, "case/t1.nii.gz")


@pytest.fixture(scope="module")
def coarse():
    """Grey values of the MNI152 brain, every other voxel, with room for a head around, and their affine."""
    volume = mni152().volume
    affine = volume.affine @ np.diag([2.0, 2.0, 2.0, 1.0])
    affine[:3, 3] -= 16e-3
    return np.pad(volume.data[::2, ::2, ::2], ((8, 8), (8, 8), (8, 8))), affine


@pytest.fixture(scope="module")
def head(coarse):
    """That brain in 3 mm of fluid, 6 mm of bone and 6 mm of scalp, on a noisy background."""
    data = coarse[0].copy()
    depth = 2 * ndimage.distance_transform_edt(data == 0)
    data[(depth > 0) & (depth <= 3)] = 0.3
    data[(depth > 3) & (depth <= 9)] = 0.08
    data[(depth > 9) & (depth <= 15)] = 1.3
    return np.abs(data + np.random.default_rng(3).normal(0, 0.03, data.shape))


@pytest.fixture(scope="module")
def found(head, coarse):
    return find_brain(seen(head, coarse[1]))


def test_the_brain_of_a_made_up_head(head, coarse, found):
    brain = coarse[0] != 0
    assert found.dtype == bool and found.shape == brain.shape
    print(f"Dice {dice(found, brain):.4f}")
    assert dice(found, brain) > 0.97
    assert ndimage.label(found)[1] == 1 and (ndimage.binary_fill_holes(found) == found).all()


@pytest.mark.slow
def test_marrow_that_thin_bone_does_not_part_stays_out(head, coarse):
    """In voxels of 2 mm, the inner table between marrow and brain is nearly as bright as grey matter."""
    brain = coarse[0] != 0
    depth = 2 * ndimage.distance_transform_edt(~brain)
    above = np.indices(brain.shape)[2] > 0.62 * brain.shape[2]
    marrow, data = above & (depth > 3) & (depth <= 8), head.copy()
    data[above & (depth > 0) & (depth <= 3)] += 0.25
    data[marrow] += 0.65
    found = find_brain(seen(data, coarse[1]))
    print(f"{100 * (found & marrow).sum() / marrow.sum():.0f} % of the marrow, Dice {dice(found, brain):.4f}")
    assert (found & marrow).sum() < 0.1 * marrow.sum()
    assert dice(found, brain) > 0.97


@pytest.mark.slow
def test_same_bits_twice(head, coarse, found):
    assert np.array_equal(find_brain(seen(head, coarse[1])), found)


@pytest.mark.slow
def test_a_brain_without_skull_is_not_stripped():
    scan = mni152()
    assert np.array_equal(find_brain(scan, lambda scan: pytest.fail("stripped")), check_extracted(scan))


@pytest.mark.parametrize("background", [0.0, 2.0])  # darker and brighter than the brain
def test_a_brain_without_skull_passes(coarse, background):
    brain = coarse[0] != 0
    assert dice(find_brain(seen(np.where(brain, coarse[0], background), coarse[1])), brain) > 0.999


@pytest.mark.parametrize("skull", [pytest.param(True, marks=pytest.mark.slow), False])
def test_a_surface_coil_hides_no_brain(head, coarse, skull):
    brain, front = coarse[0] != 0, np.linspace(0, 1, head.shape[1])[:, None]
    scan = seen((head if skull else coarse[0]) * (0.2 + 1.6 * front**2), coarse[1])
    score = dice(find_brain(scan), brain)
    print(f"Dice {score:.4f}")
    assert score > 0.97


@pytest.mark.parametrize("degrees", [0.0, pytest.param(65.0, marks=pytest.mark.slow)])
def test_the_template_finds_itself_turned(coarse, degrees):
    turn = np.eye(4)
    turn[:3, :3] = 0.93 * rotation(degrees, np.array([1.0, -0.5, 0.4]))
    turn[:3, 3] = [0.01, -0.02, 0.03]
    place = align(seen(coarse[0], turn @ coarse[1]).volume, mni152().volume)
    corners = 0.07 * np.array([[x, y, z, 1 / 0.07] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]).T
    assert np.abs((place.affine - turn) @ corners)[:3].max() < 2e-3
    assert place.likeness > 0.95


def ellipsoid(shape):
    at = (np.indices(shape).T - np.array(shape) / 2).T
    return np.linalg.norm(at / np.array(shape).reshape(3, 1, 1, 1) * 2.6, axis=0)


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (
            "noise",
            "largest bright part has 0.00 litres; wanted: at least 0.5, after removal of a noisy background .*MP2RAGE",
        ),
        pytest.param("ball", f"({UNLIKE}|{ORDER})", marks=pytest.mark.slow),
        pytest.param("onion", f"({UNLIKE}|{ORDER}|{ALIKE})", marks=pytest.mark.slow),
        pytest.param("other contrast", f"({UNLIKE}|{ORDER})", marks=pytest.mark.slow),
    ],
)
def test_other_pictures_are_refused(head, coarse, rng, kind, words):
    radius, noise = ellipsoid(head.shape), rng.normal(0, 0.03, head.shape)
    data = {
        "noise": rng.random(head.shape),
        "ball": np.abs((radius < 1) + noise),
        "onion": np.abs((radius < 1) - 0.8 * (radius < 0.93) + 0.6 * (radius < 0.86) + noise),
        "other contrast": np.interp(head, [0, 0.12, 0.3, 0.6, 0.85, 1.3], [0, 0, 1.0, 0.6, 0.4, 0.3]),
    }[kind]
    with pytest.raises(InputError, match="case/t1.nii.gz: image is .*" + words):
        skull_strip(seen(data, coarse[1]))


@pytest.mark.slow
def test_a_head_that_its_affine_has_upside_down_is_refused_and_told(head, coarse):
    with pytest.raises(InputError, match=r"unlike a brain .*upside down it has 0\.\d\d: is its affine wrong"):
        skull_strip(seen(head[:, :, ::-1], coarse[1]))


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        pytest.param("onion", f"({UNLIKE}|{ORDER}|{ALIKE})", marks=pytest.mark.slow),
        pytest.param("fluid bright", f"({UNLIKE}|{ORDER})", marks=pytest.mark.slow),
        ("fluid dark, grey bright", ORDER),
    ],
)
def test_other_pictures_without_a_skull_are_refused(coarse, rng, kind, words):
    brain, _ = coarse
    at = 2 * np.linalg.norm((np.indices(brain.shape).T - np.array(brain.shape) / 2).T, axis=0)  # mm
    noise = rng.normal(0, 0.02, brain.shape)
    data = {
        "onion": np.select([at < 15, at < 60, at < 75], [0.7, 1.4, 1.0], 0),
        "fluid bright": np.interp(brain, [0, 0.1, 0.3, 0.68, 0.85], [0, 1.3, 1.2, 0.6, 0.4]),
        "fluid dark, grey bright": np.interp(brain, [0, 0.1, 0.4, 0.68, 0.85], [0, 0.2, 0.2, 1.0, 0.6]),
    }[kind]
    with pytest.raises(InputError, match="case/t1.nii.gz: image is .*" + words):
        find_brain(seen(np.where(data > 0, np.abs(data + noise) + 1e-3, 0), coarse[1]))
