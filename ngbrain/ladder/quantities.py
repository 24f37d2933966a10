"""What is asked of a body at rest in a state: forces, displacements, percentiles of strain."""

from __future__ import annotations

from dataclasses import dataclass

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.observables import Displacements, Force, Observable, StrainPercentile
from ngbrain.forward.observables.percentiles import Percentile
from ngbrain.forward.solid.problem import Problem
from ngbrain.scene import Quantity

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


def observable(quantity: Quantity, state: State) -> Observable:
    """What a quantity is of a body: without the load factor, and for a metre of a section."""
    if quantity.name == "force":
        return Force(str(quantity.boundary), along(quantity.unit_vector, state.plane))
    if quantity.name == "displacement":
        point_in(state.body.mesh, quantity, state.plane)
        return Displacements(
            [along(quantity.point or (0.0, 0.0, 0.0), state.plane)], along(quantity.unit_vector, state.plane)
        )
    near = None if quantity.radius is None else along(quantity.point or (), state.plane)
    measure = "small" if state.linear else "Green-Lagrange"
    return StrainPercentile(
        quantity.percentile, quantity.region, near, quantity.radius, BAND, measure, 1 / state.factor
    )


def answer(quantity: Quantity, state: State) -> float:
    """The number that is asked for, in SI units."""
    state.stand()
    observed = observable(quantity, state).on(state.body)
    return observed.raw if isinstance(observed, Percentile) else float(observed.value()[0]) * _times(quantity, state)


def slope(quantity: Quantity, state: State) -> Array:
    """How the number changes with the free unknowns of a body (ndof,); of a percentile, its mean over a band."""
    state.stand()
    gradient = observable(quantity, state).gradient(state.body) * _times(quantity, state)
    return np.where(state.body.weights > 0, gradient, 0.0)


def _times(quantity: Quantity, state: State) -> float:
    """What an observable is multiplied by: a percentile has the load factor in it."""
    if quantity.name == "strain":
        return 1.0
    return (state.thickness if quantity.name == "force" else 1.0) / state.factor


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


def scale_of(quantity: Quantity, state: State) -> float:
    """What an answer is measured by where it is nearly nothing, as by symmetry: the largest component of the forces that hold and
    load the body (N), the largest displacement (m). A strain is measured by itself.
    """
    if quantity.name == "strain":
        return 0.0
    state.stand()
    body = state.body
    if quantity.name == "displacement":
        nodes = ngs.GridFunction(ngs.VectorH1(body.mesh, order=1))
        nodes.Set(state.displacement())
        return float(np.abs(nodes.vec.FV().NumPy()).max())
    forces = body.tissue_forces()
    spaces = (body.u.space.Range(i) for i in range(body.mesh.dim))
    largest = max(float(np.abs(forces[span.start : span.stop]).sum()) for span in spaces) / 2  # there and back
    return largest * state.thickness / state.factor


def point_in(mesh: ngs.Mesh, quantity: Quantity, plane: bool) -> ngs.MeshPoint:
    """The quantity's point; `InputError` for one outside."""
    found = mesh(*along(quantity.point or (0.0, 0.0, 0.0), plane))
    if found.nr < 0:
        raise InputError("quantity.point_mm", [1e3 * c for c in quantity.point or ()], "a point in the body")
    return found


def within(mesh: ngs.Mesh, quantity: Quantity) -> tuple[Array, Array]:
    """Quadrature points in the quantity's regions, within its radius, and the volumes that they stand for."""
    (shape,) = {element.type for element in mesh.Elements()}
    rule = ngs.IntegrationRule(shape, 2)
    points = mesh.MapToAllElements({shape: rule}, ngs.VOL)
    volume = _within(mesh, quantity) * ngs.Det(ngs.specialcf.JacobianMatrix(mesh.dim))
    weights = np.tile(np.array(rule.weights), mesh.ne) * np.abs(np.array(volume(points)).ravel())
    if not (weights > 0).any():
        raise InputError("quantity.region", repr(quantity.region), "a region and a distance that hold some of the body")
    return points[weights > 0], weights[weights > 0]


def _within(mesh: ngs.Mesh, quantity: Quantity) -> ngs.CoefficientFunction:
    """1 in the quantity's regions and within its radius, else 0."""
    inside = mesh.MaterialCF({quantity.region: 1.0}, default=0.0)
    if quantity.radius is None:
        return inside
    centre = along(quantity.point or (), mesh.dim == 2)
    away = sum((x - c) ** 2 for x, c in zip((ngs.x, ngs.y, ngs.z), centre, strict=False))
    return inside * ngs.IfPos(quantity.radius**2 - away, 1.0, 0.0)
