"""C_ij(t) = C_ij∞ + (C_ij0 - C_ij∞) Σ γ_k exp(-t/τ_k): instant, end, a held stretch; all alike it is quasi-linear."""

import ngsolve as ngs
import numpy as np
import pytest
from netgen.occ import unit_cube

from ngbrain.errors import InputError
from ngbrain.materials import Branch, Deformation, Polynomial, Prony, RelaxingPolynomial, Viscous

MESH = ngs.Mesh(unit_cube.GenerateMesh(maxh=2.0))
POINT = MESH(0.3, 0.3, 0.2)
C0 = {(1, 0): 263.0, (0, 1): 263.0, (2, 0): 491.0, (0, 2): 491.0}
ONE = {(1, 0): 300.0}
SHARES, TIMES = [0.55, 0.45], [0.5, 50.0]


def number(C):
    C = np.array(C) / np.linalg.det(C) ** (1 / 3)
    return ngs.CF(tuple(C.ravel()), dims=(3, 3))


SHAPE = [[1.3, 0.2, 0.1], [0.2, 0.9, -0.1], [0.1, -0.1, 1.0]]


def stress(law, C):
    """The deviatoric S̄ of an elastic law."""
    return np.array(Branch(law, 1.0).stress(number(C))(POINT))


def relaxed(material, C, t):
    """S̄ at time t after a sudden stretch that is held: each branch has lost its exp(-t/τ)."""
    parts = [np.exp(-t / b.tau) * stress(b.law, C) for b in material.branches]
    return sum(parts, stress(material.equilibrium, C))


def at_time(c0, c_inf, t, left):
    """The polynomial whose coefficients are what is left of them at time t."""
    return Polynomial({power: c_inf[power] + (c0[power] - c_inf[power]) * left(power, t) for power in c0})


def test_a_held_stretch_has_the_stress_of_the_coefficients_of_its_time():
    c_inf = {(1, 0): 40.0, (0, 1): 90.0, (2, 0): 491.0, (0, 2): 600.0}  # two relax, one stays, one grows
    material = RelaxingPolynomial(C0, c_inf, SHARES, TIMES)
    for t in (0.0, 0.3, 20.0, 1e6):
        law = at_time(C0, c_inf, t, lambda _, t: np.dot(SHARES, np.exp(-t / np.array(TIMES))))
        assert relaxed(material, SHAPE, t) == pytest.approx(stress(law, SHAPE), rel=1e-12, abs=1e-10)
    assert [branch.tau for branch in material.branches] == TIMES
    assert all((2, 0) not in branch.law.c for branch in material.branches)


def test_each_coefficient_may_have_times_of_its_own():
    c0, c_inf = {(1, 0): 300.0, (2, 0): 500.0}, {(1, 0): 60.0, (2, 0): 40.0}
    gamma, tau = {(1, 0): [0.3, 0.7], (2, 0): [1.0]}, {(1, 0): [0.5, 20.0], (2, 0): [3.0]}
    material = RelaxingPolynomial(c0, c_inf, gamma, tau)
    assert sorted(branch.tau for branch in material.branches) == [0.5, 3.0, 20.0]
    for t in (0.0, 1.0, 10.0):
        law = at_time(c0, c_inf, t, lambda power, t: np.dot(gamma[power], np.exp(-t / np.array(tau[power]))))
        assert relaxed(material, SHAPE, t) == pytest.approx(stress(law, SHAPE), rel=1e-12, abs=1e-10)
    shared = RelaxingPolynomial(c0, c_inf, [0.3, 0.7], {(1, 0): [0.5, 20.0], (2, 0): [20.0, 0.5]})
    assert [branch.tau for branch in shared.branches] == [0.5, 20.0]
    assert shared.branches[0].law.c == {(1, 0): pytest.approx(240 * 0.3), (2, 0): pytest.approx(460 * 0.7)}
    (once,) = RelaxingPolynomial(ONE, {(1, 0): 60.0}, [0.5, 0.5], [2.0, 2.0]).branches
    assert once == Branch(Polynomial({(1, 0): 240.0}), 2.0)


def test_coefficients_that_relax_alike_are_quasi_linear():
    g = [0.45, 0.365]
    prony = Prony(Polynomial(C0), g, TIMES)
    c_inf = {power: (1 - sum(g)) * c for power, c in C0.items()}
    ours = RelaxingPolynomial(C0, c_inf, [gk / sum(g) for gk in g], TIMES)
    for shares in ([1, 1], [0, 0], [0.7, 0.2]):
        energies = [m.density(Deformation.from_stretch(number(SHAPE)), shares)(POINT) for m in (ours, prony)]
        assert energies[0] == pytest.approx(energies[1], rel=1e-12)
    for a, b in zip(ours.branches, prony.branches, strict=True):
        assert a.tau == b.tau
        assert stress(a.law, SHAPE) == pytest.approx(stress(b.law, SHAPE), rel=1e-12, abs=1e-12)


def test_only_alike_do_curves_of_relaxation_collapse():
    def curve(material, stretch):
        C = np.diag([stretch**2, 1 / stretch, 1 / stretch])
        return relaxed(material, C, 5.0)[0] / relaxed(material, C, 0.0)[0]

    alike = RelaxingPolynomial(C0, {power: 0.2 * c for power, c in C0.items()}, SHARES, TIMES)
    other = RelaxingPolynomial(C0, {(1, 0): 20.0, (0, 1): 20.0, (2, 0): 400.0, (0, 2): 400.0}, SHARES, TIMES)
    quasi_linear, dependent = ([curve(m, s) for s in (1.01, 1.05, 1.1, 1.2)] for m in (alike, other))
    assert np.ptp(quasi_linear) < 1e-12
    assert np.ptp(dependent) > 0.02


def test_fields_are_taken():
    law = RelaxingPolynomial({(1, 0): ngs.Parameter(300.0)}, {(1, 0): 60.0}, [1.0], [ngs.Parameter(2.0)])
    assert isinstance(law, Viscous)
    assert stress(law.branches[0].law, SHAPE) == pytest.approx(stress(Polynomial({(1, 0): 240.0}), SHAPE), rel=1e-12)


@pytest.mark.parametrize(
    ("make", "field", "value"),
    [
        (lambda: RelaxingPolynomial(ONE, {(1, 0): 400.0}, [1.0], [1.0]), r"c0\[1, 0\] - c_inf\[1, 0\]", r"-100\.0"),
        (
            lambda: RelaxingPolynomial(ONE | {(0, 1): 1.0}, {(1, 0): 60.0, (0, 1): 2.0}, [1.0], [1.0]),
            r"c0\[0, 1\] - c_inf\[0, 1\]",
            r"-1\.0",
        ),
        (lambda: RelaxingPolynomial(ONE, {(0, 1): 60.0}, [1.0], [1.0]), "c_inf", r"\[\(0, 1\)\]"),
        (lambda: RelaxingPolynomial(ONE, {(1, 0): 60.0}, [0.5, 0.4], [1.0, 2.0]), "gamma", r"\[0\.5, 0\.4\]"),
        (lambda: RelaxingPolynomial(ONE, {(1, 0): 60.0}, [1.5, -0.5], [1.0, 2.0]), "gamma", r"-0\.5"),
        (lambda: RelaxingPolynomial(ONE, {(1, 0): 60.0}, [1.0], [0.0]), "tau", r"0\.0"),
        (lambda: RelaxingPolynomial(ONE, {(1, 0): 60.0}, [1.0], [1.0, 2.0]), "tau", "2 values"),
        (lambda: RelaxingPolynomial(ONE, {(1, 0): 60.0}, {(2, 0): [1.0]}, [1.0]), "gamma", r"empty for \(1, 0\)"),
    ],
)
def test_refuses(make, field, value):
    with pytest.raises(InputError, match=rf"RelaxingPolynomial\.{field} is .*{value}"):
        make()


def test_what_stays_must_be_stiff():
    with pytest.raises(InputError, match=r"Polynomial\.c\[1, 0\] \+ c\[0, 1\] is 0\.0"):
        RelaxingPolynomial(ONE, {(1, 0): 0.0}, [1.0], [1.0])
