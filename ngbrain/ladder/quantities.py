"""What is asked of a body at rest in a state: forces, displacements, percentiles of strain, and any observable of one's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.observables import Displacements, Force, Observable, StrainPercentile
from ngbrain.forward.observables.percentiles import Percentile
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials.base import check_parameter
from ngbrain.scene import Quantity, Scene

Array = np.ndarray
BAND = 0.1
"""Of the volume, to both sides of a percentile."""
PLANE = (0, 2)
"""Axes of the body that a section has."""


@dataclass(frozen=True, eq=False)
class BodyState:
    """A body in a state.

    body       what was solved
    x          its unknowns
    factor     the load factor that they belong to; small and linear strains are 1/factor times as large
    linear     whether strains count as small
    thickness  of a section (m), else 1
    still      the same without memory, which is stressed at rest once it has moved
    """

    body: Problem
    x: Array
    factor: float
    linear: bool
    thickness: float = 1.0
    without_memory: Problem | None = None

    @property
    def plane(self) -> bool:
        """Whether it is a section."""
        return self.body.mesh.dim == 2

    def apply(self) -> None:
        """Put the body there."""
        self.body.load(self.x, self.factor)
        self.body.x = self.x

    def displacement(self) -> ngs.CoefficientFunction:
        """At full load (m)."""
        return self.body.u / self.factor


WHEN = ("end", "ramp")
"""When a question is asked: see `scene.Quantity`."""


@dataclass(frozen=True, eq=False)
class Question:
    """An observable that a ladder is asked of every model of a scene's, beside the questions that the scene asks itself.

    It is asked of bodies in space alone: a section has no y. Of small strains it counts linearly: Q(0) + Q'(0) u.

    Parameters
    ----------
    observable : Observable
        Of one number, with a gradient: those of `ngbrain.forward.observables`, or one's own.
    tolerance : float
        The relative error that its answer may have.
    when : str
        "end", or "ramp": when the loads have just got their size.

    Raises
    ------
    InputError
        For what is no observable, a tolerance that makes no sense or another time.

    Examples
    --------
    >>> from ngbrain.forward.observables import region_volume
    >>> Question(region_volume(), tolerance=0.01).label
    'volume of .*, end'
    """

    observable: Observable
    tolerance: float = 0.05
    when: str = "end"

    def __post_init__(self) -> None:
        if not isinstance(self.observable, Observable):
            raise InputError("Question.observable", type(self.observable).__name__, "an Observable")
        check_parameter(
            self.tolerance, "Question.tolerance", lambda t: 1e-4 <= t <= 1, "a relative error of 0.0001 to 1"
        )
        if self.when not in WHEN:
            raise InputError("Question.when", repr(self.when), " or ".join(map(repr, WHEN)))

    @property
    def label(self) -> str:
        """In words, as those of a scene."""
        return f"{self.observable.name}, {self.when}"

    def value(self, state: BodyState) -> float:
        """At full load: of small strains as far as it is linear."""
        state.apply()
        here = self._number(state.body)
        if state.factor == 1:
            return here
        without_memory = state.without_memory or state.body
        without_memory.x = np.zeros_like(state.x)
        rest = self._number(without_memory)
        state.apply()
        return rest + (here - rest) / state.factor

    def _number(self, body: Problem) -> float:
        value = self.observable.value(body)
        if np.size(value) != 1:
            raise InputError("Question.observable", f"of {np.size(value)} numbers", "an observable of one")
        return float(value[0])


Asked = Quantity | Question


def check_questions(asked: Sequence[Asked], scene: Scene, own: Sequence[Question]) -> None:
    """Refuse quantities that are asked twice, and observables of one's own of a wave."""
    labels = [quantity.label for quantity in asked]
    for i, label in enumerate(labels):
        if label in labels[:i]:
            raise InputError("questions", repr(label), "a question that is not asked already")
    if own and scene.time.frequency is not None:
        raise InputError("questions", repr(own[0].label), "none of a body that is shaken: its state is a wave")


def interpolate_state(state: BodyState, body: Problem, factor: float) -> Array:
    """A state's displacements, and the pressures that go with them, as unknowns of another body in the same place."""
    state.apply()
    u = state.displacement() * factor
    body.u.Set(u)
    if body.p is not None and state.body.p is not None:
        body.p.Set(state.body.p * (factor / state.factor))
    elif body.p is not None:
        J = ngs.Det(body.kinematics.gradient(body.u, ngs.Grad(body.u)))
        bulk = body.mesh.MaterialCF({name: material.bulk for name, material in body.materials.items()})
        body.p.Set(bulk * (J - 1))
    return body.load(body.x, factor)


def observable(quantity: Asked, state: BodyState) -> Observable:
    """What a question asks of a body: without the load factor, and for a metre of a section."""
    if isinstance(quantity, Question):
        return quantity.observable
    if quantity.name == "force":
        return Force(str(quantity.boundary), mesh_components(quantity.unit_vector, state.plane))
    if quantity.name == "displacement":
        mesh_point(state.body.mesh, quantity, state.plane)
        return Displacements(
            [mesh_components(quantity.point or (0.0, 0.0, 0.0), state.plane)],
            mesh_components(quantity.unit_vector, state.plane),
        )
    near = None if quantity.radius is None else mesh_components(quantity.point or (), state.plane)
    measure = "small" if state.linear else "Green-Lagrange"
    return StrainPercentile(
        quantity.percentile, quantity.region, near, quantity.radius, BAND, measure=measure, factor=1 / state.factor
    )


def evaluate(quantity: Asked, state: BodyState) -> float:
    """The number that is asked for, in SI units."""
    if isinstance(quantity, Question):
        return quantity.value(state)
    state.apply()
    observed = observable(quantity, state).on(state.body)
    return observed.raw if isinstance(observed, Percentile) else float(observed.value()[0]) * _times(quantity, state)


def gradient(quantity: Asked, state: BodyState) -> Array:
    """How the number changes with the free unknowns of a body (ndof,); of a percentile, its mean over a band."""
    state.apply()
    gradient = observable(quantity, state).gradient(state.body) * _times(quantity, state)
    return np.where(state.body.weights > 0, gradient, 0.0)


def _times(quantity: Asked, state: BodyState) -> float:
    """What an observable is multiplied by: a percentile has the load factor in it."""
    if isinstance(quantity, Question):
        return 1.0 / state.factor
    if quantity.name == "strain":
        return 1.0
    return (state.thickness if quantity.name == "force" else 1.0) / state.factor


def mesh_components(vector: tuple[float, ...], plane: bool) -> tuple[float, ...]:
    """A vector's components that a mesh has."""
    return tuple(vector[i] for i in PLANE) if plane else tuple(vector)


def direction_in_mesh(direction: tuple[float, float, float], plane: bool) -> tuple[float, float, float]:
    """A direction of three components, up to sign, in a mesh's own axes: a section's third is across it, the body's y.

    >>> direction_in_mesh((0.0, 0.6, 0.8), plane=True)
    (0.0, 0.8, 0.6)
    """
    x, y, z = direction
    return (x, z, y) if plane else direction


def reference_size(quantity: Asked, state: BodyState) -> float:
    """What an answer is measured by where it is nearly nothing, as by symmetry: the largest component of the forces that hold and
    load the body (N), the largest displacement (m). A strain is measured by itself, and so is an observable of one's own.
    """
    if isinstance(quantity, Question) or quantity.name == "strain":
        return 0.0
    state.apply()
    body = state.body
    if quantity.name == "displacement":
        nodes = ngs.GridFunction(ngs.VectorH1(body.mesh, order=1))
        nodes.Set(state.displacement())
        return float(np.abs(nodes.vec.FV().NumPy()).max())
    forces = body.tissue_forces()
    spaces = (body.u.space.Range(i) for i in range(body.mesh.dim))
    largest = max(float(np.abs(forces[span.start : span.stop]).sum()) for span in spaces) / 2  # there and back
    return largest * state.thickness / state.factor


def mesh_point(mesh: ngs.Mesh, quantity: Quantity, plane: bool) -> ngs.MeshPoint:
    """The quantity's point; `InputError` for one outside."""
    found = mesh(*mesh_components(quantity.point or (0.0, 0.0, 0.0), plane))
    if found.nr < 0:
        raise InputError("quantity.point_mm", [1e3 * c for c in quantity.point or ()], "a point in the body")
    return found


def quadrature_in_region(mesh: ngs.Mesh, quantity: Quantity) -> tuple[Array, Array]:
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
    centre = mesh_components(quantity.point or (), mesh.dim == 2)
    away = sum((x - c) ** 2 for x, c in zip((ngs.x, ngs.y, ngs.z), centre, strict=False))
    return inside * ngs.IfPos(quantity.radius**2 - away, 1.0, 0.0)
