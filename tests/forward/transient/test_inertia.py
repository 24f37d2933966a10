"""The generalised-α method by itself, and in a body: energy, tangent, restart, rejected steps, steps by their error, bad input."""

import ngsolve as ngs
import numpy as np
import pytest
from free_vibration import LENGTH, RADIUS, Undriven, bar, even, swing, turned, twist
from plate_contact import PRESS, Failing, run

from ngbrain.adjoint.check import taylor
from ngbrain.errors import InputError
from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.inertia import GeneralizedAlpha, Inertia, MotionRates
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.step_control import ErrorControl, StepControl
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.io import QuadraticGrid, load, save
from ngbrain.materials import Branch, Maxwell, NeoHooke, Ogden, Viscous
from ngbrain.mesh import block

RADII = (0.0, 0.5, 0.8, 1.0)
HEREDITARY = Viscous(Ogden(300.0, -12.0), (Branch(Ogden(700.0, -15.0), 0.03), Branch(NeoHooke(500.0), 2.0)))
SOFT = {".*": Material(NeoHooke(1e3), 1e6)}
FLOWING = Viscous(Ogden(300.0, -12.0), (Maxwell(Ogden(700.0, -15.0), 21.0),))


# The scheme: ü = -ω² u.


def stepped(scheme, u, pace, dt):
    """u and its pace a step further; ω = 1."""
    step = scheme.begin(u, pace, dt)
    c = scheme.weight(dt)
    u = c * step.target / (c + 1)
    return u, step.end(u)


def of_steps(scheme, h):
    """The matrix that takes (u, h v, h² a) a step further."""
    u, v, a = np.eye(3)
    u, pace = stepped(scheme, u, MotionRates(v / h, -u, a / h**2, h), h)
    return np.array([u, h * pace.velocity, h**2 * pace.average])


def recursion(radius, h):
    """The same of the three equations of Chung and Hulbert 1993 as they stand there."""
    am, af = (2 * radius - 1) / (radius + 1), radius / (radius + 1)
    gamma, beta = 0.5 - am + af, (1 - am + af) ** 2 / 4
    after = np.array([[1, 0, -beta], [0, 1, -gamma], [h**2 * (1 - af), 0, 1 - am]])
    before = np.array([[1, 1, 0.5 - beta], [0, 1, 1 - gamma], [-(h**2) * af, 0, -am]])
    return np.linalg.solve(after, before)


@pytest.mark.parametrize("radius", RADII)
@pytest.mark.parametrize("h", [0.1, 2.0, 50.0])
def test_steps_are_those_of_the_published_recursion(radius, h):
    assert of_steps(GeneralizedAlpha(radius), h) == pytest.approx(recursion(radius, h), rel=1e-10, abs=1e-10 * h**2)


@pytest.mark.parametrize("radius", RADII)
def test_the_spectral_radius_is_at_most_one_and_the_given_one_in_the_end(radius):
    scheme = GeneralizedAlpha(radius)
    radii = [np.max(np.abs(np.linalg.eigvals(of_steps(scheme, h)))) for h in np.logspace(-2, 5, 29)]
    assert max(radii) < 1 + 1e-6 and radii[-1] == pytest.approx(radius, abs=1e-3)


@pytest.mark.parametrize("radius", RADII)
@pytest.mark.parametrize("lengths", [(1.0, 1.0), (1.5, 0.5)], ids=["even", "uneven"])
def test_order_two_with_even_and_uneven_steps(radius, lengths):
    errors = []
    for n in (64, 128, 256):
        u, a = np.array([1.0]), np.array([-1.0])
        pace = MotionRates(0 * u, a, a, 0.0)
        for dt in np.tile(lengths, n // 2) * 2.0 / n:
            u, pace = stepped(GeneralizedAlpha(radius), u, pace, dt)
        errors.append(np.hypot(u[0] - np.cos(2.0), pace.velocity[0] + np.sin(2.0)))
    rates = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert errors[0] < 1e-2 and np.all(np.abs(rates - 2) < 0.1), (errors, rates)


@pytest.mark.parametrize("radius", RADII)
def test_the_error_of_a_step_is_what_it_misses(radius):
    scheme, t = GeneralizedAlpha(radius), 0.7
    for h, close in ((0.1, 0.2), (0.01, 0.02)):
        late = t + (scheme.alpha_m - scheme.alpha_f) * h  # the time that the average acceleration belongs to
        exact = MotionRates(np.array([np.cos(t)]), np.array([-np.sin(t)]), np.array([-np.sin(late)]), h)
        u = np.array([np.sin(t)])
        end, _ = stepped(scheme, u, exact, h)
        assert scheme.begin(u, exact, h).error(end)[0] == pytest.approx(end[0] - np.sin(t + h), rel=close)


@pytest.mark.parametrize("radius", [-0.1, 1.1, float("nan"), "1"])
def test_bad_radius(radius):
    with pytest.raises(InputError, match=r"GeneralizedAlpha\.radius"):
        GeneralizedAlpha(radius)


# The body.


def made(law=HEREDITARY, bulk=1.5e6, radius=0.8, contacts=(), density=1000.0, fixed="bottom", **more):
    mesh = block((0.02, 0.02, 0.02), 0.02)
    mass = Inertia({"tissue": density}, GeneralizedAlpha(radius), **more)
    supports = {fixed: 0} if fixed else {}
    return Problem(mesh, {"tissue": Material(law, bulk)}, supports, [mass], contacts, element="P2/P1")


@pytest.fixture
def moving(plate, rng):
    """A relaxing body under a plate after a step at speed, in another step, and a state that is neither small nor special."""
    drive = plate((0, 1), (0, 1e-3))
    body = made(contacts=[drive.contact(1e6)], density=1000 + 2e4 * ngs.x)
    size = np.where(body.is_u, 2e-4, 50.0) * (body.weights > 0)
    body.start((0.1 * ngs.z, 0, 0.05 * ngs.z))
    body.begin(0.01)
    body.residual(np.where(body.is_u, 1e-4, 20.0) * rng.standard_normal(body.fes.ndof) * (body.weights > 0))
    body.finish()
    drive.set(1.0)
    body.begin(0.003)
    x, dx = (size * rng.standard_normal(body.fes.ndof) for _ in range(2))
    return body, x, dx


def test_residual_is_the_gradient_of_the_energy(moving):
    body, x, dx = moving

    def energy(y):
        body.x = y
        return body.form.Energy(body.gfu.vec)

    rates = taylor(energy, body.residual(x)[0], x, dx)
    assert np.all(np.abs(rates - 2) < 0.1), rates


def test_tangent_is_the_derivative_of_the_residual(moving):
    body, x, dx = moving
    solve = body.factorise(x)
    body.form.AssembleLinearization(body.gfu.vec)
    direction, product = body.gfu.vec.CreateVector(), body.gfu.vec.CreateVector()
    direction.FV().NumPy()[:] = dx
    product.data = body.form.mat * direction
    slope = product.FV().NumPy() * (body.weights > 0)
    rates = taylor(lambda y: body.residual(y)[0], lambda _: slope, x, dx)
    assert np.all(np.abs(rates - 2) < 0.1), rates
    assert solve(slope) == pytest.approx(dx, rel=1e-6, abs=1e-7 * np.abs(dx).max())


def test_a_part_renewed_knows_the_length_of_the_step(moving):
    body, x, dx = moving
    body.focus(np.ones(body.mesh.ne, bool))
    body.begin(0.01)
    body.factorise(x)
    body.begin(0.003)
    r = dx * (body.weights > 0)
    part, exact = body.refactorise(x)(r), body.factorise(x)(r)
    assert part == pytest.approx(exact, rel=1e-7, abs=1e-9 * np.abs(exact).max())


def test_a_step_balances_mean_forces_with_the_mean_acceleration():
    """As Chung and Hulbert wrote it: forces of two states, weighted, beside M times accelerations."""
    body = made(radius=0.6)
    body.start((0.5 * ngs.z, 0, 0))
    forces, means, mass = [], [], []
    density = ngs.GridFunction(body.fes.components[0])

    def look(b):
        forces.append(b.tissue_forces())
        means.append(b.inertia.pace.average)
        return []

    swing(body, 0.02, even(0.004), look)
    s, free = body.inertia.scheme, body.weights[body.is_u] > 0
    u, v = density.space.TnT()
    mass = ngs.BilinearForm(1000 * u * v * ngs.dx).Assemble().mat
    for n in range(1, len(forces)):
        density.vec.FV().NumPy()[:] = (1 - s.alpha_m) * means[n] + s.alpha_m * means[n - 1]
        inertia = (mass * density.vec).Evaluate().FV().NumPy()
        off = inertia + (1 - s.alpha_f) * forces[n] + s.alpha_f * forces[n - 1]
        assert np.abs(off[free]).max() < 1e-5 * np.abs(inertia[free]).max()


def test_an_accelerated_start_balances_the_forces():
    body = made(NeoHooke(1e3), bulk=1e4)
    body.u.Set(ngs.CF((0.1 * ngs.z, 0, 0)))
    body.start((0, 0, 0))
    moved = body.inertia.pace.acceleration
    energy = body.form.Energy(body.gfu.vec)
    dt = 1e-5
    body.begin(dt)
    body.u.vec.FV().NumPy()[:] += 0.5 * dt**2 * moved
    body.inertia._weight.Set(0.0)
    change = (body.form.Energy(body.gfu.vec) - energy) / dt**2
    body.inertia.pace = MotionRates(dt * moved, moved, moved, dt)  # its speed by then
    assert change * dt**2 == pytest.approx(-body.kinetic_energy(), rel=1e-3)


def test_kinetic_energy_of_a_known_velocity():
    body = made(density=1000 + 5e4 * ngs.z)
    body.start((0.3 * ngs.z, -0.1 * ngs.z, 0))
    L = 0.02
    assert body.kinetic_energy() == pytest.approx(0.05 * L**2 * (1000 * L**3 / 3 + 5e4 * L**4 / 4), rel=1e-9)


# In time steps.


def pressed(plate, law=HEREDITARY, ramp=4.0, control=None, **more):
    """A plate's force (N) over time as it presses, holds and leaves, and where the run stands."""
    drive = plate(np.array(PRESS[0]) * ramp / 4, PRESS[1])
    return run(made(law, contacts=[drive.contact()], **more), drive, control or StepControl(ramp / 4, dt_max=10.0))


def test_without_mass_and_slowly_it_is_the_quasi_static_answer(make_body, plate):
    law = Viscous(NeoHooke(300.0), (Branch(NeoHooke(700.0), 3.0),))
    drive = plate(*PRESS)
    quasi, rows = run(make_body(law, [drive.contact()]), drive, StepControl(1.0, dt_max=10.0))
    for density, radius, close in ((1e-6, 0.8, 1e-8), (1000.0, 0.0, 1e-3)):
        transient, found = pressed(plate, law, density=density, radius=radius)
        assert np.abs(found - rows)[:, :2].max() < close * rows[:, 1].max(), density
        assert transient.progress.newton < 1.1 * quasi.progress.newton
    fast, slow = (pressed(plate, law, ramp=ramp, density=1000.0, radius=0.0)[1][:, 1].max() for ramp in (0.02, 4.0))
    assert fast > 1.5 * slow  # it does have mass


def test_from_a_millisecond_to_an_hour_in_one_run(make_body, plate):
    law = Viscous(Ogden(300.0, -12.0), (Branch(Ogden(700.0, -15.0), 3.0), Branch(NeoHooke(500.0), 0.02)))
    way = ((0, 0.4, 3600), (0, 2e-3, 2e-3))
    control = ErrorControl(1e-2, touch=1e-3, shortest=1e-6)
    drive = plate(*way)
    quasi, rest = run(make_body(law, [drive.contact()]), drive, control)
    drive = plate(*way)
    moving, rows = run(made(law, contacts=[drive.contact()], radius=0.0), drive, control)
    lengths = np.diff(rows[:, 0])
    assert lengths.min() < 1.1e-3 and lengths.max() > 100 and moving.progress.steps < 10 * quasi.progress.steps
    assert rows[-1, 1] == pytest.approx(rest[-1, 1], rel=1e-5)


CONTROLS = {"even": StepControl(0.01, dt_max=0.01), "by error": ErrorControl(0.1, touch=2e-3, shortest=1e-5)}


@pytest.mark.one_thread
@pytest.mark.parametrize(("law", "control"), [(HEREDITARY, "by error"), (FLOWING, "even")])
def test_restart_goes_on_with_the_same_bits(law, control, plate, tmp_path):
    def begun():
        drive = plate((0, 0.05, 0.1), (0, 2e-3, 2e-3))
        body = made(law, contacts=[drive.contact(1e6)], radius=0.5)
        return TimeStepper(body, drive, CONTROLS[control], 1e-3)

    whole, half, other = begun(), begun(), begun()
    whole.run(lambda *_: None)
    half.run(lambda *_: None, until=0.06)
    assert np.abs(half.problem.inertia.pace.velocity).max() > 1e-3 and half.checkpoint()["factors"]
    save(tmp_path / "run.vtkhdf", QuadraticGrid(half.problem.mesh), [], half.checkpoint())
    saved = load(tmp_path / "run.vtkhdf").state
    other.restore(saved)
    np.testing.assert_equal(other.checkpoint(), half.checkpoint())
    other.run(lambda *_: None)
    assert np.array_equal(other.problem.x, whole.problem.x) and other.progress.steps == whole.progress.steps
    assert all(
        np.array_equal(value, getattr(whole.problem.inertia.pace, name))
        for name, value in vars(other.problem.inertia.pace).items()
    )


def test_a_rejected_step_leaves_the_pace_as_it_was():
    ends = []
    for refused, dt in (((0,), 0.006), ((), 0.002)):
        body = made(NeoHooke(1e3), bulk=1e5)
        body.start((0.5 * ngs.z, 0, 0))
        transient = TimeStepper(body, Undriven(1.0), even(dt), 1.0, Failing(at=refused))
        transient.step()
        assert transient.progress.dt == pytest.approx(0.002) and transient.progress.rejected == len(refused)
        ends.append(np.concatenate([body.x[body.is_u] / 1e-3, body.inertia.pace.velocity / 0.01]))
    assert ends[0] == pytest.approx(ends[1], rel=1e-6, abs=1e-6 * np.abs(ends[1]).max())


@pytest.mark.slow
def test_steps_by_the_error_of_inertia():
    """Of a harmonic swing the steps are 0.9 (tolerance/C)^⅓/ω where its acceleration changes most."""
    omega = np.pi / 2 / LENGTH  # wave speed 1 m/s
    scheme, angle = GeneralizedAlpha(0.8), 1e-2
    constant = scheme.beta + (scheme.alpha_m - scheme.alpha_f) / 2 - 1 / 6
    errors, numbers = [], []
    for tolerance in (1e-2, 1e-2 / 8):
        body = Problem(
            bar(), SOFT, {"bottom": 0}, [Inertia({".*": 1e3}, scheme, amplitude=angle * RADIUS)], element="P2/P1"
        )
        body.start(twist(angle * omega))
        control = ErrorControl(tolerance, touch=0.05 / omega, shortest=1e-5)
        _, rows = swing(body, 2 * np.pi / omega, control, lambda b: [turned(b)])
        t, found = rows.T
        least = np.diff(t)[t[1:] > np.pi / omega][:-2].min() * omega  # the last two meet the end
        assert least == pytest.approx(0.9 * (tolerance / constant) ** (1 / 3), rel=0.25)
        errors.append(np.abs(found / angle - np.sin(omega * t)).max())
        numbers.append(len(t))
    assert errors[0] < 0.2 and errors[1] < errors[0] / 4 and numbers[1] < 2.6 * numbers[0], (errors, numbers)


@pytest.mark.parametrize(
    ("density", "name"),
    [
        ({"bone": 1e3}, "density region"),
        ({"tissue": 1e3, ".*": 1e3}, "has a density already"),
        ({}, "density is not given for tissue"),
        ({"tissue": -1.0}, "density of tissue"),
    ],
)
def test_bad_density(density, name):
    with pytest.raises(InputError, match=name):
        Problem(block(maxh=0.04), SOFT, {"bottom": 0}, [Inertia(density, GeneralizedAlpha(0.8))], element="P2/P1")
