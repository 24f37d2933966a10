"""Zones in which the regions' volumes are matched: the whole mesh, or its refined part and the rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ngbrain.image.read.label_map import LabelMap
from ngbrain.look import BriefText
from ngbrain.mesh.geometry.sizing import SizeField

GRADED = 2.0
"""Ratio of the largest to the smallest element size from which the refined part is a zone of its own."""
Fine = Callable[[np.ndarray, float, float], np.ndarray]
"""(sizes (n,), smallest, largest size) → membership of the refined part (n,), from 0 to 1."""


@dataclass(frozen=True, eq=False, repr=False)
class Zones(BriefText):
    """A partition of space into zones, and the target volumes of the regions in each.

    Parameters
    ----------
    weights : callable
        Points (n, 3) in m → weights (n, zones), which add up to 1.
    target_volumes : ndarray, shape (zones, regions)
        Target volumes (m³), those of the labels.
    """

    weights: Callable[[np.ndarray], np.ndarray]
    target_volumes: np.ndarray

    @classmethod
    def whole(cls, labels: LabelMap) -> Zones:
        """One zone with the total volumes of the labels."""
        return cls(everywhere, 1e-6 * np.array([list(labels.volumes_ml().values())]))

    @classmethod
    def of(cls, labels: LabelMap, size: SizeField, fine: Fine) -> Zones:
        """Zones of labels for a size field: the refined part, if sizes differ by `GRADED`, and the rest.

        Parameters
        ----------
        labels : LabelMap
            The labels.
        size : SizeField
            Element size (m).
        fine : callable
            Membership of the refined part, see `Fine`.

        Returns
        -------
        Zones
            One or two zones.

        Examples
        --------
        >>> from ngbrain.image.read.volume import Volume
        >>> row = LabelMap(Volume(np.array([[[1, 1, 2, 2]]]), np.diag([1e-3, 1e-3, 1e-3, 1])), {1: "grey", 2: "white"})
        >>> zones = Zones.of(row, lambda x: 1e-3 + x[:, 2], lambda h, smallest, largest: h < 2.5e-3)
        >>> (1e9 * zones.target_volumes).round().tolist(), zones.weights(np.array([[0, 0, 2e-3]])).tolist()
        ([[2.0, 0.0], [0.0, 2.0]], [[0.0, 1.0]])
        """
        numbers = replace(labels, cut=None).region_numbers()
        at = np.argwhere(numbers > 0)
        h, number = size(labels.volume.to_world(at)), numbers[tuple(at.T)]
        smallest, largest = float(h.min()), float(h.max())
        if largest < GRADED * smallest:
            return cls.whole(labels)

        def share(points: np.ndarray) -> np.ndarray:
            inside = np.asarray(fine(size(points), smallest, largest), float)
            return np.stack([inside, 1 - inside], axis=1)

        left = 1.0 if labels.cut is None else 1 - labels.cut[tuple(at.T)].astype(float)
        mine = left * np.asarray(fine(h, smallest, largest), float)
        (total,) = cls.whole(labels).target_volumes
        near = labels.volume.voxel_volume * np.bincount(number, mine, len(total) + 1)[1:]
        return cls(share, np.stack([near, total - near]))

    def relax_targets(self, there: np.ndarray, part: float, film: float) -> Zones:
        """Reduce the targets of regions that lack volume, and raise those of regions with an excess.

        A region of which less than the fraction `film` is present keeps its target. The last zone balances the others.

        Parameters
        ----------
        there : ndarray, shape (zones, regions)
            Present volumes (m³).
        part : float
            Part of the missing volume that is given up.
        film : float
            Fraction of the target below which a region counts as a thin film.

        Returns
        -------
        Zones
            Zones with the new targets.

        Examples
        --------
        >>> zones = Zones(everywhere, np.array([[4.0, 4.0], [6.0, 1.0]]))
        >>> zones.relax_targets(np.array([[3.0, 5.0], [5.0, 2.0]]), 0.5, 0.7).target_volumes.tolist()
        [[3.5, 4.5], [6.5, 0.5]]
        """
        lacks = np.where(there < film * self.target_volumes, 0, np.maximum(self.target_volumes - there, 0))
        spare = np.maximum(there - self.target_volumes, 0)
        given = lacks.sum(axis=1, keepdims=True) * spare / np.maximum(spare.sum(axis=1, keepdims=True), 1e-30)
        change = part * np.where(spare.any(axis=1, keepdims=True), given - lacks, 0)
        change[-1] = -change[:-1].sum(axis=0)
        return replace(self, target_volumes=self.target_volumes + change)


def everywhere(points: np.ndarray) -> np.ndarray:
    """Weight 1 (n, 1) of a single zone."""
    return np.ones((len(points), 1))
