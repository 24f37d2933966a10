"""How fine a mesh is where: fine around a site, coarser away from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.mesh.geometry.cleft import Cleft

SizeField = Callable[[np.ndarray], np.ndarray]
"""Points (n, 3) m → element size (n,) m: what every route takes."""
ACROSS = 2
"""Elements across a cleft at least: larger ones bridge it."""


@dataclass(frozen=True)
class RadialSizeField:
    """Element size h(x) = min(far, near + growth · max(|x - site| - radius, 0)), all in m.

    near, far  sizes at the site and away from it; growth per distance
    site       point (3,); None: `far` everywhere
    radius     around the site in which the size is `near`

    Raises `InputError` unless 0 < near ≤ far, and for a radius below 0.

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
        """Sizes (n,) at points (n, 3)."""
        if self.site is None:
            return np.full(len(points), self.far)
        away = np.linalg.norm(np.asarray(points) - np.asarray(self.site), axis=1)
        return np.minimum(self.far, self.near + self.growth * np.maximum(away - self.radius, 0))


@dataclass(frozen=True)
class CleftSizeField:
    """Element size (m) `near` at the walls of a cleft, growing with the distance from them up to `far`.

    Raises `InputError` unless 0 < near ≤ far and `ACROSS` elements fit between the walls.
    """

    cleft: Cleft
    near: float
    far: float
    growth: float = 0.3

    def __post_init__(self) -> None:
        if not 0 < self.near <= self.far < np.inf or ACROSS * self.near > self.cleft.opening * (1 + 1e-9):
            found = f"{1e3 * self.near:g} mm near and {1e3 * self.far:g} mm far"
            wanted = (
                f"at most {1e3 * self.cleft.opening / ACROSS:g} mm near, for a cleft of {1e3 * self.cleft.opening:g} mm"
            )
            raise InputError("mesh size", found, f"{wanted}, and not less far away")

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Sizes (n,) at points (n, 3)."""
        return np.minimum(self.far, self.near + self.growth * self.cleft.distance_to_walls(points))


def sample_sizes(labels: LabelMap, size: SizeField, per_cube: float, most: float) -> np.ndarray:
    """Sizes (n,) m in the voxels of a map that have a label.

    Raises `InputError` where there is none, for sizes that are not positive numbers, and such that, with so many tetrahedra in a
    cube of their size, more than `most` would result.
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
