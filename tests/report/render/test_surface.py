"""Surfaces and sections of meshes against closed forms, and their rendering."""

import netgen.occ as occ
import ngsolve as ng
import numpy as np
import pytest

from ngbrain.io import QuadraticGrid
from ngbrain.report.pictures import frame
from ngbrain.report.render import renderer, surface

RADIUS = 0.05  # m


def grid_of(shape: occ.TopoDS_Shape, maxh: float, curve: int = 1) -> QuadraticGrid:
    return QuadraticGrid(ng.Mesh(occ.OCCGeometry(shape).GenerateMesh(maxh=maxh)).Curve(curve))


@pytest.fixture(scope="module")
def box() -> QuadraticGrid:
    """1 x 2 x 3, the lower half another region."""
    low, high = occ.Box((0, 0, 0), (1, 2, 1.5)), occ.Box((0, 0, 1.5), (1, 2, 3))
    low.mat("low"), high.mat("high")
    return grid_of(occ.Glue([low, high]), 0.6)


@pytest.fixture(scope="module")
def ball() -> QuadraticGrid:
    return grid_of(occ.Sphere((0, 0, 0), RADIUS), 0.02, 2)


def edge_balance(tris: np.ndarray) -> np.ndarray:
    """Number of traversals of each edge in one direction minus the other: 0 on a closed, oriented surface."""
    edges = np.concatenate([tris[:, [0, 1]], tris[:, [1, 2]], tris[:, [2, 0]]])
    way = np.where(edges[:, 0] < edges[:, 1], 1, -1)
    _, number = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    return np.bincount(number.ravel(), way)


def enclosed(points: np.ndarray, tris: np.ndarray) -> float:
    return float(np.linalg.det(points[tris]).sum() / 6)


def test_the_surface_of_a_box_is_closed_and_has_its_area_and_volume(box: QuadraticGrid) -> None:
    tris = surface.triangles(surface.faces(box.connectivity))
    assert not edge_balance(tris).any()
    assert surface.area(box.points, tris) == pytest.approx(22, rel=1e-12)
    assert enclosed(box.points, tris) == pytest.approx(6, rel=1e-12)  # outwards


def test_the_surface_of_a_curved_ball(ball: QuadraticGrid) -> None:
    tris = surface.triangles(surface.faces(ball.connectivity))
    assert not edge_balance(tris).any()
    assert surface.area(ball.points, tris) == pytest.approx(4 * np.pi * RADIUS**2, rel=0.02)
    normals = surface.vertex_normals(ball.points, tris)[np.unique(tris)]
    outwards = ball.points[np.unique(tris)] / RADIUS
    assert np.min(np.sum(normals * outwards, axis=1)) > 0.98


def test_faces_between_regions_come_once(box: QuadraticGrid) -> None:
    tris = surface.triangles(surface.faces(box.connectivity, np.array(box.region_names)[box.region]))
    assert surface.area(box.points, tris) == pytest.approx(22 + 2, rel=1e-12)


def test_a_region_alone_is_closed(box: QuadraticGrid) -> None:
    tris = surface.triangles(surface.faces(box.connectivity[box.region == box.region[0]]))
    assert not edge_balance(tris).any()
    assert surface.area(box.points, tris) == pytest.approx(2 * (2 + 1.5 + 3), rel=1e-12)


@pytest.mark.parametrize("normal", [(1, 0, 0), (0, 0, 1), (1, 1, 0)])
def test_a_section_of_a_box_has_its_area_and_keeps_linear_fields(
    box: QuadraticGrid, normal: tuple[int, int, int]
) -> None:
    n = np.array(normal) / np.linalg.norm(normal)
    centre = np.array([0.5, 1.0, 1.5])  # on the plane between the regions, for the normal along z: nodes lie on it
    cut = surface.cut_volume(box.connectivity, (box.points - centre) @ n)
    area = {(1, 0, 0): 6.0, (0, 0, 1): 2.0, (1, 1, 0): 3 * np.sqrt(2)}[normal]
    points = cut.interpolate(box.points)
    assert surface.area(points, cut.simplices) == pytest.approx(area, rel=1e-12)
    assert np.abs((points - centre) @ n).max() < 1e-12
    assert cut.interpolate(box.points @ [1, 2, 3]) == pytest.approx(points @ [1, 2, 3])


def test_a_section_of_a_ball_and_its_outline(ball: QuadraticGrid) -> None:
    height = 0.4 * RADIUS
    radius = np.sqrt(RADIUS**2 - height**2)
    level = ball.points[:, 2] - height
    cut = surface.cut_volume(ball.connectivity, level)
    assert surface.area(cut.interpolate(ball.points), cut.simplices) == pytest.approx(np.pi * radius**2, rel=0.02)
    line = surface.cut_surface(surface.triangles(surface.faces(ball.connectivity)), level)
    ends = line.interpolate(ball.points)[line.simplices]
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(2 * np.pi * radius, rel=0.02)
    assert (np.bincount(line.simplices.ravel()) == 2).all()  # closed


def test_strain_at_a_folded_corner_is_replaced_and_no_other(ball: QuadraticGrid) -> None:
    stretch = 1.1
    points = ball.points * [stretch, 1, 1]
    true = (stretch**2 - 1) / 2
    strain = np.full(len(points), true)
    assert frame.smooth_folded_strain(ball.connectivity, ball.points, points, strain) is strain
    rest = ball.points.copy()
    a, _, _, d, *middles = ball.connectivity[0]
    rest[middles[3]] = rest[a] + 0.26 * (rest[d] - rest[a])  # the edge's map stands nearly still at a
    strain[a] = 40.0
    mended = frame.smooth_folded_strain(ball.connectivity, rest, rest * [stretch, 1, 1], strain)
    assert mended == pytest.approx(true, rel=1e-12)


def test_the_nearer_of_two_squares_is_seen_and_a_clipped_one_is_not() -> None:
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    tris = np.array([[0, 1, 2], [0, 2, 3]])
    x, y, z = np.eye(3)
    camera = renderer.Camera.look_at(np.zeros(3), z, y, 2.0, 2.0)
    assert np.allclose(camera.right, x)
    red = renderer.Layer(square, tris, np.array([1.0, 0, 0]), lit=0)
    blue = renderer.Layer(square + 0.5 * z, tris, np.array([0, 0, 1.0]), lit=0, clip=square[:, 0])
    image = renderer.draw(camera, [blue, red], 40, 40)
    assert tuple(image[20, 5]) == (255, 255, 255)
    assert tuple(image[20, 15]) == (255, 0, 0)
    assert tuple(image[20, 25]) == (0, 0, 255)
    assert (image[:, :, 1] < 128).sum() == pytest.approx(20 * 20, abs=0)
