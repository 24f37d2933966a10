"""Small models and objectives for all faces, and the packages behind these, each of which may be missing."""

import optimiser_models
import pytest
from inversions import two_moduli
from optimiser_models import Exponential, reduced_of

from ngbrain.errors import MissingExtra, require


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


@pytest.fixture
def real():
    return Exponential()


@pytest.fixture
def risky(real):
    """J of `real`, so far from its minimum that any search asks for what has no solution."""
    return reduced_of(real, -0.5)


@pytest.fixture
def waves():
    """Complex data at 25 points, of 9 moduli and 40 boundary values."""
    return optimiser_models.waves()


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
