"""Smooth fields through scattered points by moving least squares, with the radius by leave-one-out cross-validation."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from ngbrain.errors import InputError
from ngbrain.inverse.data.smooth_field import SmoothField
from ngbrain.io.waves.data import WaveData

_NEIGHBOURS = (1.3, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.5, 8.0, 11.0)  # to try, times the coefficients of a polynomial
_LEFT_OUT = 4000  # points at most that are predicted from the others
_RIDGE = 1e-14  # of the trace of the normal equations
_CHUNK = 4_000_000  # numbers at a time


class LeastSquaresField(SmoothField):
    """Moving least squares; see `moving_least_squares`.

    Parameters
    ----------
    data : WaveData
        The data.
    degree : int
        Degree of the polynomials.

    Attributes
    ----------
    neighbours : numpy.ndarray
        (loads, d) number of points to which a polynomial is fitted; 0 where a component is not measured.
    """

    def __init__(self, data: WaveData, degree: int) -> None:
        self.points, self.degree, self.axes = data.points, degree, np.eye(data.dim)
        self.powers = _powers(data.dim, degree)
        self.noise = np.full((data.loads, len(data.components)), np.nan)
        self.neighbours = np.zeros(self.noise.shape, int)
        # Components that are measured at the same points share their fits: bits of the points → components.
        alike: dict[bytes, list[tuple[int, int]]] = {}
        known = data.measured & data.mask[None, :, None]
        for load, i in np.ndindex(self.noise.shape):
            if known[load, :, i].sum() >= 2 * len(self.powers):
                alike.setdefault(known[load, :, i].tobytes(), []).append((load, i))
        if not alike:
            raise InputError("points", f"{known.any(axis=(0, 2)).sum()} measured", f"at least {2 * len(self.powers)}")
        self._fitted: list[tuple[KDTree, np.ndarray, np.ndarray]] = []
        for same in alike.values():
            load, i = which = np.array(same).T
            at = known[same[0][0], :, same[0][1]]
            tree, values = KDTree(data.points[at]), data.displacement[load, :, i][:, at].T
            self._fitted.append((tree, values, which))
            self.neighbours[load, i], self.noise[load, i] = self._choose_neighbours(tree, values)

    def _choose_neighbours(self, tree: KDTree, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """For each column, the number of neighbours that predicts left-out points best, and the noise."""
        columns = np.arange(values.shape[1])
        some = np.random.default_rng(0).permutation(tree.n)[:_LEFT_OUT]
        counts = [k for factor in _NEIGHBOURS if (k := int(factor * len(self.powers)) + 1) <= tree.n]
        scores, noises = [], []
        for k in counts:
            fitted, own = self._fit(tree, values, k, tree.data[some], (0,) * tree.m)
            left = np.abs(values[some] - fitted) ** 2
            scores.append(np.mean(left / np.maximum(1 - own, 1e-6)[:, None] ** 2, axis=0))
            noises.append(np.sqrt(left.sum(axis=0) / np.sum(1 - own)))
        best = np.argmin(scores, axis=0)
        return np.array(counts)[best], np.array(noises)[best, columns]

    def derivative(self, orders: tuple[int, ...], points: np.ndarray | None = None) -> np.ndarray:
        """Return a derivative of the polynomial that is fitted around each point.

        Parameters
        ----------
        orders : tuple of int
            Order of differentiation along each of `axes`.
        points : numpy.ndarray, optional
            (n, d) m; by default the points of the data.

        Returns
        -------
        numpy.ndarray
            (loads, n, d)
        """
        if sum(orders) > self.degree:
            raise InputError("orders", orders, f"at most {self.degree} in all, the degree of the polynomials")
        where = self.points if points is None else np.asarray(points, float)
        u = np.full((*self.noise.shape, len(where)), np.nan, complex)
        for tree, values, (load, i) in self._fitted:
            for k in np.unique(self.neighbours[load, i]):
                these = self.neighbours[load, i] == k
                u[load[these], i[these]] = self._fit(tree, values[:, these], int(k), where, orders)[0].T
        return u.transpose(0, 2, 1)

    def _fit(
        self, tree: KDTree, values: np.ndarray, k: int, where: np.ndarray, orders: tuple[int, ...]
    ) -> tuple[np.ndarray, np.ndarray]:
        """A derivative of each column at `where`, and there the influence of a point on its own value."""
        column = int(np.flatnonzero((self.powers == orders).all(axis=1))[0])
        u, own = np.empty((len(where), values.shape[1]), complex), np.empty(len(where))
        factorial = np.prod([np.prod(np.arange(1, order + 1)) for order in orders])
        step = max(1, _CHUNK // (k * len(self.powers)))
        for start in range(0, len(where), step):
            part = slice(start, start + step)
            distance, index = tree.query(where[part], k=k)
            radius = 1.05 * distance[:, -1]
            local = (tree.data[index] - where[part, None]) / radius[:, None, None]
            ratio = distance / radius[:, None]
            weight = (1 - ratio) ** 4 * (4 * ratio + 1)  # Wendland's, C²
            P = _monomials(local, self.powers)
            normal = np.swapaxes(P * weight[:, :, None], 1, 2) @ P
            # On lattices few neighbours may not determine a polynomial: such k predict badly, but must not be singular.
            ridge = _RIDGE * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(len(self.powers))
            rows = np.linalg.inv(normal + ridge)[:, [column, 0]] @ np.swapaxes(P, 1, 2) * weight[:, None]
            u[part] = (rows[:, :1] @ values[index])[:, 0] * (factorial / radius ** sum(orders))[:, None]
            own[part] = rows[:, 1, 0]  # the nearest is the point itself
        return u, own


def moving_least_squares(data: WaveData, degree: int = 3) -> LeastSquaresField:
    """Fit moving least squares through the measured points of the mask, with the radius by leave-one-out cross-validation.

    Around each place a polynomial is fitted to its k nearest points with Wendland's weight w(s) = (1 - s)⁴(4s + 1), where s
    is the distance over 1.05 times that of the farthest of them. u and its derivatives are those of the polynomial there
    (diffuse derivatives). k has the smallest Σ|(u - û)/(1 - h)|², with h the influence of a point on its own value; this is
    the error of predicting each point from the others. The noise is √(Σ|u - û|²/Σ(1 - h)).

    Parameters
    ----------
    data : WaveData
        The data.
    degree : int
        Degree of the polynomials.

    Returns
    -------
    LeastSquaresField
        The field.

    Raises
    ------
    InputError
        Fewer than twice as many points are measured as a polynomial has coefficients.

    References
    ----------
    Lancaster & Salkauskas 1981, doi:10.1090/S0025-5718-1981-0616367-1.

    Examples
    --------
    >>> points = np.random.default_rng(0).uniform(0, 0.1, (200, 2))
    >>> u = 1e-3 * np.stack([points[:, 0] ** 3, points[:, 1]], axis=1)[None]
    >>> field = moving_least_squares(WaveData(points, u, [50.0], 1000.0, "isotropic", "elastic", poisson=0.49))
    >>> field.laplacian(np.array([[0.05, 0.05]]))[0, 0].real.round(8).tolist()
    [0.0003, 0.0]
    """
    return LeastSquaresField(data, degree)


def _powers(d: int, degree: int) -> np.ndarray:
    """Exponents of the monomials up to the degree, (m, d), the constant first."""
    each = np.indices((degree + 1,) * d).reshape(d, -1).T
    each = each[each.sum(axis=1) <= degree]
    return each[np.argsort(each.sum(axis=1), kind="stable")]


def _monomials(x: np.ndarray, powers: np.ndarray) -> np.ndarray:
    """Monomials (…, m) of x (…, d)."""
    steps = [np.stack([x[..., i] ** power for power in range(powers.max() + 1)], axis=-1) for i in range(x.shape[-1])]
    return np.prod([step[..., powers[:, i]] for i, step in enumerate(steps)], axis=0)
