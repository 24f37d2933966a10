"""Fibre directions from files: in world axes for any axes of the file, without sign, and over a mesh."""

import numpy as np
import pytest

nibabel = pytest.importorskip("nibabel", reason='nibabel is not installed; get it with: pip install "ngbrain[mri]"')

from ngbrain.errors import InputError  # noqa: E402
from ngbrain.image.read.fibre_directions import FibreDirections, read_fibre_directions  # noqa: E402
from ngbrain.ladder.models.property_maps import fibre_field  # noqa: E402
from ngbrain.mesh import block  # noqa: E402

ALONG = np.array([2.0, -1.0, 2.0]) / 3
SHAPE = (4, 5, 6)


def affine(turn, flip, sizes=(2.0, 1.5, 3.0)):
    """Voxels turned about (1, 2, 3), their first axis reversed or not, in mm."""
    axis, sin, cos = np.array([1.0, 2.0, 3.0]) / 14**0.5, np.sin(turn), np.cos(turn)
    K = np.cross(np.eye(3), axis)
    R = np.eye(3) + sin * K + (1 - cos) * K @ K
    found = np.eye(4)
    found[:3, :3] = R @ np.diag(sizes) @ np.diag([-1.0 if flip else 1.0, 1, 1])
    found[:3, 3] = (-3.0, 4.0, 5.0)
    return found


def in_file(a, place, convention):
    """Components as FSL's or MRtrix' programs write them, from their manuals: FSL's first axis always makes a left-handed frame."""
    if convention != "fsl":
        return a
    axes = place[:3, :3] / np.linalg.norm(place[:3, :3], axis=0)
    own = axes.T @ a
    return own * [-1, 1, 1] if np.linalg.det(axes) > 0 else own


def tensor_in_file(a, convention):
    D = 1e-3 * (0.3 * np.eye(3) + 1.4 * np.outer(a, a))
    order = {"fsl": "xx xy xz yy yz zz", "mrtrix": "xx yy zz xy xz yz", "nifti": "xx xy yy xz yz zz"}[convention]
    return np.array([D["xyz".index(i), "xyz".index(j)] for i, j in order.split()]), D


def write(path, values, place):
    nibabel.save(nibabel.Nifti1Image(values, place), path)
    return path


@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize("convention", ["fsl", "mrtrix", "nifti"])
@pytest.mark.parametrize("kind", ["vectors", "tensors", "matrices", "fifth axis"])
def test_a_direction_is_that_of_the_world(tmp_path, kind, convention, flip):
    place = affine(0.7, flip)
    own = in_file(ALONG, place, convention)
    six, D = tensor_in_file(own, convention)
    values = {"vectors": 3.0 * own, "tensors": six, "matrices": D, "fifth axis": six[None]}[kind]
    path = write(tmp_path / "v1.nii.gz", np.broadcast_to(values, SHAPE + values.shape).copy(), place)
    found = read_fibre_directions(path, convention).interpolate(np.array([[0.0, 0.0, 0.01], [0.01, -0.02, 0.3]]))
    assert np.abs(found @ ALONG) == pytest.approx(1.0, abs=1e-6)


def test_signs_mean_nothing_and_what_is_not_known_is_left_out():
    """A mean of vectors would be 0 between two of opposite sign."""
    data = np.zeros((4, 1, 1, 3))
    data[:3, 0, 0] = [[1, 0, 0], [-1, 0, 0], [0, 1, 0]]
    line = FibreDirections(data, np.diag([1e-3, 1e-3, 1e-3, 1]))
    found = line.interpolate(np.array([[0.5e-3, 0, 0], [1.4e-3, 0, 0], [1.6e-3, 0, 0], [3e-3, 0, 0]]))
    assert found == pytest.approx(np.array([[1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 1, 0]]))
    assert line.covers(np.array([[2e-3, 0, 0], [3e-3, 0, 0], [9e-3, 0, 0]])).tolist() == [True, False, False]


def test_over_a_mesh_an_element_has_the_mean_of_its_structure_tensors():
    """Directions that turn with x, in the plane of x and y: that of the middle of each element, signs drawn anew in each voxel."""
    mesh, size = block((0.02, 0.02, 0.02), 0.01), 5e-4
    place = np.diag([size, size, size, 1.0])
    place[:3, 3] = -0.012
    x = -0.012 + size * np.arange(70)
    angle = np.broadcast_to((40 * x)[:, None, None], (70, 49, 70))
    signs = np.random.default_rng(0).choice([-1.0, 1.0], angle.shape)
    data = signs[..., None] * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    field = fibre_field(FibreDirections(data, place), mesh, np.ones(mesh.ne, bool))
    centres = np.array([np.mean([mesh[v].point for v in each.vertices], axis=0) for each in mesh.Elements()])
    found = field(mesh(*centres.T))
    wanted = np.stack([np.cos(40 * centres[:, 0]), np.sin(40 * centres[:, 0]), 0 * centres[:, 0]], axis=-1)
    assert np.abs(np.sum(found * wanted, axis=1)).min() > 0.9999
    away = place.copy()
    away[:3, 3] += 1.0
    with pytest.raises(InputError, match="without a direction at 100% of the tissue's points"):
        fibre_field(FibreDirections(data, away), mesh, np.ones(mesh.ne, bool))


def test_what_is_no_file_of_directions(tmp_path):
    good = np.broadcast_to(ALONG, (*SHAPE, 3))
    for values, place, said in (
        (good[..., :2].copy(), affine(0, False), r"of shape \(4, 5, 6, 2\); wanted: vectors"),
        (0 * good, affine(0, False), "without a direction"),
        (np.full((*SHAPE, 3, 3), np.eye(3)), affine(0, False), "without a direction"),
        (
            good.copy(),
            affine(0, False) @ np.array([[1, 0.3, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
            "sheared",
        ),
    ):
        with pytest.raises(InputError, match=said):
            read_fibre_directions(write(tmp_path / "v1.nii", values, place), "fsl")
    with pytest.raises(InputError, match="fibre_map_convention is 'itk'"):
        read_fibre_directions(tmp_path / "v1.nii", "itk")
