"""Hexahedra over the points of wave data in space, as large as the waves allow, their faces along the coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
from scipy.spatial import KDTree

from ngbrain.forward.elements import Form
from ngbrain.inverse.direct import uniform_shear
from ngbrain.io.waves import WaveData
from ngbrain.mesh.grid import boxes

Array = np.ndarray
ACROSS = 9.0
"""Unknowns along a wave length of shear, of which errors are about 1 % with third order."""
FEWEST = 4
"""Elements along the longest side, at least."""
SHARE, SAMPLES = 0.3, 5
"""Hexahedra count when this share of them, by so many samples along each edge, is next to points of the mask: those at the
border reach out of the tissue, where waves go on as if it did."""
NEAR = 1.0
"""How far (voxels) a sample may be from a point that it is next to: more than half a voxel's diagonal."""
SAME, SPARSE = 0.01, 50.0
"""Points are of a grid if their coordinates, to so many of the nearest distance, cross at so many places for each, or fewer."""


@dataclass(frozen=True, eq=False)
class Lattice:
    """Hexahedra.

    planes  for each coordinate, growing (m)
    cells   (nx, ny, nz) bool, those between planes that count
    form    of the elements, as `Harmonic` takes it
    """

    planes: tuple[Array, Array, Array]
    cells: Array
    form: str

    @property
    def mesh(self) -> ngs.Mesh:
        """Of the cells that count."""
        return boxes(self.cells, *self.planes)

    @property
    def displacements(self) -> int:
        """About how many, as cells share their faces."""
        return int(3 * Form.named(self.form).order ** 3 * self.cells.sum())

    def part(self, low: Array, high: Array) -> Lattice:
        """Cells `low` to `high` (3,), the last ones left out, as they are in the whole."""
        chosen = [slice(a, b) for a, b in zip(low, high, strict=True)]
        x, y, z = (plane[a : b + 1] for plane, a, b in zip(self.planes, low, high, strict=True))
        return Lattice((x, y, z), self.cells[tuple(chosen)], self.form)


def lattice(data: WaveData, form: str, largest: float = np.inf) -> Lattice:
    """That of the points of the mask; larger cells where there were more than `largest` displacements.

    >>> line = np.arange(10) * 2e-3
    >>> grid = np.array([[x, y, z] for z in line for y in line for x in line])
    >>> data = WaveData(grid, 1e-6 * np.ones((1, 1000, 3)), [50.0], 1000.0, "isotropic", "elastic", poisson=0.49)
    >>> lattice(data, "P3").cells.shape
    (3, 3, 3)
    """
    points, order = data.points[data.mask], Form.named(form).order
    low, high = points.min(axis=0), points.max(axis=0)
    axes, spacing = voxels(data)
    fastest = float(data.frequency.max())
    wave = np.sqrt(uniform_shear(data) / data.density) / fastest if fastest else np.inf
    along = np.linalg.norm(axes * spacing[:, None], axis=0)  # of a voxel, along each coordinate
    size = np.maximum(order * along, min(order * wave / ACROSS, float(np.max(high - low)) / FEWEST))
    tree = KDTree(points @ axes.T / spacing)
    while True:
        x, y, z = (np.linspace(a, b, max(2, round((b - a) / h) + 1)) for a, b, h in zip(low, high, size, strict=True))
        shape = [len(plane) - 1 for plane in (x, y, z)]
        lines = [np.linspace(a, b, 2 * SAMPLES * n + 1)[1::2] for a, b, n in zip(low, high, shape, strict=True)]
        samples = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)
        covered = tree.query(samples @ axes.T / spacing, distance_upper_bound=NEAR)[0] < np.inf
        cells = covered.reshape([part for n in shape for part in (n, SAMPLES)]).mean(axis=(1, 3, 5)) >= SHARE
        found = Lattice((x, y, z), cells, form)
        over = found.displacements / largest
        if over <= 1:
            return found
        size = size * max(1.01, over ** (1 / 3))


def voxels(data: WaveData) -> tuple[Array, Array]:
    """Axes (a unit vector in each row) of the voxels that the points of the mask are, and the spacing along them (m).

    Points that were left of a grid along the coordinates have few values of each; others count as equally far apart.
    """
    if data.structured is not None:
        return data.structured.axes, data.structured.spacing
    points, nearest = data.points[data.mask], data.apart
    unit = SAME * nearest
    steps = [np.diff(np.unique(np.round((x - x.min()) / unit))) for x in points.T]
    if np.prod([len(step) + 1.0 for step in steps]) > SPARSE * len(points):
        return np.eye(data.dim), np.full(data.dim, nearest)
    return np.eye(data.dim), np.array([unit * float(np.median(step[step > 1])) for step in steps])
