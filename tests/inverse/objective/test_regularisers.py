"""Regularisers by name: energies of a step and of a bump, unknown names, and a user-defined one in `invert`."""

import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.objective.regularisation import matern, smooth
from ngbrain.inverse.objective.regularisers import PRIORS, REACH, extent, resolve_priors
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.mesh.geometry.structured import rectangles


def space_of(cells=40, side=0.1, height=0.05):
    return ngs.H1(rectangles(np.linspace(0, side, cells + 1), np.linspace(0, height, cells // 2 + 1)), order=1)


def cost(name, space, f):
    field = ngs.GridFunction(space)
    field.Set(f)
    return PRIORS[name](space, 0.0).value(field.vec.FV().NumPy())


def test_extent_is_the_longest_side():
    assert extent(space_of()) == pytest.approx(0.1)


def test_narrow_bumps_cost_most_where_correlations_are_longer():
    """Waves of 10 ℓ and of ℓ, correlations over ℓ: (1 + ℓ²k²)² rises by 840, k² by 100."""
    space = space_of(120)
    longer, shorter = (ngs.cos(2 * np.pi * ngs.x / (ratio * REACH * 0.1)) for ratio in (10, 1))
    rise = {name: cost(name, space, shorter) / cost(name, space, longer) for name in PRIORS}
    assert rise["matern"] == pytest.approx(840, rel=0.1) and rise["smooth"] == pytest.approx(100, rel=0.05)
    assert rise["edges"] < 50


def test_matern_of_the_body():
    space, x = space_of(), np.random.default_rng(0).normal(size=space_of().ndof)
    assert PRIORS["matern"](space, 0.0).value(x) == pytest.approx(matern(space, 0.0, REACH * 0.1).value(x))


def test_a_step_costs_edges_least():
    space = space_of()
    step, slope = ngs.IfPos(ngs.x - 0.05, 5.0, 0.0), 50 * ngs.x
    ratio = {name: cost(name, space, step) / cost(name, space, slope) for name in PRIORS}
    assert ratio["edges"] < 0.5 * min(ratio["smooth"], ratio["matern"])


def test_names():
    assert list(resolve_priors("auto")) == ["smooth", "edges"] and list(resolve_priors("matern")) == ["matern"]
    assert list(resolve_priors(smooth)) == ["smooth"]
    with pytest.raises(InputError, match=r"regulariser is 'matren'.*matern"):
        resolve_priors("matren")


def test_one_of_ones_own_is_what_inverts():
    """With a very strong regulariser a stiff spot is not resolved."""

    def stubborn(space, reference):
        made = smooth(space, reference)
        made._matrix = 1e12 * made._matrix
        return made

    data = Phantom.from_name("CV-G", 9).simulate_measurements(0.02).data()
    found = invert(data, uniform=False, regulariser=stubborn)
    usual = invert(data, uniform=False, regulariser="matern")
    assert found.regulariser == "stubborn" and usual.regulariser == "matern"
    assert np.ptp(found.maps["storage"]) < 0.1 * np.ptp(usual.maps["storage"])
