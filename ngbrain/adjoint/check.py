"""Verification of derivatives: Taylor remainder test and dot-product (adjoint) test."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Array = np.ndarray


def taylor(
    f: Callable[[Array], float | Array],
    grad: Array | Callable[[Array], float | Array],
    x: Array,
    dx: Array,
    steps: int = 4,
    first: float = 1e-2,
) -> Array:
    """Taylor remainder test: observed convergence rates of ‖f(x + h dx) - f(x) - h f'(x) dx‖ as h is halved.

    A correct derivative gives 2, a wrong one 1. A remainder at round-off (1e-14 of ‖f'‖ h) counts as 2, as it measures nothing:
    choose `first` so that the last remainder is above it.

    Parameters
    ----------
    f : callable
        Function of an array, to a number or an array.
    grad : array or callable
        Gradient of f at x (the remainder uses grad · dx), or the Jacobian-vector product dx ↦ f'(x) dx.
    x, dx : array
        Point and direction, of one shape.
    steps : int
        Number of rates; h = first · 2⁻ᵏ.
    first : float
        First step length.

    Returns
    -------
    array (steps,)
        Observed rates.

    Examples
    --------
    >>> x = np.array([1.0, 2.0]); dx = np.array([0.3, -0.2])
    >>> rates = taylor(lambda x: float(np.sum(x**3)), 3 * x**2, x, dx)
    >>> bool(np.all(np.abs(rates - 2) < 0.05))
    True
    """
    slope = grad(dx) if callable(grad) else np.sum(np.asarray(grad) * dx)
    at_x = np.asarray(f(x))
    sizes = [first * 0.5**k for k in range(steps + 1)]
    remainders = np.array([np.linalg.norm(np.asarray(f(x + h * dx)) - at_x - h * np.asarray(slope)) for h in sizes])
    floor = 1e-14 * np.linalg.norm(slope) * np.array(sizes)
    settled = remainders <= floor
    with np.errstate(divide="ignore", invalid="ignore"):
        rates = np.log2(remainders[:-1] / remainders[1:])
    return np.where(settled[:-1] | settled[1:], 2.0, rates)


def dot(push: Array | Callable[[Array], Array], pull: Array | Callable[[Array], Array], dx: Array, w: Array) -> float:
    """Dot-product test of an adjoint: relative defect of ⟨J dx, w⟩ = ⟨dx, Jᵀw⟩.

    It is round-off (1e-10 after a solve) if the two products are transposes of each other. The defect is relative to Σ |w̄ · J
    dx| or Σ |dx · Jᵀw|, whichever is larger, so that units of data and parameters do not matter; of complex numbers the real
    part is compared. With push = pull it tests the symmetry of a Hessian. Two products that are transposes of each other and
    both wrong pass: `taylor` tests whether J is the derivative.

    Parameters
    ----------
    push : array or callable
        J dx, or the function dx ↦ J dx.
    pull : array or callable
        Jᵀw, or the function w ↦ Jᵀw; of complex data Re(Jᵀ w̄), the gradient of Re Σ w̄ · data, as models give it.
    dx, w : array
        Direction and weights; random, so that all entries count.

    Returns
    -------
    float
        The relative defect.

    Examples
    --------
    >>> J = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    >>> dx, w = np.array([0.3, -0.2]), np.array([1.0, -1.0, 0.5])
    >>> dot(lambda dx: J @ dx, lambda w: J.T @ w, dx, w) < 1e-14
    True
    >>> dot(lambda dx: J @ dx, lambda w: 1.01 * J.T @ w, dx, w) > 1e-3
    True
    """
    forth = np.conj(w) * (push(dx) if callable(push) else push)
    back = np.conj(dx) * (pull(w) if callable(pull) else pull)
    size = max(np.abs(forth).sum(), np.abs(back).sum())
    return float(abs(forth.sum().real - back.sum().real) / size) if size else 0.0
