"""A shape from voxels as a smooth signed distance, with projection of points onto it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from ngbrain.errors import require
from ngbrain.look import BriefText

Points = np.ndarray
LARGE = 100_000
"""Number of grid points near the outline above which only every second one is used for triangles."""
LEVELS = 8
"""Iterations of the local volume correction."""
STEP = 0.5
"""Largest shift in each of these iterations (voxels)."""
FAINT = 0.02
"""Smallest outline area (per voxel) for a full shift."""
NEWTON = 12
"""Newton steps that project a point onto a level; a smoothed distance has a slope near 1."""


@dataclass(frozen=True, eq=False, repr=False)
class LevelSet(BriefText):
    """Signed distance φ (m) on a grid, negative inside and trilinear in between; far from the shape it is only a bound.

    Parameters
    ----------
    values : ndarray, shape (nx, ny, nz)
        φ at the grid points (m).
    origin : ndarray, shape (3,)
        Position of the first grid point (m).
    spacing : float
        Grid spacing (m).
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
        """Smooth the outline of a mask and keep its volume.

        Parameters
        ----------
        mask : ndarray of bool, shape (nx, ny, nz)
            The shape.
        origin : ndarray, shape (3,)
            Centre of the first voxel (m).
        spacing : float
            Voxel size (m).
        smoothing : float
            Standard deviation (m) of the Gaussian that smooths the voxel steps.
        margin : float
            Margin (m) around the mask.
        around : float, default 0
            Standard deviation (m) of a Gaussian window in which the volume is kept locally. Thin parts then stay and do not
            thicken the rest. 0 keeps the total volume only.
        volume : float, optional
            Enclosed volume (m³); None: that of the mask.

        Returns
        -------
        LevelSet
            The smoothed outline.
        """
        box = [slice(*np.flatnonzero(mask.any(axis=tuple({0, 1, 2} - {i})))[[0, -1]] + [0, 1]) for i in range(3)]
        start = np.array([s.start for s in box])
        pad = int(np.ceil(margin / spacing))
        inner = np.pad(mask[tuple(box)], pad)
        distance = ndimage.distance_transform_edt(~inner) - ndimage.distance_transform_edt(inner)
        distance -= 0.5 * np.sign(distance)  # the outline lies halfway between voxels
        smooth = ndimage.gaussian_filter(distance.astype(np.float32), smoothing / spacing)
        n = int(inner.sum())
        wanted = n if volume is None else min(round(volume / spacing**3), inner.size - 1)
        smooth -= _level_of_volume(smooth, wanted)
        if around:
            smooth = _match_local_volume(
                smooth, inner.astype(np.float32) * np.float32(wanted / n), wanted, around / spacing
            )
        return cls(smooth * np.float32(spacing), origin + (start - pad) * spacing, spacing)

    def solid(self) -> LevelSet:
        """The largest component with its cavities filled; smaller components become outside."""
        found = self.values.copy()
        for side in (-1, 1):
            pieces, _ = ndimage.label(side * found > 0)
            sizes = np.bincount(pieces.ravel())
            sizes[0] = 0
            found[(pieces > 0) & (pieces != sizes.argmax())] *= -1
        return replace(self, values=found)

    def __call__(self, points: Points) -> np.ndarray:
        """Values φ (n,) in m at points (n, 3) in m; beyond the grid, the value at its border."""
        at = (np.atleast_2d(points) - self.origin) / self.spacing
        return ndimage.map_coordinates(self.values, at.T, order=1, mode="nearest", output=float)

    def normals(self, points: Points) -> np.ndarray:
        """Gradient ∇φ (n, 3) at points (n, 3), by central differences over one voxel to each side."""
        steps = self.spacing * np.concatenate([np.eye(3), -np.eye(3)])
        ahead, behind = self((points + steps[:, None]).reshape(-1, 3)).reshape(2, 3, -1)
        return np.asarray((ahead - behind).T / (2 * self.spacing))

    def outline(self) -> np.ndarray:
        """Triangles (n, 3, 3) in m that cover φ = 0, of one grid spacing (two for large shapes); needs the extra `mri`."""
        measure = require("skimage.measure", "mri")
        stride = 1 if np.count_nonzero(np.abs(self.values) < self.spacing / 2) < LARGE else 2
        vertices, faces, *_ = measure.marching_cubes(self.values, 0.0, step_size=stride)
        return np.asarray((self.origin + vertices.astype(float) * self.spacing)[faces])

    def project(self, points: Points, level: float | np.ndarray = 0.0) -> Points:
        """Project points onto a level along the gradient, by at most two voxels a step.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            Points (m).
        level : float or ndarray, shape (n,)
            Level (m), one for all points or one for each.

        Returns
        -------
        ndarray, shape (n, 3)
            Points with φ = level (m).
        """
        points = np.array(points, float)
        for _ in range(NEWTON):
            gradient = self.normals(points)
            step = (self(points) - level) / np.maximum((gradient**2).sum(axis=1), 0.05)
            limit = 2 * self.spacing / np.maximum(np.abs(step) * np.linalg.norm(gradient, axis=1), 2 * self.spacing)
            points -= (step * limit)[:, None] * gradient
        return points

    def ray_distance(self, start: Points, direction: np.ndarray, longest: float) -> np.ndarray:
        """Distance from points inside to the surface φ = 0 along a ray.

        Parameters
        ----------
        start : ndarray, shape (n, 3)
            Points inside (m).
        direction : ndarray, shape (3,)
            Unit vector.
        longest : float
            Length of the ray (m).

        Returns
        -------
        ndarray, shape (n,)
            Distance (m) to the first intersection; NaN where there is none.
        """
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


def _level_of_volume(smooth: np.ndarray, n: int) -> np.floating:
    """The level below which there are n voxels."""
    found: np.floating = np.partition(smooth.ravel(), n)[n]
    return found


def _match_local_volume(smooth: np.ndarray, inner: np.ndarray, n: int, around: float) -> np.ndarray:
    """Shift a distance (voxels) locally, so that each neighbourhood has the volume of `inner`, and n voxels are below 0 in all.

    Newton's method: missing volume over outline area, both as Gaussian averages.
    """
    wanted = ndimage.gaussian_filter(inner, around)
    for _ in range(LEVELS):
        share = (0.5 - smooth).clip(0, 1)
        area = ((share > 0) & (share < 1)).astype(np.float32)
        missing = wanted - ndimage.gaussian_filter(share, around)
        smooth = smooth - (missing / (ndimage.gaussian_filter(area, around) + FAINT)).clip(-STEP, STEP)
    return smooth - _level_of_volume(smooth, n)
