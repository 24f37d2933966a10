"""Curved interfaces of balls: radii and volumes, no folds even for large moves, refusals."""

from dataclasses import replace
from itertools import combinations

import ngsolve as ngs
import numpy as np
import pytest
from ngsolve.comp import IntegrationRuleSpace

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume
from ngbrain.mesh.geometry.curved_elements import curve
from ngbrain.mesh.improve.curving import RETURNED, curve_interfaces, second_order_mesh
from ngbrain.mesh.improve.volume_matching import QuadraticInterfaces
from ngbrain.mesh.labels.indicators import Indicators
from ngbrain.mesh.labels.volume_zones import Zones
from ngbrain.mesh.routes.conforming import conforming
from ngbrain.mesh.routes.registry import min_jacobian

MM = 1e-3
RADII = {"outer_grey": 16.0, "grey_white": 9.0}


@pytest.fixture(scope="module")
def balls():
    r = np.linalg.norm(np.indices((40, 40, 40)) - 19.5, axis=0)
    affine = np.diag([MM, MM, MM, 1.0])
    affine[:3, 3] = -19.5 * MM
    labels = LabelMap(Volume(np.select([r < 9, r < 16], [2, 1]), affine), {1: "grey", 2: "white"})
    outside, white = 1 / (1 + np.exp(2 * (16 - r))), 1 / (1 + np.exp(2 * (r - 9)))  # half where the spheres are
    indicators = Indicators(np.stack([outside, 1 - outside - white, white]), affine, ("grey", "white"))
    return conforming(labels, lambda points: np.full(len(points), 4e-3)), indicators


def off(mesh, name):
    """Mean distance (mm) of a boundary from its sphere."""
    r, on = ngs.sqrt(ngs.x**2 + ngs.y**2 + ngs.z**2) / MM, mesh.Boundaries(name)
    area = ngs.Integrate(ngs.CF(1), mesh, ngs.BND, definedon=on)
    return ngs.Integrate(ngs.sqrt((r - RADII[name]) ** 2), mesh, ngs.BND, definedon=on, order=8) / area


def smallest_determinant(mesh, deformation):
    mesh.UnsetDeformation()
    values = ngs.GridFunction(IntegrationRuleSpace(mesh, order=6))
    values.Interpolate(ngs.Det(ngs.Id(3) + ngs.Grad(deformation)))
    return values.vec.FV().NumPy().min()


def test_interfaces_come_closer_to_the_spheres(balls):
    elements, indicators = balls
    mesh = elements.mesh()
    before = {name: off(mesh, name) for name in RADII}
    done = curve_interfaces(mesh, indicators)
    after = {name: off(mesh, name) for name in RADII}
    assert all(after[name] < 0.1 and after[name] < 0.5 * before[name] for name in RADII)
    assert done.distance_after.mean() < 0.4 * done.distance_before.mean() and done.distance_after.mean() < 0.06 * MM
    assert (
        len(done.sample_points) == len(done.distance_before) == len(done.distance_after)
        and done.sample_points.shape[1] == 3
    )
    assert smallest_determinant(mesh, done.deformation) > 0


def test_of_first_order_the_vertices_come_to_the_spheres(balls):
    elements, indicators = balls
    mesh = elements.mesh()
    done = curve_interfaces(mesh, indicators, order=1)
    shift = np.stack([part.vec.FV().NumPy() for part in done.deformation.components], axis=1)
    assert len(shift) == len(elements.points)
    for k, name in enumerate(elements.boundaries):
        vertices = np.unique(elements.triangles[elements.boundary == k])
        r = np.linalg.norm(elements.points[vertices] + shift[vertices], axis=1) / MM
        assert np.mean(np.abs(r - RADII[name]) < 0.06) > 0.95
    inner = np.setdiff1d(np.arange(len(shift)), elements.triangles)
    assert not shift[inner].any() and smallest_determinant(mesh, done.deformation) > 0


def test_volumes_are_the_balls(balls):
    elements, indicators = balls
    mesh = elements.mesh()
    curve_interfaces(mesh, indicators)
    white = ngs.Integrate(ngs.CF(1), mesh, definedon=mesh.Materials("white"), order=6)
    whole = ngs.Integrate(ngs.CF(1), mesh, order=6)
    assert white == pytest.approx(4 / 3 * np.pi * 9e-3**3, rel=0.015)
    assert whole == pytest.approx(4 / 3 * np.pi * 16e-3**3, rel=0.01)


def test_nothing_folds_however_far_nodes_should_go(balls):
    elements, indicators = balls
    moved = Indicators(
        indicators.fractions, indicators.affine + np.pad([[3.5e-3]], ((0, 3), (3, 0))), indicators.regions
    )
    mesh = elements.mesh()
    done = curve_interfaces(mesh, moved, furthest=10 * MM)
    assert done.held_back > 0.1 and done.distance_after.mean() < done.distance_before.mean()
    assert smallest_determinant(mesh, done.deformation) > 0
    mesh = elements.mesh()
    assert curve_interfaces(mesh, indicators, furthest=10 * MM).held_back < done.held_back


def test_a_bent_mesh_is_given_back_most_of_what_its_regions_lose():
    x, y, z = np.indices((44, 44, 44)) - 21.5
    r = np.sqrt(x**2 + y**2 + z**2)
    numbers = np.select([r < 6, r < 12, r < 17, r < 18.5], [4, 3, 2, 1])
    numbers[(np.abs(x) < 1) & (z > 4) & (r < 17) & (r > 12)] = 1  # a sulcus
    names = {1: "csf", 2: "grey", 3: "white", 4: "ventricles"}
    labels = LabelMap(Volume(numbers, np.diag([MM, MM, MM, 1.0])), names)
    straight = conforming(labels, lambda points: np.full(len(points), 3e-3))
    mesh, done = second_order_mesh(straight, labels)
    without = straight.mesh()
    indicators = Indicators.of(labels)
    curve_interfaces(without, indicators, towards=indicators.correct_volumes(Zones.whole(labels)))
    wanted = 1e-6 * np.array([labels.volumes_ml()[name] for name in mesh.GetMaterials()])
    lost, now = (np.array(ngs.Integrate(ngs.CF(1), m, order=6, region_wise=True)) - wanted for m in (without, mesh))
    assert lost[0] < -0.1 * wanted[0]  # fluid
    assert now == pytest.approx((1 - RETURNED) * lost, abs=2e-3 * wanted.min())
    assert done.distance_after.mean() < 0.8 * done.distance_before.mean() and min_jacobian(mesh) > 0
    inwards = replace(straight, triangles=straight.triangles[:, [0, 2, 1]])
    with pytest.raises(
        InputError, match="triangles enclose other volumes than regions have; wanted: triangles outwards"
    ):
        second_order_mesh(inwards, labels)


def test_volumes_of_curved_interfaces_are_those_that_ngsolve_integrates(balls):
    elements, indicators = balls
    mesh = elements.mesh()
    done = curve_interfaces(mesh, indicators)
    found = ngs.Integrate(ngs.CF(1), mesh, order=6, region_wise=True)
    middles = {
        tuple(sorted(tet[[i, j]])): tet[4 + k]
        for tet in done.element_nodes
        for k, (i, j) in enumerate(combinations(range(4), 2))
    }
    six = [[*t, *(middles[tuple(sorted(pair))] for pair in combinations(t, 2))] for t in elements.triangles.tolist()]
    pairs = np.array([{"outer_grey": (1, 0), "grey_white": (1, 2)}[elements.boundaries[k]] for k in elements.boundary])
    surface = QuadraticInterfaces(np.array(six), pairs, 2)
    assert surface.volumes(done.node_positions) == pytest.approx([float(v) for v in found], rel=1e-9)
    rng = np.random.default_rng(0)
    step = 1e-6 * rng.normal(size=done.node_positions.shape)
    change = (surface.volumes(done.node_positions + step) - surface.volumes(done.node_positions - step)) / 2
    assert np.einsum("vd,vdr->r", step, surface.slopes(done.node_positions)) == pytest.approx(change, rel=1e-6)


def test_refusals(balls):
    elements, indicators = balls
    with pytest.raises(InputError, match="order is 3; wanted: 1 or 2"):
        curve_interfaces(elements.mesh(), indicators, order=3)
    other = Indicators(indicators.fractions, indicators.affine, ("csf", "bone"))
    with pytest.raises(InputError, match="mesh is one with boundaries outer_grey, grey_white"):
        curve_interfaces(elements.mesh(), other)
    second_order_mesh = elements.mesh().ngmesh
    curve(second_order_mesh)
    with pytest.raises(InputError, match="mesh is curved already"):
        curve_interfaces(ngs.Mesh(second_order_mesh), indicators)
