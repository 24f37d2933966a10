"""How an inversion comes to its weights: they settle with the fields, or a curve is drawn and its corner taken.

evidence     each field's weight where the data, given the weights, are most probable (`weights.Evidence`)
discrepancy  one factor for all, to where the misfit is what the noise leaves (`weights.Discrepancy`)
l-curve      one factor for all, where the misfit stops falling and the regulariser's energy begins to rise: it asks for no
             level of noise, and takes several times as long

Source: Hansen and O'Leary 1993, 10.1137/0914086.
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
Tell = Callable[[Iteration], None]
POINTS, ABOVE, BELOW = 9, 3.0, 1.0
"""Of an L-curve, and how many decades it reaches above and below the weights that the start has left: noise stated too small
leaves weights that are too low."""
PASSING = 4
"""Rounds at each of its points: they are near to one another, and only the corner is visited again."""


@dataclass(frozen=True)
class WeightSelection:
    """Weights that a policy changes with the fields, in so many `rounds` of a descent at most."""

    policy: Callable[[], WeightPolicy] = Evidence
    max_iterations: int = 8 * MAX_ITERATIONS

    def from_waves(self, reduced: Reduced, x: Array, waves: Array, callback: Tell) -> OptimisationResult:
        """`GaussNewton.from_waves`; the weights it ends with stay in `reduced`."""
        return GaussNewton(reduced, self.policy(), callback).from_waves(x, waves)

    def descend(self, reduced: Reduced, x: Array, callback: Tell) -> OptimisationResult:
        """`GaussNewton.descend`, likewise."""
        return GaussNewton(reduced, self.policy(), callback).descend(x, self.max_iterations)


@dataclass(frozen=True)
class LCurve(WeightSelection):
    """The corner of an L-curve: minima of J at falling weights, each from the one before; weights keep their ratios.

    Starts settle by `policy`, around whose weights the curve lies.

    >>> from ngbrain.inverse.phantoms.benchmark import Phantom
    >>> inversion = Phantom.from_name("CV-G", 9).simulate_measurements(0.02).inversion(weight=100.0)
    >>> found = LCurve().descend(inversion.reduced, inversion.start, lambda _: None)
    >>> 0.8 < found.level.ratio < 1.3
    True
    """

    points: int = POINTS
    above: float = ABOVE
    below: float = BELOW

    def descend(self, reduced: Reduced, x: Array, callback: Tell) -> OptimisationResult:
        """From x to the minimum at the corner; `ConvergenceError` where J is lowered at fewer than three weights."""
        middle, misfits, energies, ends = (
            dict(reduced.weights),
            list[float](),
            list[float](),
            list[OptimisationResult](),
        )
        for factor in np.logspace(self.above, -self.below, self.points):
            reduced.weights = {name: float(factor * weight) for name, weight in middle.items()}
            try:
                found = GaussNewton(reduced, FixedWeights(), callback).descend(x, PASSING)
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
        return self._settled(reduced, chosen, callback)

    def _settled(self, reduced: Reduced, chosen: OptimisationResult, callback: Tell) -> OptimisationResult:
        try:
            return GaussNewton(reduced, FixedWeights(), callback).descend(chosen.x, self.max_iterations)
        except ConvergenceError:  # there is nothing below
            return chosen


WEIGHTINGS: dict[str, WeightSelection] = {
    "evidence": WeightSelection(Evidence),
    "discrepancy": WeightSelection(DiscrepancyPrinciple),
    "l-curve": LCurve(),
}


def weight_selection(name: str) -> WeightSelection:
    """One of `WEIGHTINGS`; `InputError` for another name.

    >>> weight_selection("l-curve").points
    9
    """
    if name not in WEIGHTINGS:
        raise InputError("weight", repr(name), nearest(name, tuple(WEIGHTINGS)))
    return WEIGHTINGS[name]
