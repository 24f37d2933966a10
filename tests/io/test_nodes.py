"""Nodes in the order VTK wants them, on the curved geometry, and fields at them."""

import netgen.occ as occ
import ngsolve as ng
import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.io import QuadraticGrid
from ngbrain.io.mesh_arrays import build_mesh, mesh_arrays

RADIUS = 0.05  # m
# The vertices on either side of nodes 4..9 of VTK_QUADRATIC_TETRA.
VTK_EDGES = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]


@pytest.fixture(scope="module")
def cube() -> QuadraticGrid:
    return QuadraticGrid(ng.Mesh(occ.unit_cube.GenerateMesh(maxh=0.4)))


@pytest.fixture(scope="module")
def ball() -> QuadraticGrid:
    """A curved ball of "brain" in a box of "csf"; the names are as awkward as users make them."""
    ball = occ.Sphere((0, 0, 0), RADIUS)
    ball.faces.name = "pia"
    box = occ.Box((-0.08, -0.08, -0.08), (0.08, 0.08, 0.08)) - ball
    ball.mat("brain"), box.mat("liquor ä")
    mesh = ng.Mesh(occ.OCCGeometry(occ.Glue([ball, box])).GenerateMesh(maxh=0.04))
    return QuadraticGrid(mesh.Curve(2))


def corner_volumes(grid: QuadraticGrid) -> np.ndarray:
    corners = grid.points[grid.connectivity[:, :4]]
    return np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6


def test_midpoints_lie_between_the_vertices_vtk_expects(cube):
    corners = cube.points[cube.connectivity[:, :4]]
    middles = cube.points[cube.connectivity[:, 4:]]
    assert np.allclose(middles, corners[:, VTK_EDGES].mean(axis=2), rtol=0, atol=1e-12)


def test_nodes_are_numbered_as_ngsolve_numbers_vertices_and_edges(cube):
    mesh = cube.mesh
    assert len(cube.points) == mesh.nv + mesh.nedge
    assert np.array_equal(cube.points[: mesh.nv], [v.point for v in mesh.vertices])
    ends = np.array([[v.nr for v in e.vertices] for e in mesh.edges])
    assert np.allclose(cube.points[mesh.nv :], cube.points[ends].mean(axis=1), rtol=0, atol=1e-12)


def test_tetrahedra_are_positive_and_fill_the_volume(cube):
    volumes = corner_volumes(cube)
    assert volumes.min() > 0
    assert volumes.sum() == pytest.approx(ng.Integrate(1, cube.mesh), abs=1e-12)
    # NGSolve's order is the other one: were it ever to change, the flip must not be blind.
    first = next(iter(cube.mesh.Elements(ng.VOL)))
    a, b, c, d = (np.array(cube.mesh[v].point) for v in first.vertices)
    assert np.linalg.det([b - a, c - a, d - a]) < 0


def test_a_positive_ngsolve_tetrahedron_is_not_flipped():
    from netgen.meshing import Element3D, FaceDescriptor, Mesh, MeshPoint, Pnt

    for order in ([1, 2, 3, 4], [2, 1, 3, 4]):
        raw = Mesh(dim=3)
        for corner in [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]:
            raw.Add(MeshPoint(Pnt(*corner)))
        raw.Add(FaceDescriptor(surfnr=1, domin=1, bc=1))
        raw.Add(Element3D(1, order))
        grid = QuadraticGrid(ng.Mesh(raw))
        assert corner_volumes(grid) == pytest.approx([1 / 6])
        corners, middles = np.split(grid.points[grid.connectivity[0]], [4])
        assert np.allclose(middles, corners[VTK_EDGES].mean(axis=1))


def test_quadratic_fields_are_exact_at_the_nodes(cube):
    u = ng.GridFunction(ng.VectorH1(cube.mesh, order=2))
    u.Set(ng.CF((ng.x**2 - ng.y * ng.z, ng.z**2 + 3 * ng.x, ng.x * ng.y)))
    x, y, z = cube.points.T
    exact = np.stack([x**2 - y * z, z**2 + 3 * x, x * y], axis=1)
    assert abs(cube.values(u) - exact).max() < 1e-12
    assert abs(cube.values(u[1]) - exact[:, 1]).max() < 1e-12
    gradient = np.stack([2 * x, -z, -y, 3 + 0 * x, 0 * x, 2 * z, y, x, 0 * x], axis=1)
    assert abs(cube.values(ng.Grad(u)) - gradient).max() < 1e-11
    assert np.array_equal(cube.values(2.5), np.full(len(x), 2.5))


def on_sphere(ball: QuadraticGrid) -> np.ndarray:
    """Mask of the nodes that belong to tetrahedra of both regions."""
    return (ball.values(1, regions="brain") == 1) & (ball.values(1, regions="liquor.*") == 1)


def test_nodes_lie_on_the_curved_geometry(ball):
    middles = ball.points[on_sphere(ball) & (np.arange(len(ball.points)) >= ball.mesh.nv)]
    straight = ball.points[ball.connectivity[:, :4]][:, VTK_EDGES].mean(axis=2)
    assert abs(ball.points[ball.connectivity[:, 4:]] - straight).max() > 0.03 * RADIUS
    # NGSolve curves by projection: its edges are within 1e-3 of the sphere here, straight ones 40 times as far.
    assert len(middles) > 100 and abs(np.linalg.norm(middles, axis=1) - RADIUS).max() < 1e-3 * RADIUS


def test_the_quadratic_tetrahedra_are_the_curved_mesh(ball):
    """VTK's shape functions on our nodes give NGSolve's volume, region by region: both maps are the same polynomial."""
    rule = ng.IntegrationRule(ng.TET, 4)
    volumes = np.zeros(len(ball.connectivity))
    for point, weight in zip(rule.points, rule.weights, strict=True):
        bary = np.array([1 - sum(point), *point])
        dbary = np.vstack([[-1, -1, -1], np.eye(3)])
        middles = [4 * (bary[i] * dbary[j] + bary[j] * dbary[i]) for i, j in VTK_EDGES]
        slopes = np.vstack([(4 * bary[:, None] - 1) * dbary, middles])  # (10, 3), d shape / d reference coordinate
        jacobian = np.linalg.det(np.einsum("tnx,nr->trx", ball.points[ball.connectivity], slopes))
        assert jacobian.min() > 0
        volumes += weight * jacobian
    expected = ng.Integrate(1, ball.mesh, region_wise=True)
    assert np.bincount(ball.region, volumes) == pytest.approx(list(expected), rel=1e-12)


def test_jumps_are_averaged_and_regions_chosen(ball):
    jump = ball.mesh.MaterialCF({"brain": 1.0, "liquor ä": 3.0})
    everywhere, brain = ball.values(jump), ball.values(jump, regions="brain")
    border, inside = on_sphere(ball), np.linalg.norm(ball.points, axis=1) < RADIUS
    assert np.allclose(everywhere[inside & ~border], 1) and np.allclose(everywhere[~inside & ~border], 3)
    assert ((everywhere[border] > 1) & (everywhere[border] < 3)).all()
    assert np.array_equal(brain, np.where(inside | border, 1.0, 0.0))
    centres = ball.points[ball.connectivity[:, :4]].mean(axis=1)
    assert np.array_equal(np.array(ball.region_names)[ball.region] == "brain", np.linalg.norm(centres, axis=1) < RADIUS)


def test_unfit_meshes_and_fields_are_refused(cube):
    with pytest.raises(InputError, match="tetrahedra"):
        QuadraticGrid(ng.Mesh(occ.OCCGeometry(occ.Rectangle(1, 1).Face(), dim=2).GenerateMesh(maxh=1)))
    with pytest.raises(InputError, match="real one"):
        cube.values(ng.CF(1j))
    with pytest.raises(InputError, match="regions is 'brian'"):
        cube.values(ng.x, regions="brian")

    mesh = ng.Mesh(occ.unit_cube.GenerateMesh(maxh=1))
    mesh.SetDeformation(ng.GridFunction(ng.VectorH1(mesh)))
    with pytest.raises(InputError, match="UnsetDeformation"):
        QuadraticGrid(mesh)


def test_a_mesh_whose_numbering_would_be_lost_is_refused():
    mesh = ng.Mesh(occ.unit_cube.GenerateMesh(maxh=1))
    mesh.Refine()
    with pytest.raises(InputError, match="refined"):
        QuadraticGrid(mesh)
    assert QuadraticGrid(build_mesh(mesh_arrays(mesh))).mesh.ne == mesh.ne


def test_a_mesh_curved_by_cubics_is_refused():
    mesh = ng.Mesh(occ.OCCGeometry(occ.Sphere((0, 0, 0), 1)).GenerateMesh(maxh=1)).Curve(3)
    with pytest.raises(InputError, match="degree 3"):
        QuadraticGrid(mesh)
