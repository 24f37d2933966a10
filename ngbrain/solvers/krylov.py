"""Krylov methods on NumPy arrays, which raise `Breakdown` without convergence or definiteness, unlike NGSolve's and SciPy's."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ngbrain.errors import Breakdown

Array = np.ndarray
Apply = Callable[[Array], Array]


def cg(apply: Apply, precondition: Apply, b: Array, rtol: float, max_iter: int) -> tuple[Array, int]:
    """Preconditioned conjugate gradients for Ax = b, with positive definite A and preconditioner P.

    Parameters
    ----------
    apply : callable
        v → Av.
    precondition : callable
        r → Pr.
    b : array (n,)
        Right-hand side.
    rtol : float
        Stops at √(r·Pr) ≤ rtol √(b·Pb).
    max_iter : int
        Largest number of iterations.

    Returns
    -------
    x : array (n,)
        Solution.
    iterations : int

    Raises
    ------
    Breakdown
        Without convergence, or where A or P is not positive definite.
    """
    x, k, residual = truncated_cg(apply, precondition, b, rtol, max_iter)
    if residual > rtol:
        raise Breakdown(f"no convergence in {max_iter} iterations (residual {residual:.1e} of its start)")
    return x, k


def truncated_cg(
    apply: Apply,
    precondition: Apply,
    b: Array,
    rtol: float,
    max_iter: int,
    callback: Callable[[Array, Array], None] = lambda p, image: None,
) -> tuple[Array, int, float]:
    """Conjugate gradients that may stop before convergence.

    Every iterate lowers ½ x·Ax - b·x, so it can be used as a minimisation step.

    Parameters
    ----------
    apply, precondition, b, rtol, max_iter
        As in `cg`.
    callback : callable, optional
        Called with each search direction p and Ap.

    Returns
    -------
    x : array (n,)
        Last iterate.
    iterations : int
    residual : float
        √(r·Pr) relative to its initial value.

    Raises
    ------
    Breakdown
        Where A or P is not positive definite.
    """
    x, r = np.zeros_like(b), b.copy()
    z = precondition(r)
    p, start = z, _definite(r, z, "preconditioner")
    now = start
    for k in range(max_iter + 1):
        if now <= rtol * rtol * start or k == max_iter:
            break
        q = apply(p)
        alpha = now / _definite(p, q, "matrix")
        callback(p, q)
        x += alpha * p
        r -= alpha * q
        z = precondition(r)
        before, now = now, _definite(r, z, "preconditioner")
        p = z + now / before * p
    return x, k, float(np.sqrt(now / start)) if start else 0.0


def minres(apply: Apply, precondition: Apply, b: Array, rtol: float, max_iter: int) -> tuple[Array, int]:
    """Preconditioned MINRES for Ax = b, with symmetric A and positive definite preconditioner P.

    Parameters
    ----------
    apply, precondition, b, rtol, max_iter
        As in `cg`, with the same stopping test.

    Returns
    -------
    x : array (n,)
        Solution.
    iterations : int

    Raises
    ------
    Breakdown
        Without convergence, for a singular A, or where P is not positive definite.

    References
    ----------
    Elman, Silvester, Wathen, Finite Elements and Fast Iterative Solvers (2014), algorithm 4.1.
    """
    x, v_old, w_old, w = (np.zeros_like(b) for _ in range(4))
    v = b.copy()
    z = precondition(v)
    gamma = np.sqrt(_definite(v, z, "preconditioner"))
    start = eta = gamma
    gamma_old, s_old, s, c_old, c = 1.0, 0.0, 0.0, 1.0, 1.0
    for k in range(max_iter + 1):
        if abs(eta) <= rtol * start:
            return x, k
        z = z / gamma
        q = apply(z)
        delta = q @ z
        v, v_old = q - delta / gamma * v - gamma / gamma_old * v_old, v
        z_new = precondition(v)
        gamma_old, gamma = gamma, np.sqrt(_definite(v, z_new, "preconditioner"))
        a0 = c * delta - c_old * s * gamma_old
        a1 = np.hypot(a0, gamma)
        a2 = s * delta + c_old * c * gamma_old
        a3 = s_old * gamma_old
        if a1 == 0:
            raise Breakdown("the matrix is singular")
        c_old, c, s_old, s = c, a0 / a1, s, gamma / a1
        w, w_old = (z - a3 * w_old - a2 * w) / a1, w
        x += c * eta * w
        eta, z = -s * eta, z_new
    raise Breakdown(f"no convergence in {max_iter} iterations (residual {abs(eta) / start:.1e} of its start)")


def gmres(
    apply: Apply, precondition: Apply, first: Array, scale: Array, rtol: float, max_iter: int
) -> tuple[Array, int, float]:
    """Left-preconditioned GMRES for PAx = Pb, which minimises ‖scale · P(b - Ax)‖.

    Parameters
    ----------
    apply : callable
        v → Av.
    precondition : callable
        r → Pr.
    first : array (n,)
        Pb.
    scale : array (n,)
        Positive weights of the norm.
    rtol : float
        Stops at this residual relative to ‖scale · Pb‖.
    max_iter : int
        Largest number of iterations.

    Returns
    -------
    x : array (n,)
        Solution.
    iterations : int
    residual : float
        Final residual norm relative to its initial value.
    """
    first = scale * first
    beta = float(np.linalg.norm(first))
    if beta == 0:
        return np.zeros_like(first), 0, 0.0
    basis, h = [first / beta], np.zeros((max_iter + 1, max_iter))
    for k in range(max_iter):
        v = scale * precondition(apply(basis[k] / scale))
        for i, other in enumerate(basis):
            h[i, k] = v @ other
            v = v - h[i, k] * other
        h[k + 1, k] = np.linalg.norm(v)
        target = np.zeros(k + 2)
        target[0] = beta
        y, *_ = np.linalg.lstsq(h[: k + 2, : k + 1], target)
        residual = float(np.linalg.norm(h[: k + 2, : k + 1] @ y - target)) / beta
        if residual <= rtol or not h[k + 1, k] > 0 or k + 1 == max_iter:
            break
        basis.append(v / h[k + 1, k])
    return sum(a * v for a, v in zip(y, basis, strict=True)) / scale, k + 1, residual


def _definite(a: Array, b: Array, what: str) -> float:
    product = float(a @ b)
    if not np.isfinite(product):
        raise Breakdown("the iteration is not finite")
    if product < 0:
        raise Breakdown(f"the {what} is not positive definite")
    return product
