"""A head of any shape with a cleft: from smooth outlines of brain and ventricles to tetrahedra."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ngbrain.errors import InputError
from ngbrain.look import BriefText
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
"""Largest elements (m) on the ventricles; larger ones do not close around thin horns."""
ROUNDS = 4
"""Iterations of the vertex moves that restore the volume of the outline."""
CLEARANCE = 1.5e-3
"""Smallest tissue thickness (m) between the cleft and a ventricle, or a lesion with its own surface."""


@dataclass(frozen=True, eq=False, repr=False)
class Hull(BriefText):
    """A mesh inside smooth surfaces.

    Parameters
    ----------
    elements : Elements
        The mesh.
    repairs : tuple of Repair
        Places where the surfaces differ from the labels.
    """

    elements: Elements
    repairs: tuple[Repair, ...]


def head(shape: Outlines, cleft: Cleft, craniotomy: float, sizes: Sizes) -> Hull:
    """Tetrahedra between the outlines of a head, with a cleft cut out by exact planes.

    Regions are `brain`, `ventricles` and the lesions by name; lesions closer to the cleft than `CLEARANCE` belong to `brain`.
    Boundaries are `skull` (the surface), `craniotomy` (a disc around the cleft), `ventricle_wall`, `<lesion>_wall` and the
    cleft's own (see `Cleft`). Volumes are those of the outlines.

    Parameters
    ----------
    shape : Outlines
        Smooth outlines of the head.
    cleft : Cleft
        The cleft.
    craniotomy : float
        Diameter of the craniotomy (m).
    sizes : Sizes
        Element sizes on the cleft, under the craniotomy and elsewhere (m).

    Returns
    -------
    Hull
        The mesh.

    Raises
    ------
    InputError
        The cleft opens a ventricle or does not reach the surface, or no mesh is found.
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
    # Order of the points: the cleft's, of which the first are also the hull's first; the rest of the hull's; the inner surfaces'.
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
    """Triangulate the surface of ventricles or of a lesion and keep its volume.

    Parameters
    ----------
    outline : LevelSet
        Smooth outline.
    size : SizeField
        Element size (m).

    Returns
    -------
    RemeshedSurface
        The triangles.
    """
    wall = remesh_surface(outline, lambda points: np.minimum(size(points), HORNS), np.zeros((0, 3)))
    return replace(wall, points=match_enclosed_volume(outline, wall.points, wall.triangles))


def wall_name(region: str) -> str:
    """Name of the boundary of a region inside the head."""
    return f"{region.removesuffix('s') if region == VENTRICLES else region}_wall"


def _clear(slot: CleftWalls, ventricles: LevelSet) -> None:
    nearest = ventricles(slot.points).min()
    if nearest < CLEARANCE:
        wanted = f"a target, approach and size of the cleft that leave {1e3 * CLEARANCE:g} mm to the ventricles"
        where = ", ".join(f"{1e3 * c:.1f}" for c in slot.cleft.target)
        raise InputError("cleft.target_mm", f"({where}) mm with a cleft that opens a ventricle", wanted)


def match_enclosed_volume(surface: LevelSet, points: Points, triangles: np.ndarray, fixed: int = 0) -> Points:
    """Move vertices along their normals so that the plane triangles enclose the volume of the outline.

    Parameters
    ----------
    surface : LevelSet
        The outline.
    points : ndarray, shape (n, 3)
        Vertices (m).
    triangles : ndarray of int, shape (m, 3)
        Triangles, with outward normals.
    fixed : int
        Number of vertices, from the first on, that do not move.

    Returns
    -------
    ndarray, shape (n, 3)
        New positions (m).
    """
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
        points += (
            missing / float((normals**2).sum()) * normals
        )  # large triangles miss more volume, so that their vertices move further
    return points


def _closed(triangles: np.ndarray) -> bool:
    """Whether every edge has one triangle on each side."""
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).tolist()
    every = set(map(tuple, edges))
    return len(every) == len(edges) and all((b, a) in every for a, b in every)
