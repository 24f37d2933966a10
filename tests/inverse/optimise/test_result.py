"""Convergence of an inversion: the change by the last step against the scatter caused by noise."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.optimise.result import Iteration, IterationLog

FIRST = Iteration("fields", 1000.0, 500.0, {"x": 5.0}, 0.1, 1.0, 0.0, {"x": 50.0})


class Factor:
    def effective_parameters(self, random):
        return 500.0


class Steady:
    """Weights that change by a factor, with 50 effective parameters."""

    def __init__(self, turned):
        self.turned, self.determined = turned, {"x": 50.0}

    def update(self, *_):
        return self.turned


def settled(misfit, turned=1.0, step=1.0, before=FIRST, phase="fields", level=None):
    """Whether an iteration that ends at this misfit is the last, for 1000 data with 500 degrees of freedom."""
    measured = np.zeros((1, 500, 1), complex)
    measured[0, 0] = np.sqrt(misfit)
    reduced = SimpleNamespace(misfit=LeastSquares(measured, np.ones((1, 500, 1))), weights={"x": 5.0}, model=None)
    reduced.unknowns = SimpleNamespace(undetermined_direction=level)
    ledger = IterationLog(reduced, Steady(turned))
    return ledger.record(phase, np.zeros(3), np.zeros_like(measured), Factor(), np.full(3, 0.1), step, [before])


@pytest.mark.parametrize("moved, expected", [(-5.0, True), (-15.0, True), (15.0, True), (-25.0, False)])
def test_a_change_that_chance_makes_ends_it(moved, expected):
    """The scatter is √(2 · 50) = 10, times the misfit of 2 over its expected value."""
    assert settled(1000.0 + moved) is expected


def test_not_while_weights_move_or_steps_are_cut():
    assert settled(999.0)
    assert not settled(999.0, turned=2.0)
    assert not settled(999.0, step=0.25)
    assert not settled(999.0, before=replace(FIRST, weights={"x": 50.0}))


def test_not_where_data_leave_the_level_open():
    """For quasi-static data, fields drift for thirty more iterations, from 15 % to 11 % error at the same misfit."""
    assert not settled(999.0, level=np.ones(3))


def test_not_on_the_way_from_measured_waves():
    """In this phase the misfit need not fall."""
    assert not settled(999.0, phase="waves", before=replace(FIRST, phase="waves"))
