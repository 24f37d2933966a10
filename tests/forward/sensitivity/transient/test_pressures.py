"""Derivatives of runs under pressures that follow, with cavities and with discontinuous pressures, once and twice."""

import ngsolve as ngs
import numpy as np
import pytest
from force_models import BENT, GRID, SIDE, checked, inflated, weighed
from friction_blocks import Sliding, mesh_of

from ngbrain.adjoint.check import taylor
from ngbrain.forward.common.loads import PressureLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.observables import Displacements, Force
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.forward.sensitivity.transient.tangents import PivotedTangents
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import NeoHooke

CASES = {
    "plane strain": ("plane strain, triangles",),
    "axisymmetric": ("axisymmetric, quadrilaterals", "Q2/Q1"),
    "space": ("space, tetrahedra",),
    "Maxwell": ("plane strain, quadrilaterals", "Q2/Q1", "Maxwell"),
    "friction": ("plane strain, triangles", "P2/P1", "Prony", True, False),
    "discontinuous": ("plane strain, triangles", "P4/L2(2)", "Prony", False, False),
    "discontinuous, cavity": ("axisymmetric, quadrilaterals", "Q2/L2(1)"),
    "discontinuous, friction": ("axisymmetric, quadrilaterals", "Q2/L2(1)", "elastic", True, False),
    "displacements": ("space, hexahedra", "Q2", "elastic", False, False),
}
FAST = ("plane strain", "axisymmetric", "friction", "discontinuous")


@pytest.mark.parametrize("case", [pytest.param(case, marks=[] if case in FAST else pytest.mark.slow) for case in CASES])
def test_rates_once_and_twice(case, rng):
    rates, twice, apart, uneven = checked(inflated(*CASES[case]), rng, 1e-3)
    print(case, rates, twice, apart, uneven)
    assert rates == pytest.approx([2, 2], abs=0.1) and twice == pytest.approx([2, 2], abs=0.1)
    assert apart < 1e-8 and uneven < 1e-8


def test_a_tangent_that_is_not_turned_lowers_the_rate(monkeypatch, rng):
    monkeypatch.setattr(PivotedTangents, "solve_transpose", lambda self, r: self._times(self._inverse, r * self._free))
    of = inflated("plane strain, triangles", cavity=False)
    start = of.theta.copy()
    start[of.blocks["push"]] = 200.0
    of.evaluate(start)
    w, value = weighed(of, rng)
    rates = taylor(value, of.evaluate(start).gradient(w), start, 0.7 * start, first=5e-3, steps=2)
    assert np.all(rates < 1.3), rates


def test_a_little_pressure_pushes_as_a_traction_does():
    """Where it hardly deforms, a run's derivative by a pressure is that of pressing with it: at zero pressure all is linear."""
    mesh, push = mesh_of("plane strain", 2), ngs.Parameter(0.0)
    body = Problem(
        mesh, {".*": Material(NeoHooke(1e3), 2e4)}, {"bottom": 0}, [PressureLoad("right", push)], element="P2/P1", history=True
    )  # fmt: skip
    seen = [Force("bottom"), Displacements([[SIDE, SIDE]])]
    of = RunModel(body, Sliding(0.0, 0.0), GRID, {"push": push}, seen)
    slopes = of.evaluate(of.theta).jacobian[0]
    assert slopes[:, 0] == pytest.approx(np.full(len(GRID) - 1, SIDE), rel=1e-9)
    moved = of.evaluate(np.array([1e-2])).data - of.evaluate(np.array([-1e-2])).data
    assert slopes == pytest.approx(moved / 2e-2, rel=1e-6, abs=1e-9)
    assert BENT.value(body)[0] > 0
