"""How every picture looks, whoever draws it, and the pictures of results."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ngbrain.errors import require

STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}
"""Settings of matplotlib."""


def figure(width: float, height: float) -> Any:
    """An empty matplotlib Figure (inches) in this style that a notebook shows where it is a cell's last value.

    Raises `MissingExtra` without matplotlib.
    """

    class Page(require("matplotlib.figure", "report").Figure):  # type: ignore[misc]
        """As pyplot's figures are shown."""

        def _repr_png_(self) -> bytes:
            self.savefig(picture := io.BytesIO(), format="png")
            return picture.getvalue()

    with require("matplotlib", "report").rc_context(STYLE):
        return Page(figsize=(width, height), dpi=150, layout="constrained")


def descent(values: Sequence[float], label: str, line: float | None = None) -> Any:
    """A positive number over iterations, as a matplotlib Figure; `line`: where it should end."""
    with require("matplotlib", "report").rc_context(STYLE):
        page = figure(4.5, 3.2)
        axes = page.subplots()
        axes.semilogy(range(1, len(values) + 1), values, "o-", color="#0072B2", ms=4)
        if line is not None:
            axes.axhline(line, color="#999999", lw=0.8, ls="--")
        axes.set_xlabel("iteration")
        axes.set_ylabel(label)
        axes.grid(color="#e8e8e8", lw=0.6)
    return page


def curves(lines: Mapping[str, tuple[Sequence[float], Sequence[float]]], x: str, y: str) -> Any:
    """Lines by name, each of abscissae and ordinates, as a matplotlib Figure."""
    with require("matplotlib", "report").rc_context(STYLE):
        page = figure(4.8, 3.2)
        axes = page.subplots()
        for name, (across, up) in lines.items():
            axes.plot(across, up, lw=1.6, label=name)
        axes.set_xlabel(x)
        axes.set_ylabel(y)
        axes.grid(color="#e8e8e8", lw=0.6)
        axes.legend(frameon=False)
    return page


def slices(data: np.ndarray, names: Sequence[str]) -> Any:
    """The three middle slices of labels (nx, ny, nz) that number `names` from 0, which is outside, as a matplotlib Figure."""
    colours = require("matplotlib", "report").colormaps["tab10"](np.arange(len(names)) % 10)
    colours[0] = 1.0
    with require("matplotlib", "report").rc_context(STYLE):
        page = figure(7.2, 2.8)
        for i, axes in enumerate(page.subplots(1, 3)):
            axes.imshow(colours[np.take(data, data.shape[i] // 2, axis=i).T], origin="lower", interpolation="nearest")
            axes.set_axis_off()
        marks = [page.axes[0].plot([], [], "s", color=colours[i], label=names[i])[0] for i in range(1, len(names))]
        page.legend(handles=marks, loc="outside lower center", ncols=len(marks), frameon=False)
    return page


def places(points: np.ndarray, names: Sequence[str]) -> Any:
    """Points of the plane (n, 2) m, coloured by name, as a matplotlib Figure."""
    with require("matplotlib", "report").rc_context(STYLE):
        page = figure(4.8, 4.4)
        axes = page.subplots()
        of = np.array(names)
        for name in dict.fromkeys(names):
            axes.plot(*(1e3 * points[of == name].T), "o", ms=2.5, label=name)
        axes.set_aspect("equal")
        axes.set_xlabel("x, mm")
        axes.set_ylabel("y, mm")
        axes.legend(frameon=False, markerscale=3)
    return page


def maps(points: np.ndarray, values: Mapping[str, np.ndarray], moduli: Sequence[str]) -> Any:
    """Maps on points of the plane (n, 2), or on the slice of points in space (n, 3) nearest to their middle, side by side.

    points in m, drawn in mm; values that are `moduli` in Pa, drawn in kPa; returns a matplotlib Figure.
    """
    if points.shape[1] == 3:
        planes = np.unique(np.round(points[:, 2], 9))
        near = np.abs(points[:, 2] - planes[len(planes) // 2]) < 1e-8
        points, values = points[near], {name: value[near] for name, value in values.items()}
    with require("matplotlib", "report").rc_context(STYLE):
        page = figure(3.6 * len(values), 3.2)
        for axes, (name, value) in zip(page.subplots(1, len(values), squeeze=False)[0], values.items(), strict=True):
            value, unit = (value / 1e3, "kPa") if name in moduli else (value, "")
            known = np.isfinite(value)
            x, y = 1e3 * points[known, 0], 1e3 * points[known, 1]
            ends = np.percentile(value[known], [1, 99])
            area = max(1.0, 3e4 / max(len(x), 1))
            drawn = axes.scatter(x, y, area, value[known], marker="s", linewidths=0, vmin=ends[0], vmax=ends[1])
            page.colorbar(drawn, ax=axes, label=unit)
            axes.set_title(name)
            axes.set_aspect("equal")
            axes.set_xlabel("x, mm")
            axes.set_ylabel("y, mm")
    return page
