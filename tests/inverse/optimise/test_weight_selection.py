"""Weight selection: the corner of an L-curve against the evidence, without a noise level, and in `invert`."""

import numpy as np
import pytest

from ngbrain.errors import ConvergenceError, InputError, SolverError
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.optimise.weight_selection import WEIGHTINGS, LCurve, WeightSelection, weight_selection
from ngbrain.inverse.phantoms.benchmark import Phantom


def silent(_):
    pass


def spot(stated=1.0):
    """A case with 2 % noise, of which a multiple is stated."""
    inversion = Phantom.from_name("CV-G", 11).simulate_measurements(0.02, seed=3).inversion()
    misfit = inversion.reduced.misfit
    inversion.reduced.misfit = LeastSquares(inversion.measured.displacement, stated * misfit.sigma)
    return inversion


def by_corner(inversion, **options):
    start = WeightSelection().from_waves(inversion.reduced, inversion.start, inversion.waves, silent)
    return LCurve(**options).descend(inversion.reduced, start.x, silent)


def test_the_corner_is_as_good_as_the_evidence():
    inversion = spot()
    found = inversion.errors(by_corner(inversion).x)
    evidence = spot()
    start = WeightSelection().from_waves(evidence.reduced, evidence.start, evidence.waves, silent)
    wanted = evidence.errors(WeightSelection().descend(evidence.reduced, start.x, silent).x)
    assert found["storage"] < 1.3 * wanted["storage"] and found["loss"] < 1.3 * wanted["loss"]


def test_the_corner_asks_for_no_level_of_noise():
    """J and weights scale with σ²: the minima are independent of the stated level. With half the level, the evidence fits noise."""
    right, wrong = (spot(stated) for stated in (1.0, 1 / 2))
    ends = [by_corner(inversion) for inversion in (right, wrong)]
    one, other = (inversion.errors(end.x) for inversion, end in zip((right, wrong), ends, strict=True))
    assert other["storage"] < 1.4 * one["storage"]
    fooled = spot(1 / 2)
    start = WeightSelection().from_waves(fooled.reduced, fooled.start, fooled.waves, silent)
    assert fooled.errors(start.x)["storage"] > 2 * other["storage"]


def test_all_weights_keep_their_ratio_and_the_minimum_is_one():
    inversion = spot()
    start = WeightSelection().from_waves(inversion.reduced, inversion.start, inversion.waves, silent)
    before = dict(inversion.reduced.weights)
    found = LCurve(points=5).descend(inversion.reduced, start.x, silent)
    ratios = [found.weights[name] / before[name] for name in before]
    assert ratios[0] == pytest.approx(ratios[1]) and found.weights == inversion.reduced.weights
    steps = 0.01 * np.random.default_rng(0).normal(size=(5, len(found.x)))
    assert all(inversion.reduced.value(found.x + step) > found.objective for step in steps)


def test_a_curve_needs_three_points():
    with pytest.raises(ConvergenceError, match="corner"):
        LCurve(points=2).descend(spot().reduced, spot().start, silent)


def test_no_point_can_be_reached(monkeypatch):
    inversion = spot()
    monkeypatch.setattr(inversion.reduced, "regular_gradient", lambda x: 1e30 * np.ones_like(x))
    with pytest.raises(SolverError):
        LCurve().descend(inversion.reduced, inversion.start, silent)


def test_names():
    assert set(WEIGHTINGS) == {"evidence", "discrepancy", "l-curve"} and isinstance(weight_selection("l-curve"), LCurve)
    with pytest.raises(InputError, match=r"weight is 'lcurve'.*l-curve"):
        weight_selection("lcurve")


def test_invert_takes_them():
    """Discrepancy keeps one weight for both moduli; the corner keeps the evidence's ratio."""
    data = Phantom.from_name("CV-G", 9).simulate_measurements(0.02).data()
    found = {w: invert(data, uniform=False, regulariser="smooth", weight=w) for w in ("discrepancy", "l-curve")}
    one, other = (found[name].weights for name in ("discrepancy", "l-curve"))
    assert one["storage"] == pytest.approx(one["loss"]) and other["storage"] != pytest.approx(other["loss"], rel=0.01)
    assert found["l-curve"].to_dict()["model"]["weight"] == "l-curve"
    with pytest.raises(InputError, match="weight"):
        invert(data, weight="evidense")
