"""The operator acts on lengths, not points; it learns; and it runs without PyTorch."""

import math

import numpy as np
import pytest

from ngbrain.errors import InputError

torch = pytest.importorskip("torch")
pytest.importorskip("pywt")
torch.set_num_threads(1)

from ngbrain.surrogate.operator import wavelet_operator  # noqa: E402
from ngbrain.surrogate.operator.wavelet_operator import WaveletOperator, count_weights, native_grid  # noqa: E402
from ngbrain.surrogate.training.export import write_onnx  # noqa: E402


def smooth(n: int, phase: float = 0.0):
    """Two waves, a bump and the coordinates, (1, 5, n, n)."""
    y, x = torch.meshgrid(*2 * (torch.linspace(0, 1, n, dtype=torch.float64),), indexing="ij")
    waves = [torch.sin(2 * math.pi * (k * x + y) + phase) * torch.cos(math.pi * k * y) for k in (1, 2)]
    bump = torch.exp(-20 * ((x - 0.4) ** 2 + (y - 0.6) ** 2))
    return torch.stack([*waves, bump, x, y])[None].float()


@pytest.fixture
def net():
    torch.manual_seed(0)
    return WaveletOperator(5, 2, width=12, blocks=2).requires_grad_(False)


def off(found, wanted) -> float:
    """Error relative to the spatial variation of the target."""
    return ((found - wanted).norm() / (wanted - wanted.mean((2, 3), keepdim=True)).norm()).item()


def test_a_finer_grid_gives_the_same_answer(net, monkeypatch):
    """At the native points equal to round-off, interpolated between them; a network tied to points would fail."""
    coarse, fine = net(smooth(51)), net(smooth(101))
    assert off(fine[..., ::2, ::2], coarse) < 1e-5
    between = torch.nn.functional.interpolate(coarse, size=(101, 101), mode="bicubic", align_corners=True)
    assert off(fine, between) < 0.04
    monkeypatch.setattr(wavelet_operator, "native_grid", lambda ny, nx: (ny, nx))
    assert off(net(smooth(101))[..., ::2, ::2], coarse) > 0.3


@pytest.mark.parametrize("n", [36, 64, 76])
def test_grids_without_the_native_points_come_near(net, n):
    between = torch.nn.functional.interpolate(net(smooth(51)), size=(n, n), mode="bicubic", align_corners=True)
    assert off(net(smooth(n)), between) < 0.08


def test_the_native_grid_has_square_cells():
    assert native_grid(101, 51) == (51, 26)
    assert native_grid(31, 64) == (25, 51)


def test_every_weight_learns_and_there_are_few():
    net = WaveletOperator(24, 4)
    assert 2e5 <= count_weights(net) <= 6e5
    net(torch.randn(1, 24, 51, 51)).square().sum().backward()
    assert all(p.grad.abs().max() > 0 for p in net.parameters())


def test_what_was_learned_on_51_points_holds_on_101():
    """The gradient of a wave along x, which needs neighbouring points."""
    torch.manual_seed(0)

    def example(n: int, phases):
        s = torch.linspace(0, 1, n)
        x = torch.stack([torch.sin(5 * s + a).expand(n, n) for a in phases])[:, None]
        return x, torch.stack([torch.cos(5 * s + a).expand(n, n) for a in phases])[:, None]

    net = WaveletOperator(1, 1, width=6, blocks=1)
    optimiser = torch.optim.Adam(net.parameters(), 2e-2)
    for _ in range(100):
        x, y = example(51, 2 * math.pi * torch.rand(4))
        optimiser.zero_grad()
        (net(x) - y).square().mean().backward()
        optimiser.step()
    with torch.no_grad():
        errors = [off(net(x), y) for x, y in (example(n, torch.arange(6.0)) for n in (51, 101, 64))]
    assert errors[0] < 0.15
    assert max(errors) < 1.3 * errors[0]


def test_one_onnx_file_serves_all_grids(net, tmp_path):
    runtime = pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    write_onnx(net, tmp_path / "net.onnx", net.channels_in, ["x", "y"])
    session = runtime.InferenceSession(tmp_path / "net.onnx", providers=["CPUExecutionProvider"])
    for shape in ((1, 5, 51, 51), (2, 5, 64, 64), (1, 5, 101, 101), (3, 5, 40, 61), (1, 5, 61, 26)):
        x = torch.randn(shape)
        (found,) = session.run(None, {"x": x.numpy()})
        np.testing.assert_allclose(found, net(x).numpy(), rtol=0, atol=1e-5 * net(x).abs().max().item())


@pytest.mark.parametrize("shape", [(1, 4, 51, 51), (5, 51, 51), (1, 5, 3, 51)])
def test_other_shapes_are_refused(net, shape):
    with pytest.raises(InputError, match=r"x\.shape .* wanted: \(batch, 5, ny, nx\), ny and nx at least 4"):
        net(torch.zeros(shape))
