"""Meshes of tissues curved to where the labels say that tissues meet."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.mesh.geometry.curved_elements import determinants, folds
from ngbrain.mesh.improve.volume_matching import QuadraticInterfaces
from ngbrain.mesh.labels.indicators import Indicators, Points
from ngbrain.mesh.labels.volume_zones import Zones
from ngbrain.mesh.tet_mesh import Elements

FURTHEST = 0.5e-3
"""Distance (m) that a node is moved at most."""
MATCHES, MATCHED = 2, 0.5
"""How often volumes are matched, and part of the longest move by which a node is moved for them."""
RETURNED = 0.6
"""Part of what regions then lack that they are given back: the rest would move interfaces farther than the volume is worth."""
HALVINGS = 4
"""of a node's move in an element that folds, before it stays where it is."""
LOWEST = 0.03
"""The Jacobian determinant anywhere in an element is at least this part of the element's largest."""
_BUBBLE = -0.125
"""Value in the middle of an edge of NGSolve's second-order function of that edge."""
_EDGES = list(combinations(range(4), 2))
_AT = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4], [2, 2, 2]]) / 6
"""Barycentric coordinates of the points of a triangle at which its distance is measured,"""
_BASIS = np.concatenate([_AT * (2 * _AT - 1), 4 * _AT[:, [0, 0, 1]] * _AT[:, [1, 2, 2]]], axis=1)
"""and the functions there of its corners and of the middles of its edges 01, 02, 12."""


@dataclass(frozen=True, eq=False)
class CurvingResult:
    """How a mesh was curved.

    deformation  the displacement (m) that the mesh now has, `mesh.SetDeformation`'s
    at           points (n, 3) m all over the straight interfaces
    before       distance (n,) m there from where the labels' regions meet, to first order; huge where none do for some mm
    after        the same, curved
    held         share of the interfaces' nodes that were moved less than wanted, as an element would have folded
    nodes        numbers (m, 10) of the tetrahedra's corners and middles of edges, 01, 02, 03, 12, 13, 23
    places       (n, 3) m, where these are now
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
    """Give a mesh of straight tetrahedra a deformation that brings its interfaces onto where the labels' regions meet.

    Interfaces are the boundaries `outer_<a>` and `<a>_<b>` of regions of the indicators. Their vertices and, of order 2,
    the middles of their edges move by the shortest way to equal shares of the regions around them, `furthest` m at most
    (and a quarter of the shortest edge beside them). Where an element folds, its nodes' moves are halved, until the
    Jacobian determinant is positive all over every element: by its Bernstein coefficients, not only at quadrature
    points (Johnen, Remacle & Geuzaine 2013, 10.1016/j.jcp.2012.08.051).

    towards   if given, where regions meet by these instead, such as `Indicators.filled`; distances stay those of `indicators`
    volumes   (regions,) m³; if given, interfaces then move on by the same small part all over each until regions of a mesh of
              second order have `RETURNED` of what they lack of them, as far as elements let them

    Raises `InputError` for another order, a mesh that is curved already, that has an element inside out, or that has no
    such boundary; with `volumes`, one whose triangles are not outwards of the region named first.
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
    held, shift = _backtracked(straight, nodes, ends, move, on)
    if volumes is not None:
        surface = _surface(mesh, straight, tets, six, pairs, indicators)
        found = surface.volumes(straight + shift)
        wanted = found + RETURNED * (volumes - found)
        for _ in range(MATCHES):
            shift = surface.match_volumes(straight + shift, wanted, MATCHED * np.where(held, 0, reach)) - straight
            back, shift = _backtracked(straight, nodes, ends, shift, on)
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
    """A mesh whose own geometry is curved, of second order, without a deformation; and what `curved` says of it.

    It can be saved, loaded, and deformed by whatever is computed on it. Of the volume that films of tissue lose `RETURNED` is
    given back. Raises what `curved` raises.

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
    """The interfaces; raises `InputError` unless they enclose what the tetrahedra of each region fill."""
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
    """NGSolve's number of each edge (n, 2), of which `middle` (6 m,) are those of the tetrahedra; asked for all at once.

    Of the functions of second order only that of an edge does not vanish in its middle.
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


def _backtracked(
    straight: Points, nodes: np.ndarray, ends: np.ndarray, move: np.ndarray, on: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Which nodes had to be held back, and moves (n, 3) of all such that no element (m, 10) folds; edges inside stay straight."""
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
        # Of each the node that is farthest off first: a vertex from its place, a middle from between its ends.
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
    """Distance (m) of the points on triangles, as many on each, from where their two regions (k, 2) meet."""
    both = np.repeat(pairs, len(at) // len(pairs), axis=0)
    found = np.empty(len(at))
    for i, j in np.unique(pairs, axis=0).tolist():
        mine = (both == (i, j)).all(axis=1)
        found[mine] = indicators.distance(at[mine], i, j)
    return found
