"""How an inversion selects its regularisation weights: by a policy during the descent, or from an L-curve.

- "evidence": the weight of each field by evidence maximisation (`regularisation_weight.Evidence`).
- "discrepancy": one factor for all, to the expected misfit (`regularisation_weight.DiscrepancyPrinciple`).
- "l-curve": one factor for all, where the misfit stops falling and the energy of the regularisers begins to rise. It needs no
  noise level and takes several times as long.

References
----------
Hansen and O'Leary 1993, 10.1137/0914086.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import ConvergenceError, InputError, nearest
from ngbrain.inverse.optimise.gauss_newton import MAX_ITERATIONS, GaussNewton
from ngbrain.inverse.optimise.regularisation_weight import (
    DiscrepancyPrinciple,
    Evidence,
    FixedWeights,
    WeightPolicy,
    l_curve_corner,
)
from ngbrain.inverse.optimise.result import Iteration, OptimisationResult

Array = np.ndarray
Callback = Callable[[Iteration], None]
POINTS, ABOVE, BELOW = 9, 3.0, 1.0
"""Number of points of an L-curve, and its range in decades above and below the weights of the initial guess: a noise level stated
too small leads to weights that are too low.
"""
ITERATIONS_PER_POINT = 4
"""Iterations at each point: neighbouring points are similar, and only the corner is refined."""


@dataclass(frozen=True)
class WeightSelection:
    """Weights that a policy updates during the inversion.

    Parameters
    ----------
    policy : callable
        Constructor of a `WeightPolicy`.
    max_iterations : int
        Maximum number of iterations of a descent.
    """

    policy: Callable[[], WeightPolicy] = Evidence
    max_iterations: int = 8 * MAX_ITERATIONS

    def from_waves(self, reduced: Reduced, x: Array, waves: Array, callback: Callback) -> OptimisationResult:
        """Run `GaussNewton.from_waves`; the final weights stay in `reduced`.

        Parameters
        ----------
        reduced : Reduced
            Objective.
        x : array (n,)
            Initial guess of the unknowns.
        waves : array (loads, ndof)
            Measured waves.
        callback : callable
            Called with each `Iteration`.

        Returns
        -------
        OptimisationResult
        """
        return GaussNewton(reduced, self.policy(), callback).from_waves(x, waves)

    def descend(self, reduced: Reduced, x: Array, callback: Callback) -> OptimisationResult:
        """Run `GaussNewton.descend`; the final weights stay in `reduced`.

        Parameters
        ----------
        reduced : Reduced
            Objective.
        x : array (n,)
            Initial guess of the unknowns.
        callback : callable
            Called with each `Iteration`.

        Returns
        -------
        OptimisationResult
        """
        return GaussNewton(reduced, self.policy(), callback).descend(x, self.max_iterations)


@dataclass(frozen=True)
class LCurve(WeightSelection):
    """Weights at the corner of an L-curve: minima of J at falling weights, each started from the previous.

    Weights keep their ratios.

    Initial guesses use `policy`; the curve is centred on their weights.

    Parameters
    ----------
    policy : callable
        Constructor of a `WeightPolicy`.
    max_iterations : int
        Maximum number of iterations at the corner.
    points : int
        Number of points.
    above, below : float
        Decades above and below the weights of the initial guess.

    Examples
    --------
    >>> from ngbrain.inverse.phantoms.benchmark import Phantom
    >>> inversion = Phantom.from_name("CV-G", 9).simulate_measurements(0.02).inversion(weight=100.0)
    >>> found = LCurve().descend(inversion.reduced, inversion.start, lambda _: None)
    >>> 0.8 < found.level.ratio < 1.3
    True
    """

    points: int = POINTS
    above: float = ABOVE
    below: float = BELOW

    def descend(self, reduced: Reduced, x: Array, callback: Callback) -> OptimisationResult:
        """Find the minimum at the corner of the L-curve.

        Parameters
        ----------
        reduced : Reduced
            Objective.
        x : array (n,)
            Initial guess of the unknowns.
        callback : callable
            Called with each `Iteration`.

        Returns
        -------
        OptimisationResult

        Raises
        ------
        ConvergenceError
            If J could be lowered at fewer than three weights.
        """
        middle, misfits, energies, ends = (
            dict(reduced.weights),
            list[float](),
            list[float](),
            list[OptimisationResult](),
        )
        for factor in np.logspace(self.above, -self.below, self.points):
            reduced.weights = {name: float(factor * weight) for name, weight in middle.items()}
            try:
                found = GaussNewton(reduced, FixedWeights(), callback).descend(x, ITERATIONS_PER_POINT)
            except ConvergenceError:
                continue
            x = found.x
            misfits.append(found.level.misfit)
            energies.append(reduced.regular(x) / factor)
            ends.append(found)
        if len(ends) < 3:
            raise ConvergenceError("an L-curve of fewer than three points has no corner: try another weight")
        chosen = ends[l_curve_corner(np.array(misfits), np.array(energies))]
        reduced.weights = dict(chosen.weights)
        return self._refine_corner(reduced, chosen, callback)

    def _refine_corner(self, reduced: Reduced, chosen: OptimisationResult, callback: Callback) -> OptimisationResult:
        try:
            return GaussNewton(reduced, FixedWeights(), callback).descend(chosen.x, self.max_iterations)
        except ConvergenceError:  # already a minimum
            return chosen


WEIGHTINGS: dict[str, WeightSelection] = {
    "evidence": WeightSelection(Evidence),
    "discrepancy": WeightSelection(DiscrepancyPrinciple),
    "l-curve": LCurve(),
}


def weight_selection(name: str) -> WeightSelection:
    """Return one of `WEIGHTINGS`; `InputError` for an unknown name.

    >>> weight_selection("l-curve").points
    9
    """
    if name not in WEIGHTINGS:
        raise InputError("weight", repr(name), nearest(name, tuple(WEIGHTINGS)))
    return WEIGHTINGS[name]
