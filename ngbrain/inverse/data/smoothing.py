"""Smooth fields through noisy displacements: tensor-product splines on grids, moving least squares through scattered points.

The smoothness is chosen by generalised cross-validation (Golub, Heath & Wahba 1979, doi:10.1080/00401706.1979.10489751) or by
leave-one-out cross-validation.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
import scipy

from ngbrain.errors import InputError
from ngbrain.inverse.data.moving_least_squares import moving_least_squares
from ngbrain.inverse.data.smooth_field import SmoothField
from ngbrain.io.waves.data import WaveData
from ngbrain.io.waves.grid import Grid

_DEGREE = 5  # quintic: the Laplacian of a curl, a third derivative, is still smooth
FEWEST = _DEGREE + 3
"""Points along each axis of a grid for splines."""
_GROWTH = 1.2  # from one number of knots to try to the next
_PATIENCE = 2  # numbers tried after the best
_TOUCHED = 0.05  # share of a spline's weight on points that count, from which it counts as a coefficient


def fit_smooth_field(data: WaveData) -> SmoothField:
    """Fit a smooth field through the measured points of the mask: `fit_splines` on a grid, else `moving_least_squares`.

    Grids of few points along an axis, such as slabs, take moving least squares too.

    Examples
    --------
    >>> points = np.array([[x, y] for y in range(12) for x in range(12)]) * 0.01
    >>> u = 1e-5 * np.stack([np.sin(20 * points[:, 1]), np.cos(20 * points[:, 0])], axis=1)[None]
    >>> data = WaveData(points, u, [50.0], 1000.0, "isotropic", "elastic", poisson=0.49)
    >>> bool(np.abs(fit_smooth_field(data).laplacian() / -400 - u).max() < 1e-7)
    True
    """
    if data not in _KNOWN:
        _KNOWN[data] = fit_splines(data) if supports_splines(data) else moving_least_squares(data)
    return _KNOWN[data]


def supports_splines(data: WaveData) -> bool:
    """Whether the points are a grid with enough points along each axis."""
    return data.grid is not None and min(data.grid.shape) >= FEWEST


_KNOWN: WeakKeyDictionary[WaveData, SmoothField] = WeakKeyDictionary()
"""Fields of data that still exist: those of a head take a minute, and start values, element sizes and SNRs need them."""


@dataclass(frozen=True, eq=False)
class _Component:
    """A scalar spline on a grid: knots along each axis, and coefficients."""

    knots: tuple[np.ndarray, ...]
    coefficients: np.ndarray
    noise: float


class SplineField(SmoothField):
    """Tensor products of quintic B-splines, a scalar spline for each component of each load; see `fit_splines`.

    Parameters
    ----------
    points : numpy.ndarray
        (n, d) points of the data, m.
    grid : Grid
        Their grid.
    components : list of list
        For each load the spline of each component; None where it is not measured.
    """

    def __init__(self, points: np.ndarray, grid: Grid, components: list[list[_Component | None]]) -> None:
        self.points, self.grid, self.components, self.axes = points, grid, components, grid.axes
        self.noise = np.array([[each.noise if each else np.nan for each in load] for load in components])

    def derivative(self, orders: tuple[int, ...], points: np.ndarray | None = None) -> np.ndarray:
        """Return a derivative of u. Beyond the grid its last polynomials continue.

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
        on_data = points is None or np.array_equal(points, self.points)  # there the axes are applied one by one
        points = self.points if points is None else np.asarray(points, float)
        where = None if on_data else self.grid.coordinates(points)
        u = np.full((len(self.components), len(points), len(self.components[0])), np.nan, complex)
        for load, fitted in enumerate(self.components):
            for i, one in enumerate(fitted):
                if one:
                    u[load, :, i] = self._on_grid(one, orders) if where is None else _evaluate(one, orders, where)
        return u

    def _on_grid(self, one: _Component, orders: tuple[int, ...]) -> np.ndarray:
        lines = zip(self.grid.shape, self.grid.spacing, one.knots, orders, strict=True)
        basis = [_basis(h * np.arange(n), knots, order) for n, h, knots, order in lines]
        return self.grid.flat(_apply_along_axes(basis, one.coefficients))


def fit_splines(data: WaveData, full: float = 0.9) -> SplineField:
    """Fit tensor-product quintic splines by least squares through the measured points of the mask, with the number of knots by
    GCV.

    Along each axis the knots are equally spaced, with about the same spacing on all axes. Of increasing numbers of
    coefficients p, the one with the smallest

        GCV(p) = n Σ|u - û|² / (n - p)²

    is taken, for each component of each load. The noise is √(Σ|u - û|²/(n - p)). Points outside the mask have no weight.
    Where the fit is not unique, it is the smallest one (in the sum of squares over the grid).

    Parameters
    ----------
    data : WaveData
        Data on a grid.
    full : float
        Most coefficients for each measured point. With .9 exact data are met closest, with their derivatives, but may be
        missed by their own size between points near the edge; with .3 by less than 1e-3 everywhere.

    Returns
    -------
    SplineField
        The field.

    Raises
    ------
    InputError
        The points are no grid, or one of fewer than 8 points along an axis; or a component is measured at no more than 6 to
        the power of the dimension points of the mask, the coefficients of the smallest spline.
    """
    grid = data.grid
    if grid is None or min(grid.shape) < FEWEST:
        found = "scattered" if grid is None else f"a grid of {' x '.join(map(str, grid.shape))}"
        raise InputError("points", found, f"a grid with at least {FEWEST} points along each axis")
    components: list[list[_Component | None]] = []
    number = 0  # of knots that is best, as `_counts` has it: about the same for all components
    for u, measured in zip(data.displacement, data.measured, strict=True):
        weights = measured & data.mask[:, None]
        boxes = [(grid.box(w), grid.box(np.where(w, each, 0))) for each, w in zip(u.T, weights.T, strict=True)]
        fitted: list[_Component | None] = []
        for weight, values in boxes:
            if not weight.any():
                fitted.append(None)
                continue
            component, number = _best_spline(grid, values, weight, full, max(number - _PATIENCE, 0))
            fitted.append(component)
        components.append(fitted)
    return SplineField(data.points, grid, components)


def _best_spline(
    grid: Grid, values: np.ndarray, weight: np.ndarray, full: float, first: int = 0
) -> tuple[_Component, int]:
    """The spline, and its index in `_counts`, which are tried from the `first` on; from 0 on if that is the best of them."""
    n, best, least, waited, place = int(weight.sum()), None, np.inf, 0, first
    if n <= (wanted := (_DEGREE + 1) ** len(grid.shape)):
        raise InputError("mask", f"true at {n} measured points", f"more than {wanted}")
    for i, counts in enumerate(_counts(grid)[first:], first):
        fit = _Fit(grid, counts, weight)
        if (p := fit.size) > max(full * n, wanted):
            break
        coefficients, misfit = fit.solve(values, tolerance=1e-3)
        score = n * misfit / (n - p) ** 2
        if score < least:
            best, least, waited, place = fit, score, 0, i
        elif (waited := waited + 1) == _PATIENCE:
            break
    if place == first > 0:
        return _best_spline(grid, values, weight, full)
    if best is None:
        raise InputError("mask", f"true at {n} measured points, far apart", "points that determine a spline")
    coefficients, misfit = best.solve(values, tolerance=1e-8)
    return _Component(best.knots, coefficients, float(np.sqrt(misfit / (n - best.size)))), place


def _counts(grid: Grid) -> list[tuple[int, ...]]:
    """Numbers of equal intervals between knots along each axis, increasing, fewer than there are points."""
    shape, spacing = np.array(grid.shape), grid.spacing
    length = (shape - 1) * spacing
    number = np.unique(np.round(_GROWTH ** np.arange(0, 60)))
    found = [np.clip(np.round(m * length / length.max()), 1, shape - _DEGREE - 1) for m in number if m <= shape.max()]
    return list(dict.fromkeys(tuple(int(m) for m in each) for each in found))


class _Fit:
    """Splines with one number of knots, and the points that they are fitted to.

    Unknowns are the coefficients of an orthonormal basis of the splines on the grid's points. So the matrix of the normal
    equations is the identity where all points count, and conjugate gradients need one step.
    """

    def __init__(self, grid: Grid, counts: tuple[int, ...], weight: np.ndarray) -> None:
        lines = list(zip(grid.shape, grid.spacing, counts, strict=True))
        self.knots = tuple(_knots(h * (n - 1), count) for n, h, count in lines)
        basis = [_basis(h * np.arange(n), knots, 0) for (n, h, _), knots in zip(lines, self.knots, strict=True)]
        self.weight, self.factors = weight, [np.linalg.qr(each) for each in basis]
        self.orthonormal = [factor.Q for factor in self.factors]
        self.adjoint = [each.T for each in self.orthonormal]
        seen, all_of = (
            _apply_along_axes([each.T for each in basis], w) for w in (weight.astype(float), np.ones(weight.shape))
        )
        self.size = int((seen > _TOUCHED * all_of).sum())

    def solve(self, values: np.ndarray, tolerance: float) -> tuple[np.ndarray, float]:
        """Coefficients of the B-splines, and Σ|u - û|² over the points that count."""
        right = _apply_along_axes(self.adjoint, values)
        x = np.zeros_like(right)
        r = p = right
        rr = first = np.vdot(r, r).real
        for _ in range(200):
            if rr <= tolerance**2 * first:
                break
            Ap = _apply_along_axes(self.adjoint, self.weight * _apply_along_axes(self.orthonormal, p))
            step = rr / np.vdot(p, Ap).real
            x = x + step * p
            r = r - step * Ap
            rr, old = np.vdot(r, r).real, rr
            p = r + rr / old * p
        misfit = np.sum(np.abs(self.weight * (values - _apply_along_axes(self.orthonormal, x))) ** 2)
        return _apply_along_axes([np.linalg.inv(factor.R) for factor in self.factors], x), float(misfit)


def _knots(length: float, count: int) -> np.ndarray:
    return np.r_[[0.0] * _DEGREE, np.linspace(0, length, count + 1), [length] * _DEGREE]


def _basis(x: np.ndarray, knots: np.ndarray, order: int) -> np.ndarray:
    """Derivatives of the B-splines at x, (n, m)."""
    spline = scipy.interpolate.BSpline(knots, np.eye(len(knots) - _DEGREE - 1), _DEGREE)
    return spline(np.clip(x, knots[0], knots[-1]), nu=order)


def _apply_along_axes(matrices: list[np.ndarray], box: np.ndarray) -> np.ndarray:
    """Apply one real matrix along each axis: always the first axis, and the new axis goes to the end."""
    whole = np.iscomplexobj(box)
    if whole:  # half the work of a product of complex numbers; the pairs end up in front
        box = np.ascontiguousarray(box).view(float).reshape(*box.shape, 2)
    for matrix in matrices:
        n, rest = box.shape[0], box.shape[1:]
        box = (box.reshape(n, -1).T @ matrix.T).reshape(*rest, len(matrix))
    return box[0] + 1j * box[1] if whole else box


def _evaluate(one: _Component, orders: tuple[int, ...], where: np.ndarray) -> np.ndarray:
    parts = np.stack([one.coefficients.real, one.coefficients.imag], axis=-1)
    found = scipy.interpolate.NdBSpline(one.knots, parts, _DEGREE)(where, nu=orders)
    return found[:, 0] + 1j * found[:, 1]
