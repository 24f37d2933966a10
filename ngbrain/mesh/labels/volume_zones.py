"""Where regions are to have their volumes each for itself: all of a mesh, or its fine part and the rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ngbrain.image.read.label_map import LabelMap
from ngbrain.mesh.geometry.sizing import SizeField

GRADED = 2.0
"""Sizes that differ by that factor make a mesh graded, with a fine part of its own."""
Fine = Callable[[np.ndarray, float, float], np.ndarray]
"""Sizes (n,), the smallest and the largest of all → how far each is of the fine part (n,), from 0 to 1."""


@dataclass(frozen=True, eq=False)
class Zones:
    """Shares of space, and what regions have there.

    share    points (n, 3) m → (n, zones), adding up to 1
    wanted   (zones, regions) m³, of the labels
    """

    share: Callable[[np.ndarray], np.ndarray]
    wanted: np.ndarray

    @classmethod
    def whole(cls, labels: LabelMap) -> Zones:
        """All of labels in one zone."""
        return cls(everywhere, 1e-6 * np.array([list(labels.volumes_ml().values())]))

    @classmethod
    def of(cls, labels: LabelMap, size: SizeField, fine: Fine) -> Zones:
        """Of labels that are meshed to a size, with a fine part where that is `GRADED`.

        >>> from ngbrain.image.read.volume import Volume
        >>> row = LabelMap(Volume(np.array([[[1, 1, 2, 2]]]), np.diag([1e-3, 1e-3, 1e-3, 1])), {1: "grey", 2: "white"})
        >>> zones = Zones.of(row, lambda x: 1e-3 + x[:, 2], lambda h, smallest, largest: h < 2.5e-3)
        >>> (1e9 * zones.wanted).round().tolist(), zones.share(np.array([[0, 0, 2e-3]])).tolist()
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
        (total,) = cls.whole(labels).wanted
        near = labels.volume.voxel_volume * np.bincount(number, mine, len(total) + 1)[1:]
        return cls(share, np.stack([near, total - near]))

    def relax_targets(self, there: np.ndarray, part: float, film: float) -> Zones:
        """Wanting a part less of what regions lack that have `there` (zones, regions) m³; those that have too much get it.

        A region of which less than the share `film` is there wants all of it. The last zone makes up for the others.

        >>> zones = Zones(everywhere, np.array([[4.0, 4.0], [6.0, 1.0]]))
        >>> zones.relax_targets(np.array([[3.0, 5.0], [5.0, 2.0]]), 0.5, 0.7).wanted.tolist()
        [[3.5, 4.5], [6.5, 0.5]]
        """
        lacks = np.where(there < film * self.wanted, 0, np.maximum(self.wanted - there, 0))
        spare = np.maximum(there - self.wanted, 0)
        given = lacks.sum(axis=1, keepdims=True) * spare / np.maximum(spare.sum(axis=1, keepdims=True), 1e-30)
        change = part * np.where(spare.any(axis=1, keepdims=True), given - lacks, 0)
        change[-1] = -change[:-1].sum(axis=0)
        return replace(self, wanted=self.wanted + change)


def everywhere(points: np.ndarray) -> np.ndarray:
    """The share of the only zone, (n, 1)."""
    return np.ones((len(points), 1))
