"""Arrays in, arrays out: CoefficientFunctions evaluated at many points at once, with or without a mesh of the user's."""

from __future__ import annotations

import re
from functools import lru_cache
from itertools import pairwise

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction
from ngsolve.meshes import Make1DMesh

from ngbrain.materials.base import Deformation, Law, Value, density
from ngbrain.tensors import tensor

EVERYWHERE = slice(None)
TINY = 1e-30
"""A shear that is nothing: of 0 itself NGSolve leaves out what is multiplied by it, before anything is differentiated."""
AT_ONCE = 16
"""Points of one element that NGSolve evaluates a function at together. It counts those beyond from 0 again, and as fields at
quadrature points know a point by its number in its element, they are then read where others' values, or none, are."""
_CONSTANT = re.compile(r"(ZeroCF|Identity matrix|[-+]?[\d.]+(e[-+]?\d+)?\s*$)")
"""What numbers are called in NGSolve's steps of an expression."""


class Points:
    """n points that hold fields given as arrays (components, n).

    space   scalar space with one unknown for each point
    mapped  the points, for evaluation

    >>> points = Points.line(3)
    >>> x = points.field(np.array([[1.0, 2.0, 3.0]]))
    >>> points(x[0] * x[0])
    array([[1., 4., 9.]])
    """

    def __init__(self, space: ngs.FESpace, mapped: np.ndarray) -> None:
        self.space, self.mapped = space, mapped
        self._crowded = bool(np.bincount(mapped["nr"]).max(initial=0) > AT_ONCE)

    @classmethod
    def line(cls, n: int) -> Points:
        """Points without a place, for laws whose parameters are numbers or `Parameter`s."""
        space, mapped = _line(1 << max(n - 1, 0).bit_length())
        return cls(space, mapped[:n])

    def field(self, values: np.ndarray) -> ngs.GridFunction:
        """A vector field with these values (components, n); `put` changes them."""
        field = ngs.GridFunction(ngs.VectorValued(self.space, len(values)))
        self.put(field, values)
        return field

    def put(self, field: ngs.GridFunction, values: np.ndarray) -> None:
        """Set the values (components, n) of a `field`."""
        field.vec.FV().NumPy().reshape(len(values), -1)[:, : len(self.mapped)] = values

    def share_element(self, numbers: np.ndarray, some: np.ndarray) -> np.ndarray:
        """Which points, of these numbers, are in an element with some of them (both masks)."""
        element = self.mapped["nr"][numbers]
        busy = np.zeros(element.max(initial=-1) + 1, bool)
        busy[element[some]] = True
        return busy[element]

    def __call__(self, function: CoefficientFunction, where: np.ndarray | slice = EVERYWHERE) -> np.ndarray:
        """Its values (components, n), tensors by rows; or those at some points, all of their elements (`beside`): fields know
        a point by its place in its element.
        """
        if self._crowded:
            field = ngs.GridFunction(self.space if function.dim == 1 else ngs.VectorValued(self.space, function.dim))
            field.Interpolate(function)
            return np.array(field.vec.FV().NumPy().reshape(function.dim, -1)[:, where])
        return np.ascontiguousarray(evaluate_at_points(function, self.mapped[where]).T)


def evaluate_at_points(function: CoefficientFunction, mapped: np.ndarray) -> np.ndarray:
    """Values (n, components) at the points of elements of one shape, each with all of its points, `AT_ONCE` at most.

    NGSolve gives every thread an equal share of the points, and fields at quadrature points know a point by its place in its
    element: a share that began inside one would read others' values. So the last element is repeated until shares are whole.
    """
    n = len(mapped)
    if n == 0 or ngs.ngsglobals.numthreads == 1:
        return np.asarray(function(mapped)).reshape(n, function.dim)
    size = int(np.argmax(mapped["nr"] != mapped["nr"][0])) or n
    missing = -(n // size) % ngs.ngsglobals.numthreads
    whole = np.concatenate([mapped, *[mapped[-size:]] * missing])
    return np.asarray(function(whole)).reshape(len(whole), -1)[:n]


@lru_cache(maxsize=16)
def _line(n: int) -> tuple[ngs.FESpace, np.ndarray]:
    mesh = Make1DMesh(n)
    middle = ngs.IntegrationRule([(0.5,)], [1.0])
    return ngs.L2(mesh, order=0), mesh.MapToAllElements(middle, ngs.VOL)


def number(value: Value) -> float:
    """What a number, a `Parameter` or an expression of these holds."""
    return float(Points.line(1)(value)[0, 0]) if isinstance(value, CoefficientFunction) else float(value)


def initial_modulus(law: Law) -> Value:
    """Shear modulus (Pa) of an isotropic law at rest, ∂²W/∂γ² in simple shear γ; it may depend on place.

    >>> from ngbrain.materials import Ogden
    >>> initial_modulus(Ogden(mu=[1000.0, 200.0], alpha=[-20.0, 2.0]))
    1200.00000...
    """
    F, shear = _sheared()
    curvature = density(law, Deformation.from_gradient(F)).Diff(shear).Diff(shear)
    return curvature.Compile() if varies(law) else float(Points.line(1)(curvature)[0, 0])


def varies(law: Law) -> bool:
    """Whether the energy of a law has anything but numbers in it: fields, `Parameter`s, places; whatever the law is made of.

    >>> from ngbrain.materials import Demiray
    >>> varies(Demiray(1e3, 2.0)), varies(Demiray(1e3, ngs.Parameter(2.0)))
    (False, True)
    """
    lines = str(density(law, Deformation.from_gradient(_sheared()[0])).Compile()).strip().splitlines()
    begins = [a for a, b in pairwise([*lines, ""]) if a.startswith("Step") and "input:" not in b]
    return not all(_CONSTANT.match(begin.partition(": ")[2]) for begin in begins)


def _sheared() -> tuple[CoefficientFunction, CoefficientFunction]:
    """F of simple shear, and the shear, which is nothing."""
    shear = ngs.CF(TINY).MakeVariable()
    return tensor(1, shear, 0, 0, 1, 0, 0, 0, 1), shear


def isotropic(law: Law) -> bool:
    """Whether a law has the same energy for a shape and the shape turned.

    >>> from ngbrain.materials import Guccione, NeoHooke
    >>> isotropic(NeoHooke(1.0)), isotropic(Guccione(1.0, 8.0, 2.0, 4.0, (1, 0, 0)))
    (True, False)
    """
    turn, _ = np.linalg.qr(np.array([[2.0, 1.0, 0.0], [1.0, -1.0, 3.0], [0.5, 2.0, 1.0]]))
    stretch = np.diag([1.1, 1.0, 1 / 1.1])
    points = Points.line(2)
    C = points.field(np.array([stretch.ravel(), (turn @ stretch @ turn.T).ravel()]).T)
    plain, turned = points(density(law, Deformation.from_stretch(ngs.CF(tuple(C[i] for i in range(9)), dims=(3, 3)))))[
        0
    ]
    return bool(abs(turned - plain) <= 1e-8 * (abs(plain) + abs(turned)))
