"""A head opened by a cleft with plane walls under a craniotomy, by any meshing route."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.mesh.geometry.cleft import Cleft, frame
from ngbrain.mesh.geometry.level_set import LevelSet
from ngbrain.mesh.geometry.primitives import Sizes
from ngbrain.mesh.geometry.sizing import CleftSizeField
from ngbrain.mesh.routes.cleft_subtraction import remove_cleft
from ngbrain.mesh.routes.registry import LabelMesh, mesh_with_opening
from ngbrain.mesh.surface.head_outlines import outlines

Points = np.ndarray


@dataclass(frozen=True)
class Opening:
    """A requested cleft under a craniotomy.

    Parameters
    ----------
    target : tuple of float
        Centre of the cleft's floor, in tissue (m).
    opening : float
        Distance between the walls (m).
    width : float
        Extent along the walls (m).
    craniotomy : float
        Diameter of the hole in the skull (m).
    approach : tuple of float, optional
        Direction from the target outwards; None: the shortest path.
    across : tuple of float, optional
        Direction from wall to wall; None: left to right.

    Raises
    ------
    InputError
        A length is not above 0, or the cleft does not fit into the craniotomy.

    Examples
    --------
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
        """Position the cleft in a head of labels; raises as `find_cleft` does."""
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
    """Find a cleft from a target to the surface of a head.

    Parameters
    ----------
    brain : LevelSet
        The brain's surface.
    ventricles : LevelSet or None
        Surface of the ventricles.
    target : ndarray, shape (3,)
        Centre of the floor (m).
    opening : float
        Distance between the walls (m).
    width : float
        Extent along the walls (m).
    approach : ndarray, shape (3,), optional
        Direction outwards; None: the shortest path.
    across : ndarray, shape (3,), optional
        Direction from wall to wall; None: left to right.

    Returns
    -------
    Cleft
        The cleft.

    Raises
    ------
    InputError
        The target is not in tissue, or no path leads to the surface.
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
    """Open a head and mesh it by a route; a mesh made before comes from the cache.

    By `hull`, the walls are exact planes and the craniotomy's rim is a circle; lesions touched by the cleft are no regions of
    it. By other routes see `registry.subtract_cleft`.

    Parameters
    ----------
    labels : LabelMap
        The labels.
    opening : Opening
        The requested cleft.
    route : str
        Meshing route.
    near : float
        Element size at the walls (m).
    far : float
        Element size far away from them (m).

    Returns
    -------
    labels : LabelMap
        Labels without the cleft.
    mesh : LabelMesh
        The mesh.

    Raises
    ------
    InputError
        The cleft is impossible, sizes do not fit it, or `mesh_with_opening` fails.
    """
    cleft = opening.cleft(labels)
    CleftSizeField(cleft, near, far)  # refuses sizes that do not fit the cleft
    left = remove_cleft(labels, cleft)
    return left, mesh_with_opening(labels, cleft, opening.craniotomy, route, Sizes(near, far, far))
