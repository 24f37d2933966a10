"""Quadratic laws: stiffness entry by entry, ratios of moduli, complex moduli, and what the linear ones lack."""

import ngsolve as ngs
import numpy as np
import pytest
from states import energy, some, stress, tangent, turn

from ngbrain import adjoint
from ngbrain.errors import InputError
from ngbrain.materials import Branch, LinearElastic, NeoHooke, SaintVenant, TransverselyIsotropic
from ngbrain.materials.points import Points

MU, ZETA, PHI, BULK = 1.3, 0.8, 0.4, 11.0
PAIRS = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
TISSUE = TransverselyIsotropic(MU, ZETA, PHI, (1, 0, 0))
LAWS = {"linear": LinearElastic(MU, 2.0), "transversely isotropic": TransverselyIsotropic(MU, ZETA, PHI, (1, -2, 0.5))}


def stiffness(law, bulk=0.0):
    """c_IJ in the order xx, yy, zz, yz, xz, xy with engineering shears, of the law and a bulk modulus."""
    K = tangent(law, np.eye(3))[0].reshape(3, 3, 3, 3)
    c = np.array([[K[(*i, *j)] for j in PAIRS] for i in PAIRS])
    c[:3, :3] += bulk
    return c


def quadratic_form(law, strain):
    """The energy of one strain."""
    return Points.line(1)(law.energy(ngs.CF(tuple(np.ravel(strain)), dims=np.shape(strain))))[0, 0]


@pytest.mark.parametrize("law", [LinearElastic(MU, 2.0), SaintVenant(MU, 2.0)])
def test_isotropic_stiffness(law):
    wanted = np.diag([2 * MU] * 3 + [MU] * 3)
    wanted[:3, :3] += 2.0
    assert stiffness(law) == pytest.approx(wanted, rel=1e-12, abs=1e-12)


def test_transversely_isotropic_stiffness():
    c11, c22 = BULK + 4 / 3 * MU * (1 + 4 / 3 * ZETA), BULK + 4 / 3 * MU * (1 + ZETA / 3)
    c12, c44 = BULK - 2 / 3 * MU * (1 + 4 / 3 * ZETA), MU * (1 + PHI)
    wanted = np.diag([c11, c22, c22, MU, c44, c44])
    wanted[0, 1] = wanted[1, 0] = wanted[0, 2] = wanted[2, 0] = c12
    wanted[1, 2] = wanted[2, 1] = c22 - 2 * MU  # isotropic across the fibre
    assert stiffness(TISSUE, BULK) == pytest.approx(wanted, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("zeta", [-0.5, 0.0, 3.0])
def test_ratios_of_moduli_without_change_of_volume(zeta):
    compliance = np.linalg.inv(stiffness(TransverselyIsotropic(MU, zeta, PHI, (1, 0, 0)), 1e9))
    assert compliance[1, 1] / compliance[0, 0] == pytest.approx(1 + zeta, rel=1e-6)
    assert 1 / compliance[0, 0] == pytest.approx(MU * (3 + 4 * zeta), rel=1e-6)
    assert compliance[3, 3] / compliance[5, 5] == pytest.approx(1 + PHI, rel=1e-12)


def test_a_dilatation_is_left_to_the_bulk():
    assert np.abs(stress(TISSUE, 1.01 * np.eye(3))).max() < 1e-12 * MU
    assert energy(TISSUE, 1.01 * np.eye(3))[0] == pytest.approx(0, abs=1e-12 * MU)


def test_plane_strain_of_a_turned_fibre():
    # The global stiffness T'cT of engineering strain rotated by 30° into the fibre's axes.
    cos, sin = np.cos(np.pi / 6), np.sin(np.pi / 6)
    T = np.array(
        [[cos**2, sin**2, cos * sin], [sin**2, cos**2, -cos * sin], [-2 * cos * sin, 2 * cos * sin, cos**2 - sin**2]]
    )
    c = stiffness(TISSUE)[np.ix_([0, 1, 5], [0, 1, 5])]
    v = np.array([0.3, -0.1, 0.25])
    wanted = v @ T.T @ c @ T @ v / 2
    strain = np.array([[v[0], v[2] / 2], [v[2] / 2, v[1]]])
    flat = TransverselyIsotropic(MU, ZETA, PHI, (cos, sin))
    assert quadratic_form(flat, strain) == pytest.approx(wanted, rel=1e-12)
    solid = TransverselyIsotropic(MU, ZETA, PHI, (cos, sin, 0.0))
    assert quadratic_form(solid, np.pad(strain, (0, 1))) == pytest.approx(wanted, rel=1e-12)


def test_complex_moduli_and_strains_are_not_conjugated(rng):
    strain = rng.normal(size=(3, 3)) + 1j * rng.normal(size=(3, 3))
    strain = strain + strain.T
    a = np.array([2.0, 1.0, -2.0]) / 3
    mu, zeta, phi, lam = 1 + 0.4j, 0.7 - 0.1j, 0.3 + 0.2j, 2 + 0.5j
    isotropic = mu * np.sum(strain * strain) + lam / 2 * np.trace(strain) ** 2
    assert quadratic_form(LinearElastic(mu, lam), strain) == pytest.approx(isotropic, rel=1e-12)
    dev = strain - np.trace(strain) / 3 * np.eye(3)
    sheared = np.sum((strain @ a) ** 2) - (a @ strain @ a) ** 2
    wanted = mu * (np.sum(dev * dev) + 2 * phi * sheared + 2 * zeta * (a @ dev @ a) ** 2)
    law = TransverselyIsotropic(mu, zeta, phi, tuple(7 * a))
    assert quadratic_form(law, strain) == pytest.approx(wanted, rel=1e-12)


def test_a_rotation_has_an_energy_in_the_linear_laws_and_none_in_saint_venants():
    Q = turn((1, 1, 0.3), np.radians(10))
    missing = 2 * (1 - np.cos(np.radians(10))) ** 2  # ε:ε, of (cos 10° - 1) twice
    assert energy(LinearElastic(MU), Q)[0] == pytest.approx(MU * missing, rel=1e-12)
    assert np.sqrt(2 * missing) == pytest.approx(0.0304, abs=1e-4)  # the shear of 3 % with the same energy
    assert energy(LAWS["transversely isotropic"], Q)[0] > 1e-4 * MU
    assert energy(SaintVenant(MU, 2.0), Q)[0] == pytest.approx(0, abs=1e-28)


def test_saint_venant_is_linear_theory_at_small_strain_and_weakens_when_pressed(rng):
    H = 1e-5 * rng.normal(size=(3, 3))
    close = energy(SaintVenant(MU, 2.0), np.eye(3) + H) / energy(LinearElastic(MU, 2.0), np.eye(3) + H)
    assert close == pytest.approx(1, abs=1e-4)
    pressed = [abs(stress(SaintVenant(MU, 2.0), np.diag([s, 1, 1]))[0, 0, 0]) for s in (0.61, 3**-0.5, 0.54)]
    assert pressed[0] < pressed[1] > pressed[2]


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_stress_and_tangent_are_derivatives(law, rng):
    F, dF = some(rng, 1)[0], rng.uniform(-1, 1, (3, 3))
    rates = adjoint.check.taylor(lambda x: energy(law, x)[0], stress(law, F)[0], F, dF)
    assert np.all(np.abs(rates - 2) < 0.1), rates
    K = tangent(law, F)[0]
    assert np.abs(K - K.T).max() < 1e-10 * np.abs(K).max()
    assert np.ravel(stress(law, F)[0] - stress(law, np.eye(3))[0]) == pytest.approx(
        K @ np.ravel(F - np.eye(3)), rel=1e-10
    )


def test_a_rotation_of_strain_about_the_fibre_changes_nothing(rng):
    F, law = some(rng, 100), LAWS["transversely isotropic"]
    R = turn((1, -2, 0.5), 0.9)
    assert energy(law, R @ F @ R.T) == pytest.approx(energy(law, F), rel=1e-12)
    other = turn((1, 1, 1), 0.9)
    assert np.abs(energy(law, other @ F @ other.T) / energy(law, F) - 1).max() > 0.1


def test_its_bounds_are_those_of_a_stable_tissue():
    least = [np.linalg.eigvalsh(stiffness(TransverselyIsotropic(1.0, z, p, (0, 0, 1)), 1.0))[0] for z, p in BOUNDS]
    assert min(least) > 0 and max(least) < 1e-3


BOUNDS = [(-0.7499, 0.0), (0.0, -0.9999)]


def test_a_linear_law_cannot_relax_in_a_branch():
    with pytest.raises(InputError, match=r"of the displacement gradient; wanted: .*SaintVenant"):
        Branch(LinearElastic(1.0), 1.0).stress(ngs.Id(3))
    with pytest.raises(InputError, match="of the displacement gradient"):
        (LinearElastic(1.0) + NeoHooke(1.0)).energy(ngs.Id(3))


@pytest.mark.parametrize(
    ("make", "field", "value"),
    [
        (lambda: LinearElastic(-1.0), r"LinearElastic\.mu", r"-1\.0"),
        (lambda: LinearElastic(3.0, -2.0), r"LinearElastic\.lam", r"-2\.0; wanted: a number above -2/3 mu, -2"),
        (lambda: SaintVenant(0.0), r"SaintVenant\.mu", r"0\.0"),
        (lambda: SaintVenant(3.0, float("nan")), r"SaintVenant\.lam", "nan"),
        (lambda: TransverselyIsotropic(0.0, 1.0, 1.0, (1, 0, 0)), r"TransverselyIsotropic\.mu", r"0\.0"),
        (lambda: TransverselyIsotropic(1.0, -0.75, 1.0, (1, 0, 0)), r"TransverselyIsotropic\.zeta", r"-0\.75"),
        (lambda: TransverselyIsotropic(1.0, 1.0, -1.0, (1, 0, 0)), r"TransverselyIsotropic\.phi", r"-1\.0"),
        (lambda: TransverselyIsotropic(1.0, 1.0, 1.0, (0, 0, 0)), r"TransverselyIsotropic\.fibre", r"\(0, 0, 0\)"),
        (
            lambda: TransverselyIsotropic(1.0, 1.0, 1.0, (1, 0, 0, 0)),
            r"TransverselyIsotropic\.fibre",
            r"\(1, 0, 0, 0\)",
        ),
    ],
)
def test_refuses(make, field, value):
    with pytest.raises(InputError, match=f"{field} is .*{value}"):
        make()
