"""What is looked for: fields of a model in variables that can take any value, nodal or one for each label.

A field θ > floor is looked for by x = ln(θ - floor): no step can make a modulus negative. A map from fewer values (labels)
to a field's unknowns is a sparse matrix.
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

Array = np.ndarray


class Transform(Protocol):
    """θ = value(x), elementwise and monotone."""

    def value(self, x: Array) -> Array:
        """θ."""

    def gradient(self, x: Array) -> Array:
        """dθ/dx."""

    def curvature(self, x: Array) -> Array:
        """d²θ/dx²."""

    def inverse(self, theta: Array) -> Array:
        """x; `InputError` for a value that θ cannot take."""


@dataclass(frozen=True)
class LogTransform:
    """θ = floor + e^x: for moduli, and for ζ > -3/4 and φ > -1.

    >>> float(LogTransform(-1.0).value(LogTransform(-1.0).inverse(np.array([0.25])))[0])
    0.25
    """

    floor: float = 0.0

    def value(self, x: Array) -> Array:
        """θ."""
        return self.floor + np.exp(x)

    def function(self, x: CoefficientFunction) -> CoefficientFunction:
        """The same of a field, in integrals."""
        return self.floor + ngs.exp(x)

    def gradient(self, x: Array) -> Array:
        """dθ/dx."""
        return np.exp(x)

    def curvature(self, x: Array) -> Array:
        """d²θ/dx²."""
        return np.exp(x)

    def inverse(self, theta: Array) -> Array:
        """x; `InputError` at the floor or below."""
        if not np.all(np.asarray(theta) > self.floor):
            raise InputError("start", float(np.min(theta)), f"values above {self.floor:g}")
        return np.log(theta - self.floor)


@dataclass(frozen=True)
class BoundedTransform:
    """θ = low + (high - low)/(1 + e^-x): between two bounds.

    >>> float(BoundedTransform(1.0, 3.0).value(np.zeros(1))[0])
    2.0
    """

    low: float
    high: float

    def value(self, x: Array) -> Array:
        """θ."""
        return self.low + (self.high - self.low) / (1 + np.exp(-x))

    def function(self, x: CoefficientFunction) -> CoefficientFunction:
        """The same of a field, in integrals."""
        return self.low + (self.high - self.low) / (1 + ngs.exp(-x))

    def gradient(self, x: Array) -> Array:
        """dθ/dx."""
        part = 1 / (1 + np.exp(-x))
        return (self.high - self.low) * part * (1 - part)

    def curvature(self, x: Array) -> Array:
        """d²θ/dx²."""
        part = 1 / (1 + np.exp(-x))
        return (self.high - self.low) * part * (1 - part) * (1 - 2 * part)

    def inverse(self, theta: Array) -> Array:
        """x; `InputError` on a bound or beyond."""
        theta = np.asarray(theta)
        if not np.all((theta > self.low) & (theta < self.high)):
            raise InputError("start", float(np.max(theta)), f"values between {self.low:g} and {self.high:g}")
        return np.log((theta - self.low) / (self.high - theta))


@dataclass(frozen=True)
class ScaledTransform:
    """θ = scale x: for what may take either sign, such as displacements (m)."""

    scale: Array | float = 1.0

    def value(self, x: Array) -> Array:
        """θ."""
        return self.scale * x

    def gradient(self, x: Array) -> Array:
        """dθ/dx."""
        return self.scale * np.ones_like(x)

    def curvature(self, x: Array) -> Array:
        """d²θ/dx²."""
        return np.zeros_like(x)

    def inverse(self, theta: Array) -> Array:
        """x."""
        return theta / self.scale


@dataclass(frozen=True)
class Unknown:
    """A field that is looked for.

    start      where the search begins, and what regularisers draw it to: a number, or a value for each that is looked for
    transform  the change of variable
    basis      (unknowns of the field, k) sparse: the k values looked for → the field; None: each of its own
    """

    start: Array | float
    transform: Transform = LogTransform()
    basis: sp.csr_array | None = None


class ParameterFields:
    """x ↦ θ for some blocks of θ; the others keep what they are.

    theta      θ (size,) with values of all blocks
    blocks     name → where in θ
    unknowns   name → Unknown

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
        """A direction of x along which data tell next to nothing: steps in the plane leave out what lies along it."""

    def theta(self, x: Array) -> Array:
        """θ(x)."""
        theta = self._theta.copy()
        for name, unknown in self.unknowns.items():
            value = unknown.transform.value(x[self.blocks[name]])
            theta[self._where[name]] = value if unknown.basis is None else unknown.basis @ value
        return theta

    def jacobian(self, x: Array) -> sp.csr_array:
        """∂θ/∂x."""
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
        """Σ_i slope_i (∂²θ_i/∂x²) δx."""
        found = np.zeros(len(x))
        for name, unknown in self.unknowns.items():
            block, part = self.blocks[name], slope[self._where[name]]
            if unknown.basis is not None:
                part = unknown.basis.T @ part
            found[block] = part * unknown.transform.curvature(x[block]) * direction[block]
        return found

    def values(self, x: Array) -> dict[str, Array]:
        """Name → the field's unknowns in θ."""
        theta = self.theta(x)
        return {name: theta[self._where[name]] for name in self.unknowns}
