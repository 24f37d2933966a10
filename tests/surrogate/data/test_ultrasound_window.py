"""The compression operator on a window of a larger body, whose boundary deforms."""

from dataclasses import replace

import numpy as np
import pytest
from compressed_lesion import CONTRAST, WINDOW, ball, compression, contrast, plane
from scipy.ndimage import gaussian_filter

pytest.importorskip("onnxruntime", reason='onnxruntime is not installed; get it with: pip install "ngbrain[surrogate]"')

from ngbrain.inverse.elastography.derived_maps import scale_to_truth  # noqa: E402
from ngbrain.surrogate.data.ultrasound_window import misfit, remove_strain_trend  # noqa: E402
from ngbrain.surrogate.prediction.predict import predict  # noqa: E402
from ngbrain.surrogate.prediction.pretrained import Operator  # noqa: E402
from ngbrain.surrogate.prediction.tiling import RasterField, predict_field  # noqa: E402


@pytest.fixture(scope="module")
def pressed():
    return compression(plane)


def axial(data):
    n = round(np.sqrt(len(data.points)))
    return data.displacement[0, :, 1].real.reshape(n, n)


def moved(data, u):
    """The data with another axial displacement."""
    return replace(data, displacement=np.stack([np.full(u.size, np.nan), u.ravel()], axis=1)[None], truth={})


@pytest.mark.parametrize("bend", [0.2, -0.4])
def test_uniform_tissue_under_a_bent_plate_is_as_under_an_even_one(bend):
    y, x = np.meshgrid(*2 * (np.linspace(0, 1, 57),), indexing="ij")
    found = remove_strain_trend(-0.01 * (y + bend * y**2 + 0.1 * x * y + 0.1 * x**2 * y))
    assert np.ptp(found, axis=1).max() < 1e-9
    np.testing.assert_allclose(found[:, 0] / found[-1, 0], y[:, 0], atol=1e-9)


def test_what_is_no_compression_stays_as_it_is(rng):
    y, _ = np.meshgrid(*2 * (np.linspace(-1, 1, 41),), indexing="ij")
    assert np.array_equal(remove_strain_trend(y**2), y**2)  # pulled below, pressed above


def test_the_truth_explains_a_window_and_other_maps_do_not(pressed):
    truth = pressed.truth["youngs"].reshape(axial(pressed).shape)
    right, uniform, inverse = (
        misfit(axial(pressed) / WINDOW, youngs / youngs.mean(), pressed.poisson)
        for youngs in (truth, np.ones_like(truth), 1 / truth)
    )
    assert right < 0.2 and uniform > 1.5 * right and inverse > 3 * right


def test_an_uneven_plate_is_no_reason_to_reject(pressed):
    found = predict(pressed)
    lesion, uneven = contrast(pressed.points, found.maps["youngs"])
    assert found.usable and not found.reasons and found.scores["boundary"] == 0
    assert lesion == pytest.approx(CONTRAST, rel=0.15) and uneven < 0.3
    assert any("window of a larger body" in note and "`invert`" in note for note in found.warnings)
    level = scale_to_truth(pressed, "youngs", found.maps["youngs"])
    off = np.abs(level - pressed.truth["youngs"]) / (found.deviations["youngs"] * level / found.maps["youngs"])
    assert (off < 1.96).mean() > 0.85
    n = len(axial(pressed))
    view = RasterField(axial(pressed)[..., None], np.ones((n, n), bool), 0.0, WINDOW / (n - 1))
    plates = np.exp(predict_field(Operator.load_default("compression"), view, 1000.0, 0.495).mean[0])
    naive, _ = contrast(pressed.points, plates.ravel())
    assert abs(naive - CONTRAST) > 2 * abs(lesion - CONTRAST)


@pytest.mark.slow
def test_a_ball_in_a_window():
    data = compression(ball)
    found = predict(data)
    assert found.usable and contrast(data.points, found.maps["youngs"])[0] == pytest.approx(2.4, rel=0.1)


SPOILS = {
    "points shuffled": lambda u, rng: rng.permutation(u.ravel()).reshape(u.shape),
    "rows shuffled": lambda u, rng: u[rng.permutation(len(u))],
    "columns shuffled": lambda u, rng: u[:, rng.permutation(len(u))],
    "noise alone": lambda u, rng: u.std() * rng.normal(size=u.shape),
    "smooth noise": lambda u, rng: u.std() * gaussian_filter(rng.normal(size=u.shape), 6),
    "axes swapped": lambda u, rng: u.T,
    "half the points upside down": lambda u, rng: np.where(rng.random(u.shape) < 0.5, u[::-1], u),
    "half the window upside down": lambda u, rng: np.hstack([u[:, : len(u) // 2], u[::-1, len(u) // 2 :]]),
    "10 % noise": lambda u, rng: u + 0.1 * u.std() * rng.normal(size=u.shape),
    "times a smooth factor": lambda u, rng: u * (1 + 0.2 * np.outer(*2 * (np.sin(np.linspace(0, 2 * np.pi, len(u))),))),
    "a wrapped patch": lambda u, rng: u + 0.2 * np.ptp(u) * np.outer(*2 * (np.abs(np.arange(len(u)) - 24) < 5,)),
}


@pytest.mark.parametrize("spoil", SPOILS)
def test_nonsense_in_a_window_is_not_trusted(pressed, spoil, rng):
    found = predict(moved(pressed, SPOILS[spoil](axial(pressed), rng)))
    assert not found.usable and found.reasons and max(found.scores.values()) > 1
    assert np.isfinite(list(found.scores.values())).all()  # result.json has no other numbers
