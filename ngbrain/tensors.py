"""Kinematics and invariants as NGSolve CoefficientFunctions.

Symbols: F deformation gradient, C = FᵀF, J = det F, C̄ = J^(-2/3) C (isochoric part), E = (C - 1)/2. All 3×3 and dimensionless.
"""

from __future__ import annotations

import math
from functools import lru_cache

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

# Added under the root of |dev C|²/6. Large enough for finite derivatives at equal stretches, small enough not to affect
# residual and tangent; a much smaller value makes the tangent at equal stretches wrong.
EQUAL_STRETCH_GUARD = 1e-12


def tensor(*entries: CoefficientFunction | float) -> CoefficientFunction:
    """3×3 tensor from nine entries by rows, or a vector from fewer; entries are numbers or scalar functions.

    >>> tuple(tensor(1, 0, 0, 0, 1, 0, 0, 0, ngs.x).dims)
    (3, 3)
    """
    made = tuple(each if isinstance(each, CoefficientFunction) else constant(float(each)) for each in entries)
    return ngs.CF(made, dims=(3, 3)) if len(made) == 9 else ngs.CF(made)


@lru_cache(maxsize=64)
def constant(value: float) -> CoefficientFunction:
    """Constant CoefficientFunction, cached: NGSolve takes 0.1 ms to convert a number inside a tuple, longer than all the rest."""
    return ngs.CF(value)


def deformation_gradient(u: CoefficientFunction) -> CoefficientFunction:
    """Deformation gradient F = 1 + ∇u of a displacement (m), a trial function or a GridFunction."""
    return ngs.Id(u.dim) + ngs.Grad(u)


def right_cauchy_green(F: CoefficientFunction) -> CoefficientFunction:
    """Right Cauchy-Green tensor C = FᵀF."""
    return F.trans * F


def isochoric_factor(C: CoefficientFunction) -> CoefficientFunction:
    """(det C)^(-1/3), the factor that makes C isochoric.

    Computed by exp and log: NGSolve differentiates non-integer powers entry by entry, which takes ten times as long.
    """
    return ngs.exp(-ngs.log(ngs.Det(C)) / 3)


def isochoric(C: CoefficientFunction) -> CoefficientFunction:
    """Isochoric part C̄ = (det C)^(-1/3) C, with determinant one."""
    return isochoric_factor(C) * C


def to_voigt(A: CoefficientFunction) -> CoefficientFunction:
    """The six entries of a symmetric tensor in Voigt order: xx, yy, zz, yz, xz, xy; shears are those of the tensor, not doubled."""
    return ngs.CF((A[0, 0], A[1, 1], A[2, 2], A[1, 2], A[0, 2], A[0, 1]))


def from_voigt(entries: CoefficientFunction) -> CoefficientFunction:
    """Symmetric tensor from its six entries in the order of `to_voigt`."""
    xx, yy, zz, yz, xz, xy = (entries[i] for i in range(6))
    return ngs.CF((xx, xy, xz, xy, yy, yz, xz, yz, zz), dims=(3, 3))


def deviator(A: CoefficientFunction) -> CoefficientFunction:
    """Deviator A - (tr A / 3) 1."""
    return A - ngs.Trace(A) / 3 * ngs.Id(3)


def lagrangian_deviator(A: CoefficientFunction, C: CoefficientFunction) -> CoefficientFunction:
    """Lagrangian deviator DEV A = A - (A : C)/3 C⁻¹ of a second Piola-Kirchhoff stress; invariant when C is scaled.

    Parameters
    ----------
    A : CoefficientFunction
        (3, 3) symmetric tensor, such as the second Piola-Kirchhoff stress (Pa).
    C : CoefficientFunction
        (3, 3) right Cauchy-Green tensor.

    Returns
    -------
    CoefficientFunction
        (3, 3), in the unit of A.
    """
    return A - ngs.InnerProduct(A, C) / 3 * ngs.Inv(C)


def principal_values(C: CoefficientFunction) -> tuple[CoefficientFunction, CoefficientFunction, CoefficientFunction]:
    """Eigenvalues c₁ ≥ c₂ ≥ c₃ of a symmetric 3×3 tensor by the trigonometric formula, differentiable also at equal values.

    With q = tr C/3, B = C - q1, p = √(|B|²/6 + 1e-12) and cos 3φ = det(B/p)/2: c_i = q + 2p cos(φ + 2πm/3). The values shift by
    up to 2e-6 where all three are equal; stress and tangent of energies built on them are accurate to 1e-10.

    References
    ----------
    Smith 1961, doi:10.1145/355578.366316.
    """
    q = ngs.Trace(C) / 3
    B = C - q * ngs.Id(3)
    p_squared = ngs.InnerProduct(B, B) / 6 + EQUAL_STRETCH_GUARD
    p = ngs.sqrt(p_squared)
    phi = ngs.acos(ngs.Det(B) / (2 * p * p_squared)) / 3
    third = 2 * math.pi / 3
    return q + 2 * p * ngs.cos(phi), q + 2 * p * ngs.cos(phi - third), q + 2 * p * ngs.cos(phi + third)


def octahedral_shear(E: np.ndarray) -> np.ndarray:
    """Octahedral shear strain 2/3 √((e₁-e₂)² + (e₂-e₃)² + (e₃-e₁)²) of principal strains, shape (n, 3) to (n,).

    The convention with the factor 2/3, as in magnetic resonance elastography; half of it is also used.

    >>> round(float(octahedral_shear(np.array([[0.1, -0.1, 0.0]]))[0]), 6)
    0.163299
    """
    e1, e2, e3 = np.asarray(E).T
    return 2 / 3 * np.sqrt((e1 - e2) ** 2 + (e2 - e3) ** 2 + (e3 - e1) ** 2)
