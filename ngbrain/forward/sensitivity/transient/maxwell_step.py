"""One time step of a nonlinear Maxwell branch (`materials.flow.MaxwellVariables`) as an expression to differentiate.

The step is a minimisation; it is differentiated through its equation ∂W(e) = 2κ (x - e). From the converged e₀, one Newton step
leads to the minimum of any neighbouring equation,

    r = ∂W(e₀) - 2κ (x - e₀) ,   M = ∂²W(e₀) + 2κ ,   e = e₀ - M⁻¹ r ,   energy = W(e₀) + κ |x - e₀|² - ½ r · M⁻¹ r .

As r = 0 at e₀, these have the exact e with its first derivatives, and the exact energy with its first and second ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import reduce
from operator import add
from typing import TypeAlias

import ngsolve as ngs
from ngsolve import CoefficientFunction

from ngbrain.materials import Maxwell
from ngbrain.materials.base import Value
from ngbrain.materials.maxwell import PLANE, SMALL
from ngbrain.materials.points import initial_modulus
from ngbrain.tensors import principal_values

SERIES = 0.1
"""Δt/τ below which the factors are series: above it differences are accurate, in derivatives too."""


def step_factors(dt: Value, tau: Value) -> tuple[CoefficientFunction, CoefficientFunction]:
    """Factors e = exp(-Δt/τ) and β = (1 - e)/(Δt/τ) of `materials.viscous.step_factors`, as expressions to differentiate.

    Parameters
    ----------
    dt : CoefficientFunction or float
        Time step Δt (s).
    tau : CoefficientFunction or float
        Relaxation time τ (s).

    Returns
    -------
    e, beta : CoefficientFunction

    Examples
    --------
    >>> e, beta = step_factors(ngs.Parameter(1e-9), ngs.Parameter(2.0))
    >>> beta.dim
    1
    """
    x = dt / tau * ngs.CF(1.0)
    e = ngs.exp(-x)
    return e, ngs.IfPos(x - SERIES, (1 - e) / x, _series(x, 2))


def half_step_factors(y: CoefficientFunction) -> tuple[CoefficientFunction, CoefficientFunction]:
    """Factors θ and κ Δt/η of `materials.maxwell.half_step_factors`, as expressions to differentiate."""
    e, beta = step_factors(y, 1.0)
    theta = ngs.IfPos(y - SERIES, 2 * (beta - e) / (y * beta), e * _series(-y, 3) / beta)
    return theta, 2 * beta / ngs.IfPos(y - SERIES, 2 * (1 - beta) / y, _series(y, 3))


def _series(x: CoefficientFunction, n: int) -> CoefficientFunction:
    """1 - x/n + x²/n(n+1) - …"""
    found: CoefficientFunction = ngs.CF(1.0)
    for k in range(n + 9, n - 1, -1):
        found = 1 - x / k * found
    return found


class SpectralDecomposition:
    """Logarithmic principal strains of a symmetric tensor A, as coordinates x in `PLANE`, and functions of A with its axes."""

    def __init__(self, A: CoefficientFunction) -> None:
        A = A.MakeVariable()
        values = principal_values(A)
        logs = [ngs.log(value) / 2 for value in values]
        self.x = [_sum(float(c) * log for c, log in zip(row, logs, strict=True)) for row in PLANE]
        self._axes = [value.Diff(A) for value in values]

    def exponential(self, strain: Sequence[CoefficientFunction]) -> CoefficientFunction:
        """Σ exp(strain_i) n_i ⊗ n_i, for coordinates of deviatoric strains."""
        logs = (_sum(float(c) * s for c, s in zip(column, strain, strict=True)) for column in PLANE.T)
        return _sum(ngs.exp(log) * axis for log, axis in zip(logs, self._axes, strict=True))


ParameterPerturbation: TypeAlias = Callable[[CoefficientFunction, CoefficientFunction], CoefficientFunction]
"""From `coefficients` and `law` to `coefficients` with perturbed parameters; the perturbation is zero but has a derivative."""


def _unperturbed(coefficients: CoefficientFunction, law: CoefficientFunction) -> CoefficientFunction:
    return coefficients


class MaxwellStart:
    """A Maxwell branch at the start of a step: G after half of the flow with the initial stress, and κ.

    Parameters enter only through the variable `coefficients`, whose value is `law`.

    Parameters
    ----------
    branch : Maxwell
        The branch.
    dt : CoefficientFunction or float
        Time step (s).
    shape, G : CoefficientFunction
        C̄ and G at the start.
    converged : CoefficientFunction
        `MaxwellVariables.step_solution`: the strains at which parameters are differentiated, and a fraction.
    perturb : callable
        From `coefficients` and `law` to `coefficients` with perturbed parameters.

    Attributes
    ----------
    value : CoefficientFunction
        G (nine entries) and κ.
    strain : list of CoefficientFunction
        Strain at the start.
    """

    def __init__(
        self,
        branch: Maxwell,
        dt: Value,
        shape: CoefficientFunction,
        G: CoefficientFunction,
        converged: CoefficientFunction,
        perturb: ParameterPerturbation = _unperturbed,
    ) -> None:
        start = SpectralDecomposition(G.trans * shape * G)
        law = _start(branch, ngs.CF((converged[2], converged[3])))
        coefficients = perturb(_start(branch, ngs.CF(tuple(start.x))), law).MakeVariable()
        slope, rest, eta = [coefficients[0], coefficients[1]], coefficients[2], coefficients[3]
        found = converged[2], converged[3]
        pairs = (slope, slope), (start.x, slope), (found, found)
        squared, along, size = (_sum(a * b for a, b in zip(*pair, strict=True)) for pair in pairs)
        theta, factor = half_step_factors(dt / eta * ngs.IfPos(size - SMALL**2, squared / (2 * along), rest))
        viscous_strain = [-converged[4] * theta * dt / (4 * eta) * s for s in slope]
        self.value = ngs.CF((G * start.exponential(viscous_strain), eta / dt * factor))
        self.strain, self.coefficients, self.law = start.x, coefficients, law


def _start(branch: Maxwell, strain: CoefficientFunction) -> CoefficientFunction:
    law = branch.slopes(strain)
    return ngs.CF((law[1], law[2], initial_modulus(branch.law), branch.eta))


class MaxwellEnd:
    """A Maxwell branch at the end of a step, where the isochoric deformation is C̄.

    Parameters
    ----------
    branch : Maxwell
        The branch.
    shape : CoefficientFunction
        C̄ at the end.
    half : CoefficientFunction
        `MaxwellStart.value`.
    converged : CoefficientFunction
        As in `MaxwellStart`.
    perturb : callable
        As in `MaxwellStart`.

    Attributes
    ----------
    energy : CoefficientFunction
        Energy density (Pa).
    G : CoefficientFunction
        Nine entries.
    coefficients, law : CoefficientFunction
        As in `MaxwellStart`.
    """

    def __init__(
        self,
        branch: Maxwell,
        shape: CoefficientFunction,
        half: CoefficientFunction,
        converged: CoefficientFunction,
        perturb: ParameterPerturbation = _unperturbed,
    ) -> None:
        G = ngs.CF(tuple(half[i] for i in range(9)), dims=(3, 3))
        kappa, end = half[9], SpectralDecomposition(G.trans * shape * G)
        law = branch.slopes(ngs.CF((converged[0], converged[1])))
        coefficients = perturb(law, law).MakeVariable()
        W, first, second, a, b, c = (coefficients[i] for i in range(6))
        off = [end.x[i] - converged[i] for i in range(2)]
        r, k = (first - 2 * kappa * off[0], second - 2 * kappa * off[1]), 2 * kappa
        det = (a + k) * (c + k) - b * b
        back = ((c + k) * r[0] - b * r[1]) / det, ((a + k) * r[1] - b * r[0]) / det
        self.energy = W + kappa * (off[0] ** 2 + off[1] ** 2) - (r[0] * back[0] + r[1] * back[1]) / 2
        self.G = (G * end.exponential([-off[i] - back[i] for i in range(2)])).Reshape((9,))
        self.coefficients, self.law, self.branch = coefficients, law, branch


def _sum(parts: Iterable[CoefficientFunction]) -> CoefficientFunction:
    return reduce(add, parts)
