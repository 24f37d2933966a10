"""The pictures of a retraction report; each function gives the bytes of a PNG."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ngbrain.errors import require
from ngbrain.report.peak import ABOVE, Peak
from ngbrain.report.render import Camera, Layer, draw
from ngbrain.report.surface import Cut, Floats, Ints, cut_surface, cut_volume, faces, triangles, vertex_normals

DPI = 200
WIDTH = 9.0
"""Of every picture, in inches: 1800 pixels, shown at 900 or less."""
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
COLOURS = {"continuous": "#0072B2", "intermittent": "#D55E00", "staged": "#009E73"}
SPARE = ("#CC79A7", "#8C6D00", "#56B4E9", "#000000")
DASHES = {"continuous": "-", "intermittent": (0, (5, 1.6)), "staged": (0, (6, 1.4, 1.4, 1.4))}
STRAIN_TOP, STRAIN_STEP = 0.40, 0.05
SKULL_THICKNESS = 5e-3
"""Of the skull as drawn on the slice (m): it is not part of the model."""
FIRST_S = 60.0
THRESHOLDS = (20.0, 30.0)

BONE = np.array([0.93, 0.89, 0.80])
FLUID = np.array([0.45, 0.65, 0.85])
STEEL = np.array([0.62, 0.66, 0.70])
RIM = "#333333"
REGIONS = {"white": "white matter"}


def head(peak: Peak) -> bytes:
    """The head with blade and opening from outside; beside it the site, near and cut open along the blade's push."""
    with _style():
        figure = _figure(4.9)
        cmap, norm = _strain_colours()
        cleft = peak.cleft
        up = np.array([0, 0, 1.0]) if abs(cleft.out[2]) < 0.97 else np.array([0, 1.0, 0])
        side = np.array([np.sign(cleft.target[0]) or 1.0, 0, 0])
        toward = 0.55 * cleft.out + 0.85 * np.array([0, 1.0, 0]) + 0.45 * side
        middle = (peak.rest.max(axis=0) + peak.rest.min(axis=0)) / 2
        reach = float(np.linalg.norm(peak.rest - middle, axis=1).max()) * 1.12
        axes = figure.add_axes((0.0, 0.03, 0.475, 0.87))
        shape = _shape(axes)
        camera = Camera.look(middle + 0.10 * reach * up, toward, up, reach * shape[0] / shape[1], reach)
        opened = _opened_layers(peak, cmap, norm)
        blade = _blade_layer(peak)
        skull = peak.skull()
        hull = Layer(peak.points, skull, BONE, vertex_normals(peak.points, skull), opacity=0.42)
        inner = peak.ventricles()
        ventricles = Layer(peak.points, inner, FLUID, vertex_normals(peak.points, inner))
        _show(axes, camera, [*opened, blade, ventricles, hull])
        _rim(axes, camera, peak)
        axes.set_title("The head, its surface seen through", pad=8)
        _triad(axes, camera, (0.12, 0.10))
        _scale_bar(axes, camera, 50)
        ring, far = _rim_points(peak), peak.points[np.unique(inner)]
        _call(axes, camera, cleft.entry + 0.9 * ABOVE * cleft.out, "blade", (0.72, 0.95))
        if len(ring):
            _call(axes, camera, ring[np.argmin(ring @ camera.right)], "craniotomy", (0.13, 0.90))
        if len(far):
            _call(axes, camera, far[np.argmax(far @ (camera.right - 0.5 * camera.up))], "ventricles", (0.86, 0.10))

        near = figure.add_axes((0.485, 0.03, 0.445, 0.87))
        _cutaway(near, peak, cmap, norm)
        near.set_title("The site, cut open through its middle", pad=8)
        _strain_bar(figure, (0.942, 0.16, 0.013, 0.60), cmap, norm)
        return _png(figure)


def pressure(answers: Mapping[str, Any]) -> bytes:
    """Pressure under the blade and opening over time: the first minute, and the whole time in minutes."""
    with _style():
        figure = _figure(5.4)
        end = max(max(a["series"]["t_s"]) for a in answers.values())
        both = end > 1.5 * FIRST_S
        grid = figure.add_gridspec(
            2, 2 if both else 1, width_ratios=[1, 1.75] if both else None, height_ratios=[1.7, 1],
            left=0.075, right=0.925, top=0.865, bottom=0.095, wspace=0.10, hspace=0.14,
        )  # fmt: skip
        top = 1.08 * max([THRESHOLDS[-1] * 1.1, *(max(a["series"]["pressure_mmHg"]) for a in answers.values())])
        lines = []
        for column in range(2 if both else 1):
            seconds = column == 0
            upper, lower = figure.add_subplot(grid[0, column]), figure.add_subplot(grid[1, column])
            for name, answer in answers.items():
                s = answer["series"]
                t = np.array(s["t_s"]) / (1 if seconds else 60)
                look = {"color": colour(name, answers), "ls": DASHES.get(name, "-"), "lw": 1.9, "label": name}
                (line,) = upper.plot(t, s["pressure_mmHg"], **look)
                lower.plot(t, s["opening_mm"], **look)
                lower.plot(t, s["blade_mm"], color=look["color"], lw=0.9, ls=":")
                lines += [line] if column == 0 else []
            for threshold in THRESHOLDS:
                upper.axhline(threshold, color="#555555", lw=1.0, ls=(0, (2, 2)), zorder=1)
            if column == (1 if both else 0):
                _name_thresholds(upper, top)
            span = min(FIRST_S, end) if seconds else end / 60
            for axes in (upper, lower):
                axes.set_xlim(0, span)
                axes.grid(axis="y", color="#e3e3e3", lw=0.6)
                axes.set_axisbelow(True)
                axes.tick_params(labelleft=seconds)
            upper.set_ylim(0, top)
            upper.tick_params(labelbottom=False)
            lower.set_ylim(*_limits(answers))
            lower.set_xlabel("time from first contact (s)" if seconds else "time from first contact (min)")
            if seconds:
                upper.set_ylabel("pressure under the blade (mmHg)")
                lower.set_ylabel("opening (mm)")
            first = f"First {span:.0f} s" if both else "Whole time"
            upper.set_title(first if seconds else "Whole time")
        ghost = require("matplotlib.lines", "report").Line2D([], [], color="#555555", lw=1.0, ls=":", label="the blade itself")
        figure.legend(handles=[*lines, ghost], loc="upper left", bbox_to_anchor=(0.065, 0.995), ncols=len(lines) + 1, frameon=False, fontsize=10.5)
        return _png(figure)


def strain_slice(peak: Peak) -> bytes:
    """Maximum principal strain on the plane of approach and push through the target, displaced: whole and near."""
    with _style():
        figure = _figure(4.75)
        cmap, norm = _strain_colours()
        centre = peak.cleft.depth / 2 + 3e-3
        whole = figure.add_axes((0.01, 0.02, 0.44, 0.88))
        near = figure.add_axes((0.475, 0.02, 0.455, 0.88))
        plane = _Plane(peak)
        low, high = plane.extent()
        half = max(high - low) / 2 + 11e-3
        for axes, middle, reach in ((whole, (low + high) / 2, half), (near, np.array([0.0, centre]), 30e-3)):
            wide, tall = _shape(axes)
            shrink = reach / min(wide, tall)
            axes.set_xlim(*(1e3 * (middle[0] + np.array([-1, 1]) * shrink * wide)))
            axes.set_ylim(*(1e3 * (middle[1] + np.array([-1, 1]) * shrink * tall)))
            axes.set_aspect("equal")
            axes.axis("off")
            plane.draw(axes, cmap, norm)
            _bar_mm(axes, 20 if axes is whole else 10)
        whole.set_title("Slice through the site" + _viewed_from(peak), pad=8)
        near.set_title("The site, 60 mm across", pad=8)
        _ends(whole, peak)
        patches = require("matplotlib.patches", "report")
        box = (-30, 1e3 * centre - 30)
        whole.add_patch(patches.Rectangle(box, 60, 60, fill=False, ec="#333333", lw=0.8, ls=(0, (4, 3)), zorder=9))
        plane.name_regions(whole)
        x = 1e3 * (peak.cleft.opening / 2 + peak.advance - peak.blade["thickness_m"] / 2)
        _say(near, "blade", (x, 1e3 * (peak.cleft.depth + 9e-3)), (x - 12, 1e3 * (peak.cleft.depth + 11e-3)))
        window = 1e3 * peak.craniotomy / 2
        _say(near, "edge of the\ncraniotomy", (-window, 1e3 * peak.cleft.depth - 1.5), (-window - 1, 1e3 * peak.cleft.depth + 9))
        _strain_bar(figure, (0.942, 0.14, 0.013, 0.62), cmap, norm)
        return _png(figure)


def colour(name: str, among: Iterable[str]) -> str:
    """A protocol's colour, the same in every picture."""
    others = [other for other in among if other not in COLOURS]
    return COLOURS.get(name) or SPARE[others.index(name) % len(SPARE)]


# The 3-D view.


def _palette(cmap: Any, norm: Any) -> Callable[[Floats], Floats]:
    return lambda strain: np.asarray(cmap(norm(np.maximum(strain, 0))))[:, :3]


def _opened_layers(peak: Peak, cmap: Any, norm: Any, clip: Floats | None = None) -> list[Layer]:
    """Craniotomy and cleft, coloured by strain."""
    parts, palette = [peak.window(), *peak.cleft_faces().values()], _palette(cmap, norm)
    return [
        Layer(peak.points, tris, peak.strain, vertex_normals(peak.points, tris), clip=clip, palette=palette)
        for tris in parts
        if len(tris)
    ]


def _blade_layer(peak: Peak) -> Layer:
    points, tris = peak.blade_solid()
    return Layer(points, tris, STEEL, shine=0.35)


def _cutaway(axes: Any, peak: Peak, cmap: Any, norm: Any) -> None:
    """The half of the site beyond the slice's plane, seen from the side that the slice is seen from, from above."""
    cleft = peak.cleft
    level = cleft.coordinates(peak.points)[:, 1]
    toward = -cleft.along + 0.62 * cleft.out - 0.25 * cleft.across
    wide, tall = _shape(axes)
    reach = 31e-3 / min(wide, tall)
    centre = cleft.target + (0.5 * cleft.depth + 5e-3) * cleft.out
    camera = Camera.look(centre, toward, cleft.out, reach * wide, reach * tall)
    skull = peak.skull()
    hull = Layer(peak.points, skull, BONE, vertex_normals(peak.points, skull), clip=level)
    cut = cut_volume(peak.tets, level)
    face = Layer(cut.at(peak.points), cut.simplices, cut.at(peak.strain), lit=0.15, palette=_palette(cmap, norm))
    lines = [_ribbons(peak, triangles(faces(peak.tets, group)), level) for group in (None, peak.region)]
    _show(axes, camera, [*_opened_layers(peak, cmap, norm, level), hull, face, *lines, _blade_layer(peak)])
    _triad(axes, camera, (0.90, 0.12))
    _scale_bar(axes, camera, 10)


def _ribbons(peak: Peak, tris: Ints, level: Floats, half_width: float = 0.11e-3) -> Layer:
    """The lines in which triangles meet the slice's plane, as thin strips just before it."""
    cut = cut_surface(tris, level)
    points = cut.at(peak.points) - 0.15e-3 * peak.cleft.along
    p, q = points[cut.simplices[:, 0]], points[cut.simplices[:, 1]]
    beside = np.cross(q - p, peak.cleft.along)
    beside *= half_width / np.maximum(np.linalg.norm(beside, axis=1, keepdims=True), 1e-12)
    corners = np.concatenate([p + beside, q + beside, q - beside, p - beside])
    i, n = np.arange(len(p)), len(p)
    quads = np.concatenate([np.column_stack([i, i + n, i + 2 * n]), np.column_stack([i, i + 2 * n, i + 3 * n])])
    return Layer(corners, quads, np.full(3, 0.2), lit=0.0)


def _show(axes: Any, camera: Camera, layers: list[Layer]) -> None:
    wide, tall = (round(DPI * size) for size in _shape(axes))
    image = draw(camera, layers, wide, tall)
    x, y = 1e3 * camera.half_width, 1e3 * camera.half_height
    axes.imshow(image, extent=(-x, x, -y, y), interpolation="none")
    axes.set_xlim(-x, x)
    axes.set_ylim(-y, y)
    axes.axis("off")


def _rim_points(peak: Peak) -> Floats:
    """The craniotomy's edge, (k, 3), in order around the axis."""
    window = peak.window()
    sides = np.sort(np.concatenate([window[:, [0, 1]], window[:, [1, 2]], window[:, [2, 0]]]), axis=1)
    edges, count = np.unique(sides, axis=0, return_counts=True)
    nodes = np.unique(edges[count == 1])
    at = peak.cleft.coordinates(peak.rest[nodes])
    edge = np.hypot(at[:, 0], at[:, 1]) > 0.8 * peak.craniotomy / 2
    nodes, at = nodes[edge], at[edge]
    return peak.points[nodes[np.argsort(np.arctan2(at[:, 1], at[:, 0]))]]


def _rim(axes: Any, camera: Camera, peak: Peak) -> None:
    ring = 1e3 * camera.project(_rim_points(peak))
    if len(ring):
        axes.plot(*np.vstack([ring, ring[:1]])[:, :2].T, color=RIM, lw=1.3)


def _triad(axes: Any, camera: Camera, at: tuple[float, float]) -> None:
    """Small arrows to the patient's right, front and top; one that points at the viewer is left out."""
    wide, tall = _shape(axes)
    size = 0.36
    for letter, direction in (("R", (1, 0, 0)), ("A", (0, 1, 0)), ("S", (0, 0, 1))):
        x, y = (float(np.dot(direction, v)) for v in (camera.right, camera.up))
        if np.hypot(x, y) < 0.25:
            continue
        end = (at[0] + size * x / wide, at[1] + size * y / tall)
        arrow = {"arrowstyle": "-|>", "color": "#222222", "lw": 1.2, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 9}
        axes.annotate("", end, at, xycoords="axes fraction", textcoords="axes fraction", arrowprops=arrow)
        label = (at[0] + (size * x + 0.13 * x / np.hypot(x, y)) / wide, at[1] + (size * y + 0.13 * y / np.hypot(x, y)) / tall)
        axes.text(*label, letter, transform=axes.transAxes, ha="center", va="center", fontsize=10, fontweight="bold")


def _scale_bar(axes: Any, camera: Camera, mm: float) -> None:
    _bar_mm(axes, mm, 0.40)


def _bar_mm(axes: Any, mm: float, at: float = 0.06) -> None:
    x0, x1 = axes.get_xlim()
    y0, y1 = axes.get_ylim()
    x, y = x0 + at * (x1 - x0), y0 + 0.045 * (y1 - y0)
    axes.plot([x, x + mm], [y, y], color="#222222", lw=2.5, solid_capstyle="butt", zorder=20)
    axes.text(x + mm / 2, y + 0.012 * (y1 - y0), f"{mm:g} mm", ha="center", va="bottom", fontsize=9.5, zorder=20)


def _call(axes: Any, camera: Camera, point: Floats, text: str, at: tuple[float, float]) -> None:
    where = 1e3 * camera.project(point[None])[0, :2]
    line = {"arrowstyle": "-", "color": "#333333", "lw": 0.8, "shrinkA": 1, "shrinkB": 0}
    axes.annotate(text, where, at, textcoords="axes fraction", ha="center", va="center", fontsize=9.5, arrowprops=line)


# The slice.


class _Plane:
    """The displaced mesh cut by the plane of approach and push through the target; coordinates (across, height), m."""

    def __init__(self, peak: Peak) -> None:
        self.peak = peak
        at = peak.cleft.coordinates(peak.points)
        self._flat, self._level = at[:, [0, 2]], at[:, 1]
        self.cut: Cut = cut_volume(peak.tets, self._level)
        self.points = self.cut.at(self._flat)

    def extent(self) -> tuple[Floats, Floats]:
        """Corners of the section."""
        return self.points.min(axis=0), self.points.max(axis=0)

    def draw(self, axes: Any, cmap: Any, norm: Any) -> None:
        """Strain, outlines, skull and blade."""
        tri = require("matplotlib.tri", "report")
        patches = require("matplotlib.patches", "report")
        mesh = tri.Triangulation(*(1e3 * self.points).T, self.cut.simplices)
        levels = np.arange(0, STRAIN_TOP + STRAIN_STEP / 2, STRAIN_STEP)
        strain = np.maximum(self.cut.at(self.peak.strain), 0)
        self._skull(axes)
        axes.tricontourf(mesh, strain, levels, cmap=cmap, norm=norm, extend="max", zorder=2)
        self._lines(axes, triangles(faces(self.peak.tets, self.peak.region)), color="#444444", linewidths=0.8, zorder=3)
        self._lines(axes, triangles(faces(self.peak.tets)), color="#222222", linewidths=1.1, zorder=4)
        profile = 1e3 * self.peak.blade_profile()
        axes.add_patch(patches.Polygon(profile, fc="#9aa3ab", ec="#222222", lw=1.0, zorder=6))

    def name_regions(self, axes: Any) -> None:
        """Each region's name where it has the most room; the lowest of such places."""
        centres = self.points[self.cut.simplices].mean(axis=1)
        region = self.peak.region[self.cut.parent]
        outlines = cut_surface(triangles(faces(self.peak.tets, self.peak.region)), self._level).at(self._flat)
        room = cKDTree(outlines).query(centres)[0]
        halo = require("matplotlib.patheffects", "report").withStroke(linewidth=2.5, foreground="white")
        for name in np.unique(region):
            mine = np.flatnonzero(region == name)
            mine = mine[room[mine] > 0.85 * room[mine].max()]
            x, y = 1e3 * centres[mine[np.argmin(centres[mine, 1])]]
            text = REGIONS.get(name, str(name).split("_")[0])
            axes.text(x, y, text, ha="center", va="center", fontsize=8.5, zorder=8, path_effects=[halo])

    def _lines(self, axes: Any, tris: Ints, **look: Any) -> None:
        lines = require("matplotlib.collections", "report")
        cut = cut_surface(tris, self._level)
        axes.add_collection(lines.LineCollection(1e3 * cut.at(self._flat)[cut.simplices], capstyle="round", **look))

    def _skull(self, axes: Any) -> None:
        """A band outside the held surface."""
        tris = self.peak.skull()
        cut = cut_surface(tris, self._level)
        if not len(cut.simplices):
            return
        normals = self.peak.cleft.coordinates(vertex_normals(self.peak.rest, tris) + self.peak.cleft.target)[:, [0, 2]]
        points, outward = cut.at(self._flat), cut.at(normals)
        outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
        outer = points + SKULL_THICKNESS * outward
        p, q = cut.simplices.T
        collections = require("matplotlib.collections", "report")
        bands = 1e3 * np.stack([points[p], points[q], outer[q], outer[p]], axis=1)
        axes.add_collection(collections.PolyCollection(bands, fc="#d9d2c3", ec="#d9d2c3", lw=0.5, zorder=1))


def _viewed_from(peak: Peak) -> str:
    """The slice is drawn with `across` to the right and `out` upwards: seen from -along."""
    return f", seen from {_direction(-peak.cleft.along, words=True)}"


def _direction(v: Floats, words: bool = False) -> str:
    """The anatomical name of a direction: its large components, the largest first.

    >>> _direction(np.array([0.9, 0.1, -0.42])), _direction(np.array([0, -1.0, 0]), words=True)
    ('RI', 'behind')
    """
    names = (("R", "L"), ("A", "P"), ("S", "I"))
    if words:
        names = (("the right", "the left"), ("the front", "behind"), ("above", "below"))
    order = [k for k in np.argsort(-np.abs(v)) if abs(v[k]) > 0.38][: 1 if words else 2]
    return "".join(names[k][0 if v[k] > 0 else 1] for k in order)


def _ends(axes: Any, peak: Peak) -> None:
    cleft = peak.cleft
    for v, at in ((cleft.across, (0.985, 0.45)), (-cleft.across, (0.015, 0.45)), (-cleft.out, (0.5, 0.015))):
        axes.text(*at, _direction(v), transform=axes.transAxes, ha="center", va="center", fontsize=11, fontweight="bold")
    axes.text(
        0.30, 0.975, _direction(cleft.out), transform=axes.transAxes, ha="center", va="center", fontsize=11, fontweight="bold"
    )


def _say(axes: Any, text: str, point: tuple[float, float], at: tuple[float, float]) -> None:
    line = {"arrowstyle": "-", "color": "#222222", "lw": 0.8, "shrinkA": 1, "shrinkB": 0}
    halo = require("matplotlib.patheffects", "report").withStroke(linewidth=3, foreground="white")
    axes.annotate(text, point, at, ha="center", va="center", fontsize=9.5, arrowprops=line, zorder=10, path_effects=[halo])


# Shared.


def _name_thresholds(axes: Any, top: float) -> None:
    """Beside the plot, apart enough to be read."""
    upper = max(THRESHOLDS[1], THRESHOLDS[0] + 0.05 * top)
    for threshold, y in zip(THRESHOLDS, (THRESHOLDS[0], upper), strict=True):
        where = axes.get_yaxis_transform()
        axes.text(1.01, y, f"{threshold:g} mmHg", transform=where, ha="left", va="center", fontsize=9, color="#333333")


def _limits(answers: Mapping[str, Any]) -> tuple[float, float]:
    values = np.concatenate([np.r_[a["series"]["opening_mm"], a["series"]["blade_mm"]] for a in answers.values()])
    low, high = float(min(values.min(), 0.0)), float(values.max())
    return low - 0.06 * (high - low), high + 0.08 * (high - low)


def _strain_colours() -> tuple[Any, Any]:
    colours = require("matplotlib.colors", "report")
    colormaps = require("matplotlib", "report").colormaps
    bands = round(STRAIN_TOP / STRAIN_STEP)
    steps = colormaps["YlOrRd"](np.linspace(0.0, 1.0, bands))
    cmap = colours.ListedColormap(steps).with_extremes(over="#45001f", under=steps[0])
    edges = np.linspace(0, STRAIN_TOP, bands + 1)
    return cmap, colours.BoundaryNorm(edges, bands)


def _strain_bar(figure: Any, box: tuple[float, float, float, float], cmap: Any, norm: Any) -> None:
    cm = require("matplotlib.cm", "report")
    axes = figure.add_axes(box)
    bar = figure.colorbar(cm.ScalarMappable(norm, cmap), cax=axes, extend="max", ticks=np.arange(0, 0.41, 0.1))
    bar.ax.set_yticklabels([f"{t:.0f} %" for t in np.arange(0, 41, 10)], fontsize=9)
    bar.ax.tick_params(length=2)
    bar.outline.set_linewidth(0.5)
    figure.text(0.995, box[1] + box[3] + 0.055, "largest\nprincipal\nstrain", ha="right", va="bottom", fontsize=9)


def _shape(axes: Any) -> tuple[float, float]:
    """Width and height of axes in inches."""
    box, size = axes.get_position(original=True), axes.figure.get_size_inches()
    return float(box.width * size[0]), float(box.height * size[1])


def _figure(height: float) -> Any:
    return require("matplotlib.figure", "report").Figure(figsize=(WIDTH, height), dpi=DPI)


def _style() -> Any:
    return require("matplotlib", "report").rc_context(STYLE)


def _png(figure: Any) -> bytes:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=DPI, metadata={"Software": None}, pil_kwargs={"optimize": True})
    return stream.getvalue()
