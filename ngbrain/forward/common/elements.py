"""Finite elements of displacement and pressure: names, spaces, inf-sup stability."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

import ngsolve as ngs
import numpy as np
import scipy.linalg

from ngbrain.errors import InputError

Kind = Literal["displacement", "continuous pressure", "discontinuous pressure"]


@dataclass(frozen=True)
class ElementPair:
    """Element pair: displacements of one order, pressures of another or none.

    Parameters
    ----------
    order : int
        Order k of the displacements.
    pressure : int, optional
        Order of the pressures; None: a pure displacement element, with U(J) as volumetric energy.
    continuous : bool
        Continuous pressures (H1); else discontinuous ones (L2), statically condensed element by element.

    Examples
    --------
    >>> ElementPair.named("P4/L2(2)")
    ElementPair(order=4, pressure=2, continuous=False)
    >>> str(ElementPair.named("P2/P1")), ElementPair.named("P3").kind
    ('P2/P1', 'displacement')
    """

    order: int
    pressure: int | None = None
    continuous: bool = True

    @classmethod
    def named(cls, name: str) -> ElementPair:
        """Element pair of a name: "P2/P1" (Taylor-Hood), "P4/L2(2)" (discontinuous pressure) or "P3" (displacement); Q means
        the same as P."""
        if not isinstance(name, str):
            raise InputError("element", repr(name), "a name such as P2/P1 or P3, or auto")
        match = re.fullmatch(r"[PQ](\d)(?:/(?:[PQ](\d)|L2\((\d)\)))?", name)
        if not match or match[1] == "0":
            raise InputError("element", repr(name), 'one such as "P2", "P2/P1", "P4/L2(2)", or "auto"')
        order, continuous, discontinuous = match.groups()
        pressure = continuous or discontinuous
        return cls(int(order), None if pressure is None else int(pressure), discontinuous is None)

    def __str__(self) -> str:
        second = "" if self.pressure is None else f"/P{self.pressure}" if self.continuous else f"/L2({self.pressure})"
        return f"P{self.order}{second}"

    @property
    def kind(self) -> Kind:
        """Kind of discretisation, for the choice of a linear solver."""
        if self.pressure is None:
            return "displacement"
        return "continuous pressure" if self.continuous else "discontinuous pressure"

    def spaces(self, mesh: ngs.Mesh, condense: bool, **dirichlet: str) -> list[ngs.FESpace]:
        """Displacement space and, if there is one, pressure space.

        Parameters
        ----------
        mesh : ngsolve.Mesh
        condense : bool
            Whether discontinuous pressures may be eliminated element by element (static condensation).
        **dirichlet : str
            NGSolve's dirichlet, dirichletx, …

        Returns
        -------
        list of FESpace
        """
        spaces = [ngs.VectorH1(mesh, order=self.order, **dirichlet)]
        if self.pressure is not None and self.continuous:
            spaces.append(ngs.H1(mesh, order=self.pressure))
        elif self.pressure is not None:
            spaces.append(ngs.L2(mesh, order=self.pressure))
            if not condense:  # with an infinite bulk modulus the pressure block is zero and cannot be eliminated
                for dof in range(spaces[1].ndof):
                    spaces[1].SetCouplingType(dof, ngs.COUPLING_TYPE.INTERFACE_DOF)
        return spaces

    def check(self, mesh: ngs.Mesh) -> None:
        """Refuse a pair whose inf-sup constant decreases under refinement: displacements look right, pressures are noise."""
        reason = self.unstable(mesh)
        if reason:
            raise InputError("element", f"{self}, {reason}", "a stable pair such as P2/P1, P3/P2, P4/L2(2)")

    def unstable(self, mesh: ngs.Mesh) -> str:
        """Reason why the pair is not inf-sup stable on a mesh's elements; empty if it is."""
        if self.pressure is None:
            return ""
        shapes = {element.type for element in mesh.Elements()}
        simplices = shapes <= {ngs.TRIG, ngs.TET}
        if self.pressure >= self.order:
            return f"pressures of order {self.pressure} under displacements of order {self.order}"
        if not self.continuous and simplices and self.pressure > self.order - 2:
            return "discontinuous pressures one order below"
        if not self.continuous and ngs.TET in shapes and (falling := FALLING.get(self.order)):
            return f"whose inf-sup constant falls on tetrahedra ({falling} for n = 2, 3, 4 in a cube)"
        return ""


FALLING = {2: ".100, .093, .076", 3: ".099, .089, .072"}
"""Inf-sup constants of P_k/L2(k-2) on n³ cubes of six tetrahedra, by k."""


def inf_sup(mesh: ngs.Mesh, form: ElementPair, dirichlet: str = ".*") -> tuple[float, int]:
    """Discrete inf-sup constant β_h, and the dimension of the kernel of Bᵀ (1, the constant, for a fully constrained boundary).

    β_h² is the smallest positive eigenvalue of B A⁻¹ Bᵀ q = β² M q, with A the H1 seminorm, B the divergence and M the pressure
    mass matrix. Dense: for meshes of a few thousand unknowns.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    form : ElementPair
    dirichlet : str
        Boundaries with zero displacement.

    Returns
    -------
    beta : float
    zeros : int
        Number of spurious and constant pressure modes.

    Examples
    --------
    >>> from ngsolve.meshes import MakeStructured2DMesh
    >>> beta, zeros = inf_sup(MakeStructured2DMesh(quads=False, nx=2, ny=2), ElementPair.named("P2/P1"))
    >>> round(beta, 3), zeros
    (0.367, 1)
    """
    V, Q = form.spaces(mesh, True, dirichlet=dirichlet)
    (u, v), (p, q) = V.TnT(), Q.TnT()
    free = np.fromiter(V.FreeDofs(), bool, V.ndof)
    A = _dense(ngs.BilinearForm(ngs.InnerProduct(ngs.Grad(u), ngs.Grad(v)) * ngs.dx))[np.ix_(free, free)]
    B = _dense(ngs.BilinearForm(ngs.Trace(ngs.Grad(u)) * q * ngs.dx))[:, free]
    M = _dense(ngs.BilinearForm(p * q * ngs.dx))
    values = scipy.linalg.eigh(B @ scipy.linalg.solve(A, B.T, assume_a="pos"), M, eigvals_only=True)
    zeros = int(np.sum(values < 1e-10))
    return float(np.sqrt(values[zeros])), zeros


def _dense(form: ngs.BilinearForm) -> np.ndarray:
    form.Assemble()
    return np.asarray(form.mat.ToDense())


def check_elements(mesh: ngs.Mesh) -> None:
    """Refuse a mesh with inverted elements; the message names the element and its region."""
    jacobian = ngs.Det(ngs.specialcf.JacobianMatrix(mesh.dim))
    least = ngs.Integrate(ngs.IfPos(jacobian, 1, -1), mesh, element_wise=True, order=4).NumPy()
    size = ngs.Integrate(ngs.CF(1), mesh, element_wise=True, order=4).NumPy()
    sign = 1 if np.sum(least) > 0 else -1
    bad = np.flatnonzero(sign * least < 0.999 * size)
    if bad.size:
        element = mesh[ngs.ElementId(ngs.VOL, int(bad[0]))]
        raise InputError(
            "mesh", f"inverted at element {bad[0]} of region {element.mat!r}", "one without inverted elements"
        )
