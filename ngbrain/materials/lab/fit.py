"""Parameters of a law from measured curves, with what the data say about them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, cast

import ngsolve as ngs
import numpy as np
from scipy.optimize import OptimizeResult, least_squares
from scipy.stats import t as student

from ngbrain.errors import ConvergenceError, InputError, SolverError, require
from ngbrain.look import STYLE, figure
from ngbrain.materials.base import Law
from ngbrain.materials.lab.curves import Curve, checked_curves
from ngbrain.materials.lab.modes import MODES
from ngbrain.materials.lab.relaxing import history
from ngbrain.materials.lab.specimen import Specimen
from ngbrain.materials.viscous import Viscous
from ngbrain.result import Result, Status

Bounds = tuple[float, float]
FREE: Bounds = (-np.inf, np.inf)
SAME_OPTIMUM = 1e-6
"""Relative difference of the sums of squares below which two starts count as ended alike."""
DRAWS = 100


@dataclass(repr=False, eq=False)
class Fit(Result):
    """The best parameters found.

    parameters   name → value
    confidence   name → ends of the 95 % interval (t-distribution, linearised at the optimum); nan at an active bound,
                 infinite where the data do not tell
    r2           curve → 1 - Σ(P - data)²/Σ(data - mean)²
    residual     root mean square of the scaled misfits
    active       name → bound the value lies on
    reached      how many of the `starts` ended at this optimum
    law          the law, with these numbers
    curves       the data, and `stresses` (Pa) of the fit along them
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
        """Stress of the fit against the data, a panel for each curve."""
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
        """Parameters with their intervals, and how well the curves are met."""
        ends = {name: "{:.4g} to {:.4g}".format(*interval) for name, interval in self.confidence.items()}
        found = [f"{name} {value:.4g} ({ends[name]})" for name, value in self.parameters.items()]
        return ", ".join([*found, f"R² {min(self.r2.values()):.3g}"])

    @property
    def statistics(self) -> dict[str, float]:
        """Of the starts."""
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
    """Least squares over all curves at once; each curve's misfit is divided by its own peak stress.

    law      makes the law of named parameters: a class, or a function such as `lambda mu, alpha: Ogden(mu, alpha)`
    start    name → first guess
    bounds   name → (lowest, highest); what the law itself refuses is never tried either
    starts   the guess and so many less one drawn around it: within finite bounds, else up to ten times smaller or
             larger and of either sign
    weights  curve → further factor of its misfit

    Raises `InputError` for data that cannot decide and a guess that the law refuses, `ConvergenceError` when no start ends.

    >>> from ngbrain.materials import NeoHooke
    >>> data = [Curve("shear", [0.1, 0.2, 0.3], [100.0, 201.0, 299.0])]
    >>> round(fit(NeoHooke, data, {"mu": 500.0}).parameters["mu"])
    999
    """
    return CurveFit(law, checked_curves(data), dict(start), bounds or {}, weights or {}).best(starts, seed)


class CurveFit:
    """Scaled misfits as a function of the parameters; infinite where the law refuses them.

    What stresses a specimen has at given parameters, `stresses`, is for others to say anew.
    """

    slope: str | Callable[[np.ndarray], np.ndarray] = "3-point"
    """Derivative of the misfits (data, parameters), or how scipy is to find it."""
    ends: Mapping[str, float] = {"xtol": 1e-12, "ftol": 1e-14, "gtol": 1e-12}
    """When scipy may stop."""

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
            self.stresses(dict(start))  # raises what is wrong
            raise InputError("start", start, "parameters with finite stress at all data")

    def prepare(self) -> None:
        """One expression for each curve, built once: its parameters are set again and again."""
        plain = [curve for curve in self.curves if curve.times is None]
        self._specimens = dict[str, Specimen]()
        if plain:  # a relaxing law need not take parameters
            law = cast(Law, self.law(**self.parameters))
            self._specimens |= {c.label: Specimen.from_law(law, MODES[c.mode], len(c.stretches)) for c in plain}

    def stresses(self, values: Mapping[str, float]) -> list[np.ndarray]:
        """Nominal stress (Pa) along each curve."""
        law = self.law(**values)  # a law checks numbers
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
        """(P - data)/peak at all data, one curve after the other."""
        try:
            stresses = self.stresses(self.parameter_values(x))
        except (InputError, SolverError):
            return np.full(sum(len(curve.stress) for curve in self.curves), np.inf)
        return self.scale_stresses([stress - curve.stress for stress, curve in zip(stresses, self.curves, strict=True)])

    def scale_stresses(self, stresses: list[np.ndarray]) -> np.ndarray:
        """Stresses (Pa) along all curves over each one's peak, one curve after the other."""
        return np.concatenate([scale * stress for scale, stress in zip(self._scales, stresses, strict=True)])

    def initial_guesses(self, count: int, seed: int) -> list[np.ndarray]:
        """The start, and others that the law accepts."""
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
        """The best of several starts; `ConvergenceError` when none ends."""
        results = [result for guess in self.initial_guesses(starts, seed) if (result := self.solve(guess)) is not None]
        if not results:
            raise ConvergenceError("none of the starts of the fit ended; try another guess or bounds")
        best = min(results, key=lambda result: result.cost)
        alike = best.cost * (1 + SAME_OPTIMUM) + 1e-24
        return self.report(best, sum(result.cost <= alike for result in results), starts)

    def solve(self, guess: np.ndarray) -> OptimizeResult | None:
        """Where this start ends, or None when it breaks down."""
        try:
            with np.errstate(all="ignore"):
                return least_squares(
                    self.misfits, guess, self.slope, (self.low, self.high), x_scale="jac", max_nfev=400, **self.ends
                )
        except (ValueError, np.linalg.LinAlgError):
            return None

    def report(self, result: OptimizeResult, reached: int, starts: int) -> Fit:
        """Numbers of the optimum, with what the data say about them."""
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

    def _active(self, result: OptimizeResult) -> dict[str, float]:
        active = {}
        for i, name in enumerate(self.names):
            for bound in (self.low[i], self.high[i]):
                if np.isfinite(bound) and abs(result.x[i] - bound) <= 1e-6 * max(abs(bound), abs(self.start[i])):
                    active[name] = float(bound)
        return active

    def _confidence(self, result: OptimizeResult, active: Mapping[str, float]) -> dict[str, tuple[float, float]]:
        free = [i for i, name in enumerate(self.names) if name not in active]
        half = np.full(len(self.names), np.nan)
        if free:
            freedom = len(result.fun) - len(free)
            half[free] = student.ppf(0.975, freedom) * np.sqrt(2 * result.cost / freedom) * _spread(result.jac[:, free])
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
