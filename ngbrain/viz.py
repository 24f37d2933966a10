"""Pictures of a head in a notebook: slices with labels and mesh, the surface, its elements, and a mesh to turn by hand.

The pictures are those of the report of `ngbrain mesh`; they need the extras `report` and `viz`, the mesh to turn `viz` alone.
Nothing here needs a network, neither in a notebook nor in what is exported of it.

>>> from ngbrain import viz
>>> from ngbrain.mesh.routes.registry import mesh_elements
>>> made = mesh_elements(labels, "lattice")  # doctest: +SKIP
>>> viz.slices(made, labels), viz.surfaces(made), viz.quality(made)  # doctest: +SKIP
>>> viz.interactive(made.mesh())  # doctest: +SKIP
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.atomic import atomic_write
from ngbrain.errors import InputError, MissingExtra, require
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume, reorient_to_ras
from ngbrain.mesh.quality import Quality
from ngbrain.mesh.tet_mesh import Elements
from ngbrain.report.pages import anatomy

Place = Sequence[float] | np.ndarray


@dataclass(frozen=True, repr=False)  # the notebook keeps the page, not the data as text too
class View:
    """A page with a mesh to turn, whole in itself: it needs no network, no kernel and no widgets.

    A notebook shows it in a frame, and it stays in what is saved or exported of the notebook. Every page holds the viewer
    (0.8 MB) and the mesh.

    Attributes
    ----------
    data
        What the webgui draws; points and values as base64 of 32-bit floats.
    viewer
        The webgui's program, a file.
    caption
        A line below.
    """

    data: Mapping[str, Any]
    viewer: Path
    caption: str = ""

    def html(self) -> str:
        """The page."""
        data = json.dumps(self.data).replace("<", "\\u003c")  # nothing in it ends the script
        program = self.viewer.read_text(encoding="utf-8")
        return f"{_HEAD}<div id=view></div><p>{escape(self.caption)}</p><script>{program}</script><script>\n" + (
            f"new webgui.Scene().init(document.getElementById('view'), {data});</script></body></html>\n"
        )

    def write(self, path: str | Path) -> Path:
        """The page as a file."""
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
    """Three planes through a point, as an `IPython.display.Image`: the scan with its labels, and the mesh cut there.

    labels   that the mesh was made of; t1 the scan on any voxels, or None
    at       point (3,) m that the planes go through; None: the middle of the mesh

    Raises `MissingExtra` without IPython or matplotlib; `InputError` for a point that is none.
    """
    scan = None if t1 is None else reorient_to_ras(t1)
    return _image(anatomy.slices(elements, labels.resample_to_ras(), scan, _through(elements, at)))


def surfaces(elements: Elements, at: Place | None = None) -> Any:
    """The head from outside, and cut open behind a point `at` (m), its regions in colour, as an `IPython.display.Image`.

    Raises `MissingExtra` without IPython or matplotlib; `InputError` for a point that is none.
    """
    return _image(anatomy.space(elements, _through(elements, at)))


def quality(elements: Elements) -> Any:
    """Histograms of the smallest dihedral angles and of the radius ratios, as an `IPython.display.Image`.

    Raises `MissingExtra` without IPython or matplotlib.
    """
    return _image(anatomy.histograms(Quality.of(elements)))


def interactive(
    mesh: ngs.Mesh, field: ngs.CoefficientFunction | None = None, at: Place | None = None, **options: Any
) -> View:
    """A mesh to turn, zoom and cut, drawn by NGSolve's webgui; in space it is cut by the coronal plane through a point.

    Parameters
    ----------
    mesh
        The mesh, in metres; curved elements are drawn curved.
    field
        What the colours show, a CoefficientFunction or GridFunction. None: the regions, each in a colour of its own.
    at
        Point (3,) in metres that the plane goes through. None: the middle of the mesh. It has no meaning for a plane mesh.
    **options
        Passed on to `ngsolve.webgui.Draw`, such as `deformation`, `min`, `max`, `euler_angles`.

    Returns
    -------
    View
        A notebook shows it where it is the last value of a cell, or by `display`.

    Raises
    ------
    MissingExtra
        Without webgui_jupyter_widgets, which brings the viewer.
    InputError
        For a point that is none.

    Examples
    --------
    >>> from ngbrain.mesh import load
    >>> view = interactive(load("idealised_head"))
    >>> view.caption
    'Colours, from blue to red: cortex, white, ventricle_left, ventricle_right'
    >>> view.write("head.html")  # doctest: +SKIP
    """
    package = find_spec("webgui_jupyter_widgets")  # of which a file is read; importing it would need more packages
    if package is None or package.origin is None:
        raise MissingExtra("webgui_jupyter_widgets", "viz")
    with np.errstate():  # importing the webgui turns numpy's warnings off
        from ngsolve.webgui import Draw

    if mesh.dim == 3:
        points = np.array([vertex.point for vertex in mesh.vertices])
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        place = middle if at is None else _point(at)
        # The webgui counts the plane's distance from the middle of the mesh, the other way round.
        cut = {"function": True, "x": 0.0, "y": 1.0, "z": 0.0, "dist": float(middle[1] - place[1])}
        options = {"clipping": cut, "euler_angles": [-70, 0, -25], **options}
    caption = ""
    if field is None:
        names = list(dict.fromkeys(mesh.GetMaterials()))
        field = ngs.GridFunction(ngs.L2(mesh, order=0))  # has values on surfaces too
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
