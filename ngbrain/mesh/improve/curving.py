"""Second-order meshes whose interfaces are curved onto the interfaces of the labels."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.look import BriefText
from ngbrain.mesh.geometry.curved_elements import determinants, folds
from ngbrain.mesh.improve.volume_matching import QuadraticInterfaces
from ngbrain.mesh.labels.indicators import Indicators, Points
from ngbrain.mesh.labels.volume_zones import Zones
from ngbrain.mesh.tet_mesh import Elements

FURTHEST = 0.5e-3
"""Largest move of a node (m)."""
MATCHES, MATCHED = 2, 0.5
"""Number of volume corrections, and the part of a node's largest move that they may use."""
RETURNED = 0.6
"""Part of the missing volume that is restored; restoring more would move interfaces too far from those of the labels."""
HALVINGS = 4
"""Number of times a node's move is halved in a folded element, before the node keeps its place."""
LOWEST = 0.03
"""Smallest Jacobian determinant anywhere in an element, as a part of the element's largest."""
_BUBBLE = -0.125
"""Value at the middle of an edge of NGSolve's second-order edge function."""
_EDGES = list(combinations(range(4), 2))
_AT = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4], [2, 2, 2]]) / 6
"""Barycentric coordinates of the points of a triangle at which the distance is measured."""
_BASIS = np.concatenate([_AT * (2 * _AT - 1), 4 * _AT[:, [0, 0, 1]] * _AT[:, [1, 2, 2]]], axis=1)
"""Values there of the functions of the triangle's corners and of the middles of its edges 01, 02, 12."""


@dataclass(frozen=True, eq=False, repr=False)
class CurvingResult(BriefText):
    """A curved mesh and the distances of its interfaces from those of the labels.

    Parameters
    ----------
    deformation : ngsolve.GridFunction
        Displacement (m) of the mesh, as set by `mesh.SetDeformation`.
    sample_points : ndarray, shape (n, 3)
        Points (m) all over the straight interfaces.
    distance_before : ndarray, shape (n,)
        First-order distance (m) of these points from the labels' interfaces; huge where there is none within some mm.
    distance_after : ndarray, shape (n,)
        The same distance after curving (m).
    held_back : float
        Part of the interface nodes whose move was shortened, because an element would have folded.
    element_nodes : ndarray of int, shape (m, 10)
        Corners and mid-edge nodes 01, 02, 03, 12, 13, 23 of the tetrahedra.
    node_positions : ndarray, shape (nodes, 3)
        Positions of the nodes after curving (m).
    """

    deformation: ngs.GridFunction
    sample_points: Points
    distance_before: np.ndarray
    distance_after: np.ndarray
    held_back: float
    element_nodes: np.ndarray
    node_positions: Points


def curve_interfaces(
    mesh: ngs.Mesh,
    indicators: Indicators,
    order: int = 2,
    furthest: float = FURTHEST,
    towards: Indicators | None = None,
    volumes: np.ndarray | None = None,
) -> CurvingResult:
    """Deform a mesh of straight tetrahedra so that its interfaces lie on those of the labels.

    Interfaces are the boundaries `outer_<a>` and `<a>_<b>` of the indicators' regions. Their vertices and, for order 2, the
    middles of their edges move by the shortest way to equal volume fractions of the adjacent regions: by `furthest` at most,
    and by a quarter of the shortest edge beside them. Where an element folds, the moves of its nodes are halved until the
    Jacobian determinant is positive everywhere in the element. This is checked by its Bernstein coefficients, not only at
    quadrature points.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        Straight tetrahedra.
    indicators : Indicators
        Smoothed indicators of the labels; distances are measured from their interfaces.
    order : int
        1 or 2.
    furthest : float
        Largest move of a node (m).
    towards : Indicators, optional
        Other indicators to move to, such as those of `Indicators.correct_volumes`.
    volumes : ndarray, shape (regions,), optional
        Target volumes (m³). Interfaces then move further, all by the same small part, until the second-order mesh has regained
        the part `RETURNED` of the missing volumes, as far as the elements allow.

    Returns
    -------
    CurvingResult
        The deformation, which is also set on the mesh, and the distances.

    Raises
    ------
    InputError
        Another order; a mesh that is already curved, has an inverted element or has no such boundary; with `volumes`, a mesh
        whose triangles do not point out of the region named first.

    References
    ----------
    Johnen, Remacle & Geuzaine (2013), doi:10.1016/j.jcp.2012.08.051.
    """
    if order not in (1, 2):
        raise InputError("order", order, "1 or 2")
    points, tets, triangles, pairs = _read(mesh, indicators)
    if not (np.linalg.det(points[tets[:, 1:]] - points[tets[:, :1]]) < 0).all():
        raise InputError("mesh", "one with an element inside out", "positive volumes")
    pairs_of = np.sort(tets[:, _EDGES].reshape(-1, 2), axis=1)
    keys, middle = np.unique(pairs_of[:, 0] * len(points) + pairs_of[:, 1], return_inverse=True)
    ends = np.stack([keys // len(points), keys % len(points)], axis=1)
    nodes = np.concatenate([tets, len(points) + middle.reshape(-1, 6)], axis=1)
    # A triangle's nodes: its corners and the middles of its edges 01, 02, 12.
    sides = np.sort(triangles[:, [[0, 1], [0, 2], [1, 2]]], axis=2)
    between = np.searchsorted(keys, sides[..., 0] * len(points) + sides[..., 1])
    six = np.concatenate([triangles, len(points) + between], axis=1)
    straight = np.concatenate([points, points[ends].mean(axis=1)])
    meeting = np.zeros((len(straight), len(indicators.regions) + 1), bool)
    for k in range(2):
        meeting[six, pairs[:, k, None]] = True
    moved = np.flatnonzero(meeting.any(axis=1))
    if order == 1:
        moved = moved[moved < len(points)]
    shortest = np.full(len(straight), np.inf)
    length = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
    for side in (ends[:, 0], ends[:, 1], np.arange(len(points), len(straight))):
        np.minimum.at(shortest, side, length)
    move = np.zeros_like(straight)
    move[moved] = (towards or indicators).project_to_interface(straight[moved], meeting[moved]) - straight[moved]
    on = np.zeros(len(straight), bool)
    on[moved] = True
    far, reach = np.linalg.norm(move, axis=1), np.where(on, np.minimum(furthest, shortest / 4), 0)
    move *= np.minimum(1, reach / np.maximum(far, 1e-12))[:, None]
    held, shift = _limit_moves(straight, nodes, ends, move, on)
    if volumes is not None:
        surface = _surface(mesh, straight, tets, six, pairs, indicators)
        found = surface.volumes(straight + shift)
        wanted = found + RETURNED * (volumes - found)
        for _ in range(MATCHES):
            shift = surface.match_volumes(straight + shift, wanted, MATCHED * np.where(held, 0, reach)) - straight
            back, shift = _limit_moves(straight, nodes, ends, shift, on)
            held |= back

    space = ngs.VectorH1(mesh, order=order)
    deformation = ngs.GridFunction(space)
    bow = shift[len(points) :] - shift[ends].mean(axis=1)
    numbers = _numbers(mesh, ends, middle) if order == 2 else np.zeros(0, int)
    for k, component in enumerate(deformation.components):
        values = component.vec.FV().NumPy()
        values[: len(points)] = shift[: len(points), k]
        if order == 2:
            values[len(points) + numbers] = bow[:, k] / _BUBBLE
    mesh.SetDeformation(deformation)
    at, there = (np.einsum("pn,tnd->tpd", _BASIS, x[six]).reshape(-1, 3) for x in (straight, straight + shift))
    before, after = _distances(at, pairs, indicators), _distances(there, pairs, indicators)
    return CurvingResult(deformation, at, before, after, float(held[moved].mean()), nodes, straight + shift)


def second_order_mesh(elements: Elements, labels: LabelMap) -> tuple[ngs.Mesh, CurvingResult]:
    """Curve a mesh to the labels and store the curvature in its own second-order geometry, without a deformation.

    Such a mesh can be saved, loaded, and deformed by a computed displacement. Of the volume that thin films of tissue lose,
    the part `RETURNED` is restored.

    Parameters
    ----------
    elements : Elements
        The mesh with straight edges.
    labels : LabelMap
        The labels it was made from.

    Returns
    -------
    mesh : ngsolve.Mesh
        The second-order mesh.
    result : CurvingResult
        Report of `curve_interfaces`.

    Raises
    ------
    InputError
        As `curve_interfaces` does.

    Examples
    --------
    >>> from ngbrain.image.read.volume import Volume
    >>> from ngbrain.mesh.routes.lattice import lattice
    >>> ball = np.linalg.norm(np.indices((24, 24, 24)) - 11.5, axis=0) < 10
    >>> labels = LabelMap(Volume(ball.astype(int), np.diag([1e-3, 1e-3, 1e-3, 1])), {1: "grey"})
    >>> mesh, done = second_order_mesh(lattice(labels, lambda points: np.full(len(points), 4e-3)).elements, labels)
    >>> mesh.deformation, float(round(1e6 * ngs.Integrate(ngs.CF(1), mesh) / labels.volumes_ml()["grey"], 2))
    (None, 1.0)
    """
    indicators = Indicators.of(labels)
    wanted = 1e-6 * np.array(list(labels.volumes_ml().values()))
    done = curve_interfaces(
        elements.mesh(), indicators, towards=indicators.correct_volumes(Zones.whole(labels)), volumes=wanted
    )
    solid = elements.mesh().ngmesh
    solid.SecondOrder()
    solid.Coordinates()[solid.Elements3D().NumPy()["nodes"] - 1] = done.node_positions[done.element_nodes]
    return ngs.Mesh(solid), done


def _read(mesh: ngs.Mesh, indicators: Indicators) -> tuple[Points, np.ndarray, np.ndarray, np.ndarray]:
    """Points, tetrahedra (m, 4), interface triangles (k, 3) and their pairs of regions (k, 2)."""
    names = {f"outer_{a}": (0, i) for i, a in enumerate(indicators.regions, 1)}
    names |= {
        f"{a}_{b}": (i, j)
        for i, a in enumerate(indicators.regions, 1)
        for j, b in enumerate(indicators.regions, 1)
        if i != j
    }
    solid, flat = mesh.ngmesh.Elements3D().NumPy(), mesh.ngmesh.Elements2D().NumPy()
    if mesh.GetCurveOrder() > 1 or (solid["nodes"].shape[1] > 4 and solid["nodes"][:, 4:].any()):
        raise InputError("mesh", "curved already", "straight tetrahedra")
    known = np.array([names.get(name, (0, 0)) for name in mesh.GetBoundaries()])
    pairs = known[flat["index"] - 1]
    if not pairs.any():
        raise InputError("mesh", f"one with boundaries {', '.join(mesh.GetBoundaries())}", "outer_<a> or <a>_<b>")
    mine = pairs.any(axis=1)
    points = mesh.ngmesh.Coordinates().copy()
    return points, solid["nodes"][:, :4].astype(int) - 1, flat["nodes"][mine, :3].astype(int) - 1, pairs[mine]


def _surface(
    mesh: ngs.Mesh, straight: Points, tets: np.ndarray, six: np.ndarray, pairs: np.ndarray, indicators: Indicators
) -> QuadraticInterfaces:
    """The interfaces; raises `InputError` unless they enclose the volume of each region's tetrahedra."""
    surface = QuadraticInterfaces(six, np.where(pairs[:, :1] == 0, pairs[:, ::-1], pairs), len(indicators.regions))
    numbers = np.array([0, *(1 + indicators.regions.index(name) for name in mesh.GetMaterials())])
    x = straight[tets]
    filled = np.bincount(
        numbers[mesh.ngmesh.Elements3D().NumPy()["index"]],
        -np.linalg.det(x[:, 1:] - x[:, :1]) / 6,
        len(indicators.regions) + 1,
    )
    if not np.allclose(surface.volumes(straight), filled[1:], rtol=0, atol=1e-6 * filled.sum()):
        raise InputError("mesh", "one whose triangles enclose other volumes than regions have", "triangles outwards")
    return surface


def _numbers(mesh: ngs.Mesh, ends: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """NGSolve's number of each edge (n, 2), evaluated for all elements at once; `middle` (6 m,) are the tetrahedra's edges.

    Of the second-order functions, only that of an edge is not zero at the edge's middle.
    """
    at = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 0]], float)  # of the corners in NGSolve's element
    rule = ngs.IntegrationRule([tuple(at[[i, j]].mean(axis=0)) for i, j in _EDGES], [0.0] * 6)
    field = ngs.GridFunction(ngs.H1(mesh, order=2))
    values = field.vec.FV().NumPy()
    values[:] = 0
    values[mesh.nv :] = 1 + np.arange(mesh.nedge)
    found = field(mesh.MapToAllElements({ngs.TET: rule}, ngs.VOL)).reshape(-1, 6) / _BUBBLE - 1
    numbers = np.full(len(ends), -1)
    numbers[middle.reshape(-1, 6)] = np.rint(found)
    return numbers


def _limit_moves(
    straight: Points, nodes: np.ndarray, ends: np.ndarray, move: np.ndarray, on: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mask of shortened nodes, and moves (n, 3) for which no element (m, 10) folds; interior edges stay straight."""
    n = len(straight) - len(ends)
    halvings = np.zeros(len(straight), int)

    def shifted() -> np.ndarray:
        shift = move * np.where(halvings > HALVINGS, 0, 0.5**halvings)[:, None]
        middles = shift[ends].mean(axis=1)
        shift[n:] = np.where((on & (halvings <= HALVINGS))[n:, None], shift[n:], middles)
        return np.asarray(shift)

    suspects = nodes[on[nodes].any(axis=1)]
    while True:
        shift = shifted()
        folded = suspects[folds(determinants((straight + shift)[suspects]), LOWEST)]
        if not len(folded):
            return halvings > 0, shift
        # First the node with the longest move: of a vertex from its place, of an edge's middle from the straight edge.
        off = np.linalg.norm(shift, axis=1)
        off[n:] = np.linalg.norm(shift[n:] - shift[ends].mean(axis=1), axis=1)
        off[halvings > HALVINGS] = 0
        back = np.unique(folded[np.arange(len(folded)), off[folded].argmax(axis=1)])
        halvings[back] += 1
        changed = np.zeros(len(straight), bool)
        changed[back] = True
        changed[n:] |= changed[ends].any(axis=1)
        suspects = nodes[changed[nodes].any(axis=1)]


def _distances(at: Points, pairs: np.ndarray, indicators: Indicators) -> np.ndarray:
    """Distance (m) of points on triangles, the same number on each, from the interface of the triangle's two regions (k, 2)."""
    both = np.repeat(pairs, len(at) // len(pairs), axis=0)
    found = np.empty(len(at))
    for i, j in np.unique(pairs, axis=0).tolist():
        mine = (both == (i, j)).all(axis=1)
        found[mine] = indicators.distance(at[mine], i, j)
    return found
