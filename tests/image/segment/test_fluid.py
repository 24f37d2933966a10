"""Fluid missing in label maps: sulci without a label, and ventricles in one class with other fluid."""

import numpy as np
import pytest
from phantoms import grid, nested, turned
from resampled_scans import rotation

from ngbrain.image.preprocess.contrast import tissue_maps
from ngbrain.image.preprocess.mni_landmarks import ventricle
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.template import mni152
from ngbrain.image.read.volume import Volume
from ngbrain.image.segment.fluid import label_sulcal_fluid, label_ventricles


def folded(fluid=False, spacing=1.0):
    """A ball of grey matter around white, 30 mm in radius, with slits of 3 mm, 12 mm deep, with or without fluid in them."""
    points, affine = grid(36, spacing)
    away = np.linalg.norm(points, axis=-1)
    slit = (np.abs((points[..., 0] + 30) % 15 - 7.5) < 1.5) & (away > 18) & (away < 30)
    numbers = np.where(away < 30, np.where(away < 16, 2, 1), 0)
    numbers[slit] = 3 if fluid else 0
    return LabelMap(Volume(numbers, affine), {1: "grey", 2: "white", 3: "csf"}), 1e-3 * slit.sum() * spacing**3


def test_sulci_without_a_label_are_filled_up_to_the_hull():
    labels, empty = folded()
    filled, ml = label_sulcal_fluid(labels)
    print(ml, empty)
    assert set(filled.regions) == {"grey", "white", "csf"} and filled.volumes_ml()["csf"] == pytest.approx(ml)
    assert ml == pytest.approx(empty, rel=0.12) and ml > 5
    away = np.linalg.norm(labels.volume.to_world(np.argwhere(filled.volume.data == 3)), axis=1)
    assert away.max() < 30.6e-3  # no film around the head
    before, after = labels.volumes_ml(), filled.volumes_ml()
    assert after["grey"] == before["grey"] and after["white"] == before["white"]
    assert label_sulcal_fluid(filled)[0] is filled  # and then there is nothing left


def test_other_voxels_are_filled_as_much():
    _, empty = folded()
    oblique = turned(folded()[0], rotation(25.0, np.array([1.0, 2.0, 0.5])))
    assert label_sulcal_fluid(oblique)[1] == pytest.approx(empty, rel=0.12)
    assert label_sulcal_fluid(folded(spacing=2.0)[0])[1] == pytest.approx(empty, rel=0.2)


def test_what_has_fluid_or_no_grey_matter_is_left_alone():
    labels, _ = folded(fluid=True)
    assert label_sulcal_fluid(labels) == (labels, 0.0)
    gel = LabelMap(folded()[0].volume, {1: "gel", 2: "stiff"})
    assert label_sulcal_fluid(gel) == (gel, 0.0)


def test_ventricles_are_told_from_other_fluid():
    """The template labelled as by FAST, by the largest share; its lateral ventricles have 10 to 40 ml."""
    fluid, grey, white = tissue_maps()
    brain = mni152().volume.data > 0
    classes = np.where(brain, 1 + np.argmax([fluid.data, grey.data, white.data], axis=0), 0)
    one = LabelMap(Volume(classes, fluid.affine), {1: "csf", 2: "grey", 3: "white"})
    found, ml = label_ventricles(one)
    assert 10 < ml < 40 and found.volumes_ml()["ventricles"] == pytest.approx(ml)
    assert found.volumes_ml()["csf"] + ml == pytest.approx(one.volumes_ml()["csf"])
    there = 1e3 * one.volume.to_world(np.argwhere(found.volume.data == 4))
    assert (ventricle(there) < 4).mean() > 0.95  # at most 4 radii from their course
    assert label_ventricles(found) == (found, 0.0)  # which has some


def test_what_is_no_brain_has_no_ventricles():
    balls = nested((45.0, 42.0, 38.0, 12.0), ("csf", "grey", "white", "ventricles"))
    bare = LabelMap(balls.volume, {1: "fluid", 2: "grey", 3: "white", 4: "lesion"})
    assert label_ventricles(bare) == (bare, 0.0)
