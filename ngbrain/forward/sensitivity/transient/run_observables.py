"""Observables at the end of a time step, and their derivatives with respect to state and parameters.

Forces are Z f(x; h, θ) + Z c(x; θ), with nodal forces f of the tissue, which depend on internal variables, and c of contacts and
loads on other boundaries; other observables are q(x; θ).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import scipy.sparse as sp

from ngbrain.errors import InputError
from ngbrain.forward.observables.base import Along, Observable, ProblemObservable
from ngbrain.forward.observables.force import Reaction
from ngbrain.forward.sensitivity.contact_work import ContactForms
from ngbrain.forward.sensitivity.node_positions import NodePositions
from ngbrain.forward.sensitivity.parameter_blocks import ParameterBlock, block_slices
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import Motion, Terms

Array = np.ndarray


class RunObservables:
    """Observables of one body.

    Parameters
    ----------
    body : Problem
        The body.
    observables : sequence of Observable
        Observables of its state.
    parts : dict of str to ParameterBlock
        Blocks of θ.

    Attributes
    ----------
    size : int
        Length of a row of data.
    slices : list of slice
        Where each observable is in a row.
    motions : csr_array (size, ndof)
        Z; rows of observables that are no forces are zero.

    Raises
    ------
    InputError
        For node positions where an observable has no derivative with respect to them.
    """

    def __init__(self, body: Problem, observables: Sequence[Observable], parts: Mapping[str, ParameterBlock]) -> None:
        self.body, self.each = body, [observable.on(body) for observable in observables]
        self.slices = block_slices([of.size for of in self.each])
        self.size = sum(of.size for of in self.each)
        rows = [of.motions if of.motions is not None else np.zeros((of.size, body.fes.ndof)) for of in self.each]
        self.motions = sp.csr_array(np.vstack(rows))
        self._outer = [_Outer(of, parts) for of in self.each]
        self._n_theta = sum(part.size for part in parts.values())

    def value(self) -> Array:
        """Data at the body's state (size,)."""
        tissue = self.body.tissue_forces() if self.motions.nnz else None
        return np.concatenate([of.value(tissue) if isinstance(of, Reaction) else of.value() for of in self.each])

    def state_gradient(self, weights: Array, stiffness: Callable[[Array], Array]) -> Array:
        """Gradient of weights · value with respect to the state.

        Parameters
        ----------
        weights : array (size,)
            Weights.
        stiffness : callable
            Product with the tangent at that state.

        Returns
        -------
        array (ndof,)
        """
        found = np.zeros(self.body.fes.ndof)
        for of, where in zip(self.each, self.slices, strict=True):
            if not weights[where].any():
                continue
            if isinstance(of, Reaction):
                motion = weights[where] @ of.motions
                found += stiffness(motion) - of.own_stiffness(motion)
            else:
                found += of.gradient(weights[where])
        return found

    def parameter_gradient(self, weights: Array) -> Array:
        """Gradient of weights · value with respect to θ, without that of the tissue's forces."""
        found = np.zeros(self._n_theta)
        for outer, where in zip(self._outer, self.slices, strict=True):
            if weights[where].any():
                found += outer.parameter_gradient(weights[where])
        return found

    def rows(self, stiffness: Callable[[Array], Array]) -> tuple[Array, Array]:
        """Both gradients for each number: (size, ndof) and (size, θ)."""
        units = np.eye(self.size)
        return np.array([self.state_gradient(w, stiffness) for w in units]), np.array(
            [self.parameter_gradient(w) for w in units]
        )

    def set_weights(self, weights: Array) -> None:
        """Set the weights of `terms`."""
        for outer, where in zip(self._outer, self.slices, strict=True):
            outer.set_weights(weights[where])

    def terms(self, *along: Motion) -> Terms:
        """Integrals of weights · value, or their derivative along motions, without the tissue's forces."""
        return [term for outer in self._outer for term in outer.terms(*along)]

    def set_direction(self, change: Array, along: Along) -> None:
        """Set the direction of `weight_terms`.

        Parameters
        ----------
        change : array (ndof,)
            Change of the state.
        along : callable
            From integrals to a callable that gives their change with the parameters.
        """
        for of in self.each:
            of.set_direction(change, along)

    def weight_terms(self, *along: Motion) -> Terms:
        """Integrals of `terms` with the change of weights inside observables along the direction."""
        return [term for of in self.each for term in of.weight_change(self.body.gfu, *along)]


class _Outer:
    """One observable without the tissue's forces."""

    def __init__(self, observed: ProblemObservable, parts: Mapping[str, ParameterBlock]) -> None:
        self._observed, body = observed, observed.problem
        self._forms: ContactForms | None = None
        self._slopes: list[Callable[[], Array]] = []
        self._none = np.zeros(sum(part.size for part in parts.values()))
        if isinstance(observed, Reaction):
            loads, contacts = observed.elsewhere
            observed.check_apart_from_friction()
            if loads or contacts:
                self._forms = ContactForms(body, parts, loads, contacts)
            return
        shapes = any(isinstance(part, NodePositions) for part in parts.values())
        if shapes and not (observed.symbolic and observed.has_shape_derivative):
            raise InputError(
                "parameters",
                "of type NodePositions",
                f"others: {type(observed).__name__} has no shape derivative",
            )
        if observed.symbolic:
            self._slopes = [part.gradient(observed.functional(body.gfu), body.mesh) for part in parts.values()]

    def set_weights(self, weights: Array) -> None:
        if isinstance(self._observed, Reaction):
            if self._forms is not None:
                self._forms.set_adjoint(weights @ self._observed.motions)
        elif self._observed.symbolic:
            self._observed.set_weights(weights)

    def parameter_gradient(self, weights: Array) -> Array:
        self.set_weights(weights)
        if self._forms is not None:
            return self._forms.parameter_gradient()
        return np.concatenate([slope() for slope in self._slopes]) if self._slopes else self._none

    def terms(self, *along: Motion) -> Terms:
        if isinstance(self._observed, Reaction):
            return [] if self._forms is None else self._forms.weighted_work(*along)
        if not self._observed.has_second_derivative:
            raise InputError(
                type(self._observed).__name__, "without second derivatives", "an observable that is an integral"
            )
        return self._observed.functional(self._observed.problem.gfu, *along)
