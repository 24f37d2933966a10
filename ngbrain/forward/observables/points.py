"""Displacements at points, and all unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import InputError
from ngbrain.forward.common.interpolation import evaluation
from ngbrain.forward.observables.base import LinearObservable, Observable
from ngbrain.forward.solid.problem import Problem
from ngbrain.look import BriefText

Array = np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Displacements(BriefText, Observable):
    """Displacements (m) at points.

    Parameters
    ----------
    points : array (n, dim)
        Reference positions of the points (m).
    direction : sequence of float, optional
        Direction of the component, one number per point; None: all components of the first point, then of the next.

    Raises
    ------
    InputError
        When evaluated on a problem, for points outside of its mesh and a direction that is zero.
    """

    points: Sequence[Sequence[float]] | Array
    direction: Sequence[float] | None = None
    unit = "m"

    @property
    def name(self) -> str:
        """Name for reports."""
        n = len(self.points)
        return f"displacement at {n} point{'s' * (n != 1)}{along_axis(self.direction)}"

    def on(self, problem: Problem) -> LinearObservable:
        """By an interpolation matrix."""
        points, dim = np.asarray(self.points, float), problem.mesh.dim
        scalar = evaluation(ngs.H1(problem.mesh, order=problem.element.order), points)
        n = len(points)
        if scalar.shape[1] * dim != problem.u.space.ndof:
            raise InputError("element", str(problem.element), "components of the displacement in spaces of their own")
        if self.direction is None:
            matrix = sp.csr_array(
                sp.block_diag([scalar] * dim, format="csr")[np.arange(n * dim).reshape(dim, n).T.ravel()]
            )
        else:
            matrix = sp.csr_array(sp.hstack([part * scalar for part in axis(self.direction, dim)]))
        matrix.resize((matrix.shape[0], problem.fes.ndof))
        return LinearObservable(problem, matrix)


@dataclass(frozen=True)
class SolutionUnknowns(Observable):
    """All unknowns of a problem's space (n,), for models that continue from its state."""

    unit = "various"
    name = "all unknowns"

    def on(self, problem: Problem) -> LinearObservable:
        """The identity."""
        return LinearObservable(problem, sp.eye_array(problem.fes.ndof, format="csr"))


def axis(direction: Sequence[float], dim: int) -> Array:
    """Direction as an array, not normalised.

    Parameters
    ----------
    direction : sequence of float
    dim : int
        Dimension of the mesh.

    Returns
    -------
    array (dim,)

    Raises
    ------
    InputError
        For a zero vector or one of another dimension.
    """
    found = np.asarray(direction, float)
    if found.shape != (dim,) or not np.any(found):
        raise InputError("direction", list(direction), f"a vector of {dim} components that is not zero")
    return found


def along_axis(direction: Sequence[float] | None) -> str:
    """Description of a direction.

    >>> along_axis((0, 0, 1))
    ' along (0, 0, 1)'
    """
    return "" if direction is None else f" along ({', '.join(f'{c:g}' for c in direction)})"
