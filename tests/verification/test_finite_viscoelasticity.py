"""Maxwell branches of finite viscoelasticity against closed forms, an independent integration, and thermodynamics."""

import ngsolve as ngs
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ngbrain import adjoint
from ngbrain.errors import InputError
from ngbrain.materials import (
    HolzapfelGasserOgden,
    Maxwell,
    MaxwellVariables,
    MooneyRivlin,
    NeoHooke,
    Ogden,
    Prony,
    Viscous,
    fourier,
    lab,
)
from ngbrain.materials.maxwell import PLANE, tensors
from ngbrain.materials.points import Points

ENTRIES = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]


class Sample:
    """n material points of one branch under given shapes C̄ (n, 3, 3)."""

    def __init__(self, law, eta, n=1):
        self.points = Points.line(n)
        self.flow = MaxwellVariables(self.points, Maxwell(law, eta).slopes, eta)

    def step(self, dt, before, after):
        """S̄ (n, 3, 3) at the end of a step from one shape to another."""
        self.flow.begin(dt, six(before))
        self.flow.relax(six(after))
        self.flow.finish(six(after))
        return tensors(self.flow.stress)


def six(C):
    return np.array([C[:, i, j] for i, j in ENTRIES])


def run(law, eta, times, shapes):
    """S̄ (times, n, 3, 3) along shapes (times, n, 3, 3)."""
    sample = Sample(law, eta, shapes.shape[1])
    steps = zip(times, times[1:], shapes, shapes[1:], strict=False)
    return np.array([0 * shapes[0], *(sample.step(t1 - t0, C0, C1) for t0, t1, C0, C1 in steps)])


def sheared(gamma):
    F = np.tile(np.eye(3), (len(gamma), 1, 1))
    F[:, 0, 1] = gamma
    return F


def shapes(F):
    return (np.swapaxes(F, 1, 2) @ F)[:, None]


def independent(mu, alpha, eta, path, rate, end):
    """σ of an Ogden branch at `end` by Reese and Govindjee's equation in b_e, -½ (L_v b_e) b_e⁻¹ = τ/2η, with no C_v."""

    def kirchhoff(b):
        values, vectors = np.linalg.eigh(b)
        by_log = 2 * mu / alpha * values ** (alpha / 2)
        return vectors @ np.diag(by_log - by_log.mean()) @ vectors.T

    def change(t, y):
        b = y.reshape(3, 3)
        l = rate(t) @ np.linalg.inv(path(t))
        return (l @ b + b @ l.T - kirchhoff(b) @ b / eta).ravel()

    solved = solve_ivp(change, (0, end), np.eye(3).ravel(), rtol=1e-11, atol=1e-13, method="DOP853")
    return kirchhoff(solved.y[:, -1].reshape(3, 3))


@pytest.mark.parametrize(("alpha", "rotating"), [(2.0, True), (-18.0, False), (-18.0, True)])
def test_second_order_against_an_independent_integration(alpha, rotating):
    mu, eta, end = 1000.0, 800.0, 2.0

    def path(t):  # isochoric; with shear the axes of C turn against those of C_v
        s, g = 1 + 0.2 * np.sin(1.7 * t), 0.3 * np.sin(2.3 * t) * rotating
        return np.array([[s, g, 0], [0, s**-0.5, 0], [0, 0, s**-0.5]])

    def rate(t, h=1e-5):
        return (path(t + h) - path(t - h)) / (2 * h)

    exact = independent(mu, alpha, eta, path, rate, end)
    errors = []
    for n in (32, 64, 128):
        times = np.linspace(0, end, n + 1)
        F = np.array([path(t) for t in times])
        tau = F[-1] @ run(Ogden(mu, alpha), eta, times, shapes(F))[-1, 0] @ F[-1].T
        tau -= np.trace(tau) / 3 * np.eye(3)
        errors.append(np.linalg.norm(tau - exact) / np.linalg.norm(exact))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(rates - 2) < 0.15) and errors[-1] < 2e-3, (errors, rates)


@pytest.mark.parametrize("tau", [1e-3, 0.1, 1.0, 1e3])
def test_a_small_ramp_and_hold_is_exact_whatever_the_step(tau):
    mu, strain, times = 1000.0, 1e-5, np.array([0.0, 2.0, 3.0])
    S = run(NeoHooke(mu), mu * tau, times, shapes(sheared(strain * np.array([0.0, 1.0, 1.0]))))
    exact = strain * mu * tau / 2 * -np.expm1(-2 / tau) * np.array([1, np.exp(-1 / tau)])
    assert S[1:, 0, 0, 1] == pytest.approx(exact, rel=1e-8, abs=1e-14 * mu)


@pytest.mark.parametrize("law", [Ogden(900.0, -25.0), NeoHooke(900.0) + Ogden(100.0, 6.0), MooneyRivlin(200.0, 100.0)])
def test_sudden_and_slow_limits(law):
    F = sheared(np.array([0.0, 0.4]))
    fast, slow = (run(law, 1.0, np.array([0.0, dt]), shapes(F))[-1, 0] for dt in (1e-13, 1e9))
    C = ngs.CF(tuple((F[1].T @ F[1]).ravel()), dims=(3, 3)).MakeVariable()
    elastic = Points.line(1)((2 * law.energy(C)).Diff(C)).reshape(3, 3)
    tau = F[1] @ elastic @ F[1].T
    assert F[1] @ fast @ F[1].T == pytest.approx(tau - np.trace(tau) / 3 * np.eye(3), rel=1e-5, abs=1e-5)
    assert np.abs(slow).max() < 1e-5


def random_cycles(rng, cycles, steps):
    """Closed paths F(t) from rest and back, isochoric, (steps + 1, cycles, 3, 3)."""
    t = np.linspace(0, 1, steps + 1)[:, None, None, None]
    waves = sum(rng.normal(0, 0.2 / k, (1, cycles, 3, 3)) * np.sin(np.pi * k * t) for k in (1, 2, 3))
    F = np.eye(3) + waves
    return F / np.cbrt(np.linalg.det(F))[..., None, None]


def test_every_step_dissipates(rng):
    # The branch's energy W(e) falls by the flow alone: in the half step at the old shape, and in that at the new one.
    law, eta, steps = Ogden(1000.0, -15.0), 300.0, 40
    F = random_cycles(rng, 200, steps)
    C = np.swapaxes(F, 2, 3) @ F
    sample = Sample(law, eta, 200)

    def stored(A):
        values = np.linalg.eigvalsh(A)
        return 2 * 1000.0 / 15.0**2 * np.sum(values ** (-15.0 / 2) - 1, axis=1)

    def held(G, C):
        return stored(np.swapaxes(G, 1, 2) @ C @ G)

    for n in range(steps):
        before = held(sample.flow.G, C[n])
        sample.flow.begin(1.0 / steps * 10 ** rng.uniform(-2, 3), six(C[n]))
        G = sample.flow._step
        relaxed, pushed = held(G, C[n]), held(G, C[n + 1])
        sample.flow.finish(six(C[n + 1]))
        after_step = held(sample.flow.G, C[n + 1])
        scale = 1e-12 * (1 + before + pushed)
        assert np.all(relaxed <= before + scale) and np.all(after_step <= pushed + scale)


@pytest.mark.parametrize("dt", [1e-4, 1e-2, 1e3])
def test_flow_goes_downhill_from_any_state(dt, rng):
    # A stiff spring far from rest, its strains not along its stress: a step along the stress could end above its start.
    n = 2000
    sample = Sample(Ogden(1000.0, -25.0), 10.0, n)
    Q, _ = np.linalg.qr(rng.standard_normal((n, 3, 3)))
    logs = (rng.uniform(0, 0.3, n) * (PLANE.T @ rng.standard_normal((2, n)))).T
    sample.flow.G = (Q * np.exp(logs)[:, None, :]) @ np.swapaxes(Q, 1, 2)

    def stored(G):
        values = np.linalg.eigvalsh(np.swapaxes(G, 1, 2) @ G)
        return np.sum(values ** (-25.0 / 2) - 1, axis=1)

    before = stored(sample.flow.G)
    sample.flow.begin(dt, six(np.tile(np.eye(3), (n, 1, 1))))
    assert np.all(stored(sample.flow._step) <= before * (1 + 1e-10))


def test_closed_cycles_cost_work(rng):
    steps = 128
    F = random_cycles(rng, 300, steps)
    S = run(Ogden(1000.0, -8.0), 300.0, np.linspace(0, 1, steps + 1), np.swapaxes(F, 2, 3) @ F)
    dC = np.diff(np.swapaxes(F, 2, 3) @ F, axis=0)
    work = np.sum((S[1:] + S[:-1]) / 4 * dC, axis=(0, 2, 3))
    assert work.min() > 0


def test_turning_the_sample_turns_the_stress(rng):
    times = np.linspace(0, 1, 9)
    F = random_cycles(rng, 4, 8)
    Q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    C = np.swapaxes(F, 2, 3) @ F
    S, turned = (run(Ogden(1000.0, -12.0), 200.0, times, x)[-2] for x in (C, Q @ C @ Q.T))
    assert turned == pytest.approx(Q @ S @ Q.T, rel=1e-8, abs=1e-7)


def test_stress_and_stiffness_are_those_of_the_minimum(rng):
    # Against a search of its own for the least W(e) + κ|x - e|², in a step that does not begin at rest.
    from scipy.optimize import minimize

    mu, alpha, eta = 1000.0, -20.0, 500.0
    sample = Sample(Ogden(mu, alpha), eta)
    F = random_cycles(rng, 1, 4)
    C = np.swapaxes(F, 2, 3) @ F
    sample.step(0.5, C[0], C[1])
    sample.flow.begin(0.3, six(C[1]))
    kappa, G = sample.flow.kappa[0], sample.flow._step[0]

    def minimum(c):
        x = PLANE @ np.log(np.linalg.eigvalsh(G.T @ tensors(c[:, None])[0] @ G)[::-1]) / 2

        def value(e):
            return 2 * mu / alpha**2 * np.sum(np.exp(alpha * (PLANE.T @ e)) - 1) + kappa * np.sum((x - e) ** 2)

        return minimize(value, x / 2, method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-12}).fun

    def slope(c):  # by the six entries: a shear counts twice
        sample.flow.relax(c[:, None])
        return sample.flow.stress[:, 0] * [0.5, 0.5, 0.5, 1, 1, 1]

    c, dc = six(C[2])[:, 0], rng.standard_normal(6)
    slope(c)
    assert sample.flow.energy[0] == pytest.approx(minimum(c), rel=1e-9)
    D = sample.flow.stiffness()[0]
    assert np.all(np.abs(adjoint.check.taylor(minimum, slope(c), c, dc, steps=3, first=3e-3) - 2) < 0.1)
    assert np.abs(D - D.T).max() < 1e-9 * np.abs(D).max()
    rates = adjoint.check.taylor(slope, lambda d: D @ d, c, dc, first=3e-4)
    assert np.all(np.abs(rates - 2) < 0.1), rates


FLOWING = Viscous(Ogden(160.0, -25.0), (Maxwell(Ogden(970.0, -25.0), 2190.0), Maxwell(NeoHooke(250.0), 3e5)))


@pytest.mark.parametrize("mode", ["uniaxial", "equibiaxial", "planar", "shear"])
def test_laboratory_at_once_and_in_the_end(mode):
    stretch = 1.2 if mode != "shear" else 0.2
    stress = lab.relaxation(FLOWING, mode, stretch, [0.0, 1e11])
    ends = [lab.stress(law, mode, [stretch])[0] for law in (FLOWING.instantaneous, FLOWING.equilibrium)]
    assert stress == pytest.approx(ends, rel=1e-6)


def test_laboratory_relaxes_faster_at_larger_strain_and_hereditary_branches_do_not():
    # The overstress of a stiffening spring pushes its dashpot harder; a quasi-linear law has one curve for all strains.
    times = np.concatenate([[0.0], np.geomspace(0.02, 4, 120)])
    linear = Prony(Ogden(1000.0, -20.0), [0.7], [2.0])
    finite = Viscous(Ogden(300.0, -20.0), (Maxwell(Ogden(700.0, -20.0), 1400.0),))

    def relaxed(material, strain):
        stress = lab.relaxation(material, "uniaxial", 1 - strain, times)
        return stress[-1] / stress[0]

    assert relaxed(linear, 0.2) == pytest.approx(relaxed(linear, 0.01), rel=1e-3)
    assert relaxed(finite, 0.001) == pytest.approx(relaxed(linear, 0.001), rel=5e-3)
    assert relaxed(finite, 0.2) < 0.9 * relaxed(finite, 0.01)


def test_laboratory_creeps_to_equilibrium_and_back_to_the_same_stress():
    times = np.linspace(0, 4000, 401)
    stretches = lab.creep(FLOWING, "uniaxial", -60.0, times)
    assert lab.stress(FLOWING.instantaneous, "uniaxial", stretches[:1]) == pytest.approx([-60.0], rel=1e-6)
    assert np.all(np.diff(stretches) < 0)
    back = lab.history(FLOWING, "uniaxial", times, stretches)
    assert back == pytest.approx(np.full_like(back, -60.0), rel=1e-6)


def test_small_oscillations_have_the_fourier_image():
    omega, periods, steps = 2.0, 12, 200
    t = np.arange(periods * steps + 1) * 2 * np.pi / omega / steps
    material = Viscous(NeoHooke(300.0), (Maxwell(NeoHooke(700.0), 350.0),))
    last = lab.history(material, "shear", t, 1e-3 * np.sin(omega * t))[-steps:]
    G = 2 / steps * np.sum(last * np.exp(-1j * omega * t[-steps:])) * 1j / 1e-3
    assert pytest.approx(fourier(material)(omega), rel=1e-3) == G


def test_fibres_beside_branches_choose_their_transverse_strains():
    material = FLOWING + HolzapfelGasserOgden(100.0, 500.0, 5.0, 0.0, (1, 1, 0))
    end = lab.relaxation(material, "uniaxial", 1.1, [0.0, 1e11])[-1]
    assert end == pytest.approx(lab.stress(material.equilibrium, "uniaxial", [1.1])[0], rel=1e-5)


def test_refuses():
    with pytest.raises(InputError, match=r"Maxwell\.eta is -1.0"):
        Maxwell(NeoHooke(1.0), -1.0)
    fibres = HolzapfelGasserOgden(1.0, 5.0, 2.0, 0.1, (1, 0, 0))
    for law in (fibres, NeoHooke(1.0) + fibres):
        with pytest.raises(InputError, match=r"Maxwell\.law is .* wanted: an isotropic law"):
            Maxwell(law, 1.0)
    assert Maxwell(HolzapfelGasserOgden(1.0, 5.0, 2.0, 1 / 3, (1, 0, 0)), 1.0).eta == 1.0
