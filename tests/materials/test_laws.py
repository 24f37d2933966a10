"""Laws against closed forms: stress, tangent, equal stretches, relaxation."""

import ngsolve as ngs
import numpy as np
import pytest
import states
from netgen.occ import unit_cube

from ngbrain.errors import InputError
from ngbrain.materials import (
    CATALOGUE,
    Branch,
    Deformation,
    MooneyRivlin,
    NeoHooke,
    Ogden,
    Prony,
    Viscous,
    barrier,
    constants,
    step_factors,
)

MESH = ngs.Mesh(unit_cube.GenerateMesh(maxh=2.0))
POINT = MESH(0.3, 0.3, 0.2)


def stress(law, C):
    """2 ∂W/∂C at a numeric C."""
    variable = ngs.CF(tuple(np.ravel(C)), dims=(3, 3)).MakeVariable()
    return np.array((2 * law.energy(variable)).Diff(variable)(POINT)).reshape(3, 3)


def uniaxial(law, stretch):
    """Nominal stress of an incompressible bar: P = λ S₁ - S₂ λ₂²/λ."""
    C = np.diag([stretch**2, 1 / stretch, 1 / stretch])
    S = stress(law, C)
    return stretch * S[0, 0] - S[1, 1] / stretch**2


@pytest.mark.parametrize("stretch", [0.7, 0.9, 1.1, 1.4])
def test_neo_hooke_uniaxial(stretch):
    assert uniaxial(NeoHooke(1.3), stretch) == pytest.approx(1.3 * (stretch - stretch**-2), rel=1e-12)


@pytest.mark.parametrize("alpha", [-25.66, -4.7, -2.0, 2.0, 9.0])
@pytest.mark.parametrize("stretch", [0.8, 0.95, 1.05, 1.25])
def test_ogden_uniaxial(alpha, stretch):
    # Two of the stretches are equal here, where an eigenvalue formula is 0/0 without its guard.
    exact = 2 * 1.7 / alpha * (stretch ** (alpha - 1) - stretch ** (-alpha / 2 - 1))
    assert uniaxial(Ogden(1.7, alpha), stretch) == pytest.approx(exact, rel=1e-8)


@pytest.mark.parametrize("gap", [0.0, 1e-12, 1e-8, 1e-4, 1e-2])
def test_ogden_two_is_neo_hooke_also_at_nearly_equal_stretches(gap):
    C = np.diag([1.2 + gap, 1.2, 1 / 1.44])
    C[0, 1] = C[1, 0] = gap / 3
    assert np.allclose(stress(Ogden(1.0, 2.0), C), stress(NeoHooke(1.0), C), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("gap", [0.0, 1e-12, 1e-8, 1e-4])
@pytest.mark.parametrize(("alpha", "twin"), [(2.0, NeoHooke(1.0)), (-2.0, MooneyRivlin(0.0, 0.5))])
def test_ogdens_tangent_is_its_twins_also_at_nearly_equal_stretches(alpha, twin, gap):
    F = np.diag([1.2 + gap, 1.2, 1 / 1.44])
    K, exact = (states.tangent(law, F)[0] for law in (Ogden(1.0, alpha), twin))
    assert np.abs(K - exact).max() < 1e-6 * np.abs(exact).max()
    K, exact = (states.tangent(law, np.eye(3) * (1 + gap))[0] for law in (Ogden(1.0, alpha), twin))
    assert np.abs(K - exact).max() < 1e-6 * np.abs(exact).max()


def test_constants_may_come_from_numpy():
    C = np.diag([1.2, 1.0, 1 / 1.2])
    arrays, lists = Ogden(np.array([1.0, 2.0]), np.array([-5, 4])), Ogden([1.0, 2.0], [-5.0, 4.0])
    assert np.allclose(stress(arrays, C), stress(lists, C), rtol=1e-12)
    assert np.allclose(stress(NeoHooke(np.float32(2)), C), stress(NeoHooke(2.0), C), rtol=1e-12)


def test_ogden_minus_two_is_mooney_rivlin():
    C = np.array([[1.3, 0.2, 0.1], [0.2, 0.9, -0.1], [0.1, -0.1, 1.0]])
    inverse = np.linalg.inv(C)
    # W = μ/2 tr C⁻¹, so 2 ∂W/∂C = -μ C⁻²
    assert np.allclose(stress(Ogden(1.0, -2.0), C), -inverse @ inverse, rtol=1e-9, atol=1e-9)


def test_initial_shear_modulus_is_mu():
    g = 1e-2
    C = np.array([[1, g, 0], [g, 1 + g * g, 0], [0, 0, 1]])
    for law, mu in ((NeoHooke(5.0), 5.0), (Ogden([2.0, 3.0], [-20.0, 7.0]), 5.0)):
        energy = law.energy(ngs.CF(tuple(C.ravel()), dims=(3, 3)))(POINT)
        assert 2 * energy / g**2 == pytest.approx(mu, rel=1e-3)


def test_sum_adds_energies():
    C = np.diag([1.2, 1.0, 0.9])
    total = stress(NeoHooke(1.0) + Ogden(2.0, -5.0) + NeoHooke(0.5), C)
    assert np.allclose(total, stress(NeoHooke(1.5), C) + stress(Ogden(2.0, -5.0), C))


def test_sum_with_a_relaxing_material_adds_to_what_stays():
    C = np.diag([1.2, 1.0, 1 / 1.2])
    relaxing = Viscous(NeoHooke(1.0), (Branch(NeoHooke(2.0), 3.0),))
    for total, branches, stays in (
        (relaxing + Ogden(4.0, -5.0), 1, NeoHooke(1.0) + Ogden(4.0, -5.0)),
        (Ogden(4.0, -5.0) + relaxing, 1, NeoHooke(1.0) + Ogden(4.0, -5.0)),
        (relaxing + relaxing, 2, NeoHooke(2.0)),
    ):
        assert len(total.branches) == branches
        assert np.allclose(stress(total.equilibrium, C), stress(stays, C))
    assert np.allclose(stress(relaxing.instantaneous, C), stress(NeoHooke(3.0), C))
    with pytest.raises(TypeError):
        NeoHooke(1.0) + 2.0
    with pytest.raises(TypeError):
        relaxing + 2.0


def test_branch_stress_is_zero_at_rest_and_deviatoric():
    branch = Branch(Ogden(900.0, -25.0), 2.0)
    at_rest = np.array(branch.stress(ngs.Id(3))(POINT))
    assert np.max(np.abs(at_rest)) < 1e-8
    C = np.array([[1.1, 0.05, 0], [0.05, 1.0, 0.02], [0, 0.02, 0.93]])
    C /= np.linalg.det(C) ** (1 / 3)
    S = np.array(branch.stress(ngs.CF(tuple(C.ravel()), dims=(3, 3)))(POINT)).reshape(3, 3)
    assert abs(np.sum(S * C)) < 1e-9 * np.linalg.norm(S)


def test_step_factors_keep_precision_from_tiny_to_huge_steps():
    x = np.array([0.0, 1e-12, 1e-6, 1.0, 1e6])
    e, beta = step_factors(1.0, 1 / np.maximum(x, 1e-300))
    assert np.allclose(beta, [1.0, 1 - 5e-13, 1 - 5e-7 + 1e-12 / 6, 1 - np.exp(-1), 1e-6], rtol=1e-13, atol=0)
    assert e[-1] == 0.0


def test_prony_splits_the_instantaneous_law():
    material = Prony(NeoHooke(842.0), g=[0.45, 0.365], tau=[0.5, 50.0])
    C = np.diag([1.2, 1.0, 1 / 1.2])

    class At:
        def __init__(self, shares):
            self.shares = shares

        def energy(self, C):
            return material.density(Deformation.from_stretch(C), self.shares)

    assert np.allclose(stress(At([1, 1]), C), stress(NeoHooke(842.0), C))
    assert np.allclose(stress(At([0, 0]), C), stress(NeoHooke(842.0 * 0.185), C))


def test_prony_takes_parameters():
    share, C = ngs.Parameter(0.3), np.diag([1.2, 1.0, 1 / 1.2])
    material = Prony(NeoHooke(842.0), g=[share], tau=[ngs.Parameter(0.5)])
    share.Set(0.4)
    assert np.allclose(stress(material.equilibrium, C), stress(NeoHooke(842.0 * 0.6), C))


def test_catalogue_has_the_published_sums():
    initial = {name: entry.initial_modulus for name, entry in CATALOGUE.items() if name.startswith("griffiths")}
    assert initial == {
        "griffiths2024:cortex": 2380.0,
        "griffiths2024:white_matter": 1380.0,
        "griffiths2024:corpus_callosum": 830.0,
        "griffiths2024:deep_grey": 1120.0,
    }
    times = [branch.tau for branch in constants("griffiths2024:white_matter").law().branches]
    assert times == pytest.approx([2.26, 1199.2], rel=2e-3)


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: NeoHooke(-1.0), "NeoHooke.mu"),
        (lambda: Ogden(0.0, 2.0), "Ogden.mu"),
        (lambda: Ogden(1.0, 0), "Ogden.alpha"),
        (lambda: Ogden(np.array([1.0, -2.0]), np.array([3.0, 4.0])), "Ogden.mu"),
        (lambda: NeoHooke(np.int64(-5)), "NeoHooke.mu is -5"),
        (lambda: NeoHooke("500"), "NeoHooke.mu is '500'"),
        (lambda: NeoHooke(float("nan")), "NeoHooke.mu is nan"),
        (lambda: Ogden([1.0, 2.0], [3.0]), "Ogden.alpha"),
        (lambda: Branch(NeoHooke(1.0), 0.0), "Branch.tau"),
        (lambda: Prony(NeoHooke(1.0), [0.6, 0.5], [1.0, 2.0]), "Prony.g"),
        (lambda: Prony(NeoHooke(1.0), [0.6], [1.0, 2.0]), "Prony.tau"),
        (lambda: constants("griffiths2024:cortx"), "griffiths2024:cortex"),
    ],
)
def test_bad_parameters_are_named(make, field):
    with pytest.raises(InputError, match=field.replace(".", r"\.")):
        make()


def test_viscous_without_branches_is_its_law():
    C = ngs.CF(tuple(np.diag([1.1, 1.0, 0.9]).ravel()), dims=(3, 3))
    assert Viscous(NeoHooke(3.0)).density(Deformation.from_stretch(C), [])(POINT) == pytest.approx(
        NeoHooke(3.0).energy(C)(POINT)
    )


def test_barrier_is_soft_near_one_and_steep_beyond():
    J = ngs.Parameter(1.0)
    energy = barrier(J, 2.0)

    def at(value):
        J.Set(value)
        return energy(POINT)

    assert (
        at(1.0) == 0 and at(1.001) == pytest.approx(1e-6, rel=2e-3) and at(1 / 1.001) == pytest.approx(1e-6, rel=2e-3)
    )
    assert at(0.8) == pytest.approx(2 / 900 * (np.cosh(30 * np.log(0.8)) - 1), rel=1e-12)
    assert at(0.8) > 10 * 0.2**2 and np.isnan(at(-0.1))
