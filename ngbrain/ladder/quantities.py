"""What is asked of a body at rest in a state: forces, displacements, percentiles of strain."""

from __future__ import annotations

from dataclasses import dataclass

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.common.interpolation import evaluation
from ngbrain.forward.solid.problem import Problem
from ngbrain.scene.loading import Ask

Array = np.ndarray
BAND = 0.1
"""Of the volume, to both sides of a percentile."""
PLANE = (0, 2)
"""Axes of the body that a section has."""


@dataclass(frozen=True, eq=False)
class State:
    """A body in a state.

    body       what was solved
    x          its unknowns
    factor     the load factor that they belong to; small and linear strains are 1/factor times as large
    linear     whether strains count as small
    thickness  of a section (m), else 1
    """

    body: Problem
    x: Array
    factor: float
    linear: bool
    thickness: float = 1.0

    @property
    def plane(self) -> bool:
        """Whether it is a section."""
        return self.body.mesh.dim == 2

    def stand(self) -> None:
        """Put the body there."""
        self.body.load(self.x, self.factor)
        self.body.x = self.x

    def displacement(self) -> ngs.CoefficientFunction:
        """At full load (m)."""
        return self.body.u / self.factor


def embedded(state: State, body: Problem, factor: float) -> Array:
    """A state's displacements, and the pressures that go with them, as unknowns of another body in the same place."""
    state.stand()
    u = state.displacement() * factor
    body.u.Set(u)
    if body.p is not None and state.body.p is not None:
        body.p.Set(state.body.p * (factor / state.factor))
    elif body.p is not None:
        J = ngs.Det(body.kinematics.gradient(body.u, ngs.Grad(body.u)))
        bulk = body.mesh.MaterialCF({name: material.bulk for name, material in body.materials.items()})
        body.p.Set(bulk * (J - 1))
    return body.load(body.x, factor)


def answer(ask: Ask, state: State) -> float:
    """The number that is asked for, in SI units."""
    state.stand()
    if ask.quantity == "force":
        return _force(ask, state)
    return _displacement(ask, state) if ask.quantity == "displacement" else _strain(ask, state)


def slope(ask: Ask, state: State) -> Array:
    """How the number changes with the free unknowns of a linear body at rest (ndof,).

    Of a percentile: the mean over elements whose strains are within `BAND` of its place, along their largest strains.
    """
    by = {"force": _of_force, "displacement": _of_displacement, "strain": _of_strain}[ask.quantity]
    state.stand()
    return np.where(state.body.weights > 0, by(ask, state), 0.0) / state.factor


def _of_force(ask: Ask, state: State) -> Array:
    """The stiffness times a motion of the boundary, a difference quotient."""
    body, field = state.body, ngs.GridFunction(state.body.u.space)
    field.Set(ngs.CF(along(ask.unit, state.plane)), definedon=body.mesh.Boundaries(ask.boundary), dual=True)
    h = float(np.abs(state.x[body.is_u]).max()) or 1.0
    moved = state.x.copy()
    moved[body.is_u] += h * field.vec.FV().NumPy() * body.reaction_shares(ask.boundary)
    return (body.residual(moved)[0] - body.residual(state.x)[0]) * state.thickness / h


def _of_displacement(ask: Ask, state: State) -> Array:
    body, found = state.body, np.zeros(state.body.fes.ndof)
    point = np.array([along(ask.point or (0.0, 0.0, 0.0), state.plane)])
    row = evaluation(ngs.H1(body.mesh, order=body.element.order), point).toarray()[0]
    found[body.is_u] = np.concatenate([way * row for way in along(ask.unit, state.plane)])
    return found


def _of_strain(ask: Ask, state: State) -> Array:
    body, dim = state.body, state.body.mesh.dim
    sizes = ngs.Integrate(_within(body.mesh, ask), body.mesh, element_wise=True).NumPy()
    strain, mean = ngs.Sym(ngs.Grad(body.u)), ngs.GridFunction(ngs.MatrixValued(ngs.L2(body.mesh, order=0), dim))
    mean.Set(strain)
    values, ways = np.linalg.eigh(mean.vec.FV().NumPy().reshape(dim, dim, -1).transpose(2, 0, 1))
    order = np.argsort(values[:, -1])
    place = np.empty(len(order))
    place[order] = (np.cumsum(sizes[order]) - sizes[order] / 2) / sizes.sum()
    away = np.where(sizes > 0, np.abs(place - ask.percentile / 100), np.inf)
    there = sizes * (away <= max(BAND, away.min()))
    volumes = ngs.Integrate(ngs.CF(1), body.mesh, element_wise=True).NumPy()
    weight = ngs.GridFunction(mean.space)
    weight.vec.FV().NumPy()[:] = np.einsum("k,ki,kj->ijk", there / there.sum() / volumes, *2 * [ways[:, :, -1]]).ravel()
    test = body.fes.TestFunction()
    form = ngs.LinearForm(body.fes)
    form += ngs.InnerProduct(weight, ngs.Grad(test if body.p is None else test[0])) * ngs.dx
    form.Assemble()
    return np.asarray(form.vec.FV().NumPy().copy())


def along(vector: tuple[float, ...], plane: bool) -> tuple[float, ...]:
    """A vector's components that a mesh has."""
    return tuple(vector[i] for i in PLANE) if plane else tuple(vector)


def in_axes(direction: tuple[float, float, float], plane: bool) -> tuple[float, float, float]:
    """A direction of three components, up to sign, in a mesh's own axes: a section's third is across it, the body's y.

    >>> in_axes((0.0, 0.6, 0.8), plane=True)
    (0.0, 0.8, 0.6)
    """
    x, y, z = direction
    return (x, z, y) if plane else direction


def scale_of(ask: Ask, state: State) -> float:
    """What an answer is measured by where it is nearly nothing, as by symmetry: the largest component of the forces that hold and
    load the body (N), the largest displacement (m). A strain is measured by itself.
    """
    if ask.quantity == "strain":
        return 0.0
    state.stand()
    body = state.body
    if ask.quantity == "displacement":
        nodes = ngs.GridFunction(ngs.VectorH1(body.mesh, order=1))
        nodes.Set(state.displacement())
        return float(np.abs(nodes.vec.FV().NumPy()).max())
    forces = body.tissue_forces()
    spaces = (body.u.space.Range(i) for i in range(body.mesh.dim))
    largest = max(float(np.abs(forces[span.start : span.stop]).sum()) for span in spaces) / 2  # there and back
    return largest * state.thickness / state.factor


def _force(ask: Ask, state: State) -> float:
    body = state.body
    way = ngs.CF(along(ask.unit, state.plane))
    return float(body.conjugate(way, ask.boundary)) * state.thickness / state.factor


def _displacement(ask: Ask, state: State) -> float:
    return float(
        np.dot(state.displacement()(point_in(state.body.mesh, ask, state.plane)), along(ask.unit, state.plane))
    )


def point_in(mesh: ngs.Mesh, ask: Ask, plane: bool) -> ngs.MeshPoint:
    """The question's point; `InputError` for one outside."""
    found = mesh(*along(ask.point or (0.0, 0.0, 0.0), plane))
    if found.nr < 0:
        raise InputError("ask.point_mm", [1e3 * c for c in ask.point or ()], "a point in the body")
    return found


@dataclass(frozen=True, eq=False)
class Measured:
    """Values at points, and the volumes that they stand for."""

    values: Array
    weights: Array


def percentile(measured: Measured, percent: float) -> float:
    """The value below which this part of the volume has its own."""
    order = np.argsort(measured.values)
    weights = measured.weights[order]
    share = np.cumsum(weights)
    return float(np.interp(percent / 100 * share[-1], share - weights / 2, measured.values[order]))


def _strain(ask: Ask, state: State) -> float:
    """Of the largest principal strain."""
    body = state.body
    points, weights = within(body.mesh, ask)
    F = body.kinematics.gradient(state.displacement(), ngs.Grad(body.u) / state.factor)
    gradient = np.array(F.Compile()(points)).reshape(-1, 3, 3)
    if state.linear:
        strain = (gradient + gradient.transpose(0, 2, 1)) / 2 - np.eye(3)
    else:
        strain = (gradient.transpose(0, 2, 1) @ gradient - np.eye(3)) / 2
    return percentile(Measured(np.linalg.eigvalsh(strain)[:, -1], weights), ask.percentile)


def within(mesh: ngs.Mesh, ask: Ask) -> tuple[Array, Array]:
    """Quadrature points in the question's regions, within its distance, and the volumes that they stand for."""
    (shape,) = {element.type for element in mesh.Elements()}
    rule = ngs.IntegrationRule(shape, 2)
    points = mesh.MapToAllElements({shape: rule}, ngs.VOL)
    volume = _within(mesh, ask) * ngs.Det(ngs.specialcf.JacobianMatrix(mesh.dim))
    weights = np.tile(np.array(rule.weights), mesh.ne) * np.abs(np.array(volume(points)).ravel())
    if not (weights > 0).any():
        raise InputError("ask.region", repr(ask.region), "a region and a distance that hold some of the body")
    return points[weights > 0], weights[weights > 0]


def _within(mesh: ngs.Mesh, ask: Ask) -> ngs.CoefficientFunction:
    """1 in the question's regions and within its distance, else 0."""
    inside = mesh.MaterialCF({ask.region: 1.0}, default=0.0)
    if ask.within is None:
        return inside
    centre = along(ask.point or (), mesh.dim == 2)
    away = sum((x - c) ** 2 for x, c in zip((ngs.x, ngs.y, ngs.z), centre, strict=False))
    return inside * ngs.IfPos(ask.within**2 - away, 1.0, 0.0)
