"""The page of a head mesh: slices, surfaces, histograms, tables."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ngbrain.errors import require
from ngbrain.image.labelling import LEAST_CONTRAST
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume
from ngbrain.mesh.quality import Quality
from ngbrain.mesh.tet_mesh import Elements
from ngbrain.report.pages.page import write_page
from ngbrain.report.pictures.panel import Panel, SurfaceLayer, VolumeLayer, colour_code, scan_layers
from ngbrain.report.pictures.style import WIDTH, bar_mm, figure, inches, png, style
from ngbrain.report.render.renderer import Camera, Layer, draw
from ngbrain.report.render.surface import Floats, Ints, cut_surface, cut_tets, outer_triangles, vertex_normals

COLOURS = (
    "#56B4E9", "#999999", "#F2E6C9", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00",
    "#F0E442", "#882255", "#44AA99", "#332288", "#AA4499", "#117733", "#DDCC77", "#661100",
)  # fmt: skip
"""Colours of the regions in order, repeated."""
KNOWN = {"csf": 0, "grey": 1, "white": 2, "ventricles": 3, "brain": 2}
VIEWS = (("Sagittal", 0, 1, 2), ("Coronal", 1, 0, 2), ("Axial", 2, 0, 1))
"""Name; normal axis of the plane; axis that points to the picture's left; axis that points up."""
GAP, MARGIN = 4.0, 6.0
"""Gap between slices and margin around the head (mm)."""
TINT, LINE = 0.55, "#222222"


def build(
    path: str | os.PathLike[str],
    result: Mapping[str, Any],
    elements: Elements,
    labels: LabelMap | None,
    t1: Volume | None,
    at: Floats,
) -> Path:
    """Write the page of a head mesh.

    Parameters
    ----------
    path : str or path-like
        Output file.
    result : mapping of str to Any
        Result of the command `mesh`.
    elements : Elements
        The mesh.
    labels : LabelMap or None
        Labels on any voxels; None where the mesh was not made from labels.
    t1 : Volume or None
        The scan on axis-aligned voxels of 1 mm; None without a scan.
    at : ndarray, shape (3,)
        Common point of the slices (m).

    Returns
    -------
    Path
        The file.

    Raises
    ------
    MissingExtra
        matplotlib or jinja2 is not installed.
    """
    pictures = {
        **({"slices": slices(elements, labels.resample_to_ras(), t1, at)} if labels else {}),
        "space": space(elements, at),
        "quality": histograms(Quality.of(elements)),
    }
    variables = {"result": result, "scan": t1 is not None, "least_contrast": LEAST_CONTRAST}
    variables["panel"] = panel(elements, labels.resample_to_ras() if labels else None, t1, at)
    return write_page(Path(path), "anatomy.html", pictures, **variables)


def slices(elements: Elements, labels: LabelMap, t1: Volume | None, at: Floats) -> bytes:
    """Three slices through a point: above, the scan tinted by its labels; below, the labels with the mesh.

    Parameters
    ----------
    elements : Elements
        The mesh.
    labels : LabelMap
        Labels on axis-aligned cubic voxels.
    t1 : Volume or None
        The scan on the same voxels.
    at : ndarray, shape (3,)
        The point (m).

    Returns
    -------
    bytes
        A PNG.
    """
    numbers, spacing = labels.volume.data, 1e3 * labels.volume.spacing[0]
    origin = 1e3 * labels.volume.affine[:3, 3]
    names = labels.regions
    palette = np.array([(0.0,) * 4, *(_rgba(name, i) for i, name in enumerate(names))])
    filled = np.argwhere(numbers > 0)
    low, high = (spacing * filled.min(axis=0) + origin - MARGIN, spacing * filled.max(axis=0) + origin + MARGIN)
    layers = np.clip(np.rint((1e3 * at - origin) / spacing), 0, np.array(numbers.shape) - 1).astype(int)
    widths = [high[across] - low[across] for _, _, across, _ in VIEWS]
    tall = max(high[up] - low[up] for _, _, _, up in VIEWS)
    scale = WIDTH / (sum(widths) + (len(VIEWS) + 1) * GAP)
    head, foot, between = 0.55, 0.45, 0.12
    height = head + foot + between + 2 * scale * tall
    with style():
        page = figure(height)
        for row in range(2):
            left = GAP * scale
            for (name, normal, across, up), width in zip(VIEWS, widths, strict=True):
                bottom = foot + (1 - row) * (between + scale * tall)
                axes = page.add_axes((left / WIDTH, bottom / height, scale * width / WIDTH, scale * tall / height))
                left += scale * (width + GAP)
                extent = [origin[k] + spacing * (i - 0.5) for k in (across, up) for i in (0, numbers.shape[k])]
                flat = np.take(numbers, layers[normal], normal).T
                if t1 is not None and row == 0:
                    window = np.percentile(t1.data[numbers > 0], [1, 99.7])
                    grey = np.take(t1.data, layers[normal], normal).T
                    axes.imshow(grey, origin="lower", extent=extent, cmap="gray", vmin=window[0], vmax=window[1])
                tinted = palette[flat]
                tinted[..., 3] *= 0.35 if t1 is not None and row == 0 else TINT
                axes.imshow(tinted, origin="lower", extent=extent, interpolation="nearest")
                where = origin[normal] + spacing * layers[normal]
                if row == 1:
                    _cuts(axes, elements, 1e-3 * where, normal, [across, up])
                axes.set(
                    xlim=(high[across], low[across]),
                    ylim=((low + high)[up] / 2 - tall / 2, (low + high)[up] / 2 + tall / 2),
                )
                axes.set_aspect("equal")
                axes.set_facecolor("black" if t1 is not None and row == 0 else "white")
                axes.tick_params(left=False, bottom=False, labelleft=False, labelbottom=False)
                for spine in axes.spines.values():
                    spine.set_visible(False)
                if row == 0:
                    axes.set_title(f"{name}, {'xyz'[normal]} = {where:.1f} mm".replace("-", "−"), fontsize=9)
                else:
                    bar_mm(axes, -20, 0.04)
                for v, place in ((np.eye(3)[across], (0.03, 0.5)), (-np.eye(3)[across], (0.97, 0.5))):
                    letter = "RAS"[int(np.abs(v).argmax())] if v.max() > 0 else "LPI"[int(np.abs(v).argmax())]
                    axes.text(*place, letter, transform=axes.transAxes, ha="center", va="center", fontsize=10,
                              fontweight="bold", color="white" if t1 is not None and row == 0 else LINE)  # fmt: skip
        patches = require("matplotlib.patches", "report")
        handles = [patches.Patch(color=palette[i + 1], label=name) for i, name in enumerate(names[:12])]
        page.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.005, 0.0), ncols=6, fontsize=9, frameon=False)
        return png(page)


def space(elements: Elements, at: Floats) -> bytes:
    """The mesh from outside, and its part behind the coronal plane through a point, with coloured regions.

    Parameters
    ----------
    elements : Elements
        The mesh.
    at : ndarray, shape (3,)
        The point (m).

    Returns
    -------
    bytes
        A PNG.
    """
    up = np.array([0, 0, 1.0])
    toward = np.array([0.8, 0.9, 0.45])
    middle = (elements.points.max(axis=0) + elements.points.min(axis=0)) / 2
    reach = float(np.linalg.norm(elements.points - middle, axis=1).max()) * 1.05
    outer = np.concatenate([elements.triangles[elements.boundary == i] for i in _outer(elements)])
    normals = vertex_normals(elements.points, outer)
    bone = np.array([0.90, 0.84, 0.78])
    with style():
        page = figure(4.4)
        for column, title in enumerate(("The surface", "Cut open: regions and elements")):
            axes = page.add_axes((0.005 + 0.5 * column, 0.02, 0.49, 0.90))
            wide, tall = inches(axes)
            camera = Camera.look_at(middle, toward, up, reach * wide / tall, reach)
            if column:
                # Keep what lies behind the coronal plane, seen from the viewer.
                level = at[1] + 1e-7 - elements.points[:, 1]
                cut = cut_tets(elements.tets, level, np.arange(len(elements.tets)))
                shades = np.array([_rgba(name, i)[:3] for i, name in enumerate(elements.regions)])
                corners = cut.interpolate(elements.points)[cut.simplices].reshape(-1, 3)
                colour = np.repeat(shades[elements.region[cut.parent]], 3, axis=0)
                face = Layer(corners, np.arange(len(corners)).reshape(-1, 3), colour, lit=0.15)
                lines = _edges(elements, level)
                layers = [Layer(elements.points, outer, bone, normals, clip=level), face, lines]
            else:
                layers = [Layer(elements.points, outer, bone, normals)]
            image = draw(camera, layers, round(page.dpi * wide), round(page.dpi * tall))
            x, y = 1e3 * camera.half_width, 1e3 * camera.half_height
            axes.imshow(image, extent=(-x, x, -y, y), interpolation="none")
            axes.axis("off")
            axes.set_title(title)
            bar_mm(axes, 50)
        return png(page)


def panel(
    elements: Elements, labels: LabelMap | None = None, t1: Volume | None = None, at: Floats | None = None
) -> Panel:
    """Regions, elements, scan and labels, to be turned.

    Parameters
    ----------
    elements : Elements
        The mesh.
    labels : LabelMap, optional
        Labels on axis-aligned cubic voxels.
    t1 : Volume, optional
        The scan on the same voxels.
    at : ndarray, shape (3,), optional
        Common point of the planes (m); by default the centre.

    Returns
    -------
    Panel
    """
    points, outer = elements.points, outer_triangles(elements.tets)
    layers: list[SurfaceLayer | VolumeLayer] = []
    for i, name in enumerate(elements.regions):
        mine = outer_triangles(elements.tets[elements.region == i])
        if len(mine):
            outside = float(np.isin(mine, outer).mean()) > 0.3
            layers.append(
                SurfaceLayer(name, points, mine, colour_code(_rgba(name, i)), opacity=0.35 if outside else 1.0)
            )
    layers.append(SurfaceLayer("elements at the surface", points, outer, "#5a6b7a", edges=True, shown=False))
    if labels is not None:
        spacing, origin = labels.volume.spacing, labels.volume.affine[:3, 3]
        tints = [colour_code(_rgba(name, i)) for i, name in enumerate(labels.regions)]
        layers += scan_layers(
            None if t1 is None else t1.data, labels.volume.data, labels.regions, tints, origin, spacing
        )
    return Panel(layers, "The mesh in three dimensions", focus=at)


def histograms(quality: Quality) -> bytes:
    """Histograms of dihedral angles and radius ratios, with logarithmic counts that show single bad elements, as a PNG."""
    with style():
        page = figure(2.9)
        panels = (
            ("smallest dihedral angle (°)", quality.dihedrals, np.linspace(0, 75, 51), 0.07),
            ("radius ratio 3 r_in / r_circ", quality.ratios, np.linspace(0, 1, 51), 0.57),
        )
        for label, values, bins, left in panels:
            axes = page.add_axes((left, 0.18, 0.41, 0.72))
            axes.hist(values, bins, color="#5a6b7a", log=True)
            axes.set(xlabel=label, ylabel="tetrahedra", xlim=(bins[0], bins[-1]))
            least = float(values.min())
            axes.axvline(least, color="#D55E00", lw=1.2)
            axes.text(least, axes.get_ylim()[1], f" least {least:.3g}", color="#D55E00", fontsize=9, va="top")
        return png(page)


def _rgba(name: str, i: int) -> tuple[float, ...]:
    colour = COLOURS[KNOWN.get(name, (i + 4) % len(COLOURS))]
    return (*(int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)), 1.0)


def _outer(elements: Elements) -> list[int]:
    """Boundaries on the outside: those whose triangles belong to one tetrahedron."""
    faces = np.sort(elements.tets[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    n = np.int64(len(elements.points))
    keys, count = np.unique((faces[:, 0] * n + faces[:, 1]) * n + faces[:, 2], return_counts=True)
    own = np.sort(elements.triangles, axis=1).astype(np.int64)
    once = count[np.searchsorted(keys, (own[:, 0] * n + own[:, 1]) * n + own[:, 2])] == 1
    return [i for i in range(len(elements.boundaries)) if once[elements.boundary == i].any()]


def _cuts(axes: Any, elements: Elements, where: float, normal: int, flat: list[int]) -> None:
    """Draw the edges of elements and boundaries in a plane."""
    collections = require("matplotlib.collections", "report")
    level = elements.points[:, normal] - (where + 1e-8)
    faces = elements.tets[(level[elements.tets] >= 0).any(axis=1) & (level[elements.tets] < 0).any(axis=1)]
    faces = np.unique(np.sort(faces[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1), axis=0)
    for triangles, colour, width in ((faces, "#7f8c8d", 0.3), (elements.triangles, "#B2182B", 0.9)):
        cut = cut_surface(triangles, level)
        lines = 1e3 * cut.interpolate(elements.points[:, flat])[cut.simplices]
        axes.add_collection(collections.LineCollection(lines, colors=colour, linewidths=width), autolim=False)


def _edges(elements: Elements, level: Floats) -> Layer:
    """Edges of the elements in the plane, as thin strips in front of it."""
    near = elements.tets[(level[elements.tets] >= 0).any(axis=1) & (level[elements.tets] < 0).any(axis=1)]
    faces: Ints = np.unique(
        np.sort(near[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1), axis=0
    )
    cut = cut_surface(faces, level)
    points = cut.interpolate(elements.points) + np.array([0, 0.25e-3, 0])
    p, q = points[cut.simplices[:, 0]], points[cut.simplices[:, 1]]
    beside = np.cross(q - p, np.array([0, 1.0, 0]))
    beside *= 0.12e-3 / np.maximum(np.linalg.norm(beside, axis=1, keepdims=True), 1e-12)
    corners = np.concatenate([p + beside, q + beside, q - beside, p - beside])
    i, n = np.arange(len(p)), len(p)
    quads = np.concatenate([np.column_stack([i, i + n, i + 2 * n]), np.column_stack([i, i + 2 * n, i + 3 * n])])
    return Layer(corners, quads, np.full(3, 0.25), lit=0.0)
