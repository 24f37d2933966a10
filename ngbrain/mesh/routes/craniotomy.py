"""An opening in a head by any route: a cleft with plane walls under a craniotomy."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import version

import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.io.cache import load_or_compute
from ngbrain.mesh import tet_mesh
from ngbrain.mesh.geometry import cleft as cleft_module
from ngbrain.mesh.geometry import cleft_walls
from ngbrain.mesh.geometry.cleft import Cleft, frame
from ngbrain.mesh.geometry.level_set import LevelSet
from ngbrain.mesh.geometry.primitives import Sizes
from ngbrain.mesh.geometry.sizing import CleftSizeField
from ngbrain.mesh.improve.guarded_moves import apply_guarded_moves
from ngbrain.mesh.routes import cleft_head
from ngbrain.mesh.routes.registry import ROUTES, LabelMesh, mesh_labels, size_as_dict
from ngbrain.mesh.surface.head_outlines import outlines
from ngbrain.mesh.tet_mesh import Elements

ALIGNED = 0.5
"""Cosine between the normal of a triangle and that of the wall that it is called by at least."""
RINGS, TURNS = 3, 6
"""Layers of points inside that make room for those that go onto the planes, and how often they do."""
NEAR_WALL = 1.5
"""Voxels up to which triangles that face the cleft may be off its planes."""
SIDES = {"wall_plus": (0, 1), "wall_minus": (0, -1), "end_plus": (1, 1), "end_minus": (1, -1), "floor": (2, -1)}
"""Boundaries of a cleft: the coordinate that is constant there (across, along, height), and on which side."""

Points = np.ndarray


@dataclass(frozen=True)
class Opening:
    """What is asked for, m: a cleft to `target`, `opening` between its walls and `width` along them, under a craniotomy.

    target       centre of the cleft's floor, in tissue
    craniotomy   diameter of the hole in the skull
    approach     direction from the target outwards; None: the shortest way
    across       direction from wall to wall; None: left to right

    Raises `InputError` for lengths that are not above 0 and a craniotomy that the cleft does not fit in.

    >>> Opening((0.0, 0.0, 0.05), opening=-4e-3)
    Traceback (most recent call last):
    ngbrain.errors.InputError: cleft.opening_mm is -4; wanted: a length above 0
    """

    target: tuple[float, float, float]
    opening: float = 4e-3
    width: float = 12e-3
    craniotomy: float = 40e-3
    approach: tuple[float, float, float] | None = None
    across: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("opening", "width", "craniotomy"):
            if not 0 < (value := getattr(self, name)) < 1:
                raise InputError(f"cleft.{name}_mm", f"{1e3 * value:g}", "a length above 0")
        if self.craniotomy < (diagonal := float(np.hypot(self.width, self.opening))):
            wanted = f"at least {1e3 * diagonal:.4g}, the diagonal of the cleft"
            raise InputError("cleft.craniotomy_mm", f"{1e3 * self.craniotomy:g}", wanted)

    def cleft(self, labels: LabelMap) -> Cleft:
        """Where it lies in a head of labels; raises what `cleft_in` raises."""
        ways = [None if way is None else np.array(way) for way in (self.approach, self.across)]
        shape = outlines(labels)
        return find_cleft(shape.brain, shape.ventricles, np.array(self.target), self.opening, self.width, *ways)


def find_cleft(
    brain: LevelSet,
    ventricles: LevelSet | None,
    target: Points,
    opening: float,
    width: float,
    approach: Points | None = None,
    across: Points | None = None,
) -> Cleft:
    """A cleft by the shortest way to the surface of a head, or along `approach`.

    Raises `InputError` for a target that is not in tissue, and where there is no way out.
    """
    where = "(" + ", ".join(f"{1e3 * c:.1f}" for c in target) + ") mm"
    if brain(target)[0] >= 0:
        raise InputError("cleft.target_mm", where, "a point inside the brain")
    if ventricles is not None and ventricles(target)[0] <= 0:
        raise InputError("cleft.target_mm", where, "a point in tissue, not in a ventricle")
    if approach is None:
        surface = brain.outline().mean(axis=1)
        approach = np.asarray(surface[np.linalg.norm(surface - target, axis=1).argmin()] - target)
    out, across = frame(approach, across)
    depth = float(brain.ray_distance(target[None], out, 0.3)[0])
    if np.isnan(depth):
        raise InputError("cleft.approach", out.tolist(), "a direction that leads out of the brain")
    return Cleft(target, out, across, depth, opening, width)


def mesh_with_cleft(
    labels: LabelMap, opening: Opening, route: str, near: float, far: float
) -> tuple[LabelMap, LabelMesh]:
    """What is left of labels when a head is opened, and its mesh by a route, from the cache if it was made before.

    By `hull` the walls are exact planes and the craniotomy's rim a circle; lesions that the cleft touches are no regions of it.
    By the other routes what is cut away is taken from the labels' shares, and walls are put onto the planes where elements stay
    good: those of tissues' corners and of the cleft's edges may miss them by part of an element, and the craniotomy ends with
    whole triangles.

    near   element size (m) at the walls; far that away from them

    Raises `InputError` for a cleft that cannot be, sizes that do not fit it, and what `meshed_by` raises.
    """
    cleft = opening.cleft(labels)
    size, left = CleftSizeField(cleft, near, far), remove_cleft(labels, cleft)
    if route != "hull":
        made = mesh_labels(left, route, size)
        spacing = float(labels.volume.spacing.max())
        return left, replace(made, elements=fit_cleft_walls(made.elements, cleft, opening.craniotomy, spacing))
    made_from = [labels.volume.digest(), dict(enumerate(labels.regions)), size_as_dict(size), opening.craniotomy]
    modules = (sys.modules[__name__], cleft_module, cleft_walls, tet_mesh, *ROUTES["hull"].modules)

    def make() -> dict[str, np.ndarray]:
        done = cleft_head.head(outlines(labels), cleft, opening.craniotomy, Sizes(near, far, far))
        return LabelMesh(done.elements, repairs=done.repairs).arrays()

    return left, LabelMesh.from_arrays(load_or_compute("opened", [*made_from, version("netgen-mesher")], modules, make))


def remove_cleft(labels: LabelMap, cleft: Cleft) -> LabelMap:
    """Labels that are cut away in a cleft, voxels on its walls by their share in it, so that planes stay planes.

    Raises `InputError` where that opens a ventricle, or nothing is left of a region.

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
    cleft_walls = np.zeros(data.shape, np.float32)
    cleft_walls[tuple(at.T)] = share
    gone = tuple(at[share > 0.5].T)
    lost = {labels.names[number] for number in np.unique(data[gone]).tolist()}
    where = ", ".join(f"{1e3 * c:.1f}" for c in cleft.target)
    if any(name.startswith("ventricle") for name in lost):
        found = f"({where}) mm with a cleft that opens a ventricle"
        raise InputError("cleft.target_mm", found, "a target, approach and size of the cleft that do not")
    mesh_with_cleft = replace(labels, cut=cleft_walls)
    if missing := [name for name, ml in mesh_with_cleft.volumes_ml().items() if not ml]:
        raise InputError(
            "cleft.target_mm", f"({where}) mm with a cleft that takes all of {missing[0]}", "another cleft"
        )
    return mesh_with_cleft


def fit_cleft_walls(elements: Elements, cleft: Cleft, craniotomy: float, voxel: float) -> Elements:
    """A mesh of carved labels with the boundaries of the cleft named and put onto its planes where elements stay good.

    Outer triangles that face the cleft become `wall_plus`, `wall_minus`, `end_plus`, `end_minus` and `floor` (see `Cleft`), those
    of the surface within the craniotomy's diameter (m) `craniotomy`; the others keep their names. `voxel` is the labels' (m).

    Raises `InputError` where the mesh has no such wall.
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
    """Points with those of the walls put where they should be, and those inside beside them making room, in turns."""
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
