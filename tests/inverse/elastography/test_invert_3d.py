"""Wave data in space: a stiff ball found with 2 % noise, with labels and without; elements over masks; bad input."""

from dataclasses import replace

import ngsolve as ngs
import numpy as np
import pytest
from ball_in_block import MIDDLE, RADIUS, SIDE, SOFT, STIFF, between, wave_data
from scipy.spatial.transform import Rotation
from synthetic_waves import waves

from ngbrain.errors import InputError
from ngbrain.inverse.elastography.invert import invert
from ngbrain.inverse.elastography.invert_3d import _points_per_node, invert_in_space
from ngbrain.inverse.problem.discretisation import discretise
from ngbrain.inverse.problem.properties import material_properties
from ngbrain.inverse.problem.wave_problem import ElastographyProblem
from ngbrain.io.waves import WaveData


def medians(data, modulus):
    """Medians inside the ball and in the rest of the block, away from the interface."""
    away = np.linalg.norm(data.points - MIDDLE, axis=1)
    return np.median(modulus[away < RADIUS - 3e-3]), np.median(modulus[away > RADIUS + 3e-3])


@pytest.mark.slow
def test_a_ball_with_its_label(tmp_path):
    data = between((0.004, 0.004, 0.004), (0.034, 0.034, 0.034))
    stopped = invert_in_space(data, labelled=True, max_iterations=2, checkpoint=tmp_path / "part.npz")
    assert not stopped.checks["converged"]
    found = invert_in_space(data, labelled=True, max_iterations=6, checkpoint=tmp_path / "part.npz")
    stiff, soft = medians(data, found.maps["storage"])
    assert soft == pytest.approx(SOFT.real, rel=0.03)
    assert stiff / soft == pytest.approx(2, rel=0.15)
    assert medians(data, found.maps["loss"])[1] == pytest.approx(SOFT.imag, rel=0.05)
    ways = {name: {row.name: row for row in each.starts} for name, each in (("stopped", stopped), ("found", found))}
    assert found.checks["converged"] and 3 <= len(ways["found"]["both"].history) <= 6
    before = ways["stopped"]["both"].history
    assert [each.misfit for each in ways["found"]["both"].history[:2]] == [each.misfit for each in before]
    np.testing.assert_array_equal(ways["found"]["waves"].maps["loss"], ways["stopped"]["waves"].maps["loss"])
    assert ways["found"]["waves"].misfit > ways["found"]["both"].misfit and ways["found"]["waves"].history
    assert found.by_label["storage"][1]["median"] == pytest.approx(STIFF.real, rel=0.2)
    assert found.checks["misfit_over_expected"] < 1.5


def test_from_measured_waves_fields_and_waves_find_each_other():
    data, told = wave_data(), []
    invert_in_space(data, discretise(data, order=2), max_iterations=1, callback=told.append)
    way = [each.misfit / each.expected for each in told if each.phase == "waves"]
    assert way[0] > 5 and way[-1] < 3


@pytest.mark.slow
def test_two_components_of_three_find_a_ball_too():
    data = wave_data()
    displacement = data.displacement.copy()
    displacement[:, :, 0] = np.nan
    found = invert_in_space(replace(data, displacement=displacement))
    stiff, soft = medians(data, found.maps["storage"])
    assert soft == pytest.approx(SOFT.real, rel=0.05) and 1.6 < stiff / soft < 2.2
    off = np.log(np.abs(found.maps["storage"] + 1j * found.maps["loss"]) / np.abs(data.truth["shear"]))
    assert np.sqrt(np.mean(off**2)) < 0.2  # .15 with all three


@pytest.mark.slow
def test_uniform_fields_arrive_too_and_the_lower_end_is_kept(tmp_path):
    data, path = between((0.0, 0.0, 0.01), (0.04, 0.04, 0.031)), tmp_path / "part.npz"
    elements = discretise(data, order=2)
    found = invert_in_space(data, elements, levels=(0.7, 1.0), max_iterations=4, checkpoint=path)
    assert [row.name for row in found.starts] == ["waves", "uniform", "both"]
    _, uniform, both = found.starts
    assert uniform.value == pytest.approx(both.value, rel=0.1)
    assert found.chosen == ("uniform" if uniform.value < both.value else "both")
    assert np.median(uniform.maps["storage"]) == pytest.approx(np.median(both.maps["storage"]), rel=0.05)
    assert any("uniform fields ended at" in note for note in found.warnings)
    assert {each.name for each in tmp_path.iterdir()} == {
        f"part{stage}.npz" for stage in ("", "-uniform-0.7", "-uniform-1")
    }


@pytest.mark.one_thread
@pytest.mark.slow
def test_starts_side_by_side_are_the_same_to_the_last_bit_and_go_on(tmp_path, caplog):
    line, path = np.arange(8) * 3e-3, tmp_path / "part.npz"
    points = np.array([[x, y, z] for z in line for y in line for x in line])
    waves = 1e-5 * np.stack([np.exp(-(200 - 50j) * 1j * points[:, i]) for i in (1, 2, 0)], axis=1)[None]
    data = WaveData(points, waves, [80.0], 1000.0, "isotropic", "viscoelastic", bulk=2e5).with_noise(0.02, seed=0)
    ways = {"levels": (1.0,), "max_iterations": 2, "drop_outliers": False}
    alone, both = invert_in_space(data, **ways), invert_in_space(data, **ways, executor=2, checkpoint=path)
    again = invert_in_space(data, **ways, checkpoint=path)
    assert both.solves == alone.solves and [row.value for row in both.starts] == [row.value for row in alone.starts]
    for name, values in alone.maps.items():
        np.testing.assert_array_equal(both.maps[name], values)
        np.testing.assert_array_equal(again.maps[name], values)
    assert again.solves.incremental < 0.5 * both.solves.incremental  # each way was there
    assert "in this process" not in caplog.text


def test_loads_start_each_by_what_is_measured_of_it():
    data = wave_data()
    u = data.displacement.copy()
    u[1, ::2, 0] = np.nan
    data = replace(data, displacement=u)
    elements = discretise(data, order=1)
    both = ElastographyProblem(data, elements).waves
    for k in (0, 1):
        alone = replace(data, displacement=u[[k, k]])
        assert np.allclose(
            ElastographyProblem(alone, elements, material_properties(data)).waves[1], both[k], rtol=1e-6, atol=1e-12
        )


def test_killed_on_its_way_from_measured_waves_it_goes_on_there(tmp_path):
    data, first, second, path = between((0, 0, 0), (0.022, 0.022, 0.022)), [], [], tmp_path / "way.npz"
    elements = discretise(data, order=1)
    whole = invert_in_space(data, elements, max_iterations=1, callback=first.append)

    def killed(each):
        if each is not None and path.exists():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):  # in the second round: what the first one found is written
        invert_in_space(data, elements, max_iterations=1, checkpoint=path, callback=killed)
    again = invert_in_space(data, elements, max_iterations=1, checkpoint=path, callback=second.append)
    assert len(first) >= 2 and len(second) == len(first) - 1
    assert [each.misfit for each in second] == pytest.approx([each.misfit for each in first[1:]], rel=0.01)
    assert np.allclose(again.maps["storage"], whole.maps["storage"], rtol=0.05)


@pytest.mark.slow
def test_a_ball_of_which_nothing_is_known():
    data = wave_data()
    found = invert(data)  # data in space find their way
    stiff, soft = medians(data, found.maps["storage"])
    assert soft == pytest.approx(SOFT.real, rel=0.05)
    assert stiff / soft == pytest.approx(2, rel=0.2)


def test_elements_cover_a_mask_and_leave_a_hollow_open():
    data = wave_data()
    away = np.linalg.norm(data.points - MIDDLE, axis=1)
    hollow = replace(data, mask=away > 0.011, dirichlet=None)
    elements = discretise(hollow, order=1)
    volume = ngs.Integrate(1, elements.mesh)
    extent = np.ptp(data.points, axis=0).prod()
    assert volume == pytest.approx(extent - 4 / 3 * np.pi * 0.011**3, rel=0.1)
    assert elements.inside[hollow.mask].mean() > 0.95 and not elements.inside[~hollow.mask].any()
    whole = discretise(data)
    assert whole.form == "P3" and whole.inside.all()
    assert ngs.Integrate(1, whole.mesh) == pytest.approx(extent)
    assert extent == pytest.approx((SIDE - 0.004) ** 3, rel=0.2)


def test_tissue_that_hardly_changes_its_volume_gets_a_pressure():
    data = replace(wave_data(), bulk=None, poisson=0.4999)
    assert discretise(data).form == "P3/P2"


@pytest.fixture
def no_work(monkeypatch):
    def work(*_, **__):
        raise AssertionError("minutes of work were begun")

    monkeypatch.setattr("ngbrain.inverse.elastography.invert.invert_in_space", work)
    monkeypatch.setattr("ngbrain.inverse.elastography.invert_3d.discretise_volume", work)


@pytest.mark.parametrize(
    "choices, words",
    [
        ({"weight": "l-curve"}, "weight"),
        ({"noise": -1.0}, "noise"),
        ({"regulariser": "smoth"}, "regulariser"),
    ],
)
def test_bad_choices(no_work, choices, words):
    with pytest.raises(InputError, match=words):
        invert(wave_data(), **choices)


@pytest.mark.parametrize(
    "choices, words",
    [
        ({"noise": -1.0}, "noise"),
        ({"max_iterations": 0}, "max_iterations is 0"),
        ({"model_error": np.nan}, "model_error"),
        ({"regulariser": "auto"}, "regulariser is 'auto'"),
        ({"levels": (0.5, -2.0)}, "levels"),
        ({"regulariser": "smoth"}, "regulariser is 'smoth'"),
    ],
)
def test_bad_choices_of_its_own(no_work, choices, words):
    with pytest.raises(InputError, match=words):
        invert_in_space(wave_data(), **choices)


def test_data_in_the_plane_are_not_for_it(no_work):
    with pytest.raises(InputError, match="in the plane"):
        invert_in_space(waves(n=9))


@pytest.mark.parametrize("loads", [0, slice(None)])
def test_one_component_is_not_enough(loads):
    data = wave_data()
    axial = data.displacement.copy()
    axial[loads, :, :2] = np.nan
    with pytest.raises(InputError, match="one component alone is measured; wanted: two of them"):
        invert_in_space(replace(data, displacement=axial), discretise(data, order=1))


def test_labels_that_are_not_there():
    with pytest.raises(InputError, match="labels"):
        invert(replace(wave_data(), labels=None), labelled=True)


def voxels(spacing, turn, side=0.048):
    """Points of a block of such voxels in a ball, and the data."""
    lines = [np.arange(0, side + h / 2, h) for h in spacing]
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).transpose(2, 1, 0, 3).reshape(-1, 3)
    u = 1e-5 * np.stack([np.exp(-2j * np.pi * points[:, i] / 8e-3) for i in (1, 2, 0)], axis=1)[None]
    ball = np.linalg.norm(points - side / 2, axis=1) < 0.021
    return ball, WaveData(points @ turn, u, [50.0], 1000.0, "isotropic", "viscoelastic", bulk=2e5)


@pytest.fixture
def short_waves(monkeypatch):
    """Fix the wavelength at 8 mm for any data: elements are then as small as voxels allow."""
    monkeypatch.setattr(
        "ngbrain.inverse.problem.voxel_lattice.uniform_shear", lambda data: data.density * (50.0 * 8e-3) ** 2
    )


TURNED = Rotation.from_euler("xyz", (5, 80, 5), degrees=True).as_matrix()


@pytest.mark.parametrize(
    "spacing", [pytest.param((2e-3,) * 3, marks=pytest.mark.slow), (2e-3, 2e-3, 6e-3), (6e-3, 1.5e-3, 3e-3)]
)
@pytest.mark.parametrize("kind", ["masked", "turned", "left over"])
def test_elements_cover_long_voxels_too(short_waves, spacing, kind):
    """For a known grid or only its remaining points, aligned with the coordinates or not."""
    ball, data = voxels(spacing, TURNED if kind == "turned" else np.eye(3))
    if kind == "left over":
        chosen = replace(
            data, points=data.points[ball], displacement=data.displacement[:, ball], mask=None, dirichlet=None
        )
    else:
        chosen = replace(data, mask=ball, dirichlet=None)
    assert (chosen.grid is None) == (kind == "left over")
    elements = discretise(chosen, 1)
    assert elements.inside[chosen.mask].mean() > 0.98 and not elements.inside[~chosen.mask].any()
    assert ngs.Integrate(1, elements.mesh) == pytest.approx(1.25 * 4 / 3 * np.pi * 0.021**3, rel=0.1)


def test_elements_are_no_shorter_than_voxels(short_waves):
    data = voxels((2e-3, 2e-3, 6e-3), np.eye(3))[1]
    assert discretise(data, 2).mesh.ne == 12 * 12 * 4


@pytest.mark.parametrize("n, order", [(11, 1), (12, 2), (31, 3)])
def test_elements_of_a_block_are_all_there(n, order):
    """Also where samples lie halfway between points."""
    line = np.linspace(0, 0.002 * (n - 1), n)
    points = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).transpose(2, 1, 0, 3).reshape(-1, 3)
    k = 2 * np.pi * 50 / 1.5
    u = 1e-5 * np.stack([np.exp(-1j * k * points[:, i]) for i in (1, 2, 0)], axis=1)[None]
    data = WaveData(points, u, [50.0], 1000.0, "isotropic", "viscoelastic", bulk=2e5)
    elements = discretise(data, order)
    assert elements.inside.all()
    assert ngs.Integrate(1, elements.mesh) == pytest.approx(line[-1] ** 3)


@pytest.mark.parametrize("order", [1, 2])
def test_points_for_each_node(order):
    data = wave_data()
    experiment = ElastographyProblem(data, discretise(data, order=order))
    nodes = ngs.H1(experiment.body.mesh, order=order).ndof
    assert _points_per_node(experiment) == pytest.approx(len(experiment.model.points) / nodes)
