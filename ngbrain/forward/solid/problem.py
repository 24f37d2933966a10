"""The nonlinear solid: tissue, supports, loads, contacts and inertia on one mesh, as one residual and one tangent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.common.dirichlet import Support, Supports
from ngbrain.forward.common.elements import ElementPair
from ngbrain.forward.common.kinematics import SolidKinematics
from ngbrain.forward.common.loads import CavityVolume, Load
from ngbrain.forward.common.material import Material
from ngbrain.forward.common.regions import boundaries, check_apart, check_regions, check_types
from ngbrain.forward.contact.force_control import ForceControlledTool, PrescribedForce
from ngbrain.forward.contact.friction import Friction, FrictionTerm
from ngbrain.forward.contact.rigid import RigidContact, SlidingSupport, WallContact
from ngbrain.forward.solid.external_loads import ExternalLoads
from ngbrain.forward.solid.inertia import Inertia, InertiaTerm
from ngbrain.forward.solid.stateful import Stateful
from ngbrain.forward.solid.tangent import Tangent
from ngbrain.forward.solid.tissue import TissueTerm
from ngbrain.look import NotebookCard
from ngbrain.solvers import linear
from ngbrain.solvers.record import Clock

Array = np.ndarray
RELATIVE = 0.01
"""Scale of corrections, relative to the body's size; that of pressures is its shear modulus."""
GAP = 1e-3
"""Scale of corrections (m) with contacts, where displacements far smaller than a body matter."""
WORTH_REUSING = 100_000
"""Unknowns in 3-D above which a Krylov method with an old factorisation is tried before a new one (at 76 000 both take equally
long, and the cost of a factorisation grows twice as fast):"""
ROUGHLY, AT_MOST = 0.1, 6
"""relative residual that it has to reach, and iterations allowed."""


class Problem(NotebookCard, Stateful):
    """Nonlinear solid: energy Σ W(F; history) + U(J) or p(J - 1) - p²/2K, + loads + contacts + inertia, stationary at equilibrium.

    Steps are made by `advance`, in a `LoadPath` or a `TimeStepper`. The GridFunctions hold the current state.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        2-D or 3-D, of any element shape.
    materials : dict
        Region pattern → `Material`, elastic or viscoelastic.
    boundary_conditions : dict
        Boundary pattern → displacement there at load factor 1: 0, a vector (m), or components with None where free; at shared
        nodes the later pattern counts.
    loads : sequence
        Of `ngbrain.forward.common.loads`, and one `Inertia`.
    contacts : sequence
        `RigidContact`, `Friction`, `SlidingSupport`, `SelfContact`, and one `PrescribedForce` of force-controlled rigid bodies.
    element : str or ElementPair
        "P2/P1", "P4/L2(2)", "P3", …, or "auto"; refused if its inf-sup constant decreases under refinement. An `ElementPair`
        is used as it is.
    kinematics : SolidKinematics
        `PlaneStrain` (default in the plane), `Axisymmetric`.
    solver : str
        A name of `ngbrain.solvers.linear`, or "auto".
    bonus : int
        Orders of quadrature beyond 2k, for bodies without internal variables.
    history : bool, optional
        Whether there are internal variables, and stresses, at the quadrature points; by default for viscoelastic tissue, and
        with contacts or inertia.

    Attributes
    ----------
    x : all unknowns as one array
    fes, gfu, u, p, offset : their space, and GridFunctions of them: all, displacement, pressure and offset of contacts
    terms : terms with internal variables: tissue, friction, inertia, force-controlled tool; see `state` and `set_state`
    factor : load factor (`ngs.Parameter`)
    history : internal variables of viscoelastic tissue; an error for an elastic body without contacts and inertia
    choice : the element and the linear solver, and why they were chosen
    fixed, prescribed : mask of constrained displacement unknowns, and their values (m)

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

    PICTURE = "ngbrain.workflows.preview:plot_problem"

    assembled: bool
    factored: bool
    focused: bool
    _tangent: Tangent | None

    def __init__(
        self,
        mesh: ngs.Mesh,
        materials: Mapping[str, Material],
        boundary_conditions: Mapping[str, Support] | None = None,
        loads: Sequence[Load | Inertia] = (),
        contacts: Sequence[WallContact | Friction | PrescribedForce] = (),
        element: str | ElementPair = "auto",
        kinematics: SolidKinematics | None = None,
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
        check_contacts(mesh, conditions, contacts)
        masses = [load for load in loads if isinstance(load, Inertia)]
        self.loads = tuple(load for load in loads if not isinstance(load, Inertia))
        self.contacts = tuple(each for each in contacts if not isinstance(each, (Friction, PrescribedForce)))
        rigid = [each for each in self.contacts if isinstance(each, RigidContact)]
        self._cavities = [load for load in self.loads if isinstance(load, CavityVolume)]
        relaxes = any(m.viscous.branches for m in materials.values())
        through_time = relaxes or (bool(contacts or masses) if history is None else history)
        super().__init__(mesh, materials, conditions, element, kinematics, through_time, rigid, len(self._cavities))
        self.clock, self.partial = Clock(), False
        parts, solid = (self.layout, self.gfu), self.kinematics
        self.factor, self._swelling_size = ngs.Parameter(0.0), 0.0
        self.tissue = TissueTerm(*parts, solid, materials, self.element, through_time, bonus, self.factor)
        self.friction = FrictionTerm(*parts, [each for each in contacts if isinstance(each, Friction)], solid)
        self.inertia = InertiaTerm(*parts, masses, solid, self.element.order) if masses else None
        acting = self.fes, self.layout, solid, self.element.order, self.factor
        self.external = ExternalLoads(*acting, self.loads, self.contacts)
        self.gaps = [each.gaps(self.u) for each in rigid]
        given = next((each for each in contacts if isinstance(each, PrescribedForce)), None)
        if given is not None:
            self.tool = ForceControlledTool(given, *parts, self.contacts, self.friction, solid, self.min_gap)
        self.terms = tuple(
            term for term in (self.tissue, self.external, self.friction, self.inertia, self.tool) if term is not None
        )
        size = GAP if contacts else RELATIVE * np.ptp([vertex.point for vertex in mesh.vertices], axis=0).max()
        self._scale = np.where(self._lengths, size, self.modulus)
        self._set_free(ngs.BitArray(self.fes.FreeDofs()))
        chosen = self._linear_solver(self.pivots, bool(self.contacts))
        self.solver = chosen.name if solver == "auto" else solver
        self.choice["solver"] = chosen.why if solver == "auto" else "asked for"
        self._last_factor: linear.Solve | None = None
        self._make_forms()

    # Interface of Newton's method (solvers.newton.System).

    def summary(self) -> dict[str, str]:
        """Regions, elements, unknowns, conditions and loads in words."""
        laws = [f"{pattern}: {type(material.law).__name__}" for pattern, material in self.materials.items()]
        acting = [type(each).__name__ for each in (*self.loads, *self.contacts)]
        return {
            "materials": ", ".join(laws),
            "mesh": f"{self.mesh.ne} elements in {self.mesh.dim}-D",
            "element": str(self.element),
            "unknowns": f"{self.fes.ndof} unknowns",
            "solver": self.solver,
        } | ({"loads and contacts": ", ".join(acting)} if acting else {})

    def load(self, x: Array, t: float) -> Array:
        """Set the load factor, and the prescribed displacements in the unknowns.

        Parameters
        ----------
        x : array (n,)
            Unknowns.
        t : float
            Load factor.

        Returns
        -------
        array (n,)
            A copy with the prescribed values at t.
        """
        self.factor.Set(t)
        self._swelling_size = t * self._swelling_force()
        x = x.copy()
        x[: len(self.fixed)][self.fixed] = t * self.prescribed[self.fixed]
        return x

    def residual(self, x: Array) -> tuple[Array, float]:
        """Residual on the free unknowns, and the norm of the reactions and applied nodal forces."""
        with self.clock("residual"):
            self._set_unknowns(x)
            r, outer = self.tissue.forces(), self._outer_forces()
            size = float(np.linalg.norm((r + outer if self.contacts else r)[self.is_u]))
            size = max(size, self._swelling_size)
            r = r + outer
            if self.inertia is not None:
                r[self.is_u] += self.inertia.forces()
            r = r * self._free
        return r if self.tool is None else np.append(r, self.tool.force_residual()), size

    def _swelling_force(self) -> float:
        """Norm of nodal forces (N) of μ times the swelling: scale of the residual, as free swelling has no reactions."""
        found = {name: material.swelling for name, material in self.materials.items() if material.swells}
        if not found:
            return 0.0
        test = self.layout.fields(self.fes.TestFunction()).u
        spread = ngs.Trace(self.kinematics.change(test, ngs.Grad(test)))
        push = self._moduli * self.mesh.MaterialCF(found, default=0.0) * spread
        form = ngs.LinearForm(self.fes)
        form += self.kinematics.weight() * push * ngs.dx(intrules=self.tissue.rules)
        form.Assemble()
        return float(np.linalg.norm(form.vec.FV().NumPy()[self.is_u]))

    def factorise(self, x: Array, r: Array | None = None) -> linear.Solve:
        """Solver with the tangent at x.

        It is that of `refactorise` if accurate enough for r (`partial` says so). For large bodies without a focus an old
        factorisation serves as a preconditioner where that pays off; otherwise the tangent is factorised anew.

        Parameters
        ----------
        x : array (n,)
            Unknowns.
        r : array (n,), optional
            Residual there.

        Returns
        -------
        callable
            r ↦ K⁻¹ r.
        """
        self.partial = False
        if self._tangent is not None:
            solve = None if r is None else self.refactorise(x, r)
            self.partial = solve is not None
            if solve is not None:
                return solve
            self._set_unknowns(x)
            self.tissue.stiffen()
            return self._bordered(self._tangent.renew(self.gfu.vec))
        self._set_unknowns(x)
        with self.clock("assemble"):
            self.tissue.stiffen()
            self.form.AssembleLinearization(self.gfu.vec)
        self.assembled = True
        if r is not None and self._last_factor and self.mesh.dim == 3 and self.fes.ndof > WORTH_REUSING:
            with self.clock("solve"):
                solve = linear.reuse_factor(self.form, self._last_factor, r[: self.fes.ndof], ROUGHLY, AT_MOST)
            if solve:
                return self._bordered(self._timed(solve))
        self._last_factor = None  # frees the memory of the old one first
        with self.clock("factor"):
            self._last_factor = self.new_factor()
        self.factored = True
        return self._bordered(self._timed(self._last_factor))

    def refactorise(self, x: Array, r: Array | None = None) -> linear.Solve | None:
        """Solver with the tangent renewed in the elements of `focus`, and as last factorised elsewhere.

        Parameters
        ----------
        x : array (n,)
            Unknowns.
        r : array (n,), optional
            Residual there.

        Returns
        -------
        callable or None
            None without a focus or a factorisation, and if the solution for r is too inaccurate.
        """
        if not self.focused:
            return None
        assert self._tangent is not None
        self._set_unknowns(x)
        self.tissue.stiffen(self._focus_points)
        solve = self._tangent.refresh(self.gfu.vec, None if r is None else r[: self.fes.ndof])
        return solve and self._bordered(solve)

    def _bordered(self, solve: linear.Solve) -> linear.Solve:
        """Solver bordered by the force balance of a force-controlled tool, if there is one."""
        return solve if self.tool is None else self.tool.bordered_solver(solve, self._free)

    def min_det(self, x: Array) -> float:
        """Smallest det F over all quadrature points."""
        with self.clock("check"):
            self.x = x
            return self.tissue.min_det()

    def _timed(self, solve: linear.Solve) -> linear.Solve:
        def timed(r: Array) -> Array:
            with self.clock("solve"):
                return solve(r)

        return timed

    @property
    def last_factor(self) -> linear.Solve | None:
        """The last factorisation of `factorise`."""
        return self._last_factor

    def tangent(self) -> linear.Solve:
        """Solver with a new factorisation of the tangent at the current state."""
        self.form.AssembleLinearization(self.gfu.vec)
        return self.new_factor()

    def invalidate_tangent(self) -> None:
        """Mark tangent and factorisation as out of date, after a change of parameters."""
        self.assembled = self.factored = False

    # Partial renewal of the tangent.

    def hold(self, elements: Array) -> None:
        """Fix all unknowns of some elements (a mask) at their current values; these elements are no longer integrated."""
        self._check_symmetric()
        self.tissue.leave_out(elements)
        self._set_free(self._without(elements))
        self._tangent = Tangent(self.form, self._free_dofs, self._weights)

    def focus(self, elements: Array) -> None:
        """Set the elements (a mask) in which `factorise` renews the tangent; contacts are always included."""
        self._check_symmetric()
        tissue = self.tissue.energies()
        for term in tissue:
            term.SetDefinedOnElements(ngs.BitArray(elements))
        self.focused, self._focus_points = True, self.tissue.points_in(elements)
        part = self._form(tissue)
        self._tangent = Tangent(self.form, self._free_dofs, self._weights, part, self._without(~elements))

    def _check_symmetric(self) -> None:
        """A partial tangent is factorised without pivoting and without static condensation."""
        if not self.symmetric or self._cavities or self._condense:
            found = "a follower pressure, a cavity's pressure or condensed pressures"
            raise InputError("problem", f"with {found}", "one without, for a tangent that is renewed in part")

    def _without(self, elements: Array) -> ngs.BitArray:
        """Free unknowns that belong to none of some elements (a mask)."""
        free = ngs.BitArray(self._free_dofs)
        for element in self.mesh.Elements():
            if elements[element.nr]:
                for dof in self.fes.GetDofNrs(element):
                    free.Clear(dof)
        return free

    def _set_free(self, free: ngs.BitArray) -> None:
        self._free_dofs = free
        self._free = np.fromiter(free, bool, self.fes.ndof).astype(float)
        self._weights = self._free / self._scale**2 / self.fes.ndof
        self.focused = False
        self._tangent = None

    # Assembly.

    @property
    def weights(self) -> Array:
        """Weights of squared corrections: 1/scale² of each unknown, 0 where it is fixed."""
        return self._weights if self.tool is None else np.append(self._weights, self.tool.weight)

    @property
    def pivots(self) -> str:
        """Reason why the linear solver has to pivot; empty if it has not."""
        if not self.symmetric:
            return "a follower pressure has no energy"
        if self._cavities:
            return "a cavity's pressure is an unknown"
        return "K is infinite" if np.isinf(self.ratio) else ""

    @property
    def symmetric(self) -> bool:
        """Whether the tangent is symmetric: a follower pressure has no energy."""
        return self.external.symmetric

    def with_materials(self, materials: Mapping[str, Material]) -> None:
        """Replace the materials."""
        self.materials = dict(materials)
        self.tissue.materials = self.materials
        self.tissue.make()
        self._make_forms()

    def _make_forms(self) -> None:
        """Make the form, and the function that factorises its matrix."""
        self.form = self._form(self.tissue.terms)
        self.new_factor = linear.prepare(self.solver, self.form, self._moduli)
        self._last_factor = None
        self.__dict__.pop("uncondensed", None)
        self.invalidate_tangent()

    @cached_property
    def uncondensed(self) -> ngs.BilinearForm:
        """The form without static condensation, for products with the tangent."""
        return self._form(self.tissue.terms, condense=False) if self._condense else self.form

    def _form(self, tissue: Sequence[ngs.comp.BFI], condense: bool | None = None) -> ngs.BilinearForm:
        """Energies of tissue, contacts, friction, loads and inertia."""
        condense = self._condense if condense is None else condense
        form = ngs.BilinearForm(self.fes, symmetric=self.symmetric, condense=condense)
        for part in tissue:
            form += part
        for term in self.terms[1:]:
            term.join(form)
        return form


def check_contacts(
    mesh: ngs.Mesh, conditions: Mapping[str, Support], contacts: Sequence[WallContact | Friction | PrescribedForce]
) -> None:
    """Check contacts against supports and each other.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    conditions : dict
        Boundary pattern → support.
    contacts : sequence

    Raises
    ------
    InputError
        For walls in contact that are constrained, sliding walls that meet a rigid body, and several prescribed forces.
    """
    if not contacts:
        return
    rigid = [each for each in contacts if isinstance(each, RigidContact)]
    fixed = {p for p, components in Supports(mesh, conditions).components.items() if len(components) == mesh.dim}
    walls = [each.wall for each in contacts if not isinstance(each, PrescribedForce)]
    check_apart(mesh, "|".join(fixed), walls)
    for film in (each for each in contacts if isinstance(each, SlidingSupport)):
        check_apart(mesh, film.wall, [each.wall for each in rigid])
    given = [each for each in contacts if isinstance(each, PrescribedForce)]
    if len(given) > 1:
        raise InputError("contacts", f"with {len(given)} prescribed forces", "one for each body")
    if given and not any(each.travel is given[0].parameter for each in rigid):
        raise InputError(
            "contacts",
            "with a prescribed force that acts on none of them",
            "a RigidContact whose travel is its parameter",
        )
