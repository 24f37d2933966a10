"""The transform against ptwt and itself: the same coefficients, exact reconstruction, other grids through the native one."""

import pytest

from ngbrain.errors import InputError

torch = pytest.importorskip("torch")
ptwt = pytest.importorskip("ptwt")
torch.set_num_threads(1)

from ngbrain.surrogate.operator.wavelets import Wavelet, interpolation  # noqa: E402

LEVELS = 3


@pytest.fixture
def field(rng):
    def of(ny, nx):
        return torch.from_numpy(rng.normal(size=(ny, nx, 2, 3))).float()

    return of


@pytest.mark.parametrize("name", ["haar", "db2", "db6", "bior2.2"])
@pytest.mark.parametrize("shape", [(51, 51), (64, 64), (101, 51)])
def test_coefficients_are_those_of_ptwt(field, name, shape):
    """Ours are local means: 2^-j times theirs. Relative to the largest."""
    wavelet, x = Wavelet(name), field(*shape)
    mean, details = wavelet.decompose(x, wavelet.levels(*shape, LEVELS))
    theirs = ptwt.wavedec2(x.permute(2, 3, 0, 1).double(), name, mode="symmetric", level=LEVELS)
    pairs = [(2**LEVELS * mean.permute(2, 3, 0, 1), theirs[0])]
    for level, found in enumerate(details, 1):
        pairs += zip((2**level * found).unflatten(1, (3, -1)).unbind(1), theirs[-level], strict=True)
    assert len(pairs) == 1 + 3 * LEVELS
    for ours, wanted in pairs:
        torch.testing.assert_close(ours.double(), wanted, rtol=0, atol=1e-6 * wanted.abs().max().item())


@pytest.mark.parametrize("name", ["haar", "db2", "db6", "bior2.2"])
@pytest.mark.parametrize("shape", [(51, 64), (101, 26), (9, 7)])
def test_reconstruction_is_exact(field, name, shape):
    wavelet, x = Wavelet(name), field(*shape)
    levels = wavelet.levels(*shape, LEVELS)
    again = wavelet.compose(*wavelet.decompose(x, levels), levels)
    torch.testing.assert_close(again, x, rtol=0, atol=1e-6 * x.abs().max().item())


def test_means_of_a_constant_are_the_constant_and_details_nothing():
    wavelet = Wavelet("db2")
    mean, details = wavelet.decompose(torch.full((51, 64, 1, 1), 7.0), wavelet.levels(51, 64, LEVELS))
    torch.testing.assert_close(mean, torch.full_like(mean, 7.0))
    assert max(d.abs().max() for d in details) < 1e-5


def test_a_finer_grid_gives_the_native_coefficients(field):
    """101 points contain the 51; 64 do not, but resolve a smooth field."""
    wavelet, fine = Wavelet("db2"), field(101, 101)
    native = wavelet.axis(51)
    finer = native.resample(101)
    for ours, wanted in zip(
        wavelet.split(fine, (finer, finer)), wavelet.split(fine[::2, ::2], (native, native)), strict=True
    ):
        torch.testing.assert_close(ours, wanted)
    wave = torch.sin(2 * torch.pi * torch.linspace(0, 1, 64))
    torch.testing.assert_close(
        native.resample(64).synthesis @ (native.resample(64).analysis @ wave), wave, rtol=0, atol=2e-4
    )


def test_a_level_below_another_is_the_second_of_two(field):
    wavelet, x = Wavelet("db2"), field(51, 51)
    (first, _), (second, _) = wavelet.levels(51, 51, 2)
    both = second.chain(first)
    mean, _ = wavelet.split(x, (first, first))
    for ours, wanted in zip(wavelet.split(x, (both, both)), wavelet.split(mean, (second, second)), strict=True):
        torch.testing.assert_close(ours, wanted)
    again = wavelet.join(*wavelet.split(x, (both, both)), (both, both))
    torch.testing.assert_close(again, wavelet.join(mean, torch.zeros(2, 9, 27, 27), (first, first)))


def test_interpolation_is_exact_for_cubics_up_to_the_ends():
    coarse, fine = torch.linspace(0, 1, 13, dtype=torch.float64), torch.linspace(0, 1, 40, dtype=torch.float64)
    found = interpolation(13, 40, coarse) @ (coarse**3 - coarse)
    torch.testing.assert_close(found, fine**3 - fine, rtol=0, atol=1e-12)


def test_an_unknown_wavelet_is_refused():
    with pytest.raises(InputError, match="wavelet is 'db2x'; wanted: did you mean"):
        Wavelet("db2x")
