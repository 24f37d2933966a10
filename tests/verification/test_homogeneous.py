"""Isotropic laws in homogeneous, incompressible states against closed forms; objectivity, isotropy, Taylor tests."""

import ngsolve as ngs
import numpy as np
import pytest
import states
from netgen.occ import unit_cube

from ngbrain import adjoint
from ngbrain.errors import InputError
from ngbrain.materials import Demiray, Gent, MooneyRivlin, NeoHooke, Ogden, Polynomial, Yeoh

MESH = ngs.Mesh(unit_cube.GenerateMesh(maxh=2.0))
POINT = MESH(0.3, 0.3, 0.2)

# Law, W₁ = ∂W/∂I₁ and W₂ = ∂W/∂I₂ as functions of (I₁ - 3, I₂ - 3), initial shear modulus.
LAWS = {
    "Neo-Hooke": (NeoHooke(2.0), lambda a, b: 1.0, lambda a, b: 0.0, 2.0),
    "Mooney-Rivlin": (MooneyRivlin(0.7, 0.4), lambda a, b: 0.7, lambda a, b: 0.4, 2.2),
    "Yeoh": (Yeoh(0.5, -0.05, 0.02), lambda a, b: 0.5 - 0.1 * a + 0.06 * a**2, lambda a, b: 0.0, 1.0),
    "Gent": (Gent(2.0, 5.0), lambda a, b: 5.0 / (5.0 - a), lambda a, b: 0.0, 2.0),
    "Demiray": (Demiray(2.0, 0.3), lambda a, b: np.exp(0.3 * a), lambda a, b: 0.0, 2.0),
    "polynomial": (
        Polynomial({(1, 0): 0.5, (0, 1): 0.25, (1, 1): 0.1, (0, 2): 0.05}),
        lambda a, b: 0.5 + 0.1 * b,
        lambda a, b: 0.25 + 0.1 * a + 0.1 * b,
        1.5,
    ),
}


def energy(law, C):
    return law.energy(ngs.CF(tuple(np.ravel(C)), dims=(3, 3)))(POINT)


def stress(law, F):
    """F S Fᵀ with S = 2 ∂W/∂C: the Cauchy stress but for a pressure."""
    C = ngs.CF(tuple(np.ravel(F.T @ F)), dims=(3, 3)).MakeVariable()
    S = np.array((2 * law.energy(C)).Diff(C)(POINT)).reshape(3, 3)
    return F @ S @ F.T


def cauchy(law, F):
    """Cauchy stress of an incompressible body without traction along z."""
    sigma = stress(law, F)
    return sigma - sigma[2, 2] * np.eye(3)


def reduced(F):
    C = F.T @ F
    i1 = np.trace(C)
    return i1 - 3, (i1**2 - np.trace(C @ C)) / 2 - 3


STRETCHES = [0.7, 0.93, 1.2, 1.6]
MODES = {
    "uniaxial": (lambda s: np.diag([s, s**-0.5, s**-0.5]), lambda s, w1, w2: 2 * (s - s**-2) * (w1 + w2 / s)),
    "equibiaxial": (lambda s: np.diag([s, s, s**-2]), lambda s, w1, w2: 2 * (s - s**-5) * (w1 + s**2 * w2)),
    "planar": (lambda s: np.diag([s, 1, 1 / s]), lambda s, w1, w2: 2 * (s - s**-3) * (w1 + w2)),
}


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", LAWS)
def test_nominal_stress_of_a_stretch(name, mode):
    law, w1, w2, _ = LAWS[name]
    deformed, exact = MODES[mode]
    for stretch in STRETCHES:
        F = deformed(stretch)
        wanted = exact(stretch, w1(*reduced(F)), w2(*reduced(F)))
        assert cauchy(law, F)[0, 0] / stretch == pytest.approx(wanted, rel=1e-10), stretch


@pytest.mark.parametrize("name", LAWS)
def test_stresses_of_simple_shear(name):
    law, w1, w2, _ = LAWS[name]
    for shear in (-0.6, 0.1, 1.0):
        F = np.eye(3)
        F[0, 1] = shear
        sigma, at = cauchy(law, F), reduced(F)
        assert sigma[0, 1] == pytest.approx(2 * shear * (w1(*at) + w2(*at)), rel=1e-10)
        assert sigma[0, 0] == pytest.approx(2 * shear**2 * w1(*at), rel=1e-10)
        assert sigma[1, 1] == pytest.approx(-2 * shear**2 * w2(*at), rel=1e-10, abs=1e-10)


@pytest.mark.parametrize("law", [*(entry[0] for entry in LAWS.values()), Ogden([1.0, 0.4], [-12.0, 3.0])])
def test_every_law_obeys_rivlins_relation_of_simple_shear(law):
    F = np.eye(3)
    F[0, 1] = 0.4
    sigma = cauchy(law, F)
    assert sigma[0, 0] - sigma[1, 1] == pytest.approx(0.4 * sigma[0, 1], rel=1e-9)


@pytest.mark.parametrize("alpha", [-20.0, -2.0, 3.0])
def test_ogden_in_the_other_modes(alpha):
    law, factor = Ogden(1.3, alpha), 2 * 1.3 / alpha
    for s in (0.8, 1.25):
        biaxial, planar = (cauchy(law, MODES[mode][0](s))[0, 0] / s for mode in ("equibiaxial", "planar"))
        assert biaxial == pytest.approx(factor * (s ** (alpha - 1) - s ** (-2 * alpha - 1)), rel=1e-8)
        assert planar == pytest.approx(factor * (s ** (alpha - 1) - s ** (-alpha - 1)), rel=1e-8)
    shear = 0.4
    F = np.eye(3)
    F[0, 1] = shear
    s = shear / 2 + np.sqrt(1 + shear**2 / 4)
    assert cauchy(law, F)[0, 1] == pytest.approx(factor * (s**alpha - s**-alpha) / (s + 1 / s), rel=1e-8)


@pytest.mark.parametrize("name", LAWS)
def test_initial_shear_modulus(name):
    law, _, _, mu = LAWS[name]
    F = np.eye(3)
    F[0, 1] = 1e-4
    assert stress(law, F)[0, 1] / 1e-4 == pytest.approx(mu, rel=1e-6)


@pytest.mark.parametrize("law", [*(entry[0] for entry in LAWS.values()), Ogden(1.0, -15.0)])
def test_energy_knows_no_directions(law, rng):
    for _ in range(100):
        F = np.eye(3) + 0.15 * rng.standard_normal((3, 3))
        F *= np.linalg.det(F) ** (-1 / 3)
        Q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
        W = energy(law, F.T @ F)
        turned, rotated = F @ Q, Q @ F
        assert energy(law, turned.T @ turned) == pytest.approx(W, rel=1e-12, abs=1e-12)
        assert energy(law, rotated.T @ rotated) == pytest.approx(W, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("law", [*(entry[0] for entry in LAWS.values()), Ogden(1.0, -15.0)])
def test_stress_is_the_derivative_of_energy(law, rng):
    F = np.eye(3) + 0.1 * rng.standard_normal((3, 3))
    dF = rng.standard_normal((3, 3))

    def first_piola(F):
        return stress(law, F) @ np.linalg.inv(F).T

    rates = adjoint.check.taylor(lambda F: energy(law, F.T @ F), first_piola(F), F, dF)
    assert np.all(np.abs(rates - 2) < 0.2), rates


@pytest.mark.parametrize("law", [*(entry[0] for entry in LAWS.values()), Ogden([1.0, 0.4], [-15.0, 3.0])])
def test_tangent_is_the_derivative_of_stress_and_symmetric(law, rng):
    F, dF = np.eye(3) + 0.1 * rng.standard_normal((3, 3)), rng.standard_normal((3, 3))
    K = states.tangent(law, F)[0]
    assert np.abs(K - K.T).max() < 1e-10 * np.abs(K).max()
    rates = adjoint.check.taylor(lambda F: states.stress(law, F)[0].ravel(), lambda d: K @ d.ravel(), F, dF, first=3e-3)
    assert np.all(np.abs(rates - 2) < 0.2), rates


PARAMETERS = {
    "Neo-Hooke": (NeoHooke, [2.0]),
    "Mooney-Rivlin": (MooneyRivlin, [0.7, 0.4]),
    "Yeoh": (Yeoh, [0.5, -0.05, 0.02]),
    "Gent": (Gent, [2.0, 5.0]),
    "Demiray": (Demiray, [2.0, 0.3]),
    "Ogden": (Ogden, [1.3, -12.0]),
}


@pytest.mark.parametrize("name", PARAMETERS)
def test_parameters_may_be_fields_and_have_derivatives(name, rng):
    make, values = PARAMETERS[name]
    F = states.some(rng, 1)[0]
    C = ngs.CF(tuple(np.ravel(F.T @ F / np.cbrt(np.linalg.det(F) ** 2))), dims=(3, 3))
    space = ngs.L2(MESH, order=0)
    for k, value in enumerate(values):
        field = ngs.GridFunction(space)
        law = make(*values[:k], field, *values[k + 1 :])

        def W(theta, law=law, field=field):
            field.vec[:] = float(theta[0])
            return law.energy(C)(POINT)

        W([value])
        slope = np.array([law.energy(C).Diff(field)(POINT)])
        assert W([value]) == pytest.approx(make(*values).energy(C)(POINT), rel=1e-12)
        x, dx = np.array([value]), np.array([0.3 * abs(value)])
        if W(x + dx) - W(x) == pytest.approx(slope[0] * dx[0], rel=1e-10):  # linear in it
            continue
        assert np.all(np.abs(adjoint.check.taylor(W, slope, x, dx, first=0.1) - 2) < 0.2), (name, k)


def test_gent_has_neither_energy_nor_stress_beyond_its_limit():
    F = np.diag([3.0, 3**-0.5, 3**-0.5])
    assert np.isfinite(energy(Gent(1.0, 7.0), F.T @ F)) and not np.isfinite(energy(Gent(1.0, 6.0), F.T @ F))
    assert np.isfinite(states.stress(Gent(1.0, 7.0), F[None])).all()
    assert np.isnan(states.stress(Gent(1.0, 6.0), F[None])[0, 0, 0])


@pytest.mark.parametrize(
    ("make", "field", "value"),
    [
        (lambda: MooneyRivlin(1.0, -1.0), r"MooneyRivlin\.c10 \+ c01", "0.0"),
        (lambda: Yeoh(-2.0, 3.0), r"Polynomial\.c\[1, 0\] \+ c\[0, 1\]", "-2.0"),
        (lambda: Polynomial({(1, 0): 1.0, (0, 0): 1.0}), r"Polynomial\.c", r"\(0, 0\)"),
        (lambda: Polynomial({(1, 0): 1.0, (-1, 2): 1.0}), r"Polynomial\.c", r"\(-1, 2\)"),
        (lambda: Polynomial({(1, 0): 1.0, (1.5, 0): 1.0}), r"Polynomial\.c", r"\(1\.5, 0\)"),
        (lambda: Gent(0.0, 1.0), r"Gent\.mu", "0.0"),
        (lambda: Gent(1.0, -3.0), r"Gent\.jm", "-3.0"),
        (lambda: Demiray(-1.0, 1.0), r"Demiray\.mu", "-1.0"),
        (lambda: Demiray(1.0, 0.0), r"Demiray\.b", "0.0"),
    ],
)
def test_refuses(make, field, value):
    with pytest.raises(InputError, match=f"{field} is .*{value}"):
        make()
