"""Label propagation from an atlas to the template deformed by a known field, with known labels; refusals."""

import numpy as np
import pytest
from colin import dice
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image import Volume, mni152
from ngbrain.image.labelling import label_tissues
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.structures.atlas import propagate_labels


@pytest.fixture(scope="module")
def bent():
    """The template on voxels of 4 mm with its tissues, and both stretched by 5 % and bent by 6 mm."""
    scan = mni152()
    every, affine = (slice(None, None, 4),) * 3, scan.volume.affine @ np.diag([4, 4, 4, 1.0])
    t1, labels = scan.volume.data[every].copy(), label_tissues(scan).volume.data[every].astype(np.int32)
    x, y, z = np.indices(t1.shape) - np.array(t1.shape).reshape(3, 1, 1, 1) / 2
    moved = [x * 0.95 + 1.5 * np.sin(y / 7), y * 0.97 + 1.5 * np.cos(z / 7), z + np.sin(x / 7)]
    where = [each + size / 2 for each, size in zip(moved, t1.shape, strict=True)]
    other, truth = ndimage.map_coordinates(t1, where, order=1), ndimage.map_coordinates(labels, where, order=0)
    names = {1: "csf", 2: "grey", 3: "white", 4: "ventricles"}
    return Volume(t1, affine), LabelMap(Volume(labels, affine), names), Volume(other, affine), truth


@pytest.mark.slow
def test_demons_follow_a_bend_that_an_affine_map_cannot(bent):
    template, labels, brain, truth = bent
    scores = {}
    for method in ("affine", "demons"):
        found = propagate_labels(labels, template, brain, method)
        assert found.names == labels.names and found.volume.data.shape == brain.data.shape
        scores[method] = [dice(found.volume.data == tissue, truth == tissue) for tissue in (3, 4)]
    print({method: np.round(score, 3) for method, score in scores.items()})
    assert max(scores["affine"]) < 0.8 and min(scores["demons"]) > 0.85


@pytest.mark.slow
def test_labels_on_flipped_voxels_of_another_size(bent):
    template, labels, _, _ = bent
    flip = np.diag([1, -2, 1, 1.0])
    flip[1, 3] = labels.volume.data.shape[1] - 1
    thin = LabelMap(Volume(labels.volume.data[:, ::-2].copy(), labels.volume.affine @ flip), labels.names)
    found = propagate_labels(thin, template, template, "affine")
    assert dice(found.volume.data == 3, labels.volume.data == 3) > 0.8


def test_refusals(bent):
    template, labels, brain, _ = bent
    with pytest.raises(InputError, match="method is 'bspline'; wanted: one of affine, demons"):
        propagate_labels(labels, template, brain, "bspline")
    noise = np.where(brain.data > 0, 1 + 0.1 * np.random.default_rng(1).random(brain.data.shape), 0)
    with pytest.raises(InputError, match="template is unlike the brain"):
        propagate_labels(labels, template, Volume(noise.astype(np.float32), brain.affine))
