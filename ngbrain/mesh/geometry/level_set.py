"""A shape given by voxels, as a smooth signed distance that points can be put on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from ngbrain.errors import require

Points = np.ndarray
LARGE = 100_000
"""Grid points beside the outline of a shape that is drawn with every other one."""
LEVELS = 8
"""Rounds in which levels follow the volume around each place,"""
STEP = 0.5
"""by so many voxels at most in each,"""
FAINT = 0.02
"""and less where there is less outline than this (per voxel)."""
NEWTON = 12
"""Steps with which a point is put on a level: a smoothed distance has a slope near 1."""


@dataclass(frozen=True, eq=False)
class LevelSet:
    """φ (m), negative inside, linear between the points of a grid; far from the shape it is only a bound.

    values   (nx, ny, nz) m; origin (3,) of the first, m; spacing of the grid (m)
    """

    values: np.ndarray
    origin: np.ndarray
    spacing: float

    @classmethod
    def of(
        cls,
        mask: np.ndarray,
        origin: np.ndarray,
        spacing: float,
        smoothing: float,
        margin: float,
        around: float = 0.0,
        volume: float | None = None,
    ) -> LevelSet:
        """The smoothed outline of a mask (nx, ny, nz), `origin` (m) at its first voxel; it encloses a volume.

        smoothing   standard deviation (m) of the Gaussian that rounds the voxels' steps
        margin      room (m) around the mask
        around      standard deviation (m) of a Gaussian: the volume is kept within so much of every place, so that what is thin
                    stays, and does not make the rest thicker; 0 keeps it as a whole
        volume      that is enclosed (m³); None: the mask's
        """
        box = [slice(*np.flatnonzero(mask.any(axis=tuple({0, 1, 2} - {i})))[[0, -1]] + [0, 1]) for i in range(3)]
        start = np.array([s.start for s in box])
        pad = int(np.ceil(margin / spacing))
        inner = np.pad(mask[tuple(box)], pad)
        distance = ndimage.distance_transform_edt(~inner) - ndimage.distance_transform_edt(inner)
        distance -= 0.5 * np.sign(distance)  # the outline lies between voxels
        smooth = ndimage.gaussian_filter(distance.astype(np.float32), smoothing / spacing)
        n = int(inner.sum())
        wanted = n if volume is None else min(round(volume / spacing**3), inner.size - 1)
        smooth -= _level(smooth, wanted)
        if around:
            smooth = _levelled(smooth, inner.astype(np.float32) * np.float32(wanted / n), wanted, around / spacing)
        return cls(smooth * np.float32(spacing), origin + (start - pad) * spacing, spacing)

    def solid(self) -> LevelSet:
        """The largest piece without its holes: smaller pieces are outside, and what is closed in is inside."""
        found = self.values.copy()
        for side in (-1, 1):
            pieces, _ = ndimage.label(side * found > 0)
            sizes = np.bincount(pieces.ravel())
            sizes[0] = 0
            found[(pieces > 0) & (pieces != sizes.argmax())] *= -1
        return replace(self, values=found)

    def __call__(self, points: Points) -> np.ndarray:
        """φ (n,) at points (n, 3) in m; beyond the grid the value at its border."""
        at = (np.atleast_2d(points) - self.origin) / self.spacing
        return ndimage.map_coordinates(self.values, at.T, order=1, mode="nearest", output=float)

    def normals(self, points: Points) -> np.ndarray:
        """∇φ (n, 3), by differences over a voxel to each side."""
        steps = self.spacing * np.concatenate([np.eye(3), -np.eye(3)])
        ahead, behind = self((points + steps[:, None]).reshape(-1, 3)).reshape(2, 3, -1)
        return np.asarray((ahead - behind).T / (2 * self.spacing))

    def outline(self) -> np.ndarray:
        """Triangles (n, 3, 3) m all over φ = 0, a grid spacing or, of large shapes, two in size; needs the extra `mri`."""
        measure = require("skimage.measure", "mri")
        stride = 1 if np.count_nonzero(np.abs(self.values) < self.spacing / 2) < LARGE else 2
        vertices, faces, *_ = measure.marching_cubes(self.values, 0.0, step_size=stride)
        return np.asarray((self.origin + vertices.astype(float) * self.spacing)[faces])

    def project(self, points: Points, level: float | np.ndarray = 0.0) -> Points:
        """Points (n, 3) moved along the gradient to φ = level, one or one each, at most two voxels at a time."""
        points = np.array(points, float)
        for _ in range(NEWTON):
            gradient = self.normals(points)
            step = (self(points) - level) / np.maximum((gradient**2).sum(axis=1), 0.05)
            limit = 2 * self.spacing / np.maximum(np.abs(step) * np.linalg.norm(gradient, axis=1), 2 * self.spacing)
            points -= (step * limit)[:, None] * gradient
        return points

    def ray_distance(self, start: Points, direction: np.ndarray, longest: float) -> np.ndarray:
        """How far (n,) from points inside, along a unit vector, φ = 0 is first met (m); NaN where it is not."""
        s = np.arange(0.0, longest, self.spacing / 2)
        path = start[:, None] + s[:, None] * direction
        phi = self(path.reshape(-1, 3)).reshape(len(start), -1)
        out = phi > 0
        k = out.argmax(axis=1)
        found = out.any(axis=1) & (k > 0)
        i, j = np.arange(len(start)), np.maximum(k, 1)
        low, high = phi[i, j - 1], phi[i, j]
        share = low / np.where(found, low - high, 1.0)
        return np.where(found, s[j - 1] + share * self.spacing / 2, np.nan)


def _level(smooth: np.ndarray, n: int) -> np.floating:
    """The value below which there are n voxels."""
    found: np.floating = np.partition(smooth.ravel(), n)[n]
    return found


def _levelled(smooth: np.ndarray, inner: np.ndarray, n: int, around: float) -> np.ndarray:
    """A distance (voxels) shifted from place to place so that as much is below 0 around each as in `inner`, n voxels in all.

    Newton's method: what is missing over the outline's area, both as averages by a Gaussian.
    """
    wanted = ndimage.gaussian_filter(inner, around)
    for _ in range(LEVELS):
        share = (0.5 - smooth).clip(0, 1)
        area = ((share > 0) & (share < 1)).astype(np.float32)
        missing = wanted - ndimage.gaussian_filter(share, around)
        smooth = smooth - (missing / (ndimage.gaussian_filter(area, around) + FAINT)).clip(-STEP, STEP)
    return smooth - _level(smooth, n)
