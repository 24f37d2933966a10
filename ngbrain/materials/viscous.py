"""Hereditary viscoelasticity, with time steps that are again energies.

Each branch k has an isochoric energy W_k(C̄) and a relaxation time τ_k; W_∞ is the equilibrium energy. With S̄_k =
DEV{2 ∂W_k/∂C̄}, x_k = Δt/τ_k, e_k = exp(-x_k) and β_k = (1 - e_k)/x_k, the state at the end of a step minimises

    W = W_∞(C̄) + Σ β_k W_k(C̄) + ½ Σ (e_k H_k - β_k S̄_k) : C̄          (H_k, S̄_k at the start of the step)

and the internal variables are updated by H_k ← e_k H_k + β_k (S̄_k,new - S̄_k). The update is exact for S̄ linear
in time within a step, of second order otherwise, and stable for any Δt/τ; Δt → 0 gives W_∞ + Σ W_k, Δt → ∞ gives
W_∞.

References
----------
Simo 1987, 10.1016/0045-7825(87)90107-1; Simo & Hughes 1998, section 10.3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.arguments import check_sequence
from ngbrain.errors import InputError
from ngbrain.materials.base import (
    Deformation,
    Law,
    LawCard,
    Scaled,
    Sum,
    Value,
    check_parameter,
    check_positive,
    density,
)
from ngbrain.materials.isotropic import Polynomial
from ngbrain.materials.maxwell import Maxwell
from ngbrain.materials.points import Points, number
from ngbrain.tensors import lagrangian_deviator


@dataclass(frozen=True, repr=False)
class Branch(LawCard):
    """Hereditary viscoelastic branch.

    Parameters
    ----------
    law : Law
        Its energy W_k.
    tau : float or CoefficientFunction
        Relaxation time τ_k (s), positive.
    """

    law: Law
    tau: Value

    def __post_init__(self) -> None:
        check_positive(self.tau, "Branch.tau")

    def stress(self, C: CoefficientFunction) -> CoefficientFunction:
        """S̄ = DEV{2 ∂W/∂C̄} (Pa) at the isochoric C̄, a 3×3 CoefficientFunction; zero at rest."""
        C = C.MakeVariable()
        return overstress(density(self.law, Deformation.from_stretch(C)), C)

    def overstress(self, points: Points, C: CoefficientFunction, times: np.ndarray) -> np.ndarray:
        """Overstress H under given histories of C̄; at the first time H = S̄.

        Parameters
        ----------
        points : Points
            Evaluation points.
        C : CoefficientFunction
            C̄, with its values at `points`: one history after the other.
        times : numpy.ndarray of shape (times)
            Times (s).

        Returns
        -------
        numpy.ndarray of shape (histories, times, 3, 3)
            Overstress H (Pa).
        """
        S = points(self.stress(C).Compile()).T.reshape(-1, len(times), 3, 3)
        H = S.copy()
        e, beta = step_factors(np.diff(times), np.array(number(self.tau)))
        for n in range(len(times) - 1):
            H[:, n + 1] = e[n] * H[:, n] + beta[n] * (S[:, n + 1] - S[:, n])
        return H


def overstress(energy: CoefficientFunction, C: CoefficientFunction) -> CoefficientFunction:
    """DEV{2 ∂W/∂C̄} of an energy.

    Parameters
    ----------
    energy : CoefficientFunction
        Energy density (Pa).
    C : CoefficientFunction
        The variable C̄, 3×3.

    Returns
    -------
    CoefficientFunction
        Stress (Pa), 3×3.
    """
    by_C = energy.Diff(C)
    return lagrangian_deviator(by_C + by_C.trans, C)  # by_C is unsymmetric for laws of single entries


@dataclass(frozen=True, repr=False)
class Viscous(LawCard):
    """Viscoelastic material: an equilibrium law and viscoelastic branches.

    `+` adds a law to the equilibrium law, or another viscoelastic material with its branches.

    Parameters
    ----------
    equilibrium : Law
        Equilibrium law W_∞.
    branches : tuple of Branch or Maxwell, default ()
        Hereditary branches (`Branch`) and branches of finite viscoelasticity (`Maxwell`).

    Examples
    --------
    >>> from ngbrain.materials import NeoHooke
    >>> len((Viscous(NeoHooke(160.0), (Branch(NeoHooke(970.0), 2.3),)) + NeoHooke(50.0)).branches)
    1
    """

    equilibrium: Law
    branches: tuple[Branch | Maxwell, ...] = ()

    def __add__(self, other: Law | Viscous) -> Viscous:
        if isinstance(other, Viscous):
            return Viscous(Sum((self.equilibrium, other.equilibrium)), self.branches + other.branches)
        return Viscous(Sum((self.equilibrium, other)), self.branches) if isinstance(other, Law) else NotImplemented

    __radd__ = __add__

    @property
    def hereditary_branches(self) -> tuple[Branch, ...]:
        """The branches whose internal variable is the overstress."""
        return tuple(branch for branch in self.branches if isinstance(branch, Branch))

    @property
    def maxwell_branches(self) -> tuple[Maxwell, ...]:
        """The branches of finite viscoelasticity."""
        return tuple(branch for branch in self.branches if isinstance(branch, Maxwell))

    @property
    def instantaneous(self) -> Law:
        """Instantaneous law W_∞ + Σ W_k."""
        return Sum((self.equilibrium, *(branch.law for branch in self.branches)))

    def density(self, at: Deformation, shares: Sequence[Value]) -> CoefficientFunction:
        """Energy density of the equilibrium law and a share of the hereditary branches, W_∞ + Σ β_k W_k(C̄).

        Parameters
        ----------
        at : Deformation
            Deformation measures.
        shares : sequence of float or CoefficientFunction
            Shares β_k of the branches: 1 instantaneously, 0 in equilibrium.

        Returns
        -------
        CoefficientFunction
            Energy density (Pa).
        """
        shape = Deformation.from_stretch(at.shape)
        relaxing = (
            beta * density(branch.law, shape) for beta, branch in zip(shares, self.hereditary_branches, strict=True)
        )
        return sum(relaxing, density(self.equilibrium, at))


def viscous(law: Viscous | Law) -> Viscous:
    """The material itself, or an elastic law as a material without branches.

    >>> from ngbrain.materials import NeoHooke
    >>> viscous(NeoHooke(500.0))
    Viscous(equilibrium=NeoHooke(mu=500.0), branches=())
    """
    return law if isinstance(law, Viscous) else Viscous(law)


def Prony(law: Law, g: Sequence[Value], tau: Sequence[Value]) -> Viscous:  # noqa: N802  (reads as a law)
    """Quasi-linear viscoelasticity: W_k = g_k W, W_∞ = (1 - Σ g_k) W.

    Parameters
    ----------
    law : Law
        Instantaneous law W.
    g : sequence of float or CoefficientFunction
        Relaxing fractions of the initial modulus, each positive, with a sum below 1.
    tau : sequence of float or CoefficientFunction
        Relaxation times (s), positive.

    Returns
    -------
    Viscous
        The viscoelastic material.

    Raises
    ------
    InputError
        An inadmissible value, or different numbers of fractions and times.

    Examples
    --------
    >>> from ngbrain.materials import NeoHooke
    >>> len(Prony(NeoHooke(842.0), g=[0.45, 0.365], tau=[0.5, 50.0]).branches)
    2
    """
    g, tau = check_sequence("Prony.g", g), check_sequence("Prony.tau", tau)
    if len(g) != len(tau):
        raise InputError("Prony.tau", f"{len(tau)} values", f"as many as g has: {len(g)}")
    for value in g:
        check_positive(value, "Prony.g")
    if not any(isinstance(value, CoefficientFunction) for value in g) and not sum(g) < 1:
        raise InputError("Prony.g", list(g), "fractions that add up to less than 1")
    rest = Scaled(law, 1 - sum(g))
    return Viscous(rest, tuple(Branch(Scaled(law, gk), tk) for gk, tk in zip(g, tau, strict=True)))


def RelaxingPolynomial(  # noqa: N802  (reads as a law)
    c0: Mapping[tuple[int, int], Value],
    c_inf: Mapping[tuple[int, int], Value],
    gamma: Sequence[float] | Mapping[tuple[int, int], Sequence[float]],
    tau: Sequence[Value] | Mapping[tuple[int, int], Sequence[Value]],
) -> Viscous:
    """`Polynomial` law whose coefficients relax individually, C_ij(t) = C_ij∞ + (C_ij0 - C_ij∞) Σ γ_k exp(-t/τ_k).

    There is one branch for each relaxation time, with the (C_ij0 - C_ij∞) γ_k that relax with it. c₁₀ and c₀₁ may
    not grow, so that small strains dissipate; higher coefficients may. If all coefficients relax alike, the
    material is `Prony` of Polynomial(c0) with g_k = γ_k (1 - C_ij∞/C_ij0).

    Parameters
    ----------
    c0, c_inf : dict of tuple of (int, int) to float or CoefficientFunction
        (i, j) → instantaneous and equilibrium coefficient (Pa), for the same powers.
    gamma : sequence of float or dict of tuple of (int, int) to sequence of float
        Shares γ_k > 0 with sum 1, for all coefficients alike or (i, j) → those of one.
    tau : sequence of float or CoefficientFunction or dict of tuple of (int, int) to sequence of float or CoefficientFunction
        Relaxation times τ_k (s), for all coefficients alike or (i, j) → those of one.

    Returns
    -------
    Viscous
        The viscoelastic material.

    Raises
    ------
    InputError
        Different powers, a first-order coefficient that grows, or inadmissible shares and times.

    Examples
    --------
    >>> law = RelaxingPolynomial({(1, 0): 300.0, (2, 0): 500.0}, {(1, 0): 60.0, (2, 0): 40.0}, [0.6, 0.4], [0.5, 50.0])
    >>> [branch.tau for branch in law.branches]
    [0.5, 50.0]
    """
    if set(c0) != set(c_inf):
        raise InputError("RelaxingPolynomial.c_inf", f"for {sorted(c_inf)}", f"the powers of c0: {sorted(c0)}")
    relaxing: dict[Value, dict[tuple[int, int], Value]] = {}
    for power in c0:
        lost, index = c0[power] - c_inf[power], f"[{power[0]}, {power[1]}]"
        if sum(power) == 1:
            check_parameter(lost, f"RelaxingPolynomial.c0{index} - c_inf{index}", lambda drop: drop >= 0, "at least 0")
        for share, time in zip(*_shares_of(power, gamma, tau), strict=True):
            if isinstance(lost, CoefficientFunction) or lost:
                terms = relaxing.setdefault(time, {})
                terms[power] = terms.get(power, 0.0) + lost * share
    return Viscous(Polynomial(c_inf), tuple(Branch(Polynomial(terms), time) for time, terms in relaxing.items()))


def _shares_of(
    power: tuple[int, int],
    gamma: Sequence[float] | Mapping[tuple[int, int], Sequence[float]],
    tau: Sequence[Value] | Mapping[tuple[int, int], Sequence[Value]],
) -> tuple[Sequence[float], Sequence[Value]]:
    """Shares and relaxation times of one coefficient."""
    given = [values.get(power, ()) if isinstance(values, Mapping) else values for values in (gamma, tau)]
    for name, values in zip(("gamma", "tau"), given, strict=True):
        if not len(values):
            raise InputError(f"RelaxingPolynomial.{name}", f"empty for {power}", "a value for each branch")
        for value in values:
            check_positive(value, f"RelaxingPolynomial.{name}")
    shares, times = given
    if len(shares) != len(times):
        raise InputError("RelaxingPolynomial.tau", f"{len(times)} values", f"as many as gamma has: {len(shares)}")
    if not abs(sum(shares) - 1) <= 1e-9:
        raise InputError("RelaxingPolynomial.gamma", list(shares), "shares that add up to 1")
    return shares, times


def step_factors(dt: float | np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """e = exp(-Δt/τ) and β = (1 - e)/(Δt/τ) of a time step, to full precision for any Δt/τ ≥ 0 (β = 1 at 0).

    Parameters
    ----------
    dt : float or numpy.ndarray
        Time step (s).
    tau : numpy.ndarray
        Relaxation times (s).

    Returns
    -------
    tuple of (numpy.ndarray, numpy.ndarray)
        e and β, of the broadcast shape.

    Examples
    --------
    >>> e, beta = step_factors(1.0, np.array([1e9]))
    >>> float(beta[0]) <= 1.0 and 1 - float(beta[0]) < 1e-9
    True
    """
    x = dt / tau
    safe = np.where(x > 0, x, 1.0)
    return np.exp(-x), np.where(x > 0, -np.expm1(-safe) / safe, 1.0)
