"""Integrands of harmonic problems: differentiation, and products without complex conjugates."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import ngsolve as ngs
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError

Terms: TypeAlias = ngs.comp.SumOfIntegrals
Change: TypeAlias = Callable[[CoefficientFunction], CoefficientFunction]


def derivative(
    work: CoefficientFunction, variable: CoefficientFunction, direction: CoefficientFunction, name: str
) -> CoefficientFunction:
    """Directional derivative `work.Diff(variable, direction)`.

    NGSolve differentiates complex numbers and real constants, but not its own complex constants.

    Parameters
    ----------
    work, variable, direction : CoefficientFunction
    name : str
        Argument named in the message.

    Returns
    -------
    CoefficientFunction

    Raises
    ------
    InputError
        Where a complex constant is in `work`, such as ngs.CF(2000 + 800j).
    """
    try:
        return work.Diff(variable, direction)
    except Exception as error:  # NGSolve's exception class is not accessible in Python
        if "Diff not implemented" not in str(error):
            raise
        wanted = "what NGSolve can differentiate: a number such as 2000 + 800j, or parts of their own, CF(2000) + 1j * CF(800)"
        raise InputError(name, "made of a complex constant, ngs.CF of a complex number", wanted) from error


def vanishes(work: CoefficientFunction) -> bool:
    """Whether a derivative is identically zero."""
    return str(work).strip() == "ZeroCoefficientFunction"


def dot(a: CoefficientFunction, b: CoefficientFunction) -> CoefficientFunction:
    """Bilinear product a·b, without the complex conjugate of InnerProduct.

    Parameters
    ----------
    a, b : CoefficientFunction

    Returns
    -------
    CoefficientFunction
    """
    if a.dim == 1:
        return a * b
    first, *rest = (a[i] * b[i] for i in range(a.dim))
    return sum(rest, first)


def gradient(u: ngs.GridFunction) -> CoefficientFunction:
    """Gradient of given waves, one component per row; forms with it take half the time of forms with Grad(u)."""
    if not u.components:
        return ngs.grad(u)
    rows = tuple(ngs.grad(component) for component in u.components)
    return ngs.CF(rows, dims=(len(rows), len(rows)))


def same(work: CoefficientFunction) -> CoefficientFunction:
    """The integrand itself."""
    return work


def complex_space(space: ngs.FESpace) -> ngs.FESpace:
    """The complex version of a space, for forms with complex waves."""
    return type(space)(space.mesh, order=space.globalorder, complex=True)
