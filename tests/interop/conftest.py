"""Small models and objectives for all faces, and the packages behind these, each of which may be missing."""

import numpy as np
import pytest
from inversions import square, two_moduli

from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import ConvergenceError, MissingExtra, require
from ngbrain.inverse.misfit import LeastSquares
from ngbrain.inverse.parameters import Fields, Scaled, Unknown
from ngbrain.inverse.regularise import ridge


def or_skip(package):
    try:
        return require(package, "interop")
    except MissingExtra as missing:
        pytest.skip(str(missing))


@pytest.fixture(scope="session")
def torch():
    package = or_skip("torch")
    package.set_num_threads(1)
    return package


@pytest.fixture(scope="session")
def jax():
    package = or_skip("jax")
    package.config.update("jax_enable_x64", True)
    return package


@pytest.fixture(scope="session")
def umbridge():
    return or_skip("umbridge")


class Exponential:
    """Real data d_i = Σ e^{5θ_j} A_ij, with a `ConvergenceError` where a θ is above `cap`; counts what it solves."""

    def __init__(self, size=8, cap=0.6):
        random = np.random.default_rng(3)
        self.A = random.uniform(0.1, 1.0, size=(size + 2, size))
        self.cap, self.solved, self.failed = cap, 0, 0

    def at(self, theta):
        if np.max(theta) > self.cap:
            self.failed += 1
            raise ConvergenceError("the load cannot be carried")
        self.solved += 1
        return Tangent(self.A @ np.exp(5 * theta), self.A * (5 * np.exp(5 * theta)))


class Tangent:
    def __init__(self, data, J):
        self.data, self.J = data, J

    def push(self, direction):
        return self.J @ direction

    def pull(self, w):
        return self.J.T @ w

    gradient = pull


def reduced_of(model, start):
    """Its data at θ = 0.3 with weak ridges: the minimum is close to where it has no solution."""
    truth = np.full(model.A.shape[1], 0.3)
    fields = Fields(truth, {"theta": slice(0, len(truth))}, {"theta": Unknown(start, Scaled())})
    misfit = LeastSquares(model.at(truth).data, 0.05)
    return Reduced(model, misfit, fields, {"theta": ridge(truth)}, {"theta": 1.0})


@pytest.fixture
def real():
    return Exponential()


@pytest.fixture
def risky(real):
    """J of `real`, so far from its minimum that any search asks for what has no solution."""
    return reduced_of(real, -0.5)


@pytest.fixture
def waves():
    """Complex data: 9 moduli, then 12 boundary values."""
    return square(3, "Q2", 0.1)


@pytest.fixture
def inversion():
    """J of complex data and two fields."""
    return two_moduli(20.0, 4)


@pytest.fixture
def around(rng):
    """θ near that of a model, and a weight of its data."""

    def made(model, data):
        theta = model.theta * (1 + 0.1 * rng.uniform(-1, 1, size=model.size))
        return theta, rng.normal(size=data.shape) + 1j * rng.normal(size=data.shape)

    return made
