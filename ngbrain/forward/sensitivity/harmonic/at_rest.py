"""Derivatives of the system matrix of a body at rest with respect to fields of its materials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import InputError
from ngbrain.forward.common.solve_counts import Solves
from ngbrain.forward.harmonic.integrands import complex_space
from ngbrain.forward.harmonic.problem import HarmonicProblem
from ngbrain.forward.sensitivity.harmonic.field_gradients import (
    FieldGradient,
    Pair,
    derivative_operator,
    proportional_fields,
)
from ngbrain.forward.sensitivity.harmonic.matrix_derivative import MatrixDerivative
from ngbrain.solvers.matrices import to_scipy

Array = np.ndarray


class AtRest:
    """A body at rest, with fields as parameters, one after the other.

    Parameters
    ----------
    body : HarmonicProblem
        The body.
    fields : dict of str to GridFunction
        Real fields of its materials.

    Raises
    ------
    InputError
        For parameters that are no real GridFunctions.
    """

    def __init__(self, body: HarmonicProblem, fields: Mapping[str, Any]) -> None:
        for name, field in fields.items():
            if not isinstance(field, ngs.GridFunction):
                raise InputError(f"parameters.{name}", type(field).__name__, "a GridFunction, as the body is at rest")
            if field.space.is_complex:
                raise InputError(
                    f"parameters.{name}", "complex", "a real field; storage and loss modulus are separate fields"
                )
        self.body, self.solves = body, Solves()
        self.fields: dict[str, ngs.GridFunction] = dict(fields)
        self.sizes: dict[str, int] = {name: field.space.ndof for name, field in fields.items()}
        self._slopes = dict[tuple[float, str], FieldGradient]()

    @property
    def value(self) -> Array:
        """Degrees of freedom of the fields."""
        return np.concatenate([np.zeros(0), *(field.vec.FV().NumPy() for field in self.fields.values())])

    def set_value(self, values: Array) -> None:
        """Set the degrees of freedom."""
        for field, part in zip(self.fields.values(), self.split(values), strict=True):
            field.vec.FV().NumPy()[:] = part

    def sensitivity(self, waves: Array) -> FieldSensitivity:
        """Derivatives of the system matrix, at the values that the fields have when it is used."""
        return FieldSensitivity(self, waves)

    def split(self, values: Array) -> list[Array]:
        """Values by field."""
        return np.split(values, np.cumsum(list(self.sizes.values()))[:-1]) if self.sizes else []

    @cached_property
    def proportional(self) -> dict[float, dict[str, tuple[str, complex]]]:
        """Fields with proportional derivatives at each angular frequency (rad/s), see `proportional_fields`."""
        return {
            omega: proportional_fields(self.body, self.fields, omega)
            for omega in {wave.omega for wave in self.body.waves}
        }

    def independent_fields(self, omega: float) -> list[str]:
        """Fields that need integrals of their own."""
        return [name for name, (first, _) in self.proportional[omega].items() if name == first]

    def gradient(self, omega: float, name: str) -> FieldGradient:
        """Derivative of the matrices with respect to a field, contracted with pairs of waves; made once.

        Parameters
        ----------
        omega : float
            Angular frequency (rad/s).
        name : str
            The field.

        Returns
        -------
        FieldGradient
            For as many pairs as there are waves of this frequency.
        """
        if (omega, name) not in self._slopes:
            number = sum(wave.omega == omega for wave in self.body.waves)
            self._slopes[omega, name] = FieldGradient(self.body, omega, self.fields[name], number)
        return self._slopes[omega, name]

    @cached_property
    def derivative(self) -> MatrixDerivative:
        """Derivative of the matrices along a direction of the fields, for second derivatives."""
        return MatrixDerivative(self.body, self.fields)


class FieldSensitivity:
    """Implements `Sensitivity` for a body at rest.

    Parameters
    ----------
    medium : AtRest
        The body.
    waves : array (waves, ndof)
        Waves u.
    """

    def __init__(self, medium: AtRest, waves: Array) -> None:
        self._medium, self._waves = medium, waves
        self._omegas = [wave.omega for wave in medium.body.waves]

    def jvp(self, direction: Array) -> Sequence[Array]:
        """(∂A/∂θ δθ) u of each wave."""
        return [matrix @ direction for matrix in self.matrices]

    def vjp(self, adjoints: Sequence[Array]) -> Array:
        """Σ Re λᵀ (∂A/∂θ) u."""
        parts = [matrix.T @ adjoint for matrix, adjoint in zip(self.matrices, adjoints, strict=True)]
        return np.asarray(np.sum(parts, axis=0).real)

    def gradient(self, adjoints: Sequence[Array]) -> Array:
        """As `vjp`, by one linear form for each frequency and field."""
        medium, pairs = self._medium, dict[float, list[Pair]]()
        for omega, wave, adjoint in zip(self._omegas, self._waves, adjoints, strict=True):
            pairs.setdefault(omega, []).append((wave, adjoint))
        return self._summed(
            {
                omega: {name: medium.gradient(omega, name)(both) for name in medium.independent_fields(omega)}
                for omega, both in pairs.items()
            }
        )

    def set_direction(self, direction: Array) -> None:
        """Set a direction of all fields."""
        self._medium.derivative.set_direction(self._medium.split(direction))

    def apply_derivative(self, number: int) -> Array:
        """A' u."""
        return self._medium.derivative.apply(self._omegas[number], self._waves[number])

    def apply_derivative_transpose(self, number: int, adjoint: Array) -> Array:
        """A' λ; A' is symmetric.

        Parameters
        ----------
        number : int
            Index of the wave.
        adjoint : array (ndof,)
            λ.

        Returns
        -------
        array (ndof,)
        """
        return self._medium.derivative.apply(self._omegas[number], adjoint)

    def gradient_derivative(
        self, adjoints: Sequence[Array], changes: Sequence[Array], others: Sequence[Array]
    ) -> Array:
        """λ'ᵀ (∂A/∂θ) u + λᵀ (∂A/∂θ) u' + λᵀ (∂A/∂θ)' u.

        Parameters
        ----------
        adjoints, changes, others : sequence of array (ndof,)
            λ, u' and λ' of each wave.

        Returns
        -------
        array (size,)
        """
        medium = self._medium
        pairs: dict[float, tuple[list[Pair], list[Pair], list[Pair]]] = {}
        parts = zip(self._omegas, self._waves, adjoints, changes, others, strict=True)
        for omega, wave, adjoint, change, other in parts:
            for into, pair in zip(
                pairs.setdefault(omega, ([], [], [])), ((wave, other), (change, adjoint), (wave, adjoint)), strict=True
            ):
                into.append(pair)
        return self._summed(
            {
                omega: {
                    name: medium.gradient(omega, name)(moved)
                    + medium.gradient(omega, name)(back)
                    + medium.derivative.gradient(omega, name, same)
                    for name in medium.independent_fields(omega)
                }
                for omega, (moved, back, same) in pairs.items()
            }
        )

    def _summed(self, slopes: Mapping[float, Mapping[str, Array]]) -> Array:
        """Sum over frequencies, of all fields, from the independent ones."""
        total = {name: np.zeros(size) for name, size in self._medium.sizes.items()}
        for omega, found in slopes.items():
            for name, (first, r) in self._medium.proportional[omega].items():
                total[name] += (r * found[first]).real
        return np.concatenate([np.zeros(0), *total.values()])

    @cached_property
    def matrices(self) -> Sequence[sp.csr_array]:
        """(∂A/∂θ) u of each wave (ndof, size), assembled at first use."""
        return [self._matrix(omega, wave) for omega, wave in zip(self._omegas, self._waves, strict=True)]

    def _matrix(self, omega: float, wave: Array) -> sp.csr_array:
        medium, body = self._medium, self._medium.body
        u, test = ngs.GridFunction(body.fes), body.fes.TestFunction()
        u.vec.FV().NumPy()[:] = wave
        columns = {}
        for name in medium.independent_fields(omega):
            field = medium.fields[name]
            space = complex_space(field.space)
            form = ngs.BilinearForm(trialspace=space, testspace=body.fes)
            work = body.terms(omega, u, test, derivative_operator(field, space.TrialFunction()))
            if work is not None:
                form += work
            form.Assemble()
            columns[name] = to_scipy(form.mat)
        return sp.csr_array(sp.hstack([r * columns[first] for first, r in medium.proportional[omega].values()]))
