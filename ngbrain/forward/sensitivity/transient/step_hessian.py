"""Second derivatives of one time step.

With ℓ of `step`, the contacts' work C and observables q beside the tissue's forces, for a motion λ + Zᵀw of the tissue and λ of the
contacts, weights Λ, and directions (δx, δh, δθ), they are the derivatives with respect to x, h and θ of

    ℓ' = d/ds ( W'(x + s δx; h + s δh, θ + s δθ)[λ + Zᵀw] + Λ · U(x + s δx, h + s δh; θ + s δθ) + C(x + s δx; θ + s δθ)[λ]
                + w · q(x + s δx; θ + s δθ) ) .

Those of C and q are symbolic; those of the tissue are in `tissue_hessian`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.contact.rigid import SelfContact
from ngbrain.forward.sensitivity.contact_work import ContactForms
from ngbrain.forward.sensitivity.parameter_blocks import ParameterBlock
from ngbrain.forward.sensitivity.transient.quadrature_blocks import unknowns
from ngbrain.forward.sensitivity.transient.run_observables import RunObservables
from ngbrain.forward.sensitivity.transient.step import StepForms
from ngbrain.forward.sensitivity.transient.tissue_hessian import (
    DifferenceTissueHessian,
    SymbolicTissueHessian,
    TissueGradients,
)
from ngbrain.forward.solid.virtual_work import Motion, Terms, vector

Array = np.ndarray


class StepHessian:
    """Second derivatives of time steps, after `forms.begin`.

    Parameters
    ----------
    forms : StepForms
        First derivatives of the tissue's step.
    parts : dict of str to ParameterBlock
        Blocks of θ.
    contacts : ContactForms
        Virtual work of contacts and loads.
    observables : RunObservables
        Observables.

    Raises
    ------
    InputError
        For self-contact.
    """

    def __init__(
        self, forms: StepForms, parts: Mapping[str, ParameterBlock], contacts: ContactForms, observables: RunObservables
    ) -> None:
        self._parts, self._contacts, self._observables, body = list(parts.values()), contacts, observables, forms.body
        self._mesh = body.mesh
        if any(isinstance(contact, SelfContact) for contact in body.contacts):
            raise InputError("body", "with self-contact", "a body without it, for second derivatives of a run")
        of_tissue = {name: parts[name] for name in forms.parameters}
        self._tissues = (
            DifferenceTissueHessian(forms, of_tissue) if body.history.maxwell else SymbolicTissueHessian(forms)
        )
        self._direction = ngs.GridFunction(body.fes)
        touched = self._contact_and_observable_part()
        self._by_state = vector(body.fes, self._contact_and_observable_part(body.fes.TestFunction()))
        self._by_theta = [part.gradient(touched, body.mesh) for part in self._parts]

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
        unknowns(self._direction)[:] = state[: len(unknowns(self._direction))]
        self._tissues.set_direction(state, history, theta)
        for part, way in zip(self._parts, theta.values(), strict=True):
            part.set_direction(way)
        self._observables.set_direction(np.array(unknowns(self._direction)), self._change)

    def __call__(self, adjoint: Array, motion: Array, weights: Array) -> TissueGradients:
        """Gradients of ℓ' with respect to x, h and θ, with λ, λ + Zᵀw and Λ."""
        self._contacts.set_adjoint(adjoint)
        by_state, by_history, by_theta = self._tissues(motion, weights)
        of_contacts = np.concatenate([slope() for slope in self._by_theta])
        of_contacts[: len(by_theta)] += by_theta
        return TissueGradients(by_state + self._by_state(), by_history, of_contacts)

    def _contact_and_observable_part(self, *test_args: Motion) -> Terms:
        """Part of ℓ' of contacts and observables, or its derivative along a test function."""
        at_state = self._contacts.weighted_work(*test_args) + self._observables.terms(*test_args)
        parameter_change = [term for part in self._parts for term in part.directional_derivative(at_state)]
        change_along = self._contacts.weighted_work(self._direction, *test_args) + self._observables.terms(
            self._direction, *test_args
        )
        return change_along + parameter_change + self._observables.weight_terms(*test_args)

    def _change(self, parts: Terms) -> Callable[[], float]:
        """Derivative along the direction of θ."""
        integrals = [term.integral for part in self._parts for term in part.directional_derivative(parts)]
        return lambda: sum(float(ngs.Integrate(part, self._mesh)) for part in integrals)
