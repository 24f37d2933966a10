"""Large grids in the plane: coarser elements first, then those of the data, to the same maps."""

import numpy as np
import pytest
from planewaves import grid, shear_waves, waves

from ngbrain.errors import ConvergenceError
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.optimise.weight_selection import WeightSelection
from ngbrain.inverse.problem import discretisation
from ngbrain.inverse.problem.discretisation import coarse_discretisation
from ngbrain.report.pages.elastography import convergence

POINTS = grid(28, 22, spacing=2e-3)
CLEAN = waves(POINTS, shear_waves(POINTS, 3000 + 600j), poisson=0.4)


@pytest.mark.one_thread
def test_a_large_grid_starts_from_coarser_elements(monkeypatch):
    data = CLEAN.with_noise(0.02, seed=3)
    at_once = invert(data, uniform=False)
    assert coarse_discretisation(data) is None
    monkeypatch.setattr(discretisation, "LARGE", 1000)
    assert coarse_discretisation(data).mesh.ne < 0.6 * at_once.model["n_elements"]
    found = invert(data, uniform=False)
    assert found.model["n_elements"] == at_once.model["n_elements"]
    assert [start.name for start in found.starts] == ["coarse waves", "coarse both", "fine"]
    assert found.chosen == "fine" and found.converged
    fine = len(found.chosen_start.history)
    assert found.solves.factorisations > fine + 10  # those of the coarser elements are counted
    for name in ("storage", "loss"):
        np.testing.assert_allclose(found.maps[name], at_once.maps[name], rtol=0.02)
    assert convergence(found.to_dict()).startswith(b"\x89PNG")


@pytest.mark.one_thread
def test_where_no_step_lowers_the_objective_waves_are_the_start(monkeypatch):
    data = CLEAN.with_noise(0.02, seed=3)
    monkeypatch.setattr(discretisation, "LARGE", 1000)
    coarse, descend = coarse_discretisation(data).mesh.ne, WeightSelection.descend

    def stuck(self, reduced, x, callback):
        if reduced.model.body.mesh.ne > coarse:
            raise ConvergenceError("no step lowers the objective")
        return descend(self, reduced, x, callback)

    monkeypatch.setattr(WeightSelection, "descend", stuck)
    found = invert(data, uniform=False)
    assert found.chosen == "fine" and np.median(found.maps["storage"]) == pytest.approx(3000, rel=0.02)


def test_masks_slices_in_space_and_ultrasound_have_no_coarser_elements(monkeypatch):
    monkeypatch.setattr(discretisation, "LARGE", 1)
    assert coarse_discretisation(CLEAN) is not None
    mask = np.hypot(*(POINTS - POINTS.mean(axis=0)).T) < 0.02
    still = waves(POINTS, CLEAN.displacement, frequency=(0.0,), poisson=0.4)
    cube = grid(6, 6, 6, spacing=4e-3)
    in_space = waves(cube, shear_waves(cube, 3000 + 600j), poisson=0.4)
    for data in (waves(POINTS, CLEAN.displacement, poisson=0.4, mask=mask), still, in_space):
        assert coarse_discretisation(data) is None
