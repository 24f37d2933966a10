"""Parameters of a body as blocks of one vector θ: fields, numbers and prescribed displacements."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate
from typing import Protocol

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import InputError
from ngbrain.forward.common.regions import boundaries
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import Terms, derivatives, vector
from ngbrain.solvers.matrices import to_scipy

Array = np.ndarray


def block_slices(sizes: Sequence[int]) -> list[slice]:
    """Slices of consecutive blocks of given sizes.

    >>> block_slices([2, 1])
    [slice(0, 2, None), slice(2, 3, None)]
    """
    return [slice(end - size, end) for size, end in zip(sizes, accumulate(sizes), strict=True)]


class ParameterBlock(Protocol):
    """A block of parameters on which energies and observables depend."""

    size: int

    @property
    def value(self) -> Array:
        """Present values (size,)."""

    def set_value(self, value: Array) -> None:
        """Set the values (size,)."""

    def set_direction(self, direction: Array) -> None:
        """Set the direction (size,) of `directional_derivative`."""

    def directional_derivative(self, parts: Terms) -> Terms:
        """Derivatives of integrals along the direction last set by `set_direction`."""

    def gradient(self, parts: Terms, mesh: ngs.Mesh) -> Callable[[], Array]:
        """Gradient of a sum of integrals with respect to the block.

        Parameters
        ----------
        parts : list of Term
            Integrals that are summed.
        mesh : Mesh
            Mesh of the body.

        Returns
        -------
        callable
            Assembles the gradient (size,) at the state of the moment; it may be called repeatedly.
        """

    def jacobian(self, space: ngs.FESpace, parts: Terms) -> Callable[[], sp.csr_array]:
        """Jacobian of integrals with test functions with respect to the block.

        Parameters
        ----------
        space : FESpace
            Space of the test functions.
        parts : list of Term
            Integrals, linear in the test functions.

        Returns
        -------
        callable
            Assembles the Jacobian (ndof, size) at the state of the moment.
        """


class Field:
    """Degrees of freedom of a real GridFunction, of any space."""

    def __init__(self, gfu: ngs.GridFunction) -> None:
        self.gfu, self.size = gfu, gfu.space.ndof
        self._direction = ngs.GridFunction(gfu.space)

    @property
    def value(self) -> Array:
        """Degrees of freedom, a copy."""
        return np.array(self.gfu.vec.FV().NumPy())

    def set_value(self, value: Array) -> None:
        """Set the degrees of freedom."""
        self.gfu.vec.FV().NumPy()[:] = value

    def set_direction(self, direction: Array) -> None:
        """Set the direction of `directional_derivative`."""
        self._direction.vec.FV().NumPy()[:] = direction

    def directional_derivative(self, parts: Terms) -> Terms:
        """Derivatives along a change of the field."""
        return derivatives(parts, self.gfu, self._direction)

    def gradient(self, parts: Terms, mesh: ngs.Mesh) -> Callable[[], Array]:
        """Gradient by one linear form.

        Parameters
        ----------
        parts : list of Term
            Integrals that are summed.
        mesh : Mesh
            Mesh of the body.

        Returns
        -------
        callable
            Assembles the gradient (size,).

        Raises
        ------
        InputError
            Where the field belongs to another mesh.
        """
        found = derivatives(parts, self.gfu, self.gfu.space.TestFunction())
        if found and self.gfu.space.mesh != mesh:
            raise InputError("parameters", "a field of another mesh", "one of the body's mesh")
        return vector(self.gfu.space, found)

    def jacobian(self, space: ngs.FESpace, parts: Terms) -> Callable[[], sp.csr_array]:
        """Jacobian by one bilinear form.

        Parameters
        ----------
        space : FESpace
            Space of the test functions.
        parts : list of Term
            Integrals, linear in the test functions.

        Returns
        -------
        callable
            Assembles the Jacobian (ndof, size).
        """
        return assembled_jacobian(space, self.gfu.space, derivatives(parts, self.gfu, self.gfu.space.TrialFunction()))


class Scalar:
    """One number, an `ngs.Parameter`."""

    size = 1

    def __init__(self, parameter: ngs.Parameter) -> None:
        self.parameter, self._direction = parameter, ngs.Parameter(0.0)

    @property
    def value(self) -> Array:
        """The number (1,)."""
        return np.array([self.parameter.Get()])

    def set_value(self, value: Array) -> None:
        """Set the number."""
        self.parameter.Set(float(value[0]))

    def set_direction(self, direction: Array) -> None:
        """Set the direction of `directional_derivative`."""
        self._direction.Set(float(direction[0]))

    def directional_derivative(self, parts: Terms) -> Terms:
        """Derivatives with respect to the number, times its change."""
        return [part.times(self._direction) for part in derivatives(parts, self.parameter)]

    def gradient(self, parts: Terms, mesh: ngs.Mesh) -> Callable[[], Array]:
        """Gradient by integration.

        Parameters
        ----------
        parts : list of Term
            Integrals that are summed.
        mesh : Mesh
            Mesh of the body.

        Returns
        -------
        callable
            Gives the derivative (1,).
        """
        integrals = [part.integral for part in derivatives(parts, self.parameter)]
        return lambda: np.array([sum(float(ngs.Integrate(part, mesh)) for part in integrals)], float)

    def jacobian(self, space: ngs.FESpace, parts: Terms) -> Callable[[], sp.csr_array]:
        """Jacobian of one column.

        Parameters
        ----------
        space : FESpace
            Space of the test functions.
        parts : list of Term
            Integrals, linear in the test functions.

        Returns
        -------
        callable
            Assembles the Jacobian (ndof, 1).
        """
        column = vector(space, derivatives(parts, self.parameter))
        return lambda: sp.csr_array(column()[:, None])


class PrescribedDisplacement:
    """Displacements prescribed on a boundary (Dirichlet values) at load factor 1, for all degrees of freedom fixed there.

    Parameters
    ----------
    body : Problem
        Body whose supports prescribe the displacements.
    boundary : str
        Name or pattern of the boundary.

    Attributes
    ----------
    dofs : array of int (size,)
        The degrees of freedom.

    Raises
    ------
    InputError
        Where no component is prescribed on the boundary.
    """

    def __init__(self, body: Problem, boundary: str) -> None:
        boundaries(body.mesh, boundary)
        there = np.fromiter(body.u.space.GetDofs(body.mesh.Boundaries(boundary)), bool, len(body.fixed))
        self.body, self.dofs = body, np.flatnonzero(there & body.fixed)
        self.size = len(self.dofs)
        if not self.size:
            raise InputError("boundary", repr(boundary), "a boundary with a prescribed component")

    @property
    def value(self) -> Array:
        """Prescribed displacements (m)."""
        return np.array(self.body.prescribed[self.dofs])

    def set_value(self, value: Array) -> None:
        """Prescribe other displacements (m)."""
        self.body.prescribed[self.dofs] = value

    def set_direction(self, direction: Array) -> None:
        """Nothing to set: no energy depends on them."""

    def directional_derivative(self, parts: Terms) -> Terms:
        """Empty: no energy depends on them."""
        return []

    def gradient(self, parts: Terms, mesh: ngs.Mesh) -> Callable[[], Array]:
        """Zero: no energy depends on them.

        Parameters
        ----------
        parts : list of Term
            Not used.
        mesh : Mesh
            Not used.

        Returns
        -------
        callable
            Gives zeros (size,).
        """
        return lambda: np.zeros(self.size)

    def jacobian(self, space: ngs.FESpace, parts: Terms) -> Callable[[], sp.csr_array]:
        """Zero: no energy depends on them.

        Parameters
        ----------
        space : FESpace
            Space of the test functions.
        parts : list of Term
            Not used.

        Returns
        -------
        callable
            Gives an empty matrix (ndof, size).
        """
        return lambda: sp.csr_array((space.ndof, self.size))


def assembled_jacobian(space: ngs.FESpace, along: ngs.FESpace, parts: Terms) -> Callable[[], sp.csr_array]:
    """Assembler of a matrix with test functions of one space and trial functions of another.

    Parameters
    ----------
    space, along : FESpace
        Spaces of the test and of the trial functions.
    parts : list of WorkIntegral
        Integrals, linear in both.

    Returns
    -------
    callable
        Assembles the matrix (ndof, ndof of `along`).
    """
    form = ngs.BilinearForm(trialspace=along, testspace=space)
    for part in parts:
        form += part.integral

    def assembled() -> sp.csr_array:
        if not parts:
            return sp.csr_array((space.ndof, along.ndof))
        form.Assemble()
        return to_scipy(form.mat)

    return assembled
