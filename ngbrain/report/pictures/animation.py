"""Protocols side by side on one slice: each at its peak, and all of them at equal times as an animation."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ngbrain.adjoint.time_curve import TimeCurve
from ngbrain.errors import require
from ngbrain.report.pictures import style as looks
from ngbrain.report.pictures.cut_plane import CutPlane
from ngbrain.report.pictures.figures import pressures, spans
from ngbrain.report.pictures.frame import DeformedHead
from ngbrain.report.pictures.style import StrainScale, bar_mm, colour, direction, figure, png, style
from ngbrain.report.pictures.timeline import Run
from ngbrain.report.render.surface import Floats
from ngbrain.report.words import moment

MOST = 48
"""Largest number of frames."""
REACH = 30e-3
"""Half the height of a panel (m), from the middle of the cleft."""
ACROSS = 3
"""Panels in a row."""
SHARE = 0.8
"""Resolution relative to the other pictures."""
LETTERS = 98.0
"""Letters per inch of a bold title of one point."""
HEIGHT, CURVES = 2.75, 2.1
"""Height of a panel and of the curves (inches)."""


@dataclass(frozen=True)
class AnimationFrame:
    """All protocols at one time.

    Parameters
    ----------
    t : float
        Time (s).
    text : str
        Description.
    picture : bytes
        A WebP picture.
    """

    t: float
    text: str
    picture: bytes


@dataclass(frozen=True)
class TimeAxis:
    """Position of a time axis in a picture, relative to the picture's size.

    Parameters
    ----------
    left, top : float
        Upper left corner.
    width, height : float
        Size.
    end : float
        Time at the right end (s).
    """

    left: float
    top: float
    width: float
    height: float
    end: float

    def position(self, t: float) -> float:
        """Horizontal position of a time (s), from the left."""
        return self.left + self.width * t / self.end


@dataclass(frozen=True)
class Animation:
    """An animation with its pressure curves.

    Parameters
    ----------
    frames : list of AnimationFrame
        Frames in order of time.
    start : int
        The first frame shown.
    curves : bytes
        Picture of the pressure curves.
    axes : list of TimeAxis
        Time axes in that picture, along which a mark moves.
    """

    frames: list[AnimationFrame]
    start: int
    curves: bytes
    axes: list[TimeAxis]


def animation(runs: Mapping[str, Run], answers: Mapping[str, Any], scale: StrainScale) -> Animation:
    """Animate all protocols at equal times, starting at the highest pressure.

    Parameters
    ----------
    runs : mapping of str to Run
        Protocol → run.
    answers : mapping of str to Any
        Protocol → answers.
    scale : StrainScale
        Colours of strain.

    Returns
    -------
    Animation
        The animation.
    """
    shown, highest = [], 0.0
    start = 0
    for t in times(list(runs.values())):
        now = {name: _now(answers[name], t) for name in runs}
        titles = {name: title for name, (title, _) in now.items()}
        text = "; ".join(f"{name}: {title}" for name, title in titles.items())
        page = _panels([run.frame_at(t) for run in runs.values()], titles, answers, scale)
        shown.append(AnimationFrame(float(t), f"{moment(t)} after first contact. {text}", _webp(page)))
        pressure = max(pressure for _, pressure in now.values())
        if pressure > highest:
            start, highest = len(shown) - 1, pressure
    return Animation(shown, start, *_curves(answers))


def peaks(runs: Mapping[str, Run], answers: Mapping[str, Any], scale: StrainScale) -> bytes:
    """Draw every protocol at its own largest strain.

    Parameters
    ----------
    runs : mapping of str to Run
        Protocol → run.
    answers : mapping of str to Any
        Protocol → answers.
    scale : StrainScale
        Colours of strain.

    Returns
    -------
    bytes
        A PNG.
    """
    states = [run.peak() for run in runs.values()]
    titles = {
        state.protocol: f"{moment(state.time)}: {_now(answers[state.protocol], state.time)[0]}" for state in states
    }
    return png(_panels(states, titles, answers, scale))


def times(runs: Sequence[Run]) -> Floats:
    """Times (s) of the frames of all runs; if there are more than `MOST`, a subset, uniform in time and in blade travel.

    Both have equal weight, so that short ramps are shown as well as long holds.
    """
    every = np.unique(np.concatenate([run.times for run in runs]))
    if len(every) <= MOST:
        return every
    way = sum(np.abs(np.diff(np.interp(every, *run.advance))) for run in runs)
    gone = np.diff(every) / np.ptp(every) + way / max(float(np.sum(way)), 1e-12)
    course = np.append(0, np.cumsum(gone))
    chosen = np.abs(course[:, None] - np.linspace(0, course[-1], MOST)).argmin(axis=0)
    return np.asarray(every[np.unique(chosen)])


def _now(answer: Mapping[str, Any], t: float) -> tuple[str, float]:
    """Opening and pressure at a time (or at the end before it) in words; the pressure (mmHg)."""
    series = answer["series"]
    steps = np.array(series["t_s"], float)
    at = float(np.clip(t, steps[0], steps[-1]))
    opened, pressure = (
        float(TimeCurve(steps, np.array(series[name], float), answer.get("events_s", steps))(at))
        for name in ("opening_mm", "pressure_mmHg")
    )
    ended = f" (ended, {moment(at)})" if t > at * (1 + 1e-9) else ""
    return f"{round(opened, 1) + 0.0:.1f} mm, {abs(pressure):.0f} mmHg{ended}".replace("-", "−"), pressure


def _panels(
    states: Sequence[DeformedHead], titles: Mapping[str, str], answers: Mapping[str, Any], scale: StrainScale
) -> Any:
    """The same part of the slice for each state, with one strain scale."""
    columns = min(len(states), ACROSS)
    rows = -(-len(states) // columns)
    head = 0.5
    halo = require("matplotlib.patheffects", "report").withStroke(linewidth=2.5, foreground="white")
    with style():
        page = figure(rows * (HEIGHT + head))
        total, width = rows * (HEIGHT + head), 0.925 / columns
        for k, state in enumerate(states):
            row, column = divmod(k, columns)
            bottom = 1 - ((row + 1) * (HEIGHT + head)) / total
            axes = page.add_axes((column * width + 0.004, bottom, width - 0.008, HEIGHT / total))
            wide = REACH * (width - 0.008) * looks.WIDTH / HEIGHT
            middle = state.cleft.depth / 2 + 3e-3
            axes.set(xlim=(-1e3 * wide, 1e3 * wide), ylim=(1e3 * (middle - REACH), 1e3 * (middle + REACH)))
            axes.set_aspect("equal")
            axes.tick_params(left=False, bottom=False, labelleft=False, labelbottom=False)
            for spine in axes.spines.values():
                spine.set(visible=True, color="#999999")
            CutPlane(state).draw(axes, scale)
            bar_mm(axes, 10)
            for v, x in ((state.cleft.across, 0.975), (-state.cleft.across, 0.025)):
                look = {"transform": axes.transAxes, "ha": "right" if x > 0.5 else "left", "path_effects": [halo]}
                axes.text(x, 0.55, direction(v), weight="bold", zorder=10, **look)
            above = {"transform": axes.transAxes, "va": "bottom", "ha": "left"}
            for y, text, size, more in (
                (1.075, state.protocol, 10.0, {"color": colour(state.protocol, answers), "weight": "bold"}),
                (1.01, titles[state.protocol], 9.0, {}),
            ):
                fits = LETTERS * (width - 0.008) * looks.WIDTH / len(text)
                axes.text(0, y, text, fontsize=min(size, fits), **more, **above)
        scale.bar(page, (0.942, 1 - (head + 0.9 * HEIGHT) / total, 0.013, 0.7 * HEIGHT / total))
        return page


def _curves(answers: Mapping[str, Any]) -> tuple[bytes, list[TimeAxis]]:
    """Pressure over time, in the same width."""
    found = []
    with style():
        page = figure(CURVES)
        left, right, bottom, top = 0.075, 0.915, 0.2, 0.9
        grid = page.add_gridspec(
            1, len(spans(answers)), width_ratios=[1, 1.75][: len(spans(answers))],
            left=left, right=right, top=top, bottom=bottom, wspace=0.10,
        )  # fmt: skip
        for column, span in enumerate(spans(answers)):
            axes = page.add_subplot(grid[0, column])
            pressures(axes, answers, span)
            axes.set_xlabel(f"time from first contact ({span.unit})")
            axes.set_title(span.name, fontsize=9.5)
            axes.tick_params(labelleft=column == 0)
            axes.set_ylabel("pressure (mmHg)" if column == 0 else "")
            box = axes.get_position()
            found.append(TimeAxis(*map(float, (box.x0, 1 - box.y1, box.width, box.height, span.end))))
        return png(page), found


def _webp(page: Any) -> bytes:
    """A figure as lossless WebP."""
    stream = io.BytesIO()
    page.savefig(stream, format="webp", dpi=SHARE * looks.DPI, pil_kwargs={"lossless": True, "method": 4})
    return stream.getvalue()
