"""How far unknowns may be off, to second order around the point where an inversion ended: N(x*, H⁻¹), H = JᵀWJ + Σ αR.

Σ αR is the inverse of the covariance that was assumed before anything was measured. Unknowns without a regulariser are
eliminated: with H_bb their own part of H and T = H_bb⁻¹ H_bf, the others have S + R, S = (JᵀWJ)_ff - H_fb T. By the eigenvalues

    S v_i = λ_i R v_i ,   v_i·R v_j = δ_ij ,      (S + R)⁻¹ ≈ R⁻¹ - Σ λ_i/(1 + λ_i) v_i v_iᵀ     over all λ_i > `least`

the data take a share λ/(1 + λ) of the variance along v_i away. What is neglected is positive, and hardly more than `least` of
R: a standard deviation is never too small, and too large by a factor of about √(1 + least) at most.

Weights of regularisers and the level of noise count as known. With edges, R is the matrix of the last step.
Sources: Bui-Thanh, Ghattas, Martin, Stadler 2013, 10.1137/12089586X; Spantini et al. 2015, 10.1137/140977308; Villa, Petra,
Ghattas 2021, 10.1145/3428447.
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

Array = np.ndarray
LEAST = 0.1
"""Eigenvalue below which data are neglected: standard deviations are 5 % too large at most."""
BATCH = 256
"""Rows of which variances are computed at a time."""
EXACT, DRAWS = 20_000, 1000
"""Rows up to which variances are exact; of more they are those of so many draws, within 2.2 % (one standard error)."""
SINGULAR = 1e-13
"""Pivot of a matrix with ones on its diagonal, below which an unknown counts as not determined."""


@dataclass(frozen=True)
class InformedDirection:
    """A direction of x: what data say of it in units of what was assumed (λ), and the blocks that it lies in (shares)."""

    eigenvalue: float
    x: Array
    shares: dict[str, float]

    @property
    def name(self) -> str:
        """Such as "storage 0.93, loss 0.07"."""
        largest = sorted(self.shares.items(), key=lambda share: -share[1])
        return ", ".join(f"{name} {share:.2f}" for name, share in largest if share >= 0.005)


class Posterior:
    """N(x*, C) of a point.

    point   of any model; it has to be at hand only while this is made
    least   eigenvalue below which data are neglected; 0: none are
    seed    of the eigensolver's random vectors

    `regular` is Σ αR of all regularised unknowns, `reference` the values that it draws them to.

    It takes one Gauss-Newton product for each unknown without a regulariser, and two for each eigenvalue found.

    Raises `InputError` where a regulariser leaves something free (its matrix is singular), and where an unknown without one is
    not determined by the data.

    >>> from ngbrain.inverse.phantoms.benchmark import Phantom
    >>> inversion = Phantom.from_name("CV-G", 5).simulate_measurements(0.01).inversion()
    >>> posterior = Posterior(inversion.reduced.evaluate(inversion.start))
    >>> band = posterior.interval("storage")
    >>> bool(np.all((0 < band.low) & (band.low < band.value) & (band.value < band.high)))
    True
    """

    def __init__(self, point: Point, min_eigenvalue: float = LEAST, seed: int = 0) -> None:
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
        """What data say of the regularised unknowns f, as far as it is known: numbers y = Uᵀf + e, e of unit variance; U and y.

        So S = U Uᵀ, and x* is where its regularisers and these numbers balance.
        """
        vectors, root = self._vectors(), np.sqrt(self.eigenvalues)
        U = (self.regular @ vectors) * root
        return U, U.T @ self.x[self._held] + (vectors.T @ self._slope) / root

    def with_regularisers(
        self, regularisers: Mapping[str, QuadraticRegulariser], weights: Mapping[str, float]
    ) -> Posterior:
        """The same data with other regularisers of the same blocks. x* moves to where they balance then.

        Exact for data that are linear in x, else one Gauss-Newton step. Raises `InputError` for a singular matrix.
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
        """λ/(1 + λ): the share of the variance that data take away, by direction."""
        return self.eigenvalues / (1 + self.eigenvalues)

    @property
    def informed_directions(self) -> list[InformedDirection]:
        """Directions along which data say more than was assumed, λ > 1, most of it first."""
        return [self.direction(i) for i in range(int(np.sum(self.eigenvalues > 1)))]

    def direction(self, i: int) -> InformedDirection:
        """That of the i-th eigenvalue, one standard deviation of what was assumed long."""
        v = self._vectors(slice(i, i + 1))[:, 0]
        x = np.zeros(len(self.x))
        x[self._held], x[self._loose] = v, -self._response @ v
        parts = v * (self.regular @ v)
        return InformedDirection(
            float(self.eigenvalues[i]), x, {name: float(parts[self._of(name)].sum()) for name in self.regularised}
        )

    @property
    def effective_parameters(self) -> dict[str, float]:
        """How many numbers of each regularised block the data determine, n - tr(R_b C_bb), as far as eigenvalues are known."""
        vectors = self._vectors()
        parts = vectors * (self.regular @ vectors)
        return {name: float(parts[self._of(name)].sum(axis=0) @ self.variance_reduction) for name in self.regularised}

    @cached_property
    def remaining_variance(self) -> dict[str, float]:
        """Block → share of the assumed variance that is left, its mean over the block: 1 where data say nothing.

        It is 0 for blocks without a regulariser, of which nothing was assumed.
        """
        return dict.fromkeys(self.blocks, 0.0) | {
            name: self.mean_remaining_variance(self.selection_matrix(name)) for name in self.regularised
        }

    def mean_remaining_variance(self, rows: sp.csr_array) -> float:
        """Of the variance that was assumed of B x, regularised unknowns alone, the share that is left, its mean over the rows."""
        taken = float(np.sum((rows[:, self._held] @ self._vectors()) ** 2 @ self.variance_reduction))
        return 1 - taken / (taken + float(np.sum(self.variance(rows))))

    @property
    def notes(self) -> list[str]:
        """What the data tell and what they do not, in words."""
        return self.describe_remaining_variance(self.remaining_variance)

    def describe_remaining_variance(self, left: Mapping[str, float]) -> list[str]:
        """So of fields whose unknowns are no values: name → the share of the variance assumed of its values that is left."""
        number, notes = int(np.sum(self.eigenvalues > 1)), []
        if self.regularised:
            told = ", ".join(f"{value:.1f} of {name}" for name, value in self.effective_parameters.items())
            notes.append(f"data inform {number} directions more than was assumed; numbers determined: {told}")
        for name, share in left.items():
            if share > 0.5:
                notes.append(
                    f"of the variance assumed of {name}, {100 * share:.0f} % is left: its bands are mostly assumed"
                )
        return notes

    def variance(self, rows: sp.csr_array | Array) -> Array:
        """Variance (m,) of linear functions of x, B x with B (m, unknowns).

        Raises `InputError` for another number of columns.
        """
        rows = sp.csr_array(rows)
        if rows.shape[1] != len(self.x):
            raise InputError("rows", f"of {rows.shape[1]} columns", f"{len(self.x)}, one for each unknown")
        if rows.shape[0] > EXACT:
            return np.mean([np.mean((rows @ off.T) ** 2, axis=1) for off in self._offs(DRAWS)], axis=0)
        starts = range(0, rows.shape[0], BATCH)
        return np.concatenate([self._variance(rows[i : i + BATCH]) for i in starts] or [np.empty(0)])

    def covariance(self) -> Array:
        """Of all unknowns (n, n): of few, as each pair takes a row of `variance`."""
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
        """The matrix that takes a block out of x; `InputError` for a name that is none."""
        if name not in self.blocks:
            raise InputError("block", repr(name), "one of " + ", ".join(self.blocks))
        return sp.csr_array(sp.eye_array(len(self.x), format="csr")[self.blocks[name]])

    def interval(self, name: str, level: float = LEVEL) -> CredibleInterval:
        """Of the values looked for in a block, in their own units: the interval of x through the change of variable.

        Raises `InputError` unless unknowns are `Fields`.
        """
        if not isinstance(self.unknowns, ParameterFields):
            raise InputError("unknowns", type(self.unknowns).__name__, "Fields: others say nothing of their transforms")
        rows = self.selection_matrix(name)
        return CredibleInterval.from_gaussian(
            rows @ self.x, np.sqrt(self.variance(rows)), self.unknowns.unknowns[name].transform, level
        )

    def draws(self, number: int, seed: int = 0) -> Array:
        """So many x of the posterior (number, unknowns)."""
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
        """Of a number computed from θ, by its slope: right where it is nearly linear within the band.

        function, gradient   θ ↦ a number and its derivatives by θ, see `adjoint.check.taylor`
        """
        theta = self.unknowns.theta(self.x)
        slope = self.unknowns.jacobian(self.x).T @ gradient(theta)
        deviation = np.sqrt(self.variance(slope[None]))
        band = CredibleInterval.from_gaussian(np.array([function(theta)]), deviation, None, level)
        return CredibleInterval(float(band.value[0]), float(deviation[0]), float(band.low[0]), float(band.high[0]))  # type: ignore[index]

    def sampled_interval(
        self,
        function: Callable[[Array], float | Array],
        level: float = LEVEL,
        number: int = DRAWS,
        seed: int = 0,
        executor: parallel.AnyExecutor = None,
    ) -> CredibleInterval:
        """Of numbers computed from θ, by as many draws: whatever function it is.

        executor  who calls it, a task for each draw (`parallel.run`); by default this process. Others find functions of modules
        """
        every = [self.x, *self.draws(number, seed)]
        if executor in (None, 1):
            value, *values = (function(self.unknowns.theta(x)) for x in every)
        else:
            tasks = [
                parallel.Task(f"draw {i}", _called, (function, self.unknowns.theta(x))) for i, x in enumerate(every)
            ]
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
            with np.errstate(invalid="ignore"):  # of one that nothing depends on
                root = np.linalg.cholesky((own + own.T) / (2 * np.outer(scale, scale)))
            if not np.all(np.diag(root) ** 2 > SINGULAR):
                raise np.linalg.LinAlgError
        except np.linalg.LinAlgError:
            names = ", ".join(name for name in self.blocks if name not in self.regularised)
            raise InputError("regularisers", f"none for {names}", "one: the data do not determine it") from None
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

    def _offs(self, number: int) -> Iterator[Array]:
        """Draws less x*, in batches."""
        for seed, start in enumerate(range(0, number, BATCH)):
            yield self.draws(min(BATCH, number - start), seed) - self.x

    def _vectors(self, which: slice = slice(None)) -> Array:
        white = self._white[:, which]
        return white if self._metric is None else self._metric.unwhiten(white)

    def block_indices(self, name: str) -> Array:
        """Where (indices) a regularised block is among all that are."""
        return np.flatnonzero(self._of(name))

    def _of(self, name: str) -> Array:
        """Where a regularised block is among all that are."""
        block = self.blocks[name]
        return (self._held >= block.start) & (self._held < block.stop)


def _called(function: Callable[[Array], float | Array], theta: Array, *, callback: parallel.Callback) -> float | Array:
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
    raise InputError("regularisers", "singular", "one that leaves no unknown of its block free")
