"""What a law of one's own has to pass before anything is computed with it.

It is an energy of C that a rotation does not change and that has no stress at rest, it says the `initial_modulus` that it has
there, and it is elliptic there: waves of every direction have a real speed (Legendre-Hadamard). Where ellipticity is lost further
out, that is said. `stretch = (low, high)` in the class says how far out it is meant to go.
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
"""Stretches that are looked at where the class says nothing."""
SAMPLES = 10
"""Stretches on either side of 1."""
ALIKE, MODULUS = 1e-8, 1e-6
"""Of energies, rotated and not, relative to the largest; of the modulus at rest, and of stresses there in moduli."""
STRAINS = (0.02, 0.1)
"""Sizes of the displacement gradients that rotations are tried on."""


def admit(law: Any, name: str) -> list[str]:
    """What to know of a law, in words; `InputError` for one that computations cannot be made with.

    Parameters
    ----------
    law : Law
        With its parameters' values, all numbers.
    name : str
        What it is called, for messages.

    Returns
    -------
    list of str
        Stretches at which it is not elliptic, or has no energy.

    Raises
    ------
    InputError
        It has no energy, one that changes with a rotation, a stress at rest, another modulus there than its `initial_modulus`, or
        is not elliptic there.

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
    """Points at deformations (n, 3, 3), the energy (Pa) there, and the nine entries of F that it is made of."""
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
        raise InputError(name, f"a law without an energy at strains of {STRAINS[0]:g}", "one that has one")
    apart = np.abs(turned - plain)[known]
    if (np.isfinite(plain) != np.isfinite(turned)).any() or np.max(apart) > ALIKE * np.max(np.abs(plain[known])):
        worst = int(np.argmax(apart))
        found = f"W(F) = {plain[known][worst]:.4g} Pa where W(QF) = {turned[known][worst]:.4g} Pa with a rotation Q"
        raise InputError(name, f"not objective: {found}", "an energy that rotations do not change")


def _declared(law: Law, name: str) -> float:
    """The modulus at rest (Pa) that the law says, found in its energy."""
    declared = getattr(law, "initial_modulus", None)
    if isinstance(declared, bool) or not isinstance(declared, int | float) or not 0 < declared < np.inf:
        found = "missing" if declared is None else repr(declared)
        raise InputError(
            f"{name}.initial_modulus", found, "its shear modulus at rest in Pa, a positive number or property"
        )
    moduli = _moduli_at_rest(law)
    nearest = moduli[np.argmin(np.abs(moduli - declared))]  # with fibres, that of one plane
    if not abs(nearest - declared) <= MODULUS * declared:
        raise InputError(
            f"{name}.initial_modulus", f"{declared:g} Pa", f"{nearest:.9g} Pa, which its energy has at rest"
        )
    return float(declared)


def _moduli_at_rest(law: Law) -> np.ndarray:
    """∂²W/∂γ² (Pa) in simple shears; of a law with directions in all six along the axes."""
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
        raise InputError(name, f"a law with a stress of {largest:.3g} Pa at rest", "one that has none there")


def _ellipticity(law: Law, name: str, modulus: float) -> list[str]:
    """What is lost, in words."""
    from ngbrain.materials.lab.elastic import (
        smallest_acoustic_eigenvalue,  # scipy's optimisers, which scenes of other laws do without
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
                    name, "a law that is not elliptic at rest", "waves of every direction (Legendre-Hadamard)"
                )
            lost = np.flatnonzero(~(worst[1:] > 0))
            if lost.size:
                what = "has no energy" if np.isnan(worst[1 + lost[0]]) else "is not elliptic"
                rule = "" if np.isnan(worst[1 + lost[0]]) else " (Legendre-Hadamard)"
                found.append(f"{name} {what} in a {kind} stretch of {stretches[lost[0]]:.3g}{rule}")
    return found
