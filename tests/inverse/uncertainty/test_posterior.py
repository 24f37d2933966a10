"""Posterior: closed forms of linear problems, error of the low-rank truncation, intervals against the exact posterior of waves."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from equilibria import model
from inversions import MODULUS, scatter, square
from prior_phantoms import settled

from ngbrain.adjoint.check import taylor
from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import InputError
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.parameters import LogTransform, ParameterFields, ScaledTransform, Unknown
from ngbrain.inverse.objective.regularisation import QuadraticRegulariser, ridge
from ngbrain.inverse.optimise.gauss_newton import GaussNewton
from ngbrain.inverse.optimise.regularisation_weight import FixedWeights
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.inverse.uncertainty import posterior as module
from ngbrain.inverse.uncertainty.posterior import Posterior
from ngbrain.materials import NeoHooke

SIZES = {"a": 20, "b": 15, "c": 4}
SIGMA = 0.5


class Linear:
    """d = Aθ."""

    def __init__(self, matrix):
        self.matrix = matrix

    def evaluate(self, theta):
        A = self.matrix
        return SimpleNamespace(data=A @ theta, jvp=lambda v: A @ v, vjp=lambda w: A.T @ w, gradient=lambda w: A.T @ w)


def linear(names="abc", rng=None):
    """A linear problem with regularised blocks a and b, and its dense Gauss-Newton matrix."""
    rng = rng or np.random.default_rng(1)
    total = sum(SIZES.values())
    A = rng.normal(size=(60, total)) * np.logspace(1, -2, total)
    ends = np.cumsum([0, *SIZES.values()])
    blocks = {name: slice(*pair) for name, pair in zip(SIZES, pairwise(ends.tolist()), strict=True)}
    roots = {name: rng.normal(size=(SIZES[name], SIZES[name])) for name in "ab"}
    held = {name: sp.csr_array(root @ root.T + np.eye(len(root))) for name, root in roots.items()}
    weights = {"a": 2.0, "b": 0.3}
    H = A.T @ A / SIGMA**2
    for name, matrix in held.items():
        H[blocks[name], blocks[name]] += weights[name] * matrix.toarray()
    unknowns = ParameterFields(np.zeros(total), blocks, {name: Unknown(0.0, ScaledTransform()) for name in names})
    made = {name: QuadraticRegulariser(matrix, 0.0) for name, matrix in held.items() if name in names}
    misfit = LeastSquares(A @ rng.normal(size=total), SIGMA)
    reduced = Reduced(Linear(A), misfit, unknowns, made, {name: weights[name] for name in made})
    chosen = np.concatenate([np.arange(total)[blocks[name]] for name in names])
    return reduced, H[np.ix_(chosen, chosen)]


def at_start(reduced, min_eigenvalue=0.0):
    return Posterior(reduced.evaluate(reduced.unknowns.start), min_eigenvalue)


@pytest.mark.parametrize("names", ["abc", "ab", "ac", "c"])
def test_linear_problem_in_closed_form(names):
    reduced, H = linear(names)
    posterior, C = at_start(reduced), np.linalg.inv(H)
    assert posterior.variance(np.eye(len(C))) == pytest.approx(np.diag(C), rel=1e-10)
    assert posterior.covariance() == pytest.approx(C, rel=1e-8, abs=1e-10 * np.diag(C).max())
    some = np.random.default_rng(2).normal(size=(5, len(C)))
    assert posterior.variance(some) == pytest.approx(np.diag(some @ C @ some.T), rel=1e-10)
    for name in names:
        where = reduced.unknowns.blocks[name]
        assert posterior.deviation(name) == pytest.approx(np.sqrt(np.diag(C)[where]), rel=1e-10)
        if name in reduced.regularisers:
            R = reduced.regular_matrix(reduced.unknowns.start).toarray()[where, where]
            size = where.stop - where.start
            assert posterior.effective_parameters[name] == pytest.approx(size - np.trace(R @ C[where, where]), rel=1e-9)
            share = np.trace(C[where, where]) / np.trace(np.linalg.inv(R))
            assert posterior.remaining_variance[name] == pytest.approx(share, rel=1e-9)
        else:
            assert posterior.remaining_variance[name] == 0


@pytest.mark.parametrize("names", ["abc", "ab"])
def test_the_same_data_under_other_regularisers(names):
    """In closed form: the mean and the covariance of data and of the other assumption, from the minimum under the first one."""
    reduced, H = linear(names)
    start = reduced.unknowns.start
    x = start - np.linalg.solve(H, reduced.evaluate(start).gradient())
    rng = np.random.default_rng(5)
    others, weights = {}, {"a": 0.7, "b": 3.0}
    own, other, pull = (np.zeros_like(H), np.zeros_like(H), np.zeros(len(H)))
    for name in "ab":
        block, size = reduced.unknowns.blocks[name], SIZES[name]
        root = rng.normal(size=(size, size))
        others[name] = QuadraticRegulariser(sp.csr_array(root @ root.T + np.eye(size)), rng.normal(size=size))
        own[block, block] = reduced.weights[name] * reduced.regularisers[name].matrix(x[block]).toarray()
        other[block, block] = weights[name] * others[name].matrix(x[block]).toarray()
        pull[block] = other[block, block] @ others[name].reference
    data = H - own
    moved = Posterior(reduced.evaluate(x), min_eigenvalue=0.0).with_regularisers(others, weights)
    C = np.linalg.inv(data + other)
    assert moved.x == pytest.approx(C @ (H @ x + pull), rel=1e-8, abs=1e-8)
    assert moved.variance(np.eye(len(C))) == pytest.approx(np.diag(C), rel=1e-8)
    back = moved.with_regularisers(reduced.regularisers, reduced.weights)
    assert back.x == pytest.approx(x, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("names", ["abc", "ab", "c"])
def test_draws_have_the_covariance(names):
    reduced, H = linear(names)
    white = np.linalg.cholesky(H).T @ (at_start(reduced).draws(20_000, seed=3) - reduced.unknowns.start).T
    assert np.abs(white @ white.T / 20_000 - np.eye(len(H))).max() < 5 / np.sqrt(20_000)
    assert np.abs(white.mean(axis=1)).max() < 4 / np.sqrt(20_000)


@pytest.mark.parametrize("min_eigenvalue", [0.1, 1.0, 10.0])
def test_what_a_low_rank_leaves_out(min_eigenvalue):
    reduced, H = linear("ab")
    R = reduced.regular_matrix(reduced.unknowns.start).toarray()
    values, vectors = scipy.linalg.eigh(H - R, R)
    left = values < min_eigenvalue
    neglected = (vectors[:, left] ** 2) @ (values[left] / (1 + values[left]))
    posterior, C = at_start(reduced, min_eigenvalue), np.diag(np.linalg.inv(H))
    excess = posterior.variance(np.eye(len(C))) - C
    assert posterior.eigenvalues == pytest.approx(values[::-1][: len(posterior.eigenvalues)], rel=1e-7)
    assert len(posterior.eigenvalues) == np.sum(~left)
    assert excess == pytest.approx(neglected, rel=1e-5)
    assert np.all((excess > 0) & (excess < min_eigenvalue * C))


def test_directions_are_named():
    reduced, H = linear()
    posterior = at_start(reduced)
    R = reduced.regular_matrix(reduced.unknowns.start)
    assert len(posterior.informed_directions) == np.sum(posterior.eigenvalues > 1) > 3
    for direction in posterior.informed_directions[:4]:
        assert direction.x @ (R @ direction.x) == pytest.approx(1)
        assert direction.x @ H @ direction.x == pytest.approx(1 + direction.eigenvalue)
        assert sum(direction.shares.values()) == pytest.approx(1)
    first = posterior.informed_directions[0]
    assert first.name.startswith("a ") and first.shares["a"] > 0.9  # the data's largest columns
    assert posterior.notes[0].startswith(f"data inform {len(posterior.informed_directions)} directions")


def test_what_data_do_not_tell_is_said():
    reduced, _ = linear("ab")
    assert not any("variance of b" in note for note in at_start(reduced).notes)
    reduced.model.matrix[:, reduced.unknowns.blocks["b"]] *= 1e-3
    posterior = at_start(reduced)
    assert posterior.remaining_variance["b"] > 0.95 and posterior.remaining_variance["a"] < 0.2
    assert any(note.startswith("100 % of the prior variance of b remains") for note in posterior.notes)


def test_many_rows_are_drawn(monkeypatch):
    reduced, H = linear()
    posterior, C = at_start(reduced), np.linalg.inv(H)
    monkeypatch.setattr(module, "EXACT", 10)
    found = posterior.variance(np.eye(len(C)))
    assert np.abs(found / np.diag(C) - 1).max() < 5 * np.sqrt(2 / module.DRAWS)
    assert np.abs(found / np.diag(C) - 1).max() > 1e-6


def chain(n):
    """Squared differences of neighbours, singular up to round-off: a constant has no energy."""
    steps = np.diff(np.eye(n), axis=0) * np.sqrt(np.linspace(0.1, 0.9, n - 1))[:, None]
    return steps.T @ steps


@pytest.mark.parametrize("matrix", [np.diag([0.0] + [1.0] * 14), chain(15)], ids=["free", "constant"])
def test_a_regulariser_that_leaves_something_free(matrix):
    reduced, _ = linear("ab")
    reduced.regularisers["b"] = QuadraticRegulariser(sp.csr_array(matrix), 0.0)
    with pytest.raises(InputError, match="regularisers is singular"):
        at_start(reduced)


@pytest.mark.parametrize(("factor", "rest"), [(0.0, 0.0), (1.0, 0.0), (1.0, 1e-8)], ids=["none", "same", "nearly"])
def test_nothing_tells_of_a_block_without_a_regulariser(factor, rest):
    reduced, _ = linear()
    A = reduced.model.matrix
    A[:, -1] = factor * A[:, -2] + rest * A[:, -3]
    with pytest.raises(InputError, match="none for c"):
        at_start(reduced)


def test_blocks_without_a_regulariser_may_be_of_any_scale():
    reduced, _ = linear()
    before = at_start(reduced).deviation("c")
    reduced.model.matrix[:, -1] *= 1e-9
    after = at_start(reduced).deviation("c")
    assert after[:-1] == pytest.approx(before[:-1], rel=1e-8) and after[-1] == pytest.approx(1e9 * before[-1], rel=1e-8)


def test_bad_input():
    reduced, _ = linear()
    posterior = at_start(reduced)
    with pytest.raises(InputError, match="block is 'd'"):
        posterior.deviation("d")
    with pytest.raises(InputError, match="columns"):
        posterior.variance(np.eye(3))
    posterior.unknowns = SimpleNamespace()
    with pytest.raises(InputError, match="unknowns"):
        posterior.interval("a")


def test_waves_and_their_boundary():
    """The complete H, with boundary displacements that have no regulariser."""
    inversion = Phantom.from_name("CV-G", 5).simulate_measurements(0.01).inversion()
    point = inversion.reduced.evaluate(inversion.start)
    H = np.array([point.product(e) for e in np.eye(len(point.x))])
    C = np.linalg.inv((H + H.T) / 2)
    posterior = Posterior(point, min_eigenvalue=0)
    assert posterior.variance(np.eye(len(C))) == pytest.approx(np.diag(C), rel=1e-8)
    band = posterior.interval("storage", 0.68)
    where, theta = inversion.reduced.unknowns.blocks["storage"], inversion.reduced.unknowns.theta(point.x)
    sigma = np.sqrt(np.diag(C))[where]
    assert band.low == pytest.approx(theta[where] * np.exp(-0.99446 * sigma), rel=1e-5)
    assert band.high == pytest.approx(theta[where] * np.exp(0.99446 * sigma), rel=1e-5)


@pytest.mark.one_thread
def test_numbers_of_draws_are_the_same_in_processes(caplog):
    posterior = Posterior(settled()[1])
    here, there = (posterior.sampled_interval(np.linalg.norm, number=20, executor=who) for who in (None, 2))
    assert here == there and here.low < here.value < here.high
    assert "in this process" not in caplog.text


def test_mean_of_a_label_by_its_slope_and_by_draws():
    inversion, point = settled()
    reduced, truth = inversion.reduced, inversion.measured.truth
    posterior, blocks = Posterior(point), reduced.model.blocks
    label = np.zeros(reduced.model.size)
    label[blocks["storage"]][:20] = 1 / 20
    log_mean = lambda theta: float(np.log(label @ theta))  # noqa: E731
    slope = lambda theta: label / (label @ theta)  # noqa: E731
    theta, direction = reduced.unknowns.theta(point.x), np.random.default_rng(0).normal(size=len(label))
    assert np.all(np.abs(taylor(log_mean, slope(theta), theta, 1e3 * direction) - 2) < 0.1)
    one, other = posterior.linearised_interval(log_mean, slope), posterior.sampled_interval(log_mean, number=4000)
    assert one.value == pytest.approx(other.value)
    assert one.deviation == pytest.approx(other.deviation, rel=0.05)
    assert (one.low, one.high) == pytest.approx((other.low, other.high), abs=0.3 * one.deviation)
    assert one.deviation < 0.5 * posterior.deviation("storage")[:20].mean()  # errors of neighbours cancel
    assert one.low < np.log(truth["storage"][:20].mean()) < one.high


def pressed(measured):
    """Shear and bulk modulus of a compressed square, from measurements with 1 % noise and without a prior."""
    body = model(NeoHooke, "number")
    data = body.evaluate(body.theta).data
    fields = ParameterFields(body.theta, body.blocks, {"mu": Unknown(1e3), "bulk": Unknown(4e3)})
    return Reduced(body, LeastSquares(np.where(measured, data, np.nan), 0.01 * np.abs(data)), fields, {}, {})


def test_moduli_of_a_body_in_equilibrium():
    reduced = pressed(np.ones(7, bool))
    point = reduced.evaluate(reduced.unknowns.start)
    J = np.array([point.state.jvp(e) for e in np.diag(reduced.model.theta)]).T / (0.01 * point.state.data)[:, None]
    exact, posterior = np.sqrt(np.diag(np.linalg.inv(J.T @ J))), Posterior(point)
    for name, where in reduced.model.blocks.items():
        assert posterior.deviation(name) == pytest.approx(exact[where], rel=1e-8)
    assert posterior.interval("mu").low[0] > 950 and posterior.notes == []


def test_displacements_alone_do_not_tell_moduli():
    """A body driven by displacements only moves alike for all moduli times any factor."""
    reduced = pressed(np.arange(7) < 4)
    with pytest.raises(InputError, match="none for mu, bulk"):
        at_start(reduced)


def two_halves():
    """Log moduli of two halves, one of them poorly observed, with known boundary data."""
    true = square(9, "Q1", 0.1)
    noise, measured = scatter(true.evaluate(true.theta).data, 0.1)
    model = square(9, "Q1", 0.1)
    height = np.array([v.point[1] for v in model.body.mesh.vertices])
    basis = sp.csr_array(np.stack([height < 0.03, height >= 0.03], axis=1).astype(float))
    fields = ParameterFields(model.theta, model.blocks, {"storage": Unknown(MODULUS, LogTransform(), basis)})
    return Reduced(model, LeastSquares(measured, noise), fields, {"storage": ridge(fields.start)}, {"storage": 4.0})


def test_two_moduli_against_the_exact_posterior():
    """Deviations and ends of a non-linear problem with two unknowns against J on a grid."""
    reduced = two_halves()
    found = GaussNewton(reduced, FixedWeights()).descend(reduced.unknowns.start)
    posterior = Posterior(reduced.evaluate(found.x))
    sigma = posterior.deviation("storage")
    t = np.linspace(-4.5, 4.5, 23)
    values = np.array([[reduced.value(found.x + sigma * [a, b]) for b in t] for a in t])
    density = np.exp(values.min() - values)
    band = posterior.interval("storage")
    for i in range(2):
        marginal = density.sum(axis=1 - i)
        marginal /= marginal.sum()
        mean = marginal @ t
        assert np.sqrt(marginal @ (t - mean) ** 2) == pytest.approx(1, abs=0.05)
        fine = np.linspace(-4.5, 4.5, 2001)
        inside = np.interp(fine, t, marginal)
        moduli = np.exp(found.x[i] + sigma[i] * fine)
        within = inside[(moduli > band.low[i]) & (moduli < band.high[i])].sum() / inside.sum()
        assert within == pytest.approx(0.95, abs=0.015)


@pytest.mark.slow
def test_waves_against_sampling():
    """Deviations and intervals of all moduli, noise 5 %, against a chain that J itself decides: Hamiltonian Monte Carlo
    (Neal 2011, 10.1201/b10905-6) in the variables that the posterior makes white.
    """
    inversion, point = settled(nodes=4, noise=0.05)
    reduced, posterior = inversion.reduced, Posterior(point, min_eigenvalue=0)
    C = np.linalg.inv(np.array([point.product(e) for e in np.eye(len(point.x))]))
    root = np.linalg.cholesky((C + C.T) / 2)

    def energy(white):
        there = reduced.evaluate(point.x + root @ white)
        return there.value, root.T @ there.gradient()

    random, number, begun = np.random.default_rng(0), 2500, 50
    white, states, taken = np.zeros(len(C)), np.empty((number, len(C))), 0
    value, slope = energy(white)
    for i in range(number):
        at, momentum, step = white, random.normal(size=len(C)), random.uniform(0.2, 0.3)
        before, height, force = value + 0.5 * momentum @ momentum, value, slope
        for _ in range(6):
            momentum = momentum - step / 2 * force
            at = at + step * momentum
            height, force = energy(at)
            momentum = momentum - step / 2 * force
        if np.log(random.uniform()) < before - height - 0.5 * momentum @ momentum:
            white, value, slope, taken = at, height, force, taken + 1
        states[i] = point.x + root @ white
    assert taken > 0.8 * number
    assert (
        max(autocorrelation(states[begun:, i]) for i in range(len(C))) < number / 250
    )  # 250 draws: deviations to 4.5 %
    for name in ("storage", "loss"):
        sampled = states[begun:, reduced.unknowns.blocks[name]]
        assert posterior.deviation(name) == pytest.approx(sampled.std(axis=0), rel=0.12)
        band = posterior.interval(name)
        within = np.mean((np.exp(sampled) > band.low) & (np.exp(sampled) < band.high), axis=0)
        # J is no parabola so far out: 91.4 % at the worst of 32 moduli.
        assert np.abs(within - 0.95).max() < 0.045 and abs(within.mean() - 0.95) < 0.01


def autocorrelation(chain):
    """Number of states of the chain equivalent to one independent draw."""
    centred = chain - chain.mean()
    product = np.fft.irfft(np.abs(np.fft.rfft(centred, 2 * len(chain))) ** 2)[: len(chain)]
    product /= product[0]
    return 1 + 2 * product[1 : np.argmax(product < 0.05)].sum()


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.01, 0.05])
def test_intervals_cover_what_they_say(noise):
    """120 truths drawn from the prior, each measured once: coverage over all nodes."""
    inside = {0.68: [], 0.95: []}
    for seed in range(120):
        inversion, point = settled(noise=noise, seed=seed)
        posterior = Posterior(point)
        for level, shares in inside.items():
            for name, truth in inversion.measured.truth.items():
                band = posterior.interval(name, level)
                shares.append(np.mean((band.low < truth) & (truth < band.high)))
    assert 0.60 < np.mean(inside[0.68]) < 0.76
    assert 0.90 < np.mean(inside[0.95]) < 0.99
