"""Any model inverted by one call: its parameters from what was measured and how noisy that is.

What is usual is taken: values that are positive where the search begins stay so (ln), fields are smooth, how much by the evidence,
numbers are held by the data alone, Levenberg and Marquardt go down. `Reduced` and the optimisers are there for all else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.adjoint.reduced import Reduced, Regulariser
from ngbrain.errors import InputError, nearest
from ngbrain.forward.sensitivity.static_model import StaticModel
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.parameters import LogTransform, ParameterFields, ScaledTransform, Unknown
from ngbrain.inverse.objective.regularisation import smooth
from ngbrain.inverse.optimise.levenberg_marquardt import levenberg_marquardt
from ngbrain.inverse.optimise.result import Iteration, plot_misfit_history
from ngbrain.inverse.uncertainty.posterior import Posterior
from ngbrain.progress import log_progress, reporting
from ngbrain.result import Result

Array = np.ndarray
Holds = Callable[[ngs.FESpace, Array], Regulariser]
DETERMINED = 2.0
"""A positive number counts as determined where its 95 % interval spans less than this factor."""
FIRST = 0.05
"""Weight of regularisers to begin with, for each number of data."""


@dataclass(repr=False, eq=False)
class ParameterEstimate(Result):
    """What was found. The model's parameters have these values now.

    values   name → a number, or the unknowns of a field
    misfit   over what noise leaves: 1 where the data are fitted as well as it allows, more where the model misses something
    problem  the objective, for optimisers and bars of one's own
    x        its unknowns there
    """

    values: dict[str, float | Array]
    misfit: float
    problem: Reduced
    x: Array

    @property
    def value(self) -> dict[str, float | Array]:
        """Of each parameter."""
        return self.values

    @property
    def statistics(self) -> dict[str, float]:
        """Of the search."""
        return {"iterations": len(self.history), "cpu_s": self.history[-1].cpu_s}

    def plot(self) -> Any:
        """The misfit over iterations."""
        return plot_misfit_history(self.history)

    @cached_property
    def posterior(self) -> Posterior:
        """Error bars: `recovered.posterior.interval("mu")`. Raises `InputError` where data leave a number open."""
        return Posterior(self.problem.evaluate(self.x))

    @cached_property
    def undetermined(self) -> dict[str, str]:
        """Numbers that the data do not determine, positive ones not within a factor of `DETERMINED`: why, by name.

        Whatever their values are: another start may end elsewhere at the same misfit.
        """
        numbers = {name: value for name, value in self.values.items() if isinstance(value, float)}
        try:
            intervals = {name: self._interval(name) for name in numbers}
        except InputError as error:
            return dict.fromkeys(numbers, f"not determined: {error}")
        return {
            name: f"not determined: 95 % between {low:.3g} and {high:.3g}"
            for name, (low, high) in intervals.items()
            if numbers[name] > 0 and not high < DETERMINED * low
        }

    def _interval(self, name: str) -> tuple[float, float]:
        """95 % of a number."""
        band = self.posterior.interval(name)
        return float(np.ravel(band.low)[0]), float(np.ravel(band.high)[0])

    def __str__(self) -> str:
        """Each number with its 95 % interval, or that it is not determined; fields by their mean."""
        lines = []
        for name, value in self.values.items():
            if not isinstance(value, float):
                lines.append(f"{name}: a field, {np.mean(value):.4g} in the mean")
            elif name in self.undetermined:
                lines.append(f"{name}: {self.undetermined[name]}")
            else:
                low, high = self._interval(name)
                lines.append(f"{name}: {value:.4g}, 95 % between {low:.4g} and {high:.4g}")
        settled = "" if self.converged else f", {self.status}"
        return "\n".join([*lines, f"misfit {self.misfit:.2g} times what noise leaves{settled}"])


@reporting()
def estimate(
    model: StaticModel | RunModel,
    measured: Array,
    noise: float | Array,
    *,
    unknowns: Mapping[str, Unknown] | None = None,
    regulariser: Holds = smooth,
    callback: Callable[[Iteration], None] = log_progress,
) -> ParameterEstimate:
    """Parameters of a model such that its data are the measured ones, from the values that they have now.

    measured     as `model.evaluate(θ).data`; NaN where nothing was measured
    noise        relative, of the rms of each observation; or standard deviations, shaped as the data
    unknowns     name → `Unknown`, where a start or a change of variable is not as usual
    regulariser  of fields, from their space and where they start: one of `regularise`

    Raises `InputError` for data or noise of another shape, a noise that is not positive, a parameter that starts at nothing and
    is not among `unknowns`; `ConvergenceError` where no step lowers the misfit; what the model raises at its start.

    >>> import ngsolve as ngs
    >>> from ngbrain.forward.sensitivity.static_model import LoadCase
    >>> from ngbrain.forward.common.material import Material
    >>> from ngbrain.forward.observables import Force
    >>> from ngbrain.forward.solid.problem import Problem
    >>> from ngbrain.materials import NeoHooke
    >>> from ngbrain.mesh import block
    >>> mu = ngs.Parameter(1e3)
    >>> body = Problem(block(), {".*": Material(NeoHooke(mu), 1e4)}, {"bottom": 0, "top": (0, 0, -4e-3)}, element="P2")
    >>> model = StaticModel([LoadCase(body, [Force("top")])], {"mu": mu})
    >>> force = model.evaluate(model.theta).data
    >>> mu.Set(500.0)
    >>> round(estimate(model, force, 0.01).values["mu"], -1), round(mu.Get(), -1)
    (1000.0, 1000.0)
    """
    measured, spaces, given = np.asarray(measured, float), _spaces(model), dict(unknowns or {})
    for name in given:
        if name not in model.blocks:
            raise InputError("unknowns", repr(name), nearest(name, model.blocks))
    misfit = LeastSquares(measured, _deviations(model, measured, noise))
    theta = model.theta
    fields = ParameterFields(
        theta,
        model.blocks,
        {name: given.get(name) or _usual(name, theta[block]) for name, block in model.blocks.items()},
    )
    held = {name: regulariser(space, fields.start[fields.blocks[name]]) for name, space in spaces.items()}
    problem = Reduced(model, misfit, fields, held, dict.fromkeys(held, FIRST * misfit.count))
    found = levenberg_marquardt(problem, fields.start, callback=callback)
    problem.evaluate(found.x)  # the parameters have what was found
    values = {name: v if name in spaces else float(v[0]) for name, v in fields.values(found.x).items()}
    return ParameterEstimate(values, found.level.ratio, problem, found.x, status=found.status, history=found.history)


def _spaces(model: StaticModel | RunModel) -> dict[str, ngs.FESpace]:
    """Of the parameters that are fields."""
    parts = model.parts if isinstance(model, StaticModel) else model.parameters
    fields = {name: getattr(part, "gfu", part) for name, part in parts.items()}
    return {name: gfu.space for name, gfu in fields.items() if isinstance(gfu, ngs.GridFunction)}


def _usual(name: str, start: Array) -> Unknown:
    """What is positive stays so; what is not is looked for in units of its size."""
    if np.all(start > 0):
        return Unknown(start, LogTransform())
    if not np.any(start):
        wanted = "a start of its size, or `unknowns` with an Unknown(start, Scaled(size))"
        raise InputError(f"parameters.{name}", "nothing where the search begins", wanted)
    return Unknown(start, ScaledTransform(float(np.abs(start).max())))


def _deviations(model: StaticModel | RunModel, measured: Array, noise: float | Array) -> Array:
    """Standard deviations of the data."""
    if np.ndim(noise):
        return np.asarray(noise, float)
    if not noise > 0:
        raise InputError("noise", noise, "a positive part of the rms of each observation, or standard deviations")
    sigma = np.empty(measured.shape)
    for where in model.observation_slices:
        sigma[..., where] = noise * np.sqrt(np.nanmean(measured[..., where] ** 2))
    return sigma
