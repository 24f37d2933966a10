"""Quality of tetrahedral meshes: element shapes, and agreement with the labels that the mesh was made from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ngbrain.image.read.label_map import LabelMap
from ngbrain.look import BriefText
from ngbrain.mesh.labels.indicators import Indicators
from ngbrain.mesh.tet_mesh import Elements, smallest_angles

FLAT = 0.1
"""Radius ratio below which a tetrahedron is a sliver."""


@dataclass(frozen=True, repr=False)
class Quality(BriefText):
    """Element shapes of a mesh.

    Parameters
    ----------
    n_tets : int
        Number of tetrahedra.
    dihedrals : ndarray, shape (n_tets,)
        Smallest dihedral angle of each (degrees).
    ratios : ndarray, shape (n_tets,)
        Radius ratio 3 r_in/r_circ of each.
    """

    n_tets: int
    dihedrals: np.ndarray
    ratios: np.ndarray

    @classmethod
    def of(cls, elements: Elements) -> Quality:
        """Measure a mesh with straight edges."""
        corners = elements.points[elements.tets]
        return cls(len(corners), smallest_angles(corners), radius_ratios(corners))

    def summary(self) -> dict[str, float]:
        """Summary for `result.json`."""
        return {
            "n_tets": self.n_tets,
            "min_dihedral_deg": float(self.dihedrals.min()),
            "fraction_radius_ratio_below_0_1": float((self.ratios < FLAT).mean()),
        }


def radius_ratios(x: np.ndarray) -> np.ndarray:
    """Radius ratio 3 r_in/r_circ of every tetrahedron (n, 4, 3): 1 if regular, 0 if flat."""
    a, b, c = (x[:, i] - x[:, 0] for i in (1, 2, 3))
    volume = np.abs(np.einsum("ij,ij->i", a, np.cross(b, c))) / 6
    faces = sum(
        np.linalg.norm(np.cross(x[:, j] - x[:, i], x[:, k] - x[:, i]), axis=1) / 2
        for i, j, k in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))
    )
    sides = np.stack(
        [np.linalg.norm(p, axis=1) * np.linalg.norm(q, axis=1) for p, q in ((a, b - c), (b, c - a), (c, a - b))]
    )
    s = sides.sum(axis=0) / 2
    around = np.sqrt(np.maximum(s * np.prod(s - sides, axis=0), 0)) / (6 * np.maximum(volume, 1e-300))
    return 3 * (3 * volume / faces) / np.maximum(around, 1e-300)


def volumes_ml(elements: Elements) -> dict[str, float]:
    """Volume of each region (ml) of a mesh with straight edges."""
    found = np.bincount(elements.region, np.abs(elements.volumes()), len(elements.regions)) * 1e6
    return dict(zip(elements.regions, found.tolist(), strict=True))


def interfaces(elements: Elements) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (k, 3) on the surface or between two regions, and the numbers of both regions (k, 2) from 1; 0 is outside."""
    faces = np.sort(elements.tets[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    owner = np.repeat(elements.region + 1, 4)
    order = np.lexsort(faces.T)
    faces, owner = faces[order], owner[order]
    same = (faces[1:] == faces[:-1]).all(axis=1)
    first = np.flatnonzero(np.r_[True, ~same])
    twice = np.r_[same, False][first]
    pairs = np.stack([owner[first], np.where(twice, owner[np.minimum(first + 1, len(owner) - 1)], 0)], axis=1)
    differ = pairs[:, 0] != pairs[:, 1]
    return faces[first][differ], np.sort(pairs[differ], axis=1)


def deviations(
    elements: Elements, indicators: Indicators, where: Callable[[np.ndarray], np.ndarray] | None = None
) -> dict[tuple[int, int], np.ndarray]:
    """Distance of a mesh's interfaces from the interfaces of the labels' smoothed indicators.

    It is measured at the vertices and centres of the triangles.

    Parameters
    ----------
    elements : Elements
        The mesh.
    indicators : Indicators
        Smoothed indicators of the labels.
    where : callable, optional
        Points (n, 3) → mask (n,); it restricts the points that are measured.

    Returns
    -------
    dict of tuple of int to ndarray
        Pair of region numbers (from 1; 0 is outside) → distances (m).
    """
    triangles, pairs = interfaces(elements)
    found = {}
    for a, b in np.unique(pairs, axis=0).tolist():
        mine = triangles[(pairs == (a, b)).all(axis=1)]
        points = np.concatenate([elements.points[np.unique(mine)], elements.points[mine].mean(axis=1)])
        if where is not None:
            points = points[where(points)]
        if len(points):
            numbers = [0 if k == 0 else indicators.regions.index(elements.regions[k - 1]) + 1 for k in (a, b)]
            found[a, b] = indicators.distance(points, *numbers)
    return found


def volume_errors(elements: Elements, labels: LabelMap) -> dict[str, float]:
    """Relative error of each region's volume against its voxels.

    Parameters
    ----------
    elements : Elements
        The mesh.
    labels : LabelMap
        The labels it was made from.

    Returns
    -------
    dict of str to float
        Region → V_mesh/V_labels - 1.
    """
    meshed, wanted = volumes_ml(elements), labels.volumes_ml()
    return {name: meshed.get(name, 0.0) / ml - 1 for name, ml in wanted.items()}
