"""Surfaces as glTF, read by trimesh."""

import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.report.pictures.gltf import write_gltf
from ngbrain.report.pictures.panel import ColourScale, SurfaceLayer

POINTS = np.array(
    [[0.0, 0, 0], [0.02, 0, 0], [0, 0.01, 0], [0.02, 0.01, 0.004], [9.0, 9, 9]]
)  # the last one is not used
TRIANGLES = np.array([[0, 1, 2], [1, 3, 2]])
SCALE = ColourScale("largest principal strain (%)", 0.0, 4.0, np.array([[0, 0, 0], [188, 188, 188], [255, 0, 0]]))


def test_another_reader_finds_names_places_and_colours(tmp_path):
    pytest.importorskip("trimesh")
    import trimesh

    layers = [
        SurfaceLayer("brain", POINTS, TRIANGLES, values=np.array([0.0, 2.0, 0.0, 4.0, 1.0]), scale=SCALE),
        SurfaceLayer("blade", POINTS + 0.01, TRIANGLES, "#ff0000", opacity=0.5),
        SurfaceLayer("elements", POINTS, TRIANGLES, edges=True),
    ]
    scene = trimesh.load(write_gltf(tmp_path / "scene.glb", layers), process=False)
    assert set(scene.geometry) == {"brain", "blade"}
    brain, blade = scene.geometry["brain"], scene.geometry["blade"]
    wanted = POINTS[:4, [0, 2, 1]] * [1, 1, -1]  # up is y
    assert np.allclose(brain.vertices, wanted, atol=1e-8) and (brain.faces == TRIANGLES).all()
    assert np.allclose(blade.vertices, (POINTS[:4] + 0.01)[:, [0, 2, 1]] * [1, 1, -1], atol=1e-8)
    assert brain.area == pytest.approx(2e-2 * np.hypot(0.01, 0.0) / 2 + blade.area_faces[1])
    linear = np.round(255 * ((188 / 255 + 0.055) / 1.055) ** 2.4)
    colours = np.asarray(brain.visual.vertex_attributes["color"])
    assert colours[:, 0].tolist() == [0, linear, 0, 255] and colours[3].tolist() == [255, 0, 0, 255]
    assert blade.visual.material.baseColorFactor.tolist() == [255, 0, 0, 128]
    assert brain.metadata["values"] == SCALE.label and brain.metadata["high"] == 4.0


def test_what_cannot_be_written(tmp_path):
    with pytest.raises(InputError, match=r"wanted: a name that ends in .glb"):
        write_gltf(tmp_path / "scene.gltf", [])
    with pytest.raises(InputError, match="layers is empty"):
        write_gltf(tmp_path / "scene.glb", [SurfaceLayer("nothing", POINTS, np.zeros((0, 3), int))])
