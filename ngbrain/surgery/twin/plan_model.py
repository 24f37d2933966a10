"""A surgical plan as a differentiable model of one patient's parameters.

The factor of a tissue's moduli and viscosities at x is exp(t + φ(x)), with a number t for each tissue and one field φ, in which
differences between places are; exponents of Ogden's laws and relaxation times have a factor each. The run at the prior's centre
gives the times of its steps, and one adjoint run for each measure the gradient of its logarithm with respect to t, φ and both
factors (`RunModel`): what any draw of the patient does to it, to first order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.adjoint.derived import Dose
from ngbrain.adjoint.time_curve import Interpolation
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.materials import Ogden, Viscous
from ngbrain.materials.base import Law, Scaled, Sum, Value
from ngbrain.materials.families import stiffen
from ngbrain.materials.maxwell import Maxwell
from ngbrain.materials.viscous import Branch
from ngbrain.parallel import Callback
from ngbrain.scene import Tissue
from ngbrain.solvers.newton import Newton
from ngbrain.surgery.answers import Answer, answer
from ngbrain.surgery.measures.observer import retraction_observables
from ngbrain.surgery.model import RetractionModel
from ngbrain.surgery.protocol_run import ProtocolRun
from ngbrain.surgery.twin import prior
from ngbrain.surgery.twin.prior import Prior
from ngbrain.surgery.twin.response import DOSE, FORCE, MEASURES, PRESSURE, STRAIN, Response
from ngbrain.surgery.twin.stiffness import RelativeStiffness, lesion_shape

Array = np.ndarray
STEPS = 8
"""Number of time steps of a linearised run: a gradient of a logarithm needs fewer than a value, and whole runs check it."""
FIELD = "field"
"""Name of the parameter φ among those of a run."""
CONVERGED = Newton(rtol=1e-7, xtol=1e-7, max_iter=80)
"""Newton's method of the linearised run: its residual is an error of the gradients."""


class PlanModel:
    """One plan of one patient.

    Parameters
    ----------
    name : str
    model : RetractionModel
        Mesh and scene of the plan, with one protocol.
    stiffness : RelativeStiffness
    patient : Prior
    """

    def __init__(self, name: str, model: RetractionModel, stiffness: RelativeStiffness, patient: Prior) -> None:
        self.name, self.model, self.stiffness, self.patient = name, model, stiffness, patient
        self.protocol = model.program(model.scene, model.scene.protocols[0])
        self.field = ngs.GridFunction(ngs.H1(model.mesh, order=1))
        self.tissues = {tissue.region: ngs.Parameter(0.0) for tissue in model.scene.tissues}
        self.stiffening, self.relaxation = ngs.Parameter(0.0), ngs.Parameter(0.0)
        self.nodes = np.array([vertex.point for vertex in model.mesh.vertices])

    @property
    def parameters(self) -> dict[str, Any]:
        """Parameters of the run by name; their values one after the other are θ."""
        return {**self.tissues, prior.STIFFENING: self.stiffening, prior.RELAXATION: self.relaxation, FIELD: self.field}

    @cached_property
    def _weights(self) -> Array:
        return self.stiffness.weights(self.nodes) * self.stiffness.deviations()

    @cached_property
    def _balls(self) -> dict[str, Array]:
        return {prior.LESION + each.name: lesion_shape(each, self.nodes) for each in self.stiffness.lesion_priors}

    def theta(self, draw: Array) -> Array:
        """θ of a draw of the patient.

        Parameters
        ----------
        draw : (numbers,) array
            Values of the prior's numbers.

        Returns
        -------
        (size,) array
        """
        given = dict(zip(self.patient.names, draw, strict=True))
        exponent = given[prior.LINK]
        tissues = [
            given[prior.LEVEL] + given[prior.TISSUE + name] - exponent * self.stiffness.log_norm(name)
            for name in self.tissues
        ]
        shift = np.array([given.get(name, 0.0) for name in prior.SHIFT])
        errors = np.array([given[f"{prior.PLACE}{k}"] for k in range(self._weights.shape[1])])
        field = exponent * (self.stiffness.log_map(self.nodes, shift) + self._weights @ errors)
        for name, ball in self._balls.items():
            field = field + given[name] * ball
        return np.concatenate([tissues, [given[prior.STIFFENING], given[prior.RELAXATION]], field])

    def set_theta(self, theta: Array) -> None:
        """Give the materials the values of θ."""
        numbers = [*self.tissues.values(), self.stiffening, self.relaxation]
        for parameter, value in zip(numbers, theta, strict=False):
            parameter.Set(float(value))
        self.field.vec.FV().NumPy()[:] = theta[len(numbers) :]

    def materials(self) -> Mapping[str, Any]:
        """Materials that depend on the parameters."""
        return self.model.materials_from_laws(self._law)

    def _law(self, tissue: Tissue, law: Viscous) -> Viscous:
        exponent = self.tissues[tissue.region]
        inner = exponent + self.field if self.stiffness.normal[tissue.region] is not None else exponent
        return change_law(stiffen(law, ngs.exp(inner)), ngs.exp(self.stiffening), ngs.exp(self.relaxation))

    def run(self, draw: Array, callback: Callback | None = None) -> Answer:
        """The answer of a whole nonlinear run with a draw of the patient.

        Parameters
        ----------
        draw : (numbers,) array
        callback : callable, optional
            As of `ProtocolRun.run`.

        Returns
        -------
        dict
            As of `surgery.answers.answer`.
        """
        self.set_theta(self.theta(draw))
        done = ProtocolRun(self.model, self.protocol, None, materials=dict(self.materials())).run(callback)
        return answer(done.result(), self.model.scene.patient)

    def linearise(self, found: Answer, steps: int = STEPS) -> Response:
        """Gradients of the logarithms of the measures at the prior's centre.

        Parameters
        ----------
        found : dict
            The answer there, of `run`.
        steps : int
            Number of time steps of the linearised run: those of `found`, thinned out.

        Returns
        -------
        Response
        """
        self.model.check_rest()
        centre = self.theta(self.patient.centre)
        self.set_theta(centre)
        stepper = self.model.run(self.protocol, materials=dict(self.materials()))
        every = retraction_observables(stepper.problem, self.model.blades, self.model.parts())
        asked = [every[key] for key in ("pressure", "force", "mps_p95")]
        assert stepper.motion is not None  # a blade moves
        grid = coarse_grid(np.array(found["series"]["t_s"]), self.protocol.times, steps)
        run = RunModel(stepper.problem, stepper.motion, grid, self.parameters, asked, newton=CONVERGED)
        linear = run.evaluate(centre)
        dose = Dose(run.times, Interpolation.MONOTONE_CUBIC, found["events_s"])
        weights = {
            PRESSURE: _weigh_peak(linear.data, 0),
            FORCE: _weigh_peak(linear.data, 1),
            STRAIN: _weigh_peak(linear.data, 2),
            DOSE: _weigh_dose(linear.data, dose),
        }
        gradients = linear.gradients([weights[key] for key in MEASURES])
        values = {key: float(found[key]) for key in MEASURES}
        return Response(values, centre, dict(zip(MEASURES, gradients, strict=True)), self.nodes)


def coarse_grid(times: Array, events: Sequence[float], steps: int) -> Array:
    """Times of fewer steps: all events, and of the others as many as there is room for, evenly among the given ones.

    Parameters
    ----------
    times : (n,) array
        Ends of steps (s), from 0.
    events : sequence of float
        Times (s) at which the tool's rate changes.
    steps : int

    Returns
    -------
    array

    Examples
    --------
    >>> coarse_grid(np.arange(11.0), (0.0, 5.0, 10.0), 4).tolist()
    [0.0, 3.0, 5.0, 8.0, 10.0]
    """
    kept = np.min(np.abs(times[:, None] - np.asarray(events)[None]), axis=1) <= 1e-9 * times[-1]
    kept[[0, -1]] = True
    others = np.flatnonzero(~kept)
    room = min(max(steps + 1 - int(kept.sum()), 0), len(others))
    kept[others[((np.arange(room) + 0.5) * len(others) / max(room, 1)).astype(int)]] = True
    return np.asarray(times[kept])


def _weigh_peak(data: Array, column: int) -> Array:
    """Derivative of ln of the largest value of a column with respect to the data."""
    row, weights = int(np.argmax(data[:, column])), np.zeros_like(data)
    weights[row, column] = 1 / data[row, column]
    return weights


def _weigh_dose(data: Array, dose: Dose) -> Array:
    """Derivative of ln of the dose of the first column with respect to the data."""
    weights = np.zeros_like(data)
    weights[:, 0] = dose.gradient(data)[:, 0] / dose.value(data)[0]
    return weights


def change_law(law: Viscous, stiffening: Value, relaxation: Value) -> Viscous:
    """A law with other exponents and relaxation times; laws without exponents keep how they stiffen.

    Parameters
    ----------
    law : Viscous
    stiffening : float or CoefficientFunction
        Factor of the exponents of Ogden's terms; moduli stay.
    relaxation : float or CoefficientFunction
        Factor of all relaxation times.

    Returns
    -------
    Viscous

    Examples
    --------
    >>> from ngbrain.materials import Prony
    >>> change_law(Prony(Ogden(900.0, -20.0), [0.5], [3.0]), 0.5, 2.0).branches[0]
    Branch(law=Scaled(law=Ogden(mu=900.0, alpha=-10.0), factor=0.5), tau=6.0)
    """

    def branch(of: Branch | Maxwell) -> Branch | Maxwell:
        inner = _bend(of.law, stiffening)
        return Maxwell(inner, relaxation * of.eta) if isinstance(of, Maxwell) else Branch(inner, relaxation * of.tau)

    return Viscous(_bend(law.equilibrium, stiffening), tuple(map(branch, law.branches)))


def _bend(law: Law, factor: Value) -> Law:
    if isinstance(law, Ogden):
        many = isinstance(law.alpha, list | tuple | np.ndarray)
        return Ogden(law.mu, tuple(factor * each for each in law.alpha) if many else factor * law.alpha)  # type: ignore[union-attr,operator]
    if isinstance(law, Scaled):
        return replace(law, law=_bend(law.law, factor))
    return Sum(tuple(_bend(part, factor) for part in law.parts)) if isinstance(law, Sum) else law
