"""Which finite elements carry displacement and pressure, what they are called, and which pairs are refused."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import ngsolve as ngs
import numpy as np
import scipy.linalg

from ngbrain.errors import InputError

Kind = Literal["displacement", "continuous pressure", "discontinuous pressure"]


@dataclass(frozen=True)
class Form:
    """Displacements of an order, and pressures of another or none.

    order       k of the displacements
    pressure    order of the pressures; None: no pressure unknowns, U(J) instead
    continuous  pressures in H1, else in L2 and condensed element by element

    >>> Form.named("P4/L2(2)")
    Form(order=4, pressure=2, continuous=False)
    >>> str(Form.named("P2/P1")), Form.named("P3").kind
    ('P2/P1', 'displacement')
    """

    order: int
    pressure: int | None = None
    continuous: bool = True

    @classmethod
    def named(cls, name: str) -> Form:
        """From "P2/P1" (Taylor-Hood), "P4/L2(2)" (discontinuous) or "P3" (displacement); Q instead of P means the same."""
        match = re.fullmatch(r"[PQ](\d)(?:/(?:[PQ](\d)|L2\((\d)\)))?", name)
        if not match or match[1] == "0":
            raise InputError("form", repr(name), 'one such as "P2", "P2/P1", "P4/L2(2)", or "auto"')
        order, continuous, discontinuous = match.groups()
        pressure = continuous or discontinuous
        return cls(int(order), None if pressure is None else int(pressure), discontinuous is None)

    def __str__(self) -> str:
        second = "" if self.pressure is None else f"/P{self.pressure}" if self.continuous else f"/L2({self.pressure})"
        return f"P{self.order}{second}"

    @property
    def kind(self) -> Kind:
        """What a linear solver has to know."""
        if self.pressure is None:
            return "displacement"
        return "continuous pressure" if self.continuous else "discontinuous pressure"

    def spaces(self, mesh: ngs.Mesh, condense: bool, **held: str) -> list[ngs.FESpace]:
        """Displacement space and, if there is one, pressure space; `held` is what NGSolve calls dirichlet, dirichletx, …"""
        spaces = [ngs.VectorH1(mesh, order=self.order, **held)]
        if self.pressure is not None and self.continuous:
            spaces.append(ngs.H1(mesh, order=self.pressure))
        elif self.pressure is not None:
            spaces.append(ngs.L2(mesh, order=self.pressure))
            if not condense:  # beside a bulk modulus that is infinite there is nothing to eliminate them with
                for dof in range(spaces[1].ndof):
                    spaces[1].SetCouplingType(dof, ngs.COUPLING_TYPE.INTERFACE_DOF)
        return spaces

    def check(self, mesh: ngs.Mesh) -> None:
        """Refuse a pair whose inf-sup constant falls with the mesh: displacements look right and pressures are noise."""
        reason = self.unstable(mesh)
        if reason:
            raise InputError("form", f"{self}, {reason}", "a stable pair such as P2/P1, P3/P2, P4/L2(2)")

    def unstable(self, mesh: ngs.Mesh) -> str:
        """Why the pair is not stable on a mesh's elements; nothing if it is."""
        if self.pressure is None:
            return ""
        shapes = {element.type for element in mesh.Elements()}
        simplices = shapes <= {ngs.TRIG, ngs.TET}
        if self.pressure >= self.order:
            return f"pressures of order {self.pressure} under displacements of order {self.order}"
        if not self.continuous and simplices and self.pressure > self.order - 2:
            return "discontinuous pressures one order below"
        if not self.continuous and ngs.TET in shapes and self.order == 2:
            return "whose inf-sup constant falls on tetrahedra (.100, .093, .076 for n = 2, 3, 4 in a cube)"
        return ""


def inf_sup(mesh: ngs.Mesh, form: Form, dirichlet: str = ".*") -> tuple[float, int]:
    """The inf-sup constant β_h, and how many pressures no displacement sees (1, the constant, is right for a held boundary).

    β_h² is the smallest eigenvalue above zero of B A⁻¹ Bᵀ q = β² M q with A the H1 seminorm, B the divergence and M the
    mass of pressures. Dense: for meshes of a few thousand unknowns.

    >>> from ngsolve.meshes import MakeStructured2DMesh
    >>> beta, zeros = inf_sup(MakeStructured2DMesh(quads=False, nx=2, ny=2), Form.named("P2/P1"))
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


# Which form a scene needs.

LARGE = 20_000
"""Elements from which on P4/L2(2) is no longer cheap: 700 000 unknowns in space."""
STEEP = 220.0
"""Degrees inside a body beyond which an edge is taken for re-entrant, not for a curve cut into facets."""


def automatic(mesh: ngs.Mesh, ratio: float, held: Mapping[str, Any]) -> tuple[Form, str]:
    """The cheapest adequate form, and why: by K/μ, and by whether solutions can be smooth on this mesh.

    ratio   largest K/μ
    held    boundary pattern → components that are held there
    """
    if ratio <= COMPRESSIBLE:
        return Form(2), f"K/μ is {ratio:.3g}, which does not lock quadratic displacements"
    reason = rough(mesh, held)
    if reason:
        return Form(2, 1), f"{reason}: order 4 would gain little on it for its cost"
    return Form(4, 2, False), "one region, no re-entrant edges, no clamped boundary that meets a free one: smooth"


COMPRESSIBLE = 20.0
"""K/μ up to which displacements alone do."""


def rough(mesh: ngs.Mesh, held: Mapping[str, Any]) -> str:
    """Why a solution is not smooth on a mesh; nothing if it can be."""
    regions = set(mesh.GetMaterials())
    if len(regions) > 1:
        return f"{len(regions)} regions"
    if mesh.ne > LARGE:
        return f"{mesh.ne} elements"
    faces, meeting, angles = _edges(mesh)
    if np.any(angles > STEEP):
        return f"{np.sum(angles > STEEP)} re-entrant edges"
    names = mesh.GetBoundaries()
    count = [0] * len(names)
    for pattern, components in held.items():
        for i, match in enumerate(mesh.Boundaries(pattern).Mask()):
            count[i] |= sum(1 << c for c in components) if match else 0
    bits = np.array(count)[faces]
    full = (1 << mesh.dim) - 1
    first, second = bits[meeting[:, 0]], bits[meeting[:, 1]]
    if np.any(((first == full) & (second == 0)) | ((second == full) & (first == 0))):
        return "a clamped boundary meets a free one"
    return ""


def _edges(mesh: ngs.Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Boundary number of each surface element, pairs of neighbours among them, the angle (°) of the body between each two."""
    corners = np.array([vertex.point for vertex in mesh.vertices])
    elements = list(mesh.Elements(ngs.BND))
    inner = {}
    wanted = {_facet(mesh, element): i for i, element in enumerate(elements)}
    for element in mesh.Elements():
        middle = corners[[v.nr for v in element.vertices]].mean(axis=0)
        for facet in element.faces if mesh.dim == 3 else element.edges:
            if facet in wanted:
                inner[wanted[facet]] = middle
    middles = np.array([corners[[v.nr for v in e.vertices]].mean(axis=0) for e in elements])
    normals = np.array([_normal(corners[[v.nr for v in e.vertices]]) for e in elements])
    outward = middles - np.array([inner[i] for i in range(len(elements))])
    normals *= np.sign(np.sum(normals * outward, axis=1))[:, None]
    sides: dict[Any, list[int]] = {}
    for i, element in enumerate(elements):
        for side in element.edges if mesh.dim == 3 else element.vertices:
            sides.setdefault(side, []).append(i)
    pairs = np.array([both for both in sides.values() if len(both) == 2])
    a, b = pairs.T
    turn = np.degrees(np.arccos(np.clip(np.sum(normals[a] * normals[b], axis=1), -1, 1)))
    convex = np.sum((middles[b] - middles[a]) * (normals[b] - normals[a]), axis=1) >= 0
    return np.array([e.index for e in elements]), pairs, 180 + np.where(convex, -turn, turn)


def _facet(mesh: ngs.Mesh, element: Any) -> Any:
    return element.faces[0] if mesh.dim == 3 else element.edges[0]


def _normal(points: np.ndarray) -> np.ndarray:
    along = points[1] - points[0]
    normal = np.array([along[1], -along[0]]) if points.shape[1] == 2 else np.cross(along, points[2] - points[0])
    return normal / np.linalg.norm(normal)
