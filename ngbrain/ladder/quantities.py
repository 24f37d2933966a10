"""Requested quantities of a solved body: forces, displacements, strain percentiles, and any observable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.observables import Displacements, Force, Observable, StrainPercentile
from ngbrain.forward.observables.percentiles import ProblemPercentile
from ngbrain.forward.solid.problem import Problem
from ngbrain.io import Frame, QuadraticGrid, save
from ngbrain.look import BriefText
from ngbrain.materials.base import check_parameter
from ngbrain.scene import Quantity, Scene

Array = np.ndarray
BAND = 0.1
"""Half width of the band of a smoothed percentile, as a fraction of the volume."""
PLANE = (0, 2)
"""Axes of the body that a section has."""


@dataclass(frozen=True, eq=False, repr=False)
class BodyState(BriefText):
    """A solved state of a body.

    Parameters
    ----------
    body : Problem
    x : (ndof,) array
        Its unknowns.
    factor : float
        Load factor of the state; small strains at full load are 1/factor times as large.
    linear : bool
        Whether strains are small.
    thickness : float
        Thickness (m) of a section, else 1.
    without_memory : Problem, optional
        The same elastic body, because a viscoelastic one keeps stresses after a motion.
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
        """Set the body to this state."""
        self.body.load(self.x, self.factor)
        self.body.x = self.x

    def displacement(self) -> ngs.CoefficientFunction:
        """Displacement at full load (m)."""
        return self.body.u / self.factor


BODY = "body.vtkhdf"
"""File of the deformed body."""


def deformed_state(states: Mapping[str, BodyState]) -> BodyState | None:
    """The last state of a body in space; None without one."""
    last = states.get("end") or next(iter(states.values()), None)
    return None if last is None or last.plane else last


def write_state(path: Path, state: BodyState) -> None:
    """Write a deformed body for ParaView: displacement (m) at full load, and the largest principal strain (of Green).

    Parameters
    ----------
    path : Path
        File that ends in .vtkhdf.
    state : BodyState
        A state of a body in space.
    """
    state.apply()
    grid = QuadraticGrid(state.body.mesh)
    moved = state.displacement()
    gradient = grid.values(ngs.Grad(state.body.u) / state.factor).reshape(-1, 3, 3)
    strain = (gradient + gradient.transpose(0, 2, 1)) / 2
    if not state.linear:
        strain = strain + gradient.transpose(0, 2, 1) @ gradient / 2
    largest = np.linalg.eigvalsh(strain)[:, 2]
    save(path, grid, [Frame(0.0, {"displacement": grid.values(moved), "max_principal_strain": largest})])


WHEN = ("end", "ramp")
"""Times of a question, see `scene.Quantity`."""


@dataclass(frozen=True, eq=False)
class Question:
    """An observable that a model ladder evaluates for every model, in addition to the scene's quantities.

    It applies to bodies in space only: a section has no y. For small strain it is linearised: Q(0) + Q'(0) u.

    Parameters
    ----------
    observable : Observable
        A scalar with a gradient, from `ngbrain.forward.observables` or your own.
    tolerance : float
        Relative tolerance of its value.
    when : str
        "end", or "ramp": when the loads have reached their full size.

    Raises
    ------
    InputError
        No observable, a tolerance outside 0.0001 to 1, or another time.

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
        """Description, as for quantities of a scene."""
        return f"{self.observable.name}, {self.when}"

    def value(self, state: BodyState) -> float:
        """Value at full load; linearised for small strain."""
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
            raise InputError("Question.observable", f"of {np.size(value)} numbers", "a scalar observable")
        return float(value[0])


Asked = Quantity | Question


def check_questions(asked: Sequence[Asked], scene: Scene, own: Sequence[Question]) -> None:
    """Refuse quantities that are asked twice, and observables of a harmonic problem.

    Parameters
    ----------
    asked : sequence of Quantity or Question
        All of them.
    scene : Scene
    own : sequence of Question

    Raises
    ------
    InputError
        A repeated question, or one that does not apply.
    """
    labels = [quantity.label for quantity in asked]
    for i, label in enumerate(labels):
        if label in labels[:i]:
            raise InputError("questions", repr(label), "a quantity that is requested once")
    if own and scene.time.frequency is not None:
        raise InputError(
            "questions", repr(own[0].label), "none in a harmonic problem, whose state is a complex amplitude"
        )


def interpolate_state(state: BodyState, body: Problem, factor: float) -> Array:
    """Interpolate a state's displacement and pressure to the unknowns of another body in the same place.

    Parameters
    ----------
    state : BodyState
    body : Problem
    factor : float
        Load factor of the result.

    Returns
    -------
    (ndof,) array
    """
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
    """The observable of a quantity; without the load factor, and per metre of a section's thickness.

    Parameters
    ----------
    quantity : Quantity or Question
    state : BodyState

    Returns
    -------
    Observable
    """
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
    """Value of a quantity in a state.

    Parameters
    ----------
    quantity : Quantity or Question
    state : BodyState

    Returns
    -------
    float
        SI units.
    """
    if isinstance(quantity, Question):
        return quantity.value(state)
    state.apply()
    observed = observable(quantity, state).on(state.body)
    return (
        observed.raw
        if isinstance(observed, ProblemPercentile)
        else float(observed.value()[0]) * _times(quantity, state)
    )


def gradient(quantity: Asked, state: BodyState) -> Array:
    """Derivative of a quantity by the free unknowns of a body; for a percentile, of its mean over a band.

    Parameters
    ----------
    quantity : Quantity or Question
    state : BodyState

    Returns
    -------
    (ndof,) array
    """
    state.apply()
    gradient = observable(quantity, state).gradient(state.body) * _times(quantity, state)
    return np.where(state.body.weights > 0, gradient, 0.0)


def _times(quantity: Asked, state: BodyState) -> float:
    """Factor of an observable; a percentile already contains the load factor."""
    if isinstance(quantity, Question):
        return 1.0 / state.factor
    if quantity.name == "strain":
        return 1.0
    return (state.thickness if quantity.name == "force" else 1.0) / state.factor


def mesh_components(vector: tuple[float, ...], plane: bool) -> tuple[float, ...]:
    """Components of a vector that a mesh has.

    Parameters
    ----------
    vector : tuple of float
        x, y, z.
    plane : bool
        Whether the mesh is the section y = 0.

    Returns
    -------
    tuple of float
    """
    return tuple(vector[i] for i in PLANE) if plane else tuple(vector)


def direction_in_mesh(direction: tuple[float, float, float], plane: bool) -> tuple[float, float, float]:
    """A direction, up to sign, in the axes of a mesh; the third axis of a section is the body's y.

    Parameters
    ----------
    direction : tuple of float
    plane : bool
        Whether the mesh is the section y = 0.

    Returns
    -------
    tuple of float

    Examples
    --------
    >>> direction_in_mesh((0.0, 0.6, 0.8), plane=True)
    (0.0, 0.8, 0.6)
    """
    x, y, z = direction
    return (x, z, y) if plane else direction


def reference_size(quantity: Asked, state: BodyState) -> float:
    """Reference size of a quantity whose value is nearly zero, for example by symmetry.

    Parameters
    ----------
    quantity : Quantity or Question
    state : BodyState

    Returns
    -------
    float
        For a force, the largest component of the reaction and load forces (N); for a displacement, the largest displacement (m);
        0 for strains and observables of your own.
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
    largest = (
        max(float(np.abs(forces[span.start : span.stop]).sum()) for span in spaces) / 2
    )  # sets the state, and restores it
    return largest * state.thickness / state.factor


def mesh_point(mesh: ngs.Mesh, quantity: Quantity, plane: bool) -> ngs.MeshPoint:
    """The point of a quantity in a mesh.

    Parameters
    ----------
    mesh : ngs.Mesh
    quantity : Quantity
    plane : bool
        Whether the mesh is the section y = 0.

    Returns
    -------
    ngs.MeshPoint

    Raises
    ------
    InputError
        A point outside of the body.
    """
    found = mesh(*mesh_components(quantity.point or (0.0, 0.0, 0.0), plane))
    if found.nr < 0:
        raise InputError("quantity.point_mm", [1e3 * c for c in quantity.point or ()], "a point in the body")
    return found


def quadrature_in_region(mesh: ngs.Mesh, quantity: Quantity) -> tuple[Array, Array]:
    """Quadrature points in a quantity's regions and radius.

    Parameters
    ----------
    mesh : ngs.Mesh
    quantity : Quantity

    Returns
    -------
    points : array of ngs.MeshPoint
    weights : array
        Volumes that they represent (area in a section).

    Raises
    ------
    InputError
        There are none.
    """
    (shape,) = {element.type for element in mesh.Elements()}
    rule = ngs.IntegrationRule(shape, 2)
    points = mesh.MapToAllElements({shape: rule}, ngs.VOL)
    volume = _within(mesh, quantity) * ngs.Det(ngs.specialcf.JacobianMatrix(mesh.dim))
    weights = np.tile(np.array(rule.weights), mesh.ne) * np.abs(np.array(volume(points)).ravel())
    if not (weights > 0).any():
        raise InputError(
            "quantity.region", repr(quantity.region), "a region and a radius that contain some of the body"
        )
    return points[weights > 0], weights[weights > 0]


def _within(mesh: ngs.Mesh, quantity: Quantity) -> ngs.CoefficientFunction:
    """1 in the quantity's regions and within its radius, else 0."""
    inside = mesh.MaterialCF({quantity.region: 1.0}, default=0.0)
    if quantity.radius is None:
        return inside
    centre = mesh_components(quantity.point or (), mesh.dim == 2)
    away = sum((x - c) ** 2 for x, c in zip((ngs.x, ngs.y, ngs.z), centre, strict=False))
    return inside * ngs.IfPos(quantity.radius**2 - away, 1.0, 0.0)
