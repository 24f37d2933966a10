"""Virtual work of a body's contacts and loads by symbols: how it changes with what they are made of, and with the state."""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce
from numbers import Real

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import InputError
from ngbrain.forward.common.loads import CavityVolume, Pressure
from ngbrain.forward.contact.rigid import Closing, Contact, Sliding
from ngbrain.forward.sensitivity.parameter_blocks import Block
from ngbrain.forward.sensitivity.virtual_work import Motion, Term, Terms, by, terms
from ngbrain.forward.solid.problem import Problem

Array = np.ndarray


class ContactForms:
    """C(x; θ)[λ] of the loads of `body` and the contacts that a rigid body makes, at the body's state, with θ in `parts`.

    Walls that close on each other have no part in it; `InputError` where their penalty or softness is no number.
    """

    def __init__(self, body: Problem, parts: Mapping[str, Block]) -> None:
        self._loads = [load for load in body.loads if not isinstance(load, (Pressure, CavityVolume))]
        for load in body.loads:
            if load not in self._loads:
                raise InputError(
                    "loads", type(load).__name__, "loads with an energy of the displacement, for derivatives of a run"
                )
        for contact in body.contacts:
            if isinstance(contact, Closing):
                for name in ("penalty", "softness"):
                    if not isinstance(found := getattr(contact, name), Real):
                        raise InputError(f"Closing.{name}", type(found).__name__, "a number, for derivatives of a run")
        self._body, self._adjoint = body, ngs.GridFunction(body.fes)
        tested, of_adjoint = self.work(body.fes.TestFunction()), self.work(self._adjoint)
        self._columns = [part.columns(body.fes, tested) for part in parts.values()]
        self._slopes = [part.slope(of_adjoint, body.mesh) for part in parts.values()]

    def work(self, virtual: Motion, *along: Motion) -> Terms:
        """C[virtual] and, for each motion more, its derivative along it."""
        u, a, numbers, weight = self._body.u, self._body.offset, list[ngs.Parameter](), self._body.kinematics.weight()
        for motion in (virtual, *along):
            numbers.append(ngs.Parameter(0.0))
            moves = self._body.layout.fields(motion)
            u, a = u + numbers[-1] * moves.u, a + numbers[-1] * moves.offset
        contacts, order = self._body.contacts, self._body.element.order
        rigid = [Term(weight * c.energy(u, a), c.measure()) for c in contacts if isinstance(c, Contact)]
        films = [Term(weight * c.energy(u), c.measure(order)) for c in contacts if isinstance(c, Sliding)]
        loads = [term for load in self._loads for term in terms(load.energy(self._body.external.place(u)))]
        return reduce(by, numbers, rigid + films + loads)

    def columns(self) -> sp.csr_array:
        """C_θ (ndof, θ)."""
        return sp.csr_array(sp.hstack([columns() for columns in self._columns]))

    def slopes(self, adjoint: Array) -> Array:
        """C_θᵀ λ, one parameter after the other."""
        self._adjoint.vec.FV().NumPy()[:] = adjoint
        return np.concatenate([slope() for slope in self._slopes])
