"""The meshing routes by name, with a cache, and summaries of their meshes."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from types import ModuleType
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError, nearest
from ngbrain.image.read import label_map, volume
from ngbrain.image.read.label_map import LabelMap
from ngbrain.io.cache import load_or_compute
from ngbrain.mesh import tet_mesh
from ngbrain.mesh.geometry import level_set, sizing
from ngbrain.mesh.geometry.cleft import Cleft
from ngbrain.mesh.geometry.primitives import Sizes
from ngbrain.mesh.geometry.sizing import CleftSizeField, RadialSizeField, SizeField
from ngbrain.mesh.head_mesh import middle_slice
from ngbrain.mesh.improve import (
    guarded_moves,
    octree,
    reconnection,
    snapped_lattice,
    snapping,
    vertex_relocation,
    volume_matching,
)
from ngbrain.mesh.labels import indicators, sampling, volume_fractions, volume_zones
from ngbrain.mesh.quality import Quality, volumes_ml
from ngbrain.mesh.routes import cleft_head, cleft_subtraction, conforming, hull, lattice
from ngbrain.mesh.surface import head_outlines, manifold, remeshing
from ngbrain.mesh.surface.head_outlines import BRAIN, Repair, outlines
from ngbrain.mesh.tet_mesh import Elements
from ngbrain.result import Result, Status

LOG = logging.getLogger(__name__)
_REST = "rest"


@dataclass(repr=False, eq=False)
class LabelMesh(Result):
    """A mesh of labels with the report of its route.

    Parameters
    ----------
    elements : Elements
        The mesh.
    snaps : mapping of str to int
        Of a lattice: number of vertices `snapped` onto interfaces and of `rejected` snaps.
    repairs : tuple of Repair
        Of a hull: places where its surfaces differ from the labels.
    status : Status
        Always converged.
    """

    elements: Elements
    snaps: Mapping[str, int] = field(default_factory=dict)
    repairs: tuple[Repair, ...] = ()
    status: Status = field(default=Status.CONVERGED, kw_only=True)

    @property
    def value(self) -> dict[str, float]:
        """Region → volume (ml)."""
        return volumes_ml(self.elements)

    @property
    def headline(self) -> str:
        """Volumes of the regions (ml) as text."""
        return ", ".join(f"{name} {ml:.4g} ml" for name, ml in self.value.items())

    @property
    def statistics(self) -> dict[str, float]:
        """Number of elements, and of repairs or snapped vertices."""
        return {"tetrahedra": len(self.elements.tets), "repairs": len(self.repairs), **self.snaps}

    def plot(self) -> Any:
        """Plot the regions of the tetrahedra in an axial layer through the centre."""
        return middle_slice(self.elements)

    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays for a file; `from_arrays` is the inverse."""
        rest = {"snaps": dict(self.snaps), "repairs": [asdict(repair) for repair in self.repairs]}
        return {**self.elements.arrays(), _REST: np.array(json.dumps(rest))}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> LabelMesh:
        """Rebuild a mesh from the arrays that `arrays` returned."""
        rest = json.loads(str(arrays[_REST]))
        repairs = tuple(Repair(**{**repair, "at": tuple(repair["at"])}) for repair in rest["repairs"])
        elements = Elements.from_arrays({name: array for name, array in arrays.items() if name != _REST})
        return cls(elements, rest["snaps"], repairs)


Make = Callable[[LabelMap, SizeField], LabelMesh]
"""(labels, size field) → mesh."""
OpenCleft = Callable[[LabelMap, Cleft, float, Sizes], LabelMesh]
"""(labels, cleft, diameter of the craniotomy in m, element sizes) → mesh with the boundaries of the cleft (`mesh.Cleft`)."""


@dataclass(frozen=True)
class Route:
    """A meshing route, for `ngbrain mesh`, for heads of scenes and for operations.

    Parameters
    ----------
    make : callable
        (labels, size field) → mesh.
    size : float
        Default element size (m).
    radius : float
        Default radius (m) of refinement around a site, so that 2 mm there and 8 mm elsewhere make 80 000 tetrahedra at most.
    left_out : str
        What its mesh does not resolve, in words.
    modules : tuple of module
        Source files that determine its result, for the cache.
    open_cleft : callable, optional
        How it opens a cleft: (labels, cleft, diameter of the craniotomy, element sizes) → mesh. `subtract_cleft` makes it of
        `make` where `make` leaves out what `LabelMap.cut` cuts away. None: it cannot, and is refused for operations.
    conforms : bool
        Whether every region of the labels is a region of the mesh; False for one region `brain`, in which a point takes the
        tissue of the label there, around ventricles and lesions.
    """

    make: Make
    size: float
    radius: float
    left_out: str
    modules: tuple[ModuleType, ...]
    open_cleft: OpenCleft | None = None
    conforms: bool = True


def subtract_cleft(make: Make) -> OpenCleft:
    """Open a cleft by a route that meshes any labels: the cleft is subtracted, and the walls are moved onto its planes.

    Walls move where elements stay good: corners of tissues and edges of the cleft may be off by part of an element, and the
    craniotomy ends with whole triangles.

    Parameters
    ----------
    make : callable
        (labels, size field) → mesh with boundaries `outer_REGION`; it leaves out what `LabelMap.cut` cuts away.

    Returns
    -------
    callable
        (labels, cleft, diameter of the craniotomy, element sizes) → mesh.
    """

    def opened(labels: LabelMap, cleft: Cleft, craniotomy: float, sizes: Sizes) -> LabelMesh:
        size = CleftSizeField(cleft, sizes.site, sizes.far, under=sizes.near, craniotomy=craniotomy)
        made, spacing = make(cleft_subtraction.remove_cleft(labels, cleft), size), float(labels.volume.spacing.max())
        return replace(made, elements=cleft_subtraction.fit_cleft_walls(made.elements, cleft, craniotomy, spacing))

    return opened


def _hulled(done: cleft_head.Hull) -> LabelMesh:
    return LabelMesh(done.elements, repairs=done.repairs)


def _cut_hull(labels: LabelMap, cleft: Cleft, craniotomy: float, sizes: Sizes) -> LabelMesh:
    return _hulled(cleft_head.head(outlines(labels), cleft, craniotomy, sizes))


def _latticed(labels: LabelMap, size: SizeField) -> LabelMesh:
    done = lattice.lattice(labels, size)
    return LabelMesh(done.elements, {"snapped": done.snapped, "rejected": done.rejected})


def _conforming(labels: LabelMap, size: SizeField) -> LabelMesh:
    return LabelMesh(conforming.conforming(labels, size))


ROUTES: Mapping[str, Route] = {
    "hull": Route(
        lambda labels, size: _hulled(hull.hull(labels, size)),
        5e-3,
        17e-3,
        "sulci, hollows (filled), and surfaces between tissues: inside the hull a point takes the tissue of the label there",
        (hull, cleft_head, head_outlines, level_set, manifold, vertex_relocation, remeshing, conforming, reconnection),
        _cut_hull,
        conforms=False,
    ),
    "lattice": Route(
        _latticed,
        4e-3,
        10.5e-3,
        "folds and films thinner than elements",
        (lattice, guarded_moves, indicators, snapped_lattice, octree, volume_fractions, snapping, volume_zones),
        subtract_cleft(_latticed),
    ),
    "conforming": Route(
        _conforming,
        4e-3,
        20e-3,
        "folds and films thinner than elements",
        (
            conforming,
            indicators,
            reconnection,
            vertex_relocation,
            sampling,
            volume_fractions,
            volume_matching,
            volume_zones,
        ),
        subtract_cleft(_conforming),
    ),
}


def find_route(name: str) -> Route:
    """The route of a name; raises `InputError` for a name that no route has.

    >>> find_route("hul")
    Traceback (most recent call last):
    ngbrain.errors.InputError: route is 'hul'; wanted: did you mean 'hull'?
    """
    if name not in ROUTES:
        raise InputError("route", repr(name), nearest(name, ROUTES))
    return ROUTES[name]


def mesh_elements(
    labels: LabelMap, route: str = "hull", size: RadialSizeField | CleftSizeField | None = None
) -> Elements:
    """Mesh labels by a route, as `mesh_labels`, and return the plain mesh.

    Parameters
    ----------
    labels : LabelMap
        The labels.
    route : str
        "hull", "lattice" or "conforming".
    size : RadialSizeField or CleftSizeField, optional
        Element size; None: uniform, the route's default.

    Returns
    -------
    Elements
        The mesh.
    """
    return mesh_labels(labels, route, size).elements


def mesh_labels(
    labels: LabelMap, route: str = "hull", size: RadialSizeField | CleftSizeField | None = None
) -> LabelMesh:
    """Mesh labels by a route; the same labels and sizes come from the cache.

    Parameters
    ----------
    labels : LabelMap
        The labels.
    route : str
        "hull", "lattice" or "conforming".
    size : RadialSizeField or CleftSizeField, optional
        Element size; None: uniform, the route's default.

    Returns
    -------
    LabelMesh
        The mesh with the report of its route.

    Raises
    ------
    InputError
        No route has this name, or the route fails.
    """
    way = find_route(route)
    size = size or RadialSizeField(way.size, way.size)
    return _cached(route, labels, [size_as_dict(size)], lambda: way.make(labels, size))


def mesh_with_opening(labels: LabelMap, cleft: Cleft, craniotomy: float, route: str, sizes: Sizes) -> LabelMesh:
    """Mesh labels with an open cleft by a route; the same labels, cleft and sizes come from the cache.

    Parameters
    ----------
    labels : LabelMap
        The labels.
    cleft : Cleft
        The cleft.
    craniotomy : float
        Diameter of the craniotomy (m).
    route : str
        "hull", "lattice" or "conforming".
    sizes : Sizes
        Element sizes on the cleft, under the craniotomy and elsewhere (m).

    Returns
    -------
    LabelMesh
        The mesh, with the boundaries of the cleft and `craniotomy`.

    Raises
    ------
    InputError
        No route has this name, the route opens no cleft, or it fails.
    """
    way = find_route(route)
    if way.open_cleft is None:
        raise InputError("route", f"{route!r}, which opens no cleft", f"one of {', '.join(openable_routes())}")
    open_cleft = way.open_cleft
    shape = {name: np.asarray(value).tolist() for name, value in vars(cleft).items()}
    made_from = ["opened", shape, craniotomy, asdict(sizes)]
    return _cached(route, labels, made_from, lambda: open_cleft(labels, cleft, craniotomy, sizes))


def openable_routes() -> list[str]:
    """Names of the routes that open a cleft."""
    return [name for name, route in ROUTES.items() if route.open_cleft]


def conforming_routes() -> list[str]:
    """Names of the routes whose meshes have all regions of the labels."""
    return [name for name, route in ROUTES.items() if route.conforms]


def _cached(route: str, labels: LabelMap, made_from: list[Any], make: Callable[[], LabelMesh]) -> LabelMesh:
    """The mesh of a route from the cache, whose key holds the route, the labels and what else it is made from."""
    names = {str(number): name for number, name in labels.names.items()}
    cut = None if labels.cut is None else volume.Volume(labels.cut, labels.volume.affine).digest()
    key = [route, labels.volume.digest(), cut, names, *made_from, version("netgen-mesher")]
    modules = (label_map, volume, tet_mesh, sizing, *ROUTES[route].modules)
    made = LabelMesh.from_arrays(load_or_compute("meshed", key, modules, lambda: make().arrays()))
    LOG.info("route %s: %d tetrahedra, %d regions", route, len(made.elements.tets), len(labels.names))
    return made


def size_as_dict(size: RadialSizeField | CleftSizeField) -> dict[str, Any]:
    """Convert a size field to a dict for JSON."""
    found: dict[str, Any] = json.loads(json.dumps(asdict(size), default=np.ndarray.tolist))
    return found


def summarise_mesh(made: Elements, labels: LabelMap) -> dict[str, Any]:
    """Summarise a mesh for a result: `regions` (name → volume_ml, label_volume_ml) and `quality`.

    The region `brain` of a hull stands for all labels without a region of their own.

    Parameters
    ----------
    made : Elements
        The mesh.
    labels : LabelMap
        The labels it was made from.

    Returns
    -------
    dict of str to Any
        The summary.
    """
    volumes, wanted = volumes_ml(made), labels.volumes_ml()
    wanted[BRAIN] = sum(ml for name, ml in wanted.items() if name not in set(volumes) - {BRAIN})
    regions = {name: {"volume_ml": ml, "label_volume_ml": wanted[name]} for name, ml in volumes.items()}
    return {"regions": regions, "quality": {**Quality.of(made).summary(), "min_jacobian": min_jacobian(made.mesh())}}


def min_jacobian(mesh: ngs.Mesh, order: int = 4) -> float:
    """Smallest ratio of the Jacobian determinant at a quadrature point to its mean over the element.

    It is 1 for straight edges, and ≤ 0 where an element is folded.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        The mesh.
    order : int
        Order of the quadrature.

    Returns
    -------
    float
        The smallest ratio.
    """
    rule = ngs.IntegrationRule(ngs.TET, order)
    jacobian = ngs.Det(ngs.specialcf.JacobianMatrix(3))
    values = np.asarray(jacobian(mesh.MapToAllElements({ngs.TET: rule}, ngs.VOL))).reshape(mesh.ne, -1)
    return float((values / values.mean(axis=1, keepdims=True)).min())
