"""Anti-plane motion of one slice: modulus, inclusion, exponent of frequency, and notes of the result."""

from dataclasses import replace

import ngsolve as ngs
import numpy as np
import pytest
from planewaves import grid, wave_number
from waves import square

from ngbrain.errors import InputError
from ngbrain.forward.common.kinematics import AntiPlane
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.harmonic.wave import Wave
from ngbrain.inverse.data.direct_inversion import uniform_modulus
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.uncertainty.credible_maps import uncertainty
from ngbrain.io.waves import WaveData, read_waves, write_waves
from ngbrain.materials import Shearing
from ngbrain.surrogate.prediction.predict import predict

G, SIDE = 2000 + 800j, 0.06


def data_of(u, points, frequency, **more):
    return WaveData(points, u, frequency, 1000.0, "isotropic", "viscoelastic", motion="anti_plane", **more)


def plane(frequencies=(50.0,), exponent=0.0, shape=(24, 22)):
    """Two crossing waves at each frequency."""
    points, loads = grid(*shape, spacing=2.5e-3), []
    for f in frequencies:
        k = wave_number(G * (f / frequencies[0]) ** exponent, f)
        loads.append(np.exp(-1j * k * points[:, 0]) + 0.8 * np.exp(-1j * k * (points @ [0.6, 0.8])))
    return data_of(1e-5 * np.array(loads)[..., None], points, list(frequencies)).with_noise(0.01, seed=0)


def inclusion(ratio):
    """Waves from two sides of a square with a disc of 15 mm in its middle, computed on triangles of fourth order."""
    mesh, n = square(24, SIDE), 31
    away = (ngs.x - SIDE / 2) ** 2 + (ngs.y - SIDE / 2) ** 2
    modulus = ngs.IfPos((7.5e-3) ** 2 - away, ratio, 1.0)
    modulus = G.real * modulus + 1j * (G.imag * modulus)
    loads = [Wave(60.0, {"left|top": (1e-5,)}), Wave(60.0, {"bottom": (1e-5,), "left": (-1e-5,)})]
    body = HarmonicProblem(
        mesh, Shearing(modulus), loads, form="P4", dirichlet="left|bottom|top|right", kinematics=AntiPlane()
    )
    line = np.linspace(1e-9, SIDE - 1e-9, n)
    points = np.array([[x, y] for y in line for x in line])
    u = np.array([wave(mesh(*points.T)).reshape(-1, 1) for wave in body.solve()])
    inside = np.hypot(*(points - SIDE / 2).T) < 5e-3
    return data_of(u, points, [60.0, 60.0]).with_noise(0.01, seed=0), inside


def test_a_modulus_of_one_slice_and_what_is_said_of_it():
    found = invert(plane(), uniform=False, regulariser="smooth")
    assert np.median(found.maps["storage"]) == pytest.approx(2000, rel=0.02)
    assert np.median(found.maps["loss"]) == pytest.approx(800, rel=0.04)
    assert found.predicted.shape == (1, 528, 1) and 0.7 < found.checks["misfit_over_expected"] < 1.3
    said = " ".join(found.warnings)
    assert "apparent moduli" in said and "uniform displacement" in said and "square of the pixels' size" in said
    assert np.isfinite(found.strain.oss).all()


def test_error_bars_of_one_slice():
    """The uniform translation is one of the eliminated unknowns."""
    data = plane()
    bars = uncertainty(invert(data, uniform=False, regulariser="smooth"))
    mean = bars.mean("storage")
    assert abs(mean.value - 2000) < 4 * mean.deviation and 1 < mean.deviation < 60


def test_the_start_is_that_of_the_waves():
    assert uniform_modulus(plane()).value == pytest.approx(G, rel=0.05)


@pytest.mark.parametrize("ratio", [0.6, 1.6])
def test_an_inclusion_is_found(ratio):
    data, inside = inclusion(ratio)
    found = invert(data, uniform=False, regulariser="smooth")
    storage = found.maps["storage"]
    assert np.median(storage[inside]) / 2000 == pytest.approx(ratio, rel=0.15)


def test_the_seam_of_two_scans_is_no_tissue():
    """A varying modulus explains one load except the jump, which the displacement itself reveals."""
    one, other = plane(shape=(30, 28)), plane(frequencies=(50.0,), shape=(30, 28))
    x = one.points[:, 0]
    left = (x < np.median(x))[None, :, None]
    noise = 0.02 * one.rms.max() * np.random.default_rng(1).normal(size=one.displacement.shape)
    one = replace(one, noise=None)
    whole = replace(one, displacement=one.displacement + noise)
    seam = replace(one, displacement=np.where(left, one.displacement, -1.5j * other.displacement) + noise)
    good, torn = (invert(data, uniform=False, regulariser="smooth") for data in (whole, seam))
    assert good.usable and good.strain.discontinuity_share == 0
    assert torn.strain.discontinuity_share > 0.02 and any("beside a jump" in reason for reason in torn.reasons)
    assert torn.noise_found < 4 * torn.stated  # the misfit alone would let it pass


def test_one_exponent_for_all_frequencies():
    data = plane((30.0, 40.0, 60.0), 0.7)
    found = invert(data, uniform=False, regulariser="smooth")
    assert found.checks["exponent"] == pytest.approx(0.7, abs=0.03)
    assert np.median(found.maps["storage"]) == pytest.approx(2000, rel=0.03) and "exponent" not in found.maps
    assert any("goes with frequency to the power" in note for note in found.warnings)


def test_an_angle_to_the_slice_reads_as_an_apparent_modulus():
    """A wave in space whose direction leaves the plane by 30°: in the slice it is longer, and G comes out 1/cos² 30° = 1.33."""
    points, k = grid(24, 22, spacing=2.5e-3), wave_number(G)
    along = np.cos(np.pi / 6) * points[:, 0]
    found = invert(data_of(1e-5 * np.exp(-1j * k * along)[None, :, None], points, [50.0]), noise=0.01, uniform=False)
    assert np.median(found.maps["storage"]) == pytest.approx(2000 / np.cos(np.pi / 6) ** 2, rel=0.02)


def test_files_keep_the_motion(tmp_path):
    data = plane()
    for name in ("waves.npz", "waves.h5", "waves.nii.gz"):
        if name.endswith("gz"):
            pytest.importorskip("nibabel")
        write_waves(tmp_path / name, data)
        back = read_waves(tmp_path / name)
        assert back.motion == "anti_plane" and back.displacement.shape == (1, 528, 1)
        assert np.array_equal(back.displacement, data.displacement)


def test_what_is_refused():
    points, u = grid(10, 10), np.ones((1, 100, 1))
    for more, words in (
        ({"motion": "sideways"}, "motion is 'sideways'"),
        ({"symmetry": "transversely_isotropic", "fibre": [1.0, 0.0]}, "symmetry is transversely_isotropic"),
        ({"rheology": "elastic"}, "poisson is missing"),
    ):
        given = {"symmetry": "isotropic", "rheology": "viscoelastic", "motion": "anti_plane"} | more
        with pytest.raises(InputError, match=words):
            WaveData(points, 1e-6 * u, [50.0], 1000.0, **given)
    with pytest.raises(InputError, match="motion is 'anti_plane'"):
        WaveData(
            grid(3, 3, 3), 1e-6 * np.ones((1, 27, 1)), [50.0], 1e3, "isotropic", "viscoelastic", motion="anti_plane"
        )
    with pytest.raises(InputError, match="motion is anti_plane; wanted: in_plane"):
        predict(plane())
    with pytest.raises(InputError, match="motion is in_plane; wanted: anti_plane for one component"):
        WaveData(points, 1e-6 * u, [50.0], 1000.0, "isotropic", "viscoelastic", poisson=0.4)
    with pytest.raises(InputError, match="two frequencies or more"):
        invert(plane(), dispersion="power")
