"""The nonlinear solid: tissue, supports, loads, contacts and inertia on one mesh, as one residual and one tangent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.arguments import of_type
from ngbrain.errors import InputError
from ngbrain.forward.choice import automatic
from ngbrain.forward.contact import Contact, Sliding, Touch, offsets, surface_rules
from ngbrain.forward.elements import Form, check_elements
from ngbrain.forward.fields import Layout
from ngbrain.forward.friction import Friction, Grip
from ngbrain.forward.history import History
from ngbrain.forward.inertia import Inertia, Momentum
from ngbrain.forward.kinematics import Solid, kinematics_of
from ngbrain.forward.loads import CavityVolume, Load, Place, Pressure, volume
from ngbrain.forward.material import Material, stiffness
from ngbrain.forward.patterns import boundaries, check_apart, check_regions, check_types
from ngbrain.forward.supports import Support, Supports
from ngbrain.forward.tangent import Tangent
from ngbrain.forward.tissue import Tissue, history_order
from ngbrain.solvers import linear
from ngbrain.solvers.record import Clock

Array = np.ndarray
RELATIVE = 0.01
"""Corrections are judged against this share of the body's size, pressures against its shear modulus."""
GAP = 1e-3
"""With contacts corrections are judged against this length (m): walls come and go by far less than a body is long."""
CONDENSE_UP_TO = 1e6
"""K/μ up to which discontinuous pressures are eliminated element by element; beyond, that loses digits."""
WORTH_REUSING = 100_000
"""Unknowns in space from which on a Krylov method with an old factor is tried before a new one is made (at 76 000 it took as
long as a new one, which grows twice as fast):"""
ROUGHLY, AT_MOST = 0.1, 6
"""it has to bring the first residual down to this share in so many iterations."""


class Problem:
    """A body: energy Σ W(F; history) + U(J) or p(J - 1) - p²/2K, + loads + contacts + inertia; equilibrium where it is stationary.

    It has no time and no way of its own: a `LoadPath` makes its loads grow, a `TimeStepper` takes it through time.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        In the plane or in space, of any element shape.
    materials : dict
        Region pattern → `Material`, elastic or relaxing.
    boundary_conditions : dict
        Boundary pattern → displacement there at load factor 1: 0, a vector (m) or components, None where free; where patterns
        share nodes the later one counts.
    loads : sequence
        Of `ngbrain.forward.loads`, and one `Inertia`.
    contacts : sequence
        Rigid bodies that walls meet, their friction, walls that slide, and walls that close on each other.
    element : str or Form
        "P2/P1", "P4/L2(2)", "P3", …, refused if its inf-sup constant falls with the mesh (a `Form` is taken at its word), or "auto".
    kinematics : Solid
        `PlaneStrain` (default in the plane), `Axisymmetric`.
    solver : str
        A name of `ngbrain.solvers.linear`, or "auto".
    bonus : int
        Orders of quadrature beyond 2k, of bodies without a history.
    history : bool, optional
        Whether the body keeps a history at its quadrature points, with stresses there; by default where tissue relaxes, and with
        contacts or inertia.

    Attributes
    ----------
    fes, gfu, u, p, offset : the space, the state, and its displacement, pressure and offset of contacts
    factor : load factor (`ngs.Parameter`)
    history : what relaxing tissue remembers; None of an elastic body without contacts and mass
    choice : which element and linear solver were chosen, and why
    held, prescribed : which displacement unknowns are held, and where (m)

    Raises
    ------
    InputError
        For a pattern that matches nothing, a refused element, an inverted element of the mesh.

    Examples
    --------
    >>> from ngbrain.forward.load_path import LoadPath
    >>> from ngbrain.materials import NeoHooke
    >>> from ngbrain.mesh import block
    >>> cube = block((0.1, 0.1, 0.1), 0.1)
    >>> body = Problem(cube, {".*": Material(NeoHooke(1e3), 1e5)}, {"bottom": 0, "top": (0, 0, -0.01)}, element="P2/P1")
    >>> record = LoadPath(body).solve()
    >>> record.converged, bool(body.force("top")[2] < 0)
    (True, True)
    """

    def __init__(
        self,
        mesh: ngs.Mesh,
        materials: Mapping[str, Material],
        boundary_conditions: Mapping[str, Support] | None = None,
        loads: Sequence[Load | Inertia] = (),
        contacts: Sequence[Touch | Friction] = (),
        element: str | Form = "auto",
        kinematics: Solid | None = None,
        solver: str = "auto",
        bonus: int = 0,
        history: bool | None = None,
    ) -> None:
        conditions = {} if boundary_conditions is None else boundary_conditions
        check_types(mesh, materials, conditions)
        check_regions(mesh, materials)
        for load in loads:
            if hasattr(load, "boundary"):
                boundaries(mesh, load.boundary)
        frictions = [each for each in contacts if isinstance(each, Friction)]
        rigid = [each for each in contacts if isinstance(each, Contact)]
        self._check_contacts(mesh, conditions, contacts, rigid)
        self.mesh, self.materials = mesh, dict(materials)
        masses = [load for load in loads if isinstance(load, Inertia)]
        self.loads = tuple(load for load in loads if not isinstance(load, Inertia))
        self.contacts = tuple(each for each in contacts if not isinstance(each, Friction))
        self.kinematics = kinematics_of(mesh, kinematics)
        self.supports = Supports(mesh, conditions)
        instant = {name: Material(m.viscous.instantaneous, m.bulk) for name, m in materials.items()}
        relaxes = any(m.viscous.branches for m in materials.values())
        through_time = relaxes or (bool(contacts or masses) if history is None else history)
        asked = element if isinstance(element, Form) else None if element == "auto" else self._named(element)
        points = history_order(mesh, asked.order if asked else 2) if through_time else None
        self._moduli, self.modulus, self.ratio = stiffness(mesh, instant, points)
        self.element, why = self._choose(element, asked)
        self._condense = self.element.kind == "discontinuous pressure" and self.ratio <= CONDENSE_UP_TO
        self.symmetric = not any(isinstance(load, Pressure) for load in self.loads)
        spaces = self.element.spaces(mesh, self._condense, **self.supports.dirichlet)
        self._cavities = [load for load in self.loads if isinstance(load, CavityVolume)]
        self.layout = Layout(self.element.pressure is not None, bool(rigid), len(self._cavities))
        if rigid:
            spaces.append(offsets(mesh, rigid, self.element.order))
        spaces += [ngs.NumberSpace(mesh) for _ in self._cavities]
        self.fes = spaces[0] if len(spaces) == 1 else ngs.FESpace(spaces)
        self.gfu = ngs.GridFunction(self.fes)
        self._vec = self.gfu.vec.CreateVector()
        self.u, self.p, self.offset = (getattr(self.layout.fields(self.gfu), name) for name in ("u", "p", "offset"))
        check_elements(mesh)
        self.factor, self.clock, self.partial = ngs.Parameter(0.0), Clock(), False
        self.tissue = Tissue(self.layout, self.gfu, self.kinematics, materials, self.element, through_time, bonus)
        self.friction = Grip(self.layout, self.fes, frictions, self.kinematics)
        self.prescribed, self.held = self.supports.coefficients(spaces[0])
        self.inertia = Momentum(masses, self.gfu, spaces[0], self.kinematics, self.element.order) if masses else None
        self.gaps = [
            (each.gap(self.u).Compile(), mesh.MapToAllElements(surface_rules(mesh), mesh.Boundaries(each.wall)))
            for each in rigid
        ]
        part = np.repeat(np.arange(self.layout.count), [space.ndof for space in spaces])
        self.is_u = part == 0
        size = GAP if contacts else RELATIVE * np.ptp([vertex.point for vertex in mesh.vertices], axis=0).max()
        lengths = self.is_u | (bool(rigid) & (part == 1 + self.layout.pressure))
        self._scale = np.where(lengths, size, self.modulus)
        self._release(ngs.BitArray(self.fes.FreeDofs()))
        chosen = self._solver(int(np.sum(np.fromiter(self.fes.FreeDofs(self._condense), bool))))
        self.solver = chosen.name if solver == "auto" else solver
        self.choice = {"element": f"{self.element}: {why}", "solver": chosen.why if solver == "auto" else "asked for"}
        self._kept: linear.Solve | None = None
        self._joined: list[object] = []
        self._make_forms()

    # What Newton's method asks (solvers.newton.System).

    @property
    def state(self) -> Array:
        """All unknowns as one array, a copy."""
        return np.array(self.gfu.vec.FV().NumPy())

    @state.setter
    def state(self, x: Array) -> None:
        self.gfu.vec.FV().NumPy()[:] = x

    def load(self, x: Array, t: float) -> Array:
        """Set the load factor; x with what is prescribed at t."""
        self.factor.Set(t)
        x = x.copy()
        x[: len(self.held)][self.held] = t * self.prescribed[self.held]
        return x

    def residual(self, x: Array) -> tuple[Array, float]:
        """Residual on the free unknowns, and the norm of the nodal forces that supports and loads have to bear."""
        with self.clock("residual"):
            self._stand(x)
            r, outer = self.tissue.forces(), self._outer_forces()
            size = float(np.linalg.norm((r + outer if self.contacts else r)[self.is_u]))
            r = r + outer
            if self.inertia is not None:
                r[self.is_u] += self.inertia.forces(x[: len(self.held)])
        return r * self._free, size

    def factorise(self, x: Array, r: Array | None = None) -> linear.Solve:
        """Solver with the tangent at x, where the residual is r.

        That of `refactorise` if what it gives for r will do (`partial` says so); of large bodies without a focus an old factor as
        preconditioner where that is worth it and will do; else a new factor.
        """
        if self._tangent is not None:
            solve = None if r is None else self.refactorise(x, r)
            self.partial = solve is not None
            if solve is None:
                self._stand(x)
                self.tissue.stiffen()
                solve = self._tangent.renew(self.gfu.vec)
            return solve
        self._stand(x)
        with self.clock("assemble"):
            self.tissue.stiffen()
            self.form.AssembleLinearization(self.gfu.vec)
        self.assembled = True
        if r is not None and self._kept and self.mesh.dim == 3 and self.fes.ndof > WORTH_REUSING:
            with self.clock("solve"):
                solve = linear.reused(self.form, self._kept, r, ROUGHLY, AT_MOST)
            if solve:
                return self._timed(solve)
        self._kept = None  # the old one's memory first
        with self.clock("factor"):
            self._kept = self.new_factor()
        self.factored = True
        return self._timed(self._kept)

    def refactorise(self, x: Array, r: Array | None = None) -> linear.Solve | None:
        """The same with the tangent renewed where `focus` says, and elsewhere as it was when factorised.

        None without a focus or a factorisation, and if what it gives for r is too rough.
        """
        if not self.focused:
            return None
        assert self._tangent is not None
        self._stand(x)
        self.tissue.stiffen(self._near)
        return self._tangent.refresh(self.gfu.vec, r)

    def min_det(self, x: Array) -> float:
        """Smallest det F over all quadrature points."""
        with self.clock("check"):
            self.state = x
            return self.tissue.min_det()

    def _stand(self, x: Array) -> None:
        """Go to a state: Maxwell branches flow there, friction takes its pressures and normals there."""
        self.state = x
        self.friction.hold(self.gfu.vec)
        self.tissue.relax(x)

    def _timed(self, solve: linear.Solve) -> linear.Solve:
        def timed(r: Array) -> Array:
            with self.clock("solve"):
                return solve(r)

        return timed

    @property
    def kept(self) -> linear.Solve | None:
        """The last factor that `factorise` made, which is that of a tangent of then."""
        return self._kept

    def tangent(self) -> linear.Solve:
        """Solver with the tangent at the state, made new."""
        self.form.AssembleLinearization(self.gfu.vec)
        return self.new_factor()

    def changed(self) -> None:
        """Say that parameters did: the tangent and the factor that are there, `assembled` and `factored`, are of others."""
        self.assembled = self.factored = False

    # Where the tangent is renewed, and what takes part.

    def hold(self, elements: Array) -> None:
        """Hold all unknowns of some elements (a mask) where they are from now on; nothing is integrated over them."""
        self.tissue.leave_out(elements)
        self._release(self._without(elements))
        self._tangent = Tangent(self.form, self._free_dofs, self.weights)

    def focus(self, elements: Array) -> None:
        """Elements (a mask) where the tangent changes most, for `factorise`; contacts always belong to them."""
        tissue = self.tissue.energies()
        for term in tissue:
            term.SetDefinedOnElements(ngs.BitArray(elements))
        self.focused, self._near = True, self.tissue.points_in(elements)
        part = self._form(tissue)
        self._tangent = Tangent(self.form, self._free_dofs, self.weights, part, self._without(~elements))

    def _without(self, elements: Array) -> ngs.BitArray:
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
        self.focused, self._tangent = False, None

    # A time step.

    @property
    def history(self) -> History:
        """What relaxing tissue remembers."""
        if self.tissue.history is None:
            raise AttributeError(
                "history: an elastic body without contacts and inertia has none unless it is asked for"
            )
        return self.tissue.history

    def begin(self, dt: float) -> None:
        """Begin a time step of `dt` seconds from the present state; it ends with `finish`."""
        self.tissue.begin(dt)
        self.friction.begin(self.state[: self.fes.ndof])
        if self.inertia is not None:
            self.inertia.begin(dt)

    def finish(self) -> None:
        """End the step begun at the state that now stands."""
        self._finish_tissue()
        self.friction.hold(self.gfu.vec)
        self.friction.finish()
        if self.inertia is not None:
            self.inertia.finish()

    def _finish_tissue(self) -> None:
        if self.tissue.history is not None:
            self.tissue.relax(self.state)
            self.tissue.history.finish()

    def halving(self, before: Array) -> tuple[float, float]:
        """By how much (Pa) the overstress at the end of the step would change in two half steps, and its size: see `History`."""
        if self.tissue.history is None:
            return 0.0, 0.0
        now = self.state
        self.state = (before + now) / 2
        middle = self.history.here()
        self.state = now
        return self.history.halving(middle)

    def path_error(self) -> float:
        """Relative error of the step that now ends beside the history's: that of inertia."""
        return 0.0 if self.inertia is None else self.inertia.error(self._free)

    @property
    def frozen(self) -> dict[str, Any]:
        """All that the energy of the present step is made of besides the state."""
        history = {} if self.tissue.history is None else self.history.frozen
        return {**history, **self.friction.frozen}

    def freeze(self, x: Array, energy: dict[str, Any]) -> None:
        """Go back to a state x and what the energy (`frozen`) was made of there."""
        if self.tissue.history is not None:
            self.history.frozen = energy
        self.tissue.relaxed_at(x, stiff=True)
        self.friction.frozen = energy
        self.state = x
        if self.inertia is not None:
            self.inertia.freeze(energy["dt"])

    @property
    def memory(self) -> dict[str, Any]:
        """All that decides the steps to come besides the state."""
        history = {} if self.tissue.history is None else self.history.memory
        return {**history, **self.friction.memory, **({} if self.inertia is None else self.inertia.memory)}

    @memory.setter
    def memory(self, saved: dict[str, Any]) -> None:
        if self.tissue.history is not None:
            self.history.memory = saved
        self.friction.memory = saved
        if self.inertia is not None:
            self.inertia.memory = saved

    def start(self, velocity: Sequence[Any] | CoefficientFunction) -> None:
        """Set the present state of a body with inertia moving at a velocity (m/s), with the acceleration that its forces give it.

        Pressures have to be there already if the state is loaded: they are taken as they are.
        """
        if self.inertia is None:
            raise InputError("loads", "without Inertia", "Inertia among them, for a body that moves by itself")
        self.tissue.begin(self.inertia.instant)
        self.friction.begin(self.state)
        self._stand(self.state)
        forces = self.tissue.forces() + self._outer_forces()
        self.inertia.start(velocity, -forces[self.is_u], self._free)

    def kinetic_energy(self) -> float:
        """∫ ρ/2 |v|² (J); 0 without inertia."""
        return 0.0 if self.inertia is None else self.inertia.energy()

    # What is asked of a state.

    @property
    def energy(self) -> float:
        """Energy (J; in plane strain per metre) of the body and of loads that have one."""
        return float(self.form.Energy(self.gfu.vec))

    def min_gap(self) -> float:
        """Smallest signed distance (m) between tissue and rigid bodies over the walls' quadrature points."""
        return min((float(np.min(gap(points))) for gap, points in self.gaps), default=float("inf"))

    def tissue_forces(self) -> Array:
        """Forces (N) that the tissue exerts on its nodes at the current state, one for each displacement unknown."""
        self._stand(self.state)
        return self.tissue.forces()[self.is_u]

    def tissue_stress(self) -> Array:
        """Nominal stress P = ∂W/∂F (Pa), (n, 3, 3) at the points of `history.space`, where `tissue_forces` was last asked."""
        return self.tissue.stress

    def contact_forces(self) -> Array:
        """Nodal forces (N) of contacts, their friction, sliding walls and loads at the current state."""
        self.friction.hold(self.gfu.vec)
        return self._outer_forces()[self.is_u]

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

    def nodal_forces(self, boundary: str) -> Array:
        """Forces (N) that act on a boundary from outside, loads on it included, one for each displacement unknown.

        They balance the body's own forces, its weight, and what loads on other boundaries put on nodes that are shared. What
        supports exert there belongs to those of them that hold the node's component, see `Supports.shares`.
        """
        self._stand(self.state)
        forces = self.tissue.forces()[self.is_u]
        for pattern, acting in self._acting:
            if not self._on(boundary, pattern):
                forces = forces + self._applied(acting)[self.is_u]
        if self.inertia is not None:
            forces = forces + self.inertia.forces(self.state[: len(self.held)])
        return forces * self.reaction_shares(boundary)

    def reaction_shares(self, boundary: str) -> Array:
        """How much of the forces at each displacement unknown is a boundary's own: see `Supports.shares`.

        Where nothing acts on the boundary its free unknowns bear nothing, and what a solution leaves there is none of its force.
        """
        shares = self.supports.shares(self.u.space, boundary)
        own = any(self._on(boundary, pattern) for pattern, _ in self._acting)
        return shares if own else np.where(self.held, shares, 0.0)

    def _on(self, boundary: str, pattern: str | None) -> bool:
        """Whether what acts on a pattern acts on a boundary; a weight has none, nor need one of a user's."""
        return pattern is not None and bool(boundaries(self.mesh, boundary) & boundaries(self.mesh, pattern))

    def force(self, boundary: str) -> Array:
        """Force (N) that acts on a boundary from outside, by components: what its supports, contacts and loads exert together."""
        return np.array([self.conjugate(_unit(i, self.mesh.dim), boundary) for i in range(self.mesh.dim)])

    def conjugate(self, motion: CoefficientFunction, boundary: str) -> float:
        """Work (J) of the outer forces on a boundary for a motion (m) of it: the force that is conjugate to its amplitude."""
        field = ngs.GridFunction(self.u.space)
        field.Set(motion, definedon=self.mesh.Boundaries(boundary), dual=True)
        return float(field.vec.FV().NumPy() @ self.nodal_forces(boundary))

    def volume(self, boundary: str) -> float:
        """Volume (m³; in plane strain m²) that a cavity's boundary encloses, as far as the mesh goes."""
        return volume(self.place(self.u, self.u), self.u, boundary)

    def cavity_pressures(self) -> list[float]:
        """Pressures (Pa) of the loads that prescribe a volume, in their order."""
        n = len(self._cavities)
        return self.state[len(self.state) - n :].tolist()

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

    # How it is made.

    @staticmethod
    def _check_contacts(
        mesh: ngs.Mesh, conditions: Mapping[str, Support], contacts: Sequence[Any], rigid: Sequence[Contact]
    ) -> None:
        held = "|".join(conditions)
        check_apart(mesh, held, [each.wall for each in contacts])
        for film in (each for each in contacts if isinstance(each, Sliding)):
            check_apart(mesh, film.wall, [each.wall for each in rigid])

    def _named(self, element: str) -> Form:
        of_type("element", element, str)
        named = Form.named(element)
        named.check(self.mesh)
        return named

    def _choose(self, element: str | Form, asked: Form | None) -> tuple[Form, str]:
        if asked is None:
            return automatic(self.mesh, self.ratio, self.supports.held)
        return asked, "taken at its word" if isinstance(element, Form) else "asked for"

    def _solver(self, coupled: int) -> linear.Choice:
        """The linear solver for so many coupled unknowns."""
        pivots = (
            "a pressure that follows has no energy"
            if not self.symmetric
            else "a cavity's pressure is an unknown"
            if self._cavities
            else "K is infinite"
            if np.isinf(self.ratio)
            else ""
        )
        if pivots:
            return linear.Choice("umfpack", f"{pivots}, which only a factor with pivots is for")
        if self.layout.offset:
            return linear.Choice(
                "sparsecholesky", "offsets of contacts are unknowns beside displacements and pressures"
            )
        return linear.choose(self.element.kind, coupled, self.ratio, dim=self.mesh.dim, order=self.element.order)

    def with_materials(self, materials: Mapping[str, Material]) -> None:
        """Put other materials in the place of those that are there."""
        self.materials = dict(materials)
        self.tissue.materials = self.materials
        self.tissue.make()
        self._make_forms()

    def _make_forms(self) -> None:
        """Forms of the whole and of what acts on it, and what makes a solver of the whole's matrix."""
        self._joined.clear()
        self.contact_form, self.form = self._outer(), self._form(self.tissue.terms)
        self.__dict__.pop("_acting", None)
        self.new_factor = linear.prepare(self.solver, self.form, self._moduli)
        self._kept = None
        self.changed()

    def _form(self, tissue: Sequence[ngs.comp.BFI]) -> ngs.BilinearForm:
        """Energies of tissues, contacts, friction, loads and inertia."""
        form = ngs.BilinearForm(self.fes, symmetric=self.symmetric, condense=self._condense)
        for term in tissue:
            form += term
        self._add_outer(form)
        self.friction.join(form)
        if self.inertia is not None:
            form += self.inertia.term(self.layout.fields(self.fes.TrialFunction()).u)
        return form

    def _outer(self) -> ngs.BilinearForm:
        """Energies of contacts and loads alone."""
        form = ngs.BilinearForm(self.fes, symmetric=self.symmetric)
        self._add_outer(form)
        return form

    def _add_outer(self, form: ngs.BilinearForm) -> None:
        at = self.layout.fields(self.fes.TrialFunction())
        for _, part in self._load_terms():
            form += part
        self._joined += [each.join(form, at, self.kinematics) for each in self.contacts]  # some have to live as long

    @cached_property
    def _acting(self) -> list[tuple[str | None, ngs.BilinearForm]]:
        """What acts from outside, one after the other: on which boundary, and its forces."""
        at, found = self.layout.fields(self.fes.TrialFunction()), []
        for load, part in self._load_terms():
            acting = ngs.BilinearForm(self.fes)
            acting += part
            found.append((getattr(load, "boundary", None), acting))
        for contact in self.contacts:
            acting = ngs.BilinearForm(self.fes)
            self._joined.append(contact.join(acting, at, self.kinematics))
            found.append((contact.wall, acting))
        return found + self.friction.forms()

    def _load_terms(self) -> list[tuple[Load, Any]]:
        """Each load with its part of a form."""
        at, test = (self.layout.fields(of) for of in self.fes.TnT())
        place, cavities = self.place(at.u, test.u), iter(at.cavities)
        found = []
        for load in self.loads:
            if isinstance(load, Pressure):
                found.append((load, load.work(place)))
            elif isinstance(load, CavityVolume):
                found.append((load, ngs.Variation(load.energy(place, next(cavities)))))
            else:
                found.append((load, ngs.Variation(load.energy(place))))
        return found


def _unit(i: int, dim: int) -> CoefficientFunction:
    return ngs.CF(tuple(float(i == j) for j in range(dim)))
