"""Second derivatives of one time step of the tissue.

With ℓ of `step`, the derivatives with respect to x, h and θ of

    ℓ' = d/ds ( W'(x + s δx; h + s δh, θ + s δθ)[μ] + Λ · U(x + s δx, h + s δh; θ + s δθ) ) ,

after `forms.begin`. `SymbolicTissueHessian` differentiates symbolically. The step of a Maxwell branch is a minimisation: symbolic
second derivatives would cost hundreds of gradients, so `DifferenceTissueHessian` takes central differences of exact first ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce
from operator import add
from typing import NamedTuple

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.forward.common.material import Material
from ngbrain.forward.sensitivity.differences import central_difference
from ngbrain.forward.sensitivity.parameter_blocks import ParameterBlock
from ngbrain.forward.sensitivity.transient.quadrature_blocks import (
    QuadratureBlock,
    entries,
    set_rows,
    unknowns,
    weighted_functions,
)
from ngbrain.forward.sensitivity.transient.step import UNPERTURBED, StepForms
from ngbrain.forward.solid.internal_forces import Density
from ngbrain.materials.base import Deformation

Array = np.ndarray
NONE = np.zeros(0)


class TissueGradients(NamedTuple):
    """Gradients with respect to state, history and parameters.

    Parameters
    ----------
    by_state : array (ndof,)
        By x.
    by_history : array (size, points)
        By h, a density at the points.
    by_theta : array (θ,)
        By θ, one parameter after the other.
    """

    by_state: Array
    by_history: Array
    by_theta: Array


class SymbolicTissueHessian:
    """Symbolic derivatives of ℓ', for hereditary branches."""

    def __init__(self, forms: StepForms) -> None:
        self._forms, body = forms, forms.body
        self._motion, self._way = ngs.GridFunction(body.fes), ngs.GridFunction(body.fes)
        self._r, self._s = ngs.Parameter(0.0), ngs.Parameter(0.0)
        densities = {p: self._density(m) for p, m in body.materials.items()}
        self._by_state = forms.nodal_forces(densities)
        self._back = body.mesh.MaterialCF({p: self._derived(m) for p, m in body.materials.items()})

    def set_direction(self, state: Array, history: Array, theta: Mapping[str, Array]) -> None:
        """Set the direction of ℓ'.

        Parameters
        ----------
        state : array (ndof,)
            δx.
        history : array (size, points)
            δh.
        theta : dict of str to array
            δθ.
        """
        unknowns(self._way)[:] = state[: self._forms.body.fes.ndof]
        self._forms.set_direction(history, theta)

    def __call__(self, motion: Array, weights: Array) -> TissueGradients:
        """Gradients of ℓ', with μ and Λ."""
        unknowns(self._motion)[:] = motion
        set_rows(self._forms.blocks, "weight", weights)
        by_history, by_theta = np.split(self._forms.points(self._back)[1:], [self._forms.size])
        return TissueGradients(
            self._by_state(), by_history, np.concatenate([NONE, *self._forms.assemble_gradient(by_theta).values()])
        )

    def _density(self, material: Material) -> Density:
        return lambda at, p: self._turned(self._work(material, at.F, p))

    def _derived(self, material: Material) -> CoefficientFunction:
        """ℓ' by history and parameters."""
        work = self._work(material, self._forms.deformation_gradient(self._forms.body.u), self._forms.p)
        turned, slopes = self._turned(work), zip(*map(self._forms.parameter_derivatives, work), strict=True)
        by_history = [turned.Diff(block.variable) for block in self._forms.blocks]
        return ngs.CF((0.0, *by_history, *(self._turned(slope) for slope in slopes))).Compile()

    def _turned(self, work: tuple[CoefficientFunction, ...]) -> CoefficientFunction:
        """ℓ' from `_work`, or from its derivative with respect to a parameter.

        Parameters are differentiated first, where the expression is smallest.
        """

        def whole(energy: CoefficientFunction, kept: CoefficientFunction) -> CoefficientFunction:
            return energy.Diff(self._r) + kept

        return whole(*work).Diff(self._s) + whole(*map(self._forms.directional_derivative, work))

    def _work(
        self, material: Material, F: CoefficientFunction, p: CoefficientFunction | None
    ) -> tuple[CoefficientFunction, CoefficientFunction]:
        """W as a function of r, the amplitude of μ, and of s; and Λ · U as a function of s, at a state."""
        forms, way = self._forms, (self._s, self._way)
        energies = forms.energies(material, *forms.perturbed_state(F, p, (self._r, self._motion), way), self._seen)
        updates = forms.updates(material, forms.perturbed_state(F, p, way)[0].shape, self._seen)
        kept = (part.value for part in weighted_functions(forms.blocks, updates))
        return reduce(add, (part.value for part in energies)), reduce(add, kept, ngs.CF(0.0))

    def _seen(self, block: QuadratureBlock) -> CoefficientFunction:
        return block.variable + self._s * entries(block.change)


class DifferenceTissueHessian:
    """Derivatives of ℓ' by central differences, for any branches.

    Parameters
    ----------
    forms : StepForms
        First derivatives of the step.
    parts : dict of str to ParameterBlock
        Parameters of the materials.
    """

    def __init__(self, forms: StepForms, parts: Mapping[str, ParameterBlock]) -> None:
        self._forms, self._parts, body = forms, parts, forms.body
        self._motion, self._way, self._r = ngs.GridFunction(body.fes), ngs.GridFunction(body.fes), ngs.Parameter(0.0)
        densities = {p: self._density(m) for p, m in body.materials.items()}
        self._stretched = forms.nodal_forces(densities)
        self._begun = body.mesh.MaterialCF({p: self._beginning(m) for p, m in body.materials.items()})
        way = body.layout.fields(self._way).u
        self._gradient = body.kinematics.change(way, ngs.Grad(way)).Reshape((9,)).Compile()

    def set_direction(self, state: Array, history: Array, theta: Mapping[str, Array]) -> None:
        """Set the direction of ℓ'.

        Parameters
        ----------
        state : array (ndof,)
            δx.
        history : array (size, points)
            δh.
        theta : dict of str to array
            δθ.
        """
        unknowns(self._way)[:] = state[: self._forms.body.fes.ndof]
        self._ways = state, history, theta
        steps = [
            self._forms.points(self._gradient),
            history[self._forms.strains],
            *(self._relative(name, theta[name]) for name in self._parts),
        ]
        self._size = max(float(np.max(np.abs(step), initial=0.0)) for step in steps)

    def __call__(self, motion: Array, weights: Array) -> TissueGradients:
        """Gradients of ℓ', with μ and Λ."""
        forms, body, theta = self._forms, self._forms.body, {n: part.value for n, part in self._parts.items()}
        unknowns(self._motion)[:] = motion
        state, history, branches = body.x, forms.history, body.history.maxwell.branches
        way, back, by = self._ways

        def set_state(s: float) -> None:
            for name, part in self._parts.items():
                part.set_value(theta[name] + s * by[name])
            body.x = state + s * way
            set_rows(forms.blocks, "value", history + s * back)
            begun, shapes = forms.points(self._begun)[1:], body.history.shapes()
            for branch, found in zip(branches, begun.reshape(len(branches), 12, begun.shape[1]), strict=True):
                branch.resume_step(found[2:], found[:2])
                branch.relax(shapes)
            forms.read_maxwell_states()

        def slopes(s: float) -> Array:
            set_state(s)
            by_history, by_theta = forms.adjoint_gradients(motion, weights)
            return np.concatenate(
                [self._stretched() + forms.history_state_gradient(weights), by_history.ravel(), *by_theta.values()]
            )

        found = central_difference(slopes, self._size)
        set_state(0.0)
        by_state, by_history, by_theta = np.split(found, np.cumsum([body.fes.ndof, history.size]))
        return TissueGradients(by_state, by_history.reshape(history.shape), by_theta)

    def _relative(self, name: str, way: Array) -> Array:
        return way / (np.max(np.abs(self._parts[name].value)) or 1.0)

    def _beginning(self, material: Material) -> CoefficientFunction:
        """Start of the branches: strains, G and κ; at rest where a region has fewer branches."""
        found = [ngs.CF((*begun.strain, begun.value)) for begun in self._forms.maxwell_starts(material, UNPERTURBED)]
        at_rest = ngs.CF((0.0, 0.0, ngs.Id(3).Reshape((9,)), 0.0))
        missing = len(self._forms.body.history.maxwell.branches) - len(found)
        return ngs.CF((0.0, *found, *[at_rest] * missing)).Compile()

    def _density(self, material: Material) -> Density:
        """W' along μ."""

        def work(at: Deformation, p: CoefficientFunction | None) -> CoefficientFunction:
            moved = self._forms.perturbed_state(at.F, p, (self._r, self._motion))
            return reduce(add, (part.value for part in self._forms.energies(material, *moved, UNPERTURBED))).Diff(
                self._r
            )

        return work
