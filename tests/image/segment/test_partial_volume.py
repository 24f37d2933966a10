"""Skull-stripped brains in coarse voxels: their rim; an error of the segmentation names the file."""

import numpy as np
import pytest
from colin import dice, seen
from nilearn.datasets import load_mni152_gm_template, load_mni152_wm_template

from ngbrain.errors import InputError
from ngbrain.image import mni152
from ngbrain.image.labelling import label_tissues
from ngbrain.image.segment import tissue_classes
from ngbrain.image.segment.partial_volume import correct_partial_volume
from ngbrain.image.segment.tissue_classes import GREY, VENTRICLE, WHITE

MM = 3


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("NGBRAIN_CACHE", str(tmp_path))


def averaged(volume):
    """A scan with voxels of 3 mm, each the mean of 27, those of the background included."""
    size = np.array(volume.data.shape) // MM
    data = volume.data[tuple(slice(MM * n) for n in size)]
    data = data.reshape(np.column_stack([size, [MM] * 3]).ravel()).mean(axis=(1, 3, 5))
    affine = volume.affine @ np.diag([MM, MM, MM, 1.0])
    affine[:3, 3] += 1e-3 * (MM - 1) / 2
    return seen(data, affine)


@pytest.mark.slow
def test_tissue_in_voxels_of_3_mm(cache):
    scan, whole = averaged(mni152().volume), mni152().volume
    found = label_tissues(scan).volume
    at = whole.to_world(np.argwhere(np.ones_like(whole.data)))
    labels = found.interpolate(at, order=0).reshape(whole.data.shape).astype(int)
    grey, white = (load(resolution=1).get_fdata() for load in (load_mni152_gm_template, load_mni152_wm_template))
    fluid = 1 - grey - white
    scores = (
        dice(labels == GREY, grey > np.maximum(fluid, white)),
        dice(labels == WHITE, white > np.maximum(fluid, grey)),
    )
    print(f"grey {scores[0]:.3f}, white {scores[1]:.3f}, ventricles {1e-3 * (labels == VENTRICLE).sum():.1f} ml")
    assert min(scores) > 0.87
    assert 13e3 < (labels == VENTRICLE).sum() < 24e3


def test_small_voxels_stay_as_they_are():
    scan = mni152()
    assert correct_partial_volume(scan, scan.volume.data != 0) is scan.volume


@pytest.mark.slow
def test_a_refused_segmentation_names_the_file(cache, monkeypatch):
    def refuse(*_):
        raise InputError("image", "a brain with ventricles of 0.0 ml", "at least 2 ml")

    monkeypatch.setattr(tissue_classes, "segment", refuse)
    scan = averaged(mni152().volume)
    with pytest.raises(InputError, match=r"^case/t1.nii.gz: image is a brain with ventricles of 0\.0 ml"):
        label_tissues(scan)
