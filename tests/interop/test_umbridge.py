"""A model served over HTTP on this machine, asked by the client of the same package."""

import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from ngbrain.adjoint.check import taylor
from ngbrain.errors import MissingExtra
from ngbrain.forward.sensitivity.harmonic.wave_model import WaveLinearisation
from ngbrain.interop.umbridge import BEYOND, model

HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def url(umbridge):
    """Of a server in another process, for as long as this file takes."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server = subprocess.Popen([sys.executable, HERE / "serving.py", str(port)], stdout=subprocess.DEVNULL)
    address = f"http://127.0.0.1:{port}"
    try:
        for _ in range(600):
            try:
                umbridge.supported_models(address)
                break
            except OSError:
                assert server.poll() is None, "the server has stopped"
                time.sleep(0.1)
        yield address
    finally:
        server.terminate()
        server.wait(10)


def numbers(y):
    return np.concatenate([y.real.ravel(), y.imag.ravel()])


def same(a, b):
    np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12 * np.abs(b).max())


def test_round_trip(umbridge, url, waves, around, rng):
    """Value, gradient and product of the Jacobian come back as the State has them, to the last digits of their text."""
    client = umbridge.HTTPModel(url, "waves")
    theta, w = around(waves, waves.evaluate(waves.theta).data)
    state, dx = waves.evaluate(theta), theta * rng.normal(size=theta.size)
    x = [theta.tolist()]
    assert client.get_input_sizes() == [waves.size] and client.get_output_sizes() == [2 * state.data.size]
    same(client(x)[0], numbers(state.data))
    same(client.gradient(0, 0, x, numbers(w).tolist()), state.gradient(w))
    same(client.apply_jacobian(0, 0, x, dx.tolist()), numbers(state.jvp(dx)))
    same(client.apply_hessian(0, 0, 0, x, numbers(w).tolist(), dx.tolist()), state.hvp(w, dx))


def test_objective(umbridge, url, risky, rng):
    client, x, dx = umbridge.HTTPModel(url, "objective"), risky.unknowns.start, rng.normal(size=8)
    point = risky.evaluate(x)
    assert client.get_output_sizes() == [1]
    assert client([x.tolist()]) == [[point.value]]
    same(client.gradient(0, 0, [x.tolist()], [2.0]), 2 * point.gradient())
    same(client.apply_jacobian(0, 0, [x.tolist()], dx.tolist()), [point.gradient() @ dx])
    same(client.apply_hessian(0, 0, 0, [x.tolist()], [2.0], dx.tolist()), 2 * point.hessian(dx))


def test_what_has_no_second_derivatives(umbridge, waves, inversion, monkeypatch, rng):
    """Data have no Hessian then, J that of Gauss and Newton."""
    monkeypatch.delattr(WaveLinearisation, "hvp")
    assert not model(waves, waves.theta).supports_apply_hessian()
    x, dx = inversion.unknowns.start, rng.normal(size=inversion.unknowns.start.size)
    served = model(inversion, x)
    same(served.apply_hessian(0, 0, 0, [x.tolist()], [2.0], dx.tolist()), 2 * inversion.evaluate(x).product(dx))


def test_rates(umbridge, url, waves, around, rng):
    client = umbridge.HTTPModel(url, "waves")
    theta, w = around(waves, waves.evaluate(waves.theta).data)
    sens, dx = numbers(w), theta * rng.normal(size=theta.size)
    slope = np.array(client.gradient(0, 0, [theta.tolist()], sens.tolist()))
    rates = taylor(lambda x: float(sens @ client([x.tolist()])[0]), slope, theta, dx, first=1e-3)
    assert np.all(np.abs(rates - 2) < 0.1)


def test_objective_without_solution_is_a_wall(umbridge, url):
    client = umbridge.HTTPModel(url, "objective")
    assert client([[1.0] * 8]) == [[BEYOND]]
    assert client.gradient(0, 0, [[1.0] * 8], [1.0]) == [0.0] * 8


def test_data_without_solution_are_an_error_that_the_client_tells(umbridge, url, real):
    client = umbridge.HTTPModel(url, "real")
    with pytest.raises(Exception, match="of type ConvergenceError: the load cannot be carried"):
        client([[1.0] * 8])
    same(client([[0.1] * 8])[0], real.evaluate(np.full(8, 0.1)).data)


def test_missing_package_is_named(monkeypatch, real):
    monkeypatch.setitem(sys.modules, "umbridge", None)
    with pytest.raises(MissingExtra, match=r'umbridge is not installed; get it with: pip install "ngbrain\[interop\]"'):
        model(real, np.zeros(8))
