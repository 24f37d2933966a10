"""Checks that a user-defined law passes before anything is computed with it.

A law is an energy density of C that is objective (unchanged by a rotation), has no stress in the reference
configuration, states its shear modulus there as `initial_modulus`, and is elliptic there: plane waves of every
direction have a real speed (Legendre-Hadamard condition). Where ellipticity is lost at larger stretches, a warning
says so. The class attribute `stretch = (low, high)` gives the range of stretches that the law is meant for.
"""

from __future__ import annotations

from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.materials.base import Deformation, Law, density
from ngbrain.materials.points import Points, isotropic
from ngbrain.tensors import tensor

STRETCH = (0.8, 1.25)
"""Range of stretches that is checked where the class states none."""
SAMPLES = 10
"""Number of stretches on either side of 1."""
ALIKE, MODULUS = 1e-8, 1e-6
"""Relative tolerances: of energies before and after a rotation (of the largest energy), and of the initial modulus.
The second is also that of the stress in the reference configuration, in units of the modulus.
"""
STRAINS = (0.02, 0.1)
"""Sizes of the random displacement gradients on which objectivity is checked."""


def admit(law: Any, name: str) -> list[str]:
    """Check a user-defined law and return warnings about it.

    Parameters
    ----------
    law : object
        The law with the values of its parameters, all numbers.
    name : str
        Name of the law, for messages.

    Returns
    -------
    list of str
        Warnings: stretches at which the law is not elliptic or has no finite energy.

    Raises
    ------
    InputError
        The law has no energy, is not objective, has a stress in the reference configuration, has there another
        modulus than its `initial_modulus`, or is not elliptic there.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Softening:
    ...     mu: float
    ...     initial_modulus = property(lambda self: self.mu)
    ...     def energy(self, C):
    ...         I = ngs.Trace(C) - 3
    ...         return self.mu / 2 * (I - I * I)
    >>> admit(Softening(900.0), "Softening")[1]
    'Softening is not elliptic in a planar stretch of 1.23 (Legendre-Hadamard)'
    """
    if not isinstance(law, Law):
        raise InputError(name, repr(law), "an object with `energy(C)`, W in Pa of a 3×3 tensor C")
    try:
        _check_objective(law, name)
        modulus = _declared(law, name)
        _check_rest(law, name, modulus)
        return _ellipticity(law, name, modulus)
    except InputError:
        raise
    except Exception as error:
        said = " ".join(str(error).split())
        raise InputError(
            name, f"a law whose energy raises {type(error).__name__}: {said}", "one of NGSolve's functions"
        ) from None


def _at(law: Law, F: np.ndarray) -> tuple[Points, ngs.CoefficientFunction, ngs.CoefficientFunction]:
    """Points at deformations (n, 3, 3), the energy density (Pa) there, and the nine entries of F as variables."""
    points = Points.line(len(F))
    field = points.field(F.reshape(-1, 9).T)
    entries = ngs.CF(tuple(field[i] for i in range(9))).MakeVariable()
    gradient = ngs.CF(tuple(entries[i] for i in range(9)), dims=(3, 3))
    return points, density(law, Deformation.from_gradient(gradient)), entries


def _check_objective(law: Law, name: str) -> None:
    random = np.random.default_rng(0)
    strained = np.concatenate([np.eye(3) + size * random.normal(size=(4, 3, 3)) for size in STRAINS])
    turns = np.linalg.qr(random.normal(size=(len(strained), 3, 3)))[0]
    turns *= np.linalg.det(turns)[:, None, None]
    points, energy, _ = _at(law, np.concatenate([strained, turns @ strained]))
    plain, turned = points(energy)[0].reshape(2, -1)
    known = np.isfinite(plain) & np.isfinite(turned)
    if not known[: len(known) // 2].any():
        raise InputError(
            name, f"a law without an energy at strains of {STRAINS[0]:g}", "one with a finite energy there"
        )
    apart = np.abs(turned - plain)[known]
    if (np.isfinite(plain) != np.isfinite(turned)).any() or np.max(apart) > ALIKE * np.max(np.abs(plain[known])):
        worst = int(np.argmax(apart))
        found = f"W(F) = {plain[known][worst]:.4g} Pa where W(QF) = {turned[known][worst]:.4g} Pa with a rotation Q"
        raise InputError(name, f"not objective: {found}", "an energy that rotations do not change")


def _declared(law: Law, name: str) -> float:
    """The declared initial modulus (Pa), checked against the second derivative of the energy."""
    declared = getattr(law, "initial_modulus", None)
    if isinstance(declared, bool) or not isinstance(declared, int | float) or not 0 < declared < np.inf:
        found = "missing" if declared is None else repr(declared)
        raise InputError(
            f"{name}.initial_modulus", found, "its shear modulus at rest in Pa, a positive number or property"
        )
    moduli = _moduli_at_rest(law)
    nearest = moduli[np.argmin(np.abs(moduli - declared))]  # with fibres, one of the six shears
    if not abs(nearest - declared) <= MODULUS * declared:
        raise InputError(
            f"{name}.initial_modulus", f"{declared:g} Pa", f"{nearest:.9g} Pa, which its energy has at rest"
        )
    return float(declared)


def _moduli_at_rest(law: Law) -> np.ndarray:
    """∂²W/∂γ² (Pa) in simple shear; for an anisotropic law in all six shears along the axes."""
    planes = [(i, j) for i in range(3) for j in range(3) if i != j][: 1 if isotropic(law) else 6]
    found = []
    for i, j in planes:
        points = Points.line(1)
        shear = ngs.CF(1.0 * points.field(np.zeros((1, 1)))[0]).MakeVariable()
        entries: list[Any] = [1, 0, 0, 0, 1, 0, 0, 0, 1]
        entries[3 * i + j] = shear
        energy = density(law, Deformation.from_gradient(tensor(*entries)))
        found.append(points(energy.Diff(shear).Diff(shear))[0, 0])
    return np.array(found)


def _check_rest(law: Law, name: str, modulus: float) -> None:
    points, energy, entries = _at(law, np.eye(3)[None])
    stress = points(energy.Diff(entries))
    largest = float(np.max(np.abs(stress)))
    if not largest <= MODULUS * modulus:
        raise InputError(name, f"a law with a stress of {largest:.3g} Pa at rest", "one without")


def _ellipticity(law: Law, name: str, modulus: float) -> list[str]:
    """Warnings about stretches at which ellipticity or the energy is lost."""
    from ngbrain.materials.lab.elastic import (
        smallest_acoustic_eigenvalue,  # imports scipy.optimize, which other scenes do not need
    )

    low, high = getattr(law, "stretch", STRETCH)
    if not 0 < low <= 1 <= high < np.inf:
        raise InputError(f"{name}.stretch", (low, high), "the lowest and the highest stretch, 1 between them")
    sides = [np.linspace(1, end, SAMPLES + 1)[1:] for end in (low, high)]
    kinds = {"uniaxial": lambda s: (s, s**-0.5, s**-0.5), "planar": lambda s: (s, 1.0, 1 / s)}
    turns = range(1 if isotropic(law) else 3)
    found = []
    for kind, stretched in kinds.items():
        for stretches in sides:
            at = np.array([np.diag(np.roll(stretched(s), turn)) for s in (1.0, *stretches) for turn in turns])
            least = smallest_acoustic_eigenvalue(law, at).reshape(-1, len(turns))
            worst = np.where(np.isfinite(least).all(axis=1), least.min(axis=1), np.nan)
            if not worst[0] > ALIKE * modulus:
                raise InputError(
                    name,
                    "a law that is not elliptic at rest",
                    "real wave speeds in every direction (Legendre-Hadamard)",
                )
            lost = np.flatnonzero(~(worst[1:] > 0))
            if lost.size:
                what = "has no energy" if np.isnan(worst[1 + lost[0]]) else "is not elliptic"
                rule = "" if np.isnan(worst[1 + lost[0]]) else " (Legendre-Hadamard)"
                found.append(f"{name} {what} in a {kind} stretch of {stretches[lost[0]]:.3g}{rule}")
    return found
