"""Quadrilaterals or hexahedra over the points of wave data, faces along the coordinates; in space as large as the waves allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
from scipy.spatial import KDTree

from ngbrain.forward.common.elements import ElementPair
from ngbrain.inverse.data.direct_inversion import uniform_shear
from ngbrain.io.waves import WaveData
from ngbrain.mesh.geometry.structured import boxes, rectangles

Array = np.ndarray
ACROSS = 9.0
"""Unknowns along a wave length of shear, of which errors are about 1 % with third order."""
FEWEST = 4
"""Elements along the longest side, at least."""
SHARE, SAMPLES = 0.3, 5
"""Cells count when this share of them, by so many samples along each edge, is next to points of the mask: those at the
border reach out of the tissue, where waves go on as if it did."""
NEAR = 1.0
"""How far (voxels) a sample may be from a point that it is next to: more than half a voxel's diagonal."""
SAME, SPARSE = 0.01, 50.0
"""Points are of a grid if their coordinates, to so many of the nearest distance, cross at so many places for each, or fewer."""


@dataclass(frozen=True, eq=False)
class VoxelLattice:
    """Hexahedra, in the plane quadrilaterals.

    planes  for each coordinate, growing (m)
    cells   (nx, ny, nz) or (nx, ny) bool, those between planes that count
    form    of the elements, as `HarmonicProblem` takes it
    """

    planes: tuple[Array, ...]
    cells: Array
    form: str

    @property
    def mesh(self) -> ngs.Mesh:
        """Of the cells that count."""
        if len(self.planes) == 2:
            return rectangles(*self.planes, None if self.cells.all() else self.cells)
        return boxes(self.cells, *self.planes)

    @property
    def n_displacements(self) -> int:
        """About how many, as cells share their faces."""
        return int(3 * ElementPair.named(self.form).order ** 3 * self.cells.sum())

    def crop(self, low: Array, high: Array) -> VoxelLattice:
        """Cells `low` to `high` (3,), the last ones left out, as they are in the whole."""
        chosen = [slice(a, b) for a, b in zip(low, high, strict=True)]
        planes = tuple(plane[a : b + 1] for plane, a, b in zip(self.planes, low, high, strict=True))
        return VoxelLattice(planes, self.cells[tuple(chosen)], self.form)


def build_lattice(data: WaveData, form: str, largest: float = np.inf) -> VoxelLattice:
    """Hexahedra over the points of the mask; larger cells where there were more than `largest` displacements.

    >>> line = np.arange(10) * 2e-3
    >>> grid = np.array([[x, y, z] for z in line for y in line for x in line])
    >>> data = WaveData(grid, 1e-6 * np.ones((1, 1000, 3)), [50.0], 1000.0, "isotropic", "elastic", poisson=0.49)
    >>> build_lattice(data, "P3").cells.shape
    (3, 3, 3)
    """
    points, order = data.points[data.mask], ElementPair.named(form).order
    low, high = points.min(axis=0), points.max(axis=0)
    axes, spacing = voxel_axes(data)
    fastest = float(data.frequency.max())
    wave = np.sqrt(uniform_shear(data) / data.density) / fastest if fastest else np.inf
    along = np.linalg.norm(axes * spacing[:, None], axis=0)  # of a voxel, along each coordinate
    size = np.maximum(order * along, min(order * wave / ACROSS, float(np.max(high - low)) / FEWEST))
    while True:
        number = [max(1, round(length / h)) for length, h in zip(high - low, size, strict=True)]
        found = lattice_of_shape(data, number, form)
        over = found.n_displacements / largest
        if over <= 1:
            return found
        size = size * max(1.01, over ** (1 / 3))


def lattice_of_shape(data: WaveData, number: Sequence[int], form: str) -> VoxelLattice:
    """That of so many cells along each coordinate over the points of the mask."""
    points = data.points[data.mask]
    low, high = points.min(axis=0), points.max(axis=0)
    axes, spacing = voxel_axes(data)
    lines = [np.linspace(a, b, 2 * SAMPLES * n + 1)[1::2] for a, b, n in zip(low, high, number, strict=True)]
    samples = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)
    distance = KDTree(points @ axes.T / spacing).query(samples @ axes.T / spacing, distance_upper_bound=NEAR)[0]
    near = (distance < np.inf).reshape([part for n in number for part in (n, SAMPLES)])
    cells = near.mean(axis=tuple(range(1, 2 * len(number), 2))) >= SHARE
    return VoxelLattice(tuple(np.linspace(a, b, n + 1) for a, b, n in zip(low, high, number, strict=True)), cells, form)


def voxel_axes(data: WaveData) -> tuple[Array, Array]:
    """Axes (a unit vector in each row) of the voxels that the points of the mask are, and the spacing along them (m).

    Points that were left of a grid along the coordinates have few values of each; others count as equally far apart.
    """
    if data.grid is not None:
        return data.grid.axes, data.grid.spacing
    points, nearest = data.points[data.mask], data.point_spacing
    unit = SAME * nearest
    steps = [np.diff(np.unique(np.round((x - x.min()) / unit))) for x in points.T]
    if np.prod([len(step) + 1.0 for step in steps]) > SPARSE * len(points):
        return np.eye(data.dim), np.full(data.dim, nearest)
    return np.eye(data.dim), np.array([unit * float(np.median(step[step > 1])) for step in steps])
