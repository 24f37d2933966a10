"""Smooth indicator functions of a label map: a mesh of tissues follows their interfaces and is measured against them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.look import BriefText
from ngbrain.mesh.labels.volume_fractions import VolumeFractions
from ngbrain.mesh.labels.volume_zones import Zones

Points = np.ndarray
SMOOTHING = 0.75e-3
"""Standard deviation (m) of the Gaussian that smooths the voxel steps."""
FILLED = 0.75
"""Part of the volume lost by smoothing that `Indicators.correct_volumes` restores."""
MOST = 0.25
"""Largest bias of a volume fraction for that correction."""
_STEPS = 0.1 * 0.85 ** np.arange(30)
LARGEST = 4e9
"""Largest size of all volume fractions (bytes); a mesh takes some copies of them."""
FAR = 5e-3
"""Distance (m) beyond which a gradient is meaningless: it vanishes in the middle of a film."""


@dataclass(frozen=True, eq=False, repr=False)
class Indicators(BriefText):
    """Volume fraction s_k of each region around a point; region 0 is outside.

    The regions of the largest fraction partition the head without gaps or overlaps. Two of them meet where s_a - s_b = 0.

    Parameters
    ----------
    fractions : ndarray of float32, shape (regions + 1, nx, ny, nz)
        Volume fractions at the voxel centres, trilinear in between.
    affine : ndarray, shape (4, 4)
        Indices → m.
    regions : tuple of str
        Names of the regions from 1.
    """

    fractions: np.ndarray
    affine: np.ndarray
    regions: tuple[str, ...]

    @classmethod
    def of(cls, labels: LabelMap, smoothing: float = SMOOTHING, margin: float = 4e-3) -> Indicators:
        """Smooth the indicators of a label map.

        Parameters
        ----------
        labels : LabelMap
            The labels.
        smoothing : float
            Standard deviation of the Gaussian (m).
        margin : float
            Margin of outside around the labels (m).

        Returns
        -------
        Indicators
            The smoothed indicators.

        Raises
        ------
        InputError
            Volume fractions of that many regions and voxels exceed `LARGEST` bytes.
        """
        pad = int(np.ceil(margin / labels.volume.spacing.min()))
        voxels = float(np.prod(np.array(labels.volume.data.shape) + 2.0 * pad))
        if 4 * (len(labels.regions) + 1) * voxels > LARGEST:
            found = f"{len(labels.regions)} regions on {voxels / 1e6:.3g} million voxels"
            raise InputError("labels", found, "names that join regions, larger voxels, or the route hull")
        numbered = np.pad(replace(labels, cut=None).region_numbers(), pad)
        sigma = smoothing / labels.volume.spacing
        left = (
            np.float32(1) if labels.cut is None else np.pad(1 - labels.cut.astype(np.float32), pad, constant_values=1)
        )
        fractions = np.stack(
            [
                ndimage.gaussian_filter((numbered == k) * left + (k == 0) * (1 - left), sigma)
                for k in range(len(labels.regions) + 1)
            ]
        )
        affine = labels.volume.affine.copy()
        affine[:3, 3] = labels.volume.to_world(np.full((1, 3), -pad))[0]
        return cls(fractions, affine, labels.regions)

    @cached_property
    def _together(self) -> VolumeFractions:
        return VolumeFractions.of(self.fractions, self.affine)

    def correct_volumes(self, zones: Zones) -> Indicators:
        """Add a constant to each region's volume fraction, in each zone its own, so that volumes come closer to their targets.

        Smoothing thins whatever is curved or thin. A constant of 0.1 moves an interface by about 0.1 mm on voxels of 1 mm. The rest
        (see `FILLED`) stays missing, since restoring it would move interfaces too far.
        """
        count, wanted = len(self.fractions), zones.target_volumes / abs(np.linalg.det(self.affine[:3, :3]))
        zone, fractions = self._voxels_in(zones), self.fractions.reshape(count, -1)
        sure = fractions.max(axis=0) > 0.5 + MOST  # stays the largest for any bias
        inside = [np.bincount(fractions[:, sure].argmax(axis=0), part[sure], count) for part in zone]
        fractions, there, given = fractions[:, ~sure], zone[:, ~sure], np.zeros((len(wanted), count), np.float32)
        for step in _STEPS:
            number = (fractions + given.T @ there).argmax(axis=0)
            got = (inside + np.stack([np.bincount(number, part, count) for part in there]))[:, 1:]
            missing = wanted / np.maximum(got, 1) - 1
            given[:, 1:] = np.clip(given[:, 1:] + np.clip(missing, -step, step), -MOST, MOST)
        return replace(
            self, fractions=self.fractions + np.float32(FILLED) * (given.T @ zone).reshape(self.fractions.shape)
        )

    def volumes(self, zones: Zones) -> np.ndarray:
        """Volumes (zones, regions) in m³ where each region has the largest volume fraction."""
        number = self.fractions.reshape(len(self.fractions), -1).argmax(axis=0)
        voxels = np.stack([np.bincount(number, part, len(self.fractions)) for part in self._voxels_in(zones)])
        return np.asarray(voxels[:, 1:] * abs(np.linalg.det(self.affine[:3, :3])))

    def _voxels_in(self, zones: Zones) -> np.ndarray:
        """Weight of each voxel in each zone (zones, voxels)."""
        _, *sheet = self.fractions.shape[1:]
        at = np.indices((1, *sheet)).reshape(3, -1).T @ self.affine[:3, :3].T + self.affine[:3, 3]
        sheets = [zones.weights(at + i * self.affine[:3, 0]).astype(np.float32) for i in range(self.fractions.shape[1])]
        return np.concatenate(sheets).T

    def __call__(self, points: Points) -> np.ndarray:
        """Volume fractions (n, regions + 1) at points (n, 3) in m."""
        return self._together(np.asarray(points))

    def region(self, points: Points) -> np.ndarray:
        """Number (n,) of the region with the largest volume fraction at points (n, 3)."""
        return self(points).argmax(axis=1)

    def distance(self, points: Points, a: int, b: int) -> np.ndarray:
        """First-order distance from the interface of two regions: |φ|/|∇φ| with φ = s_a - s_b.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            Points (m).
        a, b : int
            Numbers of the regions.

        Returns
        -------
        ndarray, shape (n,)
            Distances (m), at most `FAR`.
        """
        at = np.linalg.solve(self.affine[:3, :3], (np.asarray(points) - self.affine[:3, 3]).T)
        phi = self.fractions[a] - self.fractions[b]

        def value(where: np.ndarray) -> np.ndarray:
            return ndimage.map_coordinates(phi, where, float, order=1, mode="nearest")

        steps = 0.5 * np.eye(3)
        slopes = np.stack([value(at + e[:, None]) - value(at - e[:, None]) for e in steps])
        gradient = np.linalg.norm(np.linalg.solve(self.affine[:3, :3].T, slopes), axis=0)
        return np.minimum(np.abs(value(at)) / np.maximum(gradient, 1e-12), FAR)

    def slopes(self, points: Points) -> np.ndarray:
        """Gradients ∇s (n, regions + 1, 3) in 1/m, by central differences over half a voxel to each side."""
        return self._together.slopes(np.asarray(points))[1]

    def normals(self, points: Points, pairs: np.ndarray) -> np.ndarray:
        """Unit normals of interfaces.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            Points on interfaces (m).
        pairs : ndarray of int, shape (n, 2)
            The two regions at each point.

        Returns
        -------
        ndarray, shape (n, 3)
            Unit vectors from the first region to the second.
        """
        slopes, rows = self.slopes(points), np.arange(len(points))
        gradient = slopes[rows, pairs[:, 1]] - slopes[rows, pairs[:, 0]]
        return np.asarray(gradient / np.maximum(np.linalg.norm(gradient, axis=1), 1e-12)[:, None])

    def spread(self, points: Points, meeting: np.ndarray) -> np.ndarray:
        """Difference of the largest and smallest volume fraction among chosen regions: 0 where they meet.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            Points (m).
        meeting : ndarray of bool, shape (n, regions + 1)
            Regions that count.

        Returns
        -------
        ndarray, shape (n,)
            Differences.
        """
        fractions = self(points)
        return np.asarray(
            np.where(meeting, fractions, -np.inf).max(axis=1) - np.where(meeting, fractions, np.inf).min(axis=1)
        )

    def project_to_interface(self, points: Points, meeting: np.ndarray, steps: int = 3) -> Points:
        """Project points to where chosen regions have equal volume fractions.

        Shortest Newton steps of at most a voxel each; a condition that hardly varies in space is skipped.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            Points (m).
        meeting : ndarray of bool, shape (n, regions + 1)
            Regions that meet there.
        steps : int
            Number of Newton steps.

        Returns
        -------
        ndarray, shape (n, 3)
            Projected points (m).
        """
        points = np.array(points, float)
        two, rows = meeting.sum(axis=1) == 2, np.arange(len(points))
        first = meeting.argmax(axis=1)
        last = meeting.shape[1] - 1 - meeting[:, ::-1].argmax(axis=1)
        longest, steepest = np.linalg.norm(self.affine[:3, :3], axis=0).min(), 0.1 / np.linalg.norm(self.affine[:3, 0])
        for _ in range(steps):
            fractions, slopes = self._together.slopes(points)
            phi = fractions[rows, last] - fractions[rows, first]
            gradient = slopes[rows, last] - slopes[rows, first]
            step = (phi / np.maximum((gradient**2).sum(axis=1), steepest**2))[:, None] * gradient
            if not two.all():
                among = meeting[~two].astype(float)
                off = [
                    f[~two] - np.einsum("nk...,nk->n...", f[~two], among / among.sum(axis=1)[:, None])[:, None]
                    for f in (fractions, slopes)
                ]
                off[0] *= among
                off[1] *= among[..., None]
                u, d, v = np.linalg.svd(off[1], full_matrices=False)
                inverse = np.where(d > 2 * steepest, 1 / np.maximum(d, steepest), 0)
                step[~two] = np.einsum("nji,nj,nkj,nk->ni", v, inverse, u, off[0])
            length = np.linalg.norm(step, axis=1)
            points -= step * np.minimum(1, longest / np.maximum(length, 1e-12))[:, None]
        return points
