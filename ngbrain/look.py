"""How objects show themselves in a notebook, the style of all plots, and the plots of results."""

from __future__ import annotations

import base64
import io
import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from html import escape
from importlib import import_module
from typing import Any, ClassVar

import numpy as np

from ngbrain.errors import MissingExtra, NgbrainError, require
from ngbrain.result import html_table

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
LONGEST = 200
"""Largest number of characters of a line that represents an object."""


class _Abbreviation(reprlib.Repr):
    """Text of a value in a line: arrays by their shape, long lists and texts cut."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxdict, self.maxlist, self.maxtuple = 3, 6, 6, 6
        self.maxstring, self.maxother, self.maxlong = 60, 100, 60

    def repr_ndarray(self, value: np.ndarray, level: int) -> str:
        return f"array {value.shape}"

    def repr_instance(self, value: Any, level: int) -> str:
        return " ".join(super().repr_instance(value, level).split())


_SHORT = _Abbreviation()


class BriefText:
    """Representation of a dataclass in one line: names and values of its fields, arrays by their shape.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(repr=False)
    ... class Wave(BriefText):
    ...     frequency: float
    ...     displacement: np.ndarray
    >>> Wave(50.0, np.zeros((1000, 3)))
    Wave(frequency=50.0, displacement=array (1000, 3))
    """

    def __repr__(self) -> str:
        shown = [field.name for field in fields(self) if field.repr]  # type: ignore[arg-type]
        text = ", ".join(f"{name}={_SHORT.repr(getattr(self, name, None))}" for name in shown)
        text = f"{type(self).__name__}({text})"
        return text if len(text) <= LONGEST else f"{text[: LONGEST - 2]}…)"


class NotebookCard:
    """Short representation of an object: one line of text, or a table with a thumbnail in a notebook.

    Subclasses define `summary`, and `plot` or `PICTURE` where there is something to see.
    """

    PICTURE: ClassVar[str] = ""
    """Module and function, with a colon between them, that plot an object of this class: of a package that builds on this class."""

    def summary(self) -> Mapping[str, str]:
        """Name → text, the most important first."""
        raise NotImplementedError

    def plot(self) -> Any:
        """Plot as a matplotlib figure; `NotImplementedError` where there is nothing to see."""
        if not self.PICTURE:
            raise NotImplementedError(f"{type(self).__name__} has no picture")
        module, function = self.PICTURE.split(":")
        return getattr(import_module(module), function)(self)

    def __repr__(self) -> str:
        return f"{type(self).__name__}: {'; '.join(self.summary().values())}"

    def _repr_html_(self) -> str:
        return html_table(type(self).__name__, self.summary()) + self._thumbnail()

    def _thumbnail(self) -> str:
        """The plot as a small embedded image; nothing where there is none, or no matplotlib; else why there is none."""
        try:
            self.plot().savefig(picture := io.BytesIO(), format="png", dpi=60)
        except (NotImplementedError, MissingExtra):
            return ""
        except NgbrainError as error:
            return f"<p>no picture: {escape(str(error))}</p>"
        return f'<img alt="" src="data:image/png;base64,{base64.b64encode(picture.getvalue()).decode()}">'


def figure(width: float, height: float) -> Any:
    """Create an empty matplotlib figure in the common style; a notebook shows it as the last value of a cell.

    Parameters
    ----------
    width, height : float
        Size in inches.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    MissingExtra
        matplotlib is not installed.
    """
    with require("matplotlib", "report").rc_context(STYLE):
        return notebook_figure(figsize=(width, height), dpi=150, layout="constrained")


def notebook_figure(**options: Any) -> Any:
    """Create a matplotlib figure that a notebook shows as the last value of a cell; the options are those of `Figure`."""

    class Page(require("matplotlib.figure", "report").Figure):  # type: ignore[misc]
        """A figure with the PNG representation that notebooks show."""

        def _repr_png_(self) -> bytes:
            self.savefig(picture := io.BytesIO(), format="png")
            return picture.getvalue()

    return Page(**options)


def descent(values: Sequence[float], label: str, line: float | None = None) -> Any:
    """Plot a positive quantity over iterations, on a logarithmic scale.

    Parameters
    ----------
    values : sequence of float
        Value after each iteration.
    label : str
        Label of the vertical axis.
    line : float, optional
        Target value, drawn as a dashed line.

    Returns
    -------
    matplotlib.figure.Figure
    """
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
    """Plot curves by name.

    Parameters
    ----------
    lines : mapping
        Name → abscissae and ordinates.
    x, y : str
        Labels of the axes.

    Returns
    -------
    matplotlib.figure.Figure
    """
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
    """Plot the three middle slices of a label volume.

    Parameters
    ----------
    data : numpy.ndarray
        (nx, ny, nz) labels, indices into `names`.
    names : sequence of str
        Names of the labels; the first is the outside.

    Returns
    -------
    matplotlib.figure.Figure
    """
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
    """Plot points of the plane, coloured by name.

    Parameters
    ----------
    points : numpy.ndarray
        (n, 2) m.
    names : sequence of str
        Name of each point.

    Returns
    -------
    matplotlib.figure.Figure
    """
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
    """Plot maps side by side, on points of the plane or on the middle slice of points in space.

    Parameters
    ----------
    points : numpy.ndarray
        (n, 2) or (n, 3) m, drawn in mm.
    values : mapping
        Name → (n,) values.
    moduli : sequence of str
        Names of the maps that are in Pa and drawn in kPa.

    Returns
    -------
    matplotlib.figure.Figure
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


def grey_slices(data: np.ndarray, label: str = "") -> Any:
    """Plot the three middle slices of an image in grey.

    Parameters
    ----------
    data : numpy.ndarray
        (nx, ny, nz) values.
    label : str
        Label of the colour bar.

    Returns
    -------
    matplotlib.figure.Figure
    """
    with require("matplotlib", "report").rc_context(STYLE):
        page = figure(7.2, 2.8)
        shown = None
        for i, axes in enumerate(page.subplots(1, 3)):
            middle = np.take(data, data.shape[i] // 2, axis=i).T
            shown = axes.imshow(middle, origin="lower", cmap="gray", vmin=np.min(data), vmax=np.max(data))
            axes.set_axis_off()
        page.colorbar(shown, ax=page.axes, shrink=0.8, label=label)
    return page


def scatter(points: np.ndarray, values: np.ndarray, label: str) -> Any:
    """Plot values at points of a plane; of points in space those in the middle layer.

    Parameters
    ----------
    points : numpy.ndarray
        (n, 2|3) m.
    values : numpy.ndarray
        (n,) one value at each.
    label : str
        Label of the colour bar, with the unit.

    Returns
    -------
    matplotlib.figure.Figure
    """
    if points.shape[1] == 3:
        height = points[:, 2]
        layer = np.unique(height)[len(np.unique(height)) // 2]
        inside = np.abs(height - layer) <= 1e-6 + 0.02 * np.ptp(height)
        points, values = points[inside], values[inside]
    with require("matplotlib", "report").rc_context(STYLE):
        page = figure(4.2, 3.4)
        axes = page.subplots()
        side = 3.0 * 72 / max(np.sqrt(len(points)), 1.0)
        shown = axes.scatter(*(1e3 * points[:, :2].T), c=values, s=1.2 * side**2, marker="s", linewidths=0)
        axes.set_aspect("equal")
        axes.set_xlabel("x (mm)")
        axes.set_ylabel("y (mm)")
        page.colorbar(shown, ax=axes, label=label)
    return page
