"""Parameters of a static or transient model by one call, from measured data and their noise.

The usual choices are made: parameters that are positive initially stay positive (logarithm), fields are smooth with a weight from
the evidence, numbers have no prior, and the optimiser is Levenberg-Marquardt. For other choices use `Reduced` and the optimisers.
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
RegulariserFactory = Callable[[ngs.FESpace, Array], Regulariser]
DETERMINED = 2.0
"""A positive number counts as determined if its 95 % interval spans less than this factor."""
FIRST = 0.05
"""Initial weight of regularisers, per datum."""


@dataclass(repr=False, eq=False)
class ParameterEstimate(Result):
    """Estimated parameters; the parameters of the model have these values.

    Parameters
    ----------
    values : dict of str to float or array
        Number, or coefficients of a field, by name.
    misfit : float
        Misfit over its expected value: 1 where the data are fitted to their noise, more where the model has an error.
    problem : Reduced
        Objective, for other optimisers and intervals.
    x : array (n,)
        Unknowns of the objective.
    """

    values: dict[str, float | Array]
    misfit: float
    problem: Reduced
    x: Array

    @property
    def value(self) -> dict[str, float | Array]:
        """Value of each parameter."""
        return self.values

    @property
    def statistics(self) -> dict[str, float]:
        """Number of iterations and CPU time."""
        return {"iterations": len(self.history), "cpu_s": self.history[-1].cpu_s}

    def plot(self) -> Any:
        """Figure of the misfit over the iterations."""
        return plot_misfit_history(self.history)

    @cached_property
    def posterior(self) -> Posterior:
        """Posterior, for example `found.posterior.interval("mu")`; `InputError` where the data leave a number undetermined."""
        return Posterior(self.problem.evaluate(self.x))

    @cached_property
    def undetermined(self) -> dict[str, str]:
        """Numbers that the data do not determine, with the reason; positive ones not within a factor of `DETERMINED`.

        Their values are arbitrary: another initial guess may lead to others with the same misfit.
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
        """95 % interval of a number."""
        interval = self.posterior.interval(name)
        return float(np.ravel(interval.low)[0]), float(np.ravel(interval.high)[0])

    def __str__(self) -> str:
        """Each number with its 95 % interval or that it is not determined; fields by their mean."""
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
        return "\n".join([*lines, f"misfit {self.misfit:.2g} times its expected value{settled}"])


@reporting()
def estimate(
    model: StaticModel | RunModel,
    measured: Array,
    noise: float | Array,
    *,
    unknowns: Mapping[str, Unknown] | None = None,
    regulariser: RegulariserFactory = smooth,
    callback: Callable[[Iteration], None] = log_progress,
) -> ParameterEstimate:
    """Estimate the parameters of a model from measured data, starting from their current values.

    Parameters
    ----------
    model : StaticModel or RunModel
        Model.
    measured : array
        Measured data, shaped as `model.evaluate(θ).data`. NaN where nothing was measured.
    noise : float or array
        Relative noise, of the rms of each observation; or standard deviations, shaped as the data.
    unknowns : mapping of str to Unknown, optional
        Parameters with an initial guess or transform other than the default.
    regulariser : callable
        Regulariser of fields, from their space and initial guess; see `objective.regularisation`.
    callback : callable
        Called with each `Iteration`.

    Returns
    -------
    ParameterEstimate

    Raises
    ------
    InputError
        For data or noise of another shape, noise that is not positive, or a parameter that is zero initially and not among
        `unknowns`.
    ConvergenceError
        If no step lowers the misfit. Errors of the model at the initial guess are raised too.

    Examples
    --------
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
        {name: given.get(name) or _default_unknown(name, theta[block]) for name, block in model.blocks.items()},
    )
    held = {name: regulariser(space, fields.start[fields.blocks[name]]) for name, space in spaces.items()}
    problem = Reduced(model, misfit, fields, held, dict.fromkeys(held, FIRST * misfit.count))
    found = levenberg_marquardt(problem, fields.start, callback=callback)
    problem.evaluate(found.x)  # sets the parameters of the model
    values = {name: v if name in spaces else float(v[0]) for name, v in fields.values(found.x).items()}
    return ParameterEstimate(values, found.level.ratio, problem, found.x, status=found.status, history=found.history)


def _spaces(model: StaticModel | RunModel) -> dict[str, ngs.FESpace]:
    """Spaces of the parameters that are fields."""
    parts = model.parts if isinstance(model, StaticModel) else model.parameters
    fields = {name: getattr(part, "gfu", part) for name, part in parts.items()}
    return {name: gfu.space for name, gfu in fields.items() if isinstance(gfu, ngs.GridFunction)}


def _default_unknown(name: str, start: Array) -> Unknown:
    """Default unknown: positive parameters by their logarithm, others scaled by their size."""
    if np.all(start > 0):
        return Unknown(start, LogTransform())
    if not np.any(start):
        wanted = "an initial value of its size, or `unknowns` with an Unknown(start, ScaledTransform(size))"
        raise InputError(f"parameters.{name}", "zero initially", wanted)
    return Unknown(start, ScaledTransform(float(np.abs(start).max())))


def _deviations(model: StaticModel | RunModel, measured: Array, noise: float | Array) -> Array:
    """Standard deviations of the data."""
    if np.ndim(noise):
        return np.asarray(noise, float)
    if not noise > 0:
        raise InputError("noise", noise, "a positive share of the rms of each observation, or standard deviations")
    sigma = np.empty(measured.shape)
    for where in model.observation_slices:
        sigma[..., where] = noise * np.sqrt(np.nanmean(measured[..., where] ** 2))
    return sigma
