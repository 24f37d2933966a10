"""Driven part of the boundary by the points' flags: sides, waves with a free edge in closed form, inversions."""

from dataclasses import replace

import ngsolve as ngs
import numpy as np
import pytest
from planewaves import RHO, grid

from ngbrain.errors import InputError
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.inverse.problem.boundary_data import FREE, free_boundary
from ngbrain.inverse.problem.discretisation import discretise, original_discretisation
from ngbrain.inverse.problem.property_fields import discretise_lattice
from ngbrain.inverse.problem.voxel_lattice import build_lattice
from ngbrain.inverse.problem.wave_problem import ElastographyProblem
from ngbrain.inverse.subzones.partition import cut_zones, zone_data
from ngbrain.inverse.subzones.zone_result import problem_digest
from ngbrain.io.waves import WaveData
from ngbrain.report.pages.parameters import facts

SHEAR, FREQUENCY, STEP = 2500 + 500j, 60.0, 3e-3


def standing(*shape, free="low", spacing=STEP, **changes):
    """Waves u_x(h) = cos kh of shear on a grid, h along the last axis: no forces at h = 0. Its low or its high end is free."""
    points = grid(*shape, spacing=spacing)
    height = points[:, -1]
    u = np.zeros((1, *points.shape), complex)
    u[0, :, 0] = 1e-5 * np.cos(2 * np.pi * FREQUENCY * np.sqrt(RHO / SHEAR) * height)
    end = height < 1e-9 if free == "low" else height > height.max() - 1e-9
    given = {"poisson": 0.4, "truth": {"shear": np.full(len(points), SHEAR)}, **changes}
    data = WaveData(points, u, [FREQUENCY], RHO, "isotropic", "viscoelastic", **given)
    inner = end & np.all([(x > 1e-9) & (x < x.max() - 1e-9) for x in points.T[:-1]], axis=0)
    return replace(data, dirichlet=data.border & ~inner)


def flagged(data, *points):
    """The same, flags at these points turned."""
    flags = data.dirichlet.copy()
    flags[list(points)] ^= True
    return replace(data, dirichlet=flags)


MADE = {
    "their own": (original_discretisation, {"element": "q4", "spacing": STEP / 3}, (37, 37)),
    "of third order": (discretise, {}, (13, 13)),
    "triangles": (discretise, {"mask": np.arange(169) != 84}, (13, 13)),
    "hexahedra": (discretise, {"poisson": None, "bulk": 2e5}, (10, 10, 10)),
}


@pytest.mark.parametrize("name", MADE)
def test_waves_with_a_free_end(name):
    """Waves of the true moduli with that end free are those of the closed form; with the other end free they are not."""
    make, changes, shape = MADE[name]
    off = {}
    for end in ("low", "high"):
        data = standing(*shape, free=end, **changes)
        experiment = ElastographyProblem(data, elements := make(data))
        assert free_boundary(elements.mesh)["share"] == pytest.approx(1 / (2 * len(shape)), rel=0.02)
        off[end] = np.linalg.norm(experiment.predict_from_truth() - experiment.measured) / np.linalg.norm(
            experiment.measured
        )
    assert off["low"] < 0.015 < 0.3 < off["high"]


def test_in_their_own_elements_driven_nodes_are_those_that_are_flagged():
    """As in the published cases, corners belong to the driven edges."""
    data = standing(9, 8, element="q4")
    experiment = ElastographyProblem(data, original_discretisation(data))
    assert set(experiment.model.driven_dofs) == {k + i * 72 for k in np.flatnonzero(data.dirichlet) for i in (0, 1)}
    assert len(experiment.model.driven_dofs) == 2 * (30 - 7) and len(experiment.body.prescribed[0]) == 2 * 72


def test_a_side_is_driven_where_more_than_half_of_it_is_flagged():
    """Sides of third order have four points; those of three flagged ones at an end are driven, of two they are not."""
    data = standing(13, 13)
    lengths = [
        ngs.Integrate(1, discretise(flagged(data, *range(1, n))).mesh.Boundaries(FREE)) / STEP for n in (1, 2, 3, 6)
    ]
    assert lengths == pytest.approx([12, 12, 9, 6])


def test_what_is_all_flagged_is_all_driven():
    data = standing(9, 8, element="q4")
    full = replace(data, dirichlet=None)
    everywhere = replace(data, dirichlet=np.ones(72, bool) & data.border)
    for each in (full, everywhere):
        assert original_discretisation(each).driven_boundaries == ".*" and not free_boundary(
            original_discretisation(each).mesh
        )


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            lambda d: flagged(d, 30),
            r"true at 1 points inside, the first at \(9, 9\) mm; wanted: true at points of the border",
        ),
        (lambda d: flagged(d, 4), r"true at 1 points with too few beside them, the first at \(12, 0\) mm"),
        (lambda d: replace(d, dirichlet=np.zeros(72, bool)), "false at all the border"),
        (lambda d: replace(d, dirichlet=np.ones(72, bool)), "true at 42 points inside"),
    ],
    ids=["inside", "alone", "nowhere", "everywhere"],
)
def test_flags_that_drive_nothing(change, says):
    with pytest.raises(InputError, match=f"^dirichlet is {says}"):
        original_discretisation(change(standing(9, 8, element="q4")))


def test_flags_of_another_mask_are_refused():
    data = standing(9, 8)
    inner = np.all((data.points > 2e-3) & (data.points < data.points.max(axis=0) - 2e-3), axis=1)
    with pytest.raises(InputError, match=r"true at 23 points outside of the mask, the first at \(0, 0\) mm"):
        discretise(replace(data, mask=inner))
    with pytest.raises(InputError, match="true at 22 points inside"):
        discretise(replace(replace(data, mask=inner, dirichlet=None), mask=None))
    assert discretise(replace(data, mask=inner, dirichlet=None)).driven_boundaries == ".*"


def test_sides_that_reach_out_of_the_points_are_driven():
    """For a ball with a free lower half, sides within a voxel of its surface are free."""
    data = standing(14, 14, 14, poisson=None, bulk=2e5)
    off = data.points - data.points.mean(axis=0)
    ball = replace(data, mask=np.linalg.norm(off, axis=1) < 6.5 * STEP, dirichlet=None)
    lower = ball.border & (off[:, 2] < -0.1 * STEP)
    mesh = discretise(replace(ball, dirichlet=ball.border & ~lower)).mesh
    vertices = np.array([v.point for v in mesh.vertices])
    names = np.array(mesh.GetBoundaries())
    far = {
        free: np.array(
            [
                np.linalg.norm(ball.points[lower] - vertices[[v.nr for v in side.vertices]].mean(axis=0), axis=1).min()
                for side in mesh.Elements(ngs.BND)
                if (names[side.index] == FREE) == free
            ]
        )
        for free in (True, False)
    }
    assert far[True].max() < 1.2 * STEP and (far[False] > 1.2 * STEP).sum() > 10


def test_a_hole_between_scattered_points_is_free_where_its_border_says_so(rng):
    """Points of the hole are not on the hull, whose flags do not apply."""
    points = 0.04 * rng.random((600, 2))
    radius = np.linalg.norm(points - 0.02, axis=1)
    data = WaveData(
        points[radius > 0.008],
        np.ones((1, int((radius > 0.008).sum()), 2)) * 1e-6,
        [FREQUENCY],
        RHO,
        "isotropic",
        "elastic",
        poisson=0.4,
    )
    ring = np.linalg.norm(data.points - 0.02, axis=1) < 0.011
    low = data.points[:, 1] < 0.003
    assert not (data.border & ring).any()
    mesh = discretise(replace(data, dirichlet=data.border & ~low)).mesh
    assert free_boundary(mesh)["to_mm"][1] < 8
    rim = ring & _on_the_boundary(mesh, data.points)
    assert rim.sum() > 8 and discretise(replace(data, dirichlet=data.border | rim)).driven_boundaries == ".*"
    some = free_boundary(discretise(replace(data, dirichlet=(data.border & ~low) | rim)).mesh)
    assert some["share"] == pytest.approx(free_boundary(mesh)["share"])


def _on_the_boundary(mesh, points):
    vertices = np.array([v.point for v in mesh.vertices])
    ends = vertices[np.unique([[v.nr for v in side.vertices] for side in mesh.Elements(ngs.BND)])]
    return np.linalg.norm(points[:, None] - ends, axis=2).min(axis=1) < 1e-12


@pytest.fixture(scope="module")
def shaken():
    """A published case, its top driven and all else free; what is lost of its bottom; the flags of its top alone."""

    def made(noise, rows):
        data = Phantom.from_name("CV-G", 9).simulate_measurements(noise).data()
        u, height = data.displacement.copy(), data.points[:, 1]
        u[:, height < 0.015 * rows - 1e-9] = np.nan
        return replace(data, displacement=u), height > 0.12 - 1e-9

    return made


def errors(data, found, where=slice(None)):
    return {
        name: np.linalg.norm((found.maps[name] - truth)[where]) / np.linalg.norm(truth[where])
        for name, truth in data.truth_views.items()
    }


def inverted(data):
    found = invert(data, uniform=False, regulariser="smooth")
    return found, len(found.final_state.problem.model.driven_dofs)


def test_free_edges_have_no_unknowns_and_the_truth_comes_back_either_way(shaken):
    data, top = shaken(0.0, 0)
    (driven, of_all), (free, of_top) = map(inverted, (data, replace(data, dirichlet=top)))
    assert (of_all, of_top) == (2 * 32, 2 * 9)
    assert max(errors(data, driven).values()) < 2e-4 and max(errors(data, free).values()) < 2e-4
    assert free.model["free_boundary"] == {
        "share": pytest.approx(0.75),
        "from_mm": pytest.approx([0, 0]),
        "to_mm": pytest.approx([120, 120]),
    }
    words = "Traction-free part of the boundary"
    assert dict(facts(free.to_dict()))[words] == "75.0 % of it, at x 0 to 120, y 0 to 120 mm"
    assert "free_boundary" not in driven.model and words not in dict(facts(driven.to_dict()))


@pytest.mark.parametrize(("noise", "rows", "with_flags", "without"), [(0.0, 1, 1e-4, 0.1), (0.01, 3, 0.05, 0.09)])
def test_what_is_not_measured_at_a_free_edge_is_not_needed(shaken, noise, rows, with_flags, without):
    data, top = shaken(noise, rows)
    low = data.points[:, 1] < 0.03
    (driven, _), (free, _) = map(inverted, (data, replace(data, dirichlet=top)))
    assert max(errors(data, free, low).values()) < with_flags < without < max(errors(data, driven, low).values())


def test_zones_are_driven_at_cuts_and_where_the_body_is():
    data = standing(19, 10, 10, poisson=None, bulk=2e5)
    cells = build_lattice(data, "P3")
    body = free_boundary(discretise_lattice(data, cells, labelled=False).mesh)
    assert body["from_mm"] == pytest.approx([0, 0, 0]) and body["to_mm"] == pytest.approx([54, 27, 0])
    zones = cut_zones(data, cells, [4, 4, 4], [1, 1, 1])
    assert len(zones) > 1
    for zone in zones:
        own, _ = zone_data(data, zone)
        assert problem_digest(own, zone.cells) != problem_digest(replace(own, dirichlet=None), zone.cells)
        made = free_boundary(discretise_lattice(own, zone.cells, labelled=False).mesh)
        low, high = own.points[own.mask].min(axis=0), own.points[own.mask].max(axis=0)
        assert made["from_mm"] == pytest.approx(1e3 * low) and made["to_mm"] == pytest.approx([*(1e3 * high[:2]), 0])
