"""The page of the cheapest adequate model of a loaded body: answers, omitted effects, sequence of models."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.errors import require
from ngbrain.io import load
from ngbrain.ladder.quantities import BODY
from ngbrain.report.pages import first_answers, preview
from ngbrain.report.pages.page import write_page
from ngbrain.report.pages.preview import KINDS, Drawing, space_picture
from ngbrain.report.pictures.panel import ColourScale, SurfaceLayer
from ngbrain.report.pictures.style import figure, inches, png, style
from ngbrain.report.render.renderer import Camera, Layer, draw
from ngbrain.report.render.surface import Floats, faces, triangles, vertex_normals
from ngbrain.report.words import display_unit

VISIBLE = 0.1
"""Small displacements are drawn enlarged to less than this part of the body's size."""
LEAST, MOST = 1e-3, 10.0
"""Range of the changes drawn: from this many per cent up to this many times."""


def build(path: str | os.PathLike[str], result: Mapping[str, Any], drawing: Drawing | None = None) -> Path:
    """Write the page of a result with error estimates of its quantities.

    Parameters
    ----------
    path : str or path-like
        Output file.
    result : mapping of str to Any
        The result.
    drawing : Drawing, optional
        The scene, to show body, mesh and loads; the deformed body is read from body.vtkhdf beside the page.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    MissingExtra
        matplotlib or jinja2 is not installed.
    """
    pictures = {"way": _plot_search(result)}
    shape = None if drawing is None else _deformed(Path(path).with_name(BODY))
    if drawing is not None:
        pictures["body"] = space_picture(drawing)
    if shape is not None:
        pictures["deformed"] = _picture(shape)
    return write_page(
        Path(path),
        "ladder.html",
        pictures,
        drawing=drawing,
        kinds={each.kind: KINDS[each.kind] for each in drawing.conditions} if drawing else {},
        panel=None if drawing is None else preview.panel(drawing, None if shape is None else shape.layer),
        shape=shape,
        result=result,
        answers=answers(result),
        left_out=omitted_effects(result),
        first=first_answers.rows(result.get("first_answers") or {}),
        first_sentence=first_answers.sentence(result.get("first_answers") or {}),
    )


@dataclass(frozen=True, eq=False)
class _DeformedBody:
    """Outer surface of the deformed body, and how it is drawn.

    Parameters
    ----------
    layer : SurfaceLayer
        Surface with the largest principal strain (%).
    largest : float
        Largest displacement (m).
    times : float
        Factor of the displacements that are drawn.
    """

    layer: SurfaceLayer
    largest: float
    times: float


def _deformed(path: Path) -> _DeformedBody | None:
    """The body after its loads, moved by a round multiple of small displacements."""
    if not path.exists():
        return None
    found = load(path)
    moved, strain = (found.frames[-1].point_data[name] for name in ("displacement", "max_principal_strain"))
    largest = float(np.linalg.norm(moved, axis=1).max())
    wanted = VISIBLE * float(np.ptp(found.grid.points, axis=0).max()) / max(largest, 1e-300)
    times = 1.0 if wanted < 2 else min(float(10 ** np.floor(np.log10(wanted))), 1e6)
    tris = triangles(faces(found.grid.connectivity))
    percent_ = 100 * strain
    scale = ColourScale.of_map("largest principal strain (%)", 0.0, float(np.percentile(percent_, 99)) or 1.0, "YlOrRd")
    name = "deformed body" if times == 1 else f"deformed body, displacements × {times:g}"
    points = found.grid.points + times * moved
    return _DeformedBody(SurfaceLayer(name, points, tris, values=percent_, scale=scale), largest, times)


def _picture(shape: _DeformedBody) -> bytes:
    """The deformed body from the side and from above."""
    points, tris, scale = shape.layer.points, shape.layer.triangles, shape.layer.scale
    assert scale is not None and shape.layer.values is not None
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    reach = 1.15 * float(np.linalg.norm(points - middle, axis=1).max())
    palette = scale.palette()[:, :3] / 255
    values = shape.layer.values

    def colours(at: Floats) -> Floats:
        return np.asarray(palette[scale.bytes_of(at)])

    with style():
        made = figure(4.4)
        for column, toward in enumerate(((0.6, -1.0, 0.7), (0.0, -1.0, 0.05))):
            axes = made.add_axes((0.005 + 0.44 * column, 0.02, 0.43, 0.96))
            wide, tall = inches(axes)
            camera = Camera.look_at(middle, np.array(toward), np.array([0, 0, 1.0]), reach * wide / tall, reach)
            layer = Layer(points, tris, values, vertex_normals(points, tris), palette=colours)
            x, y = 1e3 * camera.half_width, 1e3 * camera.half_height
            image = draw(camera, [layer], round(made.dpi * wide), round(made.dpi * tall))
            axes.imshow(image, extent=(-x, x, -y, y), interpolation="none")
            axes.axis("off")
        colors, cm = (require(f"matplotlib.{each}", "report") for each in ("colors", "cm"))
        mappable = cm.ScalarMappable(colors.Normalize(scale.low, scale.high), colors.ListedColormap(palette[1:]))
        bar = made.colorbar(mappable, cax=made.add_axes((0.9, 0.2, 0.015, 0.6)), extend="max")
        bar.set_label(scale.label)
        return png(made)


def answers(result: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Rows of the answer table: quantity, value with unit, estimated error, tolerance."""
    rows = []
    for each in result["answers"]:
        unit, factor = display_unit(each["unit"])
        shown = f"{each['value'] * factor:.4g} {unit}".strip()
        rows.append((each["quantity"], shown, percent(each["error_estimate"]), percent(each["tolerance"])))
    return rows


def omitted_effects(result: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Rows of the table of omitted effects: what the model lacks, its largest change of an answer, the method, doubts."""
    rows = [(each["what"], _largest(each["change"]), each["method"], each["caution"]) for each in result["left_out"]]
    return [(what, percent(change), *rest) for what, change, *rest in sorted(rows, key=lambda row: -(row[1] or np.inf))]


def percent(share: float | None) -> str:
    """A relative number in per cent; "unknown" for None.

    >>> percent(0.0123), percent(None)
    ('1.2 %', 'unknown')
    """
    return "unknown" if share is None else f"{100 * share:.2g} %"


def _largest(change: Sequence[float | None]) -> float | None:
    return None if None in change else max(abs(c or 0.0) for c in change)


def _worst(rung: Mapping[str, Any]) -> float:
    found = _largest(rung["error_bound"])
    return MOST if found is None else found


def _plot_search(result: Mapping[str, Any]) -> bytes:
    """Plot the estimated error of each model over the time spent."""
    with style():
        made = figure(4.2)
        axis = made.add_axes((0.09, 0.13, 0.89, 0.84))
        rungs = result["models"]
        cost = [rung["cost_s"] for rung in rungs]
        missing = [max(100 * min(_worst(rung), MOST), LEAST) for rung in rungs]
        axis.step(cost, missing, where="post", color="#0072B2", lw=1.5)
        axis.plot(cost, missing, "o", color="#0072B2")
        axis.plot(cost[-1:], missing[-1:], "o", color="#D55E00", ms=11, mfc="none", mew=2)
        for x, y, rung in zip(cost, missing, rungs, strict=True):
            axis.annotate(
                " and ".join(rung["next_axes"]) or "chosen",
                (x, y),
                xytext=(5, 6),
                textcoords="offset points",
                fontsize=9,
            )
        tolerance = 100 * min(each["tolerance"] for each in result["answers"])
        axis.axhline(tolerance, color="#4d4d4d", lw=1, ls="--")
        axis.set(xlabel="computing time including estimates (s)", ylabel="estimated error (%)")
        axis.set(yscale="log", ylim=(0.5 * min(*missing, tolerance), 2 * max(*missing, tolerance)))
        axis.set_xlim(0, 1.15 * cost[-1])
        return png(made)
