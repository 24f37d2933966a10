"""What a notebook shows of a scene, data, an image, labels and a body: one line as text, a table with a thumbnail."""

import numpy as np
import pytest

import ngbrain as nb
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume
from ngbrain.materials import NeoHooke
from ngbrain.mesh import block


def waves(folder):
    nb.datasets.write("waves_plane", folder)
    return nb.read_waves(next(folder.rglob("*.npz")))


def labels(_):
    far = np.linalg.norm(np.indices((12, 12, 12)) - 6, axis=0)
    numbers = (far < 5).astype(np.uint8) + (far < 3)
    return LabelMap(Volume(numbers, np.diag([2e-3, 2e-3, 2e-3, 1.0])), {1: "grey", 2: "white"})


def body(_):
    return nb.Problem(block(), {".*": nb.Material(NeoHooke(1e3), bulk=1e6)}, {"bottom": 0})


SHOWN = {
    "scene": (lambda _: nb.Scene.shipped("idealised"), "idealised", False),
    "waves": (waves, "60 Hz", True),
    "image": (lambda folder: labels(folder).volume, "12 × 12 × 12 voxels; 2 × 2 × 2 mm", True),
    "labels": (labels, "white", True),
    "body": (body, "NeoHooke", False),
}


@pytest.mark.parametrize("name", SHOWN)
def test_one_line_and_a_card(name, tmp_path):
    make, said, seen = SHOWN[name]
    made = make(tmp_path)
    text, card = repr(made), made._repr_html_()
    assert said in text and "\n" not in text and len(text) < 200
    assert said.split(";")[0] in card and ("<img" in card) == seen


def test_a_card_has_no_thumbnail_without_matplotlib(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    assert "<img" not in labels(None)._repr_html_() and "<table>" in labels(None)._repr_html_()
