"""Size fields: element size as a function of position."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.mesh.geometry.cleft import Cleft

SizeField = Callable[[np.ndarray], np.ndarray]
"""Points (n, 3) in m → element size (n,) in m: the argument of every meshing route."""
ACROSS = 2
"""Smallest number of elements across a cleft; larger elements bridge it."""


@dataclass(frozen=True)
class RadialSizeField:
    """Element size that grows with the distance from a site: h(x) = min(far, near + growth · max(|x - site| - radius, 0)).

    Parameters
    ----------
    near : float
        Element size at the site (m).
    far : float
        Element size far from it (m).
    site : tuple of float, optional
        Position of the site (m); None: `far` everywhere.
    radius : float
        Radius (m) around the site in which the size is `near`.
    growth : float
        Growth of the size per distance.

    Raises
    ------
    InputError
        Not 0 < near ≤ far, or the radius is negative.

    Examples
    --------
    >>> size = RadialSizeField(0.002, 0.008, site=(0.0, 0.0, 0.0))
    >>> size(np.array([[0, 0, 0.01], [0, 0, 0.025], [0, 0, 0.1]])).round(4).tolist()
    [0.002, 0.004, 0.008]
    """

    near: float
    far: float
    site: tuple[float, float, float] | None = None
    radius: float = 20e-3
    growth: float = 0.4

    def __post_init__(self) -> None:
        if not 0 < self.near <= self.far < np.inf:
            found = f"{1e3 * self.near:g} mm near and {1e3 * self.far:g} mm far"
            raise InputError("mesh size", found, "sizes above 0, not larger near the site than far from it")
        if not 0 <= self.radius < np.inf:
            raise InputError("radius", f"{1e3 * self.radius:g} mm", "a length from 0 on")

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Element sizes (n,) in m at points (n, 3) in m."""
        if self.site is None:
            return np.full(len(points), self.far)
        away = np.linalg.norm(np.asarray(points) - np.asarray(self.site), axis=1)
        return np.minimum(self.far, self.near + self.growth * np.maximum(away - self.radius, 0))


@dataclass(frozen=True)
class CleftSizeField:
    """Element size that grows with the distance from the walls of a cleft, from `near` up to `far`, or to `under` a craniotomy.

    Parameters
    ----------
    cleft : Cleft
        The cleft.
    near : float
        Element size at the walls (m).
    far : float
        Largest element size (m).
    growth : float
        Growth of the size per distance.
    under : float, optional
        Largest element size (m) under the craniotomy; None: `far`.
    craniotomy : float
        Diameter (m) of the craniotomy around the cleft.

    Raises
    ------
    InputError
        Not 0 < near ≤ far, or fewer than `ACROSS` elements fit between the walls.
    """

    cleft: Cleft
    near: float
    far: float
    growth: float = 0.3
    under: float | None = None
    craniotomy: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.near <= self.far < np.inf or ACROSS * self.near > self.cleft.opening * (1 + 1e-9):
            found = f"{1e3 * self.near:g} mm near and {1e3 * self.far:g} mm far"
            wanted = (
                f"at most {1e3 * self.cleft.opening / ACROSS:g} mm near, for a cleft of {1e3 * self.cleft.opening:g} mm"
            )
            raise InputError("mesh size", found, f"{wanted}, and not less far away")

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Element sizes (n,) in m at points (n, 3) in m."""
        size = np.minimum(self.far, self.near + self.growth * self.cleft.distance_to_walls(points))
        if self.under is None:
            return size
        across, along, height = self.cleft.coordinates(points).T
        below = (np.hypot(across, along) <= self.craniotomy / 2) & (height > 0)
        return np.where(below, np.clip(size, self.near, max(self.under, self.near)), size)


def sample_sizes(labels: LabelMap, size: SizeField, per_cube: float, most: float) -> np.ndarray:
    """Evaluate a size field at the labelled voxels and check the number of elements.

    Parameters
    ----------
    labels : LabelMap
        The labels.
    size : SizeField
        Element size (m).
    per_cube : float
        Number of tetrahedra in a cube of their size.
    most : float
        Largest number of tetrahedra allowed.

    Returns
    -------
    ndarray, shape (n,)
        Element sizes (m) at the voxels with a label.

    Raises
    ------
    InputError
        No voxel has a label, a size is not a positive number, or the sizes give more than `most` tetrahedra.
    """
    at = labels.volume.to_world(np.argwhere(labels.volume.data != 0))
    if not len(at):
        raise InputError("labels", "0 in every voxel", "a region")
    h = np.asarray(size(at), float)
    if h.shape != (len(at),) or not (np.isfinite(h) & (h > 0)).all():
        found = f"{h.min():g} m somewhere" if h.shape == (len(at),) else f"an array of shape {h.shape}"
        raise InputError("size", found, "a number above 0 (m) for every point")
    count = per_cube * labels.volume.voxel_volume * float((h**-3.0).sum())
    if count > most:
        raise InputError("size", f"so small that {count:.2g} tetrahedra would result", f"at most {most:.2g} of them")
    return h
