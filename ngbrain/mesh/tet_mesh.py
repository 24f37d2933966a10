"""A tetrahedral mesh with named regions and boundaries as plain arrays: what is kept on disk, exactly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from itertools import combinations

import netgen.meshing as meshing
import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError

GRADING = 0.3
"""Growth of the tetrahedra away from the given triangles."""
FINER = 0.75
"""Netgen's tetrahedra have edges longer than the size that it is told by this."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles (k, 3) under a name, outwards of the region numbered `inside`; `outside` is -1 for nothing."""

    name: str
    triangles: np.ndarray
    inside: int
    outside: int = -1


@dataclass(frozen=True, eq=False)
class Elements:
    """points (n, 3) m; tets (m, 4) in Netgen's orientation and region (m,); triangles (k, 3) and boundary (k,).

    `regions` and `boundaries` are the names that `region` and `boundary` number.
    """

    points: np.ndarray
    tets: np.ndarray
    region: np.ndarray
    triangles: np.ndarray
    boundary: np.ndarray
    regions: tuple[str, ...]
    boundaries: tuple[str, ...]

    @classmethod
    def enclosed(
        cls,
        points: np.ndarray,
        surfaces: list[Surface],
        regions: tuple[str, ...],
        maxh: float,
        size: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> Elements:
        """Fill closed surfaces with tetrahedra, which keep every triangle; one thread, so the same bits every time.

        size   points (n, 3) → element size (n,) inside; without it, elements grow away from the triangles up to `maxh`

        Raises `InputError` where Netgen finds no mesh.
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
        except Exception as error:  # Netgen raises its own exceptions and bare ones
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
        """Volume (m³) of every tetrahedron; negative where one is inside out."""
        x = self.points[self.tets]
        return np.asarray(-np.linalg.det(x[:, 1:] - x[:, :1]) / 6)

    def arrays(self) -> dict[str, np.ndarray]:
        """For a file; `from_arrays` gives the same back."""
        return {f.name: np.asarray(getattr(self, f.name)) for f in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: dict[str, np.ndarray]) -> Elements:
        """From what `arrays` gave."""
        named = {key: tuple(arrays[key].tolist()) for key in ("regions", "boundaries")}
        return cls(**(arrays | named))  # type: ignore[arg-type]

    def mesh(self) -> ngs.Mesh:
        """As an NGSolve mesh."""
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
    """Tell Netgen the sizes that are wanted inside, on a grid as fine as the smallest of them asks for."""
    low, high = points.min(axis=0), points.max(axis=0)
    steps = np.ceil((high - low) / max(float(size(points).min()), maxh / 4)).astype(int) + 1
    grid = np.stack(np.meshgrid(*map(np.linspace, low, high, steps), indexing="ij"), axis=-1).reshape(-1, 3)
    h = size(grid)
    fine = h < maxh
    mesh.CalcLocalH(GRADING, 1)
    for point, wanted in zip(grid[fine].tolist(), h[fine].tolist(), strict=True):
        mesh.RestrictLocalH(meshing.Pnt(*point), FINER * wanted)


def centres(mesh: ngs.Mesh) -> np.ndarray:
    """Centres (m) of the elements of a mesh (element, 3)."""
    return np.array([np.mean([mesh[v].point for v in element.vertices], axis=0) for element in mesh.Elements()])


def smallest_angles(x: np.ndarray) -> np.ndarray:
    """Smallest angle (degrees) between two faces of every tetrahedron (n, 4, 3)."""
    smallest = np.full(len(x), np.inf)
    for i, j in combinations(range(4), 2):
        k, m = sorted({0, 1, 2, 3} - {i, j})
        edge = x[:, j] - x[:, i]
        sides = [np.cross(edge, x[:, corner] - x[:, i]) for corner in (k, m)]
        cosine = np.einsum("ij,ij->i", *sides) / np.prod([np.linalg.norm(s, axis=1) for s in sides], axis=0)
        smallest = np.minimum(smallest, np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return smallest


def named_elements(points: np.ndarray, tets: np.ndarray, region: np.ndarray, regions: tuple[str, ...]) -> Elements:
    """Tetrahedra (m, 4) in regions (m,) from 0, boundaries and interfaces named `outer_REGION` and `REGION_REGION`.

    Points that no tetrahedron uses are left out.
    """
    used, tets = np.unique(tets, return_inverse=True)
    tets = tets.reshape(-1, 4).astype(np.int32)
    outwards = tets[:, [[1, 3, 2], [0, 2, 3], [0, 3, 1], [0, 1, 2]]].reshape(-1, 3)
    owner = np.repeat(region, 4)
    order = np.lexsort([owner, *np.sort(outwards, axis=1).T])  # of two, that of the lower region first
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
