"""The page of an inversion: planes, text and numbers, from synthetic results without a solve."""

import re

import numpy as np
import pytest
from planewaves import grid, shear_waves, waves

from ngbrain.report.pages import elastography, parameters
from ngbrain.report.pictures.planes import planes

SHEAR = 2000 + 800j


def arrays_of(data, storage=2000.0):
    n = len(data.points)
    noise = np.random.default_rng(0).standard_normal((2, *data.displacement.shape))
    maps = {"storage": np.full(n, storage), "loss": np.full(n, 800.0)}
    follows = {name: np.linspace(1, 2, n) for name in elastography.DERIVED}
    u = data.displacement
    return {
        "points": data.points,
        **maps,
        **follows,
        "measured": u,
        "predicted": u,
        "residual": noise[0] + 1j * noise[1],
        **{name: np.tile(np.linspace(1e-3, 2e-3, n), (data.loads, 1)) for name in ("oss", "oss_snr")},
    }


def result_of(data, **changes):
    answers = {
        "storage": {"median": 2000.0, "iqr": 10.0, "relative_l2_error": 0.05},
        "loss": {"median": 800.0, "iqr": 20.0, "relative_l2_error": 0.1},
    }
    count = 2.0 * data.displacement.size
    start = {
        "misfit": count, "expected_misfit": count, "objective": 3.0, "iterations": 2, "cpu_s": 1.0, "converged": True,
        "answers": answers, "misfit_over_expected": [9.0, 1.0], "weights": [{"storage": 1.0, "loss": 2.0}] * 2,
    }  # fmt: skip
    model = {
        "form": "P3", "n_elements": 9, "n_unknowns": 99, "n_parameters": 8, "inverse_crime": False,
        "regulariser": "smooth", "weights": {"storage": 1.0, "loss": 2.0}, "effective_dof": {"storage": 4.0, "loss": 2.0},
        "resolution_mm": {"storage": 5.0, "loss": 7.0},
    }  # fmt: skip
    return {
        "source": "waves.npz", "answers": answers, "by_label": {}, "solves": {"factorisations": 3},
        "checks": {"misfit_over_expected": 1.0, "strain_snr": 12.0}, "model": model,
        "noise": {"assumed": 0.02, "estimated": 0.021}, "starts": {"waves": start, "both": start}, "selected_start": "both",
        "warnings": ["a thing to know"], "time_s": 3.0, "threads": 1, "versions": {"ngbrain": "0"}, "files": ["maps.npz"],
        **changes,
    }  # fmt: skip


@pytest.fixture
def plane():
    points = grid(8, 6)
    return waves(points, shear_waves(points, SHEAR), truth={"shear": np.full(48, SHEAR)})


def test_a_page_opens_alone_and_says_what_was_found(tmp_path, plane):
    page = elastography.build(tmp_path / "report.html", result_of(plane), plane, arrays_of(plane)).read_text()
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    pictures = re.findall(r'<img alt="[^"]+" src="data:image/png;base64,[A-Za-z0-9+/=]{1000,}"', page)
    assert len(pictures) == 6 and page.count("<img") == 6 and not re.search(r"https?:|<script src|<link", page)
    for words in ("waves.npz", "A thing to know.", "2.00", "5.00 %", "10.0 %", "measured waves, then descent, kept",
                  "Load 1, 50 Hz", "grid of 8 × 6", "fixed at 0.49", "2.10 % estimated", "G′ 5.0 mm"):  # fmt: skip
        assert words in page, words
    assert "<th>Label</th>" not in page


def test_labels_are_in_order_of_their_numbers(plane):
    found = {
        "storage": {"10": {"median": 900.0, "iqr": 5.0}, "2": {"median": 3100.0, "iqr": 50.0}},
        "loss": {"2": {"median": 0.0, "iqr": 0.0}},
        "phase": {"10": {"median": 0.2, "iqr": 0.01}},
    }
    result = result_of(plane, by_label=found)
    assert parameters.label_heads(result) == ["G′ (kPa)", "arg G* (rad)"]  # what is nothing everywhere is not shown
    assert [(row.name, row.cells) for row in parameters.labels(result)] == [
        ("2", [("3.10", "0.0500"), ("–", "–")]), ("10", [("0.900", "0.00500"), ("0.200", "0.0100")]),
    ]  # fmt: skip


def test_without_truth_no_error_is_shown(tmp_path, plane):
    blind = waves(plane.points, plane.displacement)
    answers = {name: {"median": 1.0, "iqr": 1.0} for name in ("storage", "loss")}
    spreads = {name: {"2": answers["loss"]} for name in answers}
    result = result_of(blind, answers=answers, by_label=spreads)
    for start in result["starts"].values():
        start["answers"] = answers
    page = elastography.build(tmp_path / "report.html", result, blind, arrays_of(blind)).read_text()
    assert "<th>Label</th>" in page and "truth" not in page.lower() and '<th class="n">Error</th>' not in page


def test_error_bars_are_drawn_and_stand_in_the_first_table(tmp_path, plane):
    bands = {f"{name}_{end}": np.full(48, by * value) for name, value in (("storage", 2000.0), ("loss", 800.0)) for end, by in
             (("low", 0.9), ("high", 1.1))}  # fmt: skip
    mean = {"value": 2000.0, "deviation": 10.0, "low": 1980.0, "high": 2020.0}
    result = result_of(plane, error_bars={"storage": {"mean": mean, "by_label": {}}})
    text = elastography.build(tmp_path / "report.html", result, plane, arrays_of(plane) | bands).read_text()
    table = text.split(">Parameters</h2>")[1].split(">Maps</h2>")[0]
    assert "Mean (95 % interval)" in table and "2.000 (1.980 to 2.020)" in table
    assert "half its width" in text
    bare = elastography.build(tmp_path / "bare.html", result_of(plane), plane, arrays_of(plane)).read_text()
    assert "95 %" not in bare and "half its width" not in bare


@pytest.mark.parametrize("scattered", [False, True])
def test_space_is_drawn_on_its_middle_planes(scattered):
    points = grid(9, 8, 7)
    if scattered:
        points = points + np.random.default_rng(1).uniform(-2e-4, 2e-4, points.shape)
    data = waves(points, shear_waves(points, SHEAR))
    found = planes(data)
    assert [plane.axes for plane in found] == [("y", "z"), ("x", "z"), ("x", "y")]
    middle = 1e3 * np.ptp(points, axis=0) / 2
    for normal, plane in enumerate(found):
        assert plane.name.startswith(f"{'xyz'[normal]} = ") and (plane.shape is None) == scattered
        off = 1e3 * points[plane.chosen, normal] - middle[normal]
        assert len(off) >= 56 and np.abs(off).max() < 1.7 and (scattered or np.ptp(off) < 1e-9)
    assert elastography.maps(result_of(data), data, arrays_of(data), found)[:4] == b"\x89PNG"


def test_images_stand_upright():
    points = grid(4, 3)
    data = waves(points, np.ones((12, 2)) * 1e-6)
    (plane,) = planes(data)
    assert plane.shape == (4, 3)
    from matplotlib.figure import Figure

    axes = Figure().add_subplot()
    shown = plane.draw(axes, np.arange(12.0), {"cmap": "viridis", "vmin": 0, "vmax": 11})
    x, y = shown.get_coordinates()[1, 3, :] - shown.get_coordinates()[0, 0, :]
    assert x > 0 and y > 0 and shown.get_array().ravel()[:5].tolist() == [0, 4, 8, 1, 5]


def test_a_grid_whose_coordinates_are_rounded_is_an_image_all_the_same():
    """Also for rotated grids: cells lie around their points. Matplotlib warns of centres with round-off."""
    from matplotlib.figure import Figure

    points, (c, s) = grid(5, 4), (np.cos(0.3), np.sin(0.3))
    points = points @ np.array([[c, s], [-s, c]]) * (1 + 1e-15 * np.random.default_rng(0).standard_normal(points.shape))
    for at in (grid(5, 4) + 1e-15 * np.random.default_rng(1).standard_normal(points.shape), points):
        (plane,) = planes(waves(at, np.ones((20, 2)) * 1e-6))
        corners = plane.draw(Figure().add_subplot(), np.arange(20.0), {"cmap": "viridis"}).get_coordinates()
        middles = (corners[1:, 1:] + corners[1:, :-1] + corners[:-1, 1:] + corners[:-1, :-1]) / 4
        assert np.allclose(middles, 1e3 * at.reshape(5, 4, 2, order="F"), rtol=0, atol=1e-9)


def test_triangles_do_not_cross_a_hole():
    points = grid(20, 20)
    points = points + np.random.default_rng(2).uniform(-3e-4, 3e-4, points.shape)
    hole = np.linalg.norm(points - points.mean(axis=0), axis=1) < 10e-3
    data = waves(points, shear_waves(points, SHEAR), mask=~hole)
    (plane,) = planes(data)
    middles = plane.at[plane.triangles].mean(axis=1)
    assert not hole[plane.triangles].any()
    assert np.linalg.norm(middles - 1e3 * points.mean(axis=0), axis=1).min() > 8.0


def test_motion_through_a_plane_needs_no_poissons_ratio():
    u = 1e-6 * np.ones((1, 9, 1))
    data = waves(grid(3, 3), u, poisson=None, motion="anti_plane")
    assert "out-of-plane motion, incompressible" in dict(elastography.data_facts(data))["Material"]
