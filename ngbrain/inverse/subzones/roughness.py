"""The roughness ∫ |∇m|² of a map that is given at points, from a finite-element fit."""

from __future__ import annotations

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.forward.common.interpolation import evaluation, points_in_mesh
from ngbrain.inverse.objective.regularisation import smooth
from ngbrain.inverse.problem.field_values import fit_field
from ngbrain.inverse.problem.voxel_lattice import VoxelLattice

Array = np.ndarray
ORDER = 2
LEAST = 1e-9
"""Least roughness (m): a uniform map has none."""


class Roughness:
    """Roughness of maps at points in the cells of a lattice.

    Parameters
    ----------
    cells : VoxelLattice
        The cells.
    points : numpy.ndarray
        (n, 3) m.

    Examples
    --------
    >>> line = np.linspace(0, 0.02, 6)
    >>> points = np.array([[x, y, z] for z in line for y in line for x in line])
    >>> cells = VoxelLattice((line[::5],) * 3, np.ones((1, 1, 1), bool), "P3")
    >>> round(Roughness(cells, points).compute(100 * points[:, 0]), 6)  # slope² times volume
    0.08
    """

    def __init__(self, cells: VoxelLattice, points: Array) -> None:
        self._mesh = cells.mesh
        self._space = ngs.H1(self._mesh, order=ORDER)
        self._inside = points_in_mesh(self._mesh, points)
        self._at = evaluation(self._space, points[self._inside])

    def compute(self, values: Array, share: Array | None = None) -> float:
        """Return ∫ s |∇m|² (m).

        Parameters
        ----------
        values : numpy.ndarray
            (n,) m, NaN where there is none.
        share : numpy.ndarray, optional
            (n,) weight s of the surrounding space; by default 1.

        Returns
        -------
        float
            The roughness.
        """
        known = np.isfinite(values[self._inside])
        if not known.any():
            return LEAST
        at = self._at[known]
        slope = ngs.Grad(self._fit_field(at, values[self._inside][known]))
        counts = 1.0 if share is None else self._fit_field(at, share[self._inside][known])
        return LEAST + float(ngs.Integrate(counts * slope * slope, self._mesh))

    def _fit_field(self, at: sp.csr_array, values: Array) -> ngs.GridFunction:
        """Fit a field to these values; it is smooth where there is none."""
        found = ngs.GridFunction(self._space)
        found.Set(float(np.mean(values)))
        start = found.vec.FV().NumPy().copy()
        found.vec.FV().NumPy()[:] = fit_field(at, values, smooth(self._space, start), start)
        return found
