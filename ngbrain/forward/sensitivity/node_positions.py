"""Positions of a mesh's nodes as a block of parameters."""

from __future__ import annotations

from collections.abc import Callable

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import InputError, InvertedElementError
from ngbrain.forward.sensitivity.differences import central_difference
from ngbrain.forward.sensitivity.parameter_blocks import assembled_jacobian
from ngbrain.forward.solid.virtual_work import Terms, terms, vector

Array = np.ndarray


class NodePositions:
    """Displacements (m) of a mesh's nodes, one vector a vertex, all first components first.

    Fields and the points of observed displacements move with the elements. Prescribed displacements do not change. Runs have no
    second derivatives with respect to node positions. Create the block before the bodies that use it.

    Parameters
    ----------
    mesh : Mesh
        Undeformed mesh; the block sets its deformation.

    Raises
    ------
    InputError
        For a mesh that is deformed already.
    InvertedElementError
        By `set_value`, where a shift inverts an element.
    """

    def __init__(self, mesh: ngs.Mesh) -> None:
        if mesh.deformation is not None:
            raise InputError("mesh", "deformed already", "an undeformed mesh")
        self.mesh, self.shift = mesh, ngs.GridFunction(ngs.VectorH1(mesh, order=1))
        self.size = self.shift.space.ndof
        self._stretch = ngs.Det(ngs.specialcf.JacobianMatrix(mesh.dim))
        self._direction = ngs.GridFunction(self.shift.space)
        mesh.SetDeformation(self.shift)
        self._signs = np.sign(self._integrals(self._stretch))

    @property
    def value(self) -> Array:
        """Displacements of the nodes (m)."""
        return np.array(self.shift.vec.FV().NumPy())

    def set_value(self, value: Array) -> None:
        """Move the nodes."""
        self.shift.vec.FV().NumPy()[:] = value
        if np.any(np.sign(self._integrals(self._stretch)) != self._signs):
            raise InvertedElementError("the node positions invert an element")

    def set_direction(self, direction: Array) -> None:
        """Set the direction of `finite_difference`."""
        self._direction.vec.FV().NumPy()[:] = direction

    def directional_derivative(self, parts: Terms) -> Terms:
        """Not available, as NGSolve differentiates a shape only once; see `finite_difference`."""
        raise InputError("parameters", "of type NodePositions", "one with second derivatives")

    def finite_difference(self, function: Callable[[], Array], least: float = np.inf) -> Array:
        """Directional derivative by central differences of what integrals give.

        Parameters
        ----------
        function : callable
            Assembles an array at the node positions of the moment.
        least : float
            Smallest length (m) over which the integrands vary in space.

        Returns
        -------
        array
            Derivative of the array along the direction last set.
        """
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
        """Shape gradient by one linear form.

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
        """
        return vector(self.shift.space, self._moved(parts, self.shift.space.TestFunction()))

    def jacobian(self, space: ngs.FESpace, parts: Terms) -> Callable[[], sp.csr_array]:
        """Shape Jacobian by one bilinear form.

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
        return assembled_jacobian(space, self.shift.space, self._moved(parts, self.shift.space.TrialFunction()))

    def _moved(self, parts: Terms, direction: ngs.CoefficientFunction) -> Terms:
        return [term for part in parts for term in terms((part.coef * part.over).DiffShape(direction))]

    def _integrals(self, function: ngs.CoefficientFunction) -> Array:
        """Integral over each element."""
        return np.array(ngs.Integrate(function, self.mesh, element_wise=True).NumPy())
