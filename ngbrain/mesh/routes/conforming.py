"""Tetrahedra of tissues that conform where tissues meet, straight from a map of labels, as fine as a size field asks."""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay, QhullError

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.mesh.geometry.sizing import SizeField, sample_sizes
from ngbrain.mesh.improve.reconnection import Reconnection
from ngbrain.mesh.improve.smoothing import FLATTEST, shape_quality, smooth_vertices
from ngbrain.mesh.improve.volume_matching import INSIDE, match_volumes
from ngbrain.mesh.labels.indicators import SMOOTHING, Indicators, Points
from ngbrain.mesh.labels.sampling import sample_interfaces, sample_interior
from ngbrain.mesh.labels.volume_zones import Zones
from ngbrain.mesh.tet_mesh import Elements, named_elements

PER_CUBE, MOST = 7.5, 20e6
"""Tetrahedra in a cube of their size; as many make a mesh that is refused, as it would not fit into memory."""
PASSES = 3
"""Triangulations of ever better points, each labelled anew."""
OFF = 0.15
"""Part of the element size by which points that stay off the interface that they border may miss it; others go."""
STRAY = 0.25
"""Difference of the shares that should be equal, up to which a vertex may be moved along an interface."""
MOVES = 8
"""Rounds of moves after each of them,"""
LAST_MOVES = 20
"""more after the last,"""
POLISHES = 6
"""and how often swaps and moves take turns in the last one at most."""
FAVOUR = 0.2
"""Share that a region of which there is too little is given at most, and one of which there is too much is taken off."""
AIR = 0.95
"""Share of outside at a corner from which a tetrahedron is outside."""
THORNS = 3
"""Layers of a thorn that are taken off the surface."""
BALANCING = 6
"""Rounds in which these are found."""
FINE = 1.25
"""Times the finest size: up to there volumes of a graded mesh are right for themselves (`zones`)."""
FORGONE, FILM = 0.2, 0.6
"""Part of what smoothing takes from a region there that it does without, for interfaces nearer to those of the labels; a film,
of which smoothing leaves less than that share, has none to be near to."""
GOAL = np.sin(np.radians(15))
"""Tetrahedra with angles between faces of less than 15° or more than 165° are worked on until they are gone or stuck."""
SOUND = np.sin(np.radians(8))
"""What matching volumes may make of good ones; flatter ones may leave their interfaces, by `OFF`, to get there."""


def conforming(labels: LabelMap, size: SizeField, smoothing: float = SMOOTHING, seed: int = 0) -> Elements:
    """Tetrahedra of every region of a map of labels, which meet in common triangles; the same bits every time.

    Samples on the interfaces of the labels' smoothed indicators and inside the regions; their Delaunay tetrahedra, each
    in the region of the largest share in it (a restricted Delaunay triangulation of many materials, as of Boltcheva,
    Yvinec & Boissonnat 2009, 10.1111/j.1467-8659.2009.01521.x). Vertices are put where the regions around them meet,
    and all is triangulated again, so that tetrahedra and interfaces settle. Last, moves of single vertices and swaps of
    edges and faces take turns on the worst tetrahedra (Freitag & Ollivier-Gooch 1997), and interfaces move by a small
    part of the element size so that regions have the volumes of their voxels, where a graded mesh is finest as in the
    rest. What is thinner than elements is lost to what is around it.

    labels     regions on voxels
    size       points (n, 3) m → wanted lengths of edges (n,) m; it should not change faster than about 0.3 of distance
    smoothing  standard deviation (m) of the Gaussian that rounds the voxels' steps

    Boundaries are `outer_<region>` on the outside and `<a>_<b>` between regions, in the order of `labels.regions`, with
    triangles outwards of the first.

    Raises `InputError` for labels without voxels, sizes that are not positive numbers, sizes that need more than
    `MOST` tetrahedra, and sizes so large that a region has no tetrahedron.

    >>> from ngbrain.image.read.volume import Volume
    >>> ball = np.linalg.norm(np.indices((13, 13, 13)) - 6, axis=0) < 5
    >>> labels = LabelMap(Volume(ball.astype(int), np.diag([1e-3, 1e-3, 1e-3, 1])), {1: "gel"})
    >>> mesh = conforming(labels, lambda points: np.full(len(points), 3e-3))
    >>> mesh.boundaries, bool((mesh.volumes() > 0).all()), float(round(mesh.volumes().sum() / ball.sum() / 1e-9, 2))
    (('outer_gel',), True, 1.0)
    """
    sample_sizes(labels, size, PER_CUBE, MOST)
    zones, indicators = Zones.of(labels, size, _fine), Indicators.of(labels, smoothing)
    zones, rng = zones.relax_targets(indicators.volumes(zones), FORGONE, FILM), np.random.default_rng(seed)
    indicators = indicators.correct_volumes(zones)
    points = np.concatenate([sample_interfaces(indicators, size, rng), sample_interior(indicators, size, rng)])
    for turn in range(PASSES):
        tets, region = _triangulated(points, indicators, zones)
        points, off = _settled(points, tets, region, indicators)
        points = _improved(points, tets, region, indicators, MOVES, rng)
        if turn < PASSES - 1:
            points = points[off < OFF * size(points)]
    for _ in range(POLISHES):
        swaps = Reconnection(points, tets, region)
        if not swaps.improve(GOAL):
            break
        tets, region = swaps.arrays()
        points = _improved(points, tets, region, indicators, LAST_MOVES, rng)
    points = _freed(points, tets, region, OFF * size(points), rng)
    points = match_volumes(points, tets, region, zones, size(points), SOUND)
    return named_elements(points, tets[region > 0], region[region > 0] - 1, labels.regions)


def _fine(h: np.ndarray, smallest: float, largest: float) -> np.ndarray:
    return h <= FINE * smallest


def _freed(points: Points, tets: np.ndarray, region: np.ndarray, far: np.ndarray, rng: np.random.Generator) -> Points:
    """Points of what is still flatter than `SOUND` moved by `far` (n,) at most, off their interfaces too."""

    def place(vertices: np.ndarray, wanted: Points) -> Points:
        step, most = wanted - points[vertices], far[vertices]
        return points[vertices] + step * np.minimum(1, most / np.maximum(np.linalg.norm(step, axis=1), 1e-12))[:, None]

    return smooth_vertices(points, tets, region > 0, place, SOUND, LAST_MOVES, rng)


def _triangulated(points: Points, indicators: Indicators, zones: Zones) -> tuple[np.ndarray, np.ndarray]:
    """The points' Delaunay tetrahedra (m, 4) in Netgen's orientation, and the region (m,) of each, 0 for outside."""
    try:
        delaunay = Delaunay(points)
    except (QhullError, ValueError) as error:
        raise InputError("size", "such that there are too few points", "smaller sizes") from error
    tets, beside = delaunay.simplices, delaunay.neighbors
    x = points[tets]
    swapped = np.linalg.det(x[:, 1:] - x[:, :1]) > 0
    tets[swapped] = tets[swapped][:, [1, 0, 2, 3]]
    fractions, zone = (
        np.zeros((len(tets), zones.target_volumes.shape[1] + 1)),
        np.zeros((len(tets), len(zones.target_volumes))),
    )
    for at in INSIDE:
        where = np.einsum("k,nkd->nd", at, x)
        fractions += indicators(where) / len(INSIDE)
        zone += zones.weights(where) / len(INSIDE)
    volume = np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) / 6
    # First what is inside at all, then which region: fluid that is short of volume shall not grow thorns into the air, nor is
    # anything inside that reaches into it, as its corner could not be brought back.
    air = (indicators(points)[:, 0] > AIR)[tets].any(axis=1)
    deep, favour = (
        fractions[:, 1:].max(axis=1) - fractions[:, 0],
        np.zeros((len(zones.target_volumes), fractions.shape[1])),
    )
    wanted = np.column_stack([zones.target_volumes.sum(axis=1), zones.target_volumes])
    for _ in range(BALANCING):
        mine = zone @ favour
        within = _without_thorns((deep + mine[:, 0] > 0) & ~air, beside)
        region = np.where(within, 1 + (fractions[:, 1:] + mine[:, 1:]).argmax(axis=1), 0)
        got = np.stack([np.bincount(region, volume * part, fractions.shape[1]) for part in zone.T])
        got[:, 0] = got[:, 1:].sum(axis=1)
        favour += 0.1 * np.clip((wanted - got) / np.maximum(got, 1e-12), -0.5, 0.5)
        favour = np.clip(favour, -FAVOUR, FAVOUR)
    missing = set(range(1, len(indicators.regions) + 1)) - set(np.unique(region).tolist())
    if missing:
        name = indicators.regions[min(missing) - 1]
        raise InputError("size", f"so large that {name} has no element", "smaller sizes there")
    return tets, region


def _without_thorns(within: np.ndarray, beside: np.ndarray) -> np.ndarray:
    """What is inside (m,) without tetrahedra of which three faces or more look outside; `beside` (m, 4) are those across."""
    for _ in range(THORNS):
        within = within & ((np.where(beside >= 0, within[beside], False)).sum(axis=1) >= 2)
    return within


def _meeting(tets: np.ndarray, region: np.ndarray, n: int, count: int) -> np.ndarray:
    """Which regions (n, count) there are around each vertex."""
    meeting = np.zeros((n, count), bool)
    meeting[tets, region[:, None]] = True
    return meeting


def _settled(points: Points, tets: np.ndarray, region: np.ndarray, indicators: Indicators) -> tuple[Points, np.ndarray]:
    """Points with those between regions put where these meet, and how far (n,) from there those are that had to stay.

    They have to where they would turn a tetrahedron inside out.
    """
    meeting = _meeting(tets, region, len(points), len(indicators.regions) + 1)
    border = meeting.sum(axis=1) > 1
    on = points.copy()
    on[border] = indicators.project_to_interface(points[border], meeting[border], 2)
    floor = np.minimum(FLATTEST, shape_quality(points[tets]))
    new = on.copy()
    while len(stuck := np.unique(tets[shape_quality(new[tets]) < floor])):
        stuck = stuck[(new[stuck] != points[stuck]).any(axis=1)]
        if not len(stuck):
            break
        new[stuck] = points[stuck]
    return new, np.linalg.norm(new - on, axis=1)


def _improved(
    points: Points,
    tets: np.ndarray,
    region: np.ndarray,
    indicators: Indicators,
    moves: int,
    rng: np.random.Generator,
) -> Points:
    """Points moved so that bad tetrahedra get better, those between regions along their interfaces."""
    meeting = _meeting(tets, region, len(points), len(indicators.regions) + 1)
    border = meeting.sum(axis=1) > 1

    def place(vertices: np.ndarray, wanted: Points) -> Points:
        placed, on = wanted.copy(), border[vertices]
        mine = vertices[on]
        there = indicators.project_to_interface(wanted[on], meeting[mine], 1)
        astray = indicators.spread(there, meeting[mine]) > np.maximum(
            STRAY, indicators.spread(points[mine], meeting[mine])
        )
        there[astray] = points[mine[astray]]
        placed[on] = there
        return placed

    return smooth_vertices(points, tets, region > 0, place, GOAL, moves, rng)
