"""Error bars of the property maps of `invert`, from its `Posterior`, in the units of the maps.

Intervals are pointwise. They take noise, weights and mesh as in the inversion; the boundary displacements, which are unknown too,
are marginalised.

The regulariser states the prior assumption. `smooth` assumes rough fields, the more so the finer the mesh: where the truth is
smooth, its pointwise intervals cover more than their level. By default, Gaussian fields with the correlation length and variances
that fit the data best replace the regulariser where they fit better (`evidence`); the maps are then those of that prior.
`edges` and `steps` assume jumps, of which the data know the position no better than their resolution ℓ: a jump that may be anywhere
within ±ℓ/2 adds ℓ/√12 times the map's gradient to its standard deviation.
Model errors are not part of an interval: another rheology, a wrong bulk modulus (see the notes of the inversion), a coarse mesh.
At 6.5 points per wavelength the mesh changes the mean modulus by 0.5 %, which noise of 2 % leaves uncertain by 0.1 %; at 13 points
the change is not visible.
"""

from __future__ import annotations

import time
from dataclasses import replace
from functools import cached_property
from typing import Any

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg

from ngbrain.adjoint.reduced import Point, Reduced
from ngbrain.errors import InputError, nearest
from ngbrain.forward.common.interpolation import evaluation
from ngbrain.inverse.data.quality import map_resolution
from ngbrain.inverse.elastography.identifiability import FEW
from ngbrain.inverse.elastography.result import FinalState, Inversion, StartResult, compute_derived_maps
from ngbrain.inverse.objective.misfit import LeastSquares
from ngbrain.inverse.objective.parameters import ParameterFields
from ngbrain.inverse.objective.regularisation import QuadraticRegulariser, nodes
from ngbrain.inverse.problem.properties import Property, as_moduli
from ngbrain.inverse.uncertainty.evidence import best_prior
from ngbrain.inverse.uncertainty.interval import LEVEL, CredibleInterval
from ngbrain.inverse.uncertainty.posterior import DRAWS, MIN_EIGENVALUE, Posterior
from ngbrain.inverse.uncertainty.randomised_eigenvalues import BLOCK
from ngbrain.result import Status

Array = np.ndarray
EIGENVALUES_PER_PARAMETER = 1.8
"""Eigenvalues above `MIN_EIGENVALUE` per effective parameter: 1.7 and 1.8 on CV-G, 25 and 51 points wide."""
POINTS_PER_BATCH = 4096
"""Points whose draws are in memory at a time."""
SAMPLE_POINTS = 200
"""Points at which the remaining variance is compared with the prior variance."""
MAX_MISFIT_FACTOR = 1.1
"""Factor by which the misfit may grow when the maps move to another prior by one step."""
PRIORS = ("best", "own")
TIMED_PRODUCTS = 2
"""Hessian products that are timed."""


class Uncertainty:
    """Error bars of an inversion; made by `uncertainty`.

    Parameters
    ----------
    found : Inversion
        Result of `invert`.
    posterior : Posterior
        Posterior of all unknowns, unknown boundary displacements included.
    """

    def __init__(self, found: Inversion, posterior: Posterior) -> None:
        assert found.final_state is not None
        self.found, self.data, self.problem, self.posterior = found, found.data, found.final_state.problem, posterior
        self._quantities = {quantity.name: quantity for quantity in self.problem.properties}

    def interval(self, name: str, level: float = LEVEL) -> CredibleInterval:
        """Pointwise credible interval of a map, in the unit of the map.

        Parameters
        ----------
        name : str
            Name of an unknown quantity.
        level : float
            Probability.

        Returns
        -------
        CredibleInterval
            Arrays (n,) at the points of the data, NaN at points that are left out.

        Raises
        ------
        InputError
            If the quantity was not an unknown.
        """
        if name not in self._quantities:
            raise InputError("map", repr(name), nearest(name, self._quantities))
        interval = self._interval(self._rows[name], self._quantities[name], level, self._jumps[name])
        inside, parts = self.problem.inside, []
        for values in vars(interval).values():
            parts.append(np.full(len(inside), np.nan))
            parts[-1][inside] = values
        return CredibleInterval(*parts)

    def functions(self, field: str, level: float = LEVEL) -> dict[str, ngs.GridFunction]:
        """Value, standard deviation and interval ends of a field, as functions in the space of the fields.

        The functions interpolate: at the vertices for first order, and between them too for higher order.

        Parameters
        ----------
        field : str
            Name of a field: a quantity, or for example `storage 3` of a label.
        level : float
            Probability.

        Returns
        -------
        dict of str to GridFunction
            `value`, `deviation`, `low` and `high`.

        Raises
        ------
        InputError
            If there is no such field.
        """
        composition = self.problem.composition
        known = {each.name: q for q in self._quantities.values() for each in composition.fields(q.name)}
        if field not in known:
            raise InputError("field", repr(field), "one of " + ", ".join(known))
        space, found = self.problem.space, {}
        at = evaluation(space, nodes(space))
        fit = scipy.sparse.linalg.splu(sp.csc_array(at.T @ at))
        jumps = self._jump_deviation(field, nodes(space))
        for name, values in vars(self._interval(self._values(field, at), known[field], level, jumps)).items():
            found[name] = ngs.GridFunction(space)
            found[name].vec.FV().NumPy()[:] = fit.solve(at.T @ values)
        return found

    def draws(self, number: int = DRAWS, seed: int = 0) -> dict[str, Array]:
        """Draw property maps from the posterior.

        Storage and loss are included where magnitude and phase were the unknowns.

        Parameters
        ----------
        number : int
            Number of draws.
        seed : int
            Seed.

        Returns
        -------
        dict of str to array (number, points inside)
        """
        x = self.posterior.draws(number, seed)
        return as_moduli({name: q.transform.value((self._rows[name] @ x.T).T) for name, q in self._quantities.items()})

    def mean(
        self, name: str, where: Array | None = None, level: float = LEVEL, number: int = DRAWS
    ) -> CredibleInterval:
        """Credible interval of the mean of a property over points, from draws.

        Parameters
        ----------
        name : str
            Name of the property.
        where : array (n,) of bool, optional
            Points. Default all.
        level : float
            Probability.
        number : int
            Number of draws.

        Returns
        -------
        CredibleInterval

        Raises
        ------
        InputError
            If there is no such property, or none of the points is part of the map.
        """
        inside = self.problem.inside
        chosen = np.ones(int(inside.sum()), bool) if where is None else np.asarray(where, bool)[inside]
        if not chosen.any():
            raise InputError("where", "no point of the map", "at least one point of the map")
        value = as_moduli(
            {each: q.transform.value(self._rows[each] @ self.posterior.x) for each, q in self._quantities.items()}
        )
        if name not in value:
            raise InputError("map", repr(name), nearest(name, value))
        return CredibleInterval.from_samples(
            float(value[name][chosen].mean()), self.draws(number)[name][:, chosen].mean(axis=1), level
        )

    def with_best_prior(self) -> Uncertainty:
        """Error bars under the best Gaussian prior; self unless it fits better, varies, and explains the data.

        The maps of `found` are then those of that prior.
        """
        found, posterior, begun = self.found, self.posterior, time.process_time()
        assert found.final_state is not None
        problem, reduced = found.final_state.problem, found.final_state.reduced
        unknowns = reduced.unknowns
        if not (
            isinstance(unknowns, ParameterFields)
            and unknowns.undetermined_direction is None
            and isinstance(reduced.misfit, LeastSquares)
        ):
            return self
        at = evaluation(problem.space, problem.model.points)
        means = {name: float((at @ posterior.x[posterior.blocks[name]]).mean()) for name in posterior.regularised}
        gaussian = best_prior(posterior, problem.space, means)
        if gaussian is None:
            return self
        moved = posterior.with_regularisers(gaussian.regularisers, gaussian.weights)
        determined = moved.effective_parameters
        if min(determined.values()) < FEW:  # it would be uniform around a mean that counts as known
            return self
        data = problem.model.evaluate(unknowns.theta(moved.x)).data
        before, misfit = found.chosen_start, reduced.misfit.weighted_squares(data)
        if misfit > MAX_MISFIT_FACTOR * max(before.misfit, before.expected):
            return self
        reduced = Reduced(reduced.model, reduced.misfit, unknowns, gaussian.regularisers, gaussian.weights)
        predicted = np.full_like(found.predicted, np.nan)
        predicted[:, problem.inside] = data
        maps = {name: values for name, values in problem.maps(unknowns, moved.x).items() if name in found.maps}
        note = (
            f"maps and error bars are those of Gaussian fields correlated over {1e3 * gaussian.length:.3g} mm, which fit the data "
            f"better than the regulariser {found.regulariser} (e^{gaussian.gain:.3g} times as probable)"
        )
        value, last = reduced.misfit.value(data) + reduced.regular(moved.x), [before.history[-1]]
        spent = time.process_time() - begun
        best = replace(
            found,
            starts=[*found.starts, StartResult("gaussian", maps, misfit, before.expected, value, last, spent, True)],
            chosen="gaussian",
            maps=maps,
            predicted=predicted,
            regulariser="matern",
            weights=dict(gaussian.weights),
            determined=determined,
            resolution=map_resolution(ngs.Integrate(ngs.CF(1), problem.body.mesh), found.data.dim, determined),
            checks={**found.checks, "misfit_over_expected": misfit / before.expected},
            warnings=[*found.warnings, note],
            status=Status.CONVERGED,
            final_state=FinalState(problem, reduced, moved.x),
        )
        return Uncertainty(best, moved)

    @property
    def notes(self) -> list[str]:
        """Notes of the posterior, and fields that are assumed to be nearly uniform because little is known of them."""
        few = [name for name, number in self.posterior.effective_parameters.items() if number < FEW]
        left = {}
        for name, rows in self._rows.items():
            some = rows[:: max(1, rows.shape[0] // SAMPLE_POINTS)]
            left[name] = self.posterior.mean_remaining_variance(some)
        return self.posterior.describe_remaining_variance(left) + [
            f"{name} is assumed to be nearly uniform: its intervals show how well its mean is known, "
            "and are too narrow where it varies"
            for name in few
        ]

    @property
    def by_label(self) -> dict[str, dict[int, CredibleInterval]]:
        """Credible interval of the mean of each map over each label; empty without labels."""
        labels = self.data.labels
        if labels is None:
            return {}
        numbers = [int(label) for label in np.unique(labels[self.problem.inside])]
        return {name: {label: self.mean(name, labels == label) for label in numbers} for name in self.found.maps}

    def arrays(self) -> dict[str, Array]:
        """95 % credible intervals `NAME_low` and `NAME_high` of every map at the points of the data (n,), in its unit.

        Maps of unknown quantities have analytical intervals, derived maps those of draws.
        """
        return dict(self._interval_ends)

    @cached_property
    def _interval_ends(self) -> dict[str, Array]:
        intervals = {name: self.interval(name) for name in self._quantities} | self._derived_intervals()
        return {
            f"{name}_{end}": getattr(interval, end) for name, interval in intervals.items() for end in ("low", "high")
        }

    def result(self) -> dict[str, Any]:
        """Means for result.json: for each map its mean over all points and over each label, as `value, deviation, low, high`."""
        labels = self.by_label
        return {
            name: {
                "mean": vars(self.mean(name)),
                "by_label": {label: vars(interval) for label, interval in labels.get(name, {}).items()},
            }
            for name in self.found.maps
        }

    def _derived_intervals(self, level: float = LEVEL) -> dict[str, CredibleInterval]:
        """Pointwise intervals of derived maps from `DRAWS` draws, in batches of points because draws are large."""
        x, inside = self.posterior.draws(DRAWS).T, np.flatnonzero(self.problem.inside)
        shift = np.random.default_rng(0).normal(size=DRAWS)  # of jumps, which are where all quantities jump
        tails = (1 - level) / 2, (1 + level) / 2
        middle = {**self.found.maps, **self.found.derived_maps}
        found = {
            name: np.full((4, len(self.problem.inside)), np.nan) for name in middle if name not in self._quantities
        }
        for part in np.array_split(np.arange(len(inside)), -(-len(inside) // POINTS_PER_BATCH)):
            drawn = {
                name: q.transform.value(self._rows[name][part] @ x + self._jumps[name][part, None] * shift)
                for name, q in self._quantities.items()
            }
            maps = as_moduli(drawn)
            values = {**maps, **compute_derived_maps(self.data, maps)}
            for name, interval in found.items():
                own = inside[part]
                interval[0, own], interval[1, own] = middle[name][own], values[name].std(axis=1)
                interval[2:, own] = np.quantile(values[name], tails, axis=1)
        return {name: CredibleInterval(*interval) for name, interval in found.items()}

    def _interval(self, rows: sp.csr_array, quantity: Property, level: float, jumps: Array) -> CredibleInterval:
        deviation = np.sqrt(self.posterior.variance(rows) + jumps**2)
        return CredibleInterval.from_gaussian(rows @ self.posterior.x, deviation, quantity.transform, level)

    @cached_property
    def _jumps(self) -> dict[str, Array]:
        """Standard deviation of each transformed quantity at the points inside, of the unknown position of its jumps."""
        points, composition = self.problem.model.points, self.problem.composition
        return {
            name: composition.point_values(
                {field.name: self._jump_deviation(field.name, points) for field in composition.fields(name)}
            )
            for name in self._quantities
        }

    def _jump_deviation(self, field: str, points: Array) -> Array:
        assert self.found.final_state is not None
        space, regularisers = self.problem.space, self.found.final_state.reduced.regularisers
        if isinstance(regularisers[field], QuadraticRegulariser):
            return np.zeros(len(points))
        values = ngs.GridFunction(space)
        values.vec.FV().NumPy()[:] = self.posterior.x[self.posterior.blocks[field]]
        slope = ngs.Norm(ngs.grad(values))(space.mesh(*points.T)).ravel()
        return np.asarray(self.found.resolution[field] / np.sqrt(12) * slope)

    @cached_property
    def _rows(self) -> dict[str, sp.csr_array]:
        """Matrix from x to the transformed quantity (for example its logarithm) at the points inside, by quantity."""
        at = evaluation(self.problem.space, self.problem.model.points)
        one, composition, rows = np.ones(at.shape[0]), self.problem.composition, {}
        for quantity in self._quantities:
            names = [field.name for field in composition.fields(quantity)]
            shares = {name: composition.point_values({each: one * (each == name) for each in names}) for name in names}
            parts = [self._values(name, sp.csr_array(sp.diags_array(share) @ at)) for name, share in shares.items()]
            rows[quantity] = sp.csr_array(sum(parts[1:], parts[0]))
        return rows

    def _values(self, field: str, at: sp.csr_array) -> sp.csr_array:
        return sp.csr_array(at @ self.posterior.selection_matrix(field))


def uncertainty(found: Inversion, min_eigenvalue: float = MIN_EIGENVALUE, prior: str = "best") -> Uncertainty:
    """Compute the error bars of an inversion, with the weights at its end.

    It takes one Gauss-Newton product per boundary displacement (real and imaginary parts), and two per effective parameter or a few
    times as many: in the plane one to three times the time of the inversion, in 3-D far more.

    Parameters
    ----------
    found : Inversion
        Result of `invert`.
    min_eigenvalue : float
        See `Posterior`.
    prior : str
        "best": the prior of the inversion, or a Gaussian prior where it fits better, see `evidence`. "own": always the former.

    Returns
    -------
    Uncertainty

    Raises
    ------
    InputError
        If the inversion is one of zones or slices, which have no unknowns in common.

    Examples
    --------
    >>> from ngbrain.inverse.elastography.invert import invert
    >>> from ngbrain.io.waves import WaveData
    >>> grid = np.array([[x, y] for y in range(12) for x in range(12)]) * 4e-3
    >>> k = 2 * np.pi * 30 * np.sqrt(1000 / (2500 + 500j))
    >>> u = 1e-5 * np.stack([np.exp(-1j * k * grid[:, 1]), np.exp(-1j * k * grid[:, 0])], axis=1)[None]
    >>> data = WaveData(grid, u, [30.0], 1000.0, "isotropic", "viscoelastic", poisson=0.4).with_noise(0.01, seed=0)
    >>> bars = uncertainty(invert(data, uniform=False, regulariser="smooth"))
    >>> mean = bars.mean("storage")
    >>> bool(mean.low < mean.value < mean.high), bool(abs(mean.value - 2500) < 4 * mean.deviation < 200)
    (True, True)
    """
    if prior not in PRIORS:
        raise InputError("prior", repr(prior), nearest(prior, PRIORS))
    bars = Uncertainty(found, Posterior(_final_point(found), min_eigenvalue))
    return bars.with_best_prior() if prior == "best" else bars


def count_hessian_products(found: Inversion) -> int:
    """Estimate the number of Gauss-Newton products of `uncertainty`; `InputError` for an inversion of zones or slices."""
    if found.final_state is None:
        raise InputError("found", "an inversion of zones or slices", "one of a single body")
    unknowns, held = found.final_state.reduced.unknowns.blocks, found.final_state.reduced.regularisers
    loose = sum(block.stop - block.start for name, block in unknowns.items() if name not in held)
    informed = min(len(found.final_state.x) - loose, EIGENVALUES_PER_PARAMETER * sum(found.determined.values()) + BLOCK)
    return round(loose + 2 * informed)


def estimate_seconds(found: Inversion) -> float:
    """Estimate the wall-clock time (s) of `uncertainty` from two products; errors as of `count_hessian_products`."""
    number, point = count_hessian_products(found), _final_point(found)
    probe = np.random.default_rng(0).normal(size=len(point.x))
    point.product(probe)  # sets up what all products share
    begun = time.perf_counter()
    for _ in range(TIMED_PRODUCTS):
        point.product(probe)
    return number * (time.perf_counter() - begun) / TIMED_PRODUCTS


def _final_point(found: Inversion) -> Point:
    """Point of the objective where the inversion ended, with its weights."""
    if found.final_state is None:
        raise InputError("found", "an inversion of zones or slices", "one of a single body")
    reduced = found.final_state.reduced
    same = Reduced(reduced.model, reduced.misfit, reduced.unknowns, reduced.regularisers, found.weights)
    return same.evaluate(found.final_state.x)
