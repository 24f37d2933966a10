"""Derivative of the system matrix along a direction of its fields, and the gradient of that: for second derivatives.

With A' = Σ_j δθ_j ∂A/∂θ_j, the Hessian of Re Σ w̄ · d times δθ is, for waves u and adjoints λ with A λ = Bᵀ w̄,

    -Re[ λ'ᵀ (∂A/∂θ_i) u + λᵀ (∂A/∂θ_i) u' + λᵀ (∂A/∂θ_i)' u ] ,    A u' = -A' u ,    A λ' = -A' λ .
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.forward.harmonic.integrands import Change, vanishes
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.sensitivity.harmonic.field_gradients import FieldGradient, Pair, derivative_operator

Array = np.ndarray


class MatrixDerivative:
    """A' of a body along the direction last set, and the gradient of A'. Forms are made once.

    Parameters
    ----------
    body : HarmonicProblem
        The body, at rest.
    fields : dict of str to GridFunction
        Its parameters.
    """

    def __init__(self, body: HarmonicProblem, fields: Mapping[str, ngs.GridFunction]) -> None:
        self._body, self._fields = body, fields
        self._directions = {name: ngs.GridFunction(field.space) for name, field in fields.items()}
        self._turn = _directional(fields, self._directions)
        self._wave, test = ngs.GridFunction(body.fes), body.fes.TestFunction()
        self._products: dict[float, ngs.LinearForm | None] = {}
        for omega in {wave.omega for wave in body.waves}:
            work = body.terms(omega, self._wave, test, self._turn)
            self._products[omega] = None if work is None else ngs.LinearForm(work)
        self._slopes: dict[tuple[float, str], FieldGradient] = {}

    def set_direction(self, direction: Sequence[Array]) -> None:
        """Set a change of each field."""
        for towards, part in zip(self._directions.values(), direction, strict=True):
            towards.vec.FV().NumPy()[:] = part

    def apply(self, omega: float, u: Array) -> Array:
        """A' u.

        Parameters
        ----------
        omega : float
            Angular frequency (rad/s).
        u : array (ndof,)
            A wave.

        Returns
        -------
        array (ndof,)
        """
        form = self._products[omega]
        if form is None:
            return np.zeros(len(u), complex)
        self._wave.vec.FV().NumPy()[:] = u
        form.Assemble()
        return np.asarray(form.vec.FV().NumPy().copy())

    def gradient(self, omega: float, name: str, pairs: Sequence[Pair]) -> Array:
        """Σ vᵀ (∂A/∂θ_i)' u over pairs u, v.

        Parameters
        ----------
        omega : float
            Angular frequency (rad/s).
        name : str
            A field.
        pairs : sequence of (array, array)
            Waves u and v (ndof,).

        Returns
        -------
        array (size,)
            For each degree of freedom of the field.
        """
        if (omega, name) not in self._slopes:
            self._slopes[omega, name] = FieldGradient(self._body, omega, self._fields[name], len(pairs), self._turn)
        return self._slopes[omega, name](pairs)


def _directional(fields: Mapping[str, ngs.GridFunction], directions: Mapping[str, ngs.GridFunction]) -> Change:
    """Operator from an integrand to its derivative along a change of all fields."""

    def turned(work: CoefficientFunction) -> CoefficientFunction:
        parts = (derivative_operator(field, directions[name])(work) for name, field in fields.items())
        left = [part for part in parts if not vanishes(part)]
        return sum(left[1:], left[0]) if left else ngs.CF(0.0)

    return turned
