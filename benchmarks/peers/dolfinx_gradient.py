"""What a gradient costs dolfinx, over the solve that it is of: by hand with the factor kept, and by dolfinx-adjoint's tape.

    python benchmarks/peers/dolfinx_gradient.py N ORDER TIMES      a JSON list of records

The case is that of benchmarks/gradient_cost_statics.py, "linear": a cube between plates, one shear modulus for each tetrahedron,
but J = ½ ∫ u·u, as points are no form.
"""

from __future__ import annotations

import json
import os
from typing import Any

from _case import L
from _gradient import BULK, MOVED, arguments, known, off, timed, varied

os.environ.setdefault("MPLBACKEND", "Agg")

from mpi4py import MPI  # isort: skip  # before petsc4py, which needs its library
import dolfinx
import numpy as np
import pyadjoint
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from dolfinx.mesh import CellType, create_box, locate_entities_boundary
from dolfinx_adjoint import Function as Recorded
from dolfinx_adjoint import LinearProblem, assemble_scalar
from petsc4py import PETSc

LU = {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}


class Cube:
    """Mesh, spaces, supports and forms; moduli vary by a fifth."""

    def __init__(self, n: int, order: int) -> None:
        self.mesh = create_box(MPI.COMM_SELF, [[0.0] * 3, [L] * 3], [n] * 3, CellType.tetrahedron)
        self.V = fem.functionspace(self.mesh, ("Lagrange", order, (3,)))
        self.Q = fem.functionspace(self.mesh, ("Discontinuous Lagrange", 0))
        self.moduli = varied(self.Q.dofmap.index_map.size_local)
        self.bcs = [self._held(0.0, (0.0, 0.0, 0.0)), self._held(L, MOVED)]

    def _held(self, z: float, moved: tuple[float, ...]) -> fem.DirichletBC:
        facets = locate_entities_boundary(self.mesh, 2, lambda x: np.isclose(x[2], z))
        return fem.dirichletbc(np.array(moved), fem.locate_dofs_topological(self.V, 2, facets), self.V)

    def work(self, mu: Any, u: Any, v: Any) -> Any:
        """Virtual work."""
        return (
            2 * mu * ufl.inner(ufl.dev(ufl.sym(ufl.grad(u))), ufl.sym(ufl.grad(v))) + BULK * ufl.div(u) * ufl.div(v)
        ) * ufl.dx

    def load(self, v: Any) -> Any:
        """None."""
        return ufl.inner(fem.Constant(self.mesh, (0.0, 0.0, 0.0)), v) * ufl.dx


def by_hand(cube: Cube, times: int) -> dict[str, Any]:
    """One factor for both; the gradient is one solve and one linear form."""
    mu, u, adjoint = fem.Function(cube.Q), fem.Function(cube.V), fem.Function(cube.V)
    mu.x.array[:] = cube.moduli
    trial, v = ufl.TrialFunction(cube.V), ufl.TestFunction(cube.V)
    a, b = fem.form(cube.work(mu, trial, v)), fem.form(cube.load(v))
    J, J_u = fem.form(0.5 * ufl.inner(u, u) * ufl.dx), fem.form(ufl.inner(u, v) * ufl.dx)
    strain = [ufl.dev(ufl.sym(ufl.grad(w))) for w in (u, adjoint)]
    J_mu = fem.form(-2 * ufl.inner(*strain) * ufl.TestFunction(cube.Q) * ufl.dx)
    rest = [fem.dirichletbc(np.zeros(3), bc.dof_indices()[0] // 3, cube.V) for bc in cube.bcs]
    A = petsc.create_matrix(a)
    ksp = PETSc.KSP().create(MPI.COMM_SELF)

    def forward() -> float:
        A.zeroEntries()
        petsc.assemble_matrix(A, a, bcs=cube.bcs)
        A.assemble()
        ksp.setOperators(A)
        ksp.setType("preonly")
        ksp.getPC().setType("lu")
        ksp.getPC().setFactorSolverType("mumps")
        ksp.setUp()
        rhs = petsc.assemble_vector(b)
        petsc.apply_lifting(rhs, [a], [cube.bcs])
        petsc.set_bc(rhs, cube.bcs)
        ksp.solve(rhs, u.x.petsc_vec)
        return float(fem.assemble_scalar(J))

    def gradient() -> np.ndarray:
        rhs = petsc.assemble_vector(J_u)
        petsc.set_bc(rhs, rest)
        ksp.solve(rhs, adjoint.x.petsc_vec)
        return np.array(petsc.assemble_vector(J_mu).array)

    found, slope = timed(forward, gradient, times)

    def at(moduli: np.ndarray) -> float:
        mu.x.array[:] = moduli
        return forward()

    return {"method": "dolfinx by hand", **found, "error": off(cube.moduli, at, slope)}


def by_tape(cube: Cube, times: int) -> dict[str, Any]:
    """What is recorded while solving is gone through backwards."""
    mu = Recorded(cube.Q)
    mu.x.array[:] = cube.moduli
    pyadjoint.continue_annotation()
    u, v = Recorded(cube.V), ufl.TestFunction(cube.V)
    problem = LinearProblem(
        cube.work(mu, ufl.TrialFunction(cube.V), v), cube.load(v), bcs=cube.bcs, u=u, petsc_options=LU,
        petsc_options_prefix="cube_", adjoint_petsc_options=LU,
    )  # fmt: skip
    problem.solve()
    J = assemble_scalar(0.5 * ufl.inner(u, u) * ufl.dx)
    pyadjoint.pause_annotation()
    reduced = pyadjoint.ReducedFunctional(J, pyadjoint.Control(mu))

    def forward(moduli: np.ndarray = cube.moduli) -> float:
        here = Recorded(cube.Q)
        here.x.array[:] = moduli
        return float(reduced(here))

    found, slope = timed(forward, lambda: np.array(reduced.derivative().x.array), times)
    return {"method": "dolfinx-adjoint", **found, "error": off(cube.moduli, forward, slope)}


if __name__ == "__main__":
    n, order, times = arguments()
    cube = Cube(n, order)
    tetrahedra, ndof = cube.mesh.topology.index_map(3).size_local, 3 * cube.V.dofmap.index_map.size_local
    own = known(order, tetrahedra, ndof, {"dolfinx": dolfinx.__version__})
    print(json.dumps([own | by_hand(cube, times), own | by_tape(cube, times)]))
