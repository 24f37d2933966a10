"""What is seen of a body in equilibrium: displacements at points, forces on boundaries, any integral of the state.

An observation is told of a body by `on`, and then gives values, and w · values as a functional that can be differentiated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import InputError
from ngbrain.forward.common.interpolation import evaluation
from ngbrain.forward.common.loads import Vector
from ngbrain.forward.common.regions import boundaries
from ngbrain.forward.sensitivity.virtual_work import Integrand, Motion, Terms, Work
from ngbrain.forward.solid.problem import Problem

Array = np.ndarray


class Seeing(Protocol):
    """An observation of one body."""

    size: int
    matrix: sp.csr_array | None
    """Values as B u (size, ndof); None where they are integrals."""

    def values(self) -> Array:
        """Of the body's state (size,)."""

    def weigh(self, w: Array) -> None:
        """Set the weights of `functional`."""

    def functional(self, state: Motion, *along: Motion) -> Terms:
        """w · values at a state, and for each motion its derivative along it; empty where there is a matrix."""


class Observation(Protocol):
    """What can be seen of any body."""

    def on(self, body: Problem) -> Seeing:
        """Of this one."""


@dataclass(frozen=True, eq=False)
class Displacements:
    """Displacements (m) at points (n, 2 or 3) m at rest: values (n · dim,), all components of the first point first.

    Raises `InputError` (when told of a body) for points outside of the mesh.
    """

    points: Array

    def on(self, body: Problem) -> Seeing:
        """A matrix."""
        scalar = evaluation(ngs.H1(body.mesh, order=body.element.order), np.asarray(self.points, float))
        n, dim = len(self.points), body.mesh.dim
        if scalar.shape[1] * dim != body.u.space.ndof:
            raise InputError("element", str(body.element), "components of the displacement in spaces of their own")
        by_point = np.arange(n * dim).reshape(dim, n).T.ravel()
        matrix = sp.csr_array(sp.block_diag([scalar] * dim, format="csr")[by_point])
        matrix.resize((n * dim, body.fes.ndof))
        return _Linear(body, matrix)


@dataclass(frozen=True)
class Unknowns:
    """All unknowns of the body (ndof,), for models that go on from its equilibrium."""

    def on(self, body: Problem) -> Seeing:
        """The identity."""
        return _Linear(body, sp.eye_array(body.fes.ndof, format="csr"))


@dataclass(frozen=True)
class Force:
    """Force (N) that acts on a boundary from outside, what its supports and loads exert together: all components.

    motions  instead of all components: motions of the boundary, to whose amplitudes the forces are conjugate
    """

    boundary: str
    motions: Sequence[Vector] = ()

    def on(self, body: Problem) -> Seeing:
        """The virtual work of the motions."""
        return _Reaction(body, self)


class Functional:
    """Integrals of the state, a number each: from a `Seen` (u, F, p, …) to an integral over `inside(region)` or `on(boundary)`.

    >>> volume = Functional(lambda at: ngs.Det(at.F) * at.inside(".*"))
    """

    def __init__(self, *integrands: Integrand) -> None:
        self.integrands = integrands

    def on(self, body: Problem) -> Seeing:
        """Numbers."""
        return _Integrals(body, self.integrands)


class _Linear:
    def __init__(self, body: Problem, matrix: sp.csr_array) -> None:
        self._body, self.matrix, self.size = body, matrix, matrix.shape[0]

    def values(self) -> Array:
        return np.asarray(self.matrix @ self._body.x)

    def weigh(self, w: Array) -> None:
        """Nothing to set."""

    def functional(self, state: Motion, *along: Motion) -> Terms:
        return []


class _Reaction:
    matrix = None

    def __init__(self, body: Problem, asked: Force) -> None:
        mesh, mine = body.mesh, boundaries(body.mesh, asked.boundary)
        units = [tuple(row) for row in np.eye(mesh.dim)]
        self._body, self._boundary = body, asked.boundary
        self._motions = np.array([self._motion(motion) for motion in asked.motions or units])
        self.size = len(self._motions)
        self._shares = body.reaction_shares(asked.boundary)
        others = [p for p in body.loads if not (b := getattr(p, "boundary", None)) or not mine & boundaries(mesh, b)]
        walls = [contact for contact in body.contacts if not mine & boundaries(mesh, contact.wall)]
        self._work, self._weighed = Work(body, others, walls), ngs.GridFunction(body.fes)

    def _motion(self, motion: Vector) -> Array:
        field = ngs.GridFunction(self._body.u.space)
        value = motion if isinstance(motion, ngs.CoefficientFunction) else ngs.CF(motion)
        field.Set(value, definedon=self._body.mesh.Boundaries(self._boundary), dual=True)
        return field.vec.FV().NumPy().copy()

    def values(self) -> Array:
        return self._motions @ self._body.nodal_forces(self._boundary)

    def weigh(self, w: Array) -> None:
        self._weighed.vec.FV().NumPy()[: self._motions.shape[1]] = w @ self._motions * self._shares

    def functional(self, state: Motion, *along: Motion) -> Terms:
        return self._work(state, self._weighed, *along)


class _Integrals:
    matrix = None

    def __init__(self, body: Problem, integrands: Sequence[Integrand]) -> None:
        self._body, self._integrands, self._work = body, integrands, Work(body)
        self.size = len(integrands)
        self._weights = [ngs.Parameter(0.0) for _ in integrands]
        self._now = [[term.integral for term in self._work.of(q, body.gfu)] for q in integrands]

    def values(self) -> Array:
        return np.array([sum(ngs.Integrate(part, self._body.mesh) for part in parts) for parts in self._now])

    def weigh(self, w: Array) -> None:
        for weight, value in zip(self._weights, w, strict=True):
            weight.Set(float(value))

    def functional(self, state: Motion, *along: Motion) -> Terms:
        weighed = zip(self._weights, self._integrands, strict=True)
        return [part.times(weight) for weight, q in weighed for part in self._work.of(q, state, *along)]
