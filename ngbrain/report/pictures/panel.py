"""Interactive 3-D panels: surfaces and volumes in one scene that the reader turns, in a page that needs no network."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError, require
from ngbrain.report.render.surface import Floats, Ints

MOST_TRIANGLES = 120_000
"""Triangles of a surface; vertices of larger ones are merged on a grid."""
MOST_VOXELS = 700_000
"""Voxels of a volume; of larger ones every second, third ... along each axis is taken."""
_FOLDER = Path(__file__).parent
_MISSING = "The three-dimensional view needs JavaScript and WebGL 2; the still pictures show the same."
_HOW = "Drag to turn, two fingers or + and − to zoom; switches hide layers, sliders move the planes."
_PAGE = (
    '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">\n<title>',
    "</title></head><body style='margin: 8px; font: 15px sans-serif'>\n",
)
GREY = np.repeat(np.arange(256.0)[:, None], 3, axis=1)
"""Colours of a scan."""


@dataclass(frozen=True, eq=False)
class ColourScale:
    """Colours of values.

    Parameters
    ----------
    label : str
        Quantity and unit, shown above the colours; empty for no key.
    low, high : float
        Values of the first and the last colour, in the unit of the label.
    colours : ndarray, shape (k, 3)
        Red, green, blue (0 to 255), from the lowest value to the highest.
    """

    label: str
    low: float
    high: float
    colours: Floats

    @classmethod
    def of_map(cls, label: str, low: float, high: float, name: str) -> ColourScale:
        """With a colour map of matplotlib.

        Parameters
        ----------
        label : str
            Quantity and unit.
        low, high : float
            Values of the first and the last colour.
        name : str
            Name of the colour map.

        Returns
        -------
        ColourScale
        """
        colours = require("matplotlib", "report").colormaps[name](np.linspace(0, 1, 255))[:, :3]
        return cls(label, low, high, 255 * colours)

    def bytes_of(self, values: Floats) -> npt.NDArray[np.uint8]:
        """Values as numbers of the colours, 1 to 255; 0 where they are not finite."""
        known = np.isfinite(values)
        share = (np.where(known, values, self.low) - self.low) / ((self.high - self.low) or 1.0)
        return np.where(known, 1 + np.rint(254 * np.clip(share, 0, 1)), 0).astype(np.uint8)

    def palette(self) -> npt.NDArray[np.uint8]:
        """Colours by number (256, 4); number 0 is transparent."""
        at = np.rint(np.linspace(0, len(self.colours) - 1, 255)).astype(int)
        found = np.zeros((256, 4), np.uint8)
        found[1:, :3], found[1:, 3] = self.colours[at], 255
        return found


@dataclass(frozen=True, eq=False)
class SurfaceLayer:
    """A surface of the scene.

    Parameters
    ----------
    name : str
        Name at its switch.
    points : ndarray, shape (n, 3)
        Vertices (m).
    triangles : ndarray of int, shape (m, 3)
        Triangles.
    colour : str
        Colour "#rrggbb" of a surface without values.
    values : ndarray, shape (n,), optional
        Values at the vertices, shown by the colours of `scale`.
    scale : ColourScale, optional
        Needed for values.
    opacity : float
        1, or less for a translucent surface.
    shown : bool
        Whether it is switched on at first.
    edges : bool
        Whether the edges of the triangles are drawn in place of the surface.
    whole : bool
        Whether it stays where others are cut away.
    """

    name: str
    points: Floats
    triangles: Ints
    colour: str = "#ede3cc"
    values: Floats | None = None
    scale: ColourScale | None = None
    opacity: float = 1.0
    shown: bool = True
    edges: bool = False
    whole: bool = False


@dataclass(frozen=True, eq=False)
class VolumeLayer:
    """Values of voxels along the axes, shown on three planes that the reader moves.

    Parameters
    ----------
    name : str
        Name at its switch.
    values : ndarray, shape (nx, ny, nz)
        Values; nothing is drawn where they are not finite.
    origin, spacing : ndarray, shape (3,)
        Centre of voxel (0, 0, 0) and positive voxel sizes (m).
    scale : ColourScale
        Colours.
    opacity : float
        Of the colours, over volumes before it.
    shown : bool
        Whether it is switched on at first.
    """

    name: str
    values: Floats
    origin: Floats
    spacing: Floats
    scale: ColourScale
    opacity: float = 1.0
    shown: bool = True


Layers = Sequence[SurfaceLayer | VolumeLayer]


@dataclass(frozen=True, eq=False, repr=False)
class Panel:
    """An interactive scene of layers; it needs WebGL 2, and neither a network nor another package.

    Parameters
    ----------
    layers : sequence of SurfaceLayer or VolumeLayer
        The layers.
    title : str
        Name for readers who do not see it.
    caption : str
        Text below it.
    toward : array_like, shape (3,)
        Direction to the viewer at first; the third axis points up.
    focus : array_like, shape (3,), optional
        Point (m) that the planes go through at first; by default the centre.
    head : bool
        Whether the axes are right, front and up of a head.
    cut_away : int
        Part of the surfaces that is cut away at first: 1, 2, 3 beyond the plane along an axis, negative below it, 0 none.

    Raises
    ------
    InputError
        There is no layer with points, or a surface with values has no colours.

    Examples
    --------
    >>> square = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]) / 100
    >>> panel = Panel([SurfaceLayer("plate", square, np.array([[0, 1, 2], [1, 3, 2]]))], "A plate")
    >>> panel.write("plate.html")  # doctest: +SKIP
    """

    layers: Layers
    title: str
    caption: str = ""
    toward: Sequence[float] | Floats = (0.8, 0.9, 0.45)
    focus: Sequence[float] | Floats | None = None
    head: bool = True
    cut_away: int = 0

    def __post_init__(self) -> None:
        for each in self.layers:
            if isinstance(each, SurfaceLayer) and each.values is not None and each.scale is None:
                raise InputError(f"scale of {each.name}", None, "a ColourScale for the values")
        kept = [each for each in self.layers if isinstance(each, VolumeLayer) or len(each.triangles)]
        if not kept:
            raise InputError("layers", "empty", "at least one with triangles or voxels")
        object.__setattr__(self, "layers", kept)

    def figure(self) -> str:
        """The panel as an HTML figure with its style and program, for a page that has one panel."""
        style, program = (_FOLDER.joinpath(f"panel.{kind}").read_text(encoding="utf-8") for kind in ("css", "js"))
        caption = f"{self.caption} {_HOW}".strip()
        return (
            f'<style>\n{style}</style>\n<figure class="panel" id="panel">\n<p class="missing">{_MISSING}</p>\n'
            f'<div class="live" hidden>\n<div class="box"><canvas tabindex="0" role="img" '
            f'aria-label="{escape(self.title)}; arrow keys turn the view"></canvas></div>\n'
            '<div class="switches"></div>\n<div class="places"></div>\n<div class="scales"></div>\n</div>\n'
            f"<figcaption>{escape(caption)}</figcaption>\n</figure>\n<script>\n{program}"
            f'showPanel(document.getElementById("panel"), {self.data});\n</script>'
        )

    @property
    def data(self) -> str:
        """The scene as JSON that can stand in a script: arrays as base64, points in 65535ths of the bounding box."""
        surfaces = [each for each in self.layers if isinstance(each, SurfaceLayer)]
        volumes = [_thinned(each) for each in self.layers if isinstance(each, VolumeLayer)]
        ends = [surface.points[np.unique(surface.triangles)] for surface in surfaces]
        for volume in volumes:
            ends.append(np.stack([volume.origin, volume.origin + volume.spacing * (np.array(volume.values.shape) - 1)]))
        low, high = (edge([edge(each, axis=0) for each in ends], axis=0) for edge in (np.min, np.max))
        high = np.maximum(high, low + 1e-9)
        scales = list({id(each.scale): each.scale for each in self.layers if each.scale is not None}.values())
        shapes: dict[tuple[int, int], int] = {}
        shaped: list[dict[str, Any]] = []
        drawn = []
        for each in surfaces:
            small = _decimated(each)
            key = id(each.points), id(each.triangles)
            if key not in shapes:
                shapes[key] = len(shaped)
                at = np.rint(65535 * (small.points - low) / (high - low)).clip(0, 65535)
                shaped.append({"points": _text(at, "<u2"), "triangles": _text(small.triangles, "<u4"), "edges": False})
            shaped[shapes[key]]["edges"] |= each.edges
            drawn.append(
                {
                    "name": each.name,
                    "shape": shapes[key],
                    "colour": [int(each.colour[k : k + 2], 16) / 255 for k in (1, 3, 5)],
                    "scale": None if each.values is None else scales.index(each.scale),  # type: ignore[arg-type]
                    "values": None if small.values is None else _text(each.scale.bytes_of(small.values), "u1"),  # type: ignore[union-attr]
                    **{name: getattr(each, name) for name in ("opacity", "shown", "edges", "whole")},
                }
            )
        filled = [
            {
                "name": each.name,
                "values": _text(each.scale.bytes_of(each.values), "u1"),
                "shape": list(each.values.shape),
                "origin": _numbers(each.origin),
                "spacing": _numbers(each.spacing),
                "scale": scales.index(each.scale),
                "opacity": each.opacity,
                "shown": each.shown,
            }
            for each in volumes
        ]
        keys = [
            {"label": each.label, "low": f"{each.low:.3g}", "high": f"{each.high:.3g}", "colours": _text(each.palette(), "u1")}
            for each in scales
        ]  # fmt: skip
        scene = {
            "low": _numbers(low),
            "high": _numbers(high),
            "focus": _numbers((low + high) / 2 if self.focus is None else np.clip(self.focus, low, high)),
            "toward": _numbers(self.toward),
            "head": self.head,
            "cut": self.cut_away,
            "shapes": shaped,
            "surfaces": drawn,
            "volumes": filled,
            "scales": keys,
        }
        return json.dumps(scene, ensure_ascii=False).replace("<", "\\u003c")  # so that no name closes the script

    def html(self) -> str:
        """The panel as a page of its own."""
        return f"{_PAGE[0]}{escape(self.title)}{_PAGE[1]}{self.figure()}\n</body></html>\n"

    def write(self, path: str | Path) -> Path:
        """Write the page to a file."""
        path = Path(path)
        atomic_write(path, lambda part: part.write_text(self.html(), encoding="utf-8"))
        return path

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{escape(self.html())}" style="width: 100%; height: 44rem; border: 0"></iframe>'


def colour_code(rgb: Sequence[float] | Floats) -> str:
    """Red, green, blue (0 to 1) as "#rrggbb"."""
    return "#" + "".join(f"{round(255 * float(each)):02x}" for each in rgb[:3])


def scan_layers(
    t1: np.ndarray | None,
    labels: np.ndarray,
    names: Sequence[str],
    colours: Sequence[str],
    origin: Floats,
    spacing: Floats,
) -> list[SurfaceLayer | VolumeLayer]:
    """A scan and its labels; the labels are switched off where there is a scan.

    Parameters
    ----------
    t1 : ndarray, shape (nx, ny, nz), or None
        Grey values on the voxels of the labels.
    labels : ndarray of int, shape (nx, ny, nz)
        0 outside, else the number of the label.
    names : sequence of str
        Names of labels 1, 2 ...
    colours : sequence of str
        Their colours "#rrggbb".
    origin, spacing : ndarray, shape (3,)
        Centre of voxel (0, 0, 0) and voxel sizes (m).

    Returns
    -------
    list of VolumeLayer
    """
    made: list[SurfaceLayer | VolumeLayer] = []
    spacing = np.broadcast_to(np.asarray(spacing, float), (3,))
    if t1 is not None:
        low, high = np.percentile(t1[labels > 0], [1, 99.7])
        grey = np.where(t1 > 0.05 * high, t1.astype(float), np.nan)  # the background is not drawn
        made.append(VolumeLayer("scan", grey, origin, spacing, ColourScale("", low, max(high, low + 1e-9), GREY)))
    palette = np.array([[int(colour[k : k + 2], 16) for k in (1, 3, 5)] for colour in colours])
    numbers = np.where(labels > 0, labels.astype(float), np.nan)
    scale = ColourScale("", 1, max(len(names), 2), palette if len(names) > 1 else np.repeat(palette, 2, axis=0))
    name = f"labels ({', '.join(names)})" if len(names) <= 5 else "labels"
    made.append(VolumeLayer(name, numbers, origin, spacing, scale, 1.0 if t1 is None else 0.45, t1 is None))
    return made


def _numbers(values: Any) -> list[float]:
    return [float(f"{value:.7g}") for value in np.asarray(values, float)]


def _text(values: Any, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode()


def _decimated(layer: SurfaceLayer) -> SurfaceLayer:
    """Without unused vertices, and with vertices merged on a grid where there are too many triangles."""
    used, triangles = np.unique(layer.triangles, return_inverse=True)
    points, triangles = np.asarray(layer.points)[used], triangles.reshape(-1, 3)
    values = None if layer.values is None else np.asarray(layer.values, float)[used]
    step = math.sqrt(_area(points, triangles) / MOST_TRIANGLES)
    while len(triangles) > MOST_TRIANGLES:
        cells = np.unique(np.floor(points / step).astype(int), axis=0, return_inverse=True)[1].ravel()
        count = np.bincount(cells)
        points = np.stack([np.bincount(cells, points[:, k]) / count for k in range(3)], axis=1)
        values = None if values is None else np.bincount(cells, values) / count
        triangles = cells[triangles]
        ends = np.sort(triangles, axis=1)
        triangles = triangles[(ends[:, 0] < ends[:, 1]) & (ends[:, 1] < ends[:, 2])]
        step *= 1.5
    return SurfaceLayer(layer.name, points, triangles, layer.colour, values)


def _area(points: Floats, triangles: Ints) -> float:
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum() / 2)


def _thinned(layer: VolumeLayer) -> VolumeLayer:
    """With few enough voxels."""
    step = math.ceil((layer.values.size / MOST_VOXELS) ** (1 / 3))
    values = layer.values[::step, ::step, ::step]
    return VolumeLayer(
        layer.name, values, np.asarray(layer.origin), step * np.asarray(layer.spacing), layer.scale, layer.opacity, layer.shown
    )  # fmt: skip
