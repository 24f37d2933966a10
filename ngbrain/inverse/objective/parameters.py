"""Unknown fields of a model and their transforms to unconstrained variables.

A field θ > floor is represented by x = ln(θ - floor), so that no step makes a modulus negative. Fields may be nodal, or have
one value per label: a sparse matrix (`Unknown.basis`) maps the fewer values to the coefficients of the field.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.look import BriefText

Array = np.ndarray


class Transform(Protocol):
    """Elementwise, monotone transform θ = value(x)."""

    def value(self, x: Array) -> Array:
        """Parameter θ of the variable x."""

    def gradient(self, x: Array) -> Array:
        """First derivative dθ/dx."""

    def curvature(self, x: Array) -> Array:
        """Second derivative d²θ/dx²."""

    def inverse(self, theta: Array) -> Array:
        """Variable x of the parameter θ; `InputError` for a value that θ cannot take."""


@dataclass(frozen=True)
class LogTransform:
    """Logarithmic transform θ = floor + eˣ: for moduli, and for ζ > -3/4 and φ > -1.

    >>> float(LogTransform(-1.0).value(LogTransform(-1.0).inverse(np.array([0.25])))[0])
    0.25
    """

    floor: float = 0.0

    def value(self, x: Array) -> Array:
        """Parameter θ."""
        return self.floor + np.exp(x)

    def function(self, x: CoefficientFunction) -> CoefficientFunction:
        """Parameter θ as an NGSolve function of the field x, for use in integrals."""
        return self.floor + ngs.exp(x)

    def gradient(self, x: Array) -> Array:
        """First derivative dθ/dx."""
        return np.exp(x)

    def curvature(self, x: Array) -> Array:
        """Second derivative d²θ/dx²."""
        return np.exp(x)

    def inverse(self, theta: Array) -> Array:
        """Variable x; `InputError` at the floor or below."""
        if not np.all(np.asarray(theta) > self.floor):
            raise InputError("start", float(np.min(theta)), f"values above {self.floor:g}")
        return np.log(theta - self.floor)


@dataclass(frozen=True)
class BoundedTransform:
    """Logistic transform θ = low + (high - low)/(1 + e⁻ˣ) between two bounds.

    Parameters
    ----------
    low : float
        Lower bound.
    high : float
        Upper bound.

    Examples
    --------
    >>> float(BoundedTransform(1.0, 3.0).value(np.zeros(1))[0])
    2.0
    """

    low: float
    high: float

    def value(self, x: Array) -> Array:
        """Parameter θ."""
        return self.low + (self.high - self.low) / (1 + np.exp(-x))

    def function(self, x: CoefficientFunction) -> CoefficientFunction:
        """Parameter θ as an NGSolve function of the field x, for use in integrals."""
        return self.low + (self.high - self.low) / (1 + ngs.exp(-x))

    def gradient(self, x: Array) -> Array:
        """First derivative dθ/dx."""
        part = 1 / (1 + np.exp(-x))
        return (self.high - self.low) * part * (1 - part)

    def curvature(self, x: Array) -> Array:
        """Second derivative d²θ/dx²."""
        part = 1 / (1 + np.exp(-x))
        return (self.high - self.low) * part * (1 - part) * (1 - 2 * part)

    def inverse(self, theta: Array) -> Array:
        """Variable x; `InputError` on a bound or outside."""
        theta = np.asarray(theta)
        if not np.all((theta > self.low) & (theta < self.high)):
            raise InputError("start", float(np.max(theta)), f"values between {self.low:g} and {self.high:g}")
        return np.log((theta - self.low) / (self.high - theta))


@dataclass(frozen=True, repr=False)
class ScaledTransform(BriefText):
    """Linear transform θ = scale · x, for parameters of either sign such as displacements (m)."""

    scale: Array | float = 1.0

    def value(self, x: Array) -> Array:
        """Parameter θ."""
        return self.scale * x

    def gradient(self, x: Array) -> Array:
        """First derivative dθ/dx."""
        return self.scale * np.ones_like(x)

    def curvature(self, x: Array) -> Array:
        """Second derivative d²θ/dx², zero."""
        return np.zeros_like(x)

    def inverse(self, theta: Array) -> Array:
        """Variable x."""
        return theta / self.scale


@dataclass(frozen=True)
class Unknown:
    """An unknown field: initial guess, transform and basis.

    Parameters
    ----------
    start : array or float
        Initial guess, which is also the reference of the regularisers: a number, or one value per unknown.
    transform : Transform
        Change of variable.
    basis : sparse array (coefficients of the field, k), optional
        Map from the k unknown values to the coefficients of the field. By default every coefficient is unknown.
    """

    start: Array | float
    transform: Transform = LogTransform()
    basis: sp.csr_array | None = None


class ParameterFields:
    """Map x ↦ θ from the unconstrained unknowns of some blocks to all parameters; other blocks keep their values.

    Parameters
    ----------
    theta : array (size,)
        Parameters θ with values of all blocks.
    blocks : mapping of str to slice
        Name and place of each block in θ.
    unknowns : mapping of str to Unknown
        Blocks that are unknown.

    Attributes
    ----------
    start : array (n,)
        Initial guess x of all unknowns.
    blocks : dict of str to slice
        Name and place of each unknown block in x.
    undetermined_direction : array (n,), optional
        Direction of x that the data hardly determine. Gauss-Newton steps of plane problems have no component along it.

    Raises
    ------
    InputError
        If an unknown is not one of the blocks.

    Examples
    --------
    >>> fields = ParameterFields(np.array([1.0, 1.0, 5.0]), {"mu": slice(0, 2), "rest": slice(2, 3)}, {"mu": Unknown(2000.0)})
    >>> fields.theta(fields.start).round(9).tolist()
    [2000.0, 2000.0, 5.0]
    """

    def __init__(self, theta: Array, blocks: Mapping[str, slice], unknowns: Mapping[str, Unknown]) -> None:
        if missing := set(unknowns) - set(blocks):
            raise InputError("unknowns", ", ".join(sorted(missing)), "one of " + ", ".join(blocks))
        self._theta, self._where, self.unknowns = np.array(theta, float), dict(blocks), dict(unknowns)
        places: dict[str, slice] = {}
        starts, end = [], 0
        for name, unknown in self.unknowns.items():
            where = blocks[name]
            size = where.stop - where.start if unknown.basis is None else unknown.basis.shape[1]
            starts.append(np.broadcast_to(unknown.transform.inverse(np.asarray(unknown.start, float)), (size,)))
            places[name] = slice(end, end + size)
            end += size
        self.start, self.blocks = np.concatenate(starts), places
        self.undetermined_direction: Array | None = None
        """Direction of x that the data hardly determine; steps of plane problems have no component along it."""

    def theta(self, x: Array) -> Array:
        """Parameters θ(x), all blocks."""
        theta = self._theta.copy()
        for name, unknown in self.unknowns.items():
            value = unknown.transform.value(x[self.blocks[name]])
            theta[self._where[name]] = value if unknown.basis is None else unknown.basis @ value
        return theta

    def jacobian(self, x: Array) -> sp.csr_array:
        """Jacobian ∂θ/∂x (size of θ, n), sparse."""
        rows, columns, values = [], [], []
        for name, unknown in self.unknowns.items():
            part = sp.diags_array(unknown.transform.gradient(x[self.blocks[name]]))
            part = sp.coo_array(part if unknown.basis is None else unknown.basis @ part)
            rows.append(part.coords[0] + self._where[name].start)
            columns.append(part.coords[1] + self.blocks[name].start)
            values.append(part.data)
        at = np.concatenate(rows), np.concatenate(columns)
        return sp.coo_array((np.concatenate(values), at), shape=(len(self._theta), len(x))).tocsr()

    def curvature_product(self, x: Array, slope: Array, direction: Array) -> Array:
        """Second-derivative product Σᵢ slopeᵢ (∂²θᵢ/∂x²) δx.

        Parameters
        ----------
        x : array (n,)
            Unknowns.
        slope : array (size,)
            Derivative of a functional with respect to θ.
        direction : array (n,)
            Direction δx.

        Returns
        -------
        array (n,)
            The product.
        """
        product = np.zeros(len(x))
        for name, unknown in self.unknowns.items():
            block, part = self.blocks[name], slope[self._where[name]]
            if unknown.basis is not None:
                part = unknown.basis.T @ part
            product[block] = part * unknown.transform.curvature(x[block]) * direction[block]
        return product

    def values(self, x: Array) -> dict[str, Array]:
        """Coefficients of each unknown field in θ, by name."""
        theta = self.theta(x)
        return {name: theta[self._where[name]] for name in self.unknowns}
