"""Equilibrium of elastic bodies under loads: any law, K/μ to infinity, plane, axisymmetric or in space."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.arguments import of_type
from ngbrain.errors import Breakdown, CollapseWarning, Failure, SolverError, StabilityWarning, gave_up
from ngbrain.forward import stability
from ngbrain.forward.choice import COMPRESSIBLE, automatic
from ngbrain.forward.elements import Form, check_elements
from ngbrain.forward.held import check_held
from ngbrain.forward.kinematics import Solid, kinematics_of
from ngbrain.forward.loads import CavityVolume, Load, Place, Pressure, volume
from ngbrain.forward.material import Material, stiffness
from ngbrain.forward.patterns import boundaries, check_regions, check_types
from ngbrain.forward.supports import Support, Supports
from ngbrain.materials.base import Deformation
from ngbrain.solvers import continuation, linear
from ngbrain.solvers.newton import Newton
from ngbrain.solvers.record import Clock, PathRecord
from ngbrain.threads import threads as using

RELATIVE = 0.01
"""Corrections are judged against this share of the body's size, pressures against its shear modulus."""
CONDENSE_UP_TO = 1e6
"""K/μ up to which discontinuous pressures are eliminated element by element; beyond, that loses digits."""
WORTH_REUSING = 100_000
"""Unknowns in space from which on a Krylov method with an old factor is tried before a new one is made (at 76 000 it took as
long as a new one, which grows twice as fast):"""
ROUGHLY, AT_MOST = 0.1, 6
"""it has to bring the first residual down to this share in so many iterations."""

UPHILL = 4
"""`Newton.watch` of displacement forms."""
GUARD = 0.05
"""Barrier against collapse at single points, in shear moduli, that a body gets which does not go without."""


class Static:
    """A body under loads that grow with a factor t from 0 to 1: energy Σ W(F) + p(J - 1) - p²/2K + loads.

    mesh        NGSolve mesh, in the plane or in space
    materials   region pattern → `Material` (elastic)
    supports    boundary pattern → what is prescribed there at t = 1: 0, a vector (m) or components, None where free; where
                patterns share nodes the later one counts
    loads       of `ngbrain.forward.loads`
    form        "P2/P1", "P4/L2(2)", "P3", …, refused if its inf-sup constant falls with the mesh (a `Form` is taken at its
                word), or "auto"
    kinematics  `PlaneStrain` (default in the plane), `Axisymmetric`
    solver      a name of `ngbrain.solvers.linear`, or "auto"
    bonus       orders of quadrature beyond 2k

    Attributes: `fes`, `gfu` (compound where there are pressures), `u`, `p`, `state`, `choice` (what was chosen, and why);
    `held` and `prescribed`, which displacement unknowns are held and where (m).
    Raises `InputError` for a pattern that matches nothing, a refused form, an inverted element.

    >>> from ngbrain.materials import NeoHooke
    >>> from ngbrain.mesh import block
    >>> cube = block((0.1, 0.1, 0.1), 0.1)
    >>> body = Static(cube, {".*": Material(NeoHooke(1e3), 1e5)}, {"bottom": 0, "top": (0, 0, -0.01)}, form="P2/P1")
    >>> record = body.solve()
    >>> record.converged, bool(body.force("top")[2] < 0)
    (True, True)
    """

    def __init__(
        self,
        mesh: ngs.Mesh,
        materials: Mapping[str, Material],
        supports: Mapping[str, Support],
        loads: Sequence[Load] = (),
        form: str | Form = "auto",
        kinematics: Solid | None = None,
        solver: str = "auto",
        bonus: int = 0,
    ) -> None:
        check_types(mesh, materials, supports)
        check_regions(mesh, materials)
        for load in loads:
            if hasattr(load, "boundary"):
                boundaries(mesh, load.boundary)
        self.mesh, self.materials, self.loads = mesh, dict(materials), tuple(loads)
        self.kinematics = kinematics_of(mesh, kinematics)
        self.supports = Supports(mesh, supports)
        self._moduli, self.modulus, self.ratio = stiffness(mesh, materials)
        self.form, why = self._choose(form)
        self._condense = self.form.kind == "discontinuous pressure" and self.ratio <= CONDENSE_UP_TO
        self._symmetric = not any(isinstance(load, Pressure) for load in loads)
        spaces = self.form.spaces(mesh, self._condense, **self.supports.dirichlet)
        self._cavities = [load for load in loads if isinstance(load, CavityVolume)]
        spaces += [ngs.NumberSpace(mesh) for _ in self._cavities]
        self.fes = spaces[0] if len(spaces) == 1 else ngs.FESpace(spaces)
        self.gfu = ngs.GridFunction(self.fes)
        self.u = self.gfu if len(spaces) == 1 else self.gfu.components[0]
        self.p = self.gfu.components[1] if self.form.pressure is not None else None
        self.factor = ngs.Parameter(0.0)
        self.clock = Clock()
        self._kept: linear.Solve | None = None
        shapes = {element.type for element in mesh.Elements()}
        self.rules = {shape: ngs.IntegrationRule(shape, 2 * self.form.order + bonus) for shape in shapes}
        check_elements(mesh)
        self._det = ngs.Det(self.kinematics.gradient(self.u, ngs.Grad(self.u))).Compile()
        self._points = mesh.MapToAllElements(self.rules, ngs.VOL)
        self.is_u = np.arange(self.fes.ndof) < spaces[0].ndof
        self.prescribed, self.held = self.supports.coefficients(spaces[0])
        free = np.fromiter(self.fes.FreeDofs(), bool, self.fes.ndof)
        size = RELATIVE * np.ptp([vertex.point for vertex in mesh.vertices], axis=0).max()
        self.weights = free / np.where(self.is_u, size, self.modulus) ** 2 / self.fes.ndof
        self._free = free.astype(float)
        chosen = self._solver(int(np.sum(np.fromiter(self.fes.FreeDofs(self._condense), bool))))
        self.solver = chosen.name if solver == "auto" else solver
        self.choice = {"form": f"{self.form}: {why}", "solver": chosen.why if solver == "auto" else "asked for"}
        self._make_forms()
        self._vec = self.gfu.vec.CreateVector()

    def solve(
        self,
        steps: int = 1,
        newton: Newton | None = None,
        tell: Callable[[float], None] | None = None,
        threads: int | None = None,
        start: np.ndarray | None = None,
    ) -> PathRecord:
        """Equilibrium at t = 1 from rest, in `steps` load steps, and more where one fails.

        newton    settings; `Static.newton` gives those that the form needs, with others of yours
        tell      called with the load factor after every step
        threads   for this solve; None leaves NGSolve's as they are
        start     a state (ndof,) near the one at t = 1, such as a coarser body's: the way from rest is gone if it is not near

        Raises `InputError` for a body that nothing holds, and `InvertedElementError` or `ConvergenceError` when steps get too
        short; they carry the `record`, and the body holds the last equilibrium reached.
        """
        check_held(self.supports, self.loads, self.kinematics)
        newton = newton or self.newton()
        with using(threads):
            near = None if start is None else continuation.resumed(self, newton, start, steps, tell)
            x, record = near or self._follow(newton, steps, tell)
            if not record.converged and record.min_det_F < continuation.COLLAPSED and self.ratio > COMPRESSIBLE:
                x, record = self._guarded(newton, steps, tell, record)
        self.state = x
        record.seconds, record.ndof = dict(self.clock.seconds), self.fes.ndof
        record.form, record.solver = self.choice["form"], f"{self.solver}: {self.choice['solver']}"
        if not record.converged:
            raise self._error(record)
        if record.min_det_F < continuation.COLLAPSED and self.ratio > COMPRESSIBLE:
            found = f"det F is {record.min_det_F:.2g} at a point though K/μ is {self.ratio:.3g}"
            warnings.warn(f"{found}: the mesh is too coarse there, or the body folds", CollapseWarning, stacklevel=2)
        with using(threads):
            self._ask_stability(record)
        return record

    def newton(self, **settings: Any) -> Newton:
        """Newton's method as the form needs it, with settings such as rtol=1e-10."""
        return Newton(**{"watch": UPHILL if self.form.pressure is None else 0, **settings})

    def _ask_stability(self, record: PathRecord) -> None:
        """Whether a body that is compressed far is stable; a warning if it is not, or if its free surface creases."""
        record.pressed, record.creased = stability.pressed(self), stability.creased(self)
        if max(record.pressed, record.creased) <= stability.SHARE:
            return
        said = f"{self.solver} cannot say whether the body is stable"
        if self.solver in linear.DIRECT:
            record.softest = self.softest()[0]
            sign = "positive: stable" if record.softest > 0 else "negative: not stable"
            said = f"the tangent's smallest eigenvalue is {record.softest:.3g} Pa/m², {sign}"
        if record.softest < 0 or record.creased > stability.SHARE:
            by = f"compressed by more than {1 - stability.CREASE:.0%}"
            found = f"{record.pressed:.0%} of the body and {record.creased:.0%} of its free surface are {by}; {said}"
            doubt = "surfaces crease from there on, and where and how deep depends on the mesh"
            warnings.warn(f"{found}; {doubt}", StabilityWarning, stacklevel=3)

    def _follow(
        self, newton: Newton, steps: int, tell: Callable[[float], None] | None
    ) -> tuple[np.ndarray, PathRecord]:
        settings = replace(newton, inverse=None, largest=0.0)
        return continuation.follow(self, settings, np.zeros(self.fes.ndof), steps, tell)

    def _guarded(
        self, newton: Newton, steps: int, tell: Callable[[float], None] | None, before: PathRecord
    ) -> tuple[np.ndarray, PathRecord]:
        """The same with a `barrier` against collapse at single points; it stays."""
        kappa = GUARD * self.modulus
        self.materials = {p: replace(m, pointwise=m.pointwise or kappa) for p, m in self.materials.items()}
        self._make_forms()
        x, record = self._follow(newton, steps, tell)
        record.guard = f"a barrier of {kappa:.3g} Pa against collapse: without it det F fell to {before.min_det_F:.2g}"
        record.cuts, record.tried = record.cuts + before.cuts, record.tried + before.tried
        record.work += before.work
        if record.converged:
            warnings.warn(f"{self.form} on this mesh needed {record.guard}", CollapseWarning, stacklevel=3)
        return x, record

    # What is asked of a state.

    @property
    def energy(self) -> float:
        """Energy (J; in plane strain per metre) of the body and of loads that have one."""
        return float(self._form.Energy(self.gfu.vec))

    def nodal_forces(self, boundary: str) -> np.ndarray:
        """Forces (N) that act on a boundary from outside, loads on it included, one for each displacement unknown.

        They balance the body's own forces, its weight, and what loads on other boundaries put on nodes that are shared.
        """
        forces, mine = self._applied(self._tissue), boundaries(self.mesh, boundary)
        for load, acting in self._acting:
            pattern = getattr(load, "boundary", None)  # a weight has none, nor need one of a user's
            if pattern is None or not mine & boundaries(self.mesh, pattern):
                forces += self._applied(acting)
        return forces[self.is_u]

    def body_forces(self) -> np.ndarray:
        """Forces (N) that the tissue itself exerts on its nodes, one for each displacement unknown."""
        return self._applied(self._tissue)[self.is_u]

    def force(self, boundary: str) -> np.ndarray:
        """Force (N) that acts on a boundary from outside, by components: what its supports and loads exert together."""
        return np.array([self.conjugate(_unit(i, self.mesh.dim), boundary) for i in range(self.mesh.dim)])

    def conjugate(self, motion: CoefficientFunction, boundary: str) -> float:
        """Work (J) of the outer forces on a boundary for a motion (m) of it: the force that is conjugate to its amplitude."""
        field = ngs.GridFunction(self.u.space)
        field.Set(motion, definedon=self.mesh.Boundaries(boundary), dual=True)
        return float(field.vec.FV().NumPy() @ self.nodal_forces(boundary))

    def _applied(self, form: ngs.BilinearForm) -> np.ndarray:
        form.Apply(self.gfu.vec, self._vec)
        return self._vec.FV().NumPy().copy()

    def volume(self, boundary: str) -> float:
        """Volume (m³; in plane strain m²) that a cavity's boundary encloses, as far as the mesh goes."""
        return volume(self._place(self.u, self.u), self.u, boundary)

    def cavity_pressures(self) -> list[float]:
        """Pressures (Pa) of the loads that prescribe a volume, in their order."""
        n = len(self._cavities)
        return self.state[len(self.state) - n :].tolist()

    def softest(self) -> tuple[float, ngs.GridFunction]:
        """Smallest eigenvalue λ (Pa/m²) of the tangent, among the nearest to zero, and its motion; λ < 0: not stable.

        K v = λ M v with the mass M of displacements and the constraint of the pressures. Newton's method converges to states
        that are not stable just as well, and without an imperfection it never leaves them.
        """
        return stability.softest(self)

    def tangent(self) -> linear.Solve:
        """Solver with the tangent at the state, made new."""
        self._form.AssembleLinearization(self.gfu.vec)
        return self._factorise()

    def changed(self) -> None:
        """Say that parameters did: the tangent and the factor that are there, `assembled` and `factored`, are of others."""
        self.assembled = self.factored = False

    # What Newton's method and load steps ask.

    @property
    def state(self) -> np.ndarray:
        """All unknowns as one array, a copy."""
        return self.gfu.vec.FV().NumPy().copy()

    @state.setter
    def state(self, x: np.ndarray) -> None:
        self.gfu.vec.FV().NumPy()[:] = x

    def load(self, x: np.ndarray, t: float) -> np.ndarray:
        """Set the load factor; x with what is prescribed at t."""
        self.factor.Set(t)
        x = x.copy()
        x[: len(self.held)][self.held] = t * self.prescribed[self.held]
        return x

    def residual(self, x: np.ndarray) -> tuple[np.ndarray, float]:
        """Residual on the free unknowns, and the norm of the body's nodal forces; not finite where the energy is not."""
        with self.clock("residual"):
            self.state = x
            r = self._applied(self._tissue)
            size = float(np.linalg.norm(r[self.is_u]))
            if not np.isfinite(self._tissue.Energy(self.gfu.vec)):
                raise Breakdown("the energy is not finite", Failure.NOT_FINITE)
            for _, acting in self._acting:
                r += self._applied(acting)
        return r * self._free, size

    def factorise(self, x: np.ndarray, r: np.ndarray) -> linear.Solve:
        """Solver with the tangent at x: an old factor as preconditioner where that is worth it and will do, else a new one."""
        self.state = x
        with self.clock("assemble"):
            self._form.AssembleLinearization(self.gfu.vec)
        self.assembled = True
        if self._kept and self.mesh.dim == 3 and self.fes.ndof > WORTH_REUSING:
            with self.clock("solve"):
                solve = linear.reused(self._form, self._kept, r, ROUGHLY, AT_MOST)
            if solve:
                return self._timed(solve)
        self._kept = None  # the old one's memory first
        with self.clock("factor"):
            self._kept = self._factorise()
        self.factored = True
        return self._timed(self._kept)

    @property
    def kept(self) -> linear.Solve | None:
        """The last factor that `factorise` made, which is that of a tangent of then."""
        return self._kept

    def min_det(self, x: np.ndarray) -> float:
        """Smallest det F over all quadrature points."""
        with self.clock("check"):
            self.state = x
            return float(np.min(self._det(self._points)))

    def _timed(self, solve: linear.Solve) -> linear.Solve:
        def timed(r: np.ndarray) -> np.ndarray:
            with self.clock("solve"):
                return solve(r)

        return timed

    # How it is made.

    def _choose(self, form: str | Form) -> tuple[Form, str]:
        if isinstance(form, Form):
            return form, "taken at its word"
        of_type("form", form, str)
        if form == "auto":
            return automatic(self.mesh, self.ratio, self.supports.held)
        named = Form.named(form)
        named.check(self.mesh)
        return named, "asked for"

    def _solver(self, coupled: int) -> linear.Choice:
        """The linear solver for so many coupled unknowns."""
        pivots = (
            "a pressure that follows has no energy"
            if not self._symmetric
            else "a cavity's pressure is an unknown"
            if self._cavities
            else "K is infinite"
            if np.isinf(self.ratio)
            else ""
        )
        if pivots:
            return linear.Choice("umfpack", f"{pivots}, which only a factor with pivots is for")
        return linear.choose(self.form.kind, coupled, self.ratio, dim=self.mesh.dim, order=self.form.order)

    def _place(self, u: CoefficientFunction, v: CoefficientFunction) -> Place:
        return Place(self.mesh, self.kinematics, self.factor, u, v, self.form.order)

    def _make_forms(self) -> None:
        """Forms of the whole, of the body alone and of the loads alone, and what makes a solver of the whole's matrix."""
        trial, test = self.fes.TnT()
        u, *rest = trial if isinstance(trial, (list, tuple)) else [trial]
        v = test[0] if isinstance(test, (list, tuple)) else test
        p = rest.pop(0) if self.form.pressure is not None else None
        whole = ngs.BilinearForm(self.fes, symmetric=self._symmetric, condense=self._condense)
        tissue = ngs.BilinearForm(self.fes, symmetric=True)
        self._acting: list[tuple[Load, ngs.BilinearForm]] = []
        at = Deformation.of(self.kinematics.gradient(u, ngs.Grad(u)))
        for pattern, material in self.materials.items():
            energy = (self.kinematics.weight() * material.energy(at, p)).Compile()
            term = ngs.SymbolicEnergy(energy, definedon=self.mesh.Materials(pattern))
            for shape, rule in self.rules.items():
                term.SetIntegrationRule(shape, rule)
            whole += term
            tissue += term
        place = self._place(u, v)
        for load in self.loads:
            if isinstance(load, Pressure):
                part = load.work(place)
            elif isinstance(load, CavityVolume):
                part = ngs.Variation(load.energy(place, rest.pop(0)))
            else:
                part = ngs.Variation(load.energy(place))
            whole += part
            acting = ngs.BilinearForm(self.fes)
            acting += part
            self._acting.append((load, acting))
        self._form, self._tissue = whole, tissue
        self._factorise = linear.prepare(self.solver, whole, self._moduli)
        self._kept = None
        self.changed()

    def _error(self, record: PathRecord) -> SolverError:
        advice = f"try a finer or graded mesh, another form than {self.form}, or a smaller load"
        error = gave_up(f"{record.reason}; {advice}", record.failure)
        error.record = record
        return error


def _unit(i: int, dim: int) -> CoefficientFunction:
    return ngs.CF(tuple(float(i == j) for j in range(dim)))
