"""The complex modulus: closed forms, the time domain it is the image of, parameters that vary, waves, what is refused."""

import ngsolve as ngs
import numpy as np
import pytest
from netgen.occ import unit_cube

from ngbrain.errors import InputError
from ngbrain.materials import Branch, Demiray, NeoHooke, Ogden, Prony, Viscous, constants, fourier, step_factors
from ngbrain.materials.modulus import (
    KelvinVoigt,
    MaxwellModulus,
    PowerLaw,
    PronySeries,
    Springpot,
    Zener,
    shear_wave,
)
from ngbrain.materials.points import initial_modulus

MESH = ngs.Mesh(unit_cube.GenerateMesh(maxh=2.0))
POINT = MESH(0.3, 0.3, 0.2)
OMEGA = np.geomspace(1e-3, 1e5, 33)

# Modulus and closed form (storage, loss) at ω = w.
MODULI = {
    "Kelvin-Voigt": (KelvinVoigt(2e3, 1.5), lambda w: (2e3 + 0 * w, 1.5 * w)),
    "Maxwell": (
        MaxwellModulus(2e3, 5.0),
        lambda w: (2e3 * (w / 400) ** 2 / (1 + (w / 400) ** 2), 2e3 * (w / 400) / (1 + (w / 400) ** 2)),
    ),
    "Zener": (
        Zener(700.0, 2e3, 5.0),
        lambda w: (700 + 2e3 * (w / 400) ** 2 / (1 + (w / 400) ** 2), 2e3 * (w / 400) / (1 + (w / 400) ** 2)),
    ),
    "springpot": (
        Springpot(300.0, 0.25),
        lambda w: (300 * w**0.25 * np.cos(np.pi / 8), 300 * w**0.25 * np.sin(np.pi / 8)),
    ),
    "power law": (
        PowerLaw(2e3, 800.0, 0.4, 300.0),
        lambda w: (2e3 * (w / 300) ** 0.4, 800 * (w / 300) ** 0.4),
    ),
    "Prony": (
        PronySeries(842.0, [0.45, 0.365], [0.5, 50.0]),
        lambda w: (
            842 * (0.185 + sum(g * (w * t) ** 2 / (1 + (w * t) ** 2) for g, t in ((0.45, 0.5), (0.365, 50.0)))),
            842 * sum(g * w * t / (1 + (w * t) ** 2) for g, t in ((0.45, 0.5), (0.365, 50.0))),
        ),
    ),
}


@pytest.mark.parametrize("name", MODULI)
def test_closed_forms(name):
    modulus, closed = MODULI[name]
    G, (storage, loss) = modulus(OMEGA), closed(OMEGA)
    assert G.dtype == complex and G.shape == OMEGA.shape
    assert np.allclose(G.real, storage, rtol=1e-12, atol=0) and np.allclose(G.imag, loss, rtol=1e-12, atol=0)
    assert np.all(G.imag >= 0)
    one = modulus(float(OMEGA[7]))
    assert isinstance(one, complex) and one == pytest.approx(G[7], rel=1e-12)


@pytest.mark.parametrize("name", MODULI)
def test_parameters_that_vary_give_the_same_values(name):
    modulus, _ = MODULI[name]
    values = [getattr(modulus, field) for field in modulus.__dataclass_fields__]
    kinds = {"coefficient": ngs.CF, "parameter": ngs.Parameter, "grid function": _grid_function}
    for kind, make in kinds.items():
        varying = type(modulus)(*([make(x) for x in v] if isinstance(v, list) else make(v) for v in values))
        G = varying(210.0)
        assert isinstance(G, ngs.CoefficientFunction) and G.is_complex, kind
        assert G(POINT) == pytest.approx(modulus(210.0), rel=1e-12), kind
    for omega in (ngs.Parameter(210.0), ngs.CF(210.0)):
        assert modulus(omega)(POINT) == pytest.approx(modulus(210.0), rel=1e-12)


def _grid_function(value):
    gf = ngs.GridFunction(ngs.L2(MESH, order=1))
    gf.Set(ngs.CF(value))
    return gf


def test_a_parameter_can_be_changed_later_and_derived_by():
    mu = ngs.Parameter(1000.0)
    G = KelvinVoigt(mu, 2.0)(100.0)
    mu.Set(3000.0)
    assert G(POINT) == 3000 + 200j
    assert complex(G.Diff(mu)(POINT)) == 1


def test_sum_adds_and_stays_flat():
    parts = [KelvinVoigt(1e3, 0.5), Springpot(50.0, 0.5), MaxwellModulus(200.0, 1.0)]
    total = parts[0] + parts[1] + parts[2]
    assert len(total.parts) == 3 and len((parts[0] + (parts[1] + parts[2])).parts) == 3
    assert np.allclose(total(OMEGA), sum(part(OMEGA) for part in parts), rtol=1e-12)


def test_zener_is_a_prony_series_of_one_term():
    assert np.allclose(Zener(500.0, 1500.0, 30.0)(OMEGA), PronySeries(2e3, [0.75], [0.02])(OMEGA), rtol=1e-12)
    assert np.allclose(
        Zener(500.0, 1500.0, 30.0)(OMEGA), (KelvinVoigt(500.0, 0.0) + MaxwellModulus(1500.0, 30.0))(OMEGA)
    )


@pytest.mark.parametrize("a", [0.05, 0.3, 0.5, 0.95])
def test_springpot_has_one_loss_tangent(a):
    G = Springpot(40.0, a)(OMEGA)
    assert np.allclose(G.imag / G.real, np.tan(np.pi * a / 2), rtol=1e-12)


def test_causal_power_law_is_a_springpot():
    a, reference = 0.3, 2 * np.pi * 50
    G = Springpot(120.0, a)(reference)
    assert np.allclose(PowerLaw(G.real, G.imag, a, reference)(OMEGA), Springpot(120.0, a)(OMEGA), rtol=1e-12)


# The image of a material in time.

MATERIALS = {
    "Prony of Ogden": Prony(Ogden(842.0, -4.7), g=[0.45, 0.365], tau=[0.05, 0.8]),
    "branches of their own": Viscous(
        Ogden(420.0, -21.27), (Branch(Demiray(1400.0, 12.0), 0.05), Branch(Ogden([300.0, 260.0], [-23.76, 4.0]), 0.8))
    ),
}


def shear_stress(law, shears):
    """∂W/∂γ of simple shear."""
    shear = ngs.Parameter(0.0)
    C = ngs.CF((1, shear, 0, shear, 1 + shear**2, 0, 0, 0, 1), dims=(3, 3))
    derivative = law.energy(C).Diff(shear)
    values = []
    for value in shears:
        shear.Set(value)
        values.append(derivative(POINT))
    return np.array(values)


@pytest.mark.parametrize("omega", [1.0, 6.0, 40.0])
@pytest.mark.parametrize("name", MATERIALS)
def test_image_is_the_steady_state_of_the_recursion_in_time(name, omega):
    material = MATERIALS[name]
    per_period, size = 128, 1e-4
    phase = 2 * np.pi * np.arange(per_period) / per_period
    dt = 2 * np.pi / omega / per_period
    periods = 2 + int(12 * 0.8 * omega / (2 * np.pi))
    total = shear_stress(material.equilibrium, size * np.sin(phase))
    for branch in material.branches:
        stress = np.tile(shear_stress(branch.law, size * np.sin(phase)), periods)
        (e,), (beta,) = step_factors(dt, np.array([branch.tau]))
        H = np.zeros(len(stress))
        for n in range(1, len(stress)):
            H[n] = e * H[n - 1] + beta * (stress[n] - stress[n - 1])
        total = total + H[-per_period:]
    # γ = size sin ωt is Im(size e^{iωt}), so the answer is Im(G* size e^{iωt}).
    measured = 2j * np.mean(total * np.exp(-1j * phase)) / size
    assert abs(measured / fourier(material)(omega) - 1) < 1e-3


@pytest.mark.parametrize("alpha", [-30.8, -4.7, 2.0, 9.0])
def test_initial_modulus_from_the_energy(alpha):
    assert initial_modulus(Ogden(830.0, alpha)) == pytest.approx(830.0, rel=1e-8)
    assert initial_modulus(NeoHooke(100.0) + Ogden(830.0, alpha)) == pytest.approx(930.0, rel=1e-8)


def test_limits_of_the_image_are_the_sums_of_moduli():
    white = constants("griffiths2024:white_matter")
    G = fourier(white.law())
    assert G(1e9).real == pytest.approx(white.initial_modulus, rel=1e-6)
    assert G(1e-9).real == pytest.approx(white.law().equilibrium.mu, rel=1e-6)
    assert fourier(NeoHooke(5.0))(OMEGA) == pytest.approx(5.0 + 0j * OMEGA)


def test_image_of_a_varying_material_varies():
    mu = ngs.Parameter(900.0)
    material = Viscous(NeoHooke(mu), (Branch(NeoHooke(600.0), 0.01), Branch(Ogden(mu, -20.0), 0.1)))
    G = fourier(material)(100.0)
    mu.Set(400.0)
    exact = 400 + 600 * 1j / (1 + 1j) + 400 * 10j / (1 + 10j)
    assert G(POINT) == pytest.approx(exact, rel=1e-8)


# Waves.


@pytest.mark.parametrize(
    ("G", "length", "speed", "stiffness", "depth"),
    [
        (1.0e3 + 0.5e3j, 21.7, 1.086, 1.180, 14.6),
        (2.0e3 + 0.8e3j, 29.9, 1.495, 2.234, 24.7),
        (2.7e3 + 1.2e3j, 35.1, 1.757, 3.088, 26.4),
        (3.0e3 + 2.0e3j, 39.7, 1.984, 3.936, 20.9),
    ],
)
def test_scales_of_a_wave_at_50_hertz(G, length, speed, stiffness, depth):
    wave = shear_wave(G, rho=1000.0, omega=2 * np.pi * 50)
    assert 1e3 * wave.length == pytest.approx(length, abs=0.051)
    assert wave.speed == pytest.approx(speed, abs=5.1e-4)
    assert 1e3 * wave.depth == pytest.approx(depth, abs=0.051)
    assert 1000 * wave.speed**2 / 1e3 == pytest.approx(stiffness, abs=1e-3)
    assert wave.k.imag < 0 and 1000 * wave.omega**2 == pytest.approx(G * wave.k**2)


def test_wave_over_frequencies_and_without_loss():
    omega = 2 * np.pi * np.array([20.0, 50.0, 80.0])
    wave = shear_wave(Springpot(100.0, 0.4)(omega), 1000.0, omega)
    assert wave.length.shape == wave.depth.shape == (3,) and np.all(np.diff(wave.length) < 0)
    assert shear_wave(4000.0, 1000.0, 100.0).depth == np.inf


@pytest.mark.parametrize(
    ("make", "field", "value"),
    [
        (lambda: KelvinVoigt(0.0, 1.0), r"KelvinVoigt\.mu", "0.0"),
        (lambda: KelvinVoigt(1.0, -0.5), r"KelvinVoigt\.eta", "-0.5"),
        (lambda: MaxwellModulus(-1.0, 1.0), r"Maxwell\.mu", "-1.0"),
        (lambda: MaxwellModulus(1.0, -2.0), r"Maxwell\.eta", "-2.0"),
        (lambda: Zener(0.0, 1.0, 1.0), r"Zener\.mu_inf", "0.0"),
        (lambda: Zener(1.0, -3.0, 1.0), r"Zener\.mu", "-3.0"),
        (lambda: Zener(1.0, 1.0, 0.0), r"Zener\.eta", "0.0"),
        (lambda: Springpot(-1.0, 0.5), r"Springpot\.kappa", "-1.0"),
        (lambda: Springpot(1.0, 1.0), r"Springpot\.exponent", "1.0"),
        (lambda: Springpot(1.0, 0.0), r"Springpot\.exponent", "0.0"),
        (lambda: PowerLaw(0.0, 1.0, 0.5, 1.0), r"PowerLaw\.storage", "0.0"),
        (lambda: PowerLaw(1.0, -1.0, 0.5, 1.0), r"PowerLaw\.loss", "-1.0"),
        (lambda: PowerLaw(1.0, 1.0, -0.5, 1.0), r"PowerLaw\.exponent", "-0.5"),
        (lambda: PowerLaw(1.0, 1.0, 0.5, 0.0), r"PowerLaw\.reference", "0.0"),
        (lambda: PronySeries(-1.0, [0.5], [1.0]), r"PronySeries\.mu", "-1.0"),
        (lambda: PronySeries(1.0, [-0.1], [1.0]), r"PronySeries\.g", "-0.1"),
        (lambda: PronySeries(1.0, [0.6, 0.4], [1.0, 2.0]), r"PronySeries\.g", r"\[0\.6, 0\.4\]"),
        (lambda: PronySeries(1.0, [0.5], [0.0]), r"PronySeries\.tau", "0.0"),
        (lambda: PronySeries(1.0, [0.5], [1.0, 2.0]), r"PronySeries\.tau", "2 values"),
        (lambda: MaxwellModulus(1.0, 1.0)(-5.0), "omega", "-5.0"),
        (lambda: Springpot(1.0, 0.5)(np.array([1.0, float("nan")])), "omega", "nan"),
        (lambda: shear_wave(1000.0 - 1.0j, 1000.0, 1.0), r"shear_wave\.G", r"1000-1j"),
        (lambda: shear_wave(1000.0, 0.0, 1.0), r"shear_wave\.rho", "0.0"),
    ],
)
def test_refuses(make, field, value):
    with pytest.raises(InputError, match=f"{field} is .*{value}"):
        make()
