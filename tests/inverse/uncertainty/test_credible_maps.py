"""Error bars of `invert`: at the data's points, as functions, of means; for labels, phases and other elements."""

from dataclasses import replace

import numpy as np
import pytest
from planewaves import grid, shear_waves, waves

from ngbrain.errors import InputError
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.phantoms.benchmark import Phantom
from ngbrain.inverse.uncertainty.credible_maps import count_hessian_products, estimate_seconds, uncertainty

NOISE = 0.02


def bars(data, **options):
    return uncertainty(invert(data, uniform=False, regulariser="smooth", **options))


@pytest.fixture(scope="module")
def nodal():
    """Error bars in the elements of the data, with a point left out."""
    data = Phantom.from_name("CV-G", 11).simulate_measurements(NOISE, seed=1).data()
    return bars(replace(data, mask=np.arange(121) != 20, dirichlet=None, truth={}))


@pytest.fixture(scope="module")
def cubic():
    """Error bars in new elements with fields of second order."""
    points = grid(10, 10, spacing=4e-3)
    return bars(waves(points, shear_waves(points, 5000 + 800j), poisson=0.4).with_noise(NOISE, seed=1))


def test_bands_of_nodal_maps(nodal):
    there = nodal.problem.inside
    for name, truth in Phantom.from_name("CV-G", 11).simulate_measurements().truth.items():
        band = nodal.interval(name)
        assert np.flatnonzero(np.isnan(band.low)).tolist() == [20]
        assert band.value[there] == pytest.approx(nodal.found.maps[name][there], rel=1e-9)
        low, high, truth = band.low[there], band.high[there], truth[there]
        assert np.all((low > 0) & (low < band.value[there]) & (band.value[there] < high))
        if name == "storage":
            assert np.mean((low < truth) & (truth < high)) > 0.85
        half = nodal.interval(name, 0.5)
        assert np.all((low < half.low[there]) & (half.high[there] < high))


def test_functions_of_nodal_maps(nodal):
    band, functions, there = nodal.interval("loss"), nodal.functions("loss"), nodal.problem.inside
    mesh = nodal.problem.elements.mesh
    assert functions["deviation"].space is nodal.problem.space
    for name, function in functions.items():
        at = [function(mesh(*point)) for point in nodal.data.points[there]]
        assert at == pytest.approx(getattr(band, name)[there], rel=1e-9)


def test_functions_of_higher_order(cubic):
    assert cubic.problem.space.globalorder == 2 and not cubic.problem.elements.nodal
    band = cubic.interval("storage")
    assert band.value == pytest.approx(cubic.found.maps["storage"], rel=1e-9)
    mesh = cubic.problem.elements.mesh
    corners = np.array([vertex.point for vertex in mesh.vertices])
    there = np.min(np.linalg.norm(cubic.data.points[:, None] - corners, axis=2), axis=1) < 1e-9
    assert there.sum() == len(corners)
    for name, function in cubic.functions("storage").items():
        at = np.array([function(mesh(*point)) for point in cubic.data.points])
        assert at[there] == pytest.approx(getattr(band, name)[there], rel=1e-6)
        off = np.sqrt(np.mean((at / getattr(band, name) - 1) ** 2))
        assert off < (0.3 if name == "deviation" else 0.02)  # which is no polynomial between nodes


def test_draws_have_the_bands(cubic):
    draws, band = cubic.draws(2000, seed=4)["loss"], cubic.interval("loss", 0.68)
    within = np.mean((draws > band.low) & (draws < band.high), axis=0)
    assert np.abs(within - 0.68).max() < 5 * np.sqrt(0.68 * 0.32 / 2000)
    assert draws.std(axis=0) == pytest.approx(band.deviation, rel=0.12)


def test_a_mean_is_known_better_than_points(nodal):
    band, mean = nodal.interval("storage"), nodal.mean("storage")
    assert mean.value == pytest.approx(np.nanmean(nodal.found.maps["storage"]))
    assert mean.deviation < 0.5 * np.nanmedian(band.deviation)
    one = np.arange(len(band.value)) == 30
    assert nodal.mean("storage", one).deviation == pytest.approx(band.deviation[30], rel=0.1)
    assert nodal.mean("storage", one).value == pytest.approx(band.value[30])


def test_labels_have_fields_and_means_of_their_own():
    data = Phantom.from_name("CE-G", 9).simulate_measurements(NOISE, seed=1).data()
    truth = np.real(data.truth_views["youngs"])
    data = replace(data, labels=(truth > truth.mean()).astype(int))
    found = bars(data, labelled=True)
    assert set(found.posterior.regularised) == {"youngs 0", "youngs 1"} and set(found.functions("youngs 1")) >= {
        "low",
        "high",
    }
    assert found.interval("youngs").value == pytest.approx(found.found.maps["youngs"], rel=1e-9)
    means = found.by_label["youngs"]
    assert set(means) == {0, 1}
    for label, mean in means.items():
        assert mean.low < mean.value < mean.high and mean.value == pytest.approx(
            np.mean(found.found.maps["youngs"][data.labels == label])
        )


def test_fields_taken_for_uniform_are_named(nodal):
    """The data determine two parameters of the loss: its intervals are those of a uniform loss, and miss the spot."""
    truth = Phantom.from_name("CV-G", 11).simulate_measurements().truth["loss"]
    assert nodal.posterior.effective_parameters["loss"] < 5 < nodal.posterior.effective_parameters["storage"]
    assert nodal.interval("loss").high[60] < truth[60]
    uniform = [note for note in nodal.notes if "nearly uniform" in note]
    assert len(uniform) == 1 and uniform[0].startswith("loss")


def values_of(bars, name):
    return {**bars.found.maps, **bars.found.derived_maps}[name]


def test_storage_and_loss_of_magnitude_and_phase():
    data = Phantom.from_name("CV-G", 9).simulate_measurements(NOISE, seed=1).data()
    found = bars(data, unknowns="polar")
    assert set(found.draws(10)) == {"storage", "loss"}
    phase = found.interval("phase")
    assert np.all((phase.low > 0) & (phase.high < np.pi / 2))
    other = bars(data)
    for name in ("storage", "loss"):
        assert found.mean(name).value == pytest.approx(other.mean(name).value, rel=0.1)
    assert set(found.result()) == {"storage", "loss"}
    for name in (*found.found.maps, *found.found.derived_maps):
        low, high = (found.arrays()[f"{name}_{end}"] for end in ("low", "high"))
        assert np.all(low < high) and np.mean((low < values_of(found, name)) & (values_of(found, name) < high)) > 0.99
    with pytest.raises(InputError, match="map is 'storage'"):
        found.interval("storage")


def test_bands_of_what_follows(nodal):
    arrays, there, maps = nodal.arrays(), nodal.problem.inside, nodal.found.derived_maps
    assert set(maps) == {"magnitude", "phase", "damping_ratio", "stiffness"}
    for name in maps:
        low, high = arrays[f"{name}_low"], arrays[f"{name}_high"]
        assert np.flatnonzero(np.isnan(low)).tolist() == [20]
        assert np.all((low < maps[name])[there] & (maps[name] < high)[there])
    # Of little loss the magnitude is about the storage modulus, and so are its bands.
    widths = [np.log(arrays[f"{name}_high"] / arrays[f"{name}_low"])[there] for name in ("magnitude", "storage")]
    assert np.median(widths[0]) == pytest.approx(np.median(widths[1]), rel=0.15)


def test_what_it_takes_is_known_before(nodal):
    solves, posterior = nodal.problem.model.solves, nodal.posterior
    before = solves.incremental
    uncertainty(nodal.found)
    done = (solves.incremental - before) / 2  # two solves a product, of one load
    assert count_hessian_products(nodal.found) == pytest.approx(done, rel=0.25)
    assert len(posterior.eigenvalues) > 0 and estimate_seconds(nodal.found) > 0
    with pytest.raises(InputError, match="zones or slices"):
        count_hessian_products(replace(nodal.found, final_state=None))


def test_bad_input(nodal):
    with pytest.raises(InputError, match="map is 'stoarge'; wanted: did you mean 'storage'"):
        nodal.interval("stoarge")
    with pytest.raises(InputError, match="map is 'stoarge'"):
        nodal.mean("stoarge")
    with pytest.raises(InputError, match="field is 'stoarge'"):
        nodal.functions("stoarge")
    with pytest.raises(InputError, match="where"):
        nodal.mean("storage", np.zeros(121, bool))
    with pytest.raises(InputError, match="zones"):
        uncertainty(replace(nodal.found, final_state=None))
