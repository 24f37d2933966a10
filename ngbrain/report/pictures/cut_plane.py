"""Deformed tissue and blade in the plane of approach and push, through the target."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ngbrain.errors import require
from ngbrain.report.pictures.frame import DeformedHead
from ngbrain.report.pictures.style import FLUID, StrainScale
from ngbrain.report.render.surface import Cut, Floats, Ints, cut_surface, cut_volume, vertex_normals

SKULL_THICKNESS = 5e-3
"""Thickness (m) of the skull in pictures; it is not part of the model."""
REGIONS = {"white": "white matter"}


class CutPlane:
    """The deformed mesh cut by the plane of approach and push through the target; coordinates (across, height) in m."""

    def __init__(self, state: DeformedHead) -> None:
        self.state = state
        at = state.cleft.coordinates(state.points)
        self._flat, self._level = at[:, [0, 2]], at[:, 1]
        self.cut: Cut = cut_volume(state.tets, self._level)
        self.points = self.cut.interpolate(self._flat)

    def extent(self) -> tuple[Floats, Floats]:
        """Corners of the cut (m)."""
        return self.points.min(axis=0), self.points.max(axis=0)

    def draw(self, axes: Any, scale: StrainScale) -> None:
        """Draw strain, outlines, skull and blade.

        Parameters
        ----------
        axes : matplotlib.axes.Axes
            Axes to draw in.
        scale : StrainScale
            Colours of strain.
        """
        tri = require("matplotlib.tri", "report")
        patches = require("matplotlib.patches", "report")
        mesh = tri.Triangulation(*(1e3 * self.points).T, self.cut.simplices)
        strain = np.maximum(self.cut.interpolate(self.state.strain), 0)
        self._skull(axes)
        axes.tricontourf(mesh, strain, scale.edges, cmap=scale.cmap, norm=scale.norm, extend="max", zorder=2)
        fluid = np.char.startswith(self.state.region[self.cut.parent].astype(str), "ventricle")
        drops = (1e3 * self.points)[self.cut.simplices[fluid]]
        collections = require("matplotlib.collections", "report")
        axes.add_collection(collections.PolyCollection(drops, fc=FLUID, ec=FLUID, lw=0.4, zorder=2.5))
        self._lines(axes, self.state.borders, color="#444444", linewidths=0.8, zorder=3)
        self._lines(axes, self.state.surface(), color="#222222", linewidths=1.1, zorder=4)
        for blade in self.state.blades:
            axes.add_patch(patches.Polygon(1e3 * blade.profile(), fc="#9aa3ab", ec="#222222", lw=1.0, zorder=6))

    def name_regions(self, axes: Any) -> None:
        """Write each region's name at the lowest of the places with the most room."""
        corners = self.points[self.cut.simplices]
        inside = np.concatenate([np.eye(3) * 0.7 + 0.1, np.full((1, 3), 1 / 3), 0.5 - 0.5 * np.eye(3)])
        centres = np.einsum("ij,kjl->kil", inside, corners).reshape(-1, 2)
        region = np.repeat(self.state.region[self.cut.parent], len(inside))
        outlines = cut_surface(self.state.borders, self._level)
        ends = outlines.interpolate(self._flat)[outlines.simplices]
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
        axes.add_collection(
            lines.LineCollection(1e3 * cut.interpolate(self._flat)[cut.simplices], capstyle="round", **look)
        )

    def _skull(self, axes: Any) -> None:
        """A band outside the fixed surface."""
        tris = self.state.skull()
        cut = cut_surface(tris, self._level)
        if not len(cut.simplices):
            return
        normals = self.state.cleft.coordinates(vertex_normals(self.state.rest, tris) + self.state.cleft.target)[
            :, [0, 2]
        ]
        points, outward = cut.interpolate(self._flat), cut.interpolate(normals)
        outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
        outer = points + SKULL_THICKNESS * outward
        p, q = cut.simplices.T
        collections = require("matplotlib.collections", "report")
        bands = 1e3 * np.stack([points[p], points[q], outer[q], outer[p]], axis=1)
        axes.add_collection(collections.PolyCollection(bands, fc="#d9d2c3", ec="#d9d2c3", lw=0.5, zorder=1))
