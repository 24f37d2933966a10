"""Regularisers by name, as `invert` offers them: what a field in these elements is thought to be before it is measured.

smooth   of small slope, see `regularise.smooth`
edges    of few flat parts, see `regularise.total_variation`; an edge is `EDGE` of the body wide
steps    the same with `STEP`: the longer that is, the less a steep edge costs beside a slope as high
matern   with bumps of a size, see `regularise.matern`; correlated over `REACH` of the body
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import ngsolve as ngs
import numpy as np

from ngbrain.adjoint.reduced import Regulariser
from ngbrain.errors import InputError, nearest
from ngbrain.inverse.objective.regularisation import matern, smooth, total_variation

Prior: TypeAlias = Callable[[ngs.FESpace, np.ndarray], Regulariser]
"""A space and x̄ → a regulariser of fields in it."""
EDGE, STEP, REACH = 0.1, 0.3, 0.1
AUTO = ("smooth", "edges")
"""Those of which cross-validation chooses unasked."""


def extent(space: ngs.FESpace) -> float:
    """The longest side (m) of the box around the space's mesh."""
    corners = np.array([vertex.point for vertex in space.mesh.vertices])
    return float(np.max(np.ptp(corners, axis=0)))


def _edges(space: ngs.FESpace, reference: np.ndarray) -> Regulariser:
    return total_variation(space, reference, EDGE * extent(space))


def _steps(space: ngs.FESpace, reference: np.ndarray) -> Regulariser:
    return total_variation(space, reference, STEP * extent(space))


def _matern(space: ngs.FESpace, reference: np.ndarray) -> Regulariser:
    return matern(space, reference, REACH * extent(space))


PRIORS: dict[str, Prior] = {"smooth": smooth, "edges": _edges, "steps": _steps, "matern": _matern}
"""Functions of this module or another, so that other processes find them."""


def resolve_priors(chosen: str | Prior) -> dict[str, Prior]:
    """Those to try: of a name, "auto" for `AUTO`, or a prior of one's own under its function's name.

    Raises `InputError` for another name.

    >>> list(resolve_priors("auto")), list(resolve_priors("matern"))
    (['smooth', 'edges'], ['matern'])
    """
    if callable(chosen):
        return {getattr(chosen, "__name__", type(chosen).__name__): chosen}
    if chosen == "auto":
        return {name: PRIORS[name] for name in AUTO}
    if chosen not in PRIORS:
        raise InputError("regulariser", repr(chosen), nearest(chosen, ("auto", *PRIORS)))
    return {chosen: PRIORS[chosen]}
