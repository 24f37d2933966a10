"""Functions at quadrature points in pieces: blocks of variables, and parts that are derived by these and by parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import reduce
from operator import add
from typing import TypeAlias

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

Array = np.ndarray
Expressions: TypeAlias = list[CoefficientFunction]
Derivative: TypeAlias = Callable[[CoefficientFunction], CoefficientFunction]


class QuadratureBlock:
    """Variables at quadrature points that go together: values, their change, and their weights; each (size, points).

    variable   the values, to be derived by
    perturbed      values + s change, s a number that is zero: derived by it, a function of them is derived along the change
    """

    def __init__(self, space: ngs.FESpace, size: int, s: ngs.Parameter) -> None:
        self.value, self.change, self.weight = (ngs.GridFunction(ngs.VectorValued(space, size)) for _ in range(3))
        self.size = size
        self.variable = entries(self.value).MakeVariable()
        self.perturbed = entries(self.value) + s * entries(self.change)


@dataclass(frozen=True)
class QuadratureFunction:
    """A function of the variables and its derivatives by the parameters, or those of `made`, the only place that they are in.

    What has parameters in few places, and much else, is derived by them through these places alone.
    """

    value: CoefficientFunction
    slopes: Expressions = field(default_factory=list)
    made: CoefficientFunction | None = None

    @property
    def parameter_derivatives(self) -> Expressions:
        """Derivatives by each parameter's value."""
        if self.made is None:
            return self.slopes
        by_made = self.value.Diff(self.made)
        return [contract(by_made, slope) for slope in self.slopes]

    def directional_derivative(self, s: ngs.Parameter, ways: Expressions) -> CoefficientFunction:
        """Its change with s, and with parameters along their ways unless s moves them."""
        moved = self.value.Diff(s)
        if not self.slopes:
            return moved
        change = reduce(add, (slope * way for slope, way in zip(self.slopes, ways, strict=True)))
        return moved + (change if self.made is None else contract(self.value.Diff(self.made), change))

    def apply(self, operator: Derivative) -> QuadratureFunction:
        """A linear operator of it that has no parameters."""
        slopes = self.slopes if self.made is not None else [operator(slope) for slope in self.slopes]
        return QuadratureFunction(operator(self.value), slopes, self.made)


def set_rows(blocks: Iterable[QuadratureBlock], what: str, rows: Array) -> None:
    """Set `value`, `change` or `weight` of some blocks, one after the other."""
    end = 0
    for block in blocks:
        unknowns(getattr(block, what))[:] = rows[end : end + block.size].ravel()
        end += block.size


def weighted_functions(
    blocks: Iterable[QuadratureBlock], functions: Iterable[QuadratureFunction]
) -> list[QuadratureFunction]:
    """Functions times the weights of their blocks."""

    def by(block: QuadratureBlock) -> Derivative:
        return lambda function: ngs.InnerProduct(entries(block.weight), function)

    return [f.apply(by(b)) for b, f in zip(blocks, functions, strict=True)]


def contract(by: CoefficientFunction, change: CoefficientFunction) -> CoefficientFunction:
    """A derivative by all entries, along a change of them."""
    if by.dim == change.dim:
        return ngs.InnerProduct(by.Reshape((change.dim,)), change)
    return by.Reshape((by.dim // change.dim, change.dim)) * change


def entries(field: ngs.GridFunction) -> CoefficientFunction:
    """The components of a field with a space of its own for each."""
    return ngs.CF(tuple(field[i] for i in range(field.dim)))


def unknowns(of: ngs.GridFunction | ngs.LinearForm) -> Array:
    """Its unknowns, to be written into."""
    return of.vec.FV().NumPy()
