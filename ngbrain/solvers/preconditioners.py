"""Preconditioners of the iterative solvers: BDDC, multigrid, and block-diagonal ones for mixed forms.

Call each function before the form's first assembly. It returns what makes the preconditioner after every assembly.
"""

from __future__ import annotations

from collections.abc import Callable

import ngsolve as ngs
import numpy as np

from ngbrain.errors import Breakdown
from ngbrain.solvers.condensed import Array, Core, free
from ngbrain.solvers.multigrid import Cycle, Patches

Maker = Callable[[], Core]


def multigrid(form: ngs.BilinearForm) -> Maker:
    """Multigrid on the displacements, which come first in a mixed form."""
    mixed = form.space.type != "VectorH1"
    patches: list[Patches] = []

    def make() -> Core:
        if not patches:
            patches.append(Patches(form.space.components[0] if mixed else form.space, free(form)))
        try:
            return Cycle(form.mat, patches[0])
        except Exception as error:  # NGSolve and pyamg raise exceptions of different kinds
            raise Breakdown(f"multigrid cannot be set up: {error}") from error

    return make


def bddc(form: ngs.BilinearForm) -> Maker:
    """BDDC of a form, with a direct solve of the wirebasket."""
    operator = ngs.Preconditioner(form, "bddc")
    return lambda: _array(operator, free(form))


def elastic_bddc(space: ngs.FESpace, modulus: ngs.CoefficientFunction | float, condense: bool) -> Maker:
    """BDDC of ∫ 2μ ε(u):ε(v), for the displacement block of a mixed form at any state.

    Parameters
    ----------
    space : FESpace
        Displacements.
    modulus : CoefficientFunction or float
        Shear modulus μ (Pa).
    condense : bool
        Whether static condensation is used.

    Returns
    -------
    callable
        Gives the preconditioner.
    """
    u, v = space.TnT()
    form = ngs.BilinearForm(space, symmetric=True, condense=condense)
    form += 2 * modulus * ngs.InnerProduct(ngs.Sym(ngs.Grad(u)), ngs.Sym(ngs.Grad(v))) * ngs.dx
    return _once(form, bddc(form))


def mass(space: ngs.FESpace, modulus: ngs.CoefficientFunction | float, condense: bool) -> Maker:
    """Inverse of ∫ pq/μ, for the pressure block.

    Parameters
    ----------
    space : FESpace
        Pressures.
    modulus : CoefficientFunction or float
        Shear modulus μ (Pa).
    condense : bool
        Whether static condensation is used.

    Returns
    -------
    callable
        Gives the preconditioner.
    """
    p, q = space.TnT()
    form = ngs.BilinearForm(space, symmetric=True, condense=condense)
    form += p * q / modulus * ngs.dx
    unknown = free(form)
    return _once(form, lambda: _array(form.mat.Inverse(space.FreeDofs(condense), inverse="sparsecholesky"), unknown))


def diagonal(displacement: Maker, pressure: Maker, fields: list[slice]) -> Maker:
    """Block-diagonal preconditioner.

    Parameters
    ----------
    displacement, pressure : callable
        Give the preconditioners of the two blocks.
    fields : list of slice
        Degrees of freedom of the two blocks.

    Returns
    -------
    callable
        Gives the preconditioner.
    """
    first, second = fields

    def make() -> Core:
        above, below = displacement(), pressure()

        def apply(r: Array) -> Array:
            return np.concatenate([above(r[first]), below(r[second])])

        return apply

    return make


def _once(form: ngs.BilinearForm, make: Maker) -> Maker:
    """Assemble the form and make its preconditioner at the first call only."""
    made: list[Core] = []

    def again() -> Core:
        if not made:
            form.Assemble()
            made.append(make())
        return made[0]

    return again


def _array(operator: ngs.BaseMatrix, unknown: Array) -> Core:
    right, left = operator.CreateColVector(), operator.CreateRowVector()

    def apply(r: Array) -> Array:
        right.FV().NumPy()[:] = r
        left.data = operator * right
        return left.FV().NumPy() * unknown

    return apply
