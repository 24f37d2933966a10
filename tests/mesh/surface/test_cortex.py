"""Surfaces of phantoms with known areas, volumes, distances and handles, and of a head; intersections; refusals."""

import numpy as np
import pytest
from phantoms import MM, grid, nested
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume
from ngbrain.image.segment.topology_correction import NEIGHBOURS
from ngbrain.mesh.surface import smoothing as crossing
from ngbrain.mesh.surface.cortex import cortex, spherical_cortex
from ngbrain.mesh.surface.mask_surface import contour
from ngbrain.mesh.surface.smoothing import crossings, smooth_surfaces
from ngbrain.mesh.surface.triangle_mesh import SurfaceMesh

NAMES = {1: "csf", 2: "grey", 3: "white", 4: "ventricles"}
RADII = (38.0, 34.0, 30.0, 10.0)


@pytest.fixture(scope="module")
def balls():
    return cortex(nested(RADII, tuple(NAMES.values())))


def joined(surfaces):
    first = np.cumsum([0, *(len(s.points) for s in surfaces)])
    triangles = [s.triangles + k for s, k in zip(surfaces, first, strict=False)]
    return np.concatenate([s.points for s in surfaces]), np.concatenate(triangles)


def closed(triangles):
    """Every edge once in each direction."""
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).tolist()
    there = {tuple(e) for e in edges}
    return len(there) == len(edges) and there == {(b, a) for a, b in there}


def test_areas_volumes_and_thickness_of_nested_balls(balls):
    for (name, surface), r in zip(balls.surfaces.items(), sorted(RADII), strict=True):
        area, volume = surface.area / (4 * np.pi * r**2 * MM**2), surface.volume / (4 / 3 * np.pi * r**3 * MM**3)
        print(name, area, volume, surface.volume / balls.voxels[name], surface.genus)
        assert area == pytest.approx(1, abs=0.015) and volume == pytest.approx(1, abs=0.015)
        assert surface.volume == pytest.approx(balls.voxels[name], rel=1e-4)
        assert closed(surface.triangles) and (surface.pieces, surface.euler, surface.genus) == (1, 2, 0)
    print(balls.mean_thickness, balls.thickness.min(), balls.thickness.max())
    assert balls.mean_thickness == pytest.approx(4 * MM, abs=0.1 * MM)
    assert np.abs(balls.thickness - 4 * MM).max() < 0.6 * MM
    assert balls.moved == dict.fromkeys(balls.surfaces, 0)


def test_normals_point_outwards_and_nothing_crosses(balls):
    for surface in balls.surfaces.values():
        radial = surface.points / np.linalg.norm(surface.points, axis=1)[:, None]
        assert (np.einsum("ij,ij->i", surface.normals(), radial) > 0.9).all()
        assert surface.vertex_areas().sum() == pytest.approx(surface.area)
    assert len(crossings(*joined(list(balls.surfaces.values())))) == 0


@pytest.mark.parametrize("seed", range(3))
def test_a_contour_has_the_topology_of_its_mask(seed):
    mask = np.random.default_rng(seed).random((12, 13, 14)) < 0.3 + 0.2 * seed
    points, triangles = contour(mask)
    assert closed(triangles)
    # Outside every piece one surface, around every cavity another.
    outside = ndimage.label(~np.pad(mask, 1), NEIGHBOURS)[1]
    surface = SurfaceMesh(points, triangles)
    assert surface.pieces == ndimage.label(mask, NEIGHBOURS)[1] + outside - 1
    inside = np.pad(mask, 2)
    middles = np.argwhere(inside) - 2
    assert np.abs(points[:, None] - middles).max(axis=2).min(axis=1).max() < 1
    assert 0.3 * mask.sum() < surface.volume < 1.1 * mask.sum()  # single voxels become small


def labelled(white, grey):
    numbers = np.where(white, 3, np.where(grey, 2, 0))
    _, affine = grid((len(numbers) - 1) / 2)
    return LabelMap(Volume(numbers, affine), NAMES)


def faulty(fault):
    """White matter of a known genus in a ball of grey matter."""
    points, _ = grid(26)
    x, y, z = np.moveaxis(points, -1, 0)
    r = np.linalg.norm(points, axis=-1)
    white = {
        "torus": np.hypot(np.hypot(x, y) - 12, z) < 5,
        "tunnel": (r < 16) & (np.hypot(x, y) > 2),
        "cavity": (r < 16) & (r > 4),
        "touching": (np.linalg.norm(points - np.array([8.5, 0, 0]), axis=-1) < 9)
        | (np.linalg.norm(points + np.array([8.5, 0, 0]), axis=-1) < 9),
        "shell": (r < 16) & (r > 13.8),
    }[fault]
    return labelled(white, r < 23)


@pytest.mark.parametrize(
    ("fault", "genus"), [("torus", 1), ("tunnel", 1), ("cavity", 0), ("touching", 0), ("shell", 0)]
)
def test_handles_are_found_and_cut(fault, genus):
    labels = faulty(fault)
    found = cortex(labels)
    assert found.white.genus == genus and found.white.pieces == 1
    sphere = spherical_cortex(labels)
    less = found.voxels["white"] - sphere.voxels["white"]
    print(fault, found.voxels["white"], less, sphere.moved)
    for surface in sphere.surfaces.values():
        assert closed(surface.triangles) and (surface.pieces, surface.genus) == (1, 0)
    assert (less > 0) == (genus > 0) and less < 0.1 * found.voxels["white"]
    assert len(crossings(*joined(list(sphere.surfaces.values())))) == 0
    assert sphere.white.volume == pytest.approx(sphere.voxels["white"], rel=0.005)


def test_surfaces_stay_apart_where_labels_touch():
    points, affine = grid(24)
    r, beside = np.linalg.norm(points, axis=-1), np.linalg.norm(points - np.array([9, 0, 0]), axis=-1)
    # A ventricle up to the grey matter, white matter up to the outside, and no fluid at all.
    numbers = (
        np.where(r < 20, 2, 0)
        + ((beside < 11.5) & (r < 20))
        + (np.linalg.norm(points - np.array([4, 0, 0]), axis=-1) < 6.2)
    )
    numbers[np.linalg.norm(points + np.array([3, 0, 0]), axis=-1) < 4] = 4
    found = cortex(LabelMap(Volume(numbers, affine), NAMES))
    print(found.moved)
    assert min(found.moved.values()) >= 0 and found.moved["white"] > 50 and found.moved["outer"] > 500
    assert len(crossings(*joined(list(found.surfaces.values())))) == 0
    assert found.thickness.min() > 0.3 * MM and found.ventricles.volume > 250 * MM**3


def test_crossing_triangles_are_found():
    sphere = SurfaceMesh(*contour(np.linalg.norm(np.indices((15, 15, 15)) - 7, axis=0) < 5))
    assert len(crossings(sphere.points, sphere.triangles)) == 0
    # A vertex pushed through the other side: its triangles cross those there, and neighbours that share a corner do not.
    points = sphere.points.copy()
    points[sphere.points[:, 0].argmin(), 0] = sphere.points[:, 0].max() + 1
    found = crossings(points, sphere.triangles)
    pushed = (sphere.triangles == sphere.points[:, 0].argmin()).any(axis=1)
    assert len(found) and (pushed[found].sum(axis=1) >= 1).all()
    # Two balls one into the other, against every pair.
    two = SurfaceMesh(*joined([sphere, SurfaceMesh(sphere.points + np.array([6.3, 0.2, 0.1]), sphere.triangles)]))
    assert (two.pieces, two.genus) == (2, 0)
    found = crossings(two.points, two.triangles)
    n = len(sphere.triangles)
    assert len(found) > 20 and (found[:, 0] < n).all() and (found[:, 1] >= n).all()
    a, b = (k.ravel() for k in np.meshgrid(np.arange(n), np.arange(n, 2 * n), indexing="ij"))
    t = two.triangles
    every = crossing._pierces(two.points, t[a], t[b]) | crossing._pierces(two.points, t[b], t[a])
    assert np.array_equal(np.stack([a, b], axis=1)[every], found)


@pytest.mark.parametrize("away", [1e-3, -1e-3])
def test_an_edge_away_from_a_common_corner_counts(away):
    points = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [1, 1, -1], [1, 1 + away, 1], [3, 3, 1], [3, 3.0, 2]])
    assert crossings(points, np.array([[0, 1, 2], [0, 3, 4]])).tolist() == [[0, 1]]
    assert crossings(points, np.array([[0, 1, 2], [0, 5, 6]])).tolist() == []
    assert crossings(points, np.array([[0, 1, 2], [0, 1, 4]])).tolist() == []


def test_smoothing_goes_back_where_surfaces_would_cross():
    # A ball with a spike that smoothing takes away, and a needle in the spike.
    x = SurfaceMesh(*contour(np.linalg.norm(np.indices((17, 17, 17)) - 8, axis=0) < 6))
    points = x.points - 8
    tip = points[:, 0].argmax()
    points[tip] += [5, 0, 0]
    needle = (x.points - 8) * [0.25, 0.005, 0.005] + points[tip] - [3.2, 0, 0]
    rough = [SurfaceMesh(needle, x.triangles), SurfaceMesh(points, x.triangles)]
    assert len(crossings(*joined(rough))) == 0
    volumes = [s.volume for s in rough]
    alone = [smooth_surfaces([s], [v], 10)[0] for s, v in zip(rough, volumes, strict=True)]
    together = smooth_surfaces(rough, volumes, 10)
    print(len(crossings(*joined(alone))), [np.ptp(s.points, axis=0) for s in (*alone, *together)])
    assert len(crossings(*joined(alone))) > 0 and len(crossings(*joined(together))) == 0
    moved = np.linalg.norm(together[1].points - rough[1].points, axis=1)
    assert (moved > 0).mean() > 0.5 and together[1].points[tip, 0] == points[tip, 0]


@pytest.mark.slow
def test_structures_have_the_surfaces_of_their_tissues():
    labels = nested()
    numbers = labels.volume.data.copy()
    right = np.arange(len(numbers))[:, None, None] > len(numbers) // 2
    split = np.where(right & (numbers > 0) & (numbers < 3), numbers + 3, numbers)
    middle = len(numbers) // 2
    deep = np.zeros(numbers.shape, bool)
    deep[middle + 16 : middle + 22, middle - 3 : middle + 3, middle - 3 : middle + 3] = True
    names = dict(
        enumerate(("grey_left", "white_left", "ventricles", "grey_right", "white_right", "deep_grey_right"), 1)
    )
    found, whole = cortex(LabelMap(Volume(np.where(deep, 6, split), labels.volume.affine), names)), cortex(labels)
    assert found.surfaces.keys() == whole.surfaces.keys()
    for name, surface in found.surfaces.items():
        assert np.array_equal(surface.points, whole.surfaces[name].points), name
    assert found.moved == whole.moved


@pytest.mark.parametrize("names", [{1: "grey"}, {1: "white"}, {1: "label_1"}])
def test_what_has_no_cortex_is_refused(names):
    labels = nested((12.0,), tuple(names.values()))
    with pytest.raises(InputError, match="white") as told:
        cortex(labels)
    assert "\n" not in str(told.value)
    print(told.value)


@pytest.mark.slow
def test_the_surfaces_of_a_head():
    from ngbrain.image import mni152
    from ngbrain.image.labelling import label_tissues

    found = spherical_cortex(label_tissues(mni152()).labels)
    for name, surface in found.surfaces.items():
        print(name, surface.area * 1e4, surface.volume * 1e6, surface.volume / found.voxels[name] - 1, surface.genus)
        assert surface.volume == pytest.approx(found.voxels[name], rel=0.01)
        assert surface.genus == 0 or name == "ventricles"
    print(found.mean_thickness, found.moved)
    assert len(crossings(*joined(list(found.surfaces.values())))) == 0
    assert 0.14 < found.pial.area < 0.25 and 0.15 < found.white.area < 0.25
    assert 1e-3 < found.mean_thickness < 4.5e-3
