"""Direct factorisations by name, each verified to be an inverse."""

from __future__ import annotations

import importlib.metadata
from functools import lru_cache, partial

import numpy as np
import scipy.sparse as sp

from ngbrain.errors import Breakdown, MissingExtra, require
from ngbrain.result import Status
from ngbrain.solvers.condensed import Array, Condensed, Core
from ngbrain.solvers.device import CudssFactor, Device
from ngbrain.solvers.matrices import to_scipy

NAMES = ("sparsecholesky", "umfpack", "pardiso", "mumps", "cudss")

MAX_CORRECTION = 1e-3
"""Largest relative correction by iterative refinement of a valid factor."""


def require_package(name: str) -> None:
    """Check that the package of a solver is installed (`MissingExtra`) and, for cudss, that there is a GPU (`InputError`)."""
    if name == "mumps":
        require("mumps", "mumps")
    if name == "pardiso":
        try:
            importlib.metadata.version("mkl")  # a shared library that NGSolve loads itself
        except importlib.metadata.PackageNotFoundError as error:
            raise MissingExtra("mkl", "pardiso") from error
    if name == "cudss":
        Device.from_name("cuda")


def factorise(name: str, condensed: Condensed) -> Core:
    """Factorise the condensed matrix.

    A Cholesky factor of a singular matrix may be finite but wrong by orders of magnitude. So one random right-hand side is solved
    for, and its residual too: the correction is either round-off or as large as the solution. The ratio is taken field by field,
    so that it does not depend on units.

    Parameters
    ----------
    name : str
        One of `NAMES`.
    condensed : Condensed
        The matrix.

    Returns
    -------
    callable
        r → S⁻¹ r.

    Raises
    ------
    Breakdown
        Where the factorisation fails or is not accurate; a `FloatingPointError`.
    """
    try:
        core = {"mumps": _mumps, "cudss": _cudss}.get(name, partial(_ngsolve, name))(condensed)
    except Exception as error:  # NGSolve and MUMPS raise bare exceptions of several kinds here
        raise Breakdown(f"the tangent cannot be factorised: {name}: {error}", Status.SINGULAR) from error
    b = _random(len(condensed.free)) * condensed.free
    x = core(b)
    with np.errstate(all="ignore"):
        correction = core(b - condensed.apply(x))
        sizes = [(np.linalg.norm(correction[field]), np.linalg.norm(x[field])) for field in condensed.fields]
    if not all(np.isfinite(size) and wrong <= MAX_CORRECTION * size for wrong, size in sizes):
        said = f"the tangent cannot be factorised: {name} gives no solution, the matrix is singular"
        raise Breakdown(said, Status.SINGULAR)
    return core


@lru_cache(maxsize=1)
def _random(n: int) -> Array:
    """The same n random numbers at each call; drawing them takes as long as a solve of a small body."""
    return np.random.default_rng(0).normal(size=n)


def _ngsolve(name: str, condensed: Condensed) -> Core:
    form, where = condensed.form, condensed.free
    inverse = form.mat.Inverse(form.space.FreeDofs(form.condense), inverse=name)
    right, left = form.mat.CreateColVector(), form.mat.CreateRowVector()
    asked, found = right.FV().NumPy(), left.FV().NumPy()

    def core(r: Array) -> Array:
        asked[:] = r
        left.data = inverse * right
        return found * where

    return core


def _mumps(condensed: Condensed) -> Core:
    mumps, where = require("mumps", "mumps"), condensed.free
    matrix, symmetric = to_scipy(condensed.matrix)[where][:, where], _symmetric(condensed)
    context = mumps.Context()
    context.set_matrix(sp.triu(matrix, format="coo") if symmetric else matrix.tocoo(), symmetric=symmetric)
    context.factor()

    def core(r: Array) -> Array:
        x = np.zeros_like(r)
        x[where] = context.solve(r[where])
        return x

    return core


def _cudss(condensed: Condensed) -> Core:
    form = condensed.form
    return CudssFactor(condensed.matrix, form.space.FreeDofs(form.condense), _symmetric(condensed)).solve


def _symmetric(condensed: Condensed) -> bool:
    return bool(condensed.form.flags.ToDict().get("symmetric", False))
