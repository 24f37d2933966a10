"""Laplace approximation N(x*, H⁻¹) of the posterior around the end of an inversion, with H = JᵀWJ + Σ αR.

Σ αR is the inverse of the prior covariance. Unknowns without a regulariser are eliminated: with H_bb their part of H and
T = H_bb⁻¹ H_bf, the others have S + R, S = (JᵀWJ)_ff - H_fb T. By the eigenvalues

    S v_i = λ_i R v_i ,   v_i·R v_j = δ_ij ,      (S + R)⁻¹ ≈ R⁻¹ - Σ λ_i/(1 + λ_i) v_i v_iᵀ     over all λ_i > `min_eigenvalue`

the data remove a share λ/(1 + λ) of the variance along v_i. The neglected part is positive and hardly more than `min_eigenvalue` of
R: a standard deviation is never too small, and too large by a factor of at most about √(1 + min_eigenvalue).

Regularisation weights and the noise level count as known. For edge-preserving regularisers, R is the matrix of the last step.

References
----------
Bui-Thanh, Ghattas, Martin, Stadler 2013, 10.1137/12089586X; Spantini et al. 2015, 10.1137/140977308; Villa, Petra, Ghattas 2021,
10.1145/3428447.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from ngbrain import parallel
from ngbrain.adjoint.reduced import Point
from ngbrain.errors import InputError
from ngbrain.inverse.objective.parameters import ParameterFields
from ngbrain.inverse.objective.regularisation import QuadraticRegulariser
from ngbrain.inverse.optimise.gauss_newton_hessian import Metric
from ngbrain.inverse.uncertainty.interval import LEVEL, CredibleInterval
from ngbrain.inverse.uncertainty.randomised_eigenvalues import eigenpairs
from ngbrain.look import BriefText

Array = np.ndarray
MIN_EIGENVALUE = 0.1
"""Eigenvalue below which data are neglected: standard deviations are at most 5 % too large."""
BATCH = 256
"""Rows whose variances are computed at a time."""
EXACT, DRAWS = 20_000, 1000
"""Number of rows up to which variances are exact; of more rows they come from so many draws, within 2.2 % (one standard error)."""
SINGULAR = 1e-13
"""Pivot of a matrix with unit diagonal below which an unknown counts as undetermined."""


@dataclass(frozen=True, repr=False)
class InformedDirection(BriefText):
    """Direction of x that the data inform.

    Parameters
    ----------
    eigenvalue : float
        Information of the data relative to the prior, λ.
    x : array (n,)
        Direction.
    shares : dict of str to float
        Share of each block in it.
    """

    eigenvalue: float
    x: Array
    shares: dict[str, float]

    @property
    def name(self) -> str:
        """Largest shares, for example "storage 0.93, loss 0.07"."""
        largest = sorted(self.shares.items(), key=lambda share: -share[1])
        return ", ".join(f"{name} {share:.2f}" for name, share in largest if share >= 0.005)


class Posterior:
    """Gaussian posterior N(x*, C) at a point of any model.

    It takes one Gauss-Newton product per unknown without a regulariser, and two per eigenvalue.

    Parameters
    ----------
    point : Point
        Point of the objective; the model has to stay there only during construction.
    min_eigenvalue : float
        Eigenvalue below which data are neglected; with 0, none are.
    seed : int
        Seed of the random vectors of the eigensolver.

    Attributes
    ----------
    regular : sparse array
        Σ αR of all regularised unknowns.
    reference : array
        Reference values of their regularisers.

    Raises
    ------
    InputError
        If a regulariser is singular, or the data do not determine an unknown without a regulariser.

    Examples
    --------
    >>> from ngbrain.inverse.phantoms.benchmark import Phantom
    >>> inversion = Phantom.from_name("CV-G", 5).simulate_measurements(0.01).inversion()
    >>> posterior = Posterior(inversion.reduced.evaluate(inversion.start))
    >>> interval = posterior.interval("storage")
    >>> bool(np.all((0 < interval.low) & (interval.low < interval.value) & (interval.value < interval.high)))
    True
    """

    def __init__(self, point: Point, min_eigenvalue: float = MIN_EIGENVALUE, seed: int = 0) -> None:
        reduced = point.reduced
        self.unknowns, self.x, self.blocks = reduced.unknowns, point.x.copy(), dict(reduced.unknowns.blocks)
        self.regularised = [name for name in self.blocks if name in reduced.regularisers]
        holds = np.zeros(len(self.x), bool)
        for name in self.regularised:
            holds[self.blocks[name]] = True
        self._held, self._loose = np.flatnonzero(holds), np.flatnonzero(~holds)
        self.reference = reduced.unknowns.start[self._held]
        self.regular = sp.csr_array(point.regular_matrix[self._held][:, self._held])
        self._metric = _metric(self.regular) if len(self._held) else None
        self._eliminate(point)

        def data(white: Array) -> Array:
            assert self._metric is not None
            v = self._metric.unwhiten(white)
            whole = np.zeros(len(self.x))
            whole[self._held] = v
            image = point.product(whole)
            return self._metric.whiten_gradient(
                image[self._held] - self.regular @ v - self._response.T @ image[self._loose]
            )

        random = np.random.default_rng(seed)
        self.eigenvalues, self._white = eigenpairs(data, len(self._held), min_eigenvalue, random)
        self._slope = reduced.regular_gradient(self.x)[self._held]
        """Of the regularisers at x*, where the data's is its opposite."""

    @cached_property
    def data_coordinates(self) -> tuple[Array, Array]:
        """U and y of the data y = Uᵀf + e on the regularised unknowns f, with e of unit variance, along the known eigenvectors.

        Hence S = U Uᵀ, and at x* the regularisers balance these data.
        """
        vectors, root = self._vectors(), np.sqrt(self.eigenvalues)
        U = (self.regular @ vectors) * root
        return U, U.T @ self.x[self._held] + (vectors.T @ self._slope) / root

    def with_regularisers(
        self, regularisers: Mapping[str, QuadraticRegulariser], weights: Mapping[str, float]
    ) -> Posterior:
        """Posterior of the same data with other regularisers of the same blocks; x* moves to their new balance.

        Exact for data that are linear in x, otherwise one Gauss-Newton step.

        Parameters
        ----------
        regularisers : mapping of str to QuadraticRegulariser
            Regulariser of each block.
        weights : mapping of str to float
            Weight of each block.

        Returns
        -------
        Posterior

        Raises
        ------
        InputError
            If a regulariser is singular.
        """
        U, y = self.data_coordinates
        parts = [weights[name] * regularisers[name].matrix(np.zeros(0)) for name in self.regularised]
        regular = sp.csr_array(sp.block_diag(parts))
        reference = np.concatenate([regularisers[name].reference for name in self.regularised])
        other = copy(self)
        for name in ("data_coordinates", "remaining_variance"):
            other.__dict__.pop(name, None)
        other.regular, other.reference, other._metric = regular, reference, _metric(regular)
        white = other._metric.whiten_gradient(U)
        values, turn = np.linalg.eigh(white.T @ white)
        keep = values > SINGULAR * values.max()
        values, turn = values[keep][::-1], turn[:, keep][:, ::-1]
        other.eigenvalues, other._white = values, white @ (turn / np.sqrt(values))
        off = turn @ ((turn.T @ (y - U.T @ reference)) / (1 + values))
        step = other._metric.unwhiten(white @ off)
        moved = reference + step - self.x[self._held]
        other.x = self.x.copy()
        other.x[self._held] += moved
        other.x[self._loose] -= self._response @ moved
        other._slope = regular @ step
        return other

    @property
    def variance_reduction(self) -> Array:
        """Share λ/(1 + λ) of the prior variance that the data remove, by direction."""
        return self.eigenvalues / (1 + self.eigenvalues)

    @property
    def informed_directions(self) -> list[InformedDirection]:
        """Directions along which the data are more informative than the prior, λ > 1, in descending order."""
        return [self.direction(i) for i in range(int(np.sum(self.eigenvalues > 1)))]

    def direction(self, i: int) -> InformedDirection:
        """Direction of the i-th eigenvalue, one prior standard deviation long."""
        v = self._vectors(slice(i, i + 1))[:, 0]
        x = np.zeros(len(self.x))
        x[self._held], x[self._loose] = v, -self._response @ v
        parts = v * (self.regular @ v)
        return InformedDirection(
            float(self.eigenvalues[i]),
            x,
            {name: float(parts[self._block_mask(name)].sum()) for name in self.regularised},
        )

    @property
    def effective_parameters(self) -> dict[str, float]:
        """Effective number of parameters of each regularised block, n - tr(R_b C_bb), from the known eigenvalues."""
        vectors = self._vectors()
        parts = vectors * (self.regular @ vectors)
        return {
            name: float(parts[self._block_mask(name)].sum(axis=0) @ self.variance_reduction)
            for name in self.regularised
        }

    @cached_property
    def remaining_variance(self) -> dict[str, float]:
        """Share of the prior variance that remains, averaged over each block: 1 where the data are uninformative.

        It is 0 for blocks without a regulariser, which have no prior.
        """
        return dict.fromkeys(self.blocks, 0.0) | {
            name: self.mean_remaining_variance(self.selection_matrix(name)) for name in self.regularised
        }

    def mean_remaining_variance(self, rows: sp.csr_array) -> float:
        """Share of the prior variance of B x that remains (regularised unknowns only), averaged over the rows of B."""
        taken = float(np.sum((rows[:, self._held] @ self._vectors()) ** 2 @ self.variance_reduction))
        return 1 - taken / (taken + float(np.sum(self.variance(rows))))

    @property
    def notes(self) -> list[str]:
        """What the data determine and what they do not, in words."""
        return self.describe_remaining_variance(self.remaining_variance)

    def describe_remaining_variance(self, left: Mapping[str, float]) -> list[str]:
        """Notes from the remaining share of the prior variance of each field, for fields whose coefficients are not values."""
        number, notes = int(np.sum(self.eigenvalues > 1)), []
        if self.regularised:
            numbers = ", ".join(f"{value:.1f} of {name}" for name, value in self.effective_parameters.items())
            notes.append(f"data inform {number} directions more than the prior; effective parameters: {numbers}")
        for name, share in left.items():
            if share > 0.5:
                notes.append(
                    f"{100 * share:.0f} % of the prior variance of {name} remains: its intervals are mostly prior"
                )
        return notes

    def variance(self, rows: sp.csr_array | Array) -> Array:
        """Variance (m,) of linear functions B x, with B (m, unknowns); `InputError` for another number of columns."""
        rows = sp.csr_array(rows)
        if rows.shape[1] != len(self.x):
            raise InputError("rows", f"of {rows.shape[1]} columns", f"{len(self.x)}, one for each unknown")
        if rows.shape[0] > EXACT:
            return np.mean([np.mean((rows @ off.T) ** 2, axis=1) for off in self._draw_deviations(DRAWS)], axis=0)
        starts = range(0, rows.shape[0], BATCH)
        return np.concatenate([self._variance(rows[i : i + BATCH]) for i in starts] or [np.empty(0)])

    def covariance(self) -> Array:
        """Covariance of all unknowns (n, n), for few: each pair takes a row of `variance`."""
        n = len(self.x)
        i, j = np.triu_indices(n, 1)
        own = self.variance(np.eye(n))
        pairs = (self.variance(np.eye(n)[i] + np.eye(n)[j]) - own[i] - own[j]) / 2 if n > 1 else np.zeros(0)
        found = np.diag(own)
        found[i, j] = found[j, i] = pairs
        return found

    def deviation(self, name: str) -> Array:
        """Standard deviation of a block of x."""
        return np.sqrt(self.variance(self.selection_matrix(name)))

    def selection_matrix(self, name: str) -> sp.csr_array:
        """Matrix that selects a block of x; `InputError` for an unknown name."""
        if name not in self.blocks:
            raise InputError("block", repr(name), "one of " + ", ".join(self.blocks))
        return sp.csr_array(sp.eye_array(len(self.x), format="csr")[self.blocks[name]])

    def interval(self, name: str, level: float = LEVEL) -> CredibleInterval:
        """Credible interval of the values of a block, in their own units.

        Parameters
        ----------
        name : str
            Name of the block.
        level : float
            Probability.

        Returns
        -------
        CredibleInterval

        Raises
        ------
        InputError
            If the unknowns are not `ParameterFields`, or there is no such block.
        """
        if not isinstance(self.unknowns, ParameterFields):
            raise InputError("unknowns", type(self.unknowns).__name__, "ParameterFields, which have transforms")
        rows = self.selection_matrix(name)
        return CredibleInterval.from_gaussian(
            rows @ self.x, np.sqrt(self.variance(rows)), self.unknowns.unknowns[name].transform, level
        )

    def draws(self, number: int, seed: int = 0) -> Array:
        """Draw x from the posterior.

        Parameters
        ----------
        number : int
            Number of draws.
        seed : int
            Seed.

        Returns
        -------
        array (number, unknowns)
        """
        random = np.random.default_rng(seed)
        x = np.tile(self.x, (number, 1))
        if self._metric is not None:
            white = random.normal(size=(len(self._held), number))
            less = 1 - 1 / np.sqrt(1 + self.eigenvalues)
            off = self._metric.unwhiten(white - self._white @ (less[:, None] * (self._white.T @ white)))
            x[:, self._held] += off.T
            x[:, self._loose] -= (self._response @ off).T
        free = random.normal(size=(len(self._loose), number))
        x[:, self._loose] += scipy.linalg.solve_triangular(self._factor, free, trans="T", lower=True).T
        return x

    def linearised_interval(
        self, function: Callable[[Array], float], gradient: Callable[[Array], Array], level: float = LEVEL
    ) -> CredibleInterval:
        """Credible interval of a function of θ by linear error propagation; accurate where it is nearly linear within the interval.

        Parameters
        ----------
        function : callable
            θ ↦ a number.
        gradient : callable
            θ ↦ its derivative with respect to θ, see `adjoint.check.taylor`.
        level : float
            Probability.

        Returns
        -------
        CredibleInterval
        """
        theta = self.unknowns.theta(self.x)
        slope = self.unknowns.jacobian(self.x).T @ gradient(theta)
        deviation = np.sqrt(self.variance(slope[None]))
        interval = CredibleInterval.from_gaussian(np.array([function(theta)]), deviation, None, level)
        value, low, high = (float(np.ravel(each)[0]) for each in (interval.value, interval.low, interval.high))
        return CredibleInterval(value, float(deviation[0]), low, high)

    def sampled_interval(
        self,
        function: Callable[[Array], float | Array],
        level: float = LEVEL,
        number: int = DRAWS,
        seed: int = 0,
        executor: parallel.AnyExecutor = None,
    ) -> CredibleInterval:
        """Credible interval of any function of θ, by sampling.

        Parameters
        ----------
        function : callable
            θ ↦ a number or an array.
        level : float
            Probability.
        number : int
            Number of draws.
        seed : int
            Seed.
        executor : executor or int, optional
            Evaluates the function, one task per draw (`parallel.run`). Default this process. Others need functions of modules.

        Returns
        -------
        CredibleInterval
        """
        every = [self.x, *self.draws(number, seed)]
        if executor in (None, 1):
            value, *values = (function(self.unknowns.theta(x)) for x in every)
        else:
            tasks = [parallel.Task(f"draw {i}", _call, (function, self.unknowns.theta(x))) for i, x in enumerate(every)]
            value, *values = parallel.run(tasks, executor).values()
        return CredibleInterval.from_samples(value, np.array(values), level)

    def _eliminate(self, point: Point) -> None:
        columns = np.empty((len(self.x), len(self._loose)))
        for j, number in enumerate(self._loose):
            one = np.zeros(len(self.x))
            one[number] = 1
            columns[:, j] = point.product(one)
        own = columns[self._loose]
        scale = np.sqrt(np.maximum(np.diag(own), 0))
        try:
            with np.errstate(invalid="ignore"):  # of an unknown without influence
                root = np.linalg.cholesky((own + own.T) / (2 * np.outer(scale, scale)))
            if not np.all(np.diag(root) ** 2 > SINGULAR):
                raise np.linalg.LinAlgError
        except np.linalg.LinAlgError:
            names = ", ".join(name for name in self.blocks if name not in self.regularised)
            raise InputError(
                "regularisers", f"none for {names}", "a regulariser: the data do not determine it"
            ) from None
        self._factor = scale[:, None] * root
        self._response = scipy.linalg.cho_solve((self._factor, True), columns[self._held].T)

    def _variance(self, rows: sp.csr_array) -> Array:
        loose = rows[:, self._loose].toarray().T
        held = rows[:, self._held].toarray().T - self._response.T @ loose
        variance = np.sum(scipy.linalg.solve_triangular(self._factor, loose, lower=True) ** 2, axis=0)
        if self._metric is not None:
            white = self._metric.whiten_gradient(held)
            variance += np.sum(white**2, axis=0) - self.variance_reduction @ (self._white.T @ white) ** 2
        return variance

    def _draw_deviations(self, number: int) -> Iterator[Array]:
        """Draws less x*, in batches."""
        for seed, start in enumerate(range(0, number, BATCH)):
            yield self.draws(min(BATCH, number - start), seed) - self.x

    def _vectors(self, which: slice = slice(None)) -> Array:
        white = self._white[:, which]
        return white if self._metric is None else self._metric.unwhiten(white)

    def block_indices(self, name: str) -> Array:
        """Indices of a regularised block among all regularised unknowns."""
        return np.flatnonzero(self._block_mask(name))

    def _block_mask(self, name: str) -> Array:
        """Mask of a regularised block among all regularised unknowns."""
        block = self.blocks[name]
        return (self._held >= block.start) & (self._held < block.stop)


def _call(function: Callable[[Array], float | Array], theta: Array, *, callback: parallel.Callback) -> float | Array:
    return function(theta)


def _metric(regular: sp.csr_array) -> Metric:
    probe = np.random.default_rng(0).normal(size=regular.shape[0])
    try:
        with np.errstate(invalid="ignore"):
            metric = Metric(regular)
        if np.allclose(regular @ metric.unwhiten(metric.whiten_gradient(probe)), probe, atol=1e-4):
            return metric
    except RuntimeError:
        pass
    raise InputError("regularisers", "singular", "regularisers with a non-singular matrix")
