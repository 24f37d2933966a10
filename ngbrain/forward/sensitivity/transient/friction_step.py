"""How friction's part of a time step changes with where the step begins, with the slip that it begins with, and with its end.

With the displacement y and the elastic slip e at the start of a step to x, the traction τ(x, y, e; θ) on the wall and the slip
e⁺ = E(x, y, e; θ), all that an adjoint needs is a derivative of one integral, with a motion λ of the wall and weights M,

    ℓ = ∫ τ · λ_t + M · E dA ,

by x, y, e and θ; λ_t is what of λ is along the body's surface. Newton's method takes pressure and normal as they are, its
tangent is symmetric; here they change with x too, and the tangent does not stay so.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import ngsolve as ngs
import numpy as np

from ngbrain.errors import SolverError
from ngbrain.forward.contact.friction import Rub, Slipping
from ngbrain.forward.sensitivity.parameter_blocks import Block
from ngbrain.forward.sensitivity.transient.quadrature_blocks import values
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.tangent import Solve
from ngbrain.forward.solid.virtual_work import Motion, Term, Terms, by, vector

Array = np.ndarray


class FrictionStep:
    """Of all that rubs in a body, at the end of a step where it stands; parameters as `parts`.

    A change of slips is one array (points · dim,), one friction after the other; so are weights, as densities over the walls.
    """

    felt = False
    """What is seen of forces is the tissue's: a motion of it does not take part in friction."""

    def __init__(self, body: Problem, parts: Mapping[str, Block]) -> None:
        self.body, self._parts = body, list(parts.values())
        self._motion, self._moving, self._starting = (ngs.GridFunction(body.fes) for _ in range(3))
        self._x, self._y = ngs.Parameter(0.0), ngs.Parameter(0.0)
        self._rubs = [_Fields(rub) for rub in body.friction.rubs]
        sizes = [len(values(rub.weight)) for rub in self._rubs]
        self._ends, self.size = np.cumsum(sizes)[:-1], int(sum(sizes))

    # Backwards.

    def back(self, adjoint: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Derivatives of ℓ by y (ndof,), by e (a density) and by θ."""
        self._weigh(adjoint, weights)
        by_slip = np.concatenate(
            [rub.at_points(density) for rub, density in zip(self._rubs, self._by_slip, strict=True)]
        )
        return self._by_start(), by_slip, np.concatenate([part() for part in self._by_theta])

    def remembered(self, weights: Array) -> Array:
        """∂(∫ M · E dA)/∂x (ndof,)."""
        self._weigh(np.zeros(self.body.fes.ndof), weights)
        return self._by_end()

    def _weigh(self, adjoint: Array, weights: Array) -> None:
        values(self._motion)[:] = adjoint
        for rub, part in zip(self._rubs, np.split(weights, self._ends), strict=True):
            values(rub.weight)[:] = part

    @cached_property
    def _by_start(self) -> Callable[[], Array]:
        test = self.body.fes.TestFunction()
        return vector(self.body.fes, by(self._work(self._motion, start=test), self._y))

    @cached_property
    def _by_end(self) -> Callable[[], Array]:
        """Of the slips alone: along a test function, with λ zero."""
        test = self.body.fes.TestFunction()
        return vector(self.body.fes, by(self._work(None, end=test), self._x))

    @cached_property
    def _by_slip(self) -> list[ngs.CoefficientFunction]:
        found = []
        for rub in self._rubs:
            slip = ngs.CF(tuple(rub.rub.slip[i] for i in range(rub.rub.slip.dim))).MakeVariable()
            found.append(self._density(rub, self._slipping(rub, slip=slip), self._motion).Diff(slip).Compile())
        return found

    @cached_property
    def _by_theta(self) -> list[Callable[[], Array]]:
        return [part.slope(self._work(self._motion), self.body.mesh) for part in self._parts]

    # Forwards.

    def changed(self, start: Array, slips: Array, theta: Sequence[Array]) -> Array:
        """How forces change with y, e and θ (ndof,)."""
        self._aim(start, slips, theta)
        return self._changed()

    def moved(self, end: Array) -> Array:
        """How E changes with x, and with what `changed` was last asked for."""
        values(self._moving)[:] = end
        return np.concatenate([rub.at_points(change) for rub, change in zip(self._rubs, self._moved, strict=True)])

    def _aim(self, start: Array, slips: Array, theta: Sequence[Array]) -> None:
        values(self._starting)[:] = start
        for rub, change in zip(self._rubs, np.split(slips, self._ends), strict=True):
            values(rub.change)[:] = change
        for part, way in zip(self._parts, theta, strict=True):
            part.turn(way)

    @cached_property
    def _changed(self) -> Callable[[], Array]:
        test = self.body.fes.TestFunction()
        moved = self._tractions(test, start=self._starting, slips=True)
        still = self._tractions(test)
        along = [term for part in self._parts for term in part.along(still)]
        return vector(self.body.fes, by(moved, self._y) + along)

    @cached_property
    def _moved(self) -> list[ngs.CoefficientFunction]:
        found = []
        for rub in self._rubs:
            moved = self._slipping(rub, self._moving, self._starting, rub.rub.slip + self._y * rub.change).elastic
            change = moved.Diff(self._y) + moved.Diff(self._x)
            still = [Term(self._slipping(rub).elastic, rub.rub.measure)]
            for part in self._parts:
                for term in part.along(still):
                    change = change + term.coef
            found.append(change.Compile())
        return found

    # The tangent.

    def join_tangent(self, form: ngs.BilinearForm) -> None:
        """Add to a form how tractions change with x: pressures and normals with them."""
        trial, test = self.body.fes.TnT()
        for term in by(self._tractions(test, end=trial), self._x):
            form += term.integral

    # Expressions.

    def _slipping(
        self,
        rub: _Fields,
        end: Motion | None = None,
        start: Motion | None = None,
        slip: ngs.CoefficientFunction | None = None,
    ) -> Slipping:
        """A friction with x and y moved along motions, by numbers that are zero."""
        body, layout = self.body, self.body.layout
        u, offset, y = body.u, body.offset, layout.fields(body.friction.start).u
        if end is not None:
            moves = layout.fields(end)
            u, offset = u + self._x * moves.u, offset + self._x * moves.offset
        if start is not None:
            y = y + self._y * layout.fields(start).u
        of = rub.rub
        return Slipping(of.friction, u, offset, y, of.slip if slip is None else slip, of.start, of.way_gone)

    def _density(self, rub: _Fields, at: Slipping, motion: Motion | None) -> ngs.CoefficientFunction:
        """Of ℓ."""
        slipped = ngs.InnerProduct(rub.weight, at.elastic)
        if motion is None:
            return slipped
        return slipped + ngs.InnerProduct(at.traction, at.along(self.body.layout.fields(motion).u))

    def _work(self, motion: Motion | None, end: Motion | None = None, start: Motion | None = None) -> Terms:
        """ℓ."""
        weight = self.body.kinematics.weight()
        return [
            Term(weight * self._density(rub, self._slipping(rub, end, start), motion), rub.rub.measure)
            for rub in self._rubs
        ]

    def _tractions(
        self, test: Motion, end: Motion | None = None, start: Motion | None = None, slips: bool = False
    ) -> Terms:
        """∫ τ · λ_t dA of a test function; with slips moved along their change by the number of the start."""
        found, weight = [], self.body.kinematics.weight()
        for rub in self._rubs:
            slip = rub.rub.slip + self._y * rub.change if slips else None
            at = self._slipping(rub, end, start, slip)
            work = ngs.InnerProduct(at.traction, at.along(self.body.layout.fields(test).u))
            found.append(Term(weight * work, rub.rub.measure))
        return found


class _Fields:
    """Weights and change of one friction's slip, at the points of its wall."""

    def __init__(self, rub: Rub) -> None:
        self.rub = rub
        self.weight, self.change, self._found = (ngs.GridFunction(rub.slip.space) for _ in range(3))

    def at_points(self, function: ngs.CoefficientFunction) -> Array:
        """Values of a vector, one component after the other."""
        self._found.Interpolate(function, definedon=self.rub.on)
        return values(self._found).copy()


class SlidingTangents:
    """The whole tangent of a body that rubs, at whatever state it stands, factorised with pivots.

    It is a system for Newton's method too, which settles in few steps where the symmetric tangent would creep.
    """

    def __init__(self, body: Problem, friction: FrictionStep) -> None:
        self.body, self.factorisations, self.solves = body, 0, 0
        self._form = ngs.BilinearForm(body.fes)
        for part in body.tissue.terms:
            self._form += part
        for term in body.terms[1:]:
            if term is not body.friction:
                term.join(self._form)
        friction.join_tangent(self._form)
        free = body.weights > 0
        self._free, self._held = free.astype(float), ngs.BitArray(free.tolist())
        self._vectors = body.gfu.vec.CreateVector(), body.gfu.vec.CreateVector()

    # What Newton's method asks (solvers.newton.System).

    @property
    def weights(self) -> Array:
        """Of the body."""
        return self.body.weights

    def residual(self, x: Array) -> tuple[Array, float]:
        """Of the body."""
        return self.body.residual(x)

    def min_det(self, x: Array) -> float:
        """Of the body."""
        return self.body.min_det(x)

    def factorise(self, x: Array, r: Array) -> Solve:
        """The solver at x."""
        self.body.residual(x)
        return self.here(1)

    # What derivatives of a run ask.

    def here(self, sides: int, exact: float = 0.0) -> Solve:
        """A solver, of use until the next is asked for."""
        flows = self.body.history.flows
        if flows:
            flows.stiffen()
        self.body.form.AssembleLinearization(self.body.gfu.vec)
        self._form.AssembleLinearization(self.body.gfu.vec)
        try:
            self._inverse = self._form.mat.Inverse(self._held, inverse="umfpack")
        except Exception as error:  # NGSolve raises bare exceptions of several kinds here
            raise SolverError(f"a step of a body that rubs has no derivative: {error}") from error
        self.factorisations += 1
        return lambda r: self._times(self._inverse, r * self._free)

    def transposed(self, r: Array) -> Array:
        """K⁻ᵀ r, with the factor of `here`."""
        return self._times(self._inverse.T, r * self._free)

    def apply(self, x: Array) -> Array:
        """Of the tangent without what pressures and normals change in friction, as `Tangents` has it."""
        return self._times(self.body.form.mat, x, whole=True)

    def _times(self, matrix: ngs.BaseMatrix, r: Array, whole: bool = False) -> Array:
        self.solves += not whole
        vec, image = self._vectors
        vec.FV().NumPy()[:] = r
        image.data = matrix * vec
        found = np.array(image.FV().NumPy())
        return found if whole else found * self._free
