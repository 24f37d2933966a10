"""Regularisers that `invert` offers by name.

- "smooth": H1 smoothness, see `regularisation.smooth`.
- "edges": total variation with edges `EDGE` of the domain wide, see `regularisation.total_variation`.
- "steps": total variation with edges of `STEP`. The longer the edge, the less a steep step costs relative to a slope of the
  same height.
- "matern": Matérn covariance with a correlation length of `REACH` of the domain, see `regularisation.matern`.
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
"""Constructor of a regulariser from a space and the reference x̄."""
EDGE, STEP, REACH = 0.1, 0.3, 0.1
AUTO = ("smooth", "edges")
"""Regularisers that cross-validation chooses from by default."""


def extent(space: ngs.FESpace) -> float:
    """Longest side (m) of the bounding box of the mesh of a space."""
    corners = np.array([vertex.point for vertex in space.mesh.vertices])
    return float(np.max(np.ptp(corners, axis=0)))


def _edges(space: ngs.FESpace, reference: np.ndarray) -> Regulariser:
    return total_variation(space, reference, EDGE * extent(space))


def _steps(space: ngs.FESpace, reference: np.ndarray) -> Regulariser:
    return total_variation(space, reference, STEP * extent(space))


def _matern(space: ngs.FESpace, reference: np.ndarray) -> Regulariser:
    return matern(space, reference, REACH * extent(space))


PRIORS: dict[str, Prior] = {"smooth": smooth, "edges": _edges, "steps": _steps, "matern": _matern}
"""Functions of modules, so that other processes find them."""


def resolve_priors(chosen: str | Prior) -> dict[str, Prior]:
    """Regularisers to try: that of a name, those of `AUTO` for "auto", or one of your own under the name of its function.

    Raises `InputError` for an unknown name.

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
