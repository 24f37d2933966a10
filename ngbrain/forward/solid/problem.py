"""The nonlinear solid: tissue, supports, loads, contacts and inertia on one mesh, as one residual and one tangent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.arguments import of_type
from ngbrain.errors import InputError
from ngbrain.forward.common.dirichlet import Support, Supports
from ngbrain.forward.common.element_choice import automatic
from ngbrain.forward.common.elements import Form, check_elements
from ngbrain.forward.common.kinematics import Solid, kinematics_of
from ngbrain.forward.common.loads import CavityVolume, Load, Pressure
from ngbrain.forward.common.material import Material, stiffness
from ngbrain.forward.common.regions import boundaries, check_apart, check_regions, check_types
from ngbrain.forward.common.unknowns import Layout
from ngbrain.forward.contact.friction import Friction, Grip
from ngbrain.forward.contact.rigid import Contact, Sliding, Touch, offsets, surface_rules
from ngbrain.forward.solid.inertia import Inertia, Momentum
from ngbrain.forward.solid.reactions import Reactions
from ngbrain.forward.solid.tangent import Tangent
from ngbrain.forward.solid.time_steps import TimeSteps
from ngbrain.forward.solid.tissue import Tissue, history_order
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


class Problem(TimeSteps, Reactions):
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
        Of `ngbrain.forward.common.loads`, and one `Inertia`.
    contacts : sequence
        Rigid bodies that walls meet, their friction, walls that slide, and walls that close on each other.
    element : str or Form
        "P2/P1", "P4/L2(2)", "P3", …, or "auto"; refused if its inf-sup constant falls with the mesh. A `Form` is taken at its word.
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
    >>> from ngbrain.forward.statics.load_path import LoadPath
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
        self._check_symmetric()
        self.tissue.leave_out(elements)
        self._release(self._without(elements))
        self._tangent = Tangent(self.form, self._free_dofs, self.weights)

    def focus(self, elements: Array) -> None:
        """Elements (a mask) where the tangent changes most, for `factorise`; contacts always belong to them."""
        self._check_symmetric()
        tissue = self.tissue.energies()
        for term in tissue:
            term.SetDefinedOnElements(ngs.BitArray(elements))
        self.focused, self._near = True, self.tissue.points_in(elements)
        part = self._form(tissue)
        self._tangent = Tangent(self.form, self._free_dofs, self.weights, part, self._without(~elements))

    def _check_symmetric(self) -> None:
        """Parts of a tangent are factorised without pivots and, of discontinuous pressures, as a whole."""
        if not self.symmetric or self._cavities or self._condense:
            found = "a follower pressure, a cavity's pressure or condensed pressures"
            raise InputError("problem", f"with {found}", "one without, for a tangent that is renewed in part")

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
        self.focused = False
        self._tangent = None

    # How it is made.

    @staticmethod
    def _check_contacts(
        mesh: ngs.Mesh, conditions: Mapping[str, Support], contacts: Sequence[Any], rigid: Sequence[Contact]
    ) -> None:
        held = {p for p, components in Supports(mesh, conditions).held.items() if len(components) == mesh.dim}
        check_apart(mesh, "|".join(held), [each.wall for each in contacts])
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
        if self.contacts:
            return linear.Choice("sparsecholesky", "contacts come and go, which preconditioners are not made for")
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
