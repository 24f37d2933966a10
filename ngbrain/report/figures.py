"""The pictures of a retraction report; each function gives the bytes of a PNG."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ngbrain.errors import require
from ngbrain.report.peak import Peak
from ngbrain.report.space import head
from ngbrain.report.style import (
    DASHES,
    FLUID,
    STRAIN_STEP,
    STRAIN_TOP,
    bar_mm,
    colour,
    direction,
    figure,
    inches,
    png,
    strain_bar,
    strain_colours,
    style,
    viewed_from,
)
from ngbrain.report.surface import Cut, Floats, Ints, cut_surface, cut_volume, faces, triangles, vertex_normals
from ngbrain.surgery.injury import curve

__all__ = ["head", "pressure", "strain_slice"]

SKULL_THICKNESS = 5e-3
"""Of the skull as drawn on the slice (m): it is not part of the model."""
FIRST_S = 60.0
SAMPLES = 10
"""Points drawn from step to step, where series are smooth."""
THRESHOLDS = (20.0, 30.0)
REGIONS = {"white": "white matter"}


def pressure(answers: Mapping[str, Any]) -> bytes:
    """Pressure under the blade and opening over time: the first minute, and the whole time in minutes."""
    with style():
        page = figure(5.4)
        end = max(max(a["series"]["t_s"]) for a in answers.values())
        both = end > 1.5 * FIRST_S
        grid = page.add_gridspec(
            2, 2 if both else 1, width_ratios=[1, 1.75] if both else None, height_ratios=[1.7, 1],
            left=0.075, right=0.915, top=0.865, bottom=0.095, wspace=0.10, hspace=0.14,
        )  # fmt: skip
        top = 1.08 * max([THRESHOLDS[-1] * 1.1, *(max(a["series"]["pressure_mmHg"]) for a in answers.values())])
        lines = []
        for column in range(2 if both else 1):
            seconds = column == 0
            upper, lower = page.add_subplot(grid[0, column]), page.add_subplot(grid[1, column])
            for name, answer in answers.items():
                s, unit = answer["series"], 1 if seconds else 60
                look = {"color": colour(name, answers), "ls": DASHES.get(name, "-"), "lw": 1.9, "label": name}
                t, pressures = course(answer, "pressure_mmHg")
                (line,) = upper.plot(t / unit, pressures, **look)
                lower.plot(t / unit, course(answer, "opening_mm")[1], **look)
                lower.plot(np.array(s["t_s"]) / unit, s["blade_mm"], color=look["color"], lw=0.9, ls=":")
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


def course(answer: Mapping[str, Any], name: str) -> tuple[Floats, Floats]:
    """Times (s) and values of a series as doses take it, a cubic between events (`injury.curve`), where those are given."""
    t, values = (np.array(answer["series"][key], float) for key in ("t_s", name))
    steps = len(t) - 1
    fine = np.interp(np.linspace(0, steps, SAMPLES * steps + 1), np.arange(len(t)), t)
    return fine, curve(t, values, answer.get("events_s", t))(fine)


def strain_slice(peak: Peak) -> bytes:
    """Maximum principal strain on the plane of approach and push through the target, displaced: whole and near."""
    with style():
        page = figure(4.75)
        cmap, norm = strain_colours()
        centre = peak.cleft.depth / 2 + 3e-3
        whole = page.add_axes((0.01, 0.02, 0.44, 0.88))
        near = page.add_axes((0.475, 0.02, 0.455, 0.88))
        plane = _Plane(peak)
        low, high = plane.extent()
        half = max(high - low) / 2 + 11e-3
        for axes, middle, reach in ((whole, (low + high) / 2, half), (near, np.array([0.0, centre]), 30e-3)):
            wide, tall = inches(axes)
            shrink = reach / min(wide, tall)
            axes.set_xlim(*(1e3 * (middle[0] + np.array([-1, 1]) * shrink * wide)))
            axes.set_ylim(*(1e3 * (middle[1] + np.array([-1, 1]) * shrink * tall)))
            axes.set_aspect("equal")
            axes.axis("off")
            plane.draw(axes, cmap, norm)
            bar_mm(axes, 20 if axes is whole else 10)
        whole.set_title("Slice through the site" + viewed_from(peak), pad=8)
        near.set_title("The site, 60 mm across", pad=8)
        _ends(whole, peak)
        patches = require("matplotlib.patches", "report")
        box = (-30, 1e3 * centre - 30)
        whole.add_patch(patches.Rectangle(box, 60, 60, fill=False, ec="#333333", lw=0.8, ls=(0, (4, 3)), zorder=9))
        plane.name_regions(whole)
        x = 1e3 * peak.blades[0].across(peak.cleft.depth + 9e-3)
        _say(near, peak.tool, (x, 1e3 * (peak.cleft.depth + 9e-3)), (x - 12, 1e3 * (peak.cleft.depth + 11e-3)))
        window = 1e3 * peak.craniotomy / 2
        _say(
            near,
            "edge of the\ncraniotomy",
            (-window, 1e3 * peak.cleft.depth - 1.5),
            (-window - 1, 1e3 * peak.cleft.depth + 9),
        )
        strain_bar(page, (0.942, 0.14, 0.013, 0.62), cmap, norm)
        return png(page)


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
        fluid = np.char.startswith(self.peak.region[self.cut.parent].astype(str), "ventricle")
        drops = (1e3 * self.points)[self.cut.simplices[fluid]]
        collections = require("matplotlib.collections", "report")
        axes.add_collection(collections.PolyCollection(drops, fc=FLUID, ec=FLUID, lw=0.4, zorder=2.5))
        self._lines(axes, triangles(faces(self.peak.tets, self.peak.region)), color="#444444", linewidths=0.8, zorder=3)
        self._lines(axes, triangles(faces(self.peak.tets)), color="#222222", linewidths=1.1, zorder=4)
        for blade in self.peak.blades:
            axes.add_patch(patches.Polygon(1e3 * blade.profile(), fc="#9aa3ab", ec="#222222", lw=1.0, zorder=6))

    def name_regions(self, axes: Any) -> None:
        """Each region's name where it has the most room; the lowest of such places."""
        corners = self.points[self.cut.simplices]
        inside = np.concatenate([np.eye(3) * 0.7 + 0.1, np.full((1, 3), 1 / 3), 0.5 - 0.5 * np.eye(3)])
        centres = np.einsum("ij,kjl->kil", inside, corners).reshape(-1, 2)
        region = np.repeat(self.peak.region[self.cut.parent], len(inside))
        outlines = cut_surface(triangles(faces(self.peak.tets, self.peak.region)), self._level)
        ends = outlines.at(self._flat)[outlines.simplices]
        share = np.linspace(0, 1, 9)[:, None, None]
        room = cKDTree(((1 - share) * ends[:, 0] + share * ends[:, 1]).reshape(-1, 2)).query(centres)[0]
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


def _ends(axes: Any, peak: Peak) -> None:
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


def _say(axes: Any, text: str, point: tuple[float, float], at: tuple[float, float]) -> None:
    line = {"arrowstyle": "-", "color": "#222222", "lw": 0.8, "shrinkA": 1, "shrinkB": 0}
    halo = require("matplotlib.patheffects", "report").withStroke(linewidth=3, foreground="white")
    axes.annotate(
        text, point, at, ha="center", va="center", fontsize=9.5, arrowprops=line, zorder=10, path_effects=[halo]
    )


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
