"""A cleft subtracted from labels: what is left is meshed, and the walls of the mesh are moved onto the planes of the cleft."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.mesh.geometry.cleft import Cleft
from ngbrain.mesh.improve.guarded_moves import apply_guarded_moves
from ngbrain.mesh.tet_mesh import Elements

ALIGNED = 0.5
"""Smallest cosine between the normal of a triangle and that of the wall that it belongs to."""
RINGS, TURNS = 3, 6
"""Layers of interior points that make room for points moved onto the planes, and the number of alternations."""
NEAR_WALL = 1.5
"""Largest distance (voxels) of triangles that face the cleft from its planes."""
SIDES = {"wall_plus": (0, 1), "wall_minus": (0, -1), "end_plus": (1, 1), "end_minus": (1, -1), "floor": (2, -1)}
"""Boundaries of a cleft: the coordinate that is constant there (across, along, height), and the sign of its side."""

Points = np.ndarray


def remove_cleft(labels: LabelMap, cleft: Cleft) -> LabelMap:
    """Remove a cleft from labels; voxels on its walls are removed in part, so that planes stay planes.

    Parameters
    ----------
    labels : LabelMap
        The labels.
    cleft : Cleft
        The cleft.

    Returns
    -------
    LabelMap
        The remaining labels.

    Raises
    ------
    InputError
        A ventricle is opened, or nothing is left of a region.

    Examples
    --------
    >>> from ngbrain.image.read.volume import Volume
    >>> ball = np.linalg.norm(np.indices((24, 24, 24)) - 11.5, axis=0) < 10
    >>> labels = LabelMap(Volume(ball.astype(int), np.diag([1e-3, 1e-3, 1e-3, 1])), {1: "grey"})
    >>> z, x = np.eye(3)[[2, 0]]
    >>> slot = Cleft(1e-3 * np.array([11.5, 11.5, 14.0]), z, x, 7.5e-3, opening=4e-3, width=6e-3)
    >>> round(labels.volumes_ml()["grey"] - remove_cleft(labels, slot).volumes_ml()["grey"], 3)  # 4 by 6 by 7.5
    0.180
    """
    data = labels.volume.data
    at = np.argwhere(data != 0)
    a, b, height = cleft.coordinates(labels.volume.to_world(at)).T
    wide = float(labels.volume.spacing.mean())
    within = np.stack([cleft.opening / 2 - np.abs(a), cleft.width / 2 - np.abs(b), height])
    within[2] = np.minimum(height, cleft.depth + cleft.opening + cleft.width - height)
    share = (within / wide + 0.5).clip(0, 1).prod(axis=0)
    shares = np.zeros(data.shape, np.float32)
    shares[tuple(at.T)] = share
    gone = tuple(at[share > 0.5].T)
    lost = {labels.names[number] for number in np.unique(data[gone]).tolist()}
    where = ", ".join(f"{1e3 * c:.1f}" for c in cleft.target)
    if any(name.startswith("ventricle") for name in lost):
        found = f"({where}) mm with a cleft that opens a ventricle"
        raise InputError("cleft.target_mm", found, "a target, approach and size of the cleft that do not")
    left = replace(labels, cut=shares)
    if missing := [name for name, ml in left.volumes_ml().items() if not ml]:
        raise InputError(
            "cleft.target_mm", f"({where}) mm with a cleft that takes all of {missing[0]}", "another cleft"
        )
    return left


def fit_cleft_walls(elements: Elements, cleft: Cleft, craniotomy: float, voxel: float) -> Elements:
    """Name the boundaries of the cleft in a mesh and move them onto its planes where elements stay good.

    Outer triangles that face the cleft become `wall_plus`, `wall_minus`, `end_plus`, `end_minus` and `floor` (see `Cleft`). Those
    of the surface within the craniotomy become `craniotomy`; the others keep their names.

    Parameters
    ----------
    elements : Elements
        A mesh of labels without the cleft.
    cleft : Cleft
        The cleft.
    craniotomy : float
        Diameter of the craniotomy (m).
    voxel : float
        Voxel size of the labels (m).

    Returns
    -------
    Elements
        The mesh with the cleft's boundaries.

    Raises
    ------
    InputError
        The mesh lacks one of the walls.
    """
    outer = np.array([name.startswith("outer_") for name in elements.boundaries])[elements.boundary]
    corners = elements.points[elements.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    axes = np.stack([cleft.across, cleft.along, cleft.out])
    half, off = np.array([cleft.opening / 2, cleft.width / 2, 0.0]), NEAR_WALL * voxel
    local = cleft.coordinates(corners.mean(axis=1))
    away = np.abs(local[:, :2])
    deep = outer & (away < half[:2] + off).all(axis=1) & (local[:, 2] > -off)
    facing = np.stack([-side * normals @ axes[axis] for axis, side in SIDES.values()], axis=1)
    wall = np.where(deep & (facing.max(axis=1) > ALIGNED), facing.argmax(axis=1), -1)
    for k, (axis, side) in enumerate(SIDES.values()):
        wall[(wall == k) & (np.abs(side * local[:, axis] - half[axis]) > off)] = -1
    names = [*elements.boundaries, *SIDES, "craniotomy"]
    if missing := [name for k, name in enumerate(SIDES) if not (wall == k).any()]:
        raise InputError("mesh size", f"such that the cleft has no {missing[0]}", "smaller elements near it")
    lid = outer & (wall < 0) & (local[:, 2] > cleft.depth / 2) & (np.linalg.norm(local[:, :2], axis=1) < craniotomy / 2)
    boundary = np.where(wall < 0, elements.boundary, len(elements.boundaries) + wall)
    used, boundary = np.unique(np.where(lid, len(names) - 1, boundary), return_inverse=True)

    def onto_planes(points: Points) -> Points:
        placed = points.copy()
        for k, (axis, side) in enumerate(SIDES.values()):
            on = np.unique(elements.triangles[wall == k])
            placed[on] -= (cleft.coordinates(placed[on])[:, axis] - side * half[axis])[:, None] * axes[axis]
        return placed

    return replace(
        elements,
        points=_eased(elements, np.unique(elements.triangles[wall >= 0]), onto_planes),
        boundary=boundary.astype(np.int32),
        boundaries=tuple(names[k] for k in used.tolist()),
    )


def _eased(elements: Elements, walls: np.ndarray, onto: Callable[[Points], Points]) -> Points:
    """Move wall points onto their planes and let the interior points beside them make room, in alternation."""
    points, tets = elements.points, elements.tets
    near = np.zeros(len(points), bool)
    near[walls] = True
    for _ in range(RINGS):
        near[tets[near[tets].any(axis=1)]] = True
    near[elements.triangles] = False
    pairs = np.concatenate([tets[:, [i, j]] for i in range(4) for j in range(4) if i != j])
    pairs = pairs[near[pairs[:, 0]]]
    count = np.maximum(np.bincount(pairs[:, 0], minlength=len(points)), 1)[:, None]
    for turn in range(TURNS):
        if turn:
            middle = np.stack([np.bincount(pairs[:, 0], x, len(points)) for x in points[pairs[:, 1]].T], axis=1) / count
            points, _ = apply_guarded_moves(points, tets, np.where(near[:, None], middle, points))
        points, _ = apply_guarded_moves(points, tets, onto(points))
    return points
