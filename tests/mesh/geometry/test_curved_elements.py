"""Curved elements: none folds, edges stay on the geometry where possible, and the rest of the mesh is unchanged."""

import netgen.occ as occ
import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.io.mesh_arrays import build_mesh
from ngbrain.io.nodes import QuadraticGrid
from ngbrain.mesh import Sizes, cleft_to, idealised_head
from ngbrain.mesh.geometry import primitives
from ngbrain.mesh.geometry.curved_elements import _EDGES, LOWEST, curve, determinants

# Vertices, points of the edges (their middles too), of the faces and inside, for NGSolve's own map.
LATTICE = [p for p in np.ndindex(7, 7, 7) if sum(p) <= 6]
RULE = ngs.IntegrationRule([tuple(c / 6 for c in p) for p in LATTICE], [0.0] * len(LATTICE))
RADIUS = 0.01


def scaled_jacobians(mesh):
    """Smallest over largest determinant of every element."""
    points = mesh.MapToAllElements({ngs.ET.TET: RULE}, ngs.VOL)
    values = np.array(ngs.Det(ngs.specialcf.JacobianMatrix(3))(points)).reshape(mesh.ne, -1)
    return values.min(axis=1) / values.max(axis=1)


def volume(mesh):
    return ngs.Integrate(ngs.CF(1), mesh)


def ball(maxh=1.2 * RADIUS):
    return occ.OCCGeometry(occ.Sphere((0, 0, 0), RADIUS)).GenerateMesh(maxh=maxh, curvaturesafety=0.5)


def curved_ball(*args):
    mesh = ball(*args)
    curve(mesh)
    return mesh


def with_and_without(monkeypatch, target, sizes):
    """A head's mesh, and the same mesh with every edge on the geometry."""
    straight = []

    def curve_a_copy_too(mesh):
        straight.append(mesh.Copy())
        return curve(mesh)

    monkeypatch.setattr(primitives, "curve", curve_a_copy_too)
    mesh = idealised_head(cleft_to(1e-3 * np.array(target)), sizes=sizes)
    straight[0].SecondOrder()
    return mesh, ngs.Mesh(straight[0])


@pytest.mark.parametrize(
    ("target", "sizes"),
    [
        pytest.param((-6.1, -61.5, -11.6), (4, 10, 24), id="left, back, near the surface"),
        pytest.param((0.0, 0.0, 6.0), (3, 8, 24), id="between the ventricles"),
        pytest.param((17.0, 5.9, 26.2), (3, 8, 24), id="right and high", marks=pytest.mark.slow),
        pytest.param((-25.0, -20.0, -35.0), (5, 12, 30), id="left, low and deep, coarsest", marks=pytest.mark.slow),
        pytest.param((55.0, 10.0, 10.0), (2, 6, 20), id="right, near the surface, fine", marks=pytest.mark.slow),
        pytest.param((1.0, -5.0, -10.0), (2, 6, 20), id="deepest, fine", marks=pytest.mark.slow),
    ],
)
def test_no_element_of_a_head_folds(monkeypatch, target, sizes):
    mesh, naive = with_and_without(monkeypatch, target, Sizes(*(1e-3 * s for s in sizes)))
    assert scaled_jacobians(naive).min() < 0
    assert scaled_jacobians(mesh).min() > 0.999 * LOWEST
    assert volume(mesh) == pytest.approx(volume(naive), rel=2e-4)
    assert (mesh.ne, mesh.nv, mesh.nedge) == (naive.ne, naive.nv, naive.nedge)


def test_a_ball_keeps_all_edges_on_its_surface_but_those_pulled_back():
    naive, ours = ball(), ball()
    naive.SecondOrder()
    pulled = curve(ours)
    before, after = naive.Coordinates(), ours.Coordinates()
    moved = np.linalg.norm(after - before, axis=1) > 0
    assert 0 < pulled == moved.sum()
    assert scaled_jacobians(ngs.Mesh(naive)).min() < LOWEST / 2
    mesh = ngs.Mesh(ours)
    assert scaled_jacobians(mesh).min() > 0.999 * LOWEST
    assert not moved[: mesh.nv].any()
    on_surface = np.unique(np.array([[v.nr for v in el.vertices] for el in ours.Elements2D()])) - 1
    assert np.allclose(np.linalg.norm(after[on_surface[~moved[on_surface]]], axis=1), RADIUS, rtol=1e-9)
    # A pulled node lies between the shape and the straight edge.
    assert (np.linalg.norm(after[moved], axis=1) < RADIUS).all()


def test_a_fine_ball_is_round():
    fine, coarse = curved_ball(0.35 * RADIUS), curved_ball()
    missing = [abs(volume(ngs.Mesh(m)) / (4 / 3 * np.pi * RADIUS**3) - 1) for m in (fine, coarse)]
    assert missing[0] < 1e-3 < missing[1]


def test_a_box_has_nothing_to_pull():
    mesh = occ.OCCGeometry(occ.Box((0, 0, 0), (1, 1, 1))).GenerateMesh(maxh=0.6)
    assert curve(mesh) == 0
    assert volume(ngs.Mesh(mesh)) == pytest.approx(1, rel=1e-12)


def test_coefficients_bound_the_determinant(rng):
    """Comparison with derivatives of the shape functions at interior points, for randomly deformed elements."""
    corners = np.vstack([np.eye(3), np.zeros((1, 3))])
    straight = np.vstack([corners, corners[_EDGES].mean(axis=1)])
    elements = straight + 0.1 * rng.standard_normal((50, 10, 3))
    coefficients = determinants(elements)
    for at in np.vstack([np.eye(4), rng.dirichlet(np.ones(4), 200)]):
        slopes = np.zeros((10, 4))
        slopes[range(4), range(4)] = 4 * at - 1
        for k, (i, j) in enumerate(_EDGES, start=4):
            slopes[k, i], slopes[k, j] = 4 * at[j], 4 * at[i]
        value = np.linalg.det(elements.transpose(0, 2, 1) @ (slopes[:, :3] - slopes[:, 3:]))
        assert (coefficients.min(axis=1) <= value + 1e-12).all() and (value - 1e-12 <= coefficients.max(axis=1)).all()
        if at.max() == 1:  # at a vertex the bound is sharp
            assert np.allclose(coefficients[:, [0, 10, 16, 19][int(at.argmax())]], value)


def test_an_element_that_is_inside_out_is_refused():
    mesh = ball()
    mesh.Coordinates()[mesh.Elements3D().NumPy()["nodes"][0, 0] - 1] *= -3
    with pytest.raises(InputError, match="inside out; wanted: smaller elements"):
        curve(mesh)


def test_nodes_of_a_file_are_those_of_the_mesh_and_come_back():
    mesh = ngs.Mesh(curved_ball())
    grid = QuadraticGrid(mesh)
    inside = {tuple(row) for row in mesh.ngmesh.Coordinates().round(12)}
    assert len(grid.points) == len(inside) and {tuple(row) for row in grid.points.round(12)} == inside
    again = QuadraticGrid(build_mesh(grid.arrays))
    assert np.array_equal(again.points, grid.points) and np.array_equal(again.connectivity, grid.connectivity)


@pytest.mark.parametrize("order", [2, 3])
def test_fields_and_divergences_see_the_curved_elements(order):
    mesh = ngs.Mesh(curved_ball())
    space = ngs.VectorH1(mesh, order=order)
    field = ngs.GridFunction(space)
    field.Set(ngs.CF((ngs.x, 2 * ngs.y, 3 * ngs.z)))
    gap = ngs.Grad(field) - ngs.CF((1, 0, 0, 0, 2, 0, 0, 0, 3), dims=(3, 3))
    assert ngs.Integrate(ngs.InnerProduct(gap, gap), mesh) < 1e-20
    assert order > 2 or space.ndof == 3 * (mesh.nv + mesh.nedge)
    flux = ngs.Integrate(field * ngs.specialcf.normal(3), mesh, definedon=mesh.Boundaries(".*"))
    assert flux == pytest.approx(6 * volume(mesh), rel=1e-12)
