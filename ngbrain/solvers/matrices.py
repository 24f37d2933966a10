"""Conversion of sparse matrices between NGSolve and SciPy."""

from __future__ import annotations

import ngsolve as ngs
import numpy as np
import pyngcore
import scipy.sparse as sp

Array = np.ndarray


def to_scipy(matrix: ngs.BaseMatrix) -> sp.csr_array:
    """Copy of an NGSolve matrix as a SciPy matrix."""
    values, columns, rows = (np.array(part) for part in matrix.CSR())
    return sp.csr_array((values, columns, rows), shape=(matrix.height, matrix.width))


def rows(matrix: ngs.BaseMatrix, where: Array) -> sp.csr_array:
    """Copy of some rows of an NGSolve matrix.

    Parameters
    ----------
    matrix : BaseMatrix
        Sparse matrix of NGSolve.
    where : array of int (k,)
        Row indices.

    Returns
    -------
    csr_array (k, width)
    """
    values, columns, begins = (np.asarray(part) for part in matrix.CSR())
    begins = begins.astype(np.int64)
    lengths = np.diff(begins)[where]
    ends = np.cumsum(lengths)
    places = np.repeat(begins[where] - ends + lengths, lengths) + np.arange(lengths.sum())
    return sp.csr_array((values[places], columns[places], np.append(0, ends)), shape=(len(where), matrix.width))


def to_ngsolve(matrix: sp.sparray) -> ngs.BaseMatrix:
    """Copy of a real SciPy matrix as an NGSolve matrix.

    NGSolve's own arrays are used: from NumPy arrays it would take fifteen times as long.

    >>> to_ngsolve(sp.csr_array(np.diag([2.0, 4.0]))).ToDense()[1, 1]
    4.0
    """
    entries = sp.coo_array(matrix)
    rows, columns = (_copied(each, pyngcore.Array_I_S) for each in entries.coords)
    return ngs.la.SparseMatrixd.CreateFromCOO(rows, columns, _copied(entries.data, pyngcore.Array_D_S), *entries.shape)


def _copied(values: Array, kind: type) -> object:
    made = kind(len(values))
    made.NumPy()[:] = values
    return made
