"""Linear solvers for linearised static problems by name, and the choice between them.

    sparsecholesky, umfpack, pardiso, mumps, cudss    direct; the last one on a GPU
    cg-bddc, cg-amg           for positive definite matrices: displacement forms, or condensed discontinuous pressures
    minres-bddc, minres-amg   for displacements with continuous pressures, at any K/μ: BDDC or multigrid for the displacement
                              block, and the mass matrix over μ, spectrally equivalent to the Schur complement, for pressures

References
----------
Elman, Silvester, Wathen, Finite Elements and Fast Iterative Solvers (2014), section 4.2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import ngsolve as ngs
import numpy as np

from ngbrain.errors import Breakdown, InputError, nearest
from ngbrain.look import BriefText
from ngbrain.solvers import direct, krylov
from ngbrain.solvers import preconditioners as pre
from ngbrain.solvers.condensed import Condensed, Core, fields, free

Array = np.ndarray
Solve = Callable[[Array], Array]
"""r → M⁻¹ r, arrays over all degrees of freedom, zero where these are fixed."""
FormKind = Literal["displacement", "continuous pressure", "discontinuous pressure"]

NAMES = (*direct.NAMES, "cg-bddc", "cg-amg", "minres-bddc", "minres-amg")

DIRECT = direct.NAMES
RTOL = 1e-8
MAX_ITERATIONS = 500
"""Relative residual in the preconditioner's norm, and largest number of iterations."""


MIXED_ITERATIONS = 110.0
DIRECT_MOST = {2: 2_000_000, 3: 300_000}
"""Unknowns whose factorisation takes about 4 GiB (2-D) and 7 GiB (3-D)."""


@dataclass(frozen=True)
class Choice:
    """A chosen solver.

    Parameters
    ----------
    name : str
        Name of the solver.
    why : str
        The reason, in one line.
    """

    name: str
    why: str


def choose(
    form_kind: FormKind, n_free: int, ratio: float, symmetric: bool = True, dim: int = 3, order: int = 2
) -> Choice:
    """Choose the solver for a problem.

    Measured on one thread at order 2 in 3-D with 190 000 unknowns: a factorisation takes 103 s and 3.7 GiB (106 000: 22 s,
    1.3 GiB), an iteration 0.32 s. Iterations are about 5 + 3.2 √(K/μ) in a displacement form, and 105 to 120 with pressures.
    A factor serves several solves of Newton's method, counted as four. In 2-D, 390 000 unknowns take 4 s and 0.6 GiB.

    Parameters
    ----------
    form_kind : str
        "displacement", "continuous pressure" or "discontinuous pressure".
    n_free : int
        Unknowns after condensation.
    ratio : float
        Largest ratio K/μ of bulk to shear modulus; may be inf.
    symmetric : bool
        Whether the matrix is symmetric.
    dim : int
        Space dimension.
    order : int
        Polynomial order of the displacements.

    Returns
    -------
    Choice
    """
    if not symmetric:
        return Choice("umfpack", "the matrix is not symmetric, which needs a factorisation with pivoting")
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
        return Choice("sparsecholesky", f"{size}: one factorisation for several solves is cheapest up to {limit}")
    if needed <= MAX_ITERATIONS:
        return Choice(name, f"{size}: about {needed:.0f} iterations are cheaper than a factorisation beyond {limit}")
    return Choice(
        "sparsecholesky",
        f"{size}: a factorisation of many GiB, as {name} does not converge; with a continuous pressure an iterative solver would",
    )


@dataclass
class DirectSolver:
    """Solver with a factorisation. `core` stays valid when the form is assembled again.

    Parameters
    ----------
    condensed : Condensed
        The matrix.
    core : callable
        r → S⁻¹ r.
    iterations : int
        Always 1.
    """

    condensed: Condensed
    core: Core
    iterations: int = 1

    def __call__(self, r: Array) -> Array:
        """M⁻¹ r."""
        return self.condensed.solve(self.core, r)


@dataclass
class KrylovSolver:
    """Preconditioned CG or MINRES.

    Parameters
    ----------
    name : str
        Name of the solver.
    condensed : Condensed
        The matrix.
    precondition : callable
        The preconditioner.
    rtol : float
        Relative residual in the preconditioner's norm.
    max_iter : int
        Largest number of iterations.
    iterations : int
        Iterations of the last solve.

    Raises
    ------
    Breakdown
        By a solve without convergence; a `FloatingPointError`.
    """

    name: str
    condensed: Condensed
    precondition: Core
    rtol: float = RTOL
    max_iter: int = MAX_ITERATIONS
    iterations: int = 0

    def __call__(self, r: Array) -> Array:
        """M⁻¹ r."""
        return self.condensed.solve(self._core, r)

    def _core(self, r: Array) -> Array:
        method = krylov.cg if self.name.startswith("cg") else krylov.minres
        try:
            x, self.iterations = method(self.condensed.apply, self.precondition, r, self.rtol, self.max_iter)
        except FloatingPointError as error:
            raise Breakdown(f"{self.name}: {error}") from error
        return x


@dataclass(repr=False)
class ReusedFactorSolver(BriefText):
    """GMRES preconditioned by an older factorisation. The last solution is kept, for the same right-hand side again.

    Parameters
    ----------
    condensed : Condensed
        The matrix.
    old : callable
        The older factorisation, r → M₀⁻¹ r.
    rtol : float
        Relative residual.
    max_iter : int
        Largest number of iterations.
    iterations : int
        Iterations of the last solve.
    residual : float
        Relative residual of the last solve.
    """

    condensed: Condensed
    old: Core
    rtol: float
    max_iter: int
    iterations: int = 0
    residual: float = 0.0
    _scale: Array | None = None
    _last: tuple[Array, Array] | None = None

    def __call__(self, r: Array) -> Array:
        """M⁻¹ r, approximately."""
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
    """Prepare a linear solver for a form. Call it when all terms are added and before the first assembly, in which BDDC takes part.

    Parameters
    ----------
    name : str
        One of `NAMES`.
    form : BilinearForm
        The form.
    modulus : CoefficientFunction or float
        Shear modulus (Pa), for the preconditioners of mixed forms.

    Returns
    -------
    callable
        Makes a solver for the form's matrix after each assembly. It raises FloatingPointError where a factorisation fails, as
        the solver does where an iteration fails.

    Raises
    ------
    InputError
        For an unknown name, or a solver that does not suit the form.
    MissingExtra
        Where a package is missing.
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
    """Solver for a newly assembled matrix, with an older factorisation as preconditioner.

    Residuals are measured in the older factor's norm, M₀⁻¹(r - Mx), each field relative to its own size, so that forces and volumes
    may have different units.

    Parameters
    ----------
    form : BilinearForm
        The form, assembled.
    old : callable
        The older solver.
    r : array (ndof,)
        Right-hand side for the test.
    rtol : float
        Relative residual to reach.
    max_iter : int
        Largest number of iterations.

    Returns
    -------
    callable or None
        None where `rtol` is not reached for r. Later solves stop at `max_iter` in any case.
    """
    if not isinstance(old, DirectSolver):
        return None
    solve = ReusedFactorSolver(Condensed(form), old.core, rtol, max_iter)
    solve(r)
    return solve if solve.residual <= rtol else None


def _block(name: str, form: ngs.BilinearForm, modulus: ngs.CoefficientFunction | float) -> Callable[[], Core]:
    """Maker of the preconditioner of an iterative method after each assembly."""
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
