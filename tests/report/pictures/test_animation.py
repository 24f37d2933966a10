"""The animation of synthetic runs: states, times and positions in the picture."""

import io
from dataclasses import replace
from pathlib import Path

import netgen.occ as occ
import ngsolve as ng
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.image import imread
from PIL import Image

from ngbrain.io import Frame, QuadraticGrid, save
from ngbrain.report.pictures import animation, style
from ngbrain.report.pictures.timeline import Run

OUT, ACROSS = np.array([0, 0, 1.0]), np.array([1.0, 0, 0])
GEOMETRY = {
    "target_m": [0.0, 0.0, 0.0],
    "out": OUT.tolist(),
    "across": ACROSS.tolist(),
    "depth_m": 0.03,
    "opening_m": 0.004,
    "width_m": 0.012,
    "craniotomy_m": 0.04,
    "blade": {
        "kind": "spatula",
        "width_m": 0.01,
        "tip_clearance_m": 0.02,
        "thickness_m": 0.002,
        "edge_radius_m": 0.001,
    },
}
HALF = 0.01
"""Of a cube of tissue around the target (m); the blade ends above it."""
SHIFT = 6e-3
"""Displacement (m) across, linear in time; the blade moves half as far."""
ENDS = {"long": 8.0, "short": 4.0}
FRAMES = {"long": (0.0, 2.0, 8.0), "short": (0.0, 1.0, 4.0)}
SCALE = style.StrainScale.up_to(0.36)
PEAK = {"long": 6.0, "short": 2.0}


def gone(t, name):
    return SHIFT * t / ENDS[name]


def strained(t, name):
    """Strains from 3 to 36 %."""
    return 0.03 + 0.33 * t / ENDS[name]


def answer(name):
    t = np.array([0.0, PEAK[name], ENDS[name]])
    pressure = {"long": [0.0, 40.0, 10.0], "short": [0.0, 90.0, 30.0]}[name]
    advance = 1e3 * gone(t, name) / 2
    series = {"t_s": t.tolist(), "opening_mm": (0.9 * advance).tolist(), "blade_mm": advance.tolist()}
    return {"series": series | {"pressure_mmHg": pressure}}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder: Path = tmp_path_factory.mktemp("runs")
    cube = occ.Box((-HALF, -HALF, -HALF), (HALF, HALF, HALF))
    cube.mat("white"), setattr(cube.faces, "name", "floor")
    grid = QuadraticGrid(ng.Mesh(occ.OCCGeometry(cube).GenerateMesh(maxh=0.01)))
    one = np.ones(len(grid.points))
    for name, times in FRAMES.items():
        frames = [
            Frame(t, {"displacement": np.outer(one, gone(t, name) * ACROSS), "max_principal_strain": strained(t, name) * one})
            for t in times
        ]  # fmt: skip
        save(folder / f"{name}.vtkhdf", grid, frames, {"peak": {"t": 1.2}})
    return {name: Run.read(folder, name, GEOMETRY, answer(name)) for name in FRAMES}


@pytest.fixture(scope="module")
def film(runs):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style, "DPI", 75)
        return animation.animation(runs, {name: answer(name) for name in runs}, SCALE)


def test_a_run_is_at_its_frames_and_between_them_in_proportion(runs):
    run = runs["long"]
    for t, now in ((-1.0, 0.0), (0.0, 0.0), (1.0, 1.0), (2.0, 2.0), (6.5, 6.5), (8.0, 8.0), (99.0, 8.0)):
        state = run.frame_at(t)
        assert state.time == now and state.rest is run.grid.points
        assert state.points - state.rest == pytest.approx(np.outer(np.ones(len(state.rest)), [gone(now, "long"), 0, 0]))
        assert state.strain == pytest.approx(strained(now, "long"))
        (blade,) = state.blades
        assert blade.profile()[:, 0].max() == pytest.approx(GEOMETRY["opening_m"] / 2 + gone(now, "long") / 2)


def test_at_its_peak_a_run_is_at_the_frame_nearest_to_it(runs):
    assert [run.peak().time for run in runs.values()] == [2.0, 1.0]


def test_moments_are_the_frames_of_all(film):
    assert [moment.t for moment in film.frames] == [0.0, 1.0, 2.0, 4.0, 8.0]


def test_moments_say_the_time_and_what_each_protocol_has_then(film):
    texts = [moment.text for moment in film.frames]
    assert texts[2] == "2 s after first contact. long: 0.7 mm, 13 mmHg; short: 1.4 mm, 90 mmHg"
    assert texts[3] == "4 s after first contact. long: 1.4 mm, 27 mmHg; short: 2.7 mm, 30 mmHg"
    assert texts[4] == "8 s after first contact. long: 2.7 mm, 10 mmHg; short: 2.7 mm, 30 mmHg (ended, 4 s)"
    assert film.start == 2  # 90 mmHg


def panels(moment):
    """Both halves of the picture (rows, columns, 3), and mm per pixel."""
    picture = np.asarray(Image.open(io.BytesIO(moment.picture)).convert("RGB"), float) / 255
    wide = picture.shape[1]
    assert wide == round(style.WIDTH * 75 * animation.SHARE)
    scale = 2e3 * animation.REACH * style.WIDTH / animation.HEIGHT / wide
    return (picture[:, : int(0.4625 * wide)], picture[:, int(0.4625 * wide) : int(0.925 * wide)]), scale


@pytest.mark.parametrize("number", range(5))
def test_each_panel_shows_its_own_run_at_the_moments_time(film, number):
    """Strain by its colour, displacement by the position of the right face of the cube."""
    moment, start = film.frames[number], film.frames[0]
    (shown, scale), (first, _) = panels(moment), panels(start)
    for name, picture, still in zip(ENDS, shown, first, strict=True):
        t = min(moment.t, ENDS[name])
        inside = []
        for image, time in ((picture, t), (still, 0.0)):
            wanted = np.array(SCALE.cmap(SCALE.norm(strained(time, name)))[:3])
            columns = np.flatnonzero((np.abs(image - wanted) < 0.02).all(axis=2).sum(axis=0) > 5)
            inside.append(columns)
        assert len(inside[0]) * scale == pytest.approx(2e3 * HALF, abs=3 * scale)
        assert (inside[0].max() - inside[1].max()) * scale == pytest.approx(1e3 * gone(t, name), abs=1.5 * scale)


def test_the_mark_is_where_the_curves_have_that_time(film):
    """The steepest pressure curve, of the short run, has its peak at 2 s."""
    (axis,) = film.axes
    picture = imread(io.BytesIO(film.curves), format="png")[..., :3]
    height, width, _ = picture.shape
    dark = (picture[int((axis.top + 0.5 * axis.height) * height)] < 0.3).all(axis=1)
    assert np.flatnonzero(dark)[0] == pytest.approx(axis.left * width, abs=1.5)  # the axis of pressures, t = 0
    wanted = np.array([int(style.colour("short", ENDS)[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    rows, columns = np.nonzero((np.abs(picture - wanted) < 0.1).all(axis=2))
    assert columns[rows == rows.min()].mean() == pytest.approx(axis.position(2.0) * width, abs=1.5)
    assert axis.position(ENDS["long"]) == pytest.approx(axis.left + axis.width)


def test_many_frames_are_thinned_evenly_in_time_and_way():
    """A ramp of 1 s and a hold of 99 s with 500 frames each: half of the combined measure belongs to the ramp."""
    times = np.unique(np.concatenate([np.linspace(0, 1, 500), np.linspace(1, 100, 500)]))

    class Made:
        def __init__(self):
            self.times, self.advance = times, (np.array([0.0, 1.0, 100.0]), np.array([0.0, 5e-3, 5e-3]))

    chosen = animation.times([Made(), Made()])
    assert set(chosen) <= set(times) and (chosen[0], chosen[-1]) == (0.0, 100.0)
    assert len(chosen) == animation.MOST and np.count_nonzero(chosen <= 1) == pytest.approx(animation.MOST / 2, abs=2)


def test_long_names_stay_over_their_own_panel(runs):
    name = "Two mm now and SIX mm more after Many long minutes"
    states = [replace(run, protocol=one).frame_at(1.0) for run, one in zip(runs.values(), (name, "b"), strict=True)]
    titles = {name: "0.0 mm, 0 mmHg", "b": "2.0 mm, 9 mmHg"}
    page = animation._panels([*states, states[1]], titles, {name: {}, "b": {}}, SCALE)
    axes = page.axes[0]
    (title,) = (text for text in axes.texts if text.get_text() == name)
    assert 0.3 < title.get_window_extent(FigureCanvasAgg(page).get_renderer()).width / axes.bbox.width < 1
