"""Merged zones: the shared regularisation weight in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from planewaves import grid, waves

from ngbrain.forward.common.solve_counts import Solves
from ngbrain.inverse.optimise.regularisation_weight import MisfitLevel
from ngbrain.inverse.problem.voxel_lattice import VoxelLattice
from ngbrain.inverse.subzones.merge import MergedZones, _zone_notes
from ngbrain.inverse.subzones.partition import cut_zones
from ngbrain.inverse.subzones.roughness import Roughness
from ngbrain.inverse.subzones.zone_result import ZoneResult

LENGTH, CELL = 0.048, 4e-3


@pytest.fixture(scope="module")
def bar():
    """Its data and cells: 12 along it, 4 across."""
    points = grid(25, 9, 9, spacing=2e-3)
    data = waves(points, 1e-6 * np.ones((1, len(points), 3), complex), bulk=2e5, poisson=None)
    lines = [np.arange(0, side + 1e-9, CELL) for side in (LENGTH, 0.016, 0.016)]
    return data, VoxelLattice(tuple(lines), np.ones((12, 4, 4), bool), "P3")


def together(data, cells, logarithm, weights, alone=None, fields=("storage", "loss")):
    """Two zones of 8 cells that share the 4 in the middle; they agree on a map, and each has a weight of its own."""
    zones = cut_zones(data, cells, np.full(3, 8), np.full(3, 4))
    assert len(zones) == 2
    answers = []
    for zone, weight in zip(zones, weights, strict=True):
        maps = dict.fromkeys(("storage", "loss"), np.exp(logarithm(data.points[zone.points])))
        u = data.displacement[:, zone.points]
        names = {"n_elements": 1, "n_unknowns": 1, "n_parameters": 1}
        both = dict.fromkeys(fields, weight), dict.fromkeys(fields, 10.0)
        answers.append(ZoneResult(maps, u, *both, 1.0, 1, 0.0, True, "P3", names, {}, Solves(), []))
    return MergedZones(data, zones, [Roughness(zone.cells, data.points[zone.points]) for zone in zones], answers, alone)


def test_a_slope_along_the_bar_counts_by_length(bar):
    """A zone is two thirds of the bar and, as half of it is shared, counts three quarters: α = ¾ (α_1 + α_2) ⅔."""
    found = together(*bar, lambda x: 30 * x[:, 0], (3.0, 6.0))
    share = [float(np.mean(zone.share)) for zone in found.zones]
    assert share == pytest.approx([0.75, 0.75], abs=0.02)
    assert found.weights["storage"] == pytest.approx(2 / 3 * np.dot(share, (3.0, 6.0)), rel=0.02)


def test_fields_of_labels_are_of_their_quantity_and_of_their_places(bar):
    """With one label for all, the field is the global one; a label on one half has the roughness there."""
    data, cells = bar
    whole = together(data, cells, lambda x: 30 * x[:, 0], (3.0, 6.0))
    labels = np.full(len(data.points), 7)
    one = together(
        replace(data, labels=labels), cells, lambda x: 30 * x[:, 0], (3.0, 6.0), fields=("storage 7", "loss")
    )
    assert one.weights["storage 7"] == whole.weights["storage"] and one.weights["loss"] == whole.weights["loss"]
    assert one.strength == whole.strength
    labels = np.where(data.points[:, 0] > LENGTH / 2, 3, 7)

    def bumpy(x):
        return np.where(x[:, 0] > LENGTH / 2, 0.0, np.sin(300 * x[:, 0]))

    halves = together(replace(data, labels=labels), cells, bumpy, (3.0, 6.0), fields=("storage 3", "storage 7"))
    assert halves.roughness_energy["storage 7"] > 100 * halves.roughness_energy["storage 3"]


def test_what_both_see_counts_once(bar):
    """Only a bump in the shared cells is rough: E_1 = E_2 = E."""
    found = together(*bar, lambda x: np.exp(-(((x[:, 0] - LENGTH / 2) / 3e-3) ** 2)), (2.0, 2.0))
    share = sum(float(np.mean(zone.share)) for zone in found.zones)
    assert found.weights["loss"] == pytest.approx(2.0 * share, rel=0.02)


def test_a_smoother_joined_map_wants_a_larger_weight(bar):
    """Half the gradient, a quarter of the roughness, for the same number of determined parameters."""
    first = together(*bar, lambda x: 30 * x[:, 0], (3.0, 3.0))
    later = together(*bar, lambda x: 15 * x[:, 0], (1.0, 1.0), first)
    assert later.weights["storage"] == pytest.approx(4 * first.weights["storage"], rel=1e-3)


def test_a_map_without_slopes_has_a_weight(bar):
    found = together(*bar, lambda x: np.full(len(x), 8.0), (3.0, 3.0))
    assert all(np.isfinite(weight) and weight > 0 for weight in found.weights.values())


def test_zones_that_have_not_settled_are_said(bar):
    found = together(*bar, lambda x: np.full(len(x), 8.0), (3.0, 3.0))
    assert not _zone_notes([found], MisfitLevel(250.0, 100.0))
    found.results[1].converged = False
    level = "the total misfit is 250, its expected value 100"
    assert _zone_notes([found], MisfitLevel(250.0, 100.0)) == [
        f"1 of 2 zones stopped before fields and weights converged: {level}"
    ]


def test_points_without_a_map_are_said(bar):
    found = together(*bar, lambda x: np.where(x[:, 0] < 1e-3, np.nan, 8.0), (3.0, 3.0))
    assert [
        note for note in _zone_notes([found], MisfitLevel(2.0, 1.0)) if note.startswith("81 of 2025 points have no map")
    ]
