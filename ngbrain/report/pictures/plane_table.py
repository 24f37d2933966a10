"""Tables of pictures on planes: a row for each plane, a column for each quantity, with colour bars."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from ngbrain.report.pictures.planes import Plane
from ngbrain.report.pictures.style import WIDTH, figure, png, style
from ngbrain.report.render.surface import Floats

Looks: TypeAlias = Callable[[int], list[tuple[dict[str, Any], Floats]]]
"""Row of a figure → colour settings and values of its pictures, from left to right."""


def draw_table(flat: Sequence[Plane], titles: Sequence[str], names: Sequence[str], looks: Looks) -> bytes:
    """Draw planes as rows and quantities as columns; neighbours with the same colour settings (one object) share a colour bar.

    Parameters
    ----------
    flat : sequence of Plane
        The planes.
    titles : sequence of str
        Titles of the columns.
    names : sequence of str
        Titles of the rows.
    looks : callable
        Row → colour settings and values, see `Looks`.

    Returns
    -------
    bytes
        A PNG.
    """
    columns = max(len(titles), 2)
    bar, gap, margin, head, foot = 0.62, 0.12, 0.55, 0.42, 0.42  # inches
    wide = (WIDTH - margin - columns * (bar + gap)) / columns
    talls = [min(wide * max(plane.extent[1] / plane.extent[0], 0.15), 1.15 * wide) for plane in flat]
    height = sum(tall + head + foot for tall in talls) + 0.1
    with style():
        page = figure(height)
        top = height - 0.05
        for row, (plane, name, tall) in enumerate(zip(flat, names, talls, strict=True)):
            bottom = top - head - tall
            found = looks(row)
            for column, (look, values) in enumerate(found):
                x = margin + column * (wide + bar + gap)
                axes = page.add_axes((x / WIDTH, bottom / height, wide / WIDTH, tall / height))
                image = plane.draw(axes, values, look)
                axes.set_title(titles[column], fontsize=9, pad=3)
                if column:
                    axes.tick_params(labelleft=False)
                if column + 1 == len(found) or found[column + 1][0] is not look:
                    axes.apply_aspect()
                    box = axes.get_position()
                    place = (box.x1 + 0.06 / WIDTH, box.y0, 0.09 / WIDTH, box.height)
                    scale = page.colorbar(image, cax=page.add_axes(place), extend=_extend(look, values))
                    scale.ax.tick_params(labelsize=7, length=2, pad=1.5)
                    scale.outline.set_linewidth(0.4)
            words = "   ".join(word for word in (name, plane.name) if word)
            page.text(margin / WIDTH, (top - 0.03) / height, words, fontsize=10, va="top", fontweight="bold")
            for column in range(len(found)):
                x = margin + column * (wide + bar + gap) + wide / 2
                across = f"{plane.axes[0]} (mm)"
                page.text(x / WIDTH, (bottom - 0.2) / height, across, ha="center", va="top", fontsize=7.5)
            page.text(
                0.012, (bottom + tall / 2) / height, f"{plane.axes[1]} (mm)", rotation=90, va="center", fontsize=7.5
            )
            top = bottom - foot
        return png(page)


def window(cmap: str, values: Floats) -> dict[str, Any]:
    """Colour settings from the 1st to the 99th percentile.

    Parameters
    ----------
    cmap : str
        Colour map.
    values : ndarray
        The values.

    Returns
    -------
    dict of str to Any
        cmap, vmin and vmax.
    """
    low, high = np.nanpercentile(values, [1, 99]) if np.isfinite(values).any() else (0.0, 1.0)
    room = max(float(high - low) * 0.02, 0.01 * abs(float(high)), 1e-12)
    return {"cmap": cmap, "vmin": float(low) - room, "vmax": float(high) + room}


def _extend(look: Mapping[str, Any], values: Floats) -> str:
    """At which ends of a colour bar values exceed its range."""
    low, high = bool(np.nanmin(values) < look["vmin"]), bool(np.nanmax(values) > look["vmax"])
    return {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}[low, high]
