"""Least-squares fit of the parameters of a law to measured curves, with confidence intervals."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, cast

import ngsolve as ngs
import numpy as np
import scipy

from ngbrain.errors import ConvergenceError, InputError, SolverError, require
from ngbrain.look import STYLE, figure
from ngbrain.materials.base import Law
from ngbrain.materials.lab.curves import Curve, check_curves
from ngbrain.materials.lab.modes import MODES
from ngbrain.materials.lab.relaxing import history
from ngbrain.materials.lab.specimen import Specimen
from ngbrain.materials.viscous import Viscous
from ngbrain.result import Result, Status

Bounds = tuple[float, float]
FREE: Bounds = (-np.inf, np.inf)
SAME_OPTIMUM = 1e-6
"""Relative difference of the sums of squares below which two starts count as the same optimum."""
DRAWS = 100


@dataclass(repr=False, eq=False)
class Fit(Result):
    """Result of a fit.

    Parameters
    ----------
    parameters : dict of str to float
        Name → best value.
    confidence : dict of str to tuple of (float, float)
        Name → ends of the 95 % interval (t-distribution, linearised at the optimum); nan at an active bound,
        infinite where the data do not identify the parameter.
    r2 : dict of str to float
        Curve → coefficient of determination 1 - Σ(P - data)²/Σ(data - mean)².
    residual : float
        Root mean square of the scaled residuals.
    active : dict of str to float
        Name → active bound.
    reached : int
        Number of starts that ended at this optimum.
    starts : int
        Number of starts.
    law : Law or Viscous
        The law with the best parameters.
    curves : list of Curve
        The data.
    stresses : list of numpy.ndarray
        Nominal stress (Pa) of the fit along the curves.
    """

    parameters: dict[str, float]
    confidence: dict[str, tuple[float, float]]
    r2: dict[str, float]
    residual: float
    active: dict[str, float]
    reached: int
    starts: int
    law: Law | Viscous
    curves: list[Curve]
    stresses: list[np.ndarray]

    def plot(self) -> Any:
        """Stress of the fit and the data, one panel per curve."""
        with require("matplotlib", "report").rc_context(STYLE):
            page = figure(3.6 * len(self.curves), 3.2)
            panels = page.subplots(1, len(self.curves), squeeze=False)[0]
            for axes, curve, stress in zip(panels, self.curves, self.stresses, strict=True):
                at, label = (curve.stretches, "stretch") if curve.times is None else (curve.times, "time, s")
                axes.plot(at, curve.stress / 1e3, "o", ms=4, mfc="white", mec="#222222", label="data")
                axes.plot(at, stress / 1e3, color="#0072B2", label="fit")
                axes.set(
                    title=curve.label,
                    xlabel="amount of shear" if curve.mode == "shear" and label == "stretch" else label,
                )
                axes.grid(color="#e8e8e8", lw=0.6)
            panels[0].set_ylabel("nominal stress, kPa")
            panels[0].legend(frameon=False)
        return page

    @property
    def value(self) -> dict[str, float]:
        """The parameters."""
        return self.parameters

    @property
    def headline(self) -> str:
        """Parameters with their intervals, and the smallest R²."""
        ends = {name: "{:.4g} to {:.4g}".format(*interval) for name, interval in self.confidence.items()}
        found = [f"{name} {value:.4g} ({ends[name]})" for name, value in self.parameters.items()]
        return ", ".join([*found, f"R² {min(self.r2.values()):.3g}"])

    @property
    def statistics(self) -> dict[str, float]:
        """Numbers of starts."""
        return {"starts": self.starts, "at_this_optimum": self.reached}


def fit(
    law: Callable[..., Law | Viscous],
    data: Iterable[Curve],
    start: Mapping[str, float],
    bounds: Mapping[str, Bounds] | None = None,
    starts: int = 8,
    weights: Mapping[str, float] | None = None,
    seed: int = 0,
) -> Fit:
    """Fit the parameters of a law to all curves at once; the residuals of each curve are divided by its peak stress.

    Parameters
    ----------
    law : callable
        Makes the law from named parameters: a class, or a function such as `lambda mu, alpha: Ogden(mu, alpha)`.
    data : iterable of Curve
        Measured curves.
    start : dict of str to float
        Name → initial guess.
    bounds : dict of str to Bounds, optional
        Name → (lowest, highest). Values that the law refuses are excluded too.
    starts : int, default 8
        Number of starts: the initial guess, and others drawn at random within finite bounds, else up to ten times
        smaller or larger and of either sign.
    weights : dict of str to float, optional
        Curve → further factor of its residuals.
    seed : int, default 0
        Seed of the random starts.

    Returns
    -------
    Fit
        Best parameters with intervals.

    Raises
    ------
    InputError
        More parameters than data, unknown names, or an initial guess that the law refuses.
    ConvergenceError
        No start converged.

    Examples
    --------
    >>> from ngbrain.materials import NeoHooke
    >>> data = [Curve("shear", [0.1, 0.2, 0.3], [100.0, 201.0, 299.0])]
    >>> round(fit(NeoHooke, data, {"mu": 500.0}).parameters["mu"])
    999
    """
    return CurveFit(law, check_curves(data), dict(start), bounds or {}, weights or {}).best(starts, seed)


class CurveFit:
    """Scaled residuals as a function of the parameters; infinite where the law refuses them.

    Subclasses may redefine `prepare` and `stresses`.

    Parameters
    ----------
    law : callable
        Makes the law from named parameters.
    curves : list of Curve
        Measured curves.
    start : dict of str to float
        Name → initial guess.
    bounds : dict of str to Bounds
        Name → (lowest, highest).
    weights : dict of str to float
        Curve → further factor of its residuals.

    Raises
    ------
    InputError
        See `fit`.
    """

    slope: str | Callable[[np.ndarray], np.ndarray] = "3-point"
    """Jacobian of the residuals (data, parameters), or scipy's name of a finite-difference rule."""
    ends: Mapping[str, float] = {"xtol": 1e-12, "ftol": 1e-14, "gtol": 1e-12}
    """Stopping tolerances of scipy."""

    def __init__(
        self,
        law: Callable[..., Law | Viscous],
        curves: list[Curve],
        start: dict[str, float],
        bounds: Mapping[str, Bounds],
        weights: Mapping[str, float],
    ) -> None:
        self.law, self.curves, self.names = law, curves, list(start)
        self.start = np.array(list(start.values()), dtype=float)
        labels = [curve.label for curve in curves]
        for field, given, known in (("bounds", bounds, self.names), ("weights", weights, labels)):
            if unknown := [name for name in given if name not in known]:
                raise InputError(field, repr(unknown[0]), f"one of {', '.join(known)}")
        self.low, self.high = np.array([bounds.get(name, FREE) for name in self.names], dtype=float).T
        for name, value, low, high in zip(self.names, self.start, self.low, self.high, strict=True):
            if not low < value < high:
                raise InputError(f"start[{name!r}]", value, f"a number between its bounds {low:g} and {high:g}")
        size = sum(len(curve.stress) for curve in curves)
        if size <= len(self.names):
            raise InputError("data", f"{size} values", f"more than the {len(self.names)} parameters")
        self._scales = [weights.get(curve.label, 1.0) / np.abs(curve.stress).max() for curve in curves]
        try:
            law(**start)
        except TypeError as error:
            raise InputError("start", ", ".join(self.names), f"the arguments of the law ({error})") from error
        self.parameters = {name: ngs.Parameter(value) for name, value in start.items()}
        self.prepare()
        if not np.isfinite(self.misfits(self.start)).all():
            self.stresses(dict(start))  # raises the law's own error
            raise InputError("start", start, "parameters with finite stress at all data")

    def prepare(self) -> None:
        """Build one expression per curve, whose parameters are set again for each evaluation."""
        plain = [curve for curve in self.curves if curve.times is None]
        self._specimens = dict[str, Specimen]()
        if plain:  # a viscoelastic law need not accept `Parameter`s
            law = cast(Law, self.law(**self.parameters))
            self._specimens |= {c.label: Specimen.from_law(law, MODES[c.mode], len(c.stretches)) for c in plain}

    def stresses(self, values: Mapping[str, float]) -> list[np.ndarray]:
        """Nominal stress (Pa) along each curve."""
        law = self.law(**values)  # the law checks the numbers
        for name, value in values.items():
            self.parameters[name].Set(value)
        answers = []
        for curve in self.curves:
            if curve.times is None:
                specimen = self._specimens[curve.label]
                specimen.stretch_to(curve.stretches)
                answers.append(specimen.stress)
            else:
                answers.append(history(cast(Viscous, law), curve.mode, curve.times, curve.stretches))
        return answers

    def parameter_values(self, x: np.ndarray) -> dict[str, float]:
        """Parameters by name."""
        return dict(zip(self.names, x.tolist(), strict=True))

    def misfits(self, x: np.ndarray) -> np.ndarray:
        """Residuals (P - data)/peak at all data, one curve after the other."""
        try:
            stresses = self.stresses(self.parameter_values(x))
        except (InputError, SolverError):
            return np.full(sum(len(curve.stress) for curve in self.curves), np.inf)
        return self.scale_stresses([stress - curve.stress for stress, curve in zip(stresses, self.curves, strict=True)])

    def scale_stresses(self, stresses: list[np.ndarray]) -> np.ndarray:
        """Stresses (Pa) along all curves over the peak of each curve, one curve after the other."""
        return np.concatenate([scale * stress for scale, stress in zip(self._scales, stresses, strict=True)])

    def initial_guesses(self, count: int, seed: int) -> list[np.ndarray]:
        """The initial guess, and random ones that the law accepts.

        Parameters
        ----------
        count : int
            Number of guesses.
        seed : int
            Seed of the random numbers.

        Returns
        -------
        list of numpy.ndarray
            Parameter vectors.

        Raises
        ------
        InputError
            `count` is below 1.
        """
        if count < 1:
            raise InputError("starts", count, "at least 1")
        random, found = np.random.default_rng(seed), [self.start]
        for _ in range(DRAWS * (count - 1)):
            if len(found) == count:
                break
            guess = self._draw(random)
            if np.isfinite(self.misfits(guess)).all():
                found.append(guess)
        return found

    def _draw(self, random: np.random.Generator) -> np.ndarray:
        u, flip = random.random(len(self.start)), random.random(len(self.start)) < 0.5
        scale = np.where(self.start == 0, 1.0, self.start) * 10 ** (2 * u - 1) * np.where(flip, -1.0, 1.0)
        guess = np.where((scale > self.low) & (scale < self.high), scale, self.start)
        for i in np.flatnonzero(np.isfinite(self.low) & np.isfinite(self.high)):
            low, high = self.low[i], self.high[i]
            if low * high > 0:
                guess[i] = low * (high / low) ** u[i]
            else:
                guess[i] = low + (high - low) * u[i]
        return guess

    def best(self, starts: int, seed: int) -> Fit:
        """Fit from several starts and report the best.

        Parameters
        ----------
        starts : int
            Number of starts.
        seed : int
            Seed of the random starts.

        Returns
        -------
        Fit
            The best fit.

        Raises
        ------
        ConvergenceError
            No start converged.
        """
        results = [result for guess in self.initial_guesses(starts, seed) if (result := self.solve(guess)) is not None]
        if not results:
            raise ConvergenceError("no start of the fit converged; try another initial guess or bounds")
        best = min(results, key=lambda result: result.cost)
        alike = best.cost * (1 + SAME_OPTIMUM) + 1e-24
        return self.report(best, sum(result.cost <= alike for result in results), starts)

    def solve(self, guess: np.ndarray) -> scipy.optimize.OptimizeResult | None:
        """Least-squares solution from one start, or None when it fails."""
        try:
            with np.errstate(all="ignore"):
                return scipy.optimize.least_squares(
                    self.misfits, guess, self.slope, (self.low, self.high), x_scale="jac", max_nfev=400, **self.ends
                )
        except (ValueError, np.linalg.LinAlgError):
            return None

    def report(self, result: scipy.optimize.OptimizeResult, reached: int, starts: int) -> Fit:
        """Result of an optimum, with confidence intervals.

        Parameters
        ----------
        result : OptimizeResult
            Optimum of scipy.
        reached : int
            Number of starts that ended at it.
        starts : int
            Number of starts.

        Returns
        -------
        Fit
            The fit.
        """
        values = self.parameter_values(result.x)
        stresses = self.stresses(values)
        active = self._active(result)
        return Fit(
            parameters=values,
            confidence=self._confidence(result, active),
            r2={c.label: _r2(stress, c.stress) for stress, c in zip(stresses, self.curves, strict=True)},
            residual=float(np.sqrt(np.mean(result.fun**2))),
            active=active,
            reached=int(reached),
            starts=starts,
            law=self.law(**values),
            curves=self.curves,
            stresses=stresses,
            status=Status.CONVERGED if result.success else Status.STOPPED,
        )

    def _active(self, result: scipy.optimize.OptimizeResult) -> dict[str, float]:
        active = {}
        for i, name in enumerate(self.names):
            for bound in (self.low[i], self.high[i]):
                if np.isfinite(bound) and abs(result.x[i] - bound) <= 1e-6 * max(abs(bound), abs(self.start[i])):
                    active[name] = float(bound)
        return active

    def _confidence(
        self, result: scipy.optimize.OptimizeResult, active: Mapping[str, float]
    ) -> dict[str, tuple[float, float]]:
        free = [i for i, name in enumerate(self.names) if name not in active]
        half = np.full(len(self.names), np.nan)
        if free:
            freedom = len(result.fun) - len(free)
            half[free] = (
                scipy.stats.t.ppf(0.975, freedom) * np.sqrt(2 * result.cost / freedom) * _spread(result.jac[:, free])
            )
        return {name: (x - h, x + h) for name, x, h in zip(self.names, result.x.tolist(), half.tolist(), strict=True)}


def _spread(jacobian: np.ndarray) -> np.ndarray:
    """√diag (JᵀJ)⁻¹; infinite where the columns are not independent."""
    scale = np.linalg.norm(jacobian, axis=0)
    if np.any(scale == 0):
        return np.full(len(scale), np.inf)
    _, values, directions = np.linalg.svd(jacobian / scale, full_matrices=False)
    if values[-1] <= 1e-10 * values[0]:
        return np.full(len(scale), np.inf)
    return np.sqrt(np.sum((directions / values[:, None]) ** 2, axis=0)) / scale


def _r2(stress: np.ndarray, data: np.ndarray) -> float:
    return float(1 - np.sum((stress - data) ** 2) / np.sum((data - data.mean()) ** 2))
