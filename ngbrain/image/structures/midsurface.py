"""Surface between the hemispheres: the template's mid plane, deformed into the dark longitudinal fissure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ngbrain.image.read.volume import Volume
from ngbrain.look import BriefText

_FIRST, _SHAPE, _STEP = np.array([-112.0, -80.0]), (97, 89), 2.0  # mm: y and z of the lattice
_REACH = 10.0  # mm, search range on both sides
_STIFF = 0.5  # cost at the end of the range, relative to the step from fluid to tissue
_SMOOTH = 5.0  # mm, smoothing of the surface
_LEAST = 0.1  # minimum depth of a valley, relative to the step
_OUTLIER = 2.0  # mm from the plane at which the weight is halved
_HOLD = 0.01  # weight of the plane, which determines the surface where no fissure is found
_ROUNDS = 10


@dataclass(frozen=True, eq=False, repr=False)
class MidSurface(BriefText):
    """Surface between the hemispheres, a graph over the template's plane x = 0.

    Parameters
    ----------
    offset : numpy.ndarray
        (97, 89) mm: distance of the surface to the right of the plane, every 2 mm of y and z.

    Examples
    --------
    >>> MidSurface(np.full((97, 89), 3.0)).right_of(np.array([[4.0, -20.0, 10.0]]))
    array([1.])
    """

    offset: np.ndarray

    def right_of(self, points: np.ndarray) -> np.ndarray:
        """Distance (n,) in mm of points (n, 3) of the template (mm) to the right of the surface."""
        where = ((points[:, 1:] - _FIRST) / _STEP).T
        return np.asarray(points[:, 0] - ndimage.map_coordinates(self.offset, where, order=1, mode="nearest"))

    @classmethod
    def fit(cls, head: Volume, affine: np.ndarray) -> MidSurface:
        """Fit the surface to a brain on a background of 0, given the affine (4, 4) of the template (m).

        For every y and z the darkest point within 10 mm of the plane is found, with a preference for near ones, and weighted by
        its contrast to both sides. A plane is fitted to these points, and then a surface smooth over 5 mm.
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
        for _ in range(_ROUNDS):  # iteratively reweighted, so that sulci beside the fissure do not tilt the plane
            sure = weight.ravel() / (1 + ((found.ravel() - basis @ plane) / _OUTLIER) ** 2)
            plane = np.linalg.lstsq(basis * np.sqrt(sure)[:, None], found.ravel() * np.sqrt(sure), rcond=None)[0]
        flat = (basis @ plane).reshape(found.shape)
        sure = weight / (1 + ((found - flat) / _OUTLIER) ** 2)
        over, total = (ndimage.gaussian_filter(each, _SMOOTH / _STEP) for each in (sure * (found - flat), sure))
        return cls(flat + over / (total + _HOLD))
