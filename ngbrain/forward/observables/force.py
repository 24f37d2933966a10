"""Reaction forces and moments on boundaries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.common.loads import Load, Vector
from ngbrain.forward.common.regions import boundaries
from ngbrain.forward.contact.rigid import WallContact
from ngbrain.forward.observables.base import Observable, ProblemObservable
from ngbrain.forward.observables.points import along_axis, axis
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import Motion, Terms, VirtualWork

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Force(Observable):
    """Total external force on a boundary (N; in plane strain N/m): of its supports, contacts and loads.

    Work of the nodal forces there in a unit motion, see `Problem.nodal_forces`.

    Parameters
    ----------
    boundary : str
        A pattern.
    direction : sequence of float, optional
        Direction of the component, which is multiplied by its length; None: all components.
    motions : sequence, optional
        In place of directions: motions of the boundary (vectors or CoefficientFunctions), for generalised forces conjugate to
        their amplitudes.

    Raises
    ------
    InputError
        When evaluated on a problem, for a pattern that matches nothing and a direction that is zero.
    """

    boundary: str
    direction: Sequence[float] | None = None
    motions: Sequence[Vector] = ()
    unit = "N"

    @property
    def name(self) -> str:
        """Name for reports."""
        return f"force on {self.boundary}{along_axis(self.direction)}"

    def on(self, problem: Problem) -> Reaction:
        """The virtual work of its motions."""
        dim = problem.mesh.dim
        rows = np.eye(dim) if self.direction is None else axis(self.direction, dim)[None]
        return Reaction(problem, self.boundary, self.motions or [tuple(row) for row in rows])


@dataclass(frozen=True, eq=False)
class Moment(Observable):
    """Moment (N m) of the external forces on a boundary, about an axis through a fixed point.

    Parameters
    ----------
    boundary : str
        A pattern.
    centre : sequence of float
        A point of the axis (m); lever arms are those of the reference configuration.
    axis : sequence of float
        Its direction, in space; in the plane the axis is normal to it.
    """

    boundary: str
    centre: Sequence[float]
    axis: Sequence[float] = (0.0, 0.0, 1.0)
    unit = "N m"

    @property
    def name(self) -> str:
        """Name for reports."""
        return f"moment on {self.boundary} about ({', '.join(f'{1e3 * c:g}' for c in self.centre)}) mm"

    def on(self, problem: Problem) -> Reaction:
        """The work of a small rotation."""
        dim = problem.mesh.dim
        if len(self.centre) != dim:
            raise InputError("Moment.centre", list(self.centre), f"a point of {dim} coordinates (m)")
        x, y, z = (c - float(o) for c, o in zip((ngs.x, ngs.y, ngs.z), (*self.centre, 0.0)[:3], strict=True))
        if dim == 2:
            return Reaction(problem, self.boundary, [ngs.CF((-y, x))])
        a, b, c = axis(self.axis, 3)
        return Reaction(problem, self.boundary, [ngs.CF((b * z - c * y, c * x - a * z, a * y - b * x))])


class Reaction(ProblemObservable):
    """Generalised reaction forces: work of the forces on a boundary in prescribed motions.

    Parameters
    ----------
    problem : Problem
    boundary : str
        Name or pattern.
    motions : sequence
        Vectors or CoefficientFunctions.
    """

    motions: Array

    def __init__(self, problem: Problem, boundary: str, motions: Sequence[Vector]) -> None:
        super().__init__(problem)
        self._mine, self.boundary = boundaries(problem.mesh, boundary), boundary
        own = np.array([self._motion(motion) for motion in motions])
        self.size = len(own)
        self.motions = np.zeros((self.size, problem.fes.ndof))
        self.motions[:, problem.is_u] = own * problem.reaction_shares(boundary)
        self._product = problem.gfu.vec.CreateVector(), problem.gfu.vec.CreateVector()
        self._weighed = ngs.GridFunction(problem.fes)

    def _motion(self, motion: Vector) -> Array:
        field = ngs.GridFunction(self.problem.u.space)
        value = motion if isinstance(motion, ngs.CoefficientFunction) else ngs.CF(tuple(motion))
        field.Set(value, definedon=self.problem.mesh.Boundaries(self.boundary), dual=True)
        return np.array(field.vec.FV().NumPy())

    @property
    def elsewhere(self) -> tuple[list[Load], list[WallContact]]:
        """Loads and contacts on other boundaries: their forces on shared nodes count as internal forces."""
        loads = [load for load in self.problem.loads if self._apart(getattr(load, "boundary", None))]
        return loads, [contact for contact in self.problem.contacts if self._apart(contact.wall)]

    def check_apart_from_friction(self) -> None:
        """Refuse friction on other boundaries that share nodes: its derivative there is not available."""
        u = self.problem.u.space
        for friction in self.problem.friction.frictions:
            there = np.fromiter(u.GetDofs(self.problem.mesh.Boundaries(friction.wall)), bool, u.ndof)
            if self._apart(friction.wall) and np.any(self.motions[:, : u.ndof][:, there]):
                wanted = f"one that shares no node with {friction.wall!r}, which has friction"
                raise InputError("Force.boundary", repr(self.boundary), wanted)

    def _apart(self, pattern: str | None) -> bool:
        return not pattern or not self._mine & boundaries(self.problem.mesh, pattern)

    def value(self, tissue: Array | None = None) -> Array:
        """Work (J per metre or radian) of the nodal forces; `tissue` are the tissue's nodal forces, where already computed."""
        problem = self.problem
        return np.asarray(self.motions[:, problem.is_u] @ problem.unshared_forces(self.boundary, tissue))

    def gradient(self, weights: Array) -> Array:
        """Stiffness times the motions, without loads and contacts on the boundary itself."""
        problem, motion = self.problem, weights @ self.motions
        problem.tissue.stiffen()
        problem.uncondensed.AssembleLinearization(problem.gfu.vec)
        problem.invalidate_tangent()
        return self._applied(problem.uncondensed, motion) - self.own_stiffness(motion)

    def own_stiffness(self, motion: Array) -> Array:
        """Stiffness of loads and contacts on the boundary itself, times a motion."""
        found = np.zeros(len(motion))
        for form in self._own:
            form.AssembleLinearization(self.problem.gfu.vec)
            found += self._applied(form, motion)
        return found

    @cached_property
    def _own(self) -> list[ngs.BilinearForm]:
        return [form for pattern, form in self.problem.acting if not self._apart(pattern)]

    def _applied(self, form: ngs.BilinearForm, motion: Array) -> Array:
        vector, image = self._product
        vector.FV().NumPy()[:] = motion
        image.data = (form.mat if self.problem.symmetric else form.mat.T) * vector
        return np.array(image.FV().NumPy())

    def set_weights(self, weights: Array) -> None:
        """Set the weights of `functional`."""
        self._weighed.vec.FV().NumPy()[:] = weights @ self.motions

    def functional(self, state: Motion, *along: Motion) -> Terms:
        """Virtual work of the tissue and of loads and contacts on other boundaries."""
        return self._work(state, self._weighed, *along)

    @cached_property
    def _work(self) -> VirtualWork:
        return VirtualWork(self.problem, *self.elsewhere)
