"""The figures of a retraction report; each function returns a PNG."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ngbrain.adjoint.time_curve import TimeCurve
from ngbrain.errors import require
from ngbrain.report.pictures.cut_plane import CutPlane
from ngbrain.report.pictures.frame import DeformedHead
from ngbrain.report.pictures.style import (
    DASHES,
    StrainScale,
    bar_mm,
    colour,
    direction,
    figure,
    inches,
    png,
    style,
    viewed_from,
)
from ngbrain.report.pictures.volume import head
from ngbrain.report.render.surface import Floats

__all__ = ["head", "pressure", "strain_slice"]

FIRST_S = 60.0
SAMPLES = 10
"""Points drawn between steps of smooth series."""
THRESHOLDS = (20.0, 30.0)


@dataclass(frozen=True)
class Span:
    """A time interval that a plot shows.

    Parameters
    ----------
    name : str
        Name.
    end : float
        End of the interval, which starts at 0 (s).
    unit : str
        Unit of the axis.
    seconds : float
        Seconds in that unit.
    """

    name: str
    end: float
    unit: str
    seconds: float


def spans(answers: Mapping[str, Any]) -> list[Span]:
    """The first minute, and the whole time in minutes; the whole time alone where it is short."""
    end = max(max(a["series"]["t_s"]) for a in answers.values())
    if end <= 1.5 * FIRST_S:
        return [Span("Whole time", end, "s", 1.0)]
    return [Span(f"First {FIRST_S:.0f} s", FIRST_S, "s", 1.0), Span("Whole time", end, "min", 60.0)]


def pressure(answers: Mapping[str, Any]) -> bytes:
    """Pressure under the blade and opening over time: the first minute, and the whole time in minutes."""
    with style():
        page = figure(5.4)
        shown = spans(answers)
        grid = page.add_gridspec(
            2, len(shown), width_ratios=[1, 1.75][: len(shown)], height_ratios=[1.7, 1],
            left=0.075, right=0.915, top=0.865, bottom=0.095, wspace=0.10, hspace=0.14,
        )  # fmt: skip
        for column, span in enumerate(shown):
            upper, lower = page.add_subplot(grid[0, column]), page.add_subplot(grid[1, column])
            lines = pressures(upper, answers, span)
            for name, answer in answers.items():
                s, look = answer["series"], _line_style(name, answers)
                t, opened = course(answer, "opening_mm")
                lower.plot(t / span.seconds, opened, **look)
                lower.plot(np.array(s["t_s"]) / span.seconds, s["blade_mm"], color=look["color"], lw=0.9, ls=":")
            lower.set_xlim(0, span.end / span.seconds)
            lower.grid(axis="y", color="#e3e3e3", lw=0.6)
            lower.set_axisbelow(True)
            for axes in (upper, lower):
                axes.tick_params(labelleft=column == 0)
            upper.tick_params(labelbottom=False)
            lower.set_ylim(*_limits(answers))
            lower.set_xlabel(f"time from first contact ({span.unit})")
            if column == 0:
                upper.set_ylabel("pressure under the blade (mmHg)")
                lower.set_ylabel("opening (mm)")
            upper.set_title(span.name)
        ghost = require("matplotlib.lines", "report").Line2D(
            [], [], color="#555555", lw=1.0, ls=":", label="the blade itself"
        )
        page.legend(
            handles=[*lines, ghost],
            loc="upper left",
            bbox_to_anchor=(0.065, 0.995),
            ncols=len(lines) + 1,
            frameon=False,
            fontsize=10.5,
        )
        return png(page)


def pressures(axes: Any, answers: Mapping[str, Any], span: Span) -> list[Any]:
    """Plot the pressure of every protocol and the thresholds.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Axes to draw in.
    answers : mapping of str to Any
        Protocol → answers.
    span : Span
        Time interval; the last one labels the thresholds.

    Returns
    -------
    list
        The protocols' lines.
    """
    lines = []
    for name, answer in answers.items():
        t, values = course(answer, "pressure_mmHg")
        lines += axes.plot(t / span.seconds, values, **_line_style(name, answers))
    top = 1.08 * max([THRESHOLDS[-1] * 1.1, *(max(a["series"]["pressure_mmHg"]) for a in answers.values())])
    for threshold in THRESHOLDS:
        axes.axhline(threshold, color="#555555", lw=1.0, ls=(0, (2, 2)), zorder=1)
    if span == spans(answers)[-1]:
        _name_thresholds(axes, top)
    axes.set(xlim=(0, span.end / span.seconds), ylim=(0, top))
    axes.grid(axis="y", color="#e3e3e3", lw=0.6)
    axes.set_axisbelow(True)
    return lines


def _line_style(name: str, answers: Mapping[str, Any]) -> dict[str, Any]:
    return {"color": colour(name, answers), "ls": DASHES.get(name, "-"), "lw": 1.9, "label": name}


def course(answer: Mapping[str, Any], name: str) -> tuple[Floats, Floats]:
    """A series with the interpolation used for doses: cubic between events (`TimeCurve`), where those are given.

    Parameters
    ----------
    answer : mapping of str to Any
        Answers of a protocol.
    name : str
        Name of the series.

    Returns
    -------
    times, values : ndarray
        Times (s) and values.
    """
    t, values = (np.array(answer["series"][key], float) for key in ("t_s", name))
    steps = len(t) - 1
    fine = np.interp(np.linspace(0, steps, SAMPLES * steps + 1), np.arange(len(t)), t)
    return fine, TimeCurve(t, values, answer.get("events_s", t))(fine)


def strain_slice(peak: DeformedHead, scale: StrainScale) -> bytes:
    """Largest principal strain in the plane of approach and push through the target, deformed: overview and close-up.

    Parameters
    ----------
    peak : DeformedHead
        The head at its largest strain.
    scale : StrainScale
        Colours of strain.

    Returns
    -------
    bytes
        A PNG.
    """
    with style():
        page = figure(4.75)
        centre = peak.cleft.depth / 2 + 3e-3
        whole = page.add_axes((0.01, 0.02, 0.44, 0.88))
        near = page.add_axes((0.475, 0.02, 0.455, 0.88))
        plane = CutPlane(peak)
        low, high = plane.extent()
        half = max(high - low) / 2 + 11e-3
        for axes, middle, reach in ((whole, (low + high) / 2, half), (near, np.array([0.0, centre]), 30e-3)):
            wide, tall = inches(axes)
            shrink = reach / min(wide, tall)
            axes.set_xlim(*(1e3 * (middle[0] + np.array([-1, 1]) * shrink * wide)))
            axes.set_ylim(*(1e3 * (middle[1] + np.array([-1, 1]) * shrink * tall)))
            axes.set_aspect("equal")
            axes.axis("off")
            plane.draw(axes, scale)
            bar_mm(axes, 20 if axes is whole else 10)
        whole.set_title("Slice through the site" + viewed_from(peak), pad=8)
        near.set_title("The site, 60 mm across", pad=8)
        _ends(whole, peak)
        patches = require("matplotlib.patches", "report")
        box = (-30, 1e3 * centre - 30)
        whole.add_patch(patches.Rectangle(box, 60, 60, fill=False, ec="#333333", lw=0.8, ls=(0, (4, 3)), zorder=9))
        plane.name_regions(whole)
        blade = peak.blades[0]
        height = min(peak.cleft.depth + 9e-3, blade.top)
        x = 1e3 * blade.across(height)
        _annotate(near, peak.tool, (x, 1e3 * height), (x - 12, 1e3 * (peak.cleft.depth + 11e-3)))
        window = 1e3 * peak.craniotomy / 2
        _annotate(
            near,
            "edge of the\ncraniotomy",
            (-window, 1e3 * peak.cleft.depth - 1.5),
            (-window - 1, 1e3 * peak.cleft.depth + 9),
        )
        scale.bar(page, (0.942, 0.14, 0.013, 0.62))
        return png(page)


def _ends(axes: Any, peak: DeformedHead) -> None:
    cleft = peak.cleft
    for v, at in ((cleft.across, (0.985, 0.45)), (-cleft.across, (0.015, 0.45)), (-cleft.out, (0.5, 0.015))):
        axes.text(*at, direction(v), transform=axes.transAxes, ha="center", va="center", fontsize=11, fontweight="bold")
    axes.text(
        0.27,
        0.975,
        direction(cleft.out),
        transform=axes.transAxes,
        ha="center",
        va="center",
        fontsize=11,
        fontweight="bold",
    )


def _annotate(axes: Any, text: str, point: tuple[float, float], at: tuple[float, float]) -> None:
    line = {"arrowstyle": "-", "color": "#222222", "lw": 0.8, "shrinkA": 1, "shrinkB": 0}
    halo = require("matplotlib.patheffects", "report").withStroke(linewidth=3, foreground="white")
    axes.annotate(
        text, point, at, ha="center", va="center", fontsize=9.5, arrowprops=line, zorder=10, path_effects=[halo]
    )


def _name_thresholds(axes: Any, top: float) -> None:
    """Labels beside the plot, far enough apart to be read."""
    upper = max(THRESHOLDS[1], THRESHOLDS[0] + 0.15 / inches(axes)[1] * top)
    for threshold, y in zip(THRESHOLDS, (THRESHOLDS[0], upper), strict=True):
        where = axes.get_yaxis_transform()
        axes.text(1.01, y, f"{threshold:g} mmHg", transform=where, ha="left", va="center", fontsize=9, color="#333333")


def _limits(answers: Mapping[str, Any]) -> tuple[float, float]:
    values = np.concatenate([np.r_[a["series"]["opening_mm"], a["series"]["blade_mm"]] for a in answers.values()])
    low, high = float(min(values.min(), 0.0)), float(values.max())
    return low - 0.06 * (high - low), high + 0.08 * (high - low)
