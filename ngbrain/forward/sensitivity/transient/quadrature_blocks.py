"""Variables and functions at quadrature points, and their derivatives with respect to variables and parameters."""

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
    """Variables at quadrature points: values, their change, and weights, each (size, points).

    Parameters
    ----------
    space : FESpace
        Scalar space with one degree of freedom a quadrature point.
    size : int
        Variables at each point.
    s : Parameter
        Number that is zero; the derivative with respect to it is the one along the change.

    Attributes
    ----------
    variable : CoefficientFunction
        The values, to differentiate with respect to.
    perturbed : CoefficientFunction
        Values + s change.
    """

    def __init__(self, space: ngs.FESpace, size: int, s: ngs.Parameter) -> None:
        self.value, self.change, self.weight = (ngs.GridFunction(ngs.VectorValued(space, size)) for _ in range(3))
        self.size = size
        self.variable = entries(self.value).MakeVariable()
        self.perturbed = entries(self.value) + s * entries(self.change)


@dataclass(frozen=True)
class QuadratureFunction:
    """A function of the variables, with derivatives with respect to the parameters.

    Where parameters enter only through a few coefficients `coefficients`, derivatives are taken through these.

    Parameters
    ----------
    value : CoefficientFunction
        The function.
    slopes : list of CoefficientFunction
        Derivatives with respect to each parameter, of the function or of `coefficients`.
    coefficients : CoefficientFunction, optional
        The coefficients, a variable.
    """

    value: CoefficientFunction
    slopes: Expressions = field(default_factory=list)
    coefficients: CoefficientFunction | None = None

    @property
    def parameter_derivatives(self) -> Expressions:
        """Derivatives with respect to each parameter."""
        if self.coefficients is None:
            return self.slopes
        by_coefficients = self.value.Diff(self.coefficients)
        return [contract(by_coefficients, slope) for slope in self.slopes]

    def directional_derivative(self, s: ngs.Parameter, ways: Expressions) -> CoefficientFunction:
        """Derivative with respect to s plus that along a direction of the parameters, unless s moves these.

        Parameters
        ----------
        s : Parameter
            Number that perturbs the variables.
        ways : list of CoefficientFunction
            Change of each parameter.

        Returns
        -------
        CoefficientFunction
        """
        change_by_s = self.value.Diff(s)
        if not self.slopes:
            return change_by_s
        change = reduce(add, (slope * way for slope, way in zip(self.slopes, ways, strict=True)))
        return change_by_s + (
            change if self.coefficients is None else contract(self.value.Diff(self.coefficients), change)
        )

    def apply(self, operator: Derivative) -> QuadratureFunction:
        """The function after a linear operator without parameters."""
        slopes = self.slopes if self.coefficients is not None else [operator(slope) for slope in self.slopes]
        return QuadratureFunction(operator(self.value), slopes, self.coefficients)


def set_rows(blocks: Iterable[QuadratureBlock], what: str, rows: Array) -> None:
    """Set the arrays of consecutive blocks.

    Parameters
    ----------
    blocks : iterable of QuadratureBlock
        The blocks.
    what : str
        "value", "change" or "weight".
    rows : array (sizes, points)
        The numbers, block after block.
    """
    end = 0
    for block in blocks:
        unknowns(getattr(block, what))[:] = rows[end : end + block.size].ravel()
        end += block.size


def weighted_functions(
    blocks: Iterable[QuadratureBlock], functions: Iterable[QuadratureFunction]
) -> list[QuadratureFunction]:
    """Functions multiplied by the weights of their blocks.

    Parameters
    ----------
    blocks : iterable of QuadratureBlock
        The blocks.
    functions : iterable of QuadratureFunction
        One for each block.

    Returns
    -------
    list of QuadratureFunction
        Scalar functions.
    """

    def by(block: QuadratureBlock) -> Derivative:
        return lambda function: ngs.InnerProduct(entries(block.weight), function)

    return [f.apply(by(b)) for b, f in zip(blocks, functions, strict=True)]


def contract(by: CoefficientFunction, change: CoefficientFunction) -> CoefficientFunction:
    """Derivative with respect to all entries, contracted with a change of the entries.

    Parameters
    ----------
    by : CoefficientFunction
        Derivatives with respect to the entries.
    change : CoefficientFunction
        Change of the entries.

    Returns
    -------
    CoefficientFunction
    """
    if by.dim == change.dim:
        return ngs.InnerProduct(by.Reshape((change.dim,)), change)
    return by.Reshape((by.dim // change.dim, change.dim)) * change


def entries(field: ngs.GridFunction) -> CoefficientFunction:
    """Components of a field as a CoefficientFunction."""
    return ngs.CF(tuple(field[i] for i in range(field.dim)))


def unknowns(of: ngs.GridFunction | ngs.LinearForm) -> Array:
    """Degrees of freedom, as a writable view."""
    return of.vec.FV().NumPy()
