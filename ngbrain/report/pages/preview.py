"""The page of a scene before it is computed: geometry, regions, boundary conditions, cleft and tool."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.errors import require
from ngbrain.look import notebook_figure
from ngbrain.report.pages.page import write_page
from ngbrain.report.pictures.panel import Panel, SurfaceLayer, VolumeLayer, colour_code, scan_layers
from ngbrain.report.pictures.slices import ScanImage
from ngbrain.report.pictures.style import DPI, STEEL, bar_mm, inches, png, style
from ngbrain.report.render.renderer import Camera, Layer, draw
from ngbrain.report.render.surface import Floats, Ints, cut_surface, cut_tets, outer_triangles, vertex_normals

KINDS = {
    "fixed": "#7A7A7A",
    "moved": "#D55E00",
    "rotated": "#AA3377",
    "sliding": "#8C6D00",
    "traction": "#0072B2",
    "pressure": "#56B4E9",
    "contact": "#009E73",
    "walls of the cleft": "#FF5CA8",
}
"""Kinds of boundary conditions, and their colours."""
REGIONS = ("#F3DCC2", "#DDE6CF", "#CFE0F0", "#E8D3E8", "#F4F0B8", "#D5D5D5")
"""Colours of regions."""
FREE, TOOL, GHOST = "#EFE8DC", "#7A858C", "#B04A00"
WIDE = 4.6
"""Width of a picture (inches); a page shows them side by side or, on a phone, below each other."""
STILL = 1e-4
"""Displacement (m) below which no arrow is drawn: surfaces are found on grids."""
VIEWS = ((0, 1, 2), (1, 0, 2), (2, 0, 1))
"""Normal axis of a slice, axis to its right (of a head to its left), axis upwards."""
NAMES = ("Sagittal", "Coronal", "Axial")


@dataclass(frozen=True, eq=False)
class Condition:
    """A boundary condition of the scene.

    Parameters
    ----------
    kind : str
        A key of `KINDS`.
    words : str
        Description in a line.
    boundaries : tuple of str
        Names of its boundaries.
    way : ndarray, shape (3,), optional
        Displacement or load direction (m).
    """

    kind: str
    words: str
    boundaries: tuple[str, ...]
    way: Floats | None = None


@dataclass(frozen=True, eq=False)
class RigidBodyDrawing:
    """A rigid body, a tool or an indenter, in its first and last position.

    Parameters
    ----------
    name : str
        Name.
    points : ndarray, shape (n, 3)
        Vertices in the first position (m).
    triangles : ndarray of int, shape (m, 3)
        Triangles.
    last : tuple of ndarray
        Vertices (m) and triangles in the last position.
    """

    name: str
    points: Floats
    triangles: Ints
    last: tuple[Floats, Ints]

    @property
    def way(self) -> Floats:
        """Displacement (m) of its centre from the first to the last position; zero for a tool that widens."""
        return np.asarray(_middle(self.last[0]) - _middle(self.points))


@dataclass(frozen=True, eq=False)
class Drawing:
    """Everything that is drawn of a scene.

    Parameters
    ----------
    title : str
        Title of the page.
    points : ndarray, shape (n, 3)
        Vertices (m).
    tets : ndarray of int, shape (m, 4)
        Tetrahedra.
    region : ndarray of str, shape (m,)
        Region names.
    faces : dict of str to ndarray of int, shape (k, 3)
        Boundary → triangles.
    focus : ndarray, shape (3,)
        Common point of the slices (m).
    head : bool
        Whether it is a head, drawn in radiological convention.
    conditions : sequence of Condition
        Boundary conditions.
    solids : sequence of RigidBodyDrawing
        Rigid bodies.
    image : ScanImage, optional
        The scan of the head.
    coarse : bool
        Whether the elements are larger than those of the computation.
    tables : dict of str to list of tuple of str
        Heading → rows of text below the pictures.
    warnings : sequence of str
        Warnings.
    """

    title: str
    points: Floats
    tets: Ints
    region: np.ndarray
    faces: dict[str, Ints]
    focus: Floats
    head: bool
    conditions: Sequence[Condition] = ()
    solids: Sequence[RigidBodyDrawing] = ()
    image: ScanImage | None = None
    coarse: bool = False
    tables: dict[str, list[tuple[str, ...]]] = field(default_factory=dict)
    warnings: Sequence[str] = ()

    @property
    def colours(self) -> dict[str, str]:
        """Region → colour."""
        names = sorted(set(self.region.tolist()))
        return {name: REGIONS[i % len(REGIONS)] for i, name in enumerate(names)}

    def boundary_colour(self, name: str) -> str:
        """Colour of a boundary: that of the last condition on it."""
        kinds = [each.kind for each in self.conditions if name in each.boundaries]
        return KINDS[kinds[-1]] if kinds else FREE


def build(path: str | os.PathLike[str], drawing: Drawing) -> Path:
    """Write the page of a scene.

    Parameters
    ----------
    path : str or path-like
        Output file.
    drawing : Drawing
        The scene.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    MissingExtra
        matplotlib or jinja2 is not installed.
    """
    with style():
        pictures = {f"slice{i}": _slice(drawing, *view) for i, view in enumerate(VIEWS)}
        pictures["space"] = _space(drawing)
    kinds = {each.kind: KINDS[each.kind] for each in drawing.conditions}
    return write_page(
        Path(path),
        "preview.html",
        pictures,
        drawing=drawing,
        slices=[f"slice{i}" for i in range(len(VIEWS))],
        titles=[_title(drawing, axis) for axis, _, _ in VIEWS],
        kinds=kinds,
        regions={} if drawing.image else drawing.colours,
        tool=TOOL,
        ghost=GHOST,
        solids=[solid.name for solid in drawing.solids],
        panel=panel(drawing),
    )


def plot_drawing(drawing: Drawing) -> Any:
    """Plot the pictures of the page as one figure, with a legend of the boundary conditions.

    Parameters
    ----------
    drawing : Drawing
        The scene.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    MissingExtra
        matplotlib is not installed.
    """
    patch = require("matplotlib.patches", "report").Patch
    with style():
        made = notebook_figure(figsize=(2 * WIDE, 2 * WIDE), dpi=DPI)
        panels = made.subplots(2, 2, gridspec_kw={"left": 0, "right": 1, "bottom": 0.07, "top": 0.97, "wspace": 0.02})
        for axes, view in zip(panels.flat[1:], VIEWS, strict=True):
            _draw_slice(axes, drawing, *view)
            axes.set_title(_title(drawing, view[0]))
        _draw_space(panels.flat[0], drawing)
        colours = {each.kind: KINDS[each.kind] for each in drawing.conditions}
        colours |= {} if drawing.image is not None else drawing.colours
        marks = [patch(facecolor=colour, label=name) for name, colour in colours.items()]
        made.legend(handles=marks, loc="lower center", ncols=max(len(marks), 1), frameon=False)
    return made


def panel(drawing: Drawing, deformed: SurfaceLayer | None = None) -> Panel:
    """Boundaries in the colours of their conditions, rigid bodies, elements and scan, to be turned.

    Parameters
    ----------
    drawing : Drawing
        The scene.
    deformed : SurfaceLayer, optional
        The body after the loads.

    Returns
    -------
    Panel
    """
    by_kind: dict[str, list[Ints]] = {}
    for name, tris in drawing.faces.items():
        colour = drawing.boundary_colour(name)
        kind = next((kind for kind, own in KINDS.items() if own == colour), "free surface")
        by_kind.setdefault(kind, []).append(tris)
    layers: list[SurfaceLayer | VolumeLayer] = [] if deformed is None else [deformed]
    for solid in drawing.solids:
        last = SurfaceLayer(f"{solid.name}, last position", *solid.last, GHOST, opacity=0.4, shown=False, whole=True)
        layers += [SurfaceLayer(solid.name, solid.points, solid.triangles, colour_code(STEEL), whole=True), last]
    clear = drawing.head or deformed is not None
    for kind, parts in by_kind.items():
        opacity = 0.35 if clear and (kind in ("free surface", "fixed", "sliding") or deformed is not None) else 1.0
        tris = np.concatenate(parts)
        layers.append(SurfaceLayer(kind, drawing.points, tris, KINDS.get(kind, "#d9cdb8"), opacity=opacity))
    every = outer_triangles(drawing.tets)
    layers.append(
        SurfaceLayer(
            "elements at the surface",
            drawing.points,
            every,
            "#5a6b7a",
            edges=True,
            shown=not drawing.head and deformed is None,
        )
    )
    inner = sorted(set(drawing.region.tolist()))
    for name in inner if len(inner) > 1 else ():
        tris = outer_triangles(drawing.tets[drawing.region == name])
        layers.append(SurfaceLayer(f"region {name}", drawing.points, tris, drawing.colours[name], shown=False))
    if drawing.image is not None:
        names, tints = (
            ("CSF", "grey matter", "white matter", "ventricles"),
            ("#56B4E9", "#999999", "#F2E6C9", "#0072B2"),
        )
        image = drawing.image
        layers += scan_layers(image.t1, image.labels, names, tints, image.origin, np.full(3, image.spacing))
    side = np.sign(drawing.focus[0] - _middle(drawing.points)[0]) or 1.0
    toward = (0.75 * side, 0.75, 0.65) if drawing.head else (0.6, -1.0, 0.7)
    return Panel(layers, "The scene in three dimensions", toward=toward, focus=drawing.focus, head=drawing.head)


@lru_cache(maxsize=1)  # a report is written after each model, of one scene
def space_picture(drawing: Drawing) -> bytes:
    """The scene in space, as a PNG."""
    with style():
        return _space(drawing)


def _title(drawing: Drawing, axis: int) -> str:
    where = f"{'xyz'[axis]} = {1e3 * drawing.focus[axis]:.1f} mm".replace("-", "−")
    return f"{NAMES[axis]}, {where}" if drawing.head else where


def _page(height: float) -> Any:
    return require("matplotlib.figure", "report").Figure(figsize=(WIDE, height), dpi=DPI)


def _slice(drawing: Drawing, normal: int, across: int, up: int) -> bytes:
    """A plane through the focus as PNG."""
    _, size = _extent(drawing)
    made = _page(WIDE * size[up] / size[across])
    _draw_slice(made.add_axes((0, 0, 1, 1)), drawing, normal, across, up)
    return png(made)


def _extent(drawing: Drawing) -> tuple[Floats, Floats]:
    """Centre and size (mm) of what a slice shows: the body with a margin."""
    low, high = (1e3 * edge(drawing.points, axis=0) for edge in (np.min, np.max))
    return (low + high) / 2, high - low + 0.28 * (high - low).max()


def _draw_slice(axes: Any, drawing: Drawing, normal: int, across: int, up: int) -> None:
    """A plane through the focus: regions or the scan, boundary conditions, and rigid bodies in their first and last position."""
    collections = require("matplotlib.collections", "report")
    middle, size = _extent(drawing)
    flat, level = [across, up], drawing.points[:, normal] - drawing.focus[normal] - 1e-9
    if drawing.image is not None:
        _scan(axes, drawing.image, normal, across, up, drawing.focus[normal])
    else:
        cut = cut_tets(drawing.tets, level, np.arange(len(drawing.tets)))
        corners = 1e3 * cut.interpolate(drawing.points)[:, flat][cut.simplices]
        fill = [drawing.colours[name] for name in drawing.region[cut.parent]]
        axes.add_collection(
            collections.PolyCollection(corners, facecolors=fill, edgecolors="#00000030", linewidths=0.3)
        )
    for name, tris in drawing.faces.items():
        lines, colour = _lines(drawing.points, tris, level, flat), drawing.boundary_colour(name)
        free = colour == FREE
        look = {"colors": "#555555" if free else colour, "linewidths": 0.7 if free else 2.6, "capstyle": "round"}
        axes.add_collection(collections.LineCollection(lines, **look))
    for solid in drawing.solids:
        for points, tris, colour in ((solid.points, solid.triangles, TOOL), (*solid.last, GHOST)):
            lines = _lines(points, tris, points[:, normal] - drawing.focus[normal] - 1e-9, flat)
            axes.add_collection(collections.LineCollection(lines, colors=colour, linewidths=2.2, capstyle="round"))
    x, y = (middle[axis] + size[axis] / 2 * np.array([-1, 1]) for axis in flat)
    axes.set(xlim=x[::-1] if drawing.head else x, ylim=y)
    axes.set_aspect("equal")
    _decorate(axes, drawing, across, up)


def _lines(points: Floats, tris: Ints, level: Floats, flat: list[int]) -> Floats:
    """Intersection lines of triangles and a plane (k, 2, 2) in mm."""
    cut = cut_surface(tris, level)
    return np.asarray(1e3 * cut.interpolate(points)[:, flat][cut.simplices])


def _scan(axes: Any, image: ScanImage, normal: int, across: int, up: int, where: float) -> None:
    from ngbrain.image.segment.tissue_classes import VENTRICLE, WHITE
    from ngbrain.report.pictures.slices import BORDER, FLUID, OUTLINE

    layer = image.nearest(normal, where)
    grey, label = (np.take(each, layer, normal).T for each in (image.t1, image.labels))
    window = np.percentile(image.t1[image.labels > 0], [1, 99.7])
    axes.imshow(
        grey, origin="lower", extent=image.extent(across, up), cmap="gray", vmin=window[0], vmax=max(window[1], window[0] + 1e-9)
    )  # fmt: skip
    for inside, colour in ((label >= WHITE, BORDER), (label > 0, OUTLINE), (label == VENTRICLE, FLUID)):
        if inside.any() and not inside.all():
            axes.contour(
                image.centres(across), image.centres(up), inside.astype(float), [0.5], colors=colour, linewidths=0.8
            )


def _decorate(axes: Any, drawing: Drawing, across: int, up: int) -> None:
    dark = drawing.image is not None
    ink = "white" if dark else "#222222"
    axes.set_facecolor("black" if dark else "white")
    axes.tick_params(left=False, bottom=False, labelleft=False, labelbottom=False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    letters = (("R", "L"), ("A", "P"), ("S", "I")) if drawing.head else (("+x", "−x"), ("+y", "−y"), ("+z", "−z"))
    left, right = letters[across] if drawing.head else letters[across][::-1]
    for text, at in (
        (left, (0.05, 0.5)),
        (right, (0.95, 0.5)),
        (letters[up][0], (0.5, 0.96)),
        (letters[up][1], (0.5, 0.04)),
    ):
        axes.text(*at, text, transform=axes.transAxes, ha="center", va="center", fontsize=13, weight="bold", color=ink)
    (a, b), (c, d) = axes.get_xlim(), axes.get_ylim()
    long = _round(0.25 * abs(b - a))
    x, y = a + 0.05 * (b - a), c + 0.04 * (d - c)
    axes.plot([x, x + np.sign(b - a) * long], [y, y], color=ink, lw=3, solid_capstyle="butt")
    axes.text(x, y + 0.015 * (d - c), f"{long:g} mm", ha="left", va="bottom", fontsize=12, color=ink)


def _middle(points: Floats) -> Floats:
    """Centre of the bounding box of points."""
    return np.asarray((points.min(axis=0) + points.max(axis=0)) / 2)


def _round(length: float) -> float:
    """The largest of 1, 2 or 5 times a power of ten up to a length."""
    ten = 10.0 ** np.floor(np.log10(length))
    return float(max(step * ten for step in (1, 2, 5) if step * ten <= length))


def _space(drawing: Drawing) -> bytes:
    """The view in space as PNG."""
    made = _page(WIDE)
    _draw_space(made.add_axes((0, 0, 1, 1)), drawing)
    return png(made)


def _draw_space(axes: Any, drawing: Drawing) -> None:
    """A view from the front, the side and above: boundary conditions, rigid bodies and arrows of motion."""
    every = np.concatenate([drawing.points, *(solid.points for solid in drawing.solids if drawing.head)])
    low, high = drawing.points.min(axis=0), drawing.points.max(axis=0)
    middle = (low + high) / 2
    reach = 1.18 * float(np.linalg.norm(every - middle, axis=1).max())
    side = np.sign(drawing.focus[0] - middle[0]) or 1.0
    toward = np.array([0.75 * side, 0.75, 0.65]) if drawing.head else np.array([0.6, -1.0, 0.7])
    camera = Camera.look_at(middle, toward, np.array([0, 0, 1.0]), reach, reach)
    layers = []
    colors = require("matplotlib.colors", "report")
    for name, tris in drawing.faces.items():
        colour = np.array(colors.to_rgb(drawing.boundary_colour(name)))
        normals = vertex_normals(drawing.points, tris) if drawing.head else None
        # The head's surface is transparent, since the cleft and the tool are behind it.
        through = drawing.head and drawing.boundary_colour(name) in (FREE, KINDS["fixed"], KINDS["sliding"])
        layers.append(
            Layer(
                drawing.points,
                tris,
                0.35 * colour + 0.65 if through else colour,
                normals,
                opacity=0.4 if through else 1.0,
            )
        )
    for solid in drawing.solids:
        layers.append(Layer(solid.points, solid.triangles, STEEL, shine=0.35))
    pixels = [round(axes.figure.dpi * each) for each in inches(axes)]
    axes.imshow(draw(camera, layers, *pixels), extent=[1e3 * reach * s for s in (-1, 1, -1, 1)], interpolation="none")
    axes.axis("off")
    for each in drawing.conditions:
        if each.way is not None and np.any(each.way):
            _arrow(axes, camera, drawing, each, reach)
    for solid in drawing.solids:
        if np.linalg.norm(solid.way) > STILL:
            _pointed(axes, camera, _middle(solid.points), solid.way, reach, GHOST)
    bar_mm(axes, _round(0.4e3 * reach))
    _axes(axes, camera, drawing.head, 1e3 * reach)


def _arrow(axes: Any, camera: Camera, drawing: Drawing, each: Condition, reach: float) -> None:
    nodes = [np.unique(drawing.faces[name]) for name in each.boundaries if name in drawing.faces]
    if nodes:
        _pointed(axes, camera, drawing.points[np.concatenate(nodes)].mean(axis=0), each.way, reach, KINDS[each.kind])


def _pointed(axes: Any, camera: Camera, start: Floats, way: Floats | None, reach: float, colour: str) -> None:
    """An arrow of one length along a direction, with its tip on the surface: directions, not magnitudes."""
    unit = np.asarray(way) / np.linalg.norm(np.asarray(way))
    tail, head = 1e3 * camera.project(np.array([start - 0.3 * reach * unit, start]))[:, :2]
    look = {"arrowstyle": "-|>", "color": colour, "lw": 2.6, "mutation_scale": 18, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", head, tail, arrowprops=look, zorder=30)


def _axes(axes: Any, camera: Camera, head: bool, reach: float) -> None:
    at = np.array([0.70, -0.80]) * reach
    for k, letter in enumerate("RAS" if head else "xyz"):
        v = np.array([camera.right[k], camera.up[k]])
        if np.linalg.norm(v) < 0.2:
            continue
        tip = at + 0.2 * reach * v
        look = {"arrowstyle": "-|>", "color": "#222222", "lw": 1.4, "mutation_scale": 10, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", tip, at, arrowprops=look, zorder=30)
        axes.text(*(at + 0.27 * reach * v), letter, ha="center", va="center", fontsize=12, weight="bold", zorder=30)
