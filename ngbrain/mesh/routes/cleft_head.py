"""A head of any shape, opened by a cleft: from the smooth outlines of brain and ventricles to tetrahedra."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ngbrain.errors import InputError
from ngbrain.mesh.geometry.cleft import Cleft
from ngbrain.mesh.geometry.cleft_walls import CleftWalls, rim
from ngbrain.mesh.geometry.level_set import LevelSet, Points
from ngbrain.mesh.geometry.primitives import Sizes
from ngbrain.mesh.geometry.sizing import SizeField
from ngbrain.mesh.surface.head_outlines import BRAIN, VENTRICLES, Outlines, Repair, changes
from ngbrain.mesh.surface.remeshing import RemeshedSurface, remesh_surface
from ngbrain.mesh.tet_mesh import Elements, Surface

GROWTH = 0.4
"""Growth of the element size (m) with distance (m) from the cleft."""
HORNS = 9e-3
"""Largest elements (m) on the ventricles: larger ones do not close around thin horns."""
ROUNDS = 4
"""of moving triangles until they enclose the volume of the outline."""
CLEARANCE = 1.5e-3
"""Tissue (m) that has to stay between the cleft and a ventricle, or a lesion with a surface of its own."""


@dataclass(frozen=True, eq=False)
class Hull:
    """A mesh within surfaces, and where these are not the labels'."""

    elements: Elements
    repairs: tuple[Repair, ...]


def head(shape: Outlines, cleft: Cleft, craniotomy: float, sizes: Sizes) -> Hull:
    """Tetrahedra between the outlines, with the cleft cut out by exact planes.

    Regions `brain`, `ventricles` and lesions by their names, but for those that the cleft comes closer to than `CLEARANCE`,
    which are of `brain`; boundaries `skull` (the surface), `craniotomy` (a disc of that diameter, m, around the cleft),
    `ventricle_wall`, `<lesion>_wall` and the cleft's own (see `Cleft`). Volumes are those of the outlines.

    sizes   elements (m) on the cleft, under the craniotomy, and elsewhere

    Raises `InputError` for a cleft that opens a ventricle or does not reach the surface, and where no mesh is found.
    """
    brain = shape.brain
    slot = CleftWalls.of(cleft, brain, sizes.site)
    if shape.ventricles is not None:
        _clear(slot, shape.ventricles)

    def size(points: Points) -> np.ndarray:
        a, b, height = cleft.coordinates(points).T
        near = (np.hypot(a, b) <= craniotomy / 2) & (height > 0)
        largest = np.where(near, sizes.near, sizes.far)
        return np.clip(sizes.site + GROWTH * cleft.distance_to_walls(points), sizes.site, largest)

    fixed = np.concatenate([slot.points[: slot.mouth], rim(cleft, brain, craniotomy, sizes.near)])
    skull = remesh_surface(brain, size, fixed)
    outer, triangles = match_enclosed_volume(brain, skull.points, skull.triangles, slot.mouth), skull.triangles
    repairs = [*shape.repairs, *changes(BRAIN, skull)]
    # Points: the slot's, of which the first are the hull's first too; then the rest of the hull's; then those of what is inside.
    n, m = slot.mouth, len(slot.points)
    triangles = np.where(triangles < n, triangles, triangles + m - n)
    points = np.concatenate([slot.points, outer[n:]])
    a, b, height = cleft.coordinates(points[triangles].mean(axis=1)).T
    outside = height > cleft.depth / 2
    lid = outside & (np.abs(a) < cleft.opening / 2) & (np.abs(b) < cleft.width / 2)
    window = outside & ~lid & (np.hypot(a, b) < craniotomy / 2)
    surfaces = [Surface("skull", triangles[~lid & ~window], 0), Surface("craniotomy", triangles[window], 0)]
    surfaces += [Surface(name, side, 0) for name, side in slot.sides.items()]
    if not _closed(np.concatenate([surface.triangles for surface in surfaces])):
        raise InputError("mesh sizes", "such that the surface does not close around the cleft", "smaller elements")
    inner = {name: outline for name, outline in shape.inner.items() if outline(slot.points).min() >= CLEARANCE}
    for i, (name, outline) in enumerate(inner.items(), 1):
        wall = inner_surface(outline, size)
        repairs += changes(name, wall)
        surfaces.append(Surface(wall_name(name), wall.triangles + len(points), i, 0))
        points = np.concatenate([points, wall.points])
    return Hull(Elements.enclosed(points, surfaces, (BRAIN, *inner), sizes.far), tuple(repairs))


def inner_surface(outline: LevelSet, size: SizeField) -> RemeshedSurface:
    """The surface of ventricles or a lesion, with their volume."""
    wall = remesh_surface(outline, lambda points: np.minimum(size(points), HORNS), np.zeros((0, 3)))
    return replace(wall, points=match_enclosed_volume(outline, wall.points, wall.triangles))


def wall_name(region: str) -> str:
    """The name of its boundary."""
    return f"{region.removesuffix('s') if region == VENTRICLES else region}_wall"


def _clear(slot: CleftWalls, ventricles: LevelSet) -> None:
    nearest = ventricles(slot.points).min()
    if nearest < CLEARANCE:
        wanted = f"a target, approach and size of the cleft that leave {1e3 * CLEARANCE:g} mm to the ventricles"
        where = ", ".join(f"{1e3 * c:.1f}" for c in slot.cleft.target)
        raise InputError("cleft.target_mm", f"({where}) mm with a cleft that opens a ventricle", wanted)


def match_enclosed_volume(surface: LevelSet, points: Points, triangles: np.ndarray, fixed: int = 0) -> Points:
    """Points moved along their normals, but for the first `fixed`, so that flat triangles enclose what the outline does."""
    wanted = float((surface.values < 0).sum()) * surface.spacing**3
    points = points.copy()
    for _ in range(ROUNDS):
        a, b, c = (points[triangles[:, k]] for k in range(3))
        areas = np.cross(b - a, c - a) / 2
        missing = wanted - float(np.einsum("ij,ij->", a, areas)) / 3
        normals = np.zeros_like(points)
        for k in range(3):
            np.add.at(normals, triangles[:, k], areas / 3)
        normals[:fixed] = 0
        points += missing / float((normals**2).sum()) * normals  # further where triangles are large, as they miss more
    return points


def _closed(triangles: np.ndarray) -> bool:
    """Whether every edge has one triangle on each side."""
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).tolist()
    every = set(map(tuple, edges))
    return len(every) == len(edges) and all((b, a) in every for a, b in every)
