"""External actions on a problem: contacts and loads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from weakref import WeakKeyDictionary

import ngsolve as ngs

from ngbrain.forward.common.kinematics import SolidKinematics
from ngbrain.forward.common.loads import CavityVolume, Load, LoadContext, PressureLoad
from ngbrain.forward.common.state import Term
from ngbrain.forward.common.unknowns import Layout
from ngbrain.forward.contact.rigid import WallContact


class ExternalLoads(Term):
    """Contacts and loads: terms without internal variables.

    Parameters
    ----------
    fes : FESpace
    layout : Layout
    kinematics : SolidKinematics
    order : int
        Order of the displacements.
    factor : ngsolve.Parameter
        Load factor.
    loads, contacts : sequence
    """

    def __init__(
        self,
        fes: ngs.FESpace,
        layout: Layout,
        kinematics: SolidKinematics,
        order: int,
        factor: ngs.Parameter,
        loads: Sequence[Load],
        contacts: Sequence[WallContact],
    ) -> None:
        self.fes, self.layout, self.kinematics, self.order = fes, layout, kinematics, order
        self.factor, self.loads, self.contacts = factor, tuple(loads), tuple(contacts)
        self._parts = self._of_loads()
        # Self-contacts have to be kept as long as the form that contains them.
        self._pairs = WeakKeyDictionary[ngs.BilinearForm, list[object]]()
        self.form = ngs.BilinearForm(fes, symmetric=self.symmetric)
        self.join(self.form)

    @property
    def symmetric(self) -> bool:
        """Whether all have an energy; a follower pressure has none."""
        return not any(isinstance(load, PressureLoad) for load in self.loads)

    def place(self, u: ngs.CoefficientFunction, v: ngs.CoefficientFunction | None = None) -> LoadContext:
        """Context in which loads are evaluated.

        Parameters
        ----------
        u : CoefficientFunction
            Displacement (m).
        v : CoefficientFunction, optional
            Test function.

        Returns
        -------
        LoadContext
        """
        return LoadContext(self.fes.mesh, self.kinematics, self.factor, u, v, self.order)

    def join(self, form: ngs.BilinearForm) -> None:
        """Add all to a form of the problem."""
        for _, part in self._parts:
            form += part
        for contact in self.contacts:
            self._add(form, contact)

    def boundary_forms(self) -> list[tuple[str | None, ngs.BilinearForm]]:
        """The form of each, with the boundary that it acts on; None for a load on no boundary."""
        found: list[tuple[str | None, ngs.BilinearForm]] = []
        for load, part in self._parts:
            form = ngs.BilinearForm(self.fes)
            form += part
            found.append((getattr(load, "boundary", None), form))
        for contact in self.contacts:
            form = ngs.BilinearForm(self.fes)
            self._add(form, contact)
            found.append((contact.wall, form))
        return found

    def _add(self, form: ngs.BilinearForm, contact: WallContact) -> None:
        pairs = contact.join(form, self.layout.fields(self.fes.TrialFunction()), self.kinematics)
        self._pairs.setdefault(form, []).append(pairs)

    def _of_loads(self) -> list[tuple[Load, Any]]:
        """Each load with its part of a form."""
        if not self.loads:
            return []
        at, test = (self.layout.fields(of) for of in self.fes.TnT())
        place, cavities = self.place(at.u, test.u), iter(at.cavities)
        found: list[tuple[Load, Any]] = []
        for load in self.loads:
            if isinstance(load, PressureLoad):
                found.append((load, load.work(place)))
            elif isinstance(load, CavityVolume):
                found.append((load, ngs.Variation(load.energy(place, next(cavities)))))
            else:
                found.append((load, ngs.Variation(load.energy(place))))
        return found
