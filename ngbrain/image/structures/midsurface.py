"""The surface between the two halves of a brain: a plane where the template has it, bent into the dark fissure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ngbrain.image.read.volume import Volume

_FIRST, _SHAPE, _STEP = np.array([-112.0, -80.0]), (97, 89), 2.0  # mm: y and z of the lattice
_REACH = 10.0  # mm to both sides that the fissure is looked for in
_STIFF = 0.5  # of the step from fluid to tissue: what it costs to be at the reach's end
_SMOOTH = 5.0  # mm, of the surface
_LEAST = 0.1  # of the step: a valley that is less deep says nothing
_OUTLIER = 2.0  # mm from the plane, where half the weight is lost
_HOLD = 0.01  # weight with which the plane holds the surface, so that it is kept where nothing is seen
_ROUNDS = 10


@dataclass(frozen=True, eq=False)
class MidSurface:
    """offset  (97, 89) mm: how far right of the template's plane x = 0 the surface is, every 2 mm of y and z.

    >>> MidSurface(np.full((97, 89), 3.0)).right_of(np.array([[4.0, -20.0, 10.0]]))
    array([1.])
    """

    offset: np.ndarray

    def right_of(self, points: np.ndarray) -> np.ndarray:
        """How far (mm) right of the surface points (n, 3) of the template (mm) are."""
        where = ((points[:, 1:] - _FIRST) / _STEP).T
        return np.asarray(points[:, 0] - ndimage.map_coordinates(self.offset, where, order=1, mode="nearest"))

    @classmethod
    def fit(cls, head: Volume, affine: np.ndarray) -> MidSurface:
        """Of a brain on a background of 0, into which `affine` (4, 4) takes the template (m).

        For every y and z the darkest place within 10 mm of the plane is found, nearer ones preferred, and weighted by how
        much darker it is than what is beside it. A plane is fitted to these and then a surface smooth over 5 mm.
        """
        x = np.arange(-_REACH, _REACH + 0.25, 0.5)
        y, z = (first + _STEP * np.arange(n) for first, n in zip(_FIRST, _SHAPE, strict=True))
        grid = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)
        points = 1e-3 * grid.reshape(-1, 3) @ affine[:3, :3].T + affine[:3, 3]
        seen = ndimage.gaussian_filter(head.interpolate(points).reshape(grid.shape[:3]), (2, 1, 1))
        high = np.quantile(head.data[head.data > 0], 0.9)
        cost = seen / high + _STIFF * (x[:, None, None] / _REACH) ** 2
        low = cost.argmin(axis=0)
        at = np.take_along_axis(seen, low[None], axis=0)[0]
        walls = np.minimum(seen[: len(x) // 2].max(axis=0), seen[len(x) // 2 + 1 :].max(axis=0))
        weight = np.maximum((walls - at) / high - _LEAST, 0)
        found = x[low]
        basis = np.stack([np.ones(grid.shape[1:3]), *grid[0, ..., 1:].transpose(2, 0, 1) / 50], axis=-1).reshape(-1, 3)
        plane = np.zeros(3)
        for _ in range(_ROUNDS):  # reweighted, so that sulci beside the fissure do not tilt the plane
            sure = weight.ravel() / (1 + ((found.ravel() - basis @ plane) / _OUTLIER) ** 2)
            plane = np.linalg.lstsq(basis * np.sqrt(sure)[:, None], found.ravel() * np.sqrt(sure), rcond=None)[0]
        flat = (basis @ plane).reshape(found.shape)
        sure = weight / (1 + ((found - flat) / _OUTLIER) ** 2)
        over, total = (ndimage.gaussian_filter(each, _SMOOTH / _STEP) for each in (sure * (found - flat), sure))
        return cls(flat + over / (total + _HOLD))
