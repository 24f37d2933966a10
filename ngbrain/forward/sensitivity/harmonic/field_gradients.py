"""Derivatives of a body's system matrix with respect to fields, contracted with waves; fields with proportional derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.forward.harmonic.integrands import Change, complex_space, derivative, vanishes
from ngbrain.forward.harmonic.problem import HarmonicProblem

Array = np.ndarray
Pair = tuple[Array, Array]
SAME = 1e-10
"""Relative tolerance for proportional derivatives."""
APART = 0.1
"""Relative size of the random changes of fields."""


def derivative_operator(field: ngs.GridFunction, direction: CoefficientFunction) -> Change:
    """Operator from an integrand to its derivative along a change of a field.

    Parameters
    ----------
    field : GridFunction
        The field.
    direction : CoefficientFunction
        Its change.

    Returns
    -------
    callable
    """
    return lambda work: derivative(work, field, direction, "density or absorbing")


class FieldGradient:
    """Σ vᵀ (∂A/∂θ_i) u over pairs of waves u, v, for each degree of freedom θ_i of a field: complex, by one linear form.

    The form is compiled once and evaluated with the field values at the time of the call.

    Parameters
    ----------
    body : HarmonicProblem
        The body.
    omega : float
        Angular frequency (rad/s).
    field : GridFunction
        The field θ.
    pairs : int
        Number of pairs of waves.
    turn : callable, optional
        Operator on the integrand of ∂A/∂θ_i, such as a further derivative.
    """

    def __init__(
        self,
        body: HarmonicProblem,
        omega: float,
        field: ngs.GridFunction,
        pairs: int,
        turn: Change = lambda work: work,
    ) -> None:
        space = complex_space(field.space)
        self._form = ngs.LinearForm(space)
        self._pairs = [(ngs.GridFunction(body.fes), ngs.GridFunction(body.fes)) for _ in range(pairs)]
        change = derivative_operator(field, space.TestFunction())

        def compiled(work: CoefficientFunction) -> CoefficientFunction:
            changed = change(work)
            changed = changed if vanishes(changed) else turn(changed)
            return changed if vanishes(changed) else changed.Compile()

        for u, v in self._pairs:
            work = body.terms(omega, u, v, compiled)
            if work is not None:
                self._form += work

    def __call__(self, pairs: Sequence[Pair]) -> Array:
        """The gradient for pairs of waves, (ndof,) each."""
        for functions, waves in zip(self._pairs, pairs, strict=True):
            for function, wave in zip(functions, waves, strict=True):
                function.vec.FV().NumPy()[:] = wave
        self._form.Assemble()
        return np.asarray(self._form.vec.FV().NumPy().copy())


def proportional_fields(
    body: HarmonicProblem, fields: Mapping[str, ngs.GridFunction], omega: float
) -> dict[str, tuple[str, complex]]:
    """Fields with proportional derivatives of A, so that one integral serves several.

    The factor is i for the loss modulus in G' + iG'', and iω for a viscosity. It is found numerically: between random waves, at two
    sets of random values around the fields' own, which are restored.

    Parameters
    ----------
    body : HarmonicProblem
        The body.
    fields : dict of str to GridFunction
        Its parameters.
    omega : float
        Angular frequency (rad/s).

    Returns
    -------
    dict of str to (str, complex)
        Field → first field and r with ∂A/∂field = r ∂A/∂first for any values; the field itself and 1 if there is none.

    Examples
    --------
    >>> from ngbrain.forward.harmonic.wave import Wave
    >>> from ngbrain.materials import Shearing
    >>> from ngbrain.mesh.geometry.structured import rectangles
    >>> mesh = rectangles(np.linspace(0, 0.1, 4), np.linspace(0, 0.1, 4))
    >>> storage, loss = ngs.GridFunction(ngs.H1(mesh)), ngs.GridFunction(ngs.H1(mesh))
    >>> storage.Set(2000.0), loss.Set(800.0)
    (None, None)
    >>> body = HarmonicProblem(mesh, Shearing(storage + 1j * loss), [Wave(50.0)], bulk=1e5, form="P2")
    >>> found = proportional_fields(body, {"storage": storage, "loss": loss}, body.waves[0].omega)
    >>> [(first, complex(np.round(r, 6))) for first, r in found.values()]
    [('storage', (1+0j)), ('storage', 1j)]
    """
    if len(fields) < 2:
        return {name: (name, 1.0) for name in fields}
    slopes = _tried(body, fields, omega)
    firsts: list[str] = []
    found: dict[str, tuple[str, complex]] = {}
    for name, mine in slopes.items():
        for first in firsts:
            other = slopes[first]
            if len(other) == len(mine):
                r = complex(np.vdot(other, mine) / np.vdot(other, other))
                if np.linalg.norm(mine - r * other) <= SAME * np.linalg.norm(mine):
                    found[name] = (first, r)
                    break
        else:
            found[name] = (name, 1.0)
            if mine.any():
                firsts.append(name)
    return found


def _tried(body: HarmonicProblem, fields: Mapping[str, ngs.GridFunction], omega: float) -> dict[str, Array]:
    rng = np.random.default_rng(0)
    kept = {name: field.vec.FV().NumPy().copy() for name, field in fields.items()}
    parts: dict[str, list[Array]] = {name: [] for name in fields}
    try:
        for _ in range(2):
            for name, field in fields.items():
                field.vec.FV().NumPy()[:] = _changed(kept[name], rng)
            pair = _random(body, rng), _random(body, rng)
            for name, field in fields.items():
                parts[name].append(FieldGradient(body, omega, field, 1)([pair]))
    finally:
        for name, field in fields.items():
            field.vec.FV().NumPy()[:] = kept[name]
    return {name: np.concatenate(each) for name, each in parts.items()}


def _changed(values: Array, rng: np.random.Generator) -> Array:
    """Perturbed values of the same sign; zeros become small values of the same magnitude."""
    size = np.abs(values).mean() or 1.0
    return np.where(
        values, values * (1 + APART * rng.uniform(-1, 1, len(values))), APART * size * rng.random(len(values))
    )


def _random(body: HarmonicProblem, rng: np.random.Generator) -> Array:
    return np.asarray(rng.normal(size=body.fes.ndof) + 1j * rng.normal(size=body.fes.ndof))
