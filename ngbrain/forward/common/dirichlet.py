"""Dirichlet conditions: prescribed components of the displacement by boundary."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.forward.common.regions import boundaries

Components: TypeAlias = Sequence[CoefficientFunction | float | None]
Support: TypeAlias = float | CoefficientFunction | Components
"""0, a vector, or a value for each component, None where it is free."""


class Supports:
    """Dirichlet conditions of the displacement, checked.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    supports : dict
        Boundary pattern → `Support` at t = 1 (m). Where patterns share nodes the later one counts.

    Raises
    ------
    InputError
        For patterns that match nothing, and values that do not fit the mesh's dimension.
    """

    def __init__(self, mesh: ngs.Mesh, supports: Mapping[str, Support]) -> None:
        for pattern in supports:
            boundaries(mesh, pattern)
        self.mesh = mesh
        self.values = {pattern: _components(value, mesh.dim) for pattern, value in supports.items()}

    @property
    def components(self) -> dict[str, list[int]]:
        """Pattern → constrained components."""
        return {p: [i for i, c in enumerate(values) if c is not None] for p, values in self.values.items()}

    @property
    def dirichlet(self) -> dict[str, str]:
        """NGSolve's keyword arguments for the constrained components: dirichletx="a|b", …"""
        axes = {
            f"dirichlet{axis}": "|".join(pattern for pattern, fixed in self.components.items() if i in fixed)
            for i, axis in enumerate("xyz"[: self.mesh.dim])
        }
        return {axis: patterns for axis, patterns in axes.items() if patterns}

    def coefficients(self, space: ngs.FESpace) -> tuple[np.ndarray, np.ndarray]:
        """Prescribed values of a displacement space's degrees of freedom, and the mask of those that are constrained."""
        part = ngs.GridFunction(space)
        values, fixed = np.zeros(space.ndof), np.zeros(space.ndof, bool)
        for pattern, components in self.values.items():
            region = self.mesh.Boundaries(pattern)
            for i, value in enumerate(components):
                if value is None:
                    continue
                part.components[i].Set(value, definedon=region, dual=True)  # interpolates; without, it would project
                span = space.Range(i)
                where = span.start + np.flatnonzero(np.fromiter(space.components[i].GetDofs(region), bool))
                values[where] = part.vec.FV().NumPy()[where]
                fixed[where] = True
        return values, fixed

    def shares(self, space: ngs.FESpace, boundary: str) -> np.ndarray:
        """Share of a boundary in the reaction force at each degree of freedom.

        0 where other supports constrain it and the boundary does not; 1 where the boundary alone or no support does. Where several
        supports do, the boundary's part of the mass ∫ φ² of the shape function over all of them, so that reactions add up.

        Parameters
        ----------
        space : ngsolve.FESpace
            Displacement space.
        boundary : str
            Name or pattern.

        Returns
        -------
        array (ndof,)
            Between 0 and 1.
        """
        mine, found = boundaries(self.mesh, boundary), np.ones(space.ndof)
        scalar = space.components[0]
        for i in range(self.mesh.dim):
            holding = set[int]().union(
                *(boundaries(self.mesh, pattern) for pattern, fixed in self.components.items() if i in fixed)
            )
            others = _dofs(self.mesh, scalar, holding - mine)
            if not np.any(others & _dofs(self.mesh, scalar, mine)):
                continue
            own, all_of_them = (_mass(self.mesh, scalar, which) for which in (holding & mine, holding))
            part = np.divide(own, all_of_them, out=np.ones(scalar.ndof), where=all_of_them > 0)
            span = space.Range(i)
            found[span.start : span.stop] = np.where(others, part, 1.0)
        return found


def _region(mesh: ngs.Mesh, which: set[int]) -> ngs.Region:
    return ngs.Region(mesh, ngs.BND, ngs.BitArray([i in which for i in range(len(mesh.GetBoundaries()))]))


def _dofs(mesh: ngs.Mesh, space: ngs.FESpace, which: set[int]) -> np.ndarray:
    return np.fromiter(space.GetDofs(_region(mesh, which)), bool, space.ndof)


def _mass(mesh: ngs.Mesh, space: ngs.FESpace, which: set[int]) -> np.ndarray:
    """∫ φ² over some boundaries, of each shape function."""
    if not which:
        return np.zeros(space.ndof)
    u, v = space.TnT()
    form = ngs.BilinearForm(u * v * ngs.ds(definedon=_region(mesh, which)), diagonal=True, check_unused=False)
    return np.array(form.Assemble().mat.AsVector().FV().NumPy())


def _components(value: Support, dim: int) -> Components:
    if isinstance(value, CoefficientFunction):
        return tuple(value[i] for i in range(dim)) if value.dim == dim else (value,) * dim
    if isinstance(value, Sequence) and not isinstance(value, str):
        if len(value) != dim:
            raise InputError("supports", value, f"{dim} components")
        return value
    try:
        return (float(value),) * dim
    except (TypeError, ValueError):
        raise InputError("supports", repr(value), "0, a vector, or a value for each component") from None
