"""Pictures of a head in a notebook: slices with labels and mesh, surfaces, element quality, and interactive scenes.

The pictures are those of the report of `ngbrain mesh`. They need the extras `report` and `viz`, the interactive mesh `viz`
alone. No network is needed, neither in the notebook nor in its exports.

>>> from ngbrain import viz
>>> from ngbrain.mesh.routes.registry import mesh_elements
>>> made = mesh_elements(labels, "lattice")  # doctest: +SKIP
>>> viz.slices(made, labels), viz.surfaces(made), viz.quality(made)  # doctest: +SKIP
>>> viz.interactive(made.mesh())  # doctest: +SKIP
>>> viz.panel(made, labels, scan)  # doctest: +SKIP
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError, MissingExtra, require
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.resampling import reorient_to_ras
from ngbrain.image.read.volume import Volume
from ngbrain.mesh.quality import Quality
from ngbrain.mesh.tet_mesh import Elements
from ngbrain.report.pages import anatomy
from ngbrain.report.pictures.panel import ColourScale, Panel, SurfaceLayer, VolumeLayer

__all__ = [
    "ColourScale",
    "Panel",
    "SurfaceLayer",
    "View",
    "VolumeLayer",
    "interactive",
    "panel",
    "quality",
    "slices",
    "surfaces",
]

Place = Sequence[float] | np.ndarray


@dataclass(frozen=True, repr=False)  # no text representation: the notebook would store the data twice
class View:
    """A self-contained HTML page with an interactive mesh: it needs no network, no kernel and no widgets.

    A notebook shows it in a frame, also after saving or exporting. Every page contains the viewer (0.8 MB) and the mesh.

    Parameters
    ----------
    data : mapping
        Scene of the webgui; points and values as base64 of 32-bit floats.
    viewer : Path
        Program of the webgui, a JavaScript file.
    caption : str, optional
        Caption below the mesh.
    """

    data: Mapping[str, Any]
    viewer: Path
    caption: str = ""

    def html(self) -> str:
        """The HTML page."""
        data = json.dumps(self.data).replace("<", "\\u003c")  # so that nothing in it closes the script tag
        program = self.viewer.read_text(encoding="utf-8")
        return f"{_HEAD}<div id=view></div><p>{escape(self.caption)}</p><script>{program}</script><script>\n" + (
            f"new webgui.Scene().init(document.getElementById('view'), {data});</script></body></html>\n"
        )

    def write(self, path: str | Path) -> Path:
        """Write the page to a file."""
        path = Path(path)
        atomic_write(path, lambda part: part.write_text(self.html(), encoding="utf-8"))
        return path

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{escape(self.html())}" style="width: 100%; height: 30rem; border: 0"></iframe>'


_HEAD = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>Mesh</title><style>
html, body, #view { height: 100%; margin: 0; font: 14px sans-serif; overflow: hidden }
p { position: absolute; right: 0; bottom: 0; margin: 8px; padding-left: 120px; text-align: right; pointer-events: none }
</style></head><body>"""


def slices(elements: Elements, labels: LabelMap, t1: Volume | None = None, at: Place | None = None) -> Any:
    """Show three planes through a point: the scan with its labels, and the mesh cut by the plane.

    Parameters
    ----------
    elements : Elements
        The mesh.
    labels : LabelMap
        Labels that the mesh was generated from.
    t1 : Volume, optional
        The scan, on any voxel grid.
    at : array_like, optional
        (3,) m, point that the planes go through; by default the centre of the mesh.

    Returns
    -------
    IPython.display.Image

    Raises
    ------
    MissingExtra
        IPython or matplotlib is not installed.
    InputError
        The point is not three finite numbers.
    """
    scan = None if t1 is None else reorient_to_ras(t1)
    return _image(anatomy.slices(elements, labels.resample_to_ras(), scan, _through(elements, at)))


def surfaces(elements: Elements, at: Place | None = None) -> Any:
    """Show the head from outside, and cut open behind a point, with its regions in colour.

    Parameters
    ----------
    elements : Elements
        The mesh.
    at : array_like, optional
        (3,) m, point of the cut; by default the centre of the mesh.

    Returns
    -------
    IPython.display.Image

    Raises
    ------
    MissingExtra
        IPython or matplotlib is not installed.
    InputError
        The point is not three finite numbers.
    """
    return _image(anatomy.space(elements, _through(elements, at)))


def panel(
    elements: Elements,
    labels: LabelMap | None = None,
    t1: Volume | None = None,
    at: Place | None = None,
    more: Sequence[SurfaceLayer | VolumeLayer] = (),
) -> Panel:
    """Show the mesh, the scan and its labels in one scene to be turned, with further surfaces and volumes such as tool and maps.

    It needs neither a network nor widgets; `write` makes a page that opens alone.

    Parameters
    ----------
    elements : Elements
        The mesh.
    labels : LabelMap, optional
        Labels that it was generated from.
    t1 : Volume, optional
        The scan on the voxels of the labels.
    at : array_like, optional
        (3,) m, point of the three planes of scan and labels at first; by default the centre.
    more : sequence of SurfaceLayer or VolumeLayer
        Further layers, from `ngbrain.report.pictures.panel`.

    Returns
    -------
    Panel

    Raises
    ------
    InputError
        The point is not three finite numbers.

    Examples
    --------
    >>> from ngbrain.mesh.geometry.sizing import RadialSizeField
    >>> from ngbrain.mesh.routes.lattice import lattice
    >>> points = np.stack(np.meshgrid(*[np.arange(-14, 15)] * 3, indexing="ij"), axis=-1)
    >>> ball = Volume((np.linalg.norm(points, axis=-1) < 11).astype(np.int32), np.diag([1e-3, 1e-3, 1e-3, 1]))
    >>> labels = LabelMap(ball, {1: "grey"})
    >>> made = panel(lattice(labels, RadialSizeField(5e-3, 5e-3)).elements, labels)
    >>> [layer.name for layer in made.layers]
    ['grey', 'elements at the surface', 'labels (grey)']
    """
    volume = None if labels is None else labels.resample_to_ras()
    made = anatomy.panel(elements, volume, None if t1 is None else reorient_to_ras(t1), _through(elements, at))
    return replace(made, layers=[*made.layers, *more])


def quality(elements: Elements) -> Any:
    """Show histograms of the smallest dihedral angles and of the radius ratios, as an `IPython.display.Image`.

    Raises
    ------
    MissingExtra
        IPython or matplotlib is not installed.
    """
    return _image(anatomy.histograms(Quality.of(elements)))


def interactive(
    mesh: ngs.Mesh, field: ngs.CoefficientFunction | None = None, at: Place | None = None, **options: Any
) -> View:
    """Show a mesh interactively with NGSolve's webgui; in 3-D it is cut by the coronal plane through a point.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        The mesh, in metres; curved elements are drawn curved.
    field : ngsolve.CoefficientFunction, optional
        Field shown by the colours, also a GridFunction; by default the regions, each in its own colour.
    at : array_like, optional
        (3,) m, point of the cutting plane; by default the centre of the mesh. Ignored for 2-D meshes.
    **options
        Passed on to `ngsolve.webgui.Draw`, such as `deformation`, `min`, `max`, `euler_angles`.

    Returns
    -------
    View
        A notebook shows it as the last value of a cell, or by `display`.

    Raises
    ------
    MissingExtra
        webgui_jupyter_widgets, which contains the viewer, is not installed.
    InputError
        The point is not three finite numbers.

    Examples
    --------
    >>> from ngbrain.mesh import load
    >>> view = interactive(load("idealised_head"))
    >>> view.caption
    'Colours, from blue to red: cortex, white, ventricle_left, ventricle_right'
    >>> view.write("head.html")  # doctest: +SKIP
    """
    package = find_spec("webgui_jupyter_widgets")  # only a file of it is read; importing it would need more packages
    if package is None or package.origin is None:
        raise MissingExtra("webgui_jupyter_widgets", "viz")
    with np.errstate():  # importing the webgui turns numpy's warnings off
        from ngsolve.webgui import Draw

    if mesh.dim == 3:
        points = np.array([vertex.point for vertex in mesh.vertices])
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        place = middle if at is None else _point(at)
        # The webgui measures the plane's distance from the centre of the mesh, with the opposite sign.
        cut = {"function": True, "x": 0.0, "y": 1.0, "z": 0.0, "dist": float(middle[1] - place[1])}
        options = {"clipping": cut, "euler_angles": [-70, 0, -25], **options}
    caption = ""
    if field is None:
        names = list(dict.fromkeys(mesh.GetMaterials()))
        field = ngs.GridFunction(ngs.L2(mesh, order=0))  # defined on surfaces too
        field.Set(mesh.MaterialCF({name: float(i) for i, name in enumerate(names)}))
        ends = {"autoscale": False, "min": 0.0, "max": float(max(len(names) - 1, 1))}
        options = {**ends, "settings": {"Colormap": {"ncolors": max(len(names), 2)}}, **options}
        caption = "Colours, from blue to red: " + ", ".join(names)
    drawn = Draw(field, mesh, **{**options, "show": False})
    return View(drawn.GetData(), Path(package.origin).parent / "js" / "webgui.js", caption)


def _image(picture: bytes) -> Any:
    return require("IPython.display", "viz").Image(data=picture)


def _through(elements: Elements, at: Place | None) -> np.ndarray:
    return (elements.points.min(axis=0) + elements.points.max(axis=0)) / 2 if at is None else _point(at)


def _point(at: Place) -> np.ndarray:
    point = np.asarray(at, float)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise InputError("at", repr(at), "three numbers, m")
    return point
