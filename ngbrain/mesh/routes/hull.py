"""The smallest model of a head: head surface, ventricles and lesions as conforming surfaces, tissues as a field inside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ngbrain.image.read.label_map import LabelMap
from ngbrain.mesh.geometry.level_set import LevelSet
from ngbrain.mesh.geometry.sizing import SizeField, sample_sizes
from ngbrain.mesh.improve.reconnection import Reconnection
from ngbrain.mesh.improve.vertex_relocation import smooth_vertices
from ngbrain.mesh.routes.cleft_head import Hull, inner_surface, match_enclosed_volume, wall_name
from ngbrain.mesh.routes.conforming import PER_CUBE
from ngbrain.mesh.surface.head_outlines import BRAIN, changes, outlines
from ngbrain.mesh.surface.remeshing import remesh_surface
from ngbrain.mesh.tet_mesh import Elements, Surface, named_elements

GOAL, MOVES = float(np.sin(np.radians(16))), 40
"""Elements with dihedral angles below 16° or above 164° are improved, in this number of rounds."""
SWAPS = 4
"""Largest number of alternations of swaps and moves: Netgen leaves flat elements with all corners on a wall."""
MOST = 5e6
"""Largest number of tetrahedra; with more, Netgen would not terminate."""


def hull(labels: LabelMap, size: SizeField) -> Hull:
    """Tetrahedra of the whole head, region `brain`, around ventricles and lesions, if there are any.

    Lesions are regions named as in `LESION`. Boundaries are `skull` (the surface), `ventricle_wall` and `<lesion>_wall`, at least
    `WALL` apart. The head is the largest component of the labelled voxels with its holes filled. Volumes of the smoothed
    outlines are those of the voxels. The tissue at a point is read from the labels.

    Parameters
    ----------
    labels : LabelMap
        The labels.
    size : SizeField
        Element size on the surfaces and inside (m).

    Returns
    -------
    Hull
        The mesh.

    Raises
    ------
    InputError
        Labels contain no head, a lesion touches another surface, sizes are not positive or need more than `MOST` tetrahedra, or
        no mesh is found.

    Examples
    --------
    >>> ball = np.linalg.norm(np.indices((40, 40, 40)) - 19.5, axis=0) < 16
    >>> from ngbrain.image.read.volume import Volume
    >>> labels = LabelMap(Volume(ball.astype(int), np.diag([1e-3, 1e-3, 1e-3, 1])), {1: "white"})
    >>> mesh = hull(labels, lambda points: np.full(len(points), 6e-3)).elements
    >>> round(float(mesh.volumes().sum() / labels.volume.voxel_volume / ball.sum()), 2), mesh.regions, mesh.boundaries
    (1.0, ('brain',), ('skull',))
    """
    sample_sizes(labels, size, PER_CUBE, MOST)
    shape = outlines(labels)
    skull = remesh_surface(shape.brain, size, np.zeros((0, 3)))
    points, repairs = (
        match_enclosed_volume(shape.brain, skull.points, skull.triangles),
        [*shape.repairs, *changes(BRAIN, skull)],
    )
    surfaces, walls = [Surface("skull", skull.triangles, 0)], {"skull": shape.brain}
    for i, (name, outline) in enumerate(shape.inner.items(), 1):
        wall = inner_surface(outline, size)
        repairs += changes(name, wall)
        surfaces.append(Surface(wall_name(name), wall.triangles + len(points), i, 0))
        points = np.concatenate([points, wall.points])
        walls[wall_name(name)] = outline
    corners = np.array([points.min(axis=0), points.max(axis=0)])
    made = Elements.enclosed(points, surfaces, (BRAIN, *shape.inner), float(size(corners).max()), size)
    return Hull(_rounded(made, walls), tuple(repairs))


def _rounded(elements: Elements, outlines: dict[str, LevelSet]) -> Elements:
    """Remove flat elements and move the surfaces so that they enclose their volumes."""
    elements = smooth_hull(elements, outlines)
    for _ in range(SWAPS):
        swaps = Reconnection(elements.points, elements.tets, elements.region + 1)
        if not swaps.improve(GOAL):
            break
        elements = smooth_hull(_swapped(elements, *swaps.arrays()), outlines)
    points = elements.points
    for name, outline in outlines.items():
        mine = elements.triangles[elements.boundary == elements.boundaries.index(name)]
        points = match_enclosed_volume(outline, points, mine)
    return smooth_hull(replace(elements, points=points), {})


def _swapped(elements: Elements, tets: np.ndarray, region: np.ndarray) -> Elements:
    """The mesh with other tetrahedra in regions from 1 on the same vertices, and the resulting walls."""
    made = named_elements(elements.points, tets, region - 1, elements.regions)
    triangles, walls = made.triangles, made.boundary > 0
    triangles[walls] = triangles[walls][:, [0, 2, 1]]  # pointing out of the ventricles and lesions
    return replace(made, triangles=triangles, boundaries=elements.boundaries)


def smooth_hull(elements: Elements, outlines: dict[str, LevelSet]) -> Elements:
    """Smooth flat elements; boundary vertices stay on the level of their outline, or do not move.

    Parameters
    ----------
    elements : Elements
        The mesh.
    outlines : dict of str to LevelSet
        Boundary → outline.

    Returns
    -------
    Elements
        The improved mesh.
    """
    start, tets = elements.points, elements.tets
    on = np.full(len(start), -1)
    for i in range(len(elements.boundaries)):
        on[elements.triangles[elements.boundary == i]] = i
    levels = [outlines.get(name) for name in elements.boundaries]

    def place(vertices: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        placed = wanted.copy()
        for i, phi in enumerate(levels):
            mine = on[vertices] == i
            was = start[vertices[mine]]
            placed[mine] = was if phi is None else phi.project(wanted[mine], phi(was))
        return placed

    kept = np.ones(len(tets), bool)
    return replace(elements, points=smooth_vertices(start, tets, kept, place, GOAL, MOVES, np.random.default_rng(0)))
