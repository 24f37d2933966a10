"""A problem's spaces, state and parts, as its time steps and what is asked of it know them."""

from __future__ import annotations

from typing import Any

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.forward.common.dirichlet import Supports
from ngbrain.forward.common.elements import Form
from ngbrain.forward.common.kinematics import Solid
from ngbrain.forward.common.loads import CavityVolume, Load, Place, Pressure
from ngbrain.forward.common.unknowns import Layout
from ngbrain.forward.contact.friction import Grip
from ngbrain.forward.contact.rigid import Touch
from ngbrain.forward.solid.inertia import Momentum
from ngbrain.forward.solid.tangent import Tangent
from ngbrain.forward.solid.tissue import Tissue

Array = np.ndarray


class Assembled:
    """What a `Problem` is assembled of."""

    mesh: ngs.Mesh
    kinematics: Solid
    supports: Supports
    loads: tuple[Load, ...]
    contacts: tuple[Touch, ...]
    element: Form
    layout: Layout
    fes: ngs.FESpace
    gfu: ngs.GridFunction
    u: ngs.GridFunction
    tissue: Tissue
    friction: Grip
    inertia: Momentum | None
    factor: ngs.Parameter
    held: Array
    is_u: Array
    form: ngs.BilinearForm
    contact_form: ngs.BilinearForm
    gaps: list[tuple[CoefficientFunction, Array]]
    focused: bool
    partial: bool
    assembled: bool
    factored: bool
    _free: Array
    _tangent: Tangent | None
    _cavities: list[CavityVolume]
    _joined: list[object]
    _vec: ngs.BaseVector

    @property
    def state(self) -> Array:
        """All unknowns as one array, a copy."""
        return np.array(self.gfu.vec.FV().NumPy())

    @state.setter
    def state(self, x: Array) -> None:
        self.gfu.vec.FV().NumPy()[:] = x

    def _stand(self, x: Array) -> None:
        """Go to a state: Maxwell branches flow there, friction takes its pressures and normals there."""
        self.state = x
        self.friction.hold(self.gfu.vec)
        self.tissue.relax(x)

    def place(self, u: CoefficientFunction, v: CoefficientFunction | None = None) -> Place:
        """Where its loads act, for a displacement and a test function."""
        return Place(self.mesh, self.kinematics, self.factor, u, v, self.element.order)

    def _outer_forces(self) -> Array:
        """Of contacts, their friction and loads, one number for each unknown."""
        if not self.contacts and not self.loads:
            return np.zeros(self.fes.ndof)
        return self._applied(self.contact_form) + self.friction.forces()

    def _applied(self, form: ngs.BilinearForm) -> Array:
        form.Apply(self.gfu.vec, self._vec)
        return np.array(self._vec.FV().NumPy())

    def _load_terms(self) -> list[tuple[Load, Any]]:
        """Each load with its part of a form."""
        at, test = (self.layout.fields(of) for of in self.fes.TnT())
        place, cavities = self.place(at.u, test.u), iter(at.cavities)
        found: list[tuple[Load, Any]] = []
        for load in self.loads:
            if isinstance(load, Pressure):
                found.append((load, load.work(place)))
            elif isinstance(load, CavityVolume):
                found.append((load, ngs.Variation(load.energy(place, next(cavities)))))
            else:
                found.append((load, ngs.Variation(load.energy(place))))
        return found
