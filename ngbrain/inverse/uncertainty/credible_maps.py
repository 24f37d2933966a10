"""Error bars of property maps: what `invert` found, with its `Posterior`, in the units of the maps.

Bands are those of each point by itself, given noise, weights and elements as they were in the inversion; the displacements of
the boundary, which are unknown too, may be anything that fits.

What was assumed is what the regulariser says. `smooth` takes fields for rough, the more so the finer the mesh: where the truth is
smooth, its bands at points cover more than they say. Unless told otherwise, Gaussian fields of the length and variances that fit
the data best take its place where they fit better (`evidence`), and the maps are then those of that prior.
Errors of the model are no part of a band: another rheology, a bulk modulus that is off (see the inversion's notes), elements that
are too coarse. At 6.5 points per wave these move the mean modulus by .5 %, which noise of 2 % leaves uncertain by .1 %; at 13
points they are not seen.
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
from ngbrain.inverse.objective.regularisation import nodes
from ngbrain.inverse.problem.properties import Property, as_moduli
from ngbrain.inverse.uncertainty.evidence import best_prior
from ngbrain.inverse.uncertainty.interval import LEVEL, CredibleInterval
from ngbrain.inverse.uncertainty.posterior import DRAWS, LEAST, Posterior
from ngbrain.inverse.uncertainty.randomised_eigenvalues import BLOCK
from ngbrain.result import Status

Array = np.ndarray
EIGENVALUES = 1.8
"""Eigenvalues above `LEAST` for each number that the data determine: 1.7 and 1.8 on CV-G, 25 and 51 points wide."""
PART = 4096
"""Points of which draws are held at a time."""
SOME = 200
"""Points at which the variance that is left is compared with that assumed."""
LOOSE = 1.1
"""Of the misfit: what it may grow by when maps move to another prior by one step."""
PRIORS = ("best", "own")
TIMED = 2
"""Products that are timed."""


class Uncertainty:
    """Error bars of `found`; `uncertainty` makes them.

    posterior  of all unknowns, held displacements of the boundary included
    """

    def __init__(self, found: Inversion, posterior: Posterior) -> None:
        assert found.final_state is not None
        self.found, self.data, self.problem, self.posterior = found, found.data, found.final_state.problem, posterior
        self._sought = {quantity.name: quantity for quantity in self.problem.properties}

    def interval(self, name: str, level: float = LEVEL) -> CredibleInterval:
        """Of a map at the points of the data (n,), NaN where they are left out; in the map's unit.

        Raises `InputError` for a quantity that was not looked for.
        """
        if name not in self._sought:
            raise InputError("map", repr(name), nearest(name, self._sought))
        band, inside, parts = (
            self._map_interval(self._rows[name], self._sought[name], level),
            self.problem.inside,
            [],
        )
        for values in vars(band).values():
            parts.append(np.full(len(inside), np.nan))
            parts[-1][inside] = values
        return CredibleInterval(*parts)

    def functions(self, field: str, level: float = LEVEL) -> dict[str, ngs.GridFunction]:
        """`value`, `deviation`, `low` and `high` of a field (a quantity, or `storage 3` of a label) in the space of fields.

        They interpolate: of first order at the vertices, of higher order between them too.
        Raises `InputError` for another name.
        """
        composition = self.problem.composition
        known = {each.name: q for q in self._sought.values() for each in composition.fields(q.name)}
        if field not in known:
            raise InputError("field", repr(field), "one of " + ", ".join(known))
        space, found = self.problem.space, {}
        at = evaluation(space, nodes(space))
        fit = scipy.sparse.linalg.splu(sp.csc_array(at.T @ at))
        for name, values in vars(self._map_interval(self._values(field, at), known[field], level)).items():
            found[name] = ngs.GridFunction(space)
            found[name].vec.FV().NumPy()[:] = fit.solve(at.T @ values)
        return found

    def draws(self, number: int = DRAWS, seed: int = 0) -> dict[str, Array]:
        """So many maps of each property (number, points inside); storage and loss too where magnitude and phase were looked for."""
        x = self.posterior.draws(number, seed)
        return as_moduli({name: q.transform.value((self._rows[name] @ x.T).T) for name, q in self._sought.items()})

    def mean(
        self, name: str, where: Array | None = None, level: float = LEVEL, number: int = DRAWS
    ) -> CredibleInterval:
        """Of the mean of a property over points (n,) bool, by default all, from so many draws.

        Raises `InputError` for another name, or where none of the points counts.
        """
        inside = self.problem.inside
        chosen = np.ones(int(inside.sum()), bool) if where is None else np.asarray(where, bool)[inside]
        if not chosen.any():
            raise InputError("where", "no point of the map", "some that count")
        value = as_moduli(
            {each: q.transform.value(self._rows[each] @ self.posterior.x) for each, q in self._sought.items()}
        )
        if name not in value:
            raise InputError("map", repr(name), nearest(name, value))
        return CredibleInterval.from_samples(
            float(value[name][chosen].mean()), self.draws(number)[name][:, chosen].mean(axis=1), level
        )

    def with_best_prior(self) -> Uncertainty:
        """Under Gaussian fields, where these fit better, are not all but uniform, and explain the data; else these bars.

        `found` then has the maps of that prior.
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
        if min(determined.values()) < FEW:  # uniform around a mean that would count as known
            return self
        data = problem.model.evaluate(unknowns.theta(moved.x)).data
        before, misfit = found.chosen_start, reduced.misfit.weighted_squares(data)
        if misfit > LOOSE * max(before.misfit, before.expected):
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
        """Those of the posterior, and fields of which so little is known that they are taken for uniform."""
        few = [name for name, number in self.posterior.effective_parameters.items() if number < FEW]
        left = {}
        for name, rows in self._rows.items():
            some = rows[:: max(1, rows.shape[0] // SOME)]
            left[name] = self.posterior.mean_remaining_variance(some)
        return self.posterior.describe_remaining_variance(left) + [
            f"{name} is taken for nearly uniform: its bands say how well its level is known, and are too narrow where it differs"
            for name in few
        ]

    @property
    def by_label(self) -> dict[str, dict[int, CredibleInterval]]:
        """Name of a map → label → its mean; empty without labels."""
        labels = self.data.labels
        if labels is None:
            return {}
        numbers = [int(label) for label in np.unique(labels[self.problem.inside])]
        return {name: {label: self.mean(name, labels == label) for label in numbers} for name in self.found.maps}

    def arrays(self) -> dict[str, Array]:
        """`NAME_low` and `NAME_high` of every map at the points of the data (n,): 95 % credible intervals in the map's unit.

        Of the maps that were looked for, and by draws of all that follow from them.
        """
        return dict(self._ends)

    @cached_property
    def _ends(self) -> dict[str, Array]:
        bands = {name: self.interval(name) for name in self._sought} | self._following()
        return {f"{name}_{end}": getattr(band, end) for name, band in bands.items() for end in ("low", "high")}

    def result(self) -> dict[str, Any]:
        """For result.json: map → mean over all points and over each label, `value, deviation, low, high`."""
        labels = self.by_label
        return {
            name: {
                "mean": vars(self.mean(name)),
                "by_label": {label: vars(band) for label, band in labels.get(name, {}).items()},
            }
            for name in self.found.maps
        }

    def _following(self, level: float = LEVEL) -> dict[str, CredibleInterval]:
        """Of other maps that are given, point by point from `DRAWS` draws, by parts of the points as many draws are large."""
        x, inside = self.posterior.draws(DRAWS).T, np.flatnonzero(self.problem.inside)
        tails = (1 - level) / 2, (1 + level) / 2
        middle = {**self.found.maps, **self.found.derived_maps}
        found = {name: np.full((4, len(self.problem.inside)), np.nan) for name in middle if name not in self._sought}
        for part in np.array_split(np.arange(len(inside)), -(-len(inside) // PART)):
            drawn = {name: q.transform.value(self._rows[name][part] @ x) for name, q in self._sought.items()}
            maps = as_moduli(drawn)
            values = {**maps, **compute_derived_maps(self.data, maps)}
            for name, band in found.items():
                own = inside[part]
                band[0, own], band[1, own] = middle[name][own], values[name].std(axis=1)
                band[2:, own] = np.quantile(values[name], tails, axis=1)
        return {name: CredibleInterval(*band) for name, band in found.items()}

    def _map_interval(self, rows: sp.csr_array, quantity: Property, level: float) -> CredibleInterval:
        deviation = np.sqrt(self.posterior.variance(rows))
        return CredibleInterval.from_gaussian(rows @ self.posterior.x, deviation, quantity.transform, level)

    @cached_property
    def _rows(self) -> dict[str, sp.csr_array]:
        """Quantity → the matrix from x to its variable (ln of it, say) at the points inside."""
        at = evaluation(self.problem.space, self.problem.model.points)
        one, composition, rows = np.ones(at.shape[0]), self.problem.composition, {}
        for quantity in self._sought:
            names = [field.name for field in composition.fields(quantity)]
            shares = {name: composition.point_values({each: one * (each == name) for each in names}) for name in names}
            parts = [self._values(name, sp.csr_array(sp.diags_array(share) @ at)) for name, share in shares.items()]
            rows[quantity] = sp.csr_array(sum(parts[1:], parts[0]))
        return rows

    def _values(self, field: str, at: sp.csr_array) -> sp.csr_array:
        return sp.csr_array(at @ self.posterior.selection_matrix(field))


def uncertainty(found: Inversion, min_eigenvalue: float = LEAST, prior: str = "best") -> Uncertainty:
    """Error bars of what `invert` found, at the weights that it ended with.

    least   see `Posterior`
    prior   best: that of the inversion, or Gaussian fields where they fit better, see `evidence`; own: that of the inversion

    It takes one Gauss-Newton product for each displacement of the boundary (real and imaginary parts), and two for each number
    that the data determine, or a few times as many: in the plane once to three times what the inversion took, in space far more.
    Raises `InputError` for an inversion of zones or slices, which has no unknowns in common.

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
    bars = Uncertainty(found, Posterior(_ended(found), min_eigenvalue))
    return bars.with_best_prior() if prior == "best" else bars


def count_hessian_products(found: Inversion) -> int:
    """About how many Gauss-Newton products `uncertainty` takes, see there; `InputError` for an inversion of zones or slices."""
    if found.final_state is None:
        raise InputError("found", "an inversion of zones or slices", "one of a single body")
    unknowns, held = found.final_state.reduced.unknowns.blocks, found.final_state.reduced.regularisers
    loose = sum(block.stop - block.start for name, block in unknowns.items() if name not in held)
    informed = min(len(found.final_state.x) - loose, EIGENVALUES * sum(found.determined.values()) + BLOCK)
    return round(loose + 2 * informed)


def estimate_seconds(found: Inversion) -> float:
    """About how long `uncertainty` takes on this machine as it is, by the clock, from two products. Errors as of `products_of`."""
    number, point = count_hessian_products(found), _ended(found)
    probe = np.random.default_rng(0).normal(size=len(point.x))
    point.product(probe)  # makes what all products share
    begun = time.perf_counter()
    for _ in range(TIMED):
        point.product(probe)
    return number * (time.perf_counter() - begun) / TIMED


def _ended(found: Inversion) -> Point:
    """Where an inversion ended, at the weights that it ended with."""
    if found.final_state is None:
        raise InputError("found", "an inversion of zones or slices", "one of a single body")
    reduced = found.final_state.reduced
    same = Reduced(reduced.model, reduced.misfit, reduced.unknowns, reduced.regularisers, found.weights)
    return same.evaluate(found.final_state.x)
