"""What a material is: an energy density, nothing else."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from numbers import Complex, Real
from typing import Any, Protocol, TypeAlias, cast, runtime_checkable

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.tensors import isochoric, right_cauchy_green

Value: TypeAlias = float | CoefficientFunction
"""A parameter: a number, a `Parameter`, a CoefficientFunction or a GridFunction."""


@runtime_checkable
class Law(Protocol):
    """An elastic law: any object with this one method can be used wherever the package takes a law.

    It is given the isochoric C̄. A law that needs more of the deformation has `density(at)` besides, of a `Deformation`.
    """

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density W(C̄) in Pa."""


@dataclass(frozen=True)
class Deformation:
    """What a law may ask of a state: C̄ (`shape`), C = FᵀF, J = det F and F itself (`gradient`), 3×3 but for J.

    >>> import ngsolve as ngs
    >>> tuple(Deformation.from_gradient(2 * ngs.Id(3)).shape.dims)
    (3, 3)
    """

    shape: CoefficientFunction
    C: CoefficientFunction
    J: CoefficientFunction
    gradient: CoefficientFunction | None = None

    @classmethod
    def from_gradient(cls, F: CoefficientFunction) -> Deformation:
        """All of it from the deformation gradient."""
        C = right_cauchy_green(F)
        return cls(isochoric(C), C, ngs.Det(F), F)

    @classmethod
    def from_stretch(cls, C: CoefficientFunction) -> Deformation:
        """A state without change of volume, of which C is all that is known."""
        return cls(C, C, ngs.CF(1.0))

    @property
    def F(self) -> CoefficientFunction:
        """The deformation gradient; `InputError` where only stretches are known, as in a relaxing branch."""
        if self.gradient is None:
            raise InputError("law", "a linear one, of the displacement gradient", "here one of C, such as SaintVenant")
        return self.gradient


def density(law: Law, at: Deformation) -> CoefficientFunction:
    """Energy density (Pa) of any law: of the C̄ there, unless it has a `density` of its own. `InputError` for what is no law.

    >>> import ngsolve as ngs
    >>> from ngbrain.materials import NeoHooke
    >>> density(NeoHooke(1000.0), Deformation.from_gradient(ngs.Id(3))).dim
    1
    """
    own = getattr(law, "density", None)
    if own is None and not isinstance(law, Law):
        raise InputError("law", repr(law), "an object with `energy(C)`, W in Pa of a 3×3 tensor C")
    found = own(at) if own else law.energy(at.shape)
    if not isinstance(found, CoefficientFunction):
        wanted = "a CoefficientFunction made of C, W in Pa: constants make no stress"
        raise InputError(f"{type(law).__name__}.energy", f"{found!r}, a {type(found).__name__}", wanted)
    if found.dim != 1:
        raise InputError(f"{type(law).__name__}.energy", f"of {found.dim} components", "one number, W in Pa")
    return found


def density_of_log_strains(law: Law, logs: Sequence[CoefficientFunction]) -> CoefficientFunction:
    """Energy density (Pa) of an isotropic law at three logarithmic strains that add up to 0.

    A law may have `log_strain_energy`, which needs no eigenvalue computation; of a composite law each part uses its own.

    >>> import ngsolve as ngs
    >>> from ngbrain.materials import Ogden
    >>> density_of_log_strains(Scaled(Ogden(900.0, -19.0), 0.5), [ngs.x, -ngs.x, ngs.CF(0.0)]).dim
    1
    """
    own = getattr(law, "log_strain_energy", None)
    if own is not None:
        return cast(CoefficientFunction, own(logs))
    zero = ngs.CF(0.0)
    squares = [ngs.exp(2 * log) for log in logs]
    stretch = ngs.CF((squares[0], zero, zero, zero, squares[1], zero, zero, zero, squares[2]), dims=(3, 3))
    return density(law, Deformation.from_stretch(stretch))


class Addable:
    """Gives a law the `+` that makes a `Sum`."""

    def __add__(self, other: Law) -> Sum:
        if not isinstance(other, Law):
            return NotImplemented
        parts: list[Law] = []
        for law in (cast(Law, self), other):
            parts += law.parts if isinstance(law, Sum) else (law,)
        return Sum(tuple(parts))


class Composite(Addable):
    """A law made of others: what it says of C̄ alone follows from its `density`."""

    def density(self, at: Deformation) -> CoefficientFunction:
        """Energy density (Pa)."""
        raise NotImplementedError

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density (Pa) where C is C̄."""
        return self.density(Deformation.from_stretch(C))


class TotalStretchLaw(Addable):
    """A law of C with its change of volume, such as one of fibres: split off, a dilatation would not stretch them."""

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density (Pa) of C."""
        raise NotImplementedError

    def density(self, at: Deformation) -> CoefficientFunction:
        """Energy density (Pa)."""
        return self.energy(at.C)


@dataclass(frozen=True)
class Sum(Composite):
    """W = Σ W_i, made by `law + law`."""

    parts: tuple[Law, ...]

    def density(self, at: Deformation) -> CoefficientFunction:
        """Sum of the parts' energies (Pa)."""
        first, *rest = (density(part, at) for part in self.parts)
        return sum(rest, first)

    def log_strain_energy(self, logs: Sequence[CoefficientFunction]) -> CoefficientFunction:
        """The same (Pa) at logarithmic strains, see `density_of_log_strains`."""
        first, *rest = (density_of_log_strains(part, logs) for part in self.parts)
        return sum(rest, first)


@dataclass(frozen=True)
class Scaled(Composite):
    """factor × law."""

    law: Law
    factor: Value

    def density(self, at: Deformation) -> CoefficientFunction:
        """Energy density (Pa)."""
        return self.factor * density(self.law, at)

    def log_strain_energy(self, logs: Sequence[CoefficientFunction]) -> CoefficientFunction:
        """The same (Pa) at logarithmic strains, see `density_of_log_strains`."""
        return self.factor * density_of_log_strains(self.law, logs)


def check_parameter(
    value: Value, name: str, fits: Callable[[float], bool], wanted: str, complex_too: bool = False
) -> Value:
    """A parameter of a law, as it is.

    Parameters
    ----------
    value : float or CoefficientFunction
        A number is looked at; a function is taken at its word, as long as it has one component.
    name : str
        What it is, for messages.
    fits : callable
        Whether a number may be the value; of a complex modulus what it stores.
    wanted : str
        What `fits` lets pass, in words.
    complex_too : bool
        Whether the law takes complex moduli, as linear laws of waves do.

    Raises
    ------
    InputError
        It is no number and no function of one component, not finite, complex where it may not be, or does not fit.
    """
    if isinstance(value, CoefficientFunction):
        if value.dim != 1:
            raise InputError(name, f"a function of {value.dim} components", "one component")
        return value
    given: Any = value
    if isinstance(given, bool) or not isinstance(given, Complex):
        raise InputError(name, repr(value), "a number, a Parameter, a CoefficientFunction or a GridFunction")
    if not (complex_too or isinstance(value, Real)):
        raise InputError(name, value, "a real number")
    try:
        plain = complex(value)
    except OverflowError:  # a whole number of hundreds of digits
        raise InputError(name, "a number with too many digits", wanted) from None
    if not np.isfinite(plain) or not fits(plain.real):
        raise InputError(name, value, wanted)
    return value


def check_positive(value: Value, name: str, complex_too: bool = False) -> Value:
    """The value itself, or an `InputError` naming the parameter when it is a number that is not positive; see `check_parameter`."""
    return check_parameter(value, name, lambda number: number > 0, "a positive number", complex_too)
