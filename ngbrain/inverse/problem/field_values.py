"""Nodal values of unknown fields from values at points, and where these are known."""

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
"""Of a field's regulariser, next to points of unit weight: says what a field is between and beyond them."""


def field_observations(
    problem: ElastographyProblem, logarithms: Mapping[str, Array]
) -> Iterator[tuple[PropertyField, Array, sp.csr_array, Array]]:
    """For each field: which it is, which points of the data it is known at, the matrix to its values there, and these."""
    data, at = problem.data, evaluation(problem.space, problem.model.points)
    for quantity in problem.properties:
        values = logarithms[quantity.name]
        for field in problem.composition.fields(quantity.name):
            own = problem.inside & np.isfinite(values) & field.mask(data.labels)
            yield field, own, at[own[problem.inside]], values[own]


def fit_field(at: sp.csr_array, values: Array, inner: Regulariser, start: Array) -> Array:
    """Unknowns of a field with these values at points, smooth where there is none."""
    R = FAINT * inner.matrix(start)
    right = at.T @ values + R @ start - FAINT * inner.gradient(start)
    return scipy.sparse.linalg.spsolve(sp.csc_array(at.T @ at + R), right)
