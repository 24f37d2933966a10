"""Weight policies on a linear problem with a closed-form solution, and corners of L-curves."""

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp

from ngbrain.inverse.objective.regularisation import QuadraticRegulariser
from ngbrain.inverse.optimise.regularisation_weight import (
    MAX_FACTOR,
    DiscrepancyPrinciple,
    Evidence,
    EvidenceWithModelError,
    FixedWeights,
    MisfitLevel,
    l_curve_corner,
)

N = 200


class Diagonal:
    """Data d = s x + unit noise, x of size 1/√α*: J is minimised componentwise."""

    def __init__(self, rng, true_weight=4.0):
        self.s = np.logspace(1.5, -1.5, N)
        x = rng.normal(size=N) / np.sqrt(true_weight)
        self.data = self.s * x + rng.normal(size=N)
        made = {"x": QuadraticRegulariser(sp.eye_array(N, format="csr"), 0.0)}
        unknowns = SimpleNamespace(blocks={"x": slice(0, N)})
        self.reduced = SimpleNamespace(regularisers=made, weights={"x": 1e3}, unknowns=unknowns)

    @property
    def kept(self):
        return self.s**2 / (self.s**2 + self.reduced.weights["x"])

    def effective_parameters(self, random):
        return float(self.kept.sum())

    def effective_parameters_by_block(self, blocks, regular, random):
        return {"x": self.effective_parameters(random)}

    def run(self, policy, rounds):
        for _ in range(rounds):
            x = self.s * self.data / (self.s**2 + self.reduced.weights["x"])
            level = MisfitLevel(float(np.sum((self.s * x - self.data) ** 2)), N - self.effective_parameters(None))
            turned = policy.update(self.reduced, x, level, self, None)
        return self.reduced.weights["x"], level, turned


def test_evidence_finds_the_size_of_what_is_looked_for(rng):
    weight, level, turned = Diagonal(rng).run(Evidence(), 60)
    assert 2 < weight < 8 and turned < 1.001 and level.ratio == pytest.approx(1, abs=0.3)


def test_a_weight_stays_above_the_least_of_its_regulariser(rng):
    """Without a lower bound, arbitrarily rough fields would fit errors that the model cannot represent."""
    problem = Diagonal(rng)
    problem.data *= 100
    free = problem.run(Evidence(), 60)[0]
    problem.reduced.regularisers["x"].min_weight = 0.5
    problem.reduced.weights["x"] = 1e3
    held, _, turned = problem.run(Evidence(), 60)
    assert free < 0.01 and held == 0.5 and turned == 1


def test_errors_alike_at_many_points_are_no_structure(rng):
    """Unit noise and an equal error shared by ten points: in the means of these it is ten times the noise."""
    shared, rest = 10, 200 * N
    weights = {}
    for policy in (EvidenceWithModelError(), EvidenceWithModelError(points_per_node=shared)):
        problem = Diagonal(np.random.default_rng(0))
        problem.data += np.sqrt(shared) * rng.normal(size=N)  # what unknowns can follow: the means
        for _ in range(60):
            x = problem.s * problem.data / (problem.s**2 + problem.reduced.weights["x"])
            misfit = float(np.sum((problem.s * x - problem.data) ** 2)) + 2.0 * rest  # the rest, point by point: 1 + 1
            policy.update(
                problem.reduced, x, MisfitLevel(misfit, N + rest - problem.effective_parameters(None)), problem, None
            )
        weights[policy.points_per_node] = problem.reduced.weights["x"] / (1 + shared)
    assert 2 < weights[shared] < 8  # 4 is true, in units of all that is noise in the means
    assert weights[1.0] < 1


def test_discrepancy_ends_at_its_level_in_few_rounds(rng):
    problem = Diagonal(rng)
    problem.data *= 1.15  # so that there is a weight at which the misfit is where it should be
    _, level, turned = problem.run(DiscrepancyPrinciple(tolerance=1e-3), 15)
    assert level.ratio == pytest.approx(1, abs=1e-3) and turned == 1.0


def test_no_weight_changes_faster_than_allowed(rng):
    for policy in (Evidence(), DiscrepancyPrinciple()):
        problem = Diagonal(rng)
        weight, _, turned = problem.run(policy, 1)
        assert weight >= 1e3 / MAX_FACTOR * (1 - 1e-12) and turned <= MAX_FACTOR * (1 + 1e-12)


def test_a_field_of_which_nothing_is_determined_is_settled_while_its_weight_rises(rng):
    problem = Diagonal(rng)
    problem.s = 1e-6 * problem.s
    before = problem.reduced.weights["x"]
    weight, _, turned = problem.run(Evidence(), 3)
    assert weight > 100 * before and turned == 1.0
    problem = Diagonal(rng)
    assert problem.run(Evidence(), 1)[2] > 1.3  # what is determined is not


def test_given_weights_stay(rng):
    assert Diagonal(rng).run(FixedWeights(), 3)[0] == 1e3


def test_a_bend_the_other_way_is_no_corner():
    """Misfits that fall slowly, then fast, then not at all: the curve is first concave, then convex."""
    misfits = np.exp(np.array([9.0, 9.0, 9.0, 9.0, 7.0, 5.0, 3.0, 1.0, 0.0, -1.0, -2.0]))
    energies = np.exp(np.array([0.0, 2.0, 4.0, 6.0, 6.0, 6.0, 6.0, 6.0, 7.7, 9.4, 11.1]))
    assert l_curve_corner(misfits, energies) in (7, 8)


def test_corner_of_a_curve_with_two_straight_arms():
    t = np.arange(10.0)
    misfits, energies = (
        np.exp(np.where(t < 6, 12 - 2 * t, 0.02 * (6 - t))),
        np.exp(np.where(t < 6, 0.02 * t, 2 * (t - 6))),
    )
    assert l_curve_corner(misfits, energies) in (5, 6)
