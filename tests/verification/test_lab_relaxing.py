"""The laboratory's relaxing half against closed forms: steps, ramps, sines, creep, closed cycles, G*."""

import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.errors import InputError
from ngbrain.materials import Branch, Demiray, MooneyRivlin, NeoHooke, Ogden, Prony, Viscous, Yeoh, constants, lab

# Published constants are taken as far as formulas hold.
pytestmark = pytest.mark.filterwarnings("ignore::ngbrain.errors.RangeWarning")

MODES = ["uniaxial", "equibiaxial", "planar", "shear"]
SMALL = 1e-7
"""A shear whose squares vanish in double precision: stress is linear in it."""
G, TAU = np.array([0.45, 0.365]), np.array([0.5, 50.0])
MILLER = Prony(Ogden(842.0, -4.7), list(G), list(TAU))
OWN = Viscous(Ogden(420.0, -21.27), (Branch(Ogden(1400.0, -14.66), 2.2), Branch(Ogden(560.0, -23.76), 517.0)))


def stretch(mode, size):
    return size if mode == "shear" else 1 + size


def relaxing(t):
    """G(t)/G₀ of `MILLER`."""
    return 1 - G.sum() + np.exp(-np.asarray(t)[..., None] / TAU) @ G


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("size", [-0.15, 0.02, 0.3])
def test_a_step_scales_the_elastic_stress_at_any_strain(mode, size):
    times = np.array([0.0, 1e-3, 0.1, 7.0, 300.0])
    wanted = lab.stress(MILLER.instantaneous, mode, stretch(mode, size)) * relaxing(times)
    assert np.allclose(lab.relaxation(MILLER, mode, stretch(mode, size), times), wanted, rtol=1e-12)


@pytest.mark.parametrize("tau", [1e-3, 1e-1, 1.0, 30.0, 1e3])
def test_ramp_and_hold_is_exact_at_one_step_length_for_all_times_of_relaxation(tau):
    times, t0, mu, g = np.arange(0, 61) * 0.1, 2.0, 900.0, 0.7
    got = lab.history(Prony(NeoHooke(mu), [g], [tau]), "shear", times, SMALL * np.minimum(times / t0, 1))
    ramp = g * tau * -np.expm1(-np.minimum(times, t0) / tau) * np.exp(-np.maximum(times - t0, 0) / tau)
    wanted = mu * SMALL / t0 * ((1 - g) * np.minimum(times, t0) + ramp)
    assert np.allclose(got, wanted, rtol=1e-12, atol=0)


def test_a_ramp_before_the_hold():
    t0, times = 2.0, np.array([0.5, 2.0, 3.0, 20.0])
    wanted = np.minimum(times, t0) * 0.5 + 0.5 * 3.0 * -np.expm1(-np.minimum(times, t0) / 3.0) * np.exp(
        -np.maximum(times - t0, 0) / 3.0
    )
    got = lab.relaxation(Prony(NeoHooke(1.0), [0.5], [3.0]), "shear", SMALL, times, rise=t0)
    assert np.allclose(got, SMALL / t0 * wanted, rtol=1e-12)


def test_a_sine_from_rest_is_second_order():
    tau, g, w, T = 0.2, 0.6, 3.0, 4.0
    x = w * tau
    q = x / (1 + x**2) * (np.cos(w * T) + x * np.sin(w * T) - np.exp(-T / tau))
    wanted = (1 - g) * np.sin(w * T) + g * q
    errors = []
    for n in (16, 32, 64, 128):
        times = np.linspace(0, T, int(T * n) + 1)
        got = lab.history(Prony(NeoHooke(1.0), [g], [tau]), "shear", times, SMALL * np.sin(w * times))[-1]
        errors.append(abs(got / SMALL - wanted))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(rates - 2) < 0.05) and errors[-1] < 2.2e-5, (rates, errors)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("material", [MILLER, OWN], ids=["one law", "many"])
def test_second_order_at_finite_strain(material, mode):
    last = []
    for n in (20, 40, 80, 160, 2560):
        times = np.linspace(0, 3, n + 1)
        last.append(lab.history(material, mode, times, stretch(mode, 0.2 * np.sin(times) ** 2))[-1])
    errors = np.abs(np.array(last[:-1]) / last[-1] - 1)
    rates = np.log2(errors[:-1] / errors[1:])
    assert np.all(rates >= 1.9), (rates, errors)


@pytest.mark.parametrize("mode", MODES)
def test_fast_is_instantaneous_and_slow_is_equilibrium(mode):
    material = constants("griffiths2024:white_matter").law()
    s = stretch(mode, np.linspace(0, 0.2, 5))
    fast, slow = (lab.history(material, mode, T * np.linspace(0, 1, 5), s) for T in (1e-13, 1e12))
    assert np.allclose(fast, lab.stress(material.instantaneous, mode, s), rtol=1e-8, atol=1e-6)
    assert np.allclose(slow, lab.stress(material.equilibrium, mode, s), rtol=1e-6, atol=1e-6)


def test_normalised_relaxation_of_a_quasi_linear_law_does_not_know_the_strain():
    times = np.geomspace(1e-2, 200, 12)
    times[0] = 0.0
    uneven = Viscous(Ogden(300.0, -20.0), (Branch(Ogden(600.0, -5.0), 1.0),))

    def curves(material):
        answers = np.array([lab.relaxation(material, "uniaxial", 1 + e, times) for e in (0.01, 0.05, 0.10, 0.20)])
        return answers / answers[:, :1]

    assert np.ptp(curves(MILLER), axis=0).max() < 1e-12
    assert np.ptp(curves(uneven), axis=0).max() > 0.05  # branches of another shape do


CYCLED = {
    "Neo-Hooke": Prony(NeoHooke(842.0), [0.45, 0.365], [0.5, 50.0]),
    "Mooney-Rivlin": Prony(MooneyRivlin(200.0, 220.0), [0.9], [0.3]),
    "Ogden": MILLER,
    "laws of their own": OWN,
    "Demiray": Viscous(Demiray(300.0, 3.0), (Branch(Yeoh(200.0, 100.0), 0.2), Branch(NeoHooke(500.0), 2.0))),
}


def closed_cycles(rng, count, steps):
    """Smooth histories from 0 to 0 within ±20 %, of 1 to 5 waves each: shape (count, steps + 1)."""
    t = np.linspace(0, 1, steps + 1)
    waves = np.sin(np.pi * np.arange(1, 6)[:, None] * t)
    h = (rng.standard_normal((count, 5)) * rng.random((count, 5)) ** 2) @ waves
    return 0.2 * rng.random((count, 1)) * h / np.abs(h).max(axis=1, keepdims=True)


def work(material, mode, duration, strain, every=1):
    """∮ P dλ by the trapezoidal rule: of λ₁ only, so twice that in the equibiaxial test."""
    s = stretch(mode, strain[:, ::every])
    P = lab.history(material, mode, duration * np.linspace(0, 1, s.shape[1]), s)
    return np.sum((P[:, 1:] + P[:, :-1]) / 2 * np.diff(s), axis=1), np.abs(P).max(axis=1) * np.abs(np.diff(s)).sum(
        axis=1
    )


def gives_no_work(material, mode, duration, strain):
    fine, scale = work(material, mode, duration, strain)
    coarse, _ = work(material, mode, duration, strain, every=2)  # its quadrature error: three times that of fine
    assert np.all(fine > 0) and np.all(np.abs(coarse - fine) < 0.01 * scale), (mode, duration, (fine / scale).min())


DURATIONS = (0.1, 2.0, 40.0, 2000.0)


@pytest.mark.parametrize("name", CYCLED)
def test_no_closed_cycle_gives_work(name, rng):
    for mode in MODES:
        for duration in DURATIONS:
            gives_no_work(CYCLED[name], mode, duration, closed_cycles(rng, 63, 128))  # 63 × 4 × 4 = 1008 cycles


@pytest.mark.parametrize(("mode", "duration"), list(zip(MODES, DURATIONS, strict=True)))
def test_no_closed_cycle_of_maxwell_branches_gives_work(mode, duration, rng):
    """Fewer of them: they are marched through step by step."""
    material = constants("griffiths2024:white_matter").law()
    gives_no_work(material, mode, duration, closed_cycles(rng, 32, 128))


def test_storage_and_loss():
    w = np.geomspace(1e-3, 1e3, 13)
    x = w[:, None] * TAU
    wanted = 842.0 * (1 - G.sum() + (G * x**2 / (1 + x**2)).sum(axis=1) + 1j * (G * x / (1 + x**2)).sum(axis=1))
    got = lab.storage_loss(MILLER, w)
    assert np.allclose(got, wanted, rtol=1e-9) and np.all(got.imag > 0)
    assert lab.storage_loss(MILLER, 0.0) == pytest.approx(842.0 * 0.185, rel=1e-9)


def test_small_oscillations_in_time_give_g_star():
    w, n, turns = 2.0, 400, 12
    material = Prony(NeoHooke(1.0), [0.7], [0.4])
    times = np.arange(turns * n + 1) * 2 * np.pi / w / n
    last = lab.history(material, "shear", times, SMALL * np.sin(w * times))[-n:] / SMALL
    steady = 2j * np.mean(last * np.exp(-1j * w * times[-n:]))
    assert steady == pytest.approx(complex(lab.storage_loss(material, w)), rel=1e-4)


def test_creep_of_the_standard_linear_solid():
    E0, g, tau, stress = 3000.0, 0.6, 2.0, 1e-4  # E = 3 μ
    Einf = (1 - g) * E0
    errors = []
    for n in (100, 200, 400):
        times = np.linspace(0, 20, n + 1)
        strain = lab.creep(Prony(NeoHooke(E0 / 3), [g], [tau]), "uniaxial", stress, times) - 1
        wanted = stress * (1 / Einf - (1 / Einf - 1 / E0) * np.exp(-times * Einf / (tau * E0)))
        assert strain[0] == pytest.approx(wanted[0], rel=1e-6)
        errors.append(np.abs(strain / wanted - 1).max())
    assert errors[-1] < 2e-5 and np.all(np.log2(np.array(errors[:-1]) / errors[1:]) > 1.9)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("stress", [-150.0, 150.0])
def test_the_stretch_of_creep_gives_the_stress_back(mode, stress):
    times = np.concatenate([[0.0], np.geomspace(1e-2, 500, 60)])
    stretches = lab.creep(MILLER, mode, stress, times)
    assert np.allclose(lab.history(MILLER, mode, times, stretches), stress, rtol=1e-6)
    size = np.abs(stretches - stretch(mode, 0.0))
    assert np.all(np.diff(size) > 0) and size[-1] > 0.1


@pytest.mark.parametrize("stress", [-20e3, 10e3])
def test_creep_under_a_load_whose_first_newton_step_leaves_all_sense(stress):
    """The small-strain answer to the load, λ - 1 = P/3μ, is -8 or 4."""
    (found,) = lab.creep(MILLER, "uniaxial", stress, [0.0])
    assert lab.stress(MILLER.instantaneous, "uniaxial", found) == pytest.approx(stress, rel=1e-8)
    assert (found > 1) == (stress > 0)


def let_go(g, tau, held, since):
    """Strain of the standard linear solid under no stress, `since` a unit strain of length `held` ended."""
    return g * -np.expm1(-held / tau) * np.exp(-np.asarray(since) * (1 - g) / tau)


@pytest.mark.parametrize("mode", ["uniaxial", "planar"])
def test_a_body_let_go_recovers_by_itself_and_is_met_again_where_it_is(mode):
    E0, g, tau, held, e = 3000.0 if mode == "uniaxial" else 4000.0, 0.6, 2.0, 3.0, 1e-5
    free = np.linspace(0, 4, 401)[1:]
    times = np.concatenate([[0.0, held], held + 1e-9 * np.arange(1, 3), held + free, [held + 4 + 1e-9]])
    again = 0.5 * e
    plate = 1 - np.concatenate([[e, e, 0, 0], np.full(400, -e), [again]])
    stretch, stress = lab.press(Prony(NeoHooke(1000.0), [g], [tau]), mode, times, plate)
    strain = (1 - stretch) / e
    assert np.allclose(strain[4:-1], let_go(g, tau, held, free), rtol=2e-5) and np.all(stress[2:-1] == 0)
    flowed = let_go(g, tau, held, 4.0) / g  # of the dashpot
    assert stress[1] / (-E0 * e) == pytest.approx(1 - g + g * np.exp(-held / tau), rel=1e-4)
    assert stress[-1] / (-E0 * e) == pytest.approx(0.5 - g * flowed, rel=1e-3) and strain[-1] == pytest.approx(0.5)


@pytest.mark.parametrize("name", ["miller2002:brain", "griffiths2024:white_matter"])
def test_a_plate_that_stays_is_a_history(name):
    material, times = constants(name).law(), np.concatenate([np.linspace(0, 2, 9), [5.0, 20.0, 100.0]])
    stretches = 1 - np.outer([0.02, 0.15], np.minimum(times / 2, 1))
    for mode in ("uniaxial", "equibiaxial", "planar"):
        found, stress = lab.press(material, mode, times, stretches)
        wanted = lab.history(material, mode, times, stretches)
        assert np.array_equal(found, stretches) and np.allclose(stress, wanted, rtol=1e-5, atol=1e-4)


def test_plates_of_many_histories_are_those_of_each():
    times = np.concatenate([np.linspace(0, 1, 6), [3.0, 3.1, 4.0, 4.2, 6.0]])
    ramp = np.linspace(0, 1, 6)
    goes, stays = np.concatenate([ramp, [1, 0, -1, 0.3, 0.8]]), np.concatenate([ramp, np.ones(5)])
    plates = 1 - np.array([0.05 * goes, 0.15 * goes, 0.1 * stays])
    together = lab.press(OWN, "planar", times, plates)
    alone = [lab.press(OWN, "planar", times, row) for row in plates]
    assert np.allclose(together, np.swapaxes(alone, 0, 1), rtol=1e-7, atol=1e-6)


def test_creep_under_a_load_that_goes():
    E0, g, tau, load, held = 3000.0, 0.6, 2.0, 1e-4, 5.0
    times = np.concatenate([np.linspace(0, held, 801), held + 1e-9 + np.linspace(0, 5, 801)])
    strain = lab.creep(Prony(NeoHooke(E0 / 3), [g], [tau]), "uniaxial", np.where(times <= held, load, 0.0), times) - 1
    slow = (1 - g) / tau

    def compliance(t):
        return 1 / (E0 * (1 - g)) - (1 / (E0 * (1 - g)) - 1 / E0) * np.exp(-t * slow)

    wanted = load * (compliance(times) - np.where(times > held, compliance(np.maximum(times - held, 0)), 0.0))
    assert np.allclose(strain[1:], wanted[1:], rtol=1e-4, atol=1e-13)


class Fibres:
    """Oblique fibres: the symmetric state is no equilibrium."""

    def energy(self, C):
        a = ngs.CF((np.sqrt(0.5), np.sqrt(0.5), 0))
        return 500 * (ngs.Trace(C) - 3) + 400 * (ngs.InnerProduct(a, C * a) - 1) ** 2


@pytest.mark.parametrize("mode", MODES)
def test_oblique_fibres_relax_between_their_limits(mode):
    material = Prony(Fibres(), [0.6], [1.0])
    s = stretch(mode, np.array([0.0, 0.1, 0.2, 0.2, 0.2]))
    fast = lab.history(material, mode, 1e-9 * np.arange(5), s)
    slow = lab.history(material, mode, 1e9 * np.arange(5), s)
    assert np.allclose(fast, lab.stress(material.instantaneous, mode, s), rtol=1e-6, atol=1e-6)
    assert np.allclose(slow, lab.stress(material.equilibrium, mode, s), rtol=1e-6, atol=1e-6)
    # A quasi-linear law under a step keeps its shape, so the elastic stress is scaled here too.
    held = lab.relaxation(material, mode, s[-1], [0.0, 0.5, 4.0])
    assert np.allclose(held, fast[-1] * (0.4 + 0.6 * np.exp(-np.array([0.0, 0.5, 4.0]))), rtol=1e-6)


def test_many_histories_at_once_are_the_same_as_one_by_one(rng):
    times = np.cumsum(rng.random(20)) - 0.0
    times -= times[0]
    strain = 0.1 * rng.standard_normal((3, 20))
    together = lab.history(MILLER, "shear", times, strain)
    assert np.allclose(together, [lab.history(MILLER, "shear", times, row) for row in strain], rtol=1e-12)


def test_a_branch_of_another_kind_brings_its_own_overstress():
    class Dashpot(Branch):
        def overstress(self, points, C, times):
            return 2 * super().overstress(points, C, times)

    law, times = NeoHooke(1.0), [0.0, 1.0, 2.0]
    one, two = (Viscous(law, (kind(law, 3.0),)) for kind in (Branch, Dashpot))
    stay = lab.stress(law, "shear", 0.2)
    extra = [lab.relaxation(material, "shear", 0.2, times) - stay for material in (one, two)]
    assert np.allclose(extra[1], 2 * extra[0])


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: lab.history(NeoHooke(1.0), "shear", [0, 1], [0, 0]), "material is NeoHooke.*viscoelastic"),
        (lambda: lab.history(MILLER, "shear", [0, 1, 1], [0, 0, 0]), "times is .*increasing order, from 0 on"),
        (lambda: lab.history(MILLER, "shear", [0.5, 1], [0, 0]), "from 0 on"),
        (lambda: lab.history(MILLER, "shear", [0, 1], [0, 0, 0]), r"stretches is of shape \(3,\); wanted: \(2,\)"),
        (lambda: lab.history(MILLER, "uniaxial", [0, 1], [1, -1]), "stretches is -1"),
        (lambda: lab.history(Prony(NeoHooke(ngs.x), [0.1], [1.0]), "shear", [0, 1], [0, 0]), "varies in space"),
        (lambda: lab.history(Viscous(NeoHooke(1.0), (Branch(NeoHooke(1.0), ngs.x),)), "shear", [0], [0]), "tau is"),
        (lambda: lab.relaxation(MILLER, "shear", 0.1, [1.0], rise=-1.0), "rise is -1"),
        (lambda: lab.relaxation(MILLER, "shear", 0.1, [-1.0]), "from 0 or later on"),
        (lambda: lab.creep(MILLER, "shear", np.inf, [0.0]), "stress is inf"),
        (lambda: lab.creep(MILLER, "shear", [1.0, 2.0], [0.0]), "stress is .*one for each time"),
        (lambda: lab.press(MILLER, "shear", [0.0], [0.0]), "mode is 'shear'; wanted: a compression test"),
        (lambda: lab.press(MILLER, "planar", [0.0], [1.0, 1.0]), r"stretches is of shape \(2,\)"),
        (lambda: lab.storage_loss(MILLER, -1.0), "omega is -1"),
        (lambda: lab.storage_loss(NeoHooke(1.0), 1.0), "material is NeoHooke"),
    ],
)
def test_refuses(call, says):
    with pytest.raises(InputError, match=says):
        call()
