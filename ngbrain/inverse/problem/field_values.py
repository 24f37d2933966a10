"""Fields fitted to values that are known at points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg

from ngbrain.adjoint.reduced import Regulariser
from ngbrain.forward.common.interpolation import evaluation
from ngbrain.inverse.problem.property_fields import PropertyField
from ngbrain.inverse.problem.wave_problem import ElastographyProblem

Array = np.ndarray
FAINT = 1e-3
"""Weight of a field's regulariser next to points of unit weight. It defines the field between and beyond the points."""


def field_observations(
    problem: ElastographyProblem, logarithms: Mapping[str, Array]
) -> Iterator[tuple[PropertyField, Array, sp.csr_array, Array]]:
    """Iterate over the fields of a problem with the points where their values are known.

    Parameters
    ----------
    problem : ElastographyProblem
        The problem, whose properties are made of fields.
    logarithms : mapping of str to numpy.ndarray
        Property → transformed values (n,) at the points of the data, NaN where there is none.

    Yields
    ------
    field : PropertyField
        A field.
    known : numpy.ndarray
        (n,) bool, the points of the data where it is known.
    observation : scipy.sparse.csr_array
        Matrix from the field's unknowns to its values at these points.
    values : numpy.ndarray
        The values there.
    """
    data, at = problem.data, evaluation(problem.space, problem.model.points)
    for quantity in problem.properties:
        values = logarithms[quantity.name]
        for field in problem.composition.fields(quantity.name):
            own = problem.inside & np.isfinite(values) & field.mask(data.labels)
            yield field, own, at[own[problem.inside]], values[own]


def fit_field(at: sp.csr_array, values: Array, inner: Regulariser, start: Array) -> Array:
    """Fit the unknowns of a field to values at points. The regulariser decides where there are none.

    Parameters
    ----------
    at : scipy.sparse.csr_array
        (n, unknowns) interpolation matrix to the points.
    values : numpy.ndarray
        (n,) values.
    inner : Regulariser
        Regulariser of the field, of weight `FAINT`.
    start : numpy.ndarray
        (unknowns,) where the regulariser is linearised.

    Returns
    -------
    numpy.ndarray
        (unknowns,)
    """
    R = FAINT * inner.matrix(start)
    right = at.T @ values + R @ start - FAINT * inner.gradient(start)
    return scipy.sparse.linalg.spsolve(sp.csc_array(at.T @ at + R), right)
