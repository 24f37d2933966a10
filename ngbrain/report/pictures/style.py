"""Common style of the figures: sizes, colours, strain scale, anatomical directions."""

from __future__ import annotations

import io
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ngbrain.errors import require
from ngbrain.look import STYLE, notebook_figure
from ngbrain.report.pictures.frame import DeformedHead
from ngbrain.report.render.surface import Floats

DPI = 150
WIDTH = 9.0
"""Width of every picture (inches): 1350 pixels, shown at 900 or less."""
COLOURS = {"continuous": "#0072B2", "intermittent": "#D55E00", "staged": "#009E73"}
SPARE = ("#CC79A7", "#8C6D00", "#56B4E9", "#000000")
DASHES = {"continuous": "-", "intermittent": (0, (5, 1.6)), "staged": (0, (6, 1.4, 1.4, 1.4))}
BANDS = 10
"""Largest number of steps of the strain scale."""

BONE = np.array([0.93, 0.89, 0.80])
FLUID = np.array([0.45, 0.65, 0.85])
STEEL = np.array([0.62, 0.66, 0.70])


def colour(name: str, among: Iterable[str]) -> str:
    """Colour of a protocol, the same in every picture.

    Parameters
    ----------
    name : str
        The protocol.
    among : iterable of str
        All protocols.

    Returns
    -------
    str
        The colour.
    """
    others = [other for other in among if other not in COLOURS]
    return COLOURS.get(name) or SPARE[others.index(name) % len(SPARE)]


def style() -> Any:
    """Context manager with matplotlib's settings for a picture."""
    return require("matplotlib", "report").rc_context(STYLE)


def figure(height: float) -> Any:
    """An empty figure of full width; `height` in inches."""
    return notebook_figure(figsize=(WIDTH, height), dpi=DPI)


def png(figure: Any) -> bytes:
    """A figure as PNG."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=DPI, metadata={"Software": None}, pil_kwargs={"compress_level": 6})
    return stream.getvalue()


def inches(axes: Any) -> tuple[float, float]:
    """Width and height of axes (inches)."""
    box, size = axes.get_position(original=True), axes.figure.get_size_inches()
    return float(box.width * size[0]), float(box.height * size[1])


@dataclass(frozen=True)
class StrainScale:
    """A discrete colour scale of strain, the same in every picture of a page.

    Parameters
    ----------
    cmap : matplotlib.colors.Colormap
        Colour map.
    norm : matplotlib.colors.Normalize
        Norm.
    """

    cmap: Any
    norm: Any

    @classmethod
    def up_to(cls, strain: float) -> StrainScale:
        """Scale from 0 in round steps to the first that reaches `strain`; larger strains have a colour of their own."""
        colours, ticker = (require(f"matplotlib.{name}", "report") for name in ("colors", "ticker"))
        edges = ticker.MaxNLocator(BANDS, steps=[1, 2, 2.5, 5, 10]).tick_values(0.0, max(strain, 1e-6))
        steps = require("matplotlib", "report").colormaps["YlOrRd"](np.linspace(0.0, 1.0, len(edges) - 1))
        cmap = colours.ListedColormap(steps).with_extremes(over="#45001f", under=steps[0])
        return cls(cmap, colours.BoundaryNorm(edges, len(edges) - 1))

    @property
    def edges(self) -> Floats:
        """Strains at which the colour changes."""
        return np.asarray(self.norm.boundaries)

    def bar(self, figure: Any, box: tuple[float, float, float, float]) -> None:
        """Draw the colour bar.

        Parameters
        ----------
        figure : matplotlib.figure.Figure
            The figure.
        box : tuple of float
            Left, bottom, width and height, relative to the figure.
        """
        cm, ticks = require("matplotlib.cm", "report"), self.edges[::2]
        mappable = cm.ScalarMappable(self.norm, self.cmap)
        bar = figure.colorbar(mappable, cax=figure.add_axes(box), extend="max", ticks=ticks)
        bar.ax.set_yticklabels([f"{100 * tick:g} %" for tick in ticks], fontsize=9)
        bar.ax.tick_params(length=2)
        bar.outline.set_linewidth(0.5)
        figure.text(0.995, box[1] + box[3] + 0.055, "largest\nprincipal\nstrain", ha="right", va="bottom", fontsize=9)


def bar_mm(axes: Any, mm: float, at: float = 0.06) -> None:
    """Draw a scale bar at the bottom.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Axes to draw in.
    mm : float
        Length (mm).
    at : float
        Left end, relative to the width.
    """
    x0, x1 = axes.get_xlim()
    y0, y1 = axes.get_ylim()
    x, y = x0 + at * (x1 - x0), y0 + 0.045 * (y1 - y0)
    axes.plot([x, x + mm], [y, y], color="#222222", lw=2.5, solid_capstyle="butt", zorder=20)
    axes.text(x + mm / 2, y + 0.012 * (y1 - y0), f"{abs(mm):g} mm", ha="center", va="bottom", fontsize=9.5, zorder=20)


def direction(v: Floats, words: bool = False) -> str:
    """Anatomical name of a direction: its large components, the largest first.

    Parameters
    ----------
    v : ndarray, shape (3,)
        The direction: right, front, up.
    words : bool
        Whether to return a word instead of letters.

    Returns
    -------
    str
        For example "RI".

    Examples
    --------
    >>> direction(np.array([0.9, 0.1, -0.42])), direction(np.array([0, -1.0, 0]), words=True)
    ('RI', 'behind')
    """
    names = (("R", "L"), ("A", "P"), ("S", "I"))
    if words:
        names = (("the right", "the left"), ("the front", "behind"), ("above", "below"))
    order = [k for k in np.argsort(-np.abs(v)) if abs(v[k]) > 0.38][: 1 if words else 2]
    return "".join(names[k][0 if v[k] > 0 else 1] for k in order)


def viewed_from(peak: DeformedHead) -> str:
    """Viewing direction of the slice, in words: `across` points right and `out` up, so it is seen from -along."""
    return f", seen from {direction(-peak.cleft.along, words=True)}"
