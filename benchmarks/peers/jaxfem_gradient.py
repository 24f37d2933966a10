"""What a gradient costs JAX-FEM, over the solve that it is of: the pull-back of its `ad_wrapper`.

    python benchmarks/peers/jaxfem_gradient.py N ORDER TIMES      a JSON list of records

The case is that of benchmarks/gradient_cost_statics.py, "linear", but J = ½ ∫ u·u. Both systems are solved by its `petsc_solver`
with LU, for which PETSc's options name MUMPS: several times as fast as PETSc's own or as `spsolve_solver`.
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from importlib.metadata import version
from types import ModuleType

import _gradient as g
from _case import L

os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"

from mpi4py import MPI  # noqa: F401  # isort: skip  # before petsc4py, which needs its library
import jax
import jax.numpy as jnp
import numpy as np
from petsc4py import PETSc

with redirect_stdout(sys.stderr):  # its name in large letters
    sys.modules["gmsh"] = ModuleType("gmsh")  # which it imports for meshes that are not needed here
    from jax_fem.generate_mesh import Mesh
    from jax_fem.problem import Problem
    from jax_fem.solver import ad_wrapper

logging.getLogger("jax_fem").setLevel(logging.WARNING)
LU = {"petsc_solver": {"ksp_type": "preonly", "pc_type": "lu"}}


class Elastic(Problem):
    """Its parameters: a shear modulus for each tetrahedron."""

    def get_tensor_map(self) -> Callable[[jax.Array, jax.Array], jax.Array]:
        """The stress at a point."""

        def stress(slope: jax.Array, mu: jax.Array) -> jax.Array:
            strain = (slope + slope.T) / 2
            return 2 * mu * strain + (g.BULK - 2 * mu / 3) * jnp.trace(strain) * jnp.eye(3)

        return stress

    def set_params(self, mu: jax.Array) -> None:
        """The same at all points of a tetrahedron."""
        self.internal_vars = [jnp.repeat(mu[:, None], self.fes[0].num_quads, axis=1)]


def supports() -> list[list]:
    """Where, which component, how far: the bottom held, the top moved."""
    ends = [lambda x: jnp.isclose(x[2], 0.0)] * 3 + [lambda x: jnp.isclose(x[2], L)] * 3
    return [ends, [0, 1, 2] * 2, [lambda _, by=by: by for by in (0.0, 0.0, 0.0, *g.MOVED)]]


def ways(cube: g.Cube) -> g.Ways:
    """The gradient is the pull-back alone."""
    PETSc.Options()["pc_type"] = "lu"
    PETSc.Options()["pc_factor_mat_solver_type"] = "mumps"
    kind = "TET4" if cube.order == 1 else "TET10"
    mesh = Mesh(cube.nodes, cube.tetrahedra)
    problem = Elastic(mesh, vec=3, dim=3, ele_type=kind, dirichlet_bc_info=supports())
    solve = ad_wrapper(problem, {"newton": {"linear": LU}}, LU)
    tetrahedra, mass = jnp.array(cube.tetrahedra), jnp.array(cube.mass)
    kept: list[Callable] = []

    def objective(mu: jax.Array) -> jax.Array:
        u = solve(mu)[0][tetrahedra]
        return 0.5 * jnp.einsum("eik,ij,ejk->", u, mass, u)

    def forward() -> float:
        J, pull = jax.vjp(objective, jnp.array(cube.moduli))
        kept[:] = [pull]
        return float(J)

    def gradient() -> np.ndarray:
        return np.array(kept[0](1.0)[0])

    return forward, gradient, lambda moduli: float(objective(jnp.array(moduli)))


if __name__ == "__main__":
    g.main("JAX-FEM", ways, {name: version(name) for name in ("jax-fem", "jax", "dolfinx-solver-real")})
