"""Quadrilaterals or hexahedra over the points of wave data, with faces along the coordinates; in space as large as the wavelength
allows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
from scipy.spatial import KDTree

from ngbrain.forward.common.elements import ElementPair
from ngbrain.inverse.data.direct_inversion import uniform_shear
from ngbrain.io.waves import WaveData
from ngbrain.look import BriefText
from ngbrain.mesh.geometry.structured import boxes, rectangles

Array = np.ndarray
ACROSS = 9.0
"""Unknowns along a shear wavelength. With third order, errors are about 1 %."""
FEWEST = 4
"""Fewest elements along the longest side."""
SHARE, SAMPLES = 0.3, 5
"""A cell is used when this share of it is near points of the mask, by so many samples along each edge. Border cells reach out of
the tissue, where the waves are continued."""
NEAR = 1.0
"""Distance (voxels) up to which a sample is near a point: more than half a voxel's diagonal."""
SAME, SPARSE = 0.01, 50.0
"""Points form a grid if their coordinates, rounded to this share of the smallest spacing, cross at so many places for each point,
or fewer."""


@dataclass(frozen=True, eq=False, repr=False)
class VoxelLattice(BriefText):
    """Hexahedra along the coordinates; in the plane quadrilaterals.

    Parameters
    ----------
    planes : tuple of numpy.ndarray
        Increasing coordinates (m) of the cell faces along each axis.
    cells : numpy.ndarray
        (nx, ny, nz) or (nx, ny) bool, the used cells between the planes.
    form : str
        Element pair, as `HarmonicProblem` takes it.
    """

    planes: tuple[Array, ...]
    cells: Array
    form: str

    @property
    def mesh(self) -> ngs.Mesh:
        """Mesh of the used cells."""
        if len(self.planes) == 2:
            return rectangles(*self.planes, None if self.cells.all() else self.cells)
        return boxes(self.cells, *self.planes)

    @property
    def n_displacements(self) -> int:
        """Approximate number of displacement unknowns; cells share their faces."""
        return int(3 * ElementPair.named(self.form).order ** 3 * self.cells.sum())

    def crop(self, low: Array, high: Array) -> VoxelLattice:
        """Return a block of cells.

        Parameters
        ----------
        low, high : numpy.ndarray
            (dim,) first cell, and the cell after the last, along each axis.

        Returns
        -------
        VoxelLattice
            The block, with the same cells as in the whole.
        """
        chosen = [slice(a, b) for a, b in zip(low, high, strict=True)]
        planes = tuple(plane[a : b + 1] for plane, a, b in zip(self.planes, low, high, strict=True))
        return VoxelLattice(planes, self.cells[tuple(chosen)], self.form)


def build_lattice(data: WaveData, form: str, largest: float = np.inf) -> VoxelLattice:
    """Build a lattice over the points of the mask.

    Parameters
    ----------
    data : WaveData
        Wavelength and mask determine the cells.
    form : str
        Element pair.
    largest : float
        Most displacement unknowns; cells are enlarged where there would be more.

    Returns
    -------
    VoxelLattice
        The lattice.

    Examples
    --------
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
    """Build a lattice of a given number of cells over the points of the mask.

    Parameters
    ----------
    data : WaveData
        The data.
    number : sequence of int
        Cells along each axis.
    form : str
        Element pair.

    Returns
    -------
    VoxelLattice
        The lattice.
    """
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
    """Return the voxel axes (unit vectors in rows) and spacings (m) of the points of the mask.

    Points that remain of a grid along the coordinates have few values of each coordinate. Other scattered points count as
    equally spaced.
    """
    if data.grid is not None:
        return data.grid.axes, data.grid.spacing
    points, nearest = data.points[data.mask], data.point_spacing
    unit = SAME * nearest
    steps = [np.diff(np.unique(np.round((x - x.min()) / unit))) for x in points.T]
    if np.prod([len(step) + 1.0 for step in steps]) > SPARSE * len(points):
        return np.eye(data.dim), np.full(data.dim, nearest)
    return np.eye(data.dim), np.array([unit * float(np.median(step[step > 1])) for step in steps])
