"""Baseline networks have the operator's size, accept its grids, and are what they are called."""

import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("pywt")
torch.set_num_threads(1)

from ngbrain.surrogate.operator.wavelet_operator import WaveletOperator, count_weights  # noqa: E402
from ngbrain.surrogate.training.baselines import FourierLayer, FourierOperator, UNet  # noqa: E402

RIVALS = [UNet, FourierOperator]


@pytest.mark.parametrize("rival", RIVALS)
@pytest.mark.parametrize("channels", [(24, 4), (10, 2)])
def test_as_many_weights_as_the_operator(rival, channels):
    assert count_weights(rival(*channels)) == pytest.approx(count_weights(WaveletOperator(*channels)), rel=0.1)


@pytest.mark.parametrize("network", [WaveletOperator, *RIVALS])
def test_answers_begin_near_nothing(network):
    """The initial output is near zero, so that the first estimate is unchanged."""
    torch.manual_seed(0)
    with torch.no_grad():
        assert 0 < network(10, 2)(torch.randn(2, 10, 51, 51)).std() < 0.4


@pytest.mark.parametrize("rival", RIVALS)
def test_any_grid_and_every_weight_learns(rival):
    net = rival(3, 2, width=4)
    y = net(torch.randn(2, 3, 51, 38))
    assert y.shape == (2, 2, 51, 38)
    y.square().sum().backward()
    assert all(p.grad.abs().max() > 0 for p in net.parameters())


def test_a_spectrum_sees_low_modes_alone_and_the_same_on_every_grid():
    torch.manual_seed(0)
    spectrum = FourierLayer(1, 4)

    def wave(n: int, mode: int):
        s = 2 * torch.pi * torch.arange(n) / n
        return (torch.cos(mode * s)[:, None] + torch.cos(2 * s + 1)).expand(1, 1, n, n)

    with torch.no_grad():
        torch.testing.assert_close(spectrum(wave(64, 3))[..., ::2, ::2], spectrum(wave(32, 3)), rtol=0, atol=1e-5)
        assert (spectrum(wave(64, 3)) - spectrum(wave(64, 2))).abs().max() > 0.1
        torch.testing.assert_close(spectrum(wave(64, 9)), spectrum(wave(64, 11)), rtol=0, atol=1e-5)
