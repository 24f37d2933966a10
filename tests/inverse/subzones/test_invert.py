"""Waves inverted zone by zone: moduli of plane waves, the same in one process and in two, and after a stop; bad input."""

import json
import shutil
from dataclasses import replace

import ball_in_bar
import ngsolve as ngs
import numpy as np
import pytest
from planewaves import RHO, grid, shear_waves, wave_number

from ngbrain.errors import ConvergenceError, InputError, SolverError
from ngbrain.inverse.elastography.invert_3d import invert_in_space
from ngbrain.inverse.problem.voxel_lattice import build_lattice
from ngbrain.inverse.subzones.invert import ZoneSettings, _sizes_in_cells, invert_by_subzones
from ngbrain.io.waves import WaveData
from ngbrain.mesh import block
from ngbrain.workflows.property_maps import finite

SHEAR, HERTZ = 4000 + 1200j, 80.0
ZONES = {"size": 0.027, "overlap": 0.009, "max_iterations": 5}


def clean(points):
    """Three shear waves along the coordinates."""
    k = wave_number(SHEAR, HERTZ)
    return 1e-5 * np.stack([np.exp(-1j * k * points[:, i]) for i in (1, 2, 0)], axis=1)[None]


def wave_data(**changes):
    """A bar of two zones of one wave length, 2 % noise."""
    points = grid(16, 8, 8, spacing=3e-3)
    labels = (points[:, 0] > points[:, 0].mean()).astype(int)
    truth = {"shear": np.full(len(points), SHEAR)}
    kind = ("isotropic", "viscoelastic")
    data = WaveData(points, clean(points), [HERTZ], RHO, *kind, bulk=2e5, labels=labels, truth=truth)
    return replace(data.with_noise(0.02, seed=0), **changes)


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Inverted in two processes, and the folder of its checkpoints."""
    folder = tmp_path_factory.mktemp("zones")
    told = []
    return invert_by_subzones(wave_data(), **ZONES, executor=2, checkpoint=folder, callback=told.append), folder, told


def test_moduli_of_plane_waves(kept):
    found, _, told = kept
    assert np.median(found.maps["storage"]) == pytest.approx(SHEAR.real, rel=0.02)
    assert np.median(found.maps["loss"]) == pytest.approx(SHEAR.imag, rel=0.05)
    assert np.isfinite(found.maps["storage"]).all() and found.model["zones"] == 2
    assert {each.phase for each in told} == {f"zone {i} of 2{stage}" for i in (1, 2) for stage in ("", ", pass 1")}


def test_zones_come_to_agree(kept):
    found, _, _ = kept
    for name, part in (("storage", 0.7), ("loss", 0.95)):
        assert found.checks[f"disagreement_{name}"] < part * found.checks[f"disagreement_{name}_first"]


def test_joined_waves_are_nearer_to_the_true_ones_than_what_was_measured(kept):
    found, _, _ = kept
    residual, true = found.arrays()["residual"], clean(found.data.points)
    assert np.sum(np.abs(residual) ** 2) == pytest.approx(found.starts[-1].misfit)
    assert np.linalg.norm(found.predicted - true) < 0.9 * np.linalg.norm(found.data.displacement - true)
    assert 0.8 < found.checks["misfit_over_expected"] < 1.5  # three elements for a wave length
    assert 0.8 < found.checks["misfit_as_one_body"] < 2


def test_the_result_is_that_of_other_inversions(kept):
    found, _, _ = kept
    result = json.loads(json.dumps(finite(found.to_dict())))
    assert result["selected_start"] == "pass 1" and list(result["starts"]) == ["zones", "pass 1"]
    assert set(result["by_label"]["storage"]) == {"0", "1"} and result["answers"]["storage"]["relative_l2_error"] < 0.1
    assert result["solves"]["factorisations"] > 4 and result["model"]["form"] == "P3"


@pytest.mark.one_thread
@pytest.mark.slow
def test_a_stopped_inversion_goes_on_and_one_process_answers_as_two_did(kept):
    found, folder, _ = kept
    files = sorted(path.name for path in folder.iterdir())
    assert files == [f"zone-{i}-of-2{stage}.npz" for i in (1, 2) for stage in ("-pass-1", "")]
    (folder / "zone-2-of-2-pass-1.npz").unlink()
    told = []
    again = invert_by_subzones(wave_data(), **ZONES, checkpoint=folder, callback=told.append)
    assert {each.phase for each in told} == {"zone 2 of 2, pass 1"}
    for name, values in found.maps.items():
        np.testing.assert_array_equal(values, again.maps[name])


@pytest.mark.slow
def test_a_zone_that_finds_nothing_lower_keeps_what_it_had(kept, tmp_path, monkeypatch):
    def stuck(*_, **__):
        raise ConvergenceError("no step lowers the objective")

    found, folder, _ = kept
    for path in folder.glob("zone-?-of-2.npz"):
        shutil.copy(path, tmp_path)
    monkeypatch.setattr("ngbrain.inverse.subzones.invert.invert_with_consensus", stuck)
    again = invert_by_subzones(wave_data(), **ZONES, checkpoint=tmp_path)
    np.testing.assert_array_equal(again.maps["storage"], found.starts[0].maps["storage"])
    alone = invert_by_subzones(wave_data(), **ZONES, passes=0, checkpoint=tmp_path)
    assert again.solves == alone.solves and alone.solves.checks > 0  # what was found before is not counted again


def test_a_checkpoint_of_another_problem(kept):
    _, folder, _ = kept
    with pytest.raises(InputError, match=r"^zone 1 of 2: checkpoint is .*another problem; wanted: the same data"):
        invert_by_subzones(wave_data(), **ZONES, noise=0.03, checkpoint=folder)


def test_a_zone_that_fails_is_named(monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr("ngbrain.inverse.subzones.invert.invert_in_space", broken)
    with pytest.raises(SolverError, match=r"^zone 1 of 2: ZeroDivisionError: by nothing$"):
        invert_by_subzones(wave_data(), **ZONES)


@pytest.mark.parametrize(
    ("changes", "choices", "words"),
    [
        ({}, {"size": 0.015}, "^size is 0.015; wanted: 0.0"),
        ({}, {"size": -1.0}, "^size is -1.0"),
        ({}, {"overlap": np.nan}, "^overlap is nan"),
        ({}, {"noise": -0.1}, "^noise is -0.1"),
        ({}, {"passes": -1}, "^passes is -1; wanted: at least 0"),
        ({}, {"executor": 0}, "^executor is 0"),
        ({"labels": None}, {"labelled": True}, "^labels is not given"),
        ({"frequency": [0.0]}, {"size": None}, "^size or overlap is not given.*quasi-static"),
        ({"mask": np.isin(np.arange(1024) % 16, (0, 1, 2, 6, 7, 8)), "dirichlet": None}, {}, "^mask is .*small pieces"),
    ],
)
def test_bad_input(changes, choices, words):
    with pytest.raises(InputError, match=words):
        invert_by_subzones(wave_data(**changes), **{**ZONES, **choices})


@pytest.mark.parametrize(("spacing", "side", "shared"), [(2e-3, 5, 2), (9e-3, 3, 1)])
def test_zones_by_default(spacing, side, shared):
    """Along the bar five elements of a third of a wavelength, with an overlap of two; three where voxels are that large."""
    points = grid(26, 12, 12, spacing=spacing)
    data = WaveData(points, clean(points), [HERTZ], RHO, "isotropic", "viscoelastic", bulk=2e5)
    assert [each[0] for each in _sizes_in_cells(data, build_lattice(data, "P3"), None, None)] == [side, shared]


def test_data_in_the_plane():
    points = grid(12, 12, spacing=3e-3)
    data = WaveData(points, shear_waves(points, SHEAR)[None], [50.0], RHO, "isotropic", "viscoelastic", poisson=0.4)
    with pytest.raises(InputError, match="points is in the plane"):
        invert_by_subzones(data)


def test_a_checkpoint_that_is_no_folder(tmp_path):
    (tmp_path / "taken").write_text("by a file")
    with pytest.raises(InputError, match=r"checkpoint is .*taken; wanted: a folder"):
        invert_by_subzones(wave_data(), **ZONES, checkpoint=tmp_path / "taken")


@pytest.mark.slow
def test_zones_find_a_ball_that_their_cut_goes_through_as_one_inversion_does():
    data = ball_in_bar.wave_data()
    whole, zones = invert_in_space(data), invert_by_subzones(data, executor=2)
    away = ball_in_bar.away(data.points)
    inside, outside = away < ball_in_bar.RADIUS - 3e-3, away > ball_in_bar.RADIUS + 3e-3
    assert zones.model["zones"] == 2
    for name, median, rms in (("storage", 0.02, 0.02), ("loss", 0.02, 0.03)):
        off = np.log(zones.maps[name] / whole.maps[name])
        assert abs(np.median(off[inside])) < median and abs(np.median(off[outside])) < 0.01
        assert np.sqrt(np.mean(off**2)) < rms
        assert zones.checks[f"disagreement_{name}"] < 0.6 * zones.checks[f"disagreement_{name}_first"]
    assert zones.checks["misfit_as_one_body"] < 1.05 * whole.checks["misfit_over_expected"]


def test_weights_mean_the_same_in_a_zone_as_in_the_body():
    """A gradient has the same energy in two halves as in the whole."""
    sides = np.array([0.04, 0.02, 0.02])
    whole, half = (block(tuple(sides / (share, 1, 1)), maxh=0.01) for share in (1, 2))
    common = ZoneSettings(float(sides[0]), False, 1, None)

    def cost(mesh):
        space = ngs.H1(mesh, order=1)
        field = ngs.GridFunction(space)
        field.Set(100 * ngs.x)
        return common.prior(space, np.zeros(space.ndof)).value(field.vec.FV().NumPy())

    assert 2 * cost(half) == pytest.approx(cost(whole), rel=0.02)
    assert cost(whole) == pytest.approx(0.5 * 100**2 * np.prod(sides) / sides[0], rel=0.02)
