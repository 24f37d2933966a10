"""Linear solvers by name for linearised statics, and the choice between them.

    sparsecholesky, umfpack, pardiso, mumps, cudss    direct, the last on a GPU
    cg-bddc, cg-amg           for positive definite matrices: a displacement form, or a discontinuous pressure condensed
    minres-bddc, minres-amg   for displacements with a continuous pressure, at any K/μ: the displacement block by BDDC or
                              multigrid, the pressure block by the mass matrix over μ, which the Schur complement is
                              equivalent to whatever K is

Source: Elman, Silvester, Wathen, Finite Elements and Fast Iterative Solvers (2014), section 4.2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import ngsolve as ngs
import numpy as np

from ngbrain.errors import Breakdown, InputError, nearest
from ngbrain.solvers import direct, krylov
from ngbrain.solvers import preconditioners as pre
from ngbrain.solvers.condensed import Condensed, Core, fields, free

Array = np.ndarray
Solve = Callable[[Array], Array]
"""r ↦ M⁻¹r, numpy arrays over all unknowns, zero where they are fixed."""
FormKind = Literal["displacement", "continuous pressure", "discontinuous pressure"]

NAMES = (*direct.NAMES, "cg-bddc", "cg-amg", "minres-bddc", "minres-amg")

DIRECT = direct.NAMES
RTOL = 1e-8
MAX_ITERATIONS = 500
"""Relative residual, in the preconditioner's norm, at which an iteration stops, and the iterations it may take."""


MIXED_ITERATIONS = 110.0
DIRECT_MOST = {2: 2_000_000, 3: 300_000}
"""Unknowns whose factor takes about 4 and 7 GiB."""


@dataclass(frozen=True)
class Choice:
    """The name of a solver, and in one line why."""

    name: str
    why: str


def choose(
    form_kind: FormKind, n_free: int, ratio: float, symmetric: bool = True, dim: int = 3, order: int = 2
) -> Choice:
    """The solver for a problem of `n_free` unknowns after condensation, with `ratio` the largest K/μ (inf allowed).

    Measured on one thread at order 2 in 3-D, 190 000 unknowns: a factor takes 103 s and 3.7 GiB (106 000: 22 s, 1.3 GiB),
    an iteration 0.32 s, and it takes about 5 + 3.2 √(K/μ) of them in a displacement form, 105 to 120 with a pressure. A
    factor serves several solves of Newton's method, counted as four. In 2-D, 390 000 unknowns: 4 s and 0.6 GiB.
    """
    if not symmetric:
        return Choice("umfpack", "the matrix is not symmetric, which only a factor with pivots is for")
    size = f"{n_free} unknowns in {dim}-D, K/μ {ratio:.2g}"
    if form_kind == "continuous pressure":
        name, needed = "minres-amg", MIXED_ITERATIONS
    elif order >= 4 and dim == 3 and 18 * math.sqrt(ratio) <= MAX_ITERATIONS:
        name, needed = "cg-bddc", max(20.0, 18 * math.sqrt(ratio))  # stars of order 4 take 13 kB an unknown
    else:
        name, needed = "cg-amg", 5 + 3.2 * math.sqrt(ratio)
    limit = DIRECT_MOST[dim]
    if dim == 3 and needed <= MAX_ITERATIONS:
        limit = min(limit, round(17_000 * math.sqrt(needed)))
    if n_free <= limit:
        return Choice("sparsecholesky", f"{size}: a factor for several solves is cheapest up to {limit}")
    if needed <= MAX_ITERATIONS:
        return Choice(name, f"{size}: about {needed:.0f} iterations are cheaper than a factor beyond {limit}")
    return Choice(
        "sparsecholesky", f"{size}: a factor of many GiB, as {name} does not converge; a continuous pressure would"
    )


@dataclass
class DirectSolver:
    """Solves with a factor; without the form (which may have been assembled again since), `core` is still good."""

    condensed: Condensed
    core: Core
    iterations: int = 1

    def __call__(self, r: Array) -> Array:
        """M⁻¹r."""
        return self.condensed.solve(self.core, r)


@dataclass
class KrylovSolver:
    """Solves to `rtol` in at most `max_iter` iterations, or raises FloatingPointError; `iterations` of the last solve."""

    name: str
    condensed: Condensed
    precondition: Core
    rtol: float = RTOL
    max_iter: int = MAX_ITERATIONS
    iterations: int = 0

    def __call__(self, r: Array) -> Array:
        """M⁻¹r."""
        return self.condensed.solve(self._core, r)

    def _core(self, r: Array) -> Array:
        method = krylov.cg if self.name.startswith("cg") else krylov.minres
        try:
            x, self.iterations = method(self.condensed.apply, self.precondition, r, self.rtol, self.max_iter)
        except FloatingPointError as error:
            raise Breakdown(f"{self.name}: {error}") from error
        return x


@dataclass
class ReusedFactorSolver:
    """Solves with a form's matrix by GMRES around an older factor; what it found first is kept for who asks again."""

    condensed: Condensed
    old: Core
    rtol: float
    max_iter: int
    iterations: int = 0
    residual: float = 0.0
    _scale: Array | None = None
    _last: tuple[Array, Array] | None = None

    def __call__(self, r: Array) -> Array:
        """M⁻¹r, nearly."""
        if self._last is None or not np.array_equal(self._last[0], r):
            self._last = r.copy(), self.condensed.solve(self._core, r)
        return self._last[1].copy()

    def _core(self, r: Array) -> Array:
        first = self.old(r)
        if self._scale is None:
            self._scale = np.ones(len(r))
            for field in self.condensed.fields:
                size = np.linalg.norm(first[field] * self.condensed.free[field])
                self._scale[field] = 1 / size if size > 0 else 1.0
        x, self.iterations, self.residual = krylov.gmres(
            self.condensed.apply, self.old, first, self._scale, self.rtol, self.max_iter
        )
        return x


def prepare(name: str, form: ngs.BilinearForm, modulus: ngs.CoefficientFunction | float = 1.0) -> Callable[[], Solve]:
    """What makes a solver for the form's matrix each time after it is assembled.

    To be called when the form's terms are added and before its first assembly, in which BDDC takes part.

    modulus  shear modulus (Pa), for the blocks of the mixed preconditioners

    Raises `InputError` for an unknown name or a form that it cannot be for, `MissingExtra` if a package is missing; what
    it returns raises FloatingPointError when a factorisation fails, as the solvers do when an iteration fails.
    """
    if name not in NAMES:
        raise InputError("solver", repr(name), nearest(name, NAMES))
    if name in direct.NAMES:
        direct.require_package(name)

        def factorised() -> Solve:
            condensed = Condensed(form)
            return DirectSolver(condensed, direct.factorise(name, condensed))

        return factorised
    block = _block(name, form, modulus)

    def iterative() -> Solve:
        return KrylovSolver(name, Condensed(form), block())

    return iterative


def reuse_factor(form: ngs.BilinearForm, old: Solve, r: Array, rtol: float = 1e-2, max_iter: int = 12) -> Solve | None:
    """Solver with the matrix of a new assembly by an older factor; None if that does not reach `rtol` for r.

    Later right-hand sides are solved as well as `max_iter` iterations can. Errors are measured as the old factor sees them,
    M₀⁻¹(r - Mx), each field by its own size, so that forces beside volumes do not matter.
    """
    if not isinstance(old, DirectSolver):
        return None
    solve = ReusedFactorSolver(Condensed(form), old.core, rtol, max_iter)
    solve(r)
    return solve if solve.residual <= rtol else None


def _block(name: str, form: ngs.BilinearForm, modulus: ngs.CoefficientFunction | float) -> Callable[[], Core]:
    """What makes the preconditioner of an iterative method after each assembly."""
    space, unknown, parts = form.space, free(form), fields(form.space)
    if name.startswith("cg"):
        if any(unknown[part].any() for part in parts[1:]):
            raise InputError("solver", repr(name), "minres-amg or a direct one: the pressure is not condensed")
        return pre.bddc(form) if name.endswith("bddc") else pre.multigrid(form)
    if len(parts) != 2 or not unknown[parts[1]].any():
        raise InputError("solver", repr(name), "cg-amg, cg-bddc or a direct one: there is no pressure to solve for")
    displacement = (
        pre.elastic_bddc(space.components[0], modulus, form.condense) if name.endswith("bddc") else pre.multigrid(form)
    )
    return pre.diagonal(displacement, pre.mass(space.components[1], modulus, form.condense), parts)
