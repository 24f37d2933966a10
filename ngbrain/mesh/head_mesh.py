"""What comes of meshing a head: the mesh, its regions' volumes, and whether it shows the labels that it was made from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ngbrain.look import places
from ngbrain.mesh.tet_mesh import Elements
from ngbrain.result import Status
from ngbrain.result_file import FileResult


@dataclass(repr=False, eq=False)
class HeadMesh(FileResult):
    """A mesh that was written, with its `result.json`.

    Parameters
    ----------
    elements
        With straight edges.
    """

    elements: Elements

    @classmethod
    def of(cls, data: dict[str, Any], elements: Elements) -> HeadMesh:
        """With regions that are off in volume as warnings."""
        off = [f"{name} is off by {error:+.0%} in volume" for name, error in data["checks"]["regions_off"].items()]
        return cls(data, elements, status=Status.CONVERGED, warnings=off)

    @property
    def value(self) -> dict[str, float]:
        """Region → ml."""
        return {name: region["volume_ml"] for name, region in self.data["regions"].items()}

    @property
    def headline(self) -> str:
        """Volumes, in ml."""
        return ", ".join(f"{name} {ml:.4g} ml" for name, ml in self.value.items())

    @property
    def statistics(self) -> dict[str, float]:
        """How many elements there are, and how flat the worst one is."""
        quality = self.data["quality"]
        return {"tetrahedra": quality["n_tets"], "degrees_at_least": round(quality["min_dihedral_deg"], 1)}

    @property
    def reasons(self) -> list[str]:
        """Elements that are folded, and regions that were changed too much to be those of the labels."""
        changed = [
            f"{name} is not as in the labels by {ml:.2g} ml" for name, ml in self.data["checks"]["changed_ml"].items()
        ]
        folded = ["an element is folded"] if self.data["quality"]["min_jacobian"] <= 0 else []
        return [*super().reasons, *folded, *changed]

    def plot(self) -> Any:
        """Regions of the tetrahedra about the middle, seen from above."""
        return middle_slice(self.elements)


def middle_slice(elements: Elements) -> Any:
    """Middles of tetrahedra in a layer about the mesh's own, by region, as a matplotlib Figure."""
    centres = elements.points[elements.tets].mean(axis=1)
    size = np.cbrt(np.ptp(centres, axis=0).prod() / len(centres))
    near = np.abs(centres[:, 2] - centres[:, 2].mean()) < size / 2
    return places(centres[near, :2], [elements.regions[i] for i in elements.region[near]])
