"""The smallest model of a head: its surface, ventricles and lesions as conforming surfaces, tissue as a field inside."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image.labelmap import LabelMap
from ngbrain.mesh.conforming import PER_CUBE, named
from ngbrain.mesh.elements import Elements, Surface
from ngbrain.mesh.from_labels import BRAIN, VENTRICLES, enclosing, wall_of, walled_in
from ngbrain.mesh.grading import Sizes, asked
from ngbrain.mesh.levelset import LevelSet
from ngbrain.mesh.reconnection import Reconnection
from ngbrain.mesh.relocation import improved
from ngbrain.mesh.surfaces import triangulated

SMOOTHING = 2e-3
"""Standard deviation (m) of the Gaussian that rounds the voxels' steps; sulci go with it."""
MARGIN = 8e-3 + 4 * SMOOTHING
WALL = 2e-3
"""Tissue (m) that stays between a ventricle and the surface where the labels have less."""
GOAL, MOVES = float(np.sin(np.radians(16))), 40
"""Elements with angles between faces of less than 16° or more than 164° are worked on, in so many rounds."""
SWAPS = 4
"""Rounds in which swaps and moves take turns at most: Netgen leaves flat elements with all corners on a wall."""
MOST = 5e6
"""Tetrahedra of a mesh that is refused, as Netgen would not end."""
SPECK = 0.1
"""Millilitres of a piece of a ventricle or lesion below which it is left out."""
LEFT = 0.5
"""Part of a lesion that has to be left where it keeps away from ventricles and other lesions."""
LESION = re.compile("(lesion|tumou?r|metastas[ie]s|cyst|h(a)?ematoma|cavity|resection).*", re.IGNORECASE)
"""Regions that are so called have a surface of their own."""


def hull(labels: LabelMap, size: Sizes) -> Elements:
    """Tetrahedra of the head as a whole, region `brain`, around those that are called `ventricles` or as in `LESION`, if any.

    Boundaries `skull` (the surface), `ventricle_wall` and `<lesion>_wall`, at least `WALL` apart. The head is the
    largest piece of what has a label, its holes filled;
    volumes of the smoothed outlines are those of the voxels. What tissue a point belongs to is asked of the labels.

    size   points (n, 3) m → element size (n,) m, on the surfaces and inside

    Raises `InputError` where labels hold no head, where a lesion touches what it cannot, for sizes that are not positive or that
    need more than `MOST` tetrahedra, and where no mesh is found.

    >>> ball = np.linalg.norm(np.indices((40, 40, 40)) - 19.5, axis=0) < 16
    >>> from ngbrain.image.volume import Volume
    >>> labels = LabelMap(Volume(ball.astype(int), np.diag([1e-3, 1e-3, 1e-3, 1])), {1: "white"})
    >>> mesh = hull(labels, lambda points: np.full(len(points), 6e-3))
    >>> round(float(mesh.volumes().sum() / labels.volume.voxel_volume / ball.sum()), 2), mesh.regions, mesh.boundaries
    (1.0, ('brain',), ('skull',))
    """
    asked(labels, size, PER_CUBE, MOST)
    voxels = labels.upright()
    brain = _outline(voxels)
    inner = _inside(voxels, brain)
    points, triangles = triangulated(brain, size, np.zeros((0, 3)))
    points = enclosing(brain, points, triangles)
    surfaces, walls = [Surface("skull", triangles, 0)], {"skull": brain}
    for i, (name, outline) in enumerate(inner.items(), 1):
        found, wall = walled_in(outline, size)
        surfaces.append(Surface(wall_of(name), wall + len(points), i, 0))
        points = np.concatenate([points, found])
        walls[wall_of(name)] = outline
    corners = np.array([points.min(axis=0), points.max(axis=0)])
    made = Elements.enclosed(points, surfaces, (BRAIN, *inner), float(size(corners).max()), size)
    return _rounded(made, walls)


def _rounded(elements: Elements, outlines: dict[str, LevelSet]) -> Elements:
    """Without flat elements, and the surfaces moved back to where they enclose what they should."""
    elements = rounder(elements, outlines)
    for _ in range(SWAPS):
        swaps = Reconnection(elements.points, elements.tets, elements.region + 1)
        if not swaps.improve(GOAL):
            break
        elements = rounder(_swapped(elements, *swaps.arrays()), outlines)
    points = elements.points
    for name, outline in outlines.items():
        mine = elements.triangles[elements.boundary == elements.boundaries.index(name)]
        points = enclosing(outline, points, mine)
    return rounder(replace(elements, points=points), {})


def _swapped(elements: Elements, tets: np.ndarray, region: np.ndarray) -> Elements:
    """With other tetrahedra in regions from 1 on the same corners, and the walls that they have then."""
    made = named(elements.points, tets, region - 1, elements.regions)
    triangles, walls = made.triangles, made.boundary > 0
    triangles[walls] = triangles[walls][:, [0, 2, 1]]  # outwards of the ventricles and lesions
    return replace(made, triangles=triangles, boundaries=elements.boundaries)


def rounder(elements: Elements, outlines: dict[str, LevelSet]) -> Elements:
    """With corners of flat elements moved, those of boundaries on the level of the outline that they are on, or not at all."""
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
    return replace(elements, points=improved(start, tets, kept, place, GOAL, MOVES, np.random.default_rng(0)))


def outlines(labels: LabelMap) -> tuple[LevelSet, LevelSet | None, dict[str, LevelSet]]:
    """Smooth signed distances of the head, of its ventricles, None for no ventricles, and of lesions by name.

    Ventricles and lesions are at least `WALL` inside the head.
    """
    voxels = labels.upright()
    brain = _outline(voxels)
    inner = _inside(voxels, brain)
    return brain, inner.pop(VENTRICLES, None), inner


def _outline(voxels: LabelMap) -> LevelSet:
    head = _largest(voxels.volume.data > 0)
    if head.sum() * voxels.volume.voxel_volume < 1e-6:
        raise InputError("labels", "less than a millilitre", "a head")
    return LevelSet.of(head, voxels.volume.affine[:3, 3], float(voxels.volume.spacing[0]), SMOOTHING, MARGIN)


def _inside(voxels: LabelMap, brain: LevelSet) -> dict[str, LevelSet]:
    """Of the ventricles and of each lesion, `WALL` away from the surface and from those before."""
    origin, spacing = voxels.volume.affine[:3, 3], float(voxels.volume.spacing[0])
    found: dict[str, LevelSet] = {}
    lesions = [name for name in voxels.regions if LESION.fullmatch(name)]
    for name in [VENTRICLES] * (VENTRICLES in voxels.regions) + lesions:
        mask = _without_specks(voxels.volume.data == voxels.regions.index(name) + 1, voxels.volume.voxel_volume)
        if not mask.any():
            continue
        outline = LevelSet.of(mask, origin, spacing, SMOOTHING, MARGIN)
        grid = outline.origin + spacing * np.indices(outline.values.shape).reshape(3, -1).T
        values = np.maximum(outline.values.ravel(), brain(grid) + WALL)
        for other in found.values():
            values = np.maximum(values, WALL - other(grid))
        values = values.reshape(outline.values.shape).astype(np.float32)
        if (values < 0).sum() > LEFT * mask.sum():
            found[name] = replace(outline, values=values)
        elif name != VENTRICLES:
            wanted = f"{1e3 * WALL:g} mm between them, one label for both, or the route lattice or conforming"
            raise InputError("labels", f"such that {name} is too thin, or too close to {_others(found)}", wanted)
    return found


def _others(inner: dict[str, LevelSet]) -> str:
    return " or ".join([*inner, "the surface"])


def _largest(mask: np.ndarray) -> np.ndarray:
    pieces, _ = ndimage.label(mask)
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    return ndimage.binary_fill_holes(pieces == sizes.argmax()) if len(sizes) > 1 else mask


def _without_specks(mask: np.ndarray, voxel: float) -> np.ndarray:
    pieces, _ = ndimage.label(mask)
    kept = np.bincount(pieces.ravel()) * voxel * 1e6 >= SPECK
    kept[0] = False
    return kept[pieces]
