"""Evaluation of CoefficientFunctions at many points at once, from arrays to arrays, with or without a mesh."""

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
"""A shear of practically zero: NGSolve drops terms multiplied by an exact 0 before they are differentiated."""
AT_ONCE = 16
"""Number of points of one element that NGSolve evaluates together. It numbers further points from 0 again. Fields
at quadrature points identify a point by its number in its element, so they would be read at wrong points.
"""
_CONSTANT = re.compile(r"(ZeroCF|Identity matrix|[-+]?[\d.]+(e[-+]?\d+)?\s*$)")
"""Names of numbers in NGSolve's printed expression steps."""


class Points:
    """n points that hold fields given as arrays (components, n).

    Parameters
    ----------
    space : ngs.FESpace
        Scalar space with one unknown per point.
    mapped : numpy.ndarray
        The points, mapped for evaluation.

    Examples
    --------
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
        """Points without position, for laws whose parameters are numbers or `Parameter`s."""
        space, mapped = _line(1 << max(n - 1, 0).bit_length())
        return cls(space, mapped[:n])

    def field(self, values: np.ndarray) -> ngs.GridFunction:
        """A vector field with these values (components, n); `put` changes them."""
        field = ngs.GridFunction(ngs.VectorValued(self.space, len(values)))
        self.put(field, values)
        return field

    def put(self, field: ngs.GridFunction, values: np.ndarray) -> None:
        """Set the values of a field.

        Parameters
        ----------
        field : ngs.GridFunction
            A field made by `field`.
        values : numpy.ndarray of shape (components, n)
            New values.
        """
        field.vec.FV().NumPy().reshape(len(values), -1)[:, : len(self.mapped)] = values

    def share_element(self, numbers: np.ndarray, some: np.ndarray) -> np.ndarray:
        """Which points lie in an element that contains at least one of the selected points.

        Parameters
        ----------
        numbers : numpy.ndarray
            Numbers of the points.
        some : numpy.ndarray
            Mask over `numbers` of the selected points.

        Returns
        -------
        numpy.ndarray
            Mask over `numbers` of the points in the same elements as selected ones.
        """
        element = self.mapped["nr"][numbers]
        busy = np.zeros(element.max(initial=-1) + 1, bool)
        busy[element[some]] = True
        return busy[element]

    def __call__(self, function: CoefficientFunction, where: np.ndarray | slice = EVERYWHERE) -> np.ndarray:
        """Values (components, n) of a function, tensors by rows; or those at some points.

        Such points must be all points of their elements (`share_element`), as fields identify a point by its number
        in its element.
        """
        if self._crowded:
            field = ngs.GridFunction(self.space if function.dim == 1 else ngs.VectorValued(self.space, function.dim))
            field.Interpolate(function)
            return np.array(field.vec.FV().NumPy().reshape(function.dim, -1)[:, where])
        return np.ascontiguousarray(evaluate_at_points(function, self.mapped[where]).T)


def evaluate_at_points(function: CoefficientFunction, mapped: np.ndarray) -> np.ndarray:
    """Values of a function at points of elements of one shape.

    Every element is present with all of its points, at most `AT_ONCE`. NGSolve gives every thread an equal share of
    the points. A share that began inside an element would read the values of other points, as fields identify a
    point by its number in its element. So the last element is repeated until no share does.

    Parameters
    ----------
    function : CoefficientFunction
        Function to evaluate.
    mapped : numpy.ndarray
        Mapped points, element by element.

    Returns
    -------
    numpy.ndarray of shape (n, components)
        Values, tensors by rows.
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
    """The value of a number, a `Parameter` or an expression of these."""
    return float(Points.line(1)(value)[0, 0]) if isinstance(value, CoefficientFunction) else float(value)


def initial_modulus(law: Law) -> Value:
    """Initial shear modulus (Pa) of an isotropic law, ∂²W/∂γ² in simple shear γ; a field where the law varies in space.

    >>> from ngbrain.materials import Ogden
    >>> initial_modulus(Ogden(mu=[1000.0, 200.0], alpha=[-20.0, 2.0]))
    1200.00000...
    """
    F, shear = _sheared()
    curvature = density(law, Deformation.from_gradient(F)).Diff(shear).Diff(shear)
    return curvature.Compile() if varies(law) else float(Points.line(1)(curvature)[0, 0])


def varies(law: Law) -> bool:
    """Whether the energy of a law contains anything but numbers: fields, `Parameter`s or coordinates.

    >>> from ngbrain.materials import Demiray
    >>> varies(Demiray(1e3, 2.0)), varies(Demiray(1e3, ngs.Parameter(2.0)))
    (False, True)
    """
    lines = str(density(law, Deformation.from_gradient(_sheared()[0])).Compile()).strip().splitlines()
    begins = [a for a, b in pairwise([*lines, ""]) if a.startswith("Step") and "input:" not in b]
    return not all(_CONSTANT.match(begin.partition(": ")[2]) for begin in begins)


def _sheared() -> tuple[CoefficientFunction, CoefficientFunction]:
    """F of simple shear, and the shear, which is practically zero."""
    shear = ngs.CF(TINY).MakeVariable()
    return tensor(1, shear, 0, 0, 1, 0, 0, 0, 1), shear


def isotropic(law: Law) -> bool:
    """Whether the energy of a law is unchanged by a rotation of the reference configuration.

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
