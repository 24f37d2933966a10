"""Pictures of a head in a notebook: slices with labels and mesh, the surface, its elements, and a mesh to turn by hand.

The pictures are those of the report of `ngbrain mesh`; they need the extras `report` and `viz`.

>>> from ngbrain import viz
>>> from ngbrain.mesh.routes import meshed
>>> made = meshed(labels, "lattice")  # doctest: +SKIP
>>> viz.slices(made, labels), viz.surfaces(made), viz.quality(made)  # doctest: +SKIP
>>> viz.interactive(made.mesh())  # doctest: +SKIP
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError, require
from ngbrain.image.labelmap import LabelMap
from ngbrain.image.volume import Volume, upright
from ngbrain.mesh.elements import Elements
from ngbrain.mesh.quality import Quality
from ngbrain.report import anatomy

Place = Sequence[float] | np.ndarray


def slices(elements: Elements, labels: LabelMap, t1: Volume | None = None, at: Place | None = None) -> Any:
    """Three planes through a point, as an `IPython.display.Image`: the scan with its labels, and the mesh cut there.

    labels   that the mesh was made of; t1 the scan on any voxels, or None
    at       point (3,) m that the planes go through; None: the middle of the mesh

    Raises `MissingExtra` without IPython or matplotlib; `InputError` for a point that is none.
    """
    scan = None if t1 is None else upright(t1)
    return _image(anatomy.slices(elements, labels.upright(), scan, _through(elements, at)))


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
) -> Any:
    """A mesh to turn, zoom and cut, by NGSolve's webgui: cut by the coronal plane through a point.

    field    what its colours show, a CoefficientFunction or GridFunction; None: the number of the region, in the order of
             `mesh.GetMaterials()`
    at       point (3,) m; None: the middle of the mesh
    options  of `ngsolve.webgui.Draw`, such as `deformation`, `min`, `max`

    Returns the scene that `Draw` returns. Raises `MissingExtra` without webgui_jupyter_widgets; `InputError` for a point that is
    none.
    """
    require("webgui_jupyter_widgets", "viz")
    from ngsolve.webgui import Draw

    points = np.array([vertex.point for vertex in mesh.vertices])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    place = middle if at is None else _point(at)
    if field is None:
        names = mesh.GetMaterials()
        field = ngs.GridFunction(ngs.L2(mesh, order=0))  # has values on surfaces too
        field.Set(mesh.MaterialCF({name: float(i) for i, name in enumerate(names)}))
        options = {"autoscale": False, "min": 0.0, "max": float(max(len(names) - 1, 1)), **options}
    # The webgui counts the plane's distance from the middle of the mesh, the other way round.
    cut = {"function": True, "x": 0.0, "y": 1.0, "z": 0.0, "dist": float(middle[1] - place[1])}
    return Draw(field, mesh, **{"clipping": cut, **options})


def _image(picture: bytes) -> Any:
    return require("IPython.display", "viz").Image(data=picture)


def _through(elements: Elements, at: Place | None) -> np.ndarray:
    return (elements.points.min(axis=0) + elements.points.max(axis=0)) / 2 if at is None else _point(at)


def _point(at: Place) -> np.ndarray:
    point = np.asarray(at, float)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise InputError("at", repr(at), "three numbers, m")
    return point
