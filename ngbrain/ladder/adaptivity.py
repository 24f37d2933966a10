"""Goal-oriented refinement: elements with the largest contribution to the error of the requested quantities.

With the error e of a solution u and the adjoint solution z of a quantity Q, in the space of the next order on the same elements,

    Q(u + e) - Q(u)  =  a(e, z - z_h)  ≤  Σ_K η_K ,      η_K = 2 μ_K ‖dev ε(e)‖_K ‖dev ε(z - z_h)‖_K

for any z_h of the cheaper space: the estimate of `estimates.estimate_by_adjoint`, element by element.
"""

from __future__ import annotations

from collections.abc import Sequence

import ngsolve as ngs
import numpy as np

from ngbrain.forward.common.material import stiffness
from ngbrain.forward.solid.problem import Problem
from ngbrain.ladder.quantities import Asked, BodyState, evaluate, gradient, interpolate_state

Array = np.ndarray
SHARE = {2: 0.8, 3: 0.5}
"""Fraction of the total error contribution that refined elements cover, by dimension: in 3-D more neighbours are refined."""
TINY = 1e-300


def element_contributions(cheap: BodyState, rich: Problem, asks: Sequence[Asked]) -> Array:
    """Contribution of each element to the error, relative to the answers; the largest over the questions.

    Parameters
    ----------
    cheap : BodyState
        A linear body at rest.
    rich : Problem
        The same body with elements one order higher.
    asks : sequence of Quantity or Question

    Returns
    -------
    (ne,) array
    """
    x = interpolate_state(cheap, rich, cheap.factor)
    r = rich.residual(x)[0]
    inverse = rich.factorise(x, r)
    error = _strain(rich, inverse(r))
    found = np.zeros(rich.mesh.ne)
    for quantity in asks:
        size = max(abs(evaluate(quantity, cheap)), TINY)
        rich.x = inverse(gradient(quantity, BodyState(rich, x, cheap.factor, cheap.linear, cheap.thickness)))
        cheap.body.u.Set(rich.u)
        missing = ngs.Sym(ngs.Grad(rich.u)) - ngs.Sym(ngs.Grad(cheap.body.u))
        found = np.maximum(found, error * _norm(rich, missing) / size)
    cheap.apply()
    return 2 * found * _moduli(rich)


def mark_elements(left_out: Array, share: float) -> Array:
    """Mark the smallest set of elements that covers a fraction of the total error (Dörfler marking).

    Parameters
    ----------
    left_out : (ne,) array
        Contribution of each element.
    share : float
        The fraction.

    Returns
    -------
    (ne,) bool array

    Examples
    --------
    >>> mark_elements(np.array([1.0, 5.0, 2.0, 2.0]), 0.7).tolist()
    [False, True, True, False]
    """
    order = np.argsort(-left_out, kind="stable")
    before = np.concatenate([[0.0], np.cumsum(left_out[order])[:-1]])
    marked = np.zeros(len(left_out), bool)
    marked[order[before < share * left_out.sum()]] = True
    return marked


def _strain(body: Problem, x: Array) -> Array:
    body.x = x
    return _norm(body, ngs.Sym(ngs.Grad(body.u)))


def _norm(body: Problem, strain: ngs.CoefficientFunction) -> Array:
    """Norm of the deviator over each element."""
    mesh = body.mesh
    square = ngs.InnerProduct(strain, strain) - ngs.Trace(strain) ** 2 / 3
    return np.sqrt(
        np.maximum(ngs.Integrate(square, mesh, order=2 * body.element.order - 2, element_wise=True).NumPy(), 0)
    )


def _moduli(body: Problem) -> Array:
    """Mean initial shear modulus (Pa) of each element."""
    modulus = stiffness(body.mesh, body.materials)[0]
    sums, sizes = (ngs.Integrate(f, body.mesh, element_wise=True).NumPy() for f in (modulus, ngs.CF(1)))
    return np.asarray(sums / sizes)
