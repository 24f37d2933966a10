"""The head of a scan by any route: regions grey, white and ventricles, or brain and ventricles; boundary skull."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume
from ngbrain.image.segment.tissue_classes import CSF, GREY, VENTRICLE, WHITE
from ngbrain.mesh.geometry.cleft import Cleft
from ngbrain.mesh.geometry.primitives import Sizes
from ngbrain.mesh.geometry.sizing import ACROSS, RadialSizeField
from ngbrain.mesh.routes.cleft_head import wall_name
from ngbrain.mesh.routes.registry import find_route, mesh_labels, mesh_with_opening
from ngbrain.mesh.surface.head_outlines import BRAIN, VENTRICLES
from ngbrain.mesh.tet_mesh import Elements

GREY_MATTER, WHITE_MATTER = "grey", "white"
"""Regions of a brain; by a route that does not conform to tissues, both are in the region `BRAIN`."""
REGIONS = {CSF: GREY_MATTER, GREY: GREY_MATTER, WHITE: WHITE_MATTER, VENTRICLE: VENTRICLES}
"""Tissue class → region: sulcal fluid counts as grey matter."""
SKULL, OUTER = "skull", "outer_"


def mesh_head_of_tissues(labels: Volume, route: str, size: float) -> Elements:
    """Mesh a head by a route.

    Parameters
    ----------
    labels : Volume
        Tissue classes (`ngbrain.image.segment.tissue_classes`).
    route : str
        Meshing route.
    size : float
        Element size (m).

    Returns
    -------
    Elements
        Regions `grey`, `white` and `ventricles`, or `brain` and `ventricles`; boundaries `skull` and `ventricle_wall`.

    Raises
    ------
    InputError
        The route fails, or its mesh has other regions.
    """
    return _named(mesh_labels(LabelMap(labels, REGIONS), route, RadialSizeField(size, size)).elements, route)


def open_head_of_tissues(labels: Volume, cleft: Cleft, craniotomy: float, route: str, sizes: Sizes) -> Elements:
    """Mesh a head with an open cleft by a route.

    Where regions are the tissues, elements on the walls are at most half as long as the cleft is wide.

    Parameters
    ----------
    labels : Volume
        Tissue classes (`ngbrain.image.segment.tissue_classes`).
    cleft : Cleft
        The cleft.
    craniotomy : float
        Diameter of the craniotomy (m).
    route : str
        Meshing route.
    sizes : Sizes
        Element sizes on the cleft, under the craniotomy and elsewhere (m).

    Returns
    -------
    Elements
        As of `mesh_head_of_tissues`, with the boundaries of the cleft and `craniotomy`.

    Raises
    ------
    InputError
        The route opens no cleft, it fails, or its mesh has other regions.
    """
    if find_route(route).conforms:
        sizes = replace(sizes, site=min(sizes.site, cleft.opening / ACROSS))
    return _named(mesh_with_opening(LabelMap(labels, REGIONS), cleft, craniotomy, route, sizes).elements, route)


def _named(made: Elements, route: str) -> Elements:
    """The mesh with the boundaries of a head: `skull` for `outer_REGION`, and the wall of the ventricles, pointing out of them."""
    wanted = {*REGIONS.values()} if find_route(route).conforms else {BRAIN, VENTRICLES}
    if other := sorted(set(made.regions) - wanted):
        raise InputError(
            "route", f"{route!r}, whose mesh has the region {other[0]}", f"regions {', '.join(sorted(wanted))}"
        )
    names, flipped = list[str](), list[int]()
    for number, name in enumerate(made.boundaries):
        first, _, second = name.partition("_")
        between = {first, second} <= wanted and VENTRICLES in (first, second)
        names.append(SKULL if name.startswith(OUTER) else wall_name(VENTRICLES) if between else name)
        flipped += [number] if between and second == VENTRICLES else []
    triangles = made.triangles.copy()
    turned = np.isin(made.boundary, flipped)
    triangles[turned] = triangles[turned][:, [0, 2, 1]]
    used = tuple(dict.fromkeys(names))
    table = np.array([used.index(name) for name in names], np.int32)
    return replace(made, triangles=triangles, boundary=table[made.boundary], boundaries=used)
