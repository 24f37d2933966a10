"""What is read off a body at the end of a time step, linear in its state x and in its tissue's nodal forces f: B x + Z f."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import InputError
from ngbrain.forward.common.interpolation import evaluation
from ngbrain.forward.common.regions import boundaries
from ngbrain.forward.solid.problem import Problem

Matrices = tuple[sp.csr_array, sp.csr_array]


class Reading(Protocol):
    """Some numbers of a state."""

    def on(self, body: Problem) -> Matrices:
        """B and Z, a row for each number and a column for each unknown of the body."""


@dataclass(frozen=True)
class Displacements:
    """Displacements (m) of points (n, 3) in m, given at rest: the three components of the first point, then of the next.

    Raises `InputError` for points outside of the mesh.
    """

    points: Sequence[Sequence[float]] | np.ndarray

    def on(self, body: Problem) -> Matrices:
        """B and Z."""
        scalar = evaluation(ngs.H1(body.mesh, order=body.element.order), np.asarray(self.points, float))
        n = scalar.shape[0]
        B = sp.block_diag([scalar] * 3, format="csr")[np.arange(3 * n).reshape(3, n).T.ravel()]
        B.resize((3 * n, body.fes.ndof))
        return sp.csr_array(B), sp.csr_array(B.shape)


@dataclass(frozen=True)
class Force:
    """Force (N) along a direction that acts on the tissue through a boundary: of a support, or of what presses there.

    It is the work of the tissue's nodal forces on the boundary's nodes for a unit of motion; of nodes that it shares with
    supports it counts what is its own (`Supports.shares`), and what loads put on the boundary's nodes counts, weights too. Raises
    `InputError` for a pattern that matches nothing.
    """

    boundary: str
    direction: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def on(self, body: Problem) -> Matrices:
        """B and Z."""
        if not np.any(self.direction):
            raise InputError("Force.direction", self.direction, "a vector that is not zero")
        boundaries(body.mesh, self.boundary)
        motion = ngs.GridFunction(body.fes)
        body.layout.fields(motion).u.Set(
            ngs.CF(tuple(self.direction)), definedon=body.mesh.Boundaries(self.boundary), dual=True
        )
        motion.vec.FV().NumPy()[body.is_u] *= body.reaction_shares(self.boundary)
        Z = sp.csr_array(motion.vec.FV().NumPy()[None, :])
        return sp.csr_array(Z.shape), Z
