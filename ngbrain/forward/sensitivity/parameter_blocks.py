"""What a body is made of, as blocks of one vector θ: fields, numbers, displacements that are prescribed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate
from typing import Protocol, TypeAlias

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import InputError, InvertedElementError
from ngbrain.forward.common.regions import boundaries
from ngbrain.forward.sensitivity.differences import central_difference
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import Terms, derivatives, terms, vector
from ngbrain.solvers.matrices import to_scipy

Array = np.ndarray


def block_slices(sizes: Sequence[int]) -> list[slice]:
    """Where parts of these sizes are, one after the other.

    >>> block_slices([2, 1])
    [slice(0, 2, None), slice(2, 3, None)]
    """
    return [slice(end - size, end) for size, end in zip(sizes, accumulate(sizes), strict=True)]


class ParameterBlock(Protocol):
    """One of them, part of energies and observations.

    `directional_derivative` are the parts' derivatives along the direction last set by `set_direction`.
    """

    size: int

    @property
    def value(self) -> Array:
        """What it is now (size,)."""

    def set_value(self, value: Array) -> None:
        """Set it."""

    def set_direction(self, direction: Array) -> None:
        """Set the direction of `directional_derivative`."""

    def directional_derivative(self, parts: Terms) -> Terms:
        """Derivatives of integrals along a direction."""

    def gradient(self, parts: Terms, mesh: ngs.Mesh) -> Callable[[], Array]:
        """What gives the derivatives of a sum of integrals by each unknown (size,), as often as it is asked."""

    def jacobian(self, space: ngs.FESpace, parts: Terms) -> Callable[[], sp.csr_array]:
        """The same of integrals with test functions of a space (ndof, size)."""


class Field:
    """Unknowns of a real GridFunction of any space."""

    def __init__(self, gfu: ngs.GridFunction) -> None:
        self.gfu, self.size = gfu, gfu.space.ndof
        self._direction = ngs.GridFunction(gfu.space)

    @property
    def value(self) -> Array:
        """Its unknowns, a copy."""
        return np.array(self.gfu.vec.FV().NumPy())

    def set_value(self, value: Array) -> None:
        """Set them."""
        self.gfu.vec.FV().NumPy()[:] = value

    def set_direction(self, direction: Array) -> None:
        """Set the direction of `directional_derivative`."""
        self._direction.vec.FV().NumPy()[:] = direction

    def directional_derivative(self, parts: Terms) -> Terms:
        """Derivatives along a change of the field."""
        return derivatives(parts, self.gfu, self._direction)

    def gradient(self, parts: Terms, mesh: ngs.Mesh) -> Callable[[], Array]:
        """One linear form."""
        found = derivatives(parts, self.gfu, self.gfu.space.TestFunction())
        if found and self.gfu.space.mesh != mesh:
            raise InputError("parameters", "a field of another mesh", "one of the body's mesh")
        return vector(self.gfu.space, found)

    def jacobian(self, space: ngs.FESpace, parts: Terms) -> Callable[[], sp.csr_array]:
        """One bilinear form."""
        return _assembled_jacobian(space, self.gfu.space, derivatives(parts, self.gfu, self.gfu.space.TrialFunction()))


class Scalar:
    """A `Parameter`."""

    size = 1

    def __init__(self, parameter: ngs.Parameter) -> None:
        self.parameter, self._direction = parameter, ngs.Parameter(0.0)

    @property
    def value(self) -> Array:
        """The number, as an array of one."""
        return np.array([self.parameter.Get()])

    def set_value(self, value: Array) -> None:
        """Set it."""
        self.parameter.Set(float(value[0]))

    def set_direction(self, direction: Array) -> None:
        """Set the direction of `directional_derivative`."""
        self._direction.Set(float(direction[0]))

    def directional_derivative(self, parts: Terms) -> Terms:
        """Derivatives by the number, times its change."""
        return [part.times(self._direction) for part in derivatives(parts, self.parameter)]

    def gradient(self, parts: Terms, mesh: ngs.Mesh) -> Callable[[], Array]:
        """One number by integration."""
        integrals = [part.integral for part in derivatives(parts, self.parameter)]
        return lambda: np.array([sum(float(ngs.Integrate(part, mesh)) for part in integrals)], float)

    def jacobian(self, space: ngs.FESpace, parts: Terms) -> Callable[[], sp.csr_array]:
        """One column."""
        column = vector(space, derivatives(parts, self.parameter))
        return lambda: sp.csr_array(column()[:, None])


class PrescribedDisplacement:
    """Displacements (m) that are prescribed on a boundary of one body, at t = 1: all of its unknowns there that are held.

    Raises `InputError` where nothing is held.
    """

    def __init__(self, body: Problem, boundary: str) -> None:
        boundaries(body.mesh, boundary)
        there = np.fromiter(body.u.space.GetDofs(body.mesh.Boundaries(boundary)), bool, len(body.held))
        self.body, self.dofs = body, np.flatnonzero(there & body.held)
        self.size = len(self.dofs)
        if not self.size:
            raise InputError("boundary", repr(boundary), "one with a component that is held")

    @property
    def value(self) -> Array:
        """Where they are held (m)."""
        return np.array(self.body.prescribed[self.dofs])

    def set_value(self, value: Array) -> None:
        """Hold them elsewhere."""
        self.body.prescribed[self.dofs] = value

    def set_direction(self, direction: Array) -> None:
        """They are in no energy."""

    def directional_derivative(self, parts: Terms) -> Terms:
        """Nothing."""
        return []

    def gradient(self, parts: Terms, mesh: ngs.Mesh) -> Callable[[], Array]:
        """Nothing."""
        return lambda: np.zeros(self.size)

    def jacobian(self, space: ngs.FESpace, parts: Terms) -> Callable[[], sp.csr_array]:
        """Nothing."""
        return lambda: sp.csr_array((space.ndof, self.size))


class NodePositions:
    """Shifts (m) of a mesh's nodes, a vector for each vertex by components, with which whatever is in its elements goes along.

    So do points where displacements are seen, and fields; what supports prescribe stays as it is. There are no
    second derivatives of runs. A shift that turns an element inside out raises `InvertedElementError`. To be made before the
    bodies that it is for.
    """

    def __init__(self, mesh: ngs.Mesh) -> None:
        if mesh.deformation is not None:
            raise InputError("mesh", "deformed already", "one as it was made")
        self.mesh, self.shift = mesh, ngs.GridFunction(ngs.VectorH1(mesh, order=1))
        self.size = self.shift.space.ndof
        self._stretch = ngs.Det(ngs.specialcf.JacobianMatrix(mesh.dim))
        self._direction = ngs.GridFunction(self.shift.space)
        mesh.SetDeformation(self.shift)
        self._signs = np.sign(self._integrals(self._stretch))

    @property
    def value(self) -> Array:
        """Shifts (m)."""
        return np.array(self.shift.vec.FV().NumPy())

    def set_value(self, value: Array) -> None:
        """Shift the nodes."""
        self.shift.vec.FV().NumPy()[:] = value
        if np.any(np.sign(self._integrals(self._stretch)) != self._signs):
            raise InvertedElementError("shifted nodes turn an element of the mesh inside out")

    def set_direction(self, direction: Array) -> None:
        """Set the direction of `finite_difference`."""
        self._direction.vec.FV().NumPy()[:] = direction

    def directional_derivative(self, parts: Terms) -> Terms:
        """NGSolve differentiates a shape once: `finite_difference` takes differences."""
        raise InputError("parameters", "nodes", "others, for second derivatives")

    def finite_difference(self, function: Callable[[], Array], least: float = np.inf) -> Array:
        """How what integrals give changes along the direction; `least`, a length (m) over which what they see of places does."""
        here, way = self.value, np.array(self._direction.vec.FV().NumPy())

        def at(s: float) -> Array:
            self.set_value(here + s * way)
            return function()

        gradient = ngs.Grad(self._direction)
        strain, size = (self._integrals(of) for of in (ngs.InnerProduct(gradient, gradient), ngs.CF(1.0)))
        try:
            return central_difference(
                at, max(float(np.sqrt(np.max(strain / size))), float(np.max(np.abs(way))) / least)
            )
        finally:
            self.set_value(here)

    def gradient(self, parts: Terms, mesh: ngs.Mesh) -> Callable[[], Array]:
        """One linear form."""
        return vector(self.shift.space, self._moved(parts, self.shift.space.TestFunction()))

    def jacobian(self, space: ngs.FESpace, parts: Terms) -> Callable[[], sp.csr_array]:
        """One bilinear form."""
        return _assembled_jacobian(space, self.shift.space, self._moved(parts, self.shift.space.TrialFunction()))

    def _moved(self, parts: Terms, direction: ngs.CoefficientFunction) -> Terms:
        return [term for part in parts for term in terms((part.coef * part.over).DiffShape(direction))]

    def _integrals(self, function: ngs.CoefficientFunction) -> Array:
        """Over each element."""
        return np.array(ngs.Integrate(function, self.mesh, element_wise=True).NumPy())


def _assembled_jacobian(space: ngs.FESpace, along: ngs.FESpace, parts: Terms) -> Callable[[], sp.csr_array]:
    """What assembles the matrix of terms with test functions of one space and trial functions of another."""
    form = ngs.BilinearForm(trialspace=along, testspace=space)
    for part in parts:
        form += part.integral

    def assembled() -> sp.csr_array:
        if not parts:
            return sp.csr_array((space.ndof, along.ndof))
        form.Assemble()
        return to_scipy(form.mat)

    return assembled


Parameter: TypeAlias = ngs.GridFunction | ngs.Parameter | PrescribedDisplacement | NodePositions


def parameter_block(name: str, of: Parameter) -> ParameterBlock:
    """The block that a GridFunction, a `Parameter` or another block is; `InputError` for anything else."""
    if isinstance(of, ngs.GridFunction):
        if of.space.is_complex:
            raise InputError(f"parameters.{name}", "complex", "a real field")
        return Field(of)
    if isinstance(of, ngs.Parameter):
        return Scalar(of)
    if not isinstance(of, (PrescribedDisplacement, NodePositions)):
        wanted = "a GridFunction, a Parameter, PrescribedDisplacement(body, boundary) or NodePositions(mesh)"
        raise InputError(f"parameters.{name}", type(of).__name__, wanted)
    return of
