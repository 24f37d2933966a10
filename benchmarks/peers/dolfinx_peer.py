"""What one writes with dolfinx: UFL energies, PETSc's undamped Newton and MUMPS; pressure in a space of its own."""

from __future__ import annotations

import os
import time

import _case as c
import numpy as np
import ufl
from mpi4py import MPI  # loads the library that PETSc needs

# isort: split
import basix.ufl
import dolfinx
from dolfinx import fem, mesh
from dolfinx.fem.petsc import NonlinearProblem
from petsc4py import PETSc

OPTIONS = {
    "snes_type": "newtonls",
    "snes_linesearch_type": os.environ.get("PEER_LINE_SEARCH", "none"),
    "snes_rtol": 1e-9,
    "snes_atol": 1e-10,
    "snes_stol": 1e-14,
    "snes_max_it": c.MAX_NEWTON,
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
    "mat_mumps_icntl_14": 60,
}
JIT = {"cffi_extra_compile_args": ["-O3", "-march=native", "-ffast-math"]}  # a third faster than as it comes
PHASES = {"SNESFunctionEval": "assemble", "SNESJacobianEval": "assemble", "MatSolve": "solve"}
PHASES |= {"MatLUFactorSym": "factor", "MatLUFactorNum": "factor"}


def domain(task: c.Task) -> mesh.Mesh:
    """The mesh of a case."""
    n, simplex = task.n, task.element.shape == "P"
    if task.case == "cook":
        kind = mesh.CellType.triangle if simplex else mesh.CellType.quadrilateral
        made = mesh.create_unit_square(MPI.COMM_SELF, n, n, kind, diagonal=mesh.DiagonalType.right)
        made.geometry.x[:, 0], made.geometry.x[:, 1] = c.cook_map(*made.geometry.x[:, :2].T.copy())
        return made
    kind = mesh.CellType.tetrahedron if simplex else mesh.CellType.hexahedron
    return mesh.create_box(MPI.COMM_SELF, [[0, 0, 0], [c.L] * 3], [n] * 3, kind)


def wave(task: c.Task):
    """The top's motion over its largest."""
    if task.case == "block":
        return lambda x: np.vstack([0 * x[0], 0 * x[0], 1 + 0 * x[0]])
    return lambda x: np.vstack([0 * x[0], 0 * x[0], np.cos(np.pi * x[0] / c.L) * np.cos(np.pi * x[1] / c.L)])


class Problem:
    """A case's spaces, energy, supports and solver."""

    def __init__(self, task: c.Task) -> None:
        element, self.cook, self.domain = task.element, task.case == "cook", domain(task)
        cell, dim, order = self.domain.basix_cell(), self.domain.topology.dim, element.order
        self.V = fem.functionspace(self.domain, basix.ufl.element("Lagrange", cell, order, shape=(dim,)))
        self.u, self.p, spaces = fem.Function(self.V), None, [self.V]
        if element.pressure is not None:
            family = "Lagrange" if element.continuous else "DG"
            spaces.append(fem.functionspace(self.domain, basix.ufl.element(family, cell, element.pressure)))
            self.p = fem.Function(spaces[1])
        self.unknowns = [self.u] if self.p is None else [self.u, self.p]
        self.ndof = sum(s.dofmap.index_map.size_global * s.dofmap.index_map_bs for s in spaces)
        self.load = fem.Constant(self.domain, 0.0)
        energy = self.energy(2 * order)
        forms = [ufl.derivative(energy, w, ufl.TestFunction(s)) for w, s in zip(self.unknowns, spaces, strict=True)]
        pairs = list(zip(self.unknowns, spaces, strict=True))
        slopes = [[ufl.derivative(F, w, ufl.TrialFunction(s)) for w, s in pairs] for F in forms]
        with task.phase("compile"):
            self.forces, jacobian = fem.form(forms, jit_options=JIT), fem.form(slopes, jit_options=JIT)
        self.driven, self.top = fem.Function(self.V), None
        supports = self.supports(task)
        alone = self.p is None
        self.solver = NonlinearProblem(
            self.forces[0] if alone else self.forces,
            self.u if alone else self.unknowns,
            J=jacobian[0][0] if alone else jacobian,
            bcs=supports,
            kind=None if alone else "mpi",
            petsc_options_prefix="peer_",
            petsc_options=OPTIONS,
        )

    def energy(self, degree: int) -> ufl.Form:
        """The case's energy, less the work of its load."""
        u, p = self.u, self.p
        dx = ufl.Measure("dx", domain=self.domain, metadata={"quadrature_degree": degree})
        F = ufl.Identity(len(u)) + ufl.grad(u)
        J, I1 = ufl.det(F), ufl.inner(F, F)
        if self.cook:
            bulk, shear, swelling = c.COOK_K, c.COOK_MU / 2 * (I1 + 1 - 3 - 2 * ufl.ln(J)), ufl.ln(J)
        else:
            bulk, shear, swelling = c.K, c.MU / 2 * (J ** (-2 / 3) * I1 - 3), J - 1
        inside = (shear + (bulk / 2 * swelling**2 if p is None else p * swelling - p**2 / (2 * bulk))) * dx
        if not self.cook:
            return inside
        right = self.facets(lambda x: np.isclose(x[0], c.CORNER[0]))
        tags = mesh.meshtags(self.domain, self.domain.topology.dim - 1, np.sort(right), np.ones(len(right), np.int32))
        return inside - self.load * c.TRACTION * u[1] * ufl.Measure("ds", domain=self.domain, subdomain_data=tags)(1)

    def facets(self, where) -> np.ndarray:
        """Boundary facets."""
        return mesh.locate_entities_boundary(self.domain, self.domain.topology.dim - 1, where)

    def supports(self, task: c.Task) -> list:
        """What is prescribed; `driven` holds the top's motion."""
        dim, held = self.domain.topology.dim, fem.Function(self.V)

        def dofs(space, where):
            return fem.locate_dofs_topological(space, dim - 1, self.facets(where))

        if self.cook:
            return [fem.dirichletbc(held, dofs(self.V, lambda x: np.isclose(x[0], 0)))]
        found = []
        for i in (0, 1) if task.case == "smooth" else ():
            side, part = (lambda x, i=i: np.isclose(x[i], 0) | np.isclose(x[i], c.L)), self.V.sub(i)
            found.append(fem.dirichletbc(PETSc.ScalarType(0), dofs(part, side), part))
        self.top = dofs(self.V, lambda x: np.isclose(x[2], c.L))
        found.append(fem.dirichletbc(held, dofs(self.V, lambda x: np.isclose(x[2], 0))))
        return [*found, fem.dirichletbc(self.driven, self.top)]

    def value(self, task: c.Task) -> float:
        """Of the case."""
        if self.cook:
            points = self.V.tabulate_dof_coordinates()[:, :2]
            return float(self.u.x.array.reshape(-1, 2)[np.argmin(np.abs(points - c.CORNER).sum(axis=1)), 1])
        shape = fem.Function(self.V)
        shape.interpolate(wave(task))
        forces = fem.assemble_vector(self.forces[0]).array.reshape(-1, 3)
        return float((forces * shape.x.array.reshape(-1, 3))[self.top].sum())


def solve(task: c.Task) -> dict:
    """PETSc's Newton in equal load steps."""
    PETSc.Log.begin()
    problem, newton, start = Problem(task), 0, (c.cpu(), time.perf_counter())
    motion = wave(task)
    push = c.WAVE if task.case == "smooth" else c.PRESS
    snes = problem.solver.solver
    try:
        for step in range(1, task.steps + 1):
            problem.load.value = step / task.steps
            if not problem.cook:
                problem.driven.interpolate(lambda x, s=step: push * s / task.steps * motion(x))
            problem.solver.solve()
            newton += snes.getIterationNumber()
            if snes.getConvergedReason() <= 0:
                names = {v: k for k, v in vars(PETSc.SNES.ConvergedReason).items() if isinstance(v, int)}
                reason = names.get(snes.getConvergedReason(), snes.getConvergedReason())
                raise c.Failed(f"PETSc: {reason}", newton=newton, ndof=problem.ndof)
    finally:
        share = (c.cpu() - start[0]) / (time.perf_counter() - start[1])  # PETSc's log has wall times
        for event, name in PHASES.items():
            spent = share * PETSc.Log.Event(event).getPerfInfo()["time"]
            task.phases[name] = task.phases.get(name, 0.0) + spent
    return {"value": problem.value(task), "ndof": problem.ndof, "newton": newton}


if __name__ == "__main__":
    c.main("dolfinx", solve, {"dolfinx": dolfinx.__version__, "numpy": np.__version__})
