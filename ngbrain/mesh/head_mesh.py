"""The result of meshing a head: the mesh, the volumes of its regions and the comparison with the labels."""

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
    """A mesh that was written to a file, with its `result.json`.

    Parameters
    ----------
    elements : Elements
        The mesh with straight edges.
    """

    elements: Elements

    @classmethod
    def of(cls, data: dict[str, Any], elements: Elements) -> HeadMesh:
        """Make the result from its JSON; regions with a wrong volume become warnings.

        Parameters
        ----------
        data : dict of str to Any
            Content of `result.json`.
        elements : Elements
            The mesh.

        Returns
        -------
        HeadMesh
            Converged, with one warning for each region whose volume is off.
        """
        off = [
            f"the volume of {name} is off by {error:+.0%}" for name, error in data["checks"]["volume_errors"].items()
        ]
        return cls(data, elements, status=Status.CONVERGED, warnings=off)

    @property
    def value(self) -> dict[str, float]:
        """Region → volume (ml)."""
        return {name: region["volume_ml"] for name, region in self.data["regions"].items()}

    @property
    def headline(self) -> str:
        """Volumes of the regions (ml) as text."""
        return ", ".join(f"{name} {ml:.4g} ml" for name, ml in self.value.items())

    @property
    def statistics(self) -> dict[str, float]:
        """Number of tetrahedra and smallest dihedral angle (degrees)."""
        quality = self.data["quality"]
        return {"tetrahedra": quality["n_tets"], "degrees_at_least": round(quality["min_dihedral_deg"], 1)}

    @property
    def reasons(self) -> list[str]:
        """Reasons not to use the mesh: folded elements, and regions that differ too much from their labels."""
        changed = [
            f"{name} differs from the labels by {ml:.2g} ml" for name, ml in self.data["checks"]["changed_ml"].items()
        ]
        folded = ["an element is folded"] if self.data["quality"]["min_jacobian"] <= 0 else []
        return [*super().reasons, *folded, *changed]

    def plot(self) -> Any:
        """Plot the regions of the tetrahedra in an axial layer through the centre."""
        return middle_slice(self.elements)


def middle_slice(elements: Elements) -> Any:
    """Centres of the tetrahedra in an axial layer through the mesh's centre, coloured by region, as a matplotlib Figure."""
    centres = elements.points[elements.tets].mean(axis=1)
    size = np.cbrt(np.ptp(centres, axis=0).prod() / len(centres))
    near = np.abs(centres[:, 2] - centres[:, 2].mean()) < size / 2
    return places(centres[near, :2], [elements.regions[i] for i in elements.region[near]])
