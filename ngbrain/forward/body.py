"""A nearly incompressible relaxing body in mixed form, as one energy; what Newton's method needs of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.forward.contact import Contact, Sliding, Touch, offsets, surface_rule
from ngbrain.forward.forces import Density, Forces
from ngbrain.forward.friction import Friction, Grip
from ngbrain.forward.history import History
from ngbrain.forward.kinematics import Solid
from ngbrain.forward.loads import CavityVolume, Place, Pressure, Stored
from ngbrain.forward.material import Material
from ngbrain.forward.patterns import boundaries, check_apart, check_regions
from ngbrain.forward.tangent import Solve, Tangent
from ngbrain.materials import Viscous
from ngbrain.materials.base import Deformation
from ngbrain.materials.points import EVERYWHERE
from ngbrain.tensors import deformation_gradient, isochoric, right_cauchy_green

Remembered = Callable[[Viscous, CoefficientFunction], CoefficientFunction]
"""A part of the energy that a law's history makes of C̄: `History.energy`, or `History.work` for forces alone."""

LENGTH_SCALE = 1e-3
"""Displacements (m) are judged against a millimetre in the size of a Newton correction."""


class Body:
    """Energy Σ_regions W(C̄; history) + p(J - 1) - p²/2K + contact, on P_k displacements and P_{k-1} pressures.

    mesh       NGSolve mesh, tetrahedra
    materials  region pattern → `Material`
    fixed      boundary pattern held at u = 0; "" for none
    contacts   rigid bodies that walls see, their friction, walls that slide, and walls that close on each other
    order      k ≥ 2
    modulus    what pressures are judged against in the size of a Newton correction (Pa), of the order of a shear modulus
    loads      of `ngbrain.forward.loads`, which have an energy; they change in time with what they are made of, such as the
               parameter that a motion sets

    Unknowns are u, p and the offset of the contacts, of order k on their walls.

    Attributes: `fes`, `gfu` (compound), `u`, `p`, `offset` (its components), `history`, `friction` (`Grip`). Raises `InputError`
    for a pattern that matches no region or boundary.
    """

    def __init__(
        self,
        mesh: ngs.Mesh,
        materials: dict[str, Material],
        fixed: str,
        contacts: Sequence[Touch | Friction] = (),
        order: int = 2,
        modulus: float = 1e3,
        loads: Sequence[Stored] = (),
    ) -> None:
        check_regions(mesh, materials)
        for load in loads:
            if isinstance(load, (Pressure, CavityVolume)):
                raise InputError("loads", type(load).__name__, "loads with an energy of the displacement")
            if hasattr(load, "boundary"):
                boundaries(mesh, load.boundary)
        check_apart(mesh, fixed, [contact.wall for contact in contacts])
        rigid = [contact for contact in contacts if isinstance(contact, Contact)]
        for film in (contact for contact in contacts if isinstance(contact, Sliding)):
            check_apart(mesh, film.wall, [contact.wall for contact in rigid])
        self.mesh, self.materials = mesh, materials
        self.contacts = tuple(contact for contact in contacts if not isinstance(contact, Friction))
        self.order, self.modulus, self.loads = order, modulus, tuple(loads)
        spaces = (ngs.VectorH1(mesh, order=order, dirichlet=fixed), ngs.H1(mesh, order=order - 1))
        self.fes = ngs.FESpace([*spaces, offsets(mesh, rigid, order)])
        self.gfu = ngs.GridFunction(self.fes)
        self.u, self.p, self.offset = self.gfu.components
        self.friction = Grip(self.fes, [contact for contact in contacts if isinstance(contact, Friction)])
        self.history = History(mesh, {name: m.viscous for name, m in materials.items()}, order - 1)
        F = deformation_gradient(self.u)
        self.history.follow(isochoric(right_cauchy_green(F)))
        self._det = ngs.Det(F).Compile()
        self._points = mesh.MapToAllElements({ngs.TET: self.history.rules[ngs.TET]}, ngs.VOL)
        self._tissue_terms, self._joined = self._terms(), list[object]()
        self.contact_form, self.form = self._form([]), self.friction.join(self._form(self._tissue_terms))
        densities = {name: self._density(material, self.history.work) for name, material in materials.items()}
        self._tissue_forces = Forces(self.gfu, densities, self.history.space)
        self._gaps = [
            (contact.gap(self.u).Compile(), mesh.MapToAllElements(surface_rule(), mesh.Boundaries(contact.wall)))
            for contact in rigid
        ]
        self._vec = self.gfu.vec.CreateVector()
        self._relaxed, self._stiff = np.empty(0), False
        unknown = np.repeat([0, 1, 2], [space.ndof for space in self.fes.components])
        self.is_u = unknown == 0
        self._scale = np.array([LENGTH_SCALE, modulus, LENGTH_SCALE])[unknown]
        self._release(ngs.BitArray(self.fes.FreeDofs()))

    def _terms(self) -> list[ngs.comp.BFI]:
        """Energies of the tissues, each made once and compiled."""
        u, p, _ = self.fes.TrialFunction()
        state = Deformation.of(deformation_gradient(u))
        tissue = []
        for pattern, material in self.materials.items():
            # Compiled: uncompiled, shared subexpressions are evaluated again at every use, without end.
            energy = self._density(material, self.history.energy)(state, p).Compile()
            term = ngs.SymbolicEnergy(energy, definedon=self.mesh.Materials(pattern))
            for shape, rule in self.history.rules.items():
                term.SetIntegrationRule(shape, rule)
            tissue.append(term)
        return tissue

    def _density(self, material: Material, remembered: Remembered) -> Density:
        law, history = material.viscous, self.history

        def density(at: Deformation, p: CoefficientFunction) -> CoefficientFunction:
            energy = law.density(at, history.shares[: len(law.hereditary)]) + remembered(law, at.shape)
            return energy + material.of_volume(at.J, p)

        return density

    def _form(self, tissue: list[ngs.comp.BFI]) -> ngs.BilinearForm:
        """Energies of tissues, of all contacts and of loads."""
        form = ngs.BilinearForm(self.fes, symmetric=True)
        for term in tissue:
            form += term
        for load in self.loads:
            form += ngs.Variation(load.energy(self.place(self.fes.TrialFunction()[0])))
        self._joined += [contact.join(form) for contact in self.contacts]  # some have to live as long as the form
        return form

    def place(self, u: CoefficientFunction) -> Place:
        """Where its loads act, all of them, for a displacement."""
        return Place(self.mesh, Solid(), ngs.Parameter(1.0), u, None, self.order)

    def hold(self, elements: np.ndarray) -> None:
        """Hold all unknowns of some elements (a mask) where they are from now on; nothing is integrated over them."""
        for term in self._tissue_terms:  # `dx(definedonelements=…)` is not heard by an energy; its integrator is
            term.SetDefinedOnElements(ngs.BitArray(~elements))
        self._tissue_forces.leave_out(elements)
        self._release(self._without(elements))

    def focus(self, elements: np.ndarray) -> None:
        """Elements (a mask) where the tangent changes most, for `factorise`; contacts always belong to them."""
        tissue = self._terms()
        for term in tissue:
            term.SetDefinedOnElements(ngs.BitArray(elements))
        self.focused = True
        self._near = np.flatnonzero(np.repeat(elements, self._points.size // elements.size))
        part, inside = self.friction.join(self._form(tissue)), self._without(~elements)
        self._tangent = Tangent(self.form, self._free_dofs, self.weights, part, inside)

    def _without(self, elements: np.ndarray) -> ngs.BitArray:
        """Free unknowns that none of some elements (a mask) has."""
        free = ngs.BitArray(self._free_dofs)
        for element in self.mesh.Elements():
            if elements[element.nr]:
                for dof in self.fes.GetDofNrs(element):
                    free.Clear(dof)
        return free

    def _release(self, free: ngs.BitArray) -> None:
        self._free_dofs = free
        self._free = np.fromiter(free, bool, self.fes.ndof).astype(float)
        self.weights = self._free / self._scale**2 / self.fes.ndof
        self.focused = False
        self._tangent = Tangent(self.form, free, self.weights)

    # What Newton's method asks (solvers.newton.System).

    def residual(self, x: np.ndarray) -> tuple[np.ndarray, float]:
        """Residual on the free unknowns, and the norm of all nodal forces of the displacement rows."""
        self._relax(x)
        r = self._tissue_forces() + self._contact_forces()
        return r * self._free, float(np.linalg.norm(r[self.is_u]))

    def factorise(self, x: np.ndarray, r: np.ndarray | None = None) -> Solve:
        """Solver with the tangent at x.

        With a residual r it is that of `refactorise` if what that gives for r will do; `partial` says so.
        """
        solve = None if r is None else self.refactorise(x, r)
        self.partial = solve is not None
        if solve is None:
            self._stiffen(x)
            solve = self._tangent.renew(self.gfu.vec)
        return solve

    def refactorise(self, x: np.ndarray, r: np.ndarray | None = None) -> Solve | None:
        """The same with the tangent renewed where `focus` says, and elsewhere as it was when factorised.

        None without a focus or a factorisation, and if what it gives for r is too rough.
        """
        if not self.focused:
            return None
        self._stiffen(x, self._near)
        return self._tangent.refresh(self.gfu.vec, r)

    def _relax(self, x: np.ndarray) -> None:
        """Go to a state and let the Maxwell branches flow there."""
        self.state = x
        self.friction.hold(self.gfu.vec)
        if self.history.flows and not np.array_equal(x, self._relaxed):
            self.history.relax()
            self._relaxed, self._stiff = x.copy(), False

    def _stiffen(self, x: np.ndarray, where: np.ndarray | slice = EVERYWHERE) -> None:
        """The same, with the branches' stiffness for the tangent, everywhere or at some points."""
        self._relax(x)
        if self.history.flows and not self._stiff:
            self.history.flows.stiffen(where)
            self._stiff = where is EVERYWHERE

    def begin(self, dt: float) -> None:
        """Begin a time step of `dt` seconds; it ends with `finish`."""
        self.history.begin(dt)
        self.friction.begin(np.array(self.gfu.vec.FV().NumPy()))
        self._relaxed = np.empty(0)

    def finish(self) -> None:
        """End the step begun at the state that now stands."""
        self.history.finish()
        self.friction.hold(self.gfu.vec)
        self.friction.finish()

    def halving(self, before: np.ndarray) -> tuple[float, float]:
        """By how much (Pa) the overstress at the end of the step would change in two half steps, and its size: see `History`."""
        now = self.state
        self.state = (before + now) / 2
        middle = self.history.here()
        self.state = now
        return self.history.halving(middle)

    def path_error(self) -> float:
        """Error of the step that now ends beside the history's, relative: none of a body without mass, moved by a given way."""
        return 0.0

    def freeze(self, x: np.ndarray, energy: dict[str, Any]) -> None:
        """Go back to a state x and what the energy (`frozen`) was made of there."""
        self.history.frozen, self._relaxed, self._stiff = energy, x.copy(), True
        self.friction.frozen = energy
        self.state = x

    @property
    def frozen(self) -> dict[str, Any]:
        """All that the energy of the present step is made of besides the state."""
        return {**self.history.frozen, **self.friction.frozen}

    @property
    def memory(self) -> dict[str, Any]:
        """All that decides the steps to come besides the state."""
        return {**self.history.memory, **self.friction.memory}

    @memory.setter
    def memory(self, saved: dict[str, Any]) -> None:
        self.history.memory = self.friction.memory = saved

    def min_det(self, x: np.ndarray) -> float:
        """Smallest det F over all quadrature points."""
        self.state = x
        return float(np.min(self._det(self._points)))

    def min_gap(self) -> float:
        """Smallest signed distance (m) between tissue and rigid bodies over the walls' quadrature points."""
        return min((float(np.min(gap(points))) for gap, points in self._gaps), default=float("inf"))

    # State and forces.

    @property
    def state(self) -> np.ndarray:
        """All unknowns as one array, a copy."""
        return np.array(self.gfu.vec.FV().NumPy())

    @state.setter
    def state(self, x: np.ndarray) -> None:
        self.gfu.vec.FV().NumPy()[:] = x

    def tissue_forces(self) -> np.ndarray:
        """Nodal forces (N) of the tissue alone at the current state, one per displacement unknown."""
        self._relax(self.state)
        return self._tissue_forces()[self.is_u]

    def tissue_stress(self) -> np.ndarray:
        """Nominal stress P = ∂W/∂F (Pa), (n, 3, 3) at the points of `history.space`, where `tissue_forces` was last asked."""
        return self._tissue_forces.stress

    def contact_forces(self) -> np.ndarray:
        """Nodal forces (N) of contacts, their friction, sliding walls and loads at the current state."""
        self.friction.hold(self.gfu.vec)
        return self._contact_forces()[self.is_u]

    def contact_energy(self) -> float:
        """Energy (J) stored in the penalties of contacts and sliding walls, and in loads, at the current state."""
        return float(self.contact_form.Energy(self.gfu.vec))

    def friction_work(self) -> float:
        """What went into friction (J) since the present time step began."""
        self.friction.hold(self.gfu.vec)
        return self.friction.work()

    def friction_driving(self) -> float:
        """Force (N) along the way of the rigid bodies that friction asks of them, as `Contact.driving` does."""
        self.friction.hold(self.gfu.vec)
        return self.friction.driving()

    def _contact_forces(self) -> np.ndarray:
        self.contact_form.Apply(self.gfu.vec, self._vec)
        return self._vec.FV().NumPy() + self.friction.forces()
