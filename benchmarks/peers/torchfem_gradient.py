"""What a gradient costs torch-fem, over the solve that it is of: its implicit adjoint, `differentiable_parameters`.

    python benchmarks/peers/torchfem_gradient.py N ORDER TIMES      a JSON list of records

The case is that of benchmarks/gradient_cost_statics.py, "linear", but J = ½ ∫ u·u. Young's modulus and Poisson's ratio follow from
shear and bulk modulus in the graph. The direct method is MKL's Pardiso, which torch-fem prefers to SciPy's.
"""

from __future__ import annotations

from importlib.metadata import version

import _gradient as g
import numpy as np
import pypardiso
import torch
from _case import L
from torchfem import Solid
from torchfem.materials import IsotropicElasticity3D

torch.set_num_threads(1)
torch.set_default_dtype(torch.float64)


def ways(cube: g.Cube) -> g.Ways:
    """With one model; its material is made anew for each solve."""
    tetrahedra, mass = torch.tensor(cube.tetrahedra), torch.tensor(cube.mass)

    def material(mu: torch.Tensor) -> IsotropicElasticity3D:
        return IsotropicElasticity3D(9 * g.BULK * mu / (3 * g.BULK + mu), (3 * g.BULK - 2 * mu) / (6 * g.BULK + 2 * mu))

    model = Solid(torch.tensor(cube.nodes), tetrahedra, material(torch.tensor(cube.moduli)))
    z = model.nodes[:, 2]
    model.constraints = ((z == 0) | (z == L))[:, None].expand(-1, 3).clone()
    model.displacements = (z == L)[:, None] * torch.tensor(g.MOVED)
    kept: list[torch.Tensor] = []

    def at(moduli: np.ndarray) -> float:
        pypardiso.scipy_aliases.pypardiso_solver.remove_stored_factorization()  # else the same matrix again costs nothing
        mu = torch.tensor(moduli, requires_grad=True)
        model.material = material(mu)
        u = model.solve(method="direct", differentiable_parameters=mu)[0]
        J = 0.5 * torch.einsum("eik,ij,ejk->", u[tetrahedra], mass, u[tetrahedra])
        kept[:] = J, mu
        return J.item()

    def gradient() -> np.ndarray:
        J, mu = kept
        return torch.autograd.grad(J, mu)[0].numpy()

    return lambda: at(cube.moduli), gradient, at


if __name__ == "__main__":
    g.main("torch-fem", ways, {name: version(name) for name in ("torch-fem", "torch", "pypardiso")})
