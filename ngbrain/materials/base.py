"""The interface of a material law: an energy density, from which all else is derived."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from numbers import Complex, Real
from typing import Any, Protocol, TypeAlias, cast, runtime_checkable

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.look import BriefText, NotebookCard
from ngbrain.tensors import isochoric, right_cauchy_green

Value: TypeAlias = float | CoefficientFunction
"""A material parameter: a number, an NGSolve `Parameter`, a CoefficientFunction or a GridFunction."""


@runtime_checkable
class Law(Protocol):
    """Interface of an elastic law: any object with this one method is accepted wherever the package takes a law.

    The argument is the isochoric right Cauchy-Green tensor C̄. A law that needs more of the deformation also
    defines `density(at)`, with a `Deformation` as its argument.
    """

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density W(C̄) in Pa."""


@dataclass(frozen=True)
class Deformation:
    """Deformation measures at a point, which a law may use. Tensors are 3×3.

    Parameters
    ----------
    shape : CoefficientFunction
        Isochoric right Cauchy-Green tensor C̄ = J^(-2/3) C.
    C : CoefficientFunction
        Right Cauchy-Green tensor C = FᵀF.
    J : CoefficientFunction
        Volume ratio J = det F.
    gradient : CoefficientFunction, optional
        Deformation gradient F; None where only C is known, as in a viscoelastic branch.

    Examples
    --------
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
        """All measures, from the deformation gradient F."""
        C = right_cauchy_green(F)
        return cls(isochoric(C), C, ngs.Det(F), F)

    @classmethod
    def from_stretch(cls, C: CoefficientFunction) -> Deformation:
        """A deformation without change of volume, of which only C is known."""
        return cls(C, C, ngs.CF(1.0))

    @property
    def F(self) -> CoefficientFunction:
        """The deformation gradient; raises `InputError` where only C is known, as in a viscoelastic branch."""
        if self.gradient is None:
            raise InputError("law", "a linear one, of the displacement gradient", "here one of C, such as SaintVenant")
        return self.gradient


def density(law: Law, at: Deformation) -> CoefficientFunction:
    """Energy density of a law at a deformation.

    The law's own `density` is used where it has one, else its `energy` of the isochoric C̄.

    Parameters
    ----------
    law : Law
        Law to evaluate.
    at : Deformation
        Deformation measures.

    Returns
    -------
    CoefficientFunction
        Energy density (Pa), one component.

    Raises
    ------
    InputError
        The object is no law, or its energy is no CoefficientFunction of one component.

    Examples
    --------
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
    """Energy density of an isotropic law at three principal logarithmic strains.

    A law may define `log_strain_energy`, which needs no eigenvalues; in a composite law each part uses its own.

    Parameters
    ----------
    law : Law
        Isotropic law.
    logs : sequence of CoefficientFunction
        The three ln λ_i, which add up to 0.

    Returns
    -------
    CoefficientFunction
        Energy density (Pa).

    Examples
    --------
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


class LawCard(BriefText, NotebookCard):
    """Representation of laws and viscoelastic materials: one line, a card with a plot in a notebook, and that plot."""

    PICTURE = "ngbrain.materials.lab.plot:plot_law"

    def summary(self) -> dict[str, str]:
        """Name, energy, parameters and shear modulus in words."""
        from ngbrain.materials.lab.description import law_rows  # it imports this module

        return law_rows(cast(Any, self))


class Addable(LawCard):
    """Adds the operator `+` to a law, whose result is a `Sum`, and gives it a card and a plot."""

    def __add__(self, other: Law) -> Sum:
        if not isinstance(other, Law):
            return NotImplemented
        parts: list[Law] = []
        for law in (cast(Law, self), other):
            parts += law.parts if isinstance(law, Sum) else (law,)
        return Sum(tuple(parts))


class Composite(Addable):
    """Base of laws made of other laws: `energy` follows from `density`."""

    def density(self, at: Deformation) -> CoefficientFunction:
        """Energy density (Pa)."""
        raise NotImplementedError

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density (Pa) at C = C̄, without change of volume."""
        return self.density(Deformation.from_stretch(C))


class TotalStretchLaw(Addable):
    """Base of laws of the total C, without the isochoric split.

    Laws with fibres need it: with the split, a dilatation would not stretch the fibres.
    """

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density (Pa) of the total C."""
        raise NotImplementedError

    def density(self, at: Deformation) -> CoefficientFunction:
        """Energy density (Pa)."""
        return self.energy(at.C)


@dataclass(frozen=True, repr=False)
class Sum(Composite):
    """Sum of laws, W = Σ W_i, made by `law + law`."""

    parts: tuple[Law, ...]

    def density(self, at: Deformation) -> CoefficientFunction:
        """Sum of the energy densities of the parts (Pa)."""
        first, *rest = (density(part, at) for part in self.parts)
        return sum(rest, first)

    def log_strain_energy(self, logs: Sequence[CoefficientFunction]) -> CoefficientFunction:
        """Energy density (Pa) at principal logarithmic strains, see `density_of_log_strains`."""
        first, *rest = (density_of_log_strains(part, logs) for part in self.parts)
        return sum(rest, first)


@dataclass(frozen=True, repr=False)
class Scaled(Composite):
    """A law times a factor, W = factor × W_law.

    Parameters
    ----------
    law : Law
        The law.
    factor : float or CoefficientFunction
        Dimensionless factor.
    """

    law: Law
    factor: Value

    def density(self, at: Deformation) -> CoefficientFunction:
        """Energy density (Pa)."""
        return self.factor * density(self.law, at)

    def log_strain_energy(self, logs: Sequence[CoefficientFunction]) -> CoefficientFunction:
        """Energy density (Pa) at principal logarithmic strains, see `density_of_log_strains`."""
        return self.factor * density_of_log_strains(self.law, logs)


def check_parameter(
    value: Value, name: str, fits: Callable[[float], bool], wanted: str, complex_too: bool = False
) -> Value:
    """Check a parameter of a law and return it unchanged.

    Parameters
    ----------
    value : float or CoefficientFunction
        A number is checked; of a function only the number of components is checked.
    name : str
        Name of the parameter, for messages.
    fits : callable
        Whether a number is admissible; of a complex modulus its real part is passed.
    wanted : str
        The admissible values in words, for messages.
    complex_too : bool, default False
        Whether complex values are admissible, as in linear laws of waves.

    Returns
    -------
    float or CoefficientFunction
        The value itself.

    Raises
    ------
    InputError
        The value is no number and no function of one component, is not finite, is complex where it must be real, or
        is not admissible.
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
    """Check that a parameter of a law is positive and return it unchanged; see `check_parameter`.

    Parameters
    ----------
    value : float or CoefficientFunction
        A number, or a function of one component, whose values are not checked.
    name : str
        Name of the parameter, for messages.
    complex_too : bool, default False
        Whether complex values are admissible; their real part is checked.

    Returns
    -------
    float or CoefficientFunction
        The value itself.

    Raises
    ------
    InputError
        A number that is not positive, or what `check_parameter` refuses.
    """
    return check_parameter(value, name, lambda number: number > 0, "a positive number", complex_too)
