"""What a material is: an energy density, nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeAlias, cast, runtime_checkable

from ngsolve import CoefficientFunction

from ngbrain.errors import InputError

Value: TypeAlias = float | CoefficientFunction
"""A parameter: a number, a `Parameter`, a CoefficientFunction or a GridFunction."""


@runtime_checkable
class Law(Protocol):
    """An elastic law: any object with this one method can be used wherever the package takes a law."""

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Energy density W(C) in Pa of the right Cauchy-Green tensor (the isochoric C̄ where the model splits)."""


class Addable:
    """Gives a law the `+` that makes a `Sum`."""

    def __add__(self, other: Law) -> Sum:
        parts: list[Law] = []
        for law in (cast(Law, self), other):
            parts += law.parts if isinstance(law, Sum) else (law,)
        return Sum(tuple(parts))


@dataclass(frozen=True)
class Sum(Addable):
    """W = Σ W_i, made by `law + law`."""

    parts: tuple[Law, ...]

    def energy(self, C: CoefficientFunction) -> CoefficientFunction:
        """Sum of the parts' energies (Pa)."""
        first, *rest = (part.energy(C) for part in self.parts)
        return sum(rest, first)


def positive(value: Value, name: str) -> Value:
    """The value itself, or an `InputError` naming the parameter when it is a number that is not positive."""
    if isinstance(value, (int, float)) and not value > 0:
        raise InputError(name, value, "a positive number")
    return value
