"""An objective for `scipy.optimize`: value, gradient and Gauss-Newton products, one solve for all three at one x."""

from __future__ import annotations

from collections import deque

import numpy as np

from ngbrain.adjoint.reduced import Reduced
from ngbrain.errors import SolverError
from ngbrain.interop import function as functions

Array = np.ndarray
BACK = 10.0
"""Slope of the penalty behind a failed step, relative to the descent before it: a line search backtracks to about 0.02 of the
step."""
RECENT = 10
"""Number of last values above which the penalty starts; the current iterate is among them."""


class Objective:
    """Objective J of a `Reduced` for `scipy.optimize.minimize`: `fun`, `jac`, `hessp`.

    After a failed solve (`SolverError`) the value is that of a penalty, from which a line search backtracks:

        J_max + 10 |g·(x - x̂)|      g the last gradient, computed at x̂, J_max the largest of the last J

    and the gradient is that of the penalty; searches without gradients get inf. The penalty must not be huge: after 1e30 L-BFGS-B
    takes the zero step of its cubic interpolation for convergence. At the first x the `SolverError` is raised.

    Examples
    --------
    >>> import scipy.optimize
    >>> from ngbrain.inverse.phantoms.benchmark import Phantom
    >>> inversion = Phantom.from_name("CV-G", 5).simulate_measurements(0.02).inversion()
    >>> J = Objective(inversion.reduced)
    >>> found = scipy.optimize.minimize(J.fun, inversion.start, method="trust-ncg", jac=J.jac, hessp=J.hessp)
    >>> bool(found.fun < 0.5 * J.fun(inversion.start))
    True
    """

    def __init__(self, reduced: Reduced) -> None:
        self._function = functions.ObjectiveFunction(reduced)
        self._recent: deque[float] = deque(maxlen=RECENT)
        self._slope: tuple[Array, Array] | None = None
        self._failed: Array | None = None
        self.failures = 0
        """Solves that failed, each a rejected step."""

    def fun(self, x: Array) -> float:
        """Objective J(x)."""
        value = self._solved(x)
        if value is not None:
            return value
        return np.inf if self._slope is None else max(self._recent) + BACK * abs(self._along(x))

    def jac(self, x: Array) -> Array:
        """Gradient ∇J: one adjoint solve for each load."""
        if self._solved(x) is not None:
            self._slope = np.array(x), self._function.vjp(x, 1.0)
            return self._slope[1].copy()
        return np.zeros_like(x) if self._slope is None else BACK * np.sign(self._along(x)) * self._slope[1]

    def hessp(self, x: Array, p: Array) -> Array:
        """Product of the Gauss-Newton matrix with p: two solves for each load.

        Parameters
        ----------
        x, p : array (n,)
            Point and direction.

        Returns
        -------
        array (n,)
        """
        return self._function.product(x, p)

    def _solved(self, x: Array) -> float | None:
        """J, or None where there is no solution."""
        if self._failed is not None and np.array_equal(x, self._failed):
            return None
        try:
            value = float(self._function.value(x))
        except SolverError:
            if not self._recent:
                raise
            self._failed, self.failures = np.array(x), self.failures + 1
            return None
        if not self._recent or value != self._recent[-1]:
            self._recent.append(value)
        return value

    def _along(self, x: Array) -> float:
        assert self._slope is not None
        there, slope = self._slope
        return float(slope @ (x - there))
