"""Virtual work of a body's contacts and loads by symbols: how it changes with what they are made of, and with the state."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, reduce
from numbers import Real

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import InputError
from ngbrain.forward.common.loads import CavityVolume, Load, Pressure, Stored
from ngbrain.forward.contact.rigid import Closing, Contact, Sliding, Touch
from ngbrain.forward.sensitivity.parameter_blocks import Block
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import Motion, Term, Terms, by, terms

Array = np.ndarray


class ContactForms:
    """C(x; θ)[λ] of the loads of `body` and the contacts that a rigid body makes, at the body's state, with θ in `parts`.

    Some `loads` and `contacts`, or all. Walls that close on each other have no part in it; `InputError` where their penalty or
    softness is no number.
    """

    def __init__(
        self,
        body: Problem,
        parts: Mapping[str, Block],
        loads: Sequence[Load] | None = None,
        contacts: Sequence[Touch] | None = None,
    ) -> None:
        self._loads: list[Stored] = []
        self._contacts = body.contacts if contacts is None else contacts
        for load in body.loads if loads is None else loads:
            if isinstance(load, (Pressure, CavityVolume)):
                raise InputError(
                    "loads", type(load).__name__, "loads with an energy of the displacement, for derivatives of a run"
                )
            self._loads.append(load)
        for contact in self._contacts:
            if isinstance(contact, Closing):
                for name in ("penalty", "softness"):
                    if not isinstance(found := getattr(contact, name), Real):
                        raise InputError(f"Closing.{name}", type(found).__name__, "a number, for derivatives of a run")
        self._body, self._parts, self._motion = body, list(parts.values()), ngs.GridFunction(body.fes)
        self._slopes = [part.slope(self.weighed(), body.mesh) for part in self._parts]

    def work(self, virtual: Motion, *along: Motion) -> Terms:
        """C[virtual] and, for each motion more, its derivative along it."""
        u, a, numbers, weight = self._body.u, self._body.offset, list[ngs.Parameter](), self._body.kinematics.weight()
        for motion in (virtual, *along):
            numbers.append(ngs.Parameter(0.0))
            moves = self._body.layout.fields(motion)
            u, a = u + numbers[-1] * moves.u, a + numbers[-1] * moves.offset
        contacts, order = self._contacts, self._body.element.order
        rigid = [Term(weight * c.energy(u, a), c.measure()) for c in contacts if isinstance(c, Contact)]
        films = [Term(weight * c.energy(u), c.measure(order)) for c in contacts if isinstance(c, Sliding)]
        loads = [term for load in self._loads for term in terms(load.energy(self._body.external.place(u)))]
        return reduce(by, numbers, rigid + films + loads)

    def weighed(self, *along: Motion) -> Terms:
        """C[λ] with the λ of `weigh`, or its derivative along motions."""
        return self.work(self._motion, *along)

    def weigh(self, motion: Array) -> None:
        """Set λ."""
        self._motion.vec.FV().NumPy()[:] = motion

    def slopes(self) -> Array:
        """C_θᵀ λ with the λ of `weigh`, one parameter after the other."""
        return np.concatenate([slope() for slope in self._slopes])

    def columns(self) -> sp.csr_array:
        """C_θ (ndof, θ)."""
        return sp.csr_array(sp.hstack([columns() for columns in self._columns]))

    @cached_property
    def _columns(self) -> list[Callable[[], sp.csr_array]]:
        tested = self.work(self._body.fes.TestFunction())
        return [part.columns(self._body.fes, tested) for part in self._parts]
