"""Kinematics and invariants as plain CoefficientFunctions.

Symbols: F deformation gradient, C = FᵀF, J = det F, C̄ = J^(-2/3) C (isochoric part), E = (C - 1)/2. All 3×3 and dimensionless.
"""

from __future__ import annotations

import math
from functools import lru_cache

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

# Added under the root of |dev C|²/6: large enough that derivatives stay finite at equal stretches, small enough not to
# show in residual and tangent; much smaller, and the tangent there is wrong.
EQUAL_STRETCH_GUARD = 1e-12


def tensor(*entries: CoefficientFunction | float) -> CoefficientFunction:
    """3×3 tensor of nine entries by rows, or a vector of fewer: numbers and scalar functions.

    >>> tuple(tensor(1, 0, 0, 0, 1, 0, 0, 0, ngs.x).dims)
    (3, 3)
    """
    made = tuple(each if isinstance(each, CoefficientFunction) else constant(float(each)) for each in entries)
    return ngs.CF(made, dims=(3, 3)) if len(made) == 9 else ngs.CF(made)


@lru_cache(maxsize=64)
def constant(value: float) -> CoefficientFunction:
    """A number as a function, made once: in a tuple of others NGSolve takes .1 ms to make it, longer than for all the rest."""
    return ngs.CF(value)


def deformation_gradient(u: CoefficientFunction) -> CoefficientFunction:
    """F = 1 + ∇u of a displacement: a trial function or a GridFunction (m)."""
    return ngs.Id(u.dim) + ngs.Grad(u)


def right_cauchy_green(F: CoefficientFunction) -> CoefficientFunction:
    """C = FᵀF."""
    return F.trans * F


def isochoric_factor(C: CoefficientFunction) -> CoefficientFunction:
    """(det C)^(-1/3), the factor that makes C isochoric.

    By exp and log: NGSolve derives powers with a broken exponent entry by entry, which takes ten times as long.
    """
    return ngs.exp(-ngs.log(ngs.Det(C)) / 3)


def isochoric(C: CoefficientFunction) -> CoefficientFunction:
    """C̄ = (det C)^(-1/3) C, which has determinant one."""
    return isochoric_factor(C) * C


def to_voigt(A: CoefficientFunction) -> CoefficientFunction:
    """The six entries of a symmetric tensor: xx, yy, zz, yz, xz, xy."""
    return ngs.CF((A[0, 0], A[1, 1], A[2, 2], A[1, 2], A[0, 2], A[0, 1]))


def from_voigt(entries: CoefficientFunction) -> CoefficientFunction:
    """The symmetric tensor with these `to_voigt` entries."""
    xx, yy, zz, yz, xz, xy = (entries[i] for i in range(6))
    return ngs.CF((xx, xy, xz, xy, yy, yz, xz, yz, zz), dims=(3, 3))


def green_lagrange(F: CoefficientFunction) -> CoefficientFunction:
    """E = (FᵀF - 1)/2."""
    return 0.5 * (F.trans * F - ngs.Id(3))


def deviator(A: CoefficientFunction) -> CoefficientFunction:
    """A - (tr A / 3) 1."""
    return A - ngs.Trace(A) / 3 * ngs.Id(3)


def lagrangian_deviator(A: CoefficientFunction, C: CoefficientFunction) -> CoefficientFunction:
    """DEV A = A - (A : C)/3 C⁻¹, the deviator of a second Piola-Kirchhoff stress; unchanged when C is scaled."""
    return A - ngs.InnerProduct(A, C) / 3 * ngs.Inv(C)


def safe_norm(A: CoefficientFunction, floor: float = 1e-12) -> CoefficientFunction:
    """√(A:A + floor²): the Frobenius norm with a derivative also at A = 0, where √(A:A) has none."""
    return ngs.sqrt(ngs.InnerProduct(A, A) + floor**2)


def principal_values(C: CoefficientFunction) -> tuple[CoefficientFunction, CoefficientFunction, CoefficientFunction]:
    """Eigenvalues c₁ ≥ c₂ ≥ c₃ of a symmetric 3×3 tensor, by the trigonometric formula; differentiable at equal values.

    With q = tr C/3, B = C - q1, p = √(|B|²/6 + 1e-12) and cos 3φ = det(B/p)/2:  c_i = q + 2p cos(φ + 2πm/3).
    Values are shifted by up to 2e-6 where all three agree; energies made of them keep stress and tangent to 1e-10.

    Source: Smith 1961, 10.1145/355578.366316.
    """
    q = ngs.Trace(C) / 3
    B = C - q * ngs.Id(3)
    p_squared = ngs.InnerProduct(B, B) / 6 + EQUAL_STRETCH_GUARD
    p = ngs.sqrt(p_squared)
    phi = ngs.acos(ngs.Det(B) / (2 * p * p_squared)) / 3
    third = 2 * math.pi / 3
    return q + 2 * p * ngs.cos(phi), q + 2 * p * ngs.cos(phi - third), q + 2 * p * ngs.cos(phi + third)


def octahedral_shear(E: np.ndarray) -> np.ndarray:
    """Octahedral shear strain 2/3 √((e₁-e₂)² + (e₂-e₃)² + (e₃-e₁)²) of principal strains E, shape (n, 3) to (n,).

    The convention with 2/3, as in magnetic resonance elastography (half of it circulates too).

    >>> round(float(octahedral_shear(np.array([[0.1, -0.1, 0.0]]))[0]), 6)
    0.163299
    """
    e1, e2, e3 = np.asarray(E).T
    return 2 / 3 * np.sqrt((e1 - e2) ** 2 + (e2 - e3) ** 2 + (e3 - e1) ** 2)
