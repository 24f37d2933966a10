"""Falx and tentorium: for parts separated by a plane, against the closed form, and for MNI152."""

from collections import Counter

import numpy as np
import pytest
from scipy.spatial import cKDTree

from ngbrain.errors import InputError
from ngbrain.image import Volume, mni152
from ngbrain.image.labelling import label_tissues
from ngbrain.image.preprocess.mni_landmarks import free_margin
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.structures.dura import falx, tentorium
from ngbrain.image.structures.midsurface import MidSurface
from ngbrain.image.structures.structures import CEREBELLUM, LEFT, RIGHT, Structures, segment_structures


def of_parts(parts, affine, to=None):
    empty = LabelMap(Volume(np.zeros(parts.shape, np.uint8), affine), {})
    return Structures(empty, Volume(parts, affine), np.eye(4) if to is None else to, MidSurface(np.zeros((97, 89))))


def area(points, triangles):
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def grid():
    """Middles of voxels of 2 mm (mm), and their affine."""
    at = np.stack(np.meshgrid(*(np.arange(-half, half + 1, 2.0) for half in (70, 112, 100)), indexing="ij"), axis=-1)
    affine = np.diag([2e-3, 2e-3, 2e-3, 1])
    affine[:3, 3] = [-70e-3, -112e-3, -100e-3]
    return at, affine


@pytest.mark.parametrize("turned", [False, True])
def test_a_flat_falx(turned):
    at, affine = grid()
    level = at[..., 0] - 0.1 * at[..., 2] - 1
    ball = np.linalg.norm(at, axis=-1) < 60
    island = np.linalg.norm(at - [0, -95, 50], axis=-1) < 12
    parts = np.where(ball | island, np.where(level > 0, RIGHT, LEFT), 0).astype(np.uint8)
    to = np.eye(4)
    if turned:
        to[:3] = np.array([[0, -1, 0, 0.01], [1, 0, 0, 0], [0, 0, 1, 0.02]])
    points, triangles = falx(of_parts(parts, to @ affine, to))
    here = 1e3 * (points - to[:3, 3]) @ to[:3, :3]
    assert np.linalg.norm(here, axis=1).max() < 61  # the island is none of it
    inner = np.linalg.norm(here, axis=1) < 50
    assert np.abs(here[inner, 0] - 0.1 * here[inner, 2] - 1).max() < 1.0  # half a voxel
    # The disc of the ball outside the free margin, counted on a fine lattice; the sheet ends up to 4 mm before its edge.
    fine = np.stack(np.meshgrid(*(np.arange(-60, 60.0, 0.25),) * 2, indexing="ij"), axis=-1)
    most, least = (
        1e-6 / 16 * ((np.linalg.norm(fine, axis=-1) < 60 - lost) & (free_margin(fine) > lost)).sum() for lost in (0, 4)
    )
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    across = np.cross(b - a, c - a) / 2 @ to[:3, 0]
    assert (across > 0).all() and least < across.sum() < most
    assert area(points, triangles) == pytest.approx(across.sum() * np.sqrt(1.01), rel=0.01)


def test_a_slanted_tentorium():
    at, affine = grid()
    ball = np.linalg.norm(at[..., :2] - [0, -60], axis=-1) < 40
    ball |= np.linalg.norm(at[..., :2] - [50, -97], axis=-1) < 12  # an island
    below = at[..., 2] < -20 + 0.3 * np.abs(at[..., 0])
    parts = np.where(ball, np.where(below, CEREBELLUM, np.where(at[..., 0] > 0, RIGHT, LEFT)), 0).astype(np.uint8)
    points, triangles = tentorium(of_parts(parts, affine))
    here = 1e3 * points
    assert np.linalg.norm(here[:, :2] - [0, -60], axis=1).max() < 41
    inner = (np.linalg.norm(here[:, :2] - [0, -60], axis=1) < 34) & (np.abs(here[:, 0]) > 6)
    assert np.abs(here[inner, 2] + 20 - 0.3 * np.abs(here[inner, 0])).max() < 1.0
    assert np.pi * 36e-3**2 < area(points, triangles) / np.sqrt(1.09) < np.pi * 40e-3**2


def test_without_a_cerebellum_there_is_no_tentorium():
    at, affine = grid()
    parts = np.where(np.linalg.norm(at, axis=-1) < 60, np.where(at[..., 0] > 0, RIGHT, LEFT), 0).astype(np.uint8)
    with pytest.raises(InputError, match="structures is without a place where cerebellum meets cerebrum_left and"):
        tentorium(of_parts(parts, affine))


@pytest.fixture(scope="module")
def found():
    scan = mni152()
    every, affine = (slice(None, None, 2),) * 3, scan.volume.affine @ np.diag([2, 2, 2, 1.0])
    return segment_structures(
        Volume(scan.volume.data[every].copy(), affine), Volume(label_tissues(scan).volume.data[every].copy(), affine)
    )


@pytest.mark.parametrize("sheet", [falx, tentorium])
def test_a_sheet_is_one_surface_with_an_edge(found, sheet):
    points, triangles = sheet(found)
    edges = Counter(tuple(sorted(edge)) for t in triangles.tolist() for edge in zip(t, [*t[1:], t[0]], strict=True))
    assert set(edges.values()) == {1, 2} and set(triangles.ravel().tolist()) == set(range(len(points)))
    assert 40e-4 < area(points, triangles) < 90e-4


def test_the_falx_of_the_template_is_in_its_middle(found):
    points, _ = falx(found)
    assert np.abs(points[:, 0]).max() < 3e-3
    callosum = [number for number, name in found.labels.names.items() if name == "corpus_callosum"]
    voxels = found.labels.volume.to_world(np.argwhere(np.isin(found.labels.volume.data, callosum)))
    assert cKDTree(voxels).query(points)[0].min() > 3e-3


def test_the_tentorium_lies_between_cerebrum_and_cerebellum(found):
    points, _ = tentorium(found)
    for parts in ((CEREBELLUM,), (LEFT, RIGHT)):
        voxels = found.parts.to_world(np.argwhere(np.isin(found.parts.data, parts)))
        assert np.quantile(cKDTree(voxels).query(points)[0], 0.99) < 4e-3
    off = np.abs(points[:, 0])
    assert points[off < 8e-3, 2].mean() > points[off > 30e-3, 2].mean() + 10e-3  # a tent
