"""Relaxing materials by a hereditary law whose time step is again an energy.

Each branch k has its own isochoric energy W_k(C̄) and time τ_k; W_∞ stays. With S̄_k = DEV{2 ∂W_k/∂C̄},
x_k = Δt/τ_k, e_k = exp(-x_k) and β_k = (1 - e_k)/x_k, the state at the end of a step minimises

    W = W_∞(C̄) + Σ β_k W_k(C̄) + ½ Σ (e_k H_k - β_k S̄_k) : C̄          (H_k, S̄_k at the start of the step)

and the history moves on by H_k ← e_k H_k + β_k (S̄_k,new - S̄_k). Exact for S̄ linear in time within a step, second
order otherwise, stable for any Δt/τ; Δt → 0 gives W_∞ + Σ W_k, Δt → ∞ gives W_∞.

Source: Simo 1987, 10.1016/0045-7825(87)90107-1; Simo & Hughes 1998, section 10.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from ngsolve import CoefficientFunction, exp

from ngbrain.errors import InputError
from ngbrain.materials.base import Composite, Deformation, Law, Scaled, Value, density, positive
from ngbrain.materials.points import Points
from ngbrain.tensors import lagrangian_deviator


@dataclass(frozen=True)
class Branch:
    """One relaxing branch: its energy W_k (a law) and its time τ_k (s)."""

    law: Law
    tau: Value

    def __post_init__(self) -> None:
        positive(self.tau, "Branch.tau")

    def stress(self, C: CoefficientFunction) -> CoefficientFunction:
        """S̄ = DEV{2 ∂W/∂C̄} (Pa) at the isochoric C̄, a 3×3 CoefficientFunction; zero at rest."""
        C = C.MakeVariable()
        return lagrangian_deviator(2 * density(self.law, Deformation.of_stretch(C)).Diff(C), C)

    def overstress(self, points: Points, C: CoefficientFunction, times: np.ndarray) -> np.ndarray:
        """H (Pa), shape (histories, times, 3, 3), under given histories of C̄; at the first time H = S̄.

        C holds its values at `points`: one history after the other. A branch of another kind has its own `overstress`.
        """
        S = points(self.stress(C).Compile()).T.reshape(-1, len(times), 3, 3)
        H = S.copy()
        e, beta = step_factors(np.diff(times), np.array(number(self.tau)))
        for n in range(len(times) - 1):
            H[:, n + 1] = e[n] * H[:, n] + beta[n] * (S[:, n + 1] - S[:, n])
        return H


@dataclass(frozen=True)
class Viscous:
    """A law that stays, W_∞, and branches that relax."""

    equilibrium: Law
    branches: tuple[Branch, ...] = ()

    @property
    def instantaneous(self) -> Law:
        """W_∞ + Σ W_k, the elastic law of a fast deformation."""
        return _Fixed(self, (1.0,) * len(self.branches))

    def density(self, at: Deformation, shares: Sequence[Value]) -> CoefficientFunction:
        """W_∞ + Σ β_k W_k(C̄) (Pa); `shares` are the β_k (1 for the instantaneous law, 0 for W_∞)."""
        shape = Deformation.of_stretch(at.shape)
        relaxing = (beta * density(branch.law, shape) for beta, branch in zip(shares, self.branches, strict=True))
        return sum(relaxing, density(self.equilibrium, at))


def Prony(law: Law, g: Sequence[float], tau: Sequence[float]) -> Viscous:  # noqa: N802  (reads as a law)
    """Quasi-linear viscoelasticity: W_k = g_k W, W_∞ = (1 - Σ g_k) W, with W the instantaneous law.

    g     fractions of the initial modulus that relax, each > 0, sum < 1
    tau   relaxation times (s)

    >>> from ngbrain.materials import NeoHooke
    >>> len(Prony(NeoHooke(842.0), g=[0.45, 0.365], tau=[0.5, 50.0]).branches)
    2
    """
    if len(g) != len(tau):
        raise InputError("Prony.tau", f"{len(tau)} values", f"as many as g has: {len(g)}")
    for value in g:
        positive(value, "Prony.g")
    if not sum(g) < 1:
        raise InputError("Prony.g", list(g), "fractions that add up to less than 1")
    rest = Scaled(law, 1 - sum(g))
    return Viscous(rest, tuple(Branch(Scaled(law, gk), tk) for gk, tk in zip(g, tau, strict=True)))


def number(value: Value) -> float:
    """What a number or a `Parameter` holds."""
    return float(value.Get() if hasattr(value, "Get") else value)


def step_factors(dt: float | np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """e = exp(-Δt/τ) and β = (1 - e)/(Δt/τ) of a step, to full precision for any Δt/τ ≥ 0 (β = 1 at 0).

    >>> e, beta = step_factors(1.0, np.array([1e9]))
    >>> float(beta[0]) <= 1.0 and 1 - float(beta[0]) < 1e-9
    True
    """
    x = dt / tau
    safe = np.where(x > 0, x, 1.0)
    return np.exp(-x), np.where(x > 0, -np.expm1(-safe) / safe, 1.0)


def after(material: Viscous, dt: float) -> Law:
    """The elastic law that one step of `dt` > 0 seconds from rest amounts to, W_∞ + Σ β_k W_k."""
    return _Fixed(material, tuple(_share(dt, branch.tau) for branch in material.branches))


def _share(dt: float, tau: Value) -> Value:
    if isinstance(tau, CoefficientFunction):
        return (1 - exp(-dt / tau)) * tau / dt
    return float(step_factors(dt, np.array([tau]))[1][0])


@dataclass(frozen=True)
class _Fixed(Composite):
    material: Viscous
    shares: tuple[Value, ...]

    def density(self, at: Deformation) -> CoefficientFunction:
        return self.material.density(at, self.shares)
