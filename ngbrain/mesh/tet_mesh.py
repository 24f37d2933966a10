"""A tetrahedral mesh with named regions and boundaries as plain arrays, which files keep bit by bit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from itertools import combinations

import netgen.meshing as meshing
import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.look import BriefText, NotebookCard

GRADING = 0.3
"""Growth of the tetrahedra away from the given triangles, Netgen's `grading`."""
FINER = 0.75
"""Factor on sizes passed to Netgen, whose edges come out longer than the size asked for."""


@dataclass(frozen=True, eq=False, repr=False)
class Surface(BriefText):
    """A named set of triangles between two regions.

    Parameters
    ----------
    name : str
        Name of the boundary.
    triangles : ndarray of int, shape (k, 3)
        Vertices, with the normal pointing out of the region `inside`.
    inside : int
        Number of the region on the inner side, from 0.
    outside : int, default -1
        Number of the region on the outer side; -1 for none.
    """

    name: str
    triangles: np.ndarray
    inside: int
    outside: int = -1


@dataclass(frozen=True, eq=False, repr=False)
class Elements(NotebookCard):
    """A tetrahedral mesh as plain arrays.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Vertices (m).
    tets : ndarray of int, shape (m, 4)
        Vertices of the tetrahedra in Netgen's orientation.
    region : ndarray of int, shape (m,)
        Number of each tetrahedron's region, from 0.
    triangles : ndarray of int, shape (k, 3)
        Vertices of the boundary and interface triangles.
    boundary : ndarray of int, shape (k,)
        Number of each triangle's boundary, from 0.
    regions : tuple of str
        Names of the regions.
    boundaries : tuple of str
        Names of the boundaries.
    """

    points: np.ndarray
    tets: np.ndarray
    region: np.ndarray
    triangles: np.ndarray
    boundary: np.ndarray
    regions: tuple[str, ...]
    boundaries: tuple[str, ...]

    PICTURE = "ngbrain.mesh.head_mesh:middle_slice"

    def summary(self) -> dict[str, str]:
        """Size, regions with their volumes, and boundaries in words."""
        ml = [1e6 * float(self.volumes()[self.region == i].sum()) for i in range(len(self.regions))]
        size = f"{len(self.tets)} tetrahedra, {len(self.points)} points"
        volumes = [f"{name} {volume:.3g} ml" for name, volume in zip(self.regions, ml, strict=True)]
        return {"size": size, "regions": ", ".join(volumes), "boundaries": ", ".join(self.boundaries)}

    def __repr__(self) -> str:
        names = ", ".join(self.regions)
        size = f"{len(self.tets)} tetrahedra, {len(self.points)} points"
        return f"Elements: {size}; {names if len(names) <= 100 else f'{len(self.regions)} regions'}"

    @classmethod
    def enclosed(
        cls,
        points: np.ndarray,
        surfaces: list[Surface],
        regions: tuple[str, ...],
        maxh: float,
        size: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> Elements:
        """Fill closed surfaces with tetrahedra and keep every triangle.

        Netgen runs on one thread, so that the same input gives the same mesh bit by bit.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            Vertices of the surfaces (m).
        surfaces : list of Surface
            Closed surfaces.
        regions : tuple of str
            Names of the regions that the surfaces number.
        maxh : float
            Largest element size (m).
        size : callable, optional
            Points (n, 3) → element size inside (n,) in m. Without it, elements grow away from the triangles up to `maxh`.

        Returns
        -------
        Elements
            The mesh; its volumes are all positive.

        Raises
        ------
        InputError
            Netgen finds no mesh.
        """
        mesh = meshing.Mesh()
        mesh.dim = 3
        mesh.AddPoints(np.ascontiguousarray(points))
        for i, surface in enumerate(surfaces):
            face = meshing.FaceDescriptor(surfnr=i + 1, domin=surface.inside + 1, domout=surface.outside + 1, bc=i + 1)
            index = mesh.Add(face)
            mesh.AddElements(2, index, np.ascontiguousarray(surface.triangles, np.int32), base=0)
        if size is not None:
            _restrict(mesh, points, size, maxh)
        try:
            mesh.GenerateVolumeMesh(mp=meshing.MeshingParameters(maxh=maxh, grading=GRADING, parallel_meshing=False))
        except Exception as error:  # Netgen raises exceptions of several types
            raise InputError("mesh sizes", f"such that Netgen gives up ({error})", "other element sizes") from error
        flat, solid = mesh.Elements2D().NumPy(), mesh.Elements3D().NumPy()
        if not len(solid):
            raise InputError("mesh sizes", "such that Netgen makes no tetrahedra", "other element sizes")
        made = cls(
            mesh.Coordinates().copy(),
            solid["nodes"][:, :4].astype(np.int32) - 1,
            solid["index"].astype(np.int32) - 1,
            flat["nodes"][:, :3].astype(np.int32) - 1,
            flat["index"].astype(np.int32) - 1,
            regions,
            tuple(surface.name for surface in surfaces),
        )
        if not (made.volumes() > 0).all():
            raise InputError("mesh sizes", "such that Netgen turns an element inside out", "other element sizes")
        return made

    def volumes(self) -> np.ndarray:
        """Volume of every tetrahedron (m³), shape (m,); negative for an inverted one."""
        x = self.points[self.tets]
        return np.asarray(-np.linalg.det(x[:, 1:] - x[:, :1]) / 6)

    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays for a file; `from_arrays` is the inverse."""
        return {f.name: np.asarray(getattr(self, f.name)) for f in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: dict[str, np.ndarray]) -> Elements:
        """Rebuild a mesh from the arrays that `arrays` returned."""
        named = {key: tuple(arrays[key].tolist()) for key in ("regions", "boundaries")}
        return cls(**(arrays | named))  # type: ignore[arg-type]

    def mesh(self) -> ngs.Mesh:
        """Convert to an NGSolve mesh."""
        mesh = meshing.Mesh()
        mesh.dim = 3
        mesh.AddPoints(self.points)
        for i, name in enumerate(self.regions):
            mesh.SetMaterial(i + 1, name)
            mesh.AddElements(3, i + 1, np.ascontiguousarray(self.tets[self.region == i]), base=0)
        for i, name in enumerate(self.boundaries):
            index = mesh.Add(meshing.FaceDescriptor(surfnr=i + 1, domin=1, domout=0, bc=i + 1))
            mesh.SetBCName(i, name)
            mesh.AddElements(2, index, np.ascontiguousarray(self.triangles[self.boundary == i]), base=0)
        return ngs.Mesh(mesh)


def _restrict(mesh: meshing.Mesh, points: np.ndarray, size: Callable[[np.ndarray], np.ndarray], maxh: float) -> None:
    """Pass the size field to Netgen on a grid as fine as its smallest value requires."""
    low, high = points.min(axis=0), points.max(axis=0)
    steps = np.ceil((high - low) / max(float(size(points).min()), maxh / 4)).astype(int) + 1
    grid = np.stack(np.meshgrid(*map(np.linspace, low, high, steps), indexing="ij"), axis=-1).reshape(-1, 3)
    h = size(grid)
    fine = h < maxh
    mesh.CalcLocalH(GRADING, 1)
    for point, wanted in zip(grid[fine].tolist(), h[fine].tolist(), strict=True):
        mesh.RestrictLocalH(meshing.Pnt(*point), FINER * wanted)


def centres(mesh: ngs.Mesh) -> np.ndarray:
    """Centres of a mesh's elements (m), shape (elements, 3)."""
    return np.array([np.mean([mesh[v].point for v in element.vertices], axis=0) for element in mesh.Elements()])


def smallest_angles(x: np.ndarray) -> np.ndarray:
    """Smallest dihedral angle (degrees) of every tetrahedron, for vertices (n, 4, 3)."""
    smallest = np.full(len(x), np.inf)
    for i, j in combinations(range(4), 2):
        k, m = sorted({0, 1, 2, 3} - {i, j})
        edge = x[:, j] - x[:, i]
        sides = [np.cross(edge, x[:, corner] - x[:, i]) for corner in (k, m)]
        cosine = np.einsum("ij,ij->i", *sides) / np.prod([np.linalg.norm(s, axis=1) for s in sides], axis=0)
        smallest = np.minimum(smallest, np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return smallest


def named_elements(points: np.ndarray, tets: np.ndarray, region: np.ndarray, regions: tuple[str, ...]) -> Elements:
    """Build a mesh from tetrahedra in regions and name its boundaries.

    Boundaries are `outer_REGION` on the outside and `REGION_REGION` between two regions. Unused points are removed.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Vertices (m).
    tets : ndarray of int, shape (m, 4)
        Tetrahedra in Netgen's orientation.
    region : ndarray of int, shape (m,)
        Region of each tetrahedron, from 0.
    regions : tuple of str
        Names of the regions.

    Returns
    -------
    Elements
        The mesh; triangles point out of the region named first.
    """
    used, tets = np.unique(tets, return_inverse=True)
    tets = tets.reshape(-1, 4).astype(np.int32)
    outwards = tets[:, [[1, 3, 2], [0, 2, 3], [0, 3, 1], [0, 1, 2]]].reshape(-1, 3)
    owner = np.repeat(region, 4)
    order = np.lexsort([owner, *np.sort(outwards, axis=1).T])  # of two equal triangles, that of the lower region first
    outwards, owner = outwards[order], owner[order]
    same = (np.sort(outwards[1:], axis=1) == np.sort(outwards[:-1], axis=1)).all(axis=1)
    first, twice = np.flatnonzero(np.r_[True, ~same]), np.r_[same, False]
    a, b = owner[first], np.where(twice[first], owner[np.minimum(first + 1, len(owner) - 1)], -1)
    first, a, b = (x[a != b] for x in (first, a, b))
    pairs, number = np.unique(np.stack([b, a], axis=1), axis=0, return_inverse=True)
    names = tuple(f"outer_{regions[j]}" if i < 0 else f"{regions[j]}_{regions[i]}" for i, j in pairs.tolist())
    triangles = outwards[first]
    return Elements(
        points[used], tets, region.astype(np.int32), triangles, number.reshape(-1).astype(np.int32), regions, names
    )
