"""Delaunay tetrahedra that conform to all interfaces of a label map, graded by a size field."""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay, QhullError

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.mesh.geometry.sizing import SizeField, sample_sizes
from ngbrain.mesh.improve.reconnection import Reconnection
from ngbrain.mesh.improve.vertex_relocation import FLATTEST, shape_quality, smooth_vertices
from ngbrain.mesh.improve.volume_matching import INSIDE, match_volumes
from ngbrain.mesh.labels.indicators import SMOOTHING, Indicators, Points
from ngbrain.mesh.labels.sampling import sample_interfaces, sample_interior
from ngbrain.mesh.labels.volume_zones import Zones
from ngbrain.mesh.tet_mesh import Elements, named_elements

PER_CUBE, MOST = 7.5, 20e6
"""Tetrahedra in a cube of their size, and the largest number of tetrahedra: more would not fit into memory."""
PASSES = 3
"""Number of triangulations; points are improved and tetrahedra labelled anew in each."""
OFF = 0.15
"""Largest offset of an interface vertex, as a part of the element size; vertices farther off are removed."""
STRAY = 0.25
"""Largest difference of the volume fractions that should be equal, for a vertex that moves along an interface."""
MOVES = 8
"""Rounds of vertex moves after each triangulation."""
LAST_MOVES = 20
"""Rounds of vertex moves after the last triangulation."""
POLISHES = 6
"""Largest number of alternations of swaps and moves at the end."""
FAVOUR = 0.2
"""Largest bias of a region's volume fraction, positive where it lacks volume and negative where it has too much."""
AIR = 0.95
"""Volume fraction of outside at a corner from which a tetrahedron is outside."""
THORNS = 3
"""Layers of a spike that are removed from the surface."""
BALANCING = 6
"""Iterations of the volume balance."""
FINE = 1.25
"""Ratio to the finest size up to which a graded mesh has volumes matched in a zone of its own (`volume_zones`)."""
FORGONE, FILM = 0.2, 0.6
"""Part of the volume lost by smoothing that is given up in the zones, to keep interfaces near those of the labels; and the
fraction of its volume left by smoothing below which a film keeps its full target.
"""
GOAL = np.sin(np.radians(15))
"""Tetrahedra with dihedral angles below 15° or above 165° are improved as long as that is possible."""
SOUND = np.sin(np.radians(8))
"""Smallest quality that volume matching may lead to; flatter tetrahedra may leave their interfaces, by `OFF`, to reach it."""


def conforming(labels: LabelMap, size: SizeField, smoothing: float = SMOOTHING, seed: int = 0) -> Elements:
    """Mesh every region of a label map with tetrahedra that share the interface triangles; the result is the same bit by bit.

    Points are sampled on the interfaces of the labels' smoothed indicators and inside the regions. Each of their Delaunay
    tetrahedra gets the region with the largest volume fraction in it (a multi-material restricted Delaunay triangulation).
    Interface vertices are projected onto the interface of the regions around them, and all points are triangulated again, until
    tetrahedra and interfaces are consistent. Then vertex moves and edge and face swaps alternate on the worst tetrahedra. At
    last, interfaces move by a small part of the element size, so that regions get the volumes of their voxels; in a graded mesh
    also in its finest part. Parts thinner than elements are lost to their neighbours.

    Boundaries are `outer_<region>` on the outside and `<a>_<b>` between regions, in the order of `labels.regions`; triangles
    point out of the first.

    Parameters
    ----------
    labels : LabelMap
        Regions on voxels.
    size : SizeField
        Wanted edge length (m); its gradient should be below about 0.3.
    smoothing : float
        Standard deviation (m) of the Gaussian that smooths the voxel steps.
    seed : int
        Seed of the random samples.

    Returns
    -------
    Elements
        The mesh.

    Raises
    ------
    InputError
        Labels without voxels, sizes that are not positive numbers or need more than `MOST` tetrahedra, or sizes so large that a
        region has no tetrahedron.

    References
    ----------
    Boltcheva, Yvinec & Boissonnat (2009), doi:10.1111/j.1467-8659.2009.01521.x; Freitag & Ollivier-Gooch (1997).

    Examples
    --------
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
    """Improve tetrahedra still flatter than `SOUND`; their vertices may leave interfaces by `far` (n,) at most."""

    def place(vertices: np.ndarray, wanted: Points) -> Points:
        step, most = wanted - points[vertices], far[vertices]
        return points[vertices] + step * np.minimum(1, most / np.maximum(np.linalg.norm(step, axis=1), 1e-12))[:, None]

    return smooth_vertices(points, tets, region > 0, place, SOUND, LAST_MOVES, rng)


def _triangulated(points: Points, indicators: Indicators, zones: Zones) -> tuple[np.ndarray, np.ndarray]:
    """Delaunay tetrahedra (m, 4) of the points in Netgen's orientation, and the region (m,) of each; 0 is outside."""
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
    # First inside or outside, then the region: fluid that lacks volume must not grow spikes into the air. A tetrahedron that
    # reaches into the air is outside, since its corner could not be moved back.
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
    """Inside mask (m,) without spikes: tetrahedra with three or more faces to the outside; `beside` (m, 4) are the neighbours."""
    for _ in range(THORNS):
        within = within & ((np.where(beside >= 0, within[beside], False)).sum(axis=1) >= 2)
    return within


def _meeting(tets: np.ndarray, region: np.ndarray, n: int, count: int) -> np.ndarray:
    """Regions (n, count) around each vertex."""
    meeting = np.zeros((n, count), bool)
    meeting[tets, region[:, None]] = True
    return meeting


def _settled(points: Points, tets: np.ndarray, region: np.ndarray, indicators: Indicators) -> tuple[Points, np.ndarray]:
    """Points with interface vertices projected onto their interface, and the offset (n,) of those that could not move.

    A vertex stays where its move would invert a tetrahedron.
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
    """Improve bad tetrahedra by vertex moves; interface vertices move along their interfaces."""
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
