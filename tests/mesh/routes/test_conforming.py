"""Conforming meshes of phantoms with known volumes and contacts, and of a head: names, shapes, distances, crossings, refusals."""

from itertools import combinations

import ngsolve as ngs
import numpy as np
import pytest
from scipy.spatial import Delaunay

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume
from ngbrain.mesh.geometry.sizing import RadialSizeField
from ngbrain.mesh.improve.reconnection import Reconnection
from ngbrain.mesh.improve.vertex_relocation import shape_quality, smooth_vertices
from ngbrain.mesh.labels.indicators import MOST, Indicators
from ngbrain.mesh.labels.volume_zones import Zones
from ngbrain.mesh.quality import Quality, deviations, interfaces, volume_errors
from ngbrain.mesh.routes.conforming import _freed, conforming
from ngbrain.mesh.routes.registry import ROUTES
from ngbrain.mesh.tet_mesh import named_elements

MM = 1e-3
NAMES = {1: "csf", 2: "grey", 3: "white"}


def labelled(numbers, names=NAMES):
    affine = np.diag([MM, MM, MM, 1.0])
    affine[:3, 3] = -(np.array(numbers.shape) - 1) / 2 * MM
    return LabelMap(Volume(numbers.astype(np.int16), affine), names)


def grid(n):
    return np.indices((n, n, n)) - (n - 1) / 2


def nested():
    r = np.linalg.norm(grid(42), axis=0)
    return labelled(np.select([r < 9, r < 14, r < 18], [3, 2, 1]))


def sectors():
    x, y, z = grid(36)
    angle = np.floor((np.arctan2(y, x) / np.pi + 1) * 1.4999).astype(int) + 1
    return labelled(np.where(x**2 + y**2 + z**2 < 15**2, angle, 0))


def touching():
    x, y, z = grid(48)
    return labelled(np.where((np.abs(x) - 10) ** 2 + y**2 + z**2 < 100, np.where(x < 0, 1, 2), 0))


def shell():
    r = np.linalg.norm(grid(42), axis=0)
    return labelled(np.select([r < 15.5, r < 17.5], [2, 1]))


def same(h):
    return lambda points: np.full(len(points), h)


def graded(points):
    return np.clip(2e-3 + 0.1 * np.linalg.norm(points - [0, 0, 18e-3], axis=1), 2e-3, 4e-3)


CASES = {
    "nested": (nested, same(3e-3), {"outer_csf", "csf_grey", "grey_white"}),
    "sectors": (
        sectors,
        same(3e-3),
        {"outer_csf", "outer_grey", "outer_white", "csf_grey", "csf_white", "grey_white"},
    ),
    "touching": (touching, same(2.5e-3), {"outer_csf", "outer_grey", "csf_grey"}),
    "shell": (shell, same(2.5e-3), {"outer_csf", "csf_grey"}),
    "graded": (nested, graded, {"outer_csf", "csf_grey", "grey_white"}),
}


@pytest.fixture(scope="module", params=CASES)
def made(request):
    phantom, size, names = CASES[request.param]
    labels = phantom()
    return request.param, labels, size, names, conforming(labels, size)


def test_boundaries_are_the_contacts_of_the_phantom(made):
    _, _, _, names, mesh = made
    assert set(mesh.boundaries) == names and set(mesh.boundary) == set(range(len(names)))


def test_volumes_are_the_voxels(made):
    _, labels, _, _, mesh = made
    assert max(map(abs, volume_errors(mesh, labels).values())) < 0.01


def test_no_slivers(made):
    *_, mesh = made
    quality = Quality.of(mesh)
    assert (mesh.volumes() > 0).all()
    assert quality.dihedrals.min() > 6 and (quality.ratios < 0.1).mean() <= 1e-3


def test_interfaces_are_where_the_labels_change(made):
    name, labels, _, _, mesh = made
    found = np.concatenate(list(deviations(mesh, Indicators.of(labels)).values()))
    assert found.mean() < 0.25 * MM and np.quantile(found, 0.95) < (0.9 if name == "sectors" else 0.5) * MM


def test_boundaries_are_all_interfaces_outwards_of_the_first(made):
    *_, mesh = made
    triangles, _ = interfaces(mesh)
    ours, theirs = (set(map(tuple, np.sort(t, axis=1).tolist())) for t in (mesh.triangles, triangles))
    assert ours == theirs and len(mesh.triangles) == len(triangles)
    for number, region in enumerate(mesh.regions):
        flow = 0.0
        for k, name in enumerate(mesh.boundaries):
            first, second = name.split("_")
            sign = {f"outer_{region}": 1, f"{region}_{second}": 1, f"{first}_{region}": -1}.get(name, 0)
            sign = 1 if name == f"outer_{region}" else sign
            a, b, c = np.moveaxis(mesh.points[mesh.triangles[mesh.boundary == k]], 1, 0)
            flow += sign * np.einsum("ij,ij->", a, np.cross(b, c)) / 6
        assert flow == pytest.approx(mesh.volumes()[mesh.region == number].sum(), rel=1e-9)


def test_ngsolve_integrates_each_region(made):
    *_, mesh = made
    solid = mesh.mesh()
    assert set(solid.GetBoundaries()) == set(mesh.boundaries)
    for k, name in enumerate(mesh.regions):
        volume = ngs.Integrate(ngs.CF(1), solid, definedon=solid.Materials(name))
        assert volume == pytest.approx(mesh.volumes()[mesh.region == k].sum(), rel=1e-9)


def test_edges_are_as_long_as_asked(made):
    _, _, size, _, mesh = made
    ends = mesh.points[mesh.tets[:, list(combinations(range(4), 2))].reshape(-1, 2)]
    relative = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / size(ends.mean(axis=1))
    assert 0.9 < relative.mean() < 1.3 and np.quantile(relative, 0.99) < 2


def crossing(points, triangles):
    """Pairs of triangles without a common corner, an edge of one of which pierces the other."""
    corners = points[triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    found = 0
    for i in range(len(triangles)):
        near = (low <= high[i]).all(axis=1) & (high >= low[i]).all(axis=1)
        near &= ~np.isin(triangles, triangles[i]).any(axis=1)
        a, b, c = np.moveaxis(corners[near], 1, 0)
        for p, q in ((0, 1), (1, 2), (2, 0)):
            start, end = corners[i, p], corners[i, q]
            normal = np.cross(b - a, c - a)
            s, t = (np.einsum("ij,ij->i", normal, at - a) for at in (start, end))
            sides = [
                np.einsum("ij,ij->i", np.cross(y - x, end - start), start - x) for x, y in ((a, b), (b, c), (c, a))
            ]
            same_side = np.abs(np.sign(sides).sum(axis=0)) == 3
            found += int((same_side & (s * t < 0)).sum())
    return found


def test_no_triangles_cross(made):
    name, *_, mesh = made
    assert crossing(mesh.points, mesh.triangles) == 0
    folded = mesh.points.copy()
    moved = mesh.triangles[0, 0]
    folded[moved] += 3 * (folded.mean(axis=0) - folded[moved])  # through the middle and out at the other side
    assert crossing(folded, mesh.triangles) > 0, name


def test_three_regions_meet_on_the_line():
    mesh = conforming(sectors(), same(3e-3))
    around = np.zeros((len(mesh.points), 3), bool)
    around[mesh.tets, mesh.region[:, None]] = True
    line = mesh.points[around.all(axis=1)]
    off = np.hypot(line[:, 0], line[:, 1])
    assert (off < 0.3 * MM).sum() > 3 and np.median(off) < 1.2 * MM and off.max() < 3.5 * MM  # elements of 3 mm
    assert np.ptp(line[:, 2]) > 24 * MM


def test_the_same_bits_twice():
    one, other = (conforming(touching(), same(4e-3)).arrays() for _ in range(2))
    assert all(np.array_equal(one[name], other[name]) for name in one)
    third = conforming(touching(), same(4e-3), seed=1)
    assert not np.array_equal(third.points, one["points"])


@pytest.mark.parametrize(
    "labels, size, message",
    [
        (lambda: labelled(np.zeros((9, 9, 9), int)), same(3e-3), "labels is 0 in every voxel"),
        (nested, same(-1.0), "size is -1 m somewhere; wanted: a number above 0"),
        (nested, same(np.nan), "size is nan m somewhere"),
        (nested, lambda points: 3e-3, r"size is an array of shape \(\)"),
        (nested, same(5e-5), r"size is so small that 1\.5e\+09 tetrahedra would result"),
        (nested, same(60e-3), "size is "),
    ],
)
def test_refusals(labels, size, message):
    with pytest.raises(InputError, match=message) as caught:
        conforming(labels(), size)
    assert "\n" not in str(caught.value)


def cloud(n=400, seed=2):
    points = np.random.default_rng(seed).random((n, 3))
    tets = Delaunay(points).simplices
    x = points[tets]
    turned = np.linalg.det(x[:, 1:] - x[:, :1]) > 0
    tets[turned] = tets[turned][:, [1, 0, 2, 3]]
    return points, tets


def hull_of(points, tets):
    """Vertices on the convex hull, where nothing can be improved."""
    return np.unique(interfaces(named_elements(points, tets, np.zeros(len(tets), int), ("one",)))[0])


def test_shapes_are_sines_and_negative_inside_out():
    points, tets = cloud()
    x = points[tets]
    sines = np.full(len(x), np.inf)
    for i, j in combinations(range(4), 2):
        k, m = sorted({0, 1, 2, 3} - {i, j})
        edge = x[:, j] - x[:, i]
        p, q = (np.cross(edge, x[:, c] - x[:, i]) for c in (k, m))
        sine = np.linalg.norm(np.cross(p, q), axis=1) / np.linalg.norm(p, axis=1) / np.linalg.norm(q, axis=1)
        sines = np.minimum(sines, sine)
    assert shape_quality(x) == pytest.approx(sines, rel=1e-6)
    assert shape_quality(x[:, [1, 0, 2, 3]]) == pytest.approx(-sines, rel=1e-6)


def test_swaps_keep_the_space_and_make_the_worst_better():
    points, tets = cloud()
    region = np.where(points[tets].mean(axis=1)[:, 0] < 0.5, 1, 2)
    before, hull = shape_quality(points[tets]), hull_of(points, tets)
    swaps = Reconnection(points, tets, region)
    assert swaps.improve(0.2) > 50
    new, regions = swaps.arrays()
    x = points[new]
    after, volumes = shape_quality(x), -np.linalg.det(x[:, 1:] - x[:, :1]) / 6
    was = -np.linalg.det(points[tets][:, 1:] - points[tets][:, :1]) / 6
    assert (volumes > 0).all() and volumes.sum() == pytest.approx(was.sum(), rel=1e-12)
    deep = [~np.isin(t, hull).any(axis=1) for t in (tets, new)]
    assert np.mean(after[deep[1]] < 0.1) < 0.3 * np.mean(before[deep[0]] < 0.1)
    assert np.bincount(regions, volumes) == pytest.approx(np.bincount(region, was), rel=0.02)
    faces, pairs = interfaces(named_elements(points, new, regions - 1, ("one", "two")))
    edges = np.sort(faces[(pairs > 0).all(axis=1)][:, [[0, 1], [0, 2], [1, 2]]].reshape(-1, 2), axis=1)
    free = ~np.isin(edges, hull).all(axis=1)
    assert (np.unique(edges[free], axis=0, return_counts=True)[1] % 2 == 0).all()  # the interface has no rim inside


def volumes_near(mesh, labels, site, radius):
    """Volumes of regions within a radius of a site, of the mesh and of the voxels."""
    corners, where = mesh.points[mesh.tets], np.random.default_rng(0).dirichlet(np.ones(4), 100)
    share = np.mean([np.linalg.norm(np.einsum("k,nkd->nd", w, corners) - site, axis=1) < radius for w in where], axis=0)
    numbers, count = labels.region_numbers(), len(labels.regions)
    at = labels.volume.to_world(np.argwhere(numbers > 0))
    wanted = np.bincount(numbers[numbers > 0], np.linalg.norm(at - site, axis=1) < radius, count + 1)[1:]
    return np.bincount(mesh.region, mesh.volumes() * share, count), wanted * labels.volume.voxel_volume


def test_a_graded_mesh_has_the_labels_volumes_where_it_is_fine():
    x, y, z = grid(60)
    r = np.sqrt(x**2 + y**2 + z**2)
    folds = 2 * np.cos(0.6 * x) * np.cos(0.6 * y)
    labels, site = labelled(np.select([r < 16 + folds, r < 24, r < 26], [3, 2, 1])), np.array([0, 0, 18 * MM])
    mesh = conforming(labels, lambda x: np.clip(2e-3 + 0.4 * (np.linalg.norm(x - site, axis=1) - 10 * MM), 2e-3, 6e-3))
    found, wanted = volumes_near(mesh, labels, site, 11.25 * MM)  # up to elements of 2.5 mm
    assert found[0] == pytest.approx(wanted[0], rel=0.06)  # fluid
    assert found[1:] == pytest.approx(wanted[1:], rel=0.0125)
    assert abs(volume_errors(mesh, labels)["white"]) < 0.01  # the film of fluid is lost where elements are larger


def test_vertices_that_fell_together_on_an_interface_part_again():
    mesh = conforming(nested(), same(4e-3))
    grey_white = mesh.triangles[mesh.boundary == mesh.boundaries.index("grey_white")]
    points, region = mesh.points.copy(), mesh.region + 1
    points[grey_white[0, 0]] += 0.97 * (points[grey_white[0, 1]] - points[grey_white[0, 0]])
    before = shape_quality(points[mesh.tets])
    assert 0 < before.min() < np.sin(np.radians(3))
    far = np.full(len(points), 0.6 * MM)
    parted = _freed(points, mesh.tets, region, far, np.random.default_rng(0))
    assert (
        shape_quality(parted[mesh.tets]).min() > np.sin(np.radians(5))
        and np.linalg.norm(parted - points, axis=1).max() < 0.601 * MM
    )
    good = shape_quality(points[mesh.tets]) > np.sin(np.radians(8))
    away = np.setdiff1d(np.arange(len(points)), mesh.tets[~good])
    assert np.array_equal(parted[away], points[away])


def test_a_face_is_swapped_inside_a_region_only():
    corners = [[np.cos(a), np.sin(a), 0.0] for a in 2 * np.pi / 3 * np.arange(3)]
    points = np.array([*corners, [0, 0, 0.25], [0, 0, -0.25]])
    tets = np.array([[0, 2, 1, 3], [0, 1, 2, 4]])
    if shape_quality(points[tets])[0] < 0:
        tets = tets[:, [0, 2, 1, 3]]
    assert (shape_quality(points[tets]) > 0).all()
    for region, count in (([1, 1], 3), ([1, 2], 2)):
        swaps = Reconnection(points, tets, np.array(region))
        assert swaps.improve(0.8) == count - 2 and len(swaps.arrays()[0]) == count
        assert (shape_quality(points[swaps.arrays()[0]]) > 0).all()


def test_a_flat_element_on_the_surface_joins_the_outside_unless_surfaces_would_touch():
    corners = [
        [0, 0, 0],
        [2, 0, 0],
        [1, 1, 0.1],
        [1, -1, 0.1],
    ]  # flat, its upper edge from 2 to 3, its lower one from 0 to 1
    points = np.array([*corners, [1, 0, 3.0], [1, 0.5, -3.0], [1, -0.5, -3.0]])
    tets = np.array([[0, 1, 2, 3], [0, 2, 3, 4], [1, 2, 3, 4], [0, 1, 2, 5], [0, 1, 3, 6], [0, 1, 5, 6]])
    turned = shape_quality(points[tets]) < 0
    tets[turned] = tets[turned][:, [1, 0, 2, 3]]
    for region, joins in (([1, 0, 0, 1, 1, 1], True), ([1, 1, 1, 0, 0, 0], True), ([1, 0, 0, 1, 1, 0], False)):
        swaps = Reconnection(points, tets, np.array(region))
        assert (swaps._remove_surface_tet(0) is not None) == joins
        swaps.improve(0.2)
        assert not joins or (swaps.arrays()[1] > 0).sum() == sum(region) - 1


def test_shares_that_are_filled_have_the_volume_of_a_thin_shell_but_for_a_quarter():
    labels = shell()
    smooth = Indicators.of(labels, 1.5e-3)
    wanted, before, after = (
        np.bincount(numbers.ravel(), minlength=3)[1]
        for numbers in (
            labels.region_numbers(),
            smooth.fractions.argmax(axis=0),
            smooth.correct_volumes(Zones.whole(labels)).fractions.argmax(axis=0),
        )
    )
    assert before < 0.9 * wanted and abs(wanted - after) < 0.4 * (wanted - before)
    assert (np.abs(smooth.correct_volumes(Zones.whole(labels)).fractions - smooth.fractions) <= MOST).all()


def test_a_film_is_filled_where_the_mesh_is_fine_though_the_head_has_fluid_enough():
    x, y, z = grid(48)
    r = np.sqrt(x**2 + y**2 + z**2)
    gap = (r > 15.5) & (r < np.where(z > 12, 17.2, 21))  # thin above, thick below
    labels, site = labelled(np.select([r < 10, gap, r < 22], [3, 1, 2])), np.array([0, 0, 16 * MM])
    zones = Zones.of(labels, lambda at: np.where(np.linalg.norm(at - site, axis=1) < 8 * MM, 2e-3, 6e-3), finest)
    smooth = Indicators.of(labels, 1.2e-3)
    near = np.linalg.norm(voxels_of(smooth) - site, axis=1) < 8 * MM
    plain, even, ours = (
        np.sum(fractions.argmax(axis=0).ravel()[near] == 1) * MM**3 / zones.target_volumes[0, 0]
        for fractions in (
            smooth.fractions,
            smooth.correct_volumes(Zones.whole(labels)).fractions,
            smooth.correct_volumes(zones).fractions,
        )
    )
    assert plain < 0.7 and even < 0.5 and ours == pytest.approx(1, abs=0.1)


def finest(h, smallest, largest):
    return h == smallest


def voxels_of(indicators):
    return np.argwhere(indicators.fractions[0] >= 0) @ indicators.affine[:3, :3].T + indicators.affine[:3, 3]


def test_large_elements_leave_no_spikes():
    made = conforming(shell(), same(5e-3))
    outer = np.isin(made.boundary, [k for k, name in enumerate(made.boundaries) if name.startswith("outer")])
    away = np.linalg.norm(made.points[np.unique(made.triangles[outer])], axis=1)
    assert away.max() < 19e-3


def test_moves_make_the_worst_better_and_stay_where_they_may():
    points, tets = cloud()
    hull = np.zeros(len(points), bool)
    hull[hull_of(points, tets)] = True

    def place(vertices, wanted):
        return np.where(hull[vertices, None], points[vertices], wanted)

    new = smooth_vertices(points, tets, np.ones(len(tets), bool), place, 0.2, 10, np.random.default_rng(0))
    assert np.array_equal(new[hull], points[hull]) and not np.array_equal(new, points)
    before, after = shape_quality(points[tets]), shape_quality(new[tets])
    deep = ~hull[tets].any(axis=1)
    assert (after > 0).all() and np.mean(after[deep] < 0.1) < 0.75 * np.mean(before[deep] < 0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("site", "p95"), [((0.03, 0.0, 0.05), 1.0), ((0.02, -0.08, 0.03), 1.0), ((0.03, -0.07, 0.02), 1.3)]
)
def test_a_graded_head(site, p95):
    """Near the third site there are .22 ml of fluid, of which the smoothed labels (the reference of distances) keep a quarter."""
    from ngbrain.image import mni152
    from ngbrain.surgery.head_models import ScannedHead

    labels = LabelMap(ScannedHead.from_scan(mni152()).labels, {**NAMES, 4: "ventricle"})
    mesh = conforming(labels, RadialSizeField(2e-3, 8e-3, site, ROUTES["conforming"].radius))
    quality, errors = Quality.of(mesh), volume_errors(mesh, labels)
    assert quality.n_tets < 80_000 and quality.dihedrals.min() > 3 and (quality.ratios < 0.1).mean() < 1e-3
    assert abs(errors["white"]) < 0.01 and abs(errors["ventricle"]) < 0.01
    assert abs(errors["grey"]) < 0.02 and abs(errors["csf"]) < 0.12
    found, wanted = volumes_near(mesh, labels, site, 20e-3)
    assert found[0] == pytest.approx(wanted[0], rel=0.12) and found[1:3] == pytest.approx(wanted[1:3], rel=0.02)
    near = deviations(mesh, Indicators.of(labels), lambda points: np.linalg.norm(points - site, axis=1) < 20e-3)
    found = np.concatenate(list(near.values()))
    assert found.mean() < 0.33 * MM and np.quantile(found, 0.95) < p95 * MM
