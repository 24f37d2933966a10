"""The head in three dimensions: whole, and cut open at the site."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ngbrain.report.pictures.frame import DeformedHead
from ngbrain.report.pictures.panel import ColourScale, Panel, SurfaceLayer, VolumeLayer, colour_code, scan_layers
from ngbrain.report.pictures.slices import ScanImage
from ngbrain.report.pictures.style import (
    BONE,
    FLUID,
    STEEL,
    StrainScale,
    bar_mm,
    figure,
    inches,
    png,
    style,
    viewed_from,
)
from ngbrain.report.render.renderer import Camera, Layer, draw
from ngbrain.report.render.surface import Floats, Ints, cut_surface, cut_volume, faces, triangles, vertex_normals

RIM = "#333333"


def head(peak: DeformedHead, scale: StrainScale) -> bytes:
    """The head with blade and opening from outside, and a close-up cut open along the blade's push.

    Parameters
    ----------
    peak : DeformedHead
        The head at its largest strain.
    scale : StrainScale
        Colours of strain.

    Returns
    -------
    bytes
        A PNG.
    """
    with style():
        page = figure(4.9)
        cleft = peak.cleft
        up = np.array([0, 0, 1.0])
        # From the patient's front (from the back for a cleft there) and the side of the cleft.
        beside = np.array([np.sign(cleft.target[0]) or 1.0, 1.0 if cleft.out[1] > -0.3 else -1.0, 0])
        toward = 0.55 * cleft.out + np.array([0.45, 0.85, 0]) * beside
        middle = (peak.rest.max(axis=0) + peak.rest.min(axis=0)) / 2
        reach = float(np.linalg.norm(peak.rest - middle, axis=1).max()) * 1.12
        axes = page.add_axes((0.0, 0.03, 0.475, 0.87))
        shape = inches(axes)
        camera = Camera.look_at(middle + 0.10 * reach * up, toward, up, reach * shape[0] / shape[1], reach)
        opened = _opened_layers(peak, scale)
        skull = peak.skull()
        hull = Layer(peak.points, skull, BONE, vertex_normals(peak.points, skull), opacity=0.42)
        inner = peak.ventricles()
        ventricles = Layer(peak.points, inner, FLUID, vertex_normals(peak.points, inner))
        _show(axes, camera, [*opened, *_blade_layers(peak), ventricles, hull])
        _rim(axes, camera, peak)
        axes.set_title("The head, with transparent surface", pad=8)
        _triad(axes, camera, (0.12, 0.10))
        bar_mm(axes, 50, 0.40)
        ring, far = _rim_points(peak), peak.points[np.unique(inner)]
        handle = peak.blades[0].handle
        _annotate(axes, camera, handle, peak.tool, (0.62, 0.93))
        if len(ring):
            _annotate(axes, camera, ring[np.argmin(ring @ camera.right)], "craniotomy", (0.13, 0.90))
        if len(far):
            _annotate(axes, camera, far[np.argmax(far @ (camera.right - 0.5 * camera.up))], "ventricles", (0.87, 0.10))

        near = page.add_axes((0.485, 0.03, 0.445, 0.87))
        _cutaway(near, peak, scale)
        near.set_title("The site, cut open" + viewed_from(peak) + " and above", pad=8)
        scale.bar(page, (0.942, 0.16, 0.013, 0.60))
        return png(page)


def panel(peak: DeformedHead, scale: StrainScale, image: ScanImage | None) -> Panel:
    """The head at its largest strain, with blade, strain, elements and scan, to be turned.

    Parameters
    ----------
    peak : DeformedHead
        The head.
    scale : StrainScale
        Colours of strain.
    image : ScanImage or None
        The scan, if there is one.

    Returns
    -------
    Panel
    """
    top = float(scale.edges[-1])
    steps = scale.cmap(scale.norm(np.linspace(0, top * (1 - 1e-9), 255)))[:, :3]
    colours = ColourScale("largest principal strain (%)", 0.0, 100 * top, 255 * steps)
    cleft = peak.cleft
    cut = cut_volume(peak.tets, cleft.coordinates(peak.points)[:, 1])
    fluid = np.char.startswith(peak.region[cut.parent].astype(str), "ventricle")
    section, strain = cut.interpolate(peak.points), 100 * cut.interpolate(peak.strain)
    tools = [each.solid() for each in peak.blades]
    layers: list[SurfaceLayer | VolumeLayer] = [
        *(
            SurfaceLayer(
                f"{peak.tool} {i}" if len(tools) > 1 else peak.tool, points, tris, colour_code(STEEL), whole=True
            )
            for i, (points, tris) in enumerate(tools, 1)
        ),
        SurfaceLayer(
            "strain on the slice through the site",
            section,
            cut.simplices[~fluid],
            values=strain,
            scale=colours,
            whole=True,
        ),
        SurfaceLayer(
            "craniotomy and cleft",
            peak.points,
            np.concatenate([peak.window(), *peak.cleft_faces().values()]),
            values=100 * peak.strain,
            scale=colours,
        ),
        SurfaceLayer("ventricles", peak.points, peak.ventricles(), colour_code(FLUID)),
        SurfaceLayer("brain surface", peak.points, peak.skull(), colour_code(BONE), opacity=0.35),
        SurfaceLayer(
            "strain on the surface", peak.points, peak.surface(), values=100 * peak.strain, scale=colours, shown=False
        ),
        SurfaceLayer(
            "elements",
            peak.points,
            np.concatenate([six[:, :3] for six in peak.outer.values()]),
            "#5a6b7a",
            edges=True,
            shown=False,
        ),
    ]
    if image is not None:
        names, tints = (
            ("CSF", "grey matter", "white matter", "ventricles"),
            ("#56B4E9", "#999999", "#F2E6C9", "#0072B2"),
        )
        layers += scan_layers(image.t1, image.labels, names, tints, image.origin, np.full(3, image.spacing))
    beside = np.array([np.sign(cleft.target[0]) or 1.0, 1.0 if cleft.out[1] > -0.3 else -1.0, 0])
    toward = 0.55 * cleft.out + np.array([0.45, 0.85, 0]) * beside
    return Panel(
        layers, "The head with the tool in the opening", toward=toward / np.linalg.norm(toward), focus=cleft.target
    )


def _palette(scale: StrainScale) -> Callable[[Floats], Floats]:
    return lambda strain: np.asarray(scale.cmap(scale.norm(np.maximum(strain, 0))))[:, :3]


def _opened_layers(peak: DeformedHead, scale: StrainScale, clip: Floats | None = None) -> list[Layer]:
    """Craniotomy and cleft, coloured by strain."""
    parts, palette = [peak.window(), *peak.cleft_faces().values()], _palette(scale)
    return [
        Layer(peak.points, tris, peak.strain, vertex_normals(peak.points, tris), clip=clip, palette=palette)
        for tris in parts
        if len(tris)
    ]


def _blade_layers(peak: DeformedHead) -> list[Layer]:
    return [Layer(*blade.solid(), STEEL, shine=0.35) for blade in peak.blades]


def _cutaway(axes: Any, peak: DeformedHead, scale: StrainScale) -> None:
    """The half of the site behind the slice, seen obliquely from above."""
    cleft = peak.cleft
    level = cleft.coordinates(peak.points)[:, 1]
    toward = -cleft.along + 0.62 * cleft.out - 0.25 * cleft.across
    wide, tall = inches(axes)
    reach = 31e-3 / min(wide, tall)
    centre = cleft.target + (0.5 * cleft.depth + 5e-3) * cleft.out
    camera = Camera.look_at(centre, toward, cleft.out, reach * wide, reach * tall)
    skull = peak.skull()
    hull = Layer(peak.points, skull, BONE, vertex_normals(peak.points, skull), clip=level)
    cut = cut_volume(peak.tets, level)
    fluid = np.char.startswith(peak.region[cut.parent].astype(str), "ventricle")
    tissue = Layer(
        cut.interpolate(peak.points),
        cut.simplices[~fluid],
        cut.interpolate(peak.strain),
        lit=0.15,
        palette=_palette(scale),
    )
    drops = Layer(cut.interpolate(peak.points), cut.simplices[fluid], FLUID, lit=0.15)
    lines = [_ribbons(peak, triangles(faces(peak.tets, group)), level) for group in (None, peak.region)]
    _show(axes, camera, [*_opened_layers(peak, scale, level), hull, tissue, drops, *lines, *_blade_layers(peak)])
    _triad(axes, camera, (0.85, 0.10))
    bar_mm(axes, 10)


def _ribbons(peak: DeformedHead, tris: Ints, level: Floats, half_width: float = 0.11e-3) -> Layer:
    """Intersection lines of triangles and the slice, as thin strips in front of it."""
    cut = cut_surface(tris, level)
    points = cut.interpolate(peak.points) - 0.15e-3 * peak.cleft.along
    p, q = points[cut.simplices[:, 0]], points[cut.simplices[:, 1]]
    beside = np.cross(q - p, peak.cleft.along)
    beside *= half_width / np.maximum(np.linalg.norm(beside, axis=1, keepdims=True), 1e-12)
    corners = np.concatenate([p + beside, q + beside, q - beside, p - beside])
    i, n = np.arange(len(p)), len(p)
    quads = np.concatenate([np.column_stack([i, i + n, i + 2 * n]), np.column_stack([i, i + 2 * n, i + 3 * n])])
    return Layer(corners, quads, np.full(3, 0.2), lit=0.0)


def _show(axes: Any, camera: Camera, layers: list[Layer]) -> None:
    wide, tall = (round(axes.figure.dpi * size) for size in inches(axes))
    image = draw(camera, layers, wide, tall)
    x, y = 1e3 * camera.half_width, 1e3 * camera.half_height
    axes.imshow(image, extent=(-x, x, -y, y), interpolation="none")
    axes.set_xlim(-x, x)
    axes.set_ylim(-y, y)
    axes.axis("off")


def _rim_points(peak: DeformedHead) -> Floats:
    """Edge of the craniotomy (k, 3), in order around the axis."""
    window = peak.window()
    sides = np.sort(np.concatenate([window[:, [0, 1]], window[:, [1, 2]], window[:, [2, 0]]]), axis=1)
    edges, count = np.unique(sides, axis=0, return_counts=True)
    nodes = np.unique(edges[count == 1])
    at = peak.cleft.coordinates(peak.rest[nodes])
    edge = np.hypot(at[:, 0], at[:, 1]) > 0.8 * peak.craniotomy / 2
    nodes, at = nodes[edge], at[edge]
    return peak.points[nodes[np.argsort(np.arctan2(at[:, 1], at[:, 0]))]]


def _rim(axes: Any, camera: Camera, peak: DeformedHead) -> None:
    ring = 1e3 * camera.project(_rim_points(peak))
    if len(ring):
        axes.plot(*np.vstack([ring, ring[:1]])[:, :2].T, color=RIM, lw=1.3)


def _triad(axes: Any, camera: Camera, at: tuple[float, float]) -> None:
    """Arrows to the patient's right, front and top; arrows towards the viewer or in front of another are left out."""
    shape, size, gap = np.array(inches(axes)), 0.36, 0.13
    shown: list[Floats] = []
    flat = {letter: np.array([camera.right[k], camera.up[k]]) for k, letter in enumerate("RAS")}
    for letter, v in sorted(flat.items(), key=lambda item: -float(np.linalg.norm(item[1]))):
        unit = v / max(float(np.linalg.norm(v)), 1e-9)
        if np.linalg.norm(v) < 0.25 or any(unit @ other > 0.85 for other in shown):
            continue
        shown.append(unit)
        arrow = {"arrowstyle": "-|>", "color": "#222222", "lw": 1.2, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 9}
        axes.annotate(
            "", at + size * v / shape, at, xycoords="axes fraction", textcoords="axes fraction", arrowprops=arrow
        )
        label = at + (size * v + gap * unit) / shape
        axes.text(*label, letter, transform=axes.transAxes, ha="center", va="center", fontsize=10, fontweight="bold")


def _annotate(axes: Any, camera: Camera, point: Floats, text: str, at: tuple[float, float]) -> None:
    where = 1e3 * camera.project(point[None])[0, :2]
    line = {"arrowstyle": "-", "color": "#333333", "lw": 0.8, "shrinkA": 1, "shrinkB": 0}
    axes.annotate(text, where, at, textcoords="axes fraction", ha="center", va="center", fontsize=9.5, arrowprops=line)
