"""A head of any shape, opened by a cleft: from the smooth outlines of brain and ventricles to tetrahedra."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ngbrain.errors import InputError
from ngbrain.mesh.cleft import Cleft
from ngbrain.mesh.cut import Slot, rim
from ngbrain.mesh.elements import Elements, Surface
from ngbrain.mesh.levelset import LevelSet, Points
from ngbrain.mesh.shapes import Sizes
from ngbrain.mesh.surfaces import triangulated

REGIONS = ("brain", "ventricles")
GROWTH = 0.4
"""Growth of the element size (m) with distance (m) from the cleft."""
ROUNDS = 3
"""How often an outline is moved so that flat triangles enclose what the smooth one does;"""
ENOUGH = 1e-3
"""to this part of the volume."""
CLEARANCE = 1.5e-3
"""Tissue (m) that has to stay between the cleft and a ventricle."""


def head(brain: LevelSet, ventricles: LevelSet, cleft: Cleft, craniotomy: float, sizes: Sizes) -> Elements:
    """Tetrahedra between the outlines, with the cleft cut out by exact planes.

    Regions `brain` and `ventricles`; boundaries `skull` (the surface), `craniotomy` (a disc of that diameter, m, around
    the cleft), `ventricle_wall` and the cleft's own (see `Cleft`). Volumes are those of the outlines to `ENOUGH`.

    sizes   elements (m) on the cleft, under the craniotomy, and elsewhere

    Raises `InputError` for a cleft that opens a ventricle or does not reach the surface, and where no mesh is found.
    """
    _clear(Slot.of(cleft, brain, sizes.site), ventricles)

    def size(points: Points) -> np.ndarray:
        a, b, height = cleft.coordinates(points).T
        near = (np.hypot(a, b) <= craniotomy / 2) & (height > 0)
        largest = np.where(near, sizes.near, sizes.far)
        return np.clip(sizes.site + GROWTH * cleft.distance_to_walls(points), sizes.site, largest)

    def hull(surface: LevelSet) -> tuple[Points, np.ndarray]:
        mouth = Slot.of(cleft, surface, sizes.site)
        fixed = np.concatenate([mouth.points[: mouth.mouth], rim(cleft, surface, craniotomy, sizes.near)])
        return triangulated(surface, size, fixed)

    def walls(surface: LevelSet) -> tuple[Points, np.ndarray]:
        return triangulated(surface, size, np.zeros((0, 3)))

    brain, outer, triangles = _enclosing(brain, hull)
    _, inner, ventricle = _enclosing(ventricles, walls)
    slot = Slot.of(cleft, brain, sizes.site)
    # Points: the slot's, of which the first are the hull's first too; then the rest of the hull's; then the ventricles'.
    n, m = slot.mouth, len(slot.points)
    triangles = np.where(triangles < n, triangles, triangles + m - n)
    points = np.concatenate([slot.points, outer[n:], inner])
    a, b, height = cleft.coordinates(points[triangles].mean(axis=1)).T
    outside = height > cleft.depth / 2
    lid = outside & (np.abs(a) < cleft.opening / 2) & (np.abs(b) < cleft.width / 2)
    window = outside & ~lid & (np.hypot(a, b) < craniotomy / 2)
    surfaces = [Surface("skull", triangles[~lid & ~window], 0), Surface("craniotomy", triangles[window], 0)]
    surfaces += [Surface(name, side, 0) for name, side in slot.sides.items()]
    if not _closed(np.concatenate([surface.triangles for surface in surfaces])):
        raise InputError("mesh sizes", "such that the surface does not close around the cleft", "smaller elements")
    surfaces.append(Surface("ventricle_wall", ventricle + len(points) - len(inner), 1, 0))
    return Elements.enclosed(points, surfaces, REGIONS, sizes.far)


def _clear(slot: Slot, ventricles: LevelSet) -> None:
    nearest = ventricles(slot.points).min()
    if nearest < CLEARANCE:
        wanted = f"a target, approach and size of the cleft that leave {1e3 * CLEARANCE:g} mm to the ventricles"
        where = ", ".join(f"{1e3 * c:.1f}" for c in slot.cleft.target)
        raise InputError("cleft.target_mm", f"({where}) mm with a cleft that opens a ventricle", wanted)


def _enclosing(
    surface: LevelSet, make: Callable[[LevelSet], tuple[Points, np.ndarray]]
) -> tuple[LevelSet, Points, np.ndarray]:
    """An outline moved, and triangles on it, so that they enclose what the outline did."""
    wanted = float((surface.values < 0).sum()) * surface.spacing**3
    for _ in range(ROUNDS):
        points, triangles = make(surface)
        a, b, c = (points[triangles[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a) / 2
        missing = wanted - float(np.einsum("ij,ij->", a, normals)) / 3
        if abs(missing) <= ENOUGH * wanted:
            break
        surface = surface.moved(missing / float(np.linalg.norm(normals, axis=1).sum()))
    return surface, points, triangles


def _closed(triangles: np.ndarray) -> bool:
    """Whether every edge has one triangle on each side."""
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).tolist()
    every = set(map(tuple, edges))
    return len(every) == len(edges) and all((b, a) in every for a, b in every)
