"""Linear solves with a body's tangent at one state after another, for a linearised run.

`Tangents`: symmetric tangents, with few factorisations for many steps. `PivotedTangents`: friction, follower pressures and
cavities. `BorderedTangents`: either, with the equation of a force-controlled tool.
"""

from __future__ import annotations

import ngsolve as ngs
import numpy as np

from ngbrain.errors import Breakdown, SolverError
from ngbrain.forward.sensitivity.contact_work import ContactForms
from ngbrain.forward.sensitivity.transient.friction_step import FrictionStep
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.tangent import Solve, factor
from ngbrain.solvers.krylov import gmres

Array = np.ndarray
RTOL, MAX_ITERATIONS = 1e-11, 20
"""Relative residual of GMRES, and iterations after which a new factorisation is made."""
FINE_RTOL, FINE_MAX_ITERATIONS = 1e-13, 12
"""The same for second derivatives, which are computed from computed solutions and need a better preconditioner."""
FEW = 3
"""Right-hand sides at one state up to which an older factorisation is tried."""


class Tangents:
    """The symmetric tangent at the body's present state; GMRES with an older factorisation where that converges fast enough.

    Attributes
    ----------
    factorisations, solves : int
        Counts.
    """

    def __init__(self, body: Problem) -> None:
        self.body, self.factorisations, self.solves = body, 0, 0
        weights = body.weights[: body.fes.ndof]
        free = weights > 0
        self._free, self._scale = free.astype(float), np.sqrt(np.where(free, weights, 1.0))
        self._held = ngs.BitArray(free.tolist())
        self._vectors = body.gfu.vec.CreateVector(), body.gfu.vec.CreateVector()
        self._factor: Solve | None = None

    def prepare(self, n_rhs: int, rtol: float = RTOL) -> Solve:
        """Solver for a number of right-hand sides, valid until the next one is prepared.

        Parameters
        ----------
        n_rhs : int
            Number of right-hand sides.
        rtol : float
            Relative tolerance.

        Returns
        -------
        callable
            b → K⁻¹ b.
        """
        maxwell = self.body.history.maxwell
        if maxwell:
            maxwell.stiffen()
        self.body.form.AssembleLinearization(self.body.gfu.vec)
        self._fresh, self._rtol, self._max_iter = False, rtol, MAX_ITERATIONS if rtol >= RTOL else FINE_MAX_ITERATIONS
        if n_rhs > FEW:
            self._renew()
        return self._solve

    def solve_transpose(self, b: Array) -> Array:
        """K⁻ᵀ b; the tangent is symmetric."""
        return self._solve(b)

    def apply(self, x: Array) -> Array:
        """K x (ndof,)."""
        vector, image = self._vectors
        vector.FV().NumPy()[:] = x
        image.data = self.body.form.mat * vector
        return image.FV().NumPy().copy()

    multiply = multiply_transpose = apply

    def _solve(self, b: Array) -> Array:
        self.solves += 1
        if self._factor is not None and not self._fresh:
            first = self._factor(b)
            x, _, left = gmres(
                lambda y: self.apply(y) * self._free, self._factor, first, self._scale, self._rtol, self._max_iter
            )
            if left <= self._rtol:
                return x
        if not self._fresh:
            self._renew()
        assert self._factor is not None
        return self._factor(b)

    def _renew(self) -> None:
        self._factor = None  # frees the memory of the old one first
        self._factor = factor(self.body.form, self._held)
        self._fresh = True
        self.factorisations += 1


class PivotedTangents:
    """The nonsymmetric tangent, factorised with pivoting; with friction it is complete (consistent).

    It is a system for Newton's method too, which then converges in few steps, unlike with friction's symmetric tangent.

    Parameters
    ----------
    body : Problem
        The body.
    friction : FrictionStep or None
        Its friction.
    """

    def __init__(self, body: Problem, friction: FrictionStep | None) -> None:
        self.body, self.factorisations, self.solves = body, 0, 0
        self._whole = body.uncondensed
        self._form = self._whole if friction is None else self._with(friction)
        free = body.weights[: body.fes.ndof] > 0
        self._free, self._held = free.astype(float), ngs.BitArray(free.tolist())
        self._vectors = body.gfu.vec.CreateVector(), body.gfu.vec.CreateVector()

    def _with(self, friction: FrictionStep) -> ngs.BilinearForm:
        form = ngs.BilinearForm(self.body.fes)
        for part in self.body.tissue.terms:
            form += part
        for term in self.body.terms[1:]:
            if term is not self.body.friction:
                term.join(form)
        friction.join_tangent(form)
        return form

    def prepare(self, n_rhs: int, rtol: float = 0.0) -> Solve:
        """Factorise the tangent; the solver is valid until the next one is prepared.

        Parameters
        ----------
        n_rhs : int
            Not used.
        rtol : float
            Not used.

        Returns
        -------
        callable
            r → K⁻¹ r.

        Raises
        ------
        SolverError
            Where the tangent is singular.
        """
        maxwell = self.body.history.maxwell
        if maxwell:
            maxwell.stiffen()
        self._whole.AssembleLinearization(self.body.gfu.vec)
        if self._form is not self._whole:
            self._form.AssembleLinearization(self.body.gfu.vec)
        try:
            self._inverse = self._form.mat.Inverse(self._held, inverse="umfpack")
        except Exception as error:  # NGSolve raises bare exceptions of several kinds here
            raise SolverError(f"a time step has no derivative: {error}") from error
        self.factorisations += 1
        return lambda r: self._times(self._inverse, r * self._free)

    def solve_transpose(self, r: Array) -> Array:
        """K⁻ᵀ r, with the factorisation of `prepare`."""
        return self._times(self._inverse.T, r * self._free)

    def apply(self, x: Array) -> Array:
        """Kᵀ x, with friction's symmetric tangent as in `Tangents`."""
        matrix = self._whole.mat
        return self._times(matrix if self.body.symmetric else matrix.T, x, whole=True)

    def multiply(self, x: Array) -> Array:
        """K x."""
        return self._times(self._form.mat, x, whole=True)

    def multiply_transpose(self, x: Array) -> Array:
        """Kᵀ x."""
        return self._times(self._form.mat.T, x, whole=True)

    def _times(self, matrix: ngs.BaseMatrix, r: Array, whole: bool = False) -> Array:
        self.solves += not whole
        vec, image = self._vectors
        vec.FV().NumPy()[:] = r
        image.data = matrix * vec
        found = np.array(image.FV().NumPy())
        return found if whole else found * self._free


class BorderedTangents:
    """The tangent bordered by the equation of a force-controlled tool; the tool's displacement is the last entry of vectors.

    Parameters
    ----------
    inner : Tangents or PivotedTangents
        Tangent of the body.
    contacts : ContactForms
        Virtual work of the contacts.
    friction : FrictionStep or None
        Friction of the body.
    """

    def __init__(
        self, inner: Tangents | PivotedTangents, contacts: ContactForms, friction: FrictionStep | None
    ) -> None:
        assert inner.body.tool is not None
        self.body, self.inner, self.tool = inner.body, inner, inner.body.tool
        self._contacts, self._friction = contacts, friction
        self._row = self._column = np.zeros(self.body.fes.ndof)
        self._corner = 0.0

    @property
    def factorisations(self) -> int:
        """Factorisations of the body's tangent."""
        return self.inner.factorisations

    @property
    def solves(self) -> int:
        """Solves with the body's tangent, those for the border included."""
        return self.inner.solves

    def prepare(self, n_rhs: int, rtol: float = RTOL) -> Solve:
        """Solver of the bordered system, valid until the next one is prepared.

        Parameters
        ----------
        n_rhs : int
            Number of right-hand sides.
        rtol : float
            Relative tolerance.

        Returns
        -------
        callable
            r → K⁻¹ r.
        """
        self._solve = self.inner.prepare(n_rhs + 1, rtol)
        if self.tool.prescribed.fixed_travel is None:
            row, column = self._contacts.tool_force_state_gradient(), self._contacts.tool_column()
            corner = self._contacts.tool_stiffness()
            if self._friction is not None:
                row, column = row + self._friction.tool_row(), column + self._friction.tool_column()
                corner += float(self._friction.tool_stiffness()[0])
            self._row, self._column, self._corner = row, column, corner
        return lambda r: self._bordered(self._solve, self._row, self._column, r)

    def solve_transpose(self, r: Array) -> Array:
        """K⁻ᵀ r of the bordered system."""
        return self._bordered(self.inner.solve_transpose, self._column, self._row, r)

    def apply(self, x: Array) -> Array:
        """Product with the body's tangent, without the border."""
        return self.inner.apply(x)

    def multiply(self, x: Array) -> Array:
        """K x of the bordered system."""
        return self._product(self.inner.multiply, self._column, self._row, x)

    def multiply_transpose(self, x: Array) -> Array:
        """Kᵀ x of the bordered system."""
        return self._product(self.inner.multiply_transpose, self._row, self._column, x)

    def _product(self, inner: Solve, column: Array, row: Array, x: Array) -> Array:
        return np.append(inner(x[:-1]) + x[-1] * column, row @ x[:-1] + x[-1] * self._corner)

    def _bordered(self, solve: Solve, row: Array, column: Array, r: Array) -> Array:
        y = solve(r[:-1])
        if self.tool.prescribed.fixed_travel is not None:
            return np.append(y, 0.0)
        follows = solve(column)
        stiffness = self._corner - float(row @ follows)
        if not stiffness:
            raise Breakdown("the tool force does not depend on its displacement")
        way = (r[-1] - float(row @ y)) / stiffness
        return np.append(y - way * follows, way)


class TangentSystem:
    """A body with another tangent, as a system for Newton's method (`solvers.newton.System`).

    Parameters
    ----------
    body : Problem
        The body.
    tangents : Tangents, PivotedTangents or BorderedTangents
        Its tangent.
    """

    def __init__(self, body: Problem, tangents: Tangents | PivotedTangents | BorderedTangents) -> None:
        self.body, self._tangents = body, tangents

    @property
    def weights(self) -> Array:
        """Weights of the body."""
        return self.body.weights

    def residual(self, x: Array) -> tuple[Array, float]:
        """Residual of the body."""
        return self.body.residual(x)

    def min_det(self, x: Array) -> float:
        """Smallest det F of the body."""
        return self.body.min_det(x)

    def factorise(self, x: Array, r: Array) -> Solve:
        """Solver with the tangent at x.

        Parameters
        ----------
        x : array (ndof,)
            State.
        r : array (ndof,)
            Not used.

        Returns
        -------
        callable
            r → K⁻¹ r.
        """
        self.body.residual(x)
        return self._tangents.prepare(1)
