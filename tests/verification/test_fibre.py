"""Fibre laws and Fung's against closed forms, in numpy; objectivity, symmetry of the material, Taylor tests."""

import ngsolve as ngs
import numpy as np
import pytest
from states import cauchy, energy, some, stress, tangent, turn

from ngbrain import adjoint
from ngbrain.errors import InputError
from ngbrain.materials import (
    Compressible,
    Deformation,
    Demiray,
    Fung,
    Guccione,
    HolzapfelGasserOgden,
    NeoHooke,
    SaintVenant,
    TransverselyIsotropic,
    UnsplitNeoHooke,
    density,
)
from ngbrain.materials.fibre import structural
from ngbrain.materials.points import Points

MU, K1, K2 = 1.3, 0.7, 2.0
FIBRE = np.array([1.0, -2.0, 0.5])
SHEARS = np.diag([9.0, 5.0, 4.0, 2.0, 3.0, 1.5])
SHEARS[0, 1] = SHEARS[1, 0] = 1.0
SHEARS[0, 5] = SHEARS[5, 0] = 0.4
LAWS = {
    "one family": HolzapfelGasserOgden(MU, K1, K2, 0.1, tuple(FIBRE)),
    "two families": HolzapfelGasserOgden(MU, K1, K2, 0.0, [(1.0, 1.0, 0.0), (1.0, -1.0, 0.0)]),
    "Fung": Fung(0.5, SHEARS),
    "Guccione": Guccione(0.5, 8.0, 2.0, 4.0, tuple(FIBRE)),
    "Saint-Venant": SaintVenant(MU, 2.0),
    "unsplit": UnsplitNeoHooke(MU),
    "sum": HolzapfelGasserOgden(MU, K1, K2, 0.2, tuple(FIBRE)) + Demiray(1.0, 2.0) + Compressible(20.0),
}


def uniaxial(stretch):
    return np.diag([stretch, stretch**-0.5, stretch**-0.5])


def simple_shear(shear):
    F = np.eye(3)
    F[0, 1] = shear
    return F


def stretched(rng):
    """A state in which fibres bear."""
    F = some(rng, 1)[0] + 0.3 * np.eye(3)
    assert np.linalg.norm(F @ FIBRE) > 1.05 * np.linalg.norm(FIBRE)
    return F


@pytest.mark.parametrize("stretch", [0.7, 0.95, 1.05, 1.4])
def test_a_stretch_along_the_fibres_tightens_them_and_a_shortening_does_not(stretch):
    law = HolzapfelGasserOgden(MU, K1, K2, 0.0, (2.0, 0.0, 0.0))
    beyond = max(stretch**2 - 1, 0)
    wanted = MU * (stretch - stretch**-2) + 2 * K1 * stretch * beyond * np.exp(K2 * beyond**2)
    assert cauchy(law, uniaxial(stretch))[0, 0, 0] / stretch == pytest.approx(wanted, rel=1e-10)


@pytest.mark.parametrize("shear", [-0.6, 0.1, 0.8])
def test_simple_shear_along_and_across_the_fibres(shear):
    along, across = (HolzapfelGasserOgden(MU, K1, K2, 0.0, a) for a in ((1, 0, 0), (0, 1, 0)))
    assert stress(along, simple_shear(shear))[0, 0, 1] == pytest.approx(MU * shear, rel=1e-10)
    wanted = MU * shear + 2 * K1 * shear**3 * np.exp(K2 * shear**4)
    assert stress(across, simple_shear(shear))[0, 0, 1] == pytest.approx(wanted, rel=1e-10)


def test_full_dispersion_knows_no_fibre(rng):
    F = some(rng, 20) * 1.2  # stretched all over: E > 0
    I1 = np.einsum("nij,nij->n", F, F)
    J = np.linalg.det(F)
    E = (I1 - 3) / 3
    assert E.min() > 0
    wanted = MU / 2 * (J ** (-2 / 3) * I1 - 3) + K1 / (2 * K2) * np.expm1(K2 * E**2)
    for fibre in [(1, 0, 0), (0, 0, -3), tuple(FIBRE)]:
        law = HolzapfelGasserOgden(MU, K1, K2, 1 / 3, fibre)
        assert energy(law, F) == pytest.approx(wanted, rel=1e-10)
        assert stress(law, F) == pytest.approx(stress(HolzapfelGasserOgden(MU, K1, K2, 1 / 3, (0, 1, 0)), F), rel=1e-10)


def test_sign_and_length_of_a_fibre_do_not_matter(rng):
    F = some(rng, 20)
    for law in (lambda a: HolzapfelGasserOgden(MU, K1, K2, 0.1, a), lambda a: Guccione(0.5, 8.0, 2.0, 4.0, a)):
        wanted = energy(law(tuple(FIBRE)), F)
        for same in (tuple(-FIBRE), tuple(7 * FIBRE), FIBRE, ngs.CF(tuple(0.1 * FIBRE)), [*map(float, -3 * FIBRE)]):
            assert energy(law(same), F) == pytest.approx(wanted, rel=1e-12)
    components = (ngs.Parameter(1.0), -2.0, 0.5)
    assert energy(HolzapfelGasserOgden(MU, K1, K2, 0.1, components), F) == pytest.approx(
        energy(LAWS["one family"], F), rel=1e-12
    )


@pytest.mark.parametrize("kappa", [0.0, 0.15])
@pytest.mark.parametrize("stretch", [0.9, 1.1, 1.3])
def test_two_families_in_a_stretch_with_given_sides(stretch, kappa):
    angle, side = np.radians(35), stretch**-0.3
    F = np.diag([stretch, side, 1 / (stretch * side)])
    fibres = [np.array([np.cos(angle), sign * np.sin(angle), 0]) for sign in (1, -1)]
    b = F @ F.T
    sigma = MU * (b - np.trace(b) / 3 * np.eye(3))
    for a0 in fibres:
        a = F @ a0
        E = kappa * (np.trace(b) - 3) + (1 - 3 * kappa) * (a @ a - 1)
        if E > 0:
            sigma += 2 * K1 * E * np.exp(K2 * E**2) * (kappa * b + (1 - 3 * kappa) * np.outer(a, a))
    law = HolzapfelGasserOgden(MU, K1, K2, kappa, [tuple(a) for a in fibres])
    found = stress(law, F)[0] @ F.T
    assert found == pytest.approx(sigma, rel=1e-10, abs=1e-12)
    assert abs(found[0, 1]) < 1e-12  # their shears cancel


def test_families_may_be_fields(rng):
    F = some(rng, 5)
    fields = [ngs.CF((1.0, 1.0, 0.0)), np.array([3.0, -3.0, 0.0])]
    wanted = energy(LAWS["two families"], F)
    assert energy(HolzapfelGasserOgden(MU, K1, K2, 0.0, fields), F) == pytest.approx(wanted, rel=1e-12)


def test_fibres_let_go_without_a_jump_of_stress_and_survive_any_pressure():
    law, matrix = HolzapfelGasserOgden(MU, K1, 1e3, 0.0, (1, 0, 0)), NeoHooke(MU)
    for gap in (1e-4, 1e-6, 0.0, -1e-6, -1e-4):
        F = np.diag([1 + gap, 1, 1])
        assert np.abs(stress(law, F) - stress(matrix, F)).max() <= 1.01 * 4 * K1 * max(gap, 0) + 1e-12 * MU
    pressed = np.diag([0.1, 1, 1])  # exp(1000 E²) is infinite
    assert stress(law, pressed) == pytest.approx(stress(matrix, pressed), rel=1e-12)
    assert np.all(np.isfinite(tangent(law, pressed)))


def test_fung_against_its_formula(rng):
    F = some(rng, 20)
    E = (F.transpose(0, 2, 1) @ F - np.eye(3)) / 2
    v = np.stack([E[:, 0, 0], E[:, 1, 1], E[:, 2, 2], 2 * E[:, 1, 2], 2 * E[:, 0, 2], 2 * E[:, 0, 1]], axis=1)
    Q = np.einsum("ni,ij,nj->n", v, SHEARS, v)
    assert energy(LAWS["Fung"], F) == pytest.approx(0.25 * np.expm1(Q), rel=1e-12)
    fields = (
        Fung(0.5, ngs.CF(tuple(SHEARS.ravel()), dims=(6, 6))),
        Fung(ngs.Parameter(0.5), [[ngs.Parameter(x) for x in row] for row in SHEARS]),
    )
    for law in fields:
        assert energy(law, F) == pytest.approx(energy(LAWS["Fung"], F), rel=1e-12)


def test_isotropic_fung_is_small_strain_elasticity_at_rest():
    b, beta, c = 3.0, 1.7, 0.5
    B = np.diag([2 * b] * 3 + [b] * 3)
    B[:3, :3] += b * beta
    assert tangent(Fung(c, B), np.eye(3)) == pytest.approx(tangent(SaintVenant(c * b, c * b * beta), np.eye(3)))


def test_guccione_is_fung_with_one_fibre(rng):
    bf, bt, bfs = 8.0, 2.0, 4.0
    F = some(rng, 20)
    along_x = Fung(0.5, np.diag([bf, bt, bt, bt / 2, bfs / 2, bfs / 2]))
    assert energy(Guccione(0.5, bf, bt, bfs, (1, 0, 0)), F) == pytest.approx(energy(along_x, F), rel=1e-12)
    R = turn((1.0, 2.0, -1.0), 0.7)
    turned = Guccione(0.5, bf, bt, bfs, tuple(R @ [1, 0, 0]))
    assert energy(turned, F @ R.T) == pytest.approx(energy(along_x, F), rel=1e-12)


def test_initial_shear_moduli():
    slope = {}
    for name, a in (("along", (1, 0, 0)), ("plane", (0, 0, 1))):
        laws = HolzapfelGasserOgden(MU, K1, K2, 0.1, a), Guccione(0.5, 8.0, 2.0, 4.0, a)
        slope[name] = [tangent(law, np.eye(3))[0, 1, 1] for law in laws]
    assert slope["along"] == pytest.approx([MU, 0.5 * 4 / 2], rel=1e-10)
    assert slope["plane"] == pytest.approx([MU, 0.5 * 2 / 2], rel=1e-10)


@pytest.mark.parametrize("fibre", [(1, 0, 0), (1.0, 0.3, 0.1)])
def test_fibres_count_in_the_stiffness_at_rest(fibre):
    # E = 2 (1 - 2κ) ε along them, where round-off must not decide.
    a = np.array(fibre) / np.linalg.norm(fibre)
    along = np.kron(a, a)
    K = tangent(HolzapfelGasserOgden(MU, K1, K2, 0.1, fibre), np.eye(3))[0]
    assert along @ K @ along == pytest.approx(4 / 3 * MU + 4 * K1 * 0.8**2, rel=1e-10)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_a_rotation_of_the_body_changes_no_energy(law, rng):
    F = some(rng, 100)
    Q = np.stack(
        [turn(axis, angle) for axis, angle in zip(rng.normal(size=(100, 3)), rng.normal(size=100), strict=True)]
    )
    assert energy(law, Q @ F) == pytest.approx(energy(law, F), rel=1e-12, abs=1e-12)


CONSTANTS = {
    "one family": (lambda mu, k1, k2, kappa: HolzapfelGasserOgden(mu, k1, k2, kappa, tuple(FIBRE)), (MU, K1, K2, 0.1)),
    "Guccione": (lambda c, bf, bt, bfs: Guccione(c, bf, bt, bfs, tuple(FIBRE)), (0.5, 8.0, 2.0, 4.0)),
    "transversely isotropic": (lambda mu, z, p: TransverselyIsotropic(mu, z, p, tuple(FIBRE)), (MU, 0.8, 0.4)),
    "Saint-Venant": (SaintVenant, (MU, 2.0)),
    "unsplit": (UnsplitNeoHooke, (MU,)),
}


@pytest.mark.parametrize(("make", "values"), CONSTANTS.values(), ids=CONSTANTS)
def test_parameters_may_be_fields_and_have_derivatives(make, values, rng):
    F = stretched(rng)
    parameters = [ngs.Parameter(value) for value in values]
    at = Deformation.from_gradient(ngs.CF(tuple(F.ravel()), dims=(3, 3)))
    law, point = make(*parameters), Points.line(1)
    assert point(density(law, at))[0, 0] == pytest.approx(energy(make(*values), F)[0], rel=1e-12)
    for i, parameter in enumerate(parameters):
        slope = point(density(law, at).Diff(parameter))[0, 0]
        step = 1e-5 * np.eye(len(values))[i]
        above, below = (energy(make(*(np.array(values) + sign * step)), F)[0] for sign in (1, -1))
        assert slope == pytest.approx((above - below) / 2e-5, rel=1e-6), i


@pytest.mark.parametrize("name", ["one family", "Guccione", "sum"])
def test_a_rotation_about_the_fibre_changes_no_energy(name, rng):
    F, law = some(rng, 100), LAWS[name]
    for angle in (0.3, 2.0, np.pi):
        assert energy(law, F @ turn(FIBRE, angle)) == pytest.approx(energy(law, F), rel=1e-12, abs=1e-12)
    across = energy(law, F @ turn((1, 1, 1), 1.0))
    assert np.abs(across / energy(law, F) - 1).max() > 0.05


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_stress_and_tangent_are_derivatives(law, rng):
    F = stretched(rng)
    dF = rng.uniform(-1, 1, (3, 3))
    rates = adjoint.check.taylor(lambda x: energy(law, x)[0], stress(law, F)[0], F, dF, first=2e-3)
    assert np.all(np.abs(rates - 2) < 0.1), rates
    K = tangent(law, F)[0]
    assert np.abs(K - K.T).max() < 1e-10 * np.abs(K).max()
    rates = adjoint.check.taylor(lambda x: stress(law, x)[0].ravel(), lambda d: K @ d.ravel(), F, dF, first=2e-3)
    assert np.all(np.abs(rates - 2) < 0.1), rates


@pytest.mark.parametrize("law", [law for name, law in LAWS.items() if name != "sum"])
def test_rest_has_no_stress(law):
    assert np.abs(stress(law, np.eye(3))).max() < 1e-12 * MU


def hgo(**changed):
    return HolzapfelGasserOgden(**{"mu": 1.0, "k1": 1.0, "k2": 1.0, "kappa": 0.1, "fibre": (1, 0, 0)} | changed)


def guccione(**changed):
    return Guccione(**{"c": 1.0, "bf": 1.0, "bt": 1.0, "bfs": 1.0, "fibre": (1, 0, 0)} | changed)


@pytest.mark.parametrize(
    ("make", "field", "value"),
    [
        (lambda: hgo(mu=0.0), r"HolzapfelGasserOgden\.mu", r"0\.0"),
        (lambda: hgo(k1=-1.0), r"HolzapfelGasserOgden\.k1", r"-1\.0"),
        (lambda: hgo(k2=0), r"HolzapfelGasserOgden\.k2", "0"),
        (lambda: hgo(k2=float("nan")), r"HolzapfelGasserOgden\.k2", "nan"),
        (lambda: hgo(kappa=-0.1), r"HolzapfelGasserOgden\.kappa", r"-0\.1"),
        (lambda: hgo(kappa=0.34), r"HolzapfelGasserOgden\.kappa", r"0\.34"),
        (lambda: hgo(fibre=(0, 0, 0)), r"HolzapfelGasserOgden\.fibre", r"\(0, 0, 0\)"),
        (lambda: hgo(fibre=(1, 0)), r"HolzapfelGasserOgden\.fibre", r"\(1, 0\)"),
        (lambda: hgo(fibre=(1, 0, np.inf)), r"HolzapfelGasserOgden\.fibre", "inf"),
        (lambda: hgo(fibre=()), r"HolzapfelGasserOgden\.fibre", r"\(\)"),
        (lambda: hgo(fibre=ngs.CF((1, 0))), r"HolzapfelGasserOgden\.fibre", "2 components"),
        (lambda: hgo(fibre=[(1, 0, 0), (0, 0, 0)]), r"HolzapfelGasserOgden\.fibre", r"\(0, 0, 0\)"),
        (lambda: hgo(fibre=[(1, 0, 0), 2.0]), r"HolzapfelGasserOgden\.fibre", r"2\.0"),
        (lambda: Fung(-1.0, SHEARS), r"Fung\.c", r"-1\.0"),
        (lambda: Fung(1.0, np.eye(5)), r"Fung\.B", "5 rows"),
        (lambda: Fung(1.0, ngs.CF((1.0,) * 9, dims=(3, 3))), r"Fung\.B", r"\(3, 3\)"),
        (lambda: Fung(1.0, SHEARS + np.eye(6, k=2)), r"Fung\.B", r"1\.0 at \[0, 2\] and 0\.0 at \[2, 0\]"),
        (lambda: Fung(1.0, np.diag([1, 1, 1, 1, 1, -2.0])), r"Fung\.B", "-2"),
        (lambda: guccione(c=0.0), r"Guccione\.c", r"0\.0"),
        (lambda: guccione(bf=-8.0), r"Guccione\.bf", r"-8\.0"),
        (lambda: guccione(bt=-2.0), r"Guccione\.bt", r"-2\.0"),
        (lambda: guccione(bfs=-4.0), r"Guccione\.bfs", r"-4\.0"),
        (lambda: guccione(fibre=(0.0, 0.0, 0.0)), r"Guccione\.fibre", r"\(0\.0, 0\.0, 0\.0\)"),
    ],
)
def test_refuses(make, field, value):
    with pytest.raises(InputError, match=f"{field} is .*{value}"):
        make()


def test_a_law_may_ask_for_another_number_of_components():
    with pytest.raises(InputError, match=r"fibre is \(1, 0\); wanted: a direction of 3 components, not all 0"):
        structural((1, 0), "fibre")
    assert tuple(structural((1, 0), "fibre", (2, 3)).dims) == (2, 2)
