"""Fast interpolation of volume fractions and their gradients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ngbrain.look import BriefText

Points = np.ndarray
_CHUNK = 1 << 12


@dataclass(frozen=True, eq=False, repr=False)
class VolumeFractions(BriefText):
    """Volume fractions on a grid, with all fractions of a voxel contiguous in memory, which is several times as fast.

    Parameters
    ----------
    values : ndarray of float32, shape (nx · ny · nz, regions + 1)
        Volume fractions; voxels in C order.
    shape : ndarray of int, shape (3,)
        Shape of the grid.
    matrix : ndarray, shape (3, 3)
        Linear map from m to indices.
    origin : ndarray, shape (3,)
        Position of the first voxel centre (m).

    Examples
    --------
    >>> share = np.tile(np.array([0, 0.5, 1, 1], np.float32), (4, 4, 1))
    >>> VolumeFractions.of(np.stack([share, 1 - share]), np.diag([1e-3, 1e-3, 1e-3, 1]))(1e-3 * np.array([[1, 1, 0], [1, 2, 1.5]]))
    array([[0. , 1. ], [0.75, 0.25]], dtype=float32)
    """

    values: np.ndarray
    shape: np.ndarray
    matrix: np.ndarray
    origin: np.ndarray

    @classmethod
    def of(cls, fractions: np.ndarray, affine: np.ndarray) -> VolumeFractions:
        """Copy volume fractions into this layout.

        Parameters
        ----------
        fractions : ndarray, shape (regions + 1, nx, ny, nz)
            Volume fractions.
        affine : ndarray, shape (4, 4)
            Indices → m.

        Returns
        -------
        VolumeFractions
            The copy.
        """
        regions, *shape = fractions.shape
        values = np.ascontiguousarray(np.moveaxis(fractions, 0, -1)).reshape(-1, regions)
        return cls(values, np.array(shape), np.linalg.inv(affine[:3, :3]), affine[:3, 3])

    @property
    def count(self) -> int:
        """Number of regions, including outside."""
        return int(self.values.shape[1])

    def __call__(self, points: Points) -> np.ndarray:
        """Volume fractions (n, regions + 1) as float32 at points (n, 3) in m; beyond the grid, those at its border."""
        return self._at((points - self.origin) @ self.matrix.T)

    def slopes(self, points: Points) -> tuple[np.ndarray, np.ndarray]:
        """Volume fractions (n, regions + 1), and gradients (n, regions + 1, 3) in 1/m by differences over half a voxel each way."""
        at = (points - self.origin) @ self.matrix.T
        differences = np.stack([self._at(at + e) - self._at(at - e) for e in 0.5 * np.eye(3)], axis=-1)
        return self._at(at), differences @ self.matrix

    def _at(self, indices: np.ndarray) -> np.ndarray:
        found = np.empty((len(indices), self.count), np.float32)
        stride = int(self.shape[2])
        plane = int(self.shape[1]) * stride

        def around(first: np.ndarray, weights: tuple[np.ndarray, ...]) -> np.ndarray:
            """Points along the last axis: arithmetic runs along it, not along the few regions of a point."""
            total = np.zeros((self.count, len(first)), np.float32)
            for weight, offset in zip(weights, (0, stride, plane, plane + stride), strict=True):
                total += weight * np.ascontiguousarray(self.values.take(first + offset, axis=0).T)
            return total

        for start in range(0, len(indices), _CHUNK):
            at = np.clip(indices[start : start + _CHUNK], 0, self.shape - 1.001)
            base = at.astype(np.int64)
            x, y, z = np.ascontiguousarray((at - base).astype(np.float32).T)
            corner = base[:, 0] * plane + base[:, 1] * stride + base[:, 2]
            weights = (1 - x) * (1 - y), (1 - x) * y, x * (1 - y), x * y
            below, above = around(corner, weights), around(corner + 1, weights)
            found[start : start + _CHUNK] = (below + z * (above - below)).T
        return found
