"""Newton's method that reuses its factorisation and never accepts an inverted or non-finite state.

It is error-oriented: convergence is judged by the correction M⁻¹R, which does not depend on how the equations are scaled
against one another, rather than by the residual, which stays finite and may even decrease at inverted states. The factorisation
is kept across iterations and calls. Broyden's good update (QNERR) gives superlinear convergence with it. It is renewed only when
contraction is too slow.

References
----------
Deuflhard, Newton Methods for Nonlinear Problems (2004), sections 2.1.4 and 3.3, https://doi.org/10.1007/978-3-642-23899-4.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np

from ngbrain.errors import Breakdown
from ngbrain.result import Status
from ngbrain.solvers.record import NewtonRecord

Array = np.ndarray
LOG = logging.getLogger(__name__)

UNLOADED = 0.05
"""Smallest scale of the residual, as a fraction of the largest reactions so far: at rest reactions are zero."""


class System(Protocol):
    """A nonlinear system R(x) = 0. Vectors are arrays over all degrees of freedom, zero where these are fixed."""

    @property
    def weights(self) -> Array:
        """Diagonal of the inner product that measures corrections: 1/scale² of each degree of freedom (n,)."""

    def residual(self, x: Array) -> tuple[Array, float]:
        """Residual at x on the free degrees of freedom, and the norm of the reactions, which is its scale."""

    def factorise(self, x: Array, r: Array) -> Callable[[Array], Array]:
        """Solver with the tangent M at x; it may be inexact if it is accurate for r.

        Parameters
        ----------
        x : array (n,)
            State.
        r : array (n,)
            Residual at x.

        Returns
        -------
        callable
            r → M⁻¹ r.

        Raises
        ------
        FloatingPointError
            Where the tangent cannot be factorised.
        """

    def min_det(self, x: Array) -> float:
        """Smallest det F over all quadrature points; NaN counts as inverted."""


@dataclass
class Newton:
    """Settings of Newton's method, and what it keeps from call to call: the factorisation and the largest reactions.

    Parameters
    ----------
    rtol : float
        Residual relative to the reactions at convergence.
    xtol : float
        Largest weighted correction at convergence (dimensionless, by the weights).
    max_iter : int
        Largest number of iterations.
    max_factorisations : int
        Largest number of factorisations.
    min_det : float
        States with a smaller det F are not accepted.
    max_contraction : float
        The factorisation is renewed where a correction shrinks by less than this factor; 0 with `spare_iterations` 0: always.
    spare_iterations : int
        It is not renewed where so many more iterations at that rate would converge.
    min_damping : float
        Smallest fraction of a step from a new factorisation that is tried.
    max_climbs : int
        Full steps from new factorisations that may increase the correction, in a row, before they are taken back and damped. With
        a stiff bulk modulus and no pressure, the old tangent takes a rotated state for a distant one.
    inverse : callable, optional
        The factorisation: r → M⁻¹ r.
    largest : float
        The largest reactions so far.
    """

    rtol: float = 2e-7
    xtol: float = 1e-5
    max_iter: int = 40
    max_factorisations: int = 10
    min_det: float = 0.02
    max_contraction: float = 0.7
    spare_iterations: int = 6
    min_damping: float = 0.1
    max_climbs: int = 0
    inverse: Callable[[Array], Array] | None = None
    largest: float = 0.0

    def solve(self, system: System, x: Array) -> tuple[Array, NewtonRecord]:
        """Solve R(x) = 0.

        Parameters
        ----------
        system : System
            The system.
        x : array (n,)
            Initial guess.

        Returns
        -------
        x : array (n,)
            Last accepted state.
        record : NewtonRecord
            With `converged`, and the reason where it is false.
        """
        record = NewtonRecord()
        try:
            x = self._iterate(system, x, record)
        except ArithmeticError as error:  # underflow included
            record.reason, record.status = str(error), getattr(error, "status", Status.STALLED)
        if record.reason:
            self.inverse = None
        work, end = record.work, record.reason or "converged"
        LOG.debug("%s: %d iterations, %d factorisations", end, record.iterations, work.factorisations)
        return x, record

    def _iterate(self, system: System, x: Array, record: NewtonRecord) -> Array:
        weights = system.weights
        record.min_det_F = system.min_det(x)
        if not record.min_det_F > self.min_det:
            said = f"the starting state is inverted (smallest det F {record.min_det_F:.3g})"
            raise Breakdown(said, Status.INVERTED)
        r, reactions = _residual(system, x, record)
        if not _finite(r, reactions):
            raise Breakdown("the residual is not finite", Status.NOT_FINITE)
        chain: list[tuple[Array, float]] = []
        fresh, climbs, foot = False, 0, (x, r, np.inf)
        while record.iterations < self.max_iter:
            if self.inverse is None:
                if record.work.factorisations == self.max_factorisations:
                    raise Breakdown(f"no convergence with {self.max_factorisations} factorisations")
                self.inverse = system.factorise(x, r)
                record.work.factorisations += 1
                chain, fresh = [], True
            if not chain:
                step = -self._backsolve(r, record)
                chain = [(step, _size(step, weights))]
                if chain[0][1] < foot[2]:
                    climbs, foot = 0, (x, r, chain[0][1])
            record.iterations += 1
            record.history.append((float(np.linalg.norm(r)), chain[-1][1]))
            LOG.debug("iteration %d: residual %.3e, correction %.3e", record.iterations, *record.history[-1])
            trial = self._trial(system, x, chain[-1], record, damped=fresh and climbs == self.max_climbs)
            if trial is None:
                self.inverse = None
                if fresh:
                    x, r, climbs = self._climb(system, x, chain[-1][0], record, climbs) or (*foot[:2], self.max_climbs)
                    fresh = False
                continue
            x, r, reactions, v, damping = trial
            self.largest = max(self.largest, reactions)
            if (
                np.linalg.norm(r) <= self.rtol * max(reactions, UNLOADED * self.largest)
                and _size(v, weights) <= self.xtol
            ):
                record.status = Status.CONVERGED
                return x
            fresh = False
            if damping < 1:
                self.inverse = None
                continue
            v, contraction = _broyden(chain, v, weights)
            chain.append((v, _size(v, weights)))
            if contraction > self.max_contraction and chain[-1][1] * contraction**self.spare_iterations > self.xtol:
                self.inverse = None
        record.status = Status.STALLED
        record.reason = f"no convergence in {self.max_iter} iterations (last correction {record.value:.1e})"
        return x

    def _trial(
        self, system: System, x: Array, last: tuple[Array, float], record: NewtonRecord, damped: bool
    ) -> tuple[Array, Array, float, Array, float] | None:
        """Take the step if the next correction shrinks (natural monotonicity test); else halve it if `damped`, or give None."""
        step, size = last
        if not np.isfinite(size):
            raise Breakdown("the tangent gave a correction that is not finite", Status.NOT_FINITE)
        damping = 1.0
        while damping > self.min_damping:
            candidate = x + damping * step
            det = system.min_det(candidate)
            finite = False  # non-finite energies are refused like inverted elements
            if det > self.min_det:
                r, reactions = _residual(system, candidate, record)
                finite = _finite(r, reactions)
            if finite:
                v = -self._backsolve(r, record)
                if _size(v, system.weights) <= (1 - damping / 4) * size or size <= self.xtol:
                    record.min_det_F = det
                    return candidate, r, reactions, v, damping
            if not damped:
                return None
            damping /= 2
        how = "the last trial" if finite else "the last trial has no finite forces"
        how = how if det > self.min_det else "the last trial is inverted"
        status = Status.STALLED if finite else Status.NOT_FINITE if det > self.min_det else Status.INVERTED
        raise Breakdown(f"no acceptable step ({how}, smallest det F {det:.3g})", status)

    def _climb(
        self, system: System, x: Array, step: Array, record: NewtonRecord, climbs: int
    ) -> tuple[Array, Array, int] | None:
        """The full step without the monotonicity test, if allowed."""
        if climbs == self.max_climbs or not system.min_det(x + step) > self.min_det:
            return None
        r, reactions = _residual(system, x + step, record)
        return (x + step, r, climbs + 1) if _finite(r, reactions) else None

    def _backsolve(self, r: Array, record: NewtonRecord) -> Array:
        assert self.inverse is not None
        record.work.solves += 1
        return self.inverse(r)


def _size(v: Array, weights: Array) -> float:
    return float(np.sqrt(weights @ (v * v)))


def _residual(system: System, x: Array, record: NewtonRecord) -> tuple[Array, float]:
    r, reactions = system.residual(x)
    record.work.residuals += 1
    return r, reactions


def _finite(r: Array, reactions: float) -> bool:
    return bool(np.isfinite(reactions) and np.all(np.isfinite(r)))


def _broyden(chain: list[tuple[Array, float]], v: Array, weights: Array) -> tuple[Array, float]:
    """Next step of Broyden's good update, and the contraction; only steps are stored."""
    for (before, size), (after, _) in pairwise(chain):
        v = v + (weights * v) @ before / size**2 * after
    step, size = chain[-1]
    alpha = float((weights * v) @ step) / size**2
    contraction = _size(v, weights) / size
    return (v / (1 - alpha) if alpha < 0.9 else v), contraction
