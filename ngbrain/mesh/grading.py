"""How fine a mesh is where: fine around a site, coarser away from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ngbrain.errors import InputError
from ngbrain.mesh.cleft import Cleft

Sizes = Callable[[np.ndarray], np.ndarray]
"""Points (n, 3) m → element size (n,) m: what every route takes."""
ACROSS = 2
"""Elements across a cleft at least: larger ones bridge it."""


@dataclass(frozen=True)
class Graded:
    """Element size h(x) = min(far, near + growth · max(|x - site| - radius, 0)), all in m.

    near, far  sizes at the site and away from it; growth per distance
    site       point (3,); None: `far` everywhere
    radius     around the site in which the size is `near`

    Raises `InputError` unless 0 < near ≤ far.

    >>> size = Graded(0.002, 0.008, site=(0.0, 0.0, 0.0))
    >>> size(np.array([[0, 0, 0.01], [0, 0, 0.025], [0, 0, 0.1]])).round(4).tolist()
    [0.002, 0.004, 0.008]
    """

    near: float
    far: float
    site: tuple[float, float, float] | None = None
    radius: float = 20e-3
    growth: float = 0.4

    def __post_init__(self) -> None:
        if not 0 < self.near <= self.far:
            found = f"{1e3 * self.near:g} mm near and {1e3 * self.far:g} mm far"
            raise InputError("mesh size", found, "sizes above 0, not larger near the site than far from it")

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Sizes (n,) at points (n, 3)."""
        if self.site is None:
            return np.full(len(points), self.far)
        away = np.linalg.norm(np.asarray(points) - np.asarray(self.site), axis=1)
        return np.minimum(self.far, self.near + self.growth * np.maximum(away - self.radius, 0))


@dataclass(frozen=True)
class Along:
    """Element size (m) `near` at the walls of a cleft, growing with the distance from them up to `far`.

    Raises `InputError` unless 0 < near ≤ far and `ACROSS` elements fit between the walls.
    """

    cleft: Cleft
    near: float
    far: float
    growth: float = 0.3

    def __post_init__(self) -> None:
        if not 0 < self.near <= self.far or ACROSS * self.near > self.cleft.opening * (1 + 1e-9):
            found = f"{1e3 * self.near:g} mm near and {1e3 * self.far:g} mm far"
            wanted = (
                f"at most {1e3 * self.cleft.opening / ACROSS:g} mm near, for a cleft of {1e3 * self.cleft.opening:g} mm"
            )
            raise InputError("mesh size", found, f"{wanted}, and not less far away")

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Sizes (n,) at points (n, 3)."""
        return np.minimum(self.far, self.near + self.growth * self.cleft.distance_to_walls(points))
