"""A map of labels: which region of the head each voxel belongs to, and what the regions are called."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.volume import Volume


@dataclass(frozen=True, eq=False)
class LabelMap:
    """Regions on voxels.

    volume  integers; 0 is outside
    names   number → name of the region; every number but 0 in `volume` has one, and two numbers may share a name

    >>> two = LabelMap(Volume(np.array([[[0, 1, 1, 7]]]), np.diag([1e-3, 1e-3, 1e-3, 1])), {1: "grey", 7: "white"})
    >>> two.regions, two.volumes_ml()
    (('grey', 'white'), {'grey': 0.002, 'white': 0.001})
    """

    volume: Volume
    names: Mapping[int, str]

    def __post_init__(self) -> None:
        if self.volume.data.dtype.kind not in "iu":
            raise InputError("labels", f"made of {self.volume.data.dtype} numbers", "integers")
        unnamed = sorted(set(np.unique(self.volume.data).tolist()) - {0} - set(self.names))
        if unnamed:
            raise InputError("labels", f"without a name for {unnamed[:5]}", "a name for every number but 0")

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions that there are, in the order of their numbers."""
        present = set(np.unique(self.volume.data).tolist())
        return tuple(dict.fromkeys(name for number, name in sorted(self.names.items()) if number in present))

    def numbered(self) -> np.ndarray:
        """The voxels with regions numbered from 1 in the order of `regions`, uint8; 0 is outside."""
        table = np.zeros(int(self.volume.data.max()) + 1, np.uint8)
        for number, name in self.names.items():
            if number < len(table) and name in self.regions:
                table[number] = self.regions.index(name) + 1
        table[0] = 0
        return table[self.volume.data]

    def volumes_ml(self) -> dict[str, float]:
        """Millilitres of each region."""
        counts = np.bincount(self.numbered().ravel(), minlength=len(self.regions) + 1)[1:]
        return dict(zip(self.regions, (counts * self.volume.voxel_volume * 1e6).tolist(), strict=True))
