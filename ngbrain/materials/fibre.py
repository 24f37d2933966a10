"""Laws with fibres, and exponential laws of all strain components. Except for the isotropic matrix they are laws of
the total C.

A fibre is a vector field of three components, or three numbers, of any length but 0 and of either sign: M =
a⊗a/|a|².
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.arguments import check_sequence
from ngbrain.errors import InputError
from ngbrain.materials.base import Composite, Deformation, TotalStretchLaw, Value, check_parameter, check_positive

Fibre: TypeAlias = CoefficientFunction | Sequence[Value]
"""Fibre direction: a CoefficientFunction or GridFunction with one component per axis, or as many numbers."""

SLACK = 1e-12
"""Fibres carry load from E = -SLACK on, so that they contribute to the stiffness at rest, where E is 0 up to
round-off. Without it the first Newton step overshoots however small the load. The stress jumps there by 2 k₁
SLACK, far below any tolerance.
"""

STIFF = 1e-12
"""Smallest admissible eigenvalue of `Fung.B`, relative to the largest."""


@dataclass(frozen=True, repr=False)
class HolzapfelGasserOgden(Composite):
    """Holzapfel-Gasser-Ogden law with dispersed fibres.

    W = μ/2 (Ī₁ - 3) + Σ k₁/2k₂ (exp(k₂ E²) - 1), E = κ (I₁ - 3) + (1 - 3κ)(I₄ - 1), summed over fibres with E > 0;
    I₁ = tr C, Ī₁ = tr C̄, I₄ = a·Ca with the unit vector a along the fibre.

    I₄ is taken of C, not of C̄, with which a dilatation would not stretch the fibres. So is the I₁ of E, the other
    part of one mean square stretch over the directions of a family: with κ = 1/3 the law is isotropic and
    exponential whatever a is. Compressed fibres (E ≤ 0) carry no load; the stress is continuous there, its slope is
    not. The initial shear modulus is μ₀ = μ, for shears along and across one fibre.

    Parameters
    ----------
    mu : float or CoefficientFunction
        Shear modulus of the matrix (Pa).
    k1 : float or CoefficientFunction
        Stiffness of the fibres (Pa), at least 0.
    k2 : float or CoefficientFunction
        Exponential stiffening of the fibres (dimensionless), positive.
    kappa : float or CoefficientFunction
        Dispersion, from 0 (all fibres along a) to 1/3 (isotropic).
    fibre : Fibre or sequence of Fibre
        One fibre direction, or a sequence of them for several families.

    Raises
    ------
    InputError
        A parameter out of its bounds, or no direction of three components.

    References
    ----------
    Gasser, Ogden, Holzapfel 2006, 10.1098/rsif.2005.0073; without the isochoric split: Nolan et al. 2014,
    10.1016/j.jmbbm.2014.06.016.

    Examples
    --------
    >>> import ngsolve as ngs
    >>> law = HolzapfelGasserOgden(mu=500.0, k1=2000.0, k2=5.0, kappa=0.1, fibre=(1, 1, 0))
    >>> law.energy(ngs.Id(3)).dim
    1
    """

    mu: Value
    k1: Value
    k2: Value
    kappa: Value
    fibre: Fibre | Sequence[Fibre]

    def __post_init__(self) -> None:
        check_positive(self.mu, "HolzapfelGasserOgden.mu")
        check_parameter(self.k1, "HolzapfelGasserOgden.k1", lambda k: k >= 0, "a number of at least 0")
        check_positive(self.k2, "HolzapfelGasserOgden.k2")
        check_parameter(self.kappa, "HolzapfelGasserOgden.kappa", lambda k: 0 <= k <= 1 / 3, "a number from 0 to 1/3")
        self._families()

    def _families(self) -> list[CoefficientFunction]:
        fibre, name = self.fibre, "HolzapfelGasserOgden.fibre"
        if not isinstance(fibre, CoefficientFunction):
            check_sequence(name, fibre)
        if isinstance(fibre, CoefficientFunction) or all(_is_component(entry) for entry in fibre):
            return [structural(fibre, name)]
        return [structural(one, name) for one in fibre]

    def density(self, at: Deformation) -> CoefficientFunction:
        """Energy density (Pa)."""
        energy, isotropic = self.mu / 2 * (ngs.Trace(at.shape) - 3), self.kappa * (ngs.Trace(at.C) - 3)
        for M in self._families():
            E = isotropic + (1 - 3 * self.kappa) * (ngs.InnerProduct(M, at.C) - 1)
            energy += self.k1 / (2 * self.k2) * (ngs.exp(self.k2 * ngs.IfPos(E + SLACK, E * E, 0.0)) - 1)
        return energy


@dataclass(frozen=True, repr=False)
class Fung(TotalStretchLaw):
    """Fung's exponential law, W = c/2 (exp(Q) - 1).

    Q = E:B:E = vᵀBv with v = (E_xx, E_yy, E_zz, 2E_yz, 2E_xz, 2E_xy) and E = (C - 1)/2. Isotropic for b (2 + β) at
    xx, yy, zz, bβ between them and b at the shears; the initial shear modulus is then μ₀ = c b.

    Parameters
    ----------
    c : float or CoefficientFunction
        Scale (Pa); c B is the stiffness at rest.
    B : sequence of sequence of float or CoefficientFunction or numpy.ndarray or CoefficientFunction
        Dimensionless stiffness: 6 rows of 6 numbers or fields, symmetric and positive definite, or a 6×6
        CoefficientFunction.

    Raises
    ------
    InputError
        `c` is not positive, or `B` is not 6×6, not symmetric or not positive definite.

    References
    ----------
    Fung, Fronek, Patitucci 1979, 10.1152/ajpheart.1979.237.5.H620.

    Examples
    --------
    >>> import numpy as np, ngsolve as ngs
    >>> Fung(c=100.0, B=np.diag([20.0, 20.0, 20.0, 10.0, 10.0, 10.0])).energy(ngs.Id(3)).dim
    1
    """

    c: Value
    B: Sequence[Sequence[Value]] | np.ndarray | CoefficientFunction

    def __post_init__(self) -> None:
        check_positive(self.c, "Fung.c")
        self._matrix()

    def _matrix(self) -> CoefficientFunction:
        if isinstance(self.B, CoefficientFunction):
            if tuple(self.B.dims) != (6, 6):
                raise InputError("Fung.B", f"of the shape {tuple(self.B.dims)}", "6 by 6")
            return self.B
        rows = [tuple(row) for row in self.B]
        if [len(row) for row in rows] != [6] * 6:
            raise InputError("Fung.B", f"{len(rows)} rows of {[len(row) for row in rows]}", "6 rows of 6")
        entries = [entry for row in rows for entry in row]
        if not any(isinstance(entry, CoefficientFunction) for entry in entries):
            B = np.array(entries, float).reshape(6, 6)
            if not np.allclose(B, B.T, rtol=1e-12, atol=0):
                i, j = np.unravel_index(np.argmax(np.abs(B - B.T)), B.shape)
                raise InputError("Fung.B", f"{B[i, j]} at [{i}, {j}] and {B[j, i]} at [{j}, {i}]", "a symmetric matrix")
            least, *_, most = np.linalg.eigvalsh(B)
            if not least > STIFF * most:
                raise InputError("Fung.B", f"a matrix with the eigenvalue {least:.6g}", "a positive definite one")
            entries = list(B.ravel())
        return ngs.CF(tuple(entries), dims=(6, 6))

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density (Pa)."""
        # Both entries of a shear: the derivative by C is then symmetric.
        shears = (C[i, j] + C[j, i] for i, j in ((1, 2), (0, 2), (0, 1)))
        v = ngs.CF((C[0, 0] - 1, C[1, 1] - 1, C[2, 2] - 1, *shears)) / 2
        return self.c / 2 * (ngs.exp(ngs.InnerProduct(v, self._matrix() * v)) - 1)


@dataclass(frozen=True, repr=False)
class Guccione(TotalStretchLaw):
    """Guccione's transversely isotropic exponential law, W = c/2 (exp(Q) - 1): `Fung` with one fibre.

    Q = b_f E_ff² + b_t (E_ss² + E_nn² + 2E_sn²) + 2b_fs (E_fs² + E_fn²), E = (C - 1)/2. Initial shear moduli: c
    b_fs/2 along the fibre, c b_t/2 across it.

    Parameters
    ----------
    c : float or CoefficientFunction
        Scale (Pa).
    bf : float or CoefficientFunction
        Stiffness along the fibre f (dimensionless, positive).
    bt : float or CoefficientFunction
        Stiffness across the fibre, in s and n (dimensionless, positive).
    bfs : float or CoefficientFunction
        Stiffness of shears along the fibre (dimensionless, positive).
    fibre : Fibre
        Direction f.

    Raises
    ------
    InputError
        A parameter that is not positive, or no direction of three components.

    References
    ----------
    Guccione, McCulloch, Waldman 1991, 10.1115/1.2894084.

    Examples
    --------
    >>> import ngsolve as ngs
    >>> Guccione(c=2000.0, bf=8.0, bt=2.0, bfs=4.0, fibre=(1, 0, 0)).energy(ngs.Id(3)).dim
    1
    """

    c: Value
    bf: Value
    bt: Value
    bfs: Value
    fibre: Fibre

    def __post_init__(self) -> None:
        for name in ("c", "bf", "bt", "bfs"):
            check_positive(getattr(self, name), f"Guccione.{name}")
        structural(self.fibre, "Guccione.fibre")

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density (Pa)."""
        E, M = (C - ngs.Id(3)) / 2, structural(self.fibre, "Guccione.fibre")
        squared = E * E
        along, row = ngs.InnerProduct(M, E), ngs.InnerProduct(M, squared)
        across, sheared = ngs.Trace(squared) - 2 * row + along * along, row - along * along
        Q = self.bf * along * along + self.bt * across + 2 * self.bfs * sheared
        return self.c / 2 * (ngs.exp(Q) - 1)


def structural(fibre: Fibre, name: str, sizes: Sequence[int] = (3,)) -> CoefficientFunction:
    """Structural tensor M = a⊗a/|a|² of a fibre a.

    Parameters
    ----------
    fibre : Fibre
        Direction a.
    name : str
        Name of the parameter, for messages.
    sizes : sequence of int, default (3,)
        Admissible numbers of components.

    Returns
    -------
    CoefficientFunction
        The tensor M.

    Raises
    ------
    InputError
        No direction of an admissible number of components.

    Examples
    --------
    >>> tuple(structural((0, 3, 4), "fibre").dims)
    (3, 3)
    """
    wanted = f"a direction of {' or '.join(map(str, sizes))} components, not all 0"
    if isinstance(fibre, CoefficientFunction):
        if fibre.dim not in sizes:
            raise InputError(name, f"a field of {fibre.dim} components", wanted)
        return ngs.OuterProduct(fibre, fibre) / ngs.InnerProduct(fibre, fibre)
    given = tuple(fibre) if isinstance(fibre, (Sequence, np.ndarray)) else (fibre,)
    numbers = [entry for entry in given if not isinstance(entry, CoefficientFunction)]
    fits = len(given) in sizes and all(_is_component(entry) for entry in given) and np.all(np.isfinite(numbers))
    if not fits or (len(numbers) == len(given) and not any(numbers)):
        raise InputError(name, fibre, wanted)
    return structural(ngs.CF(tuple(given)), name, sizes)


def _is_component(entry: object) -> bool:
    return entry.dim == 1 if isinstance(entry, CoefficientFunction) else isinstance(entry, (int, float, np.number))
