"""Tissue that remembers, on elements of any shape and order: forces are the energy's slope, the tangent is theirs."""

import numpy as np
import pytest
from ngsolve.meshes import MakeStructured2DMesh, MakeStructured3DMesh

from ngbrain.adjoint.check import taylor
from ngbrain.forward import Material, Problem
from ngbrain.materials import Branch, Maxwell, NeoHooke, Viscous

SIDE = 0.02
LAW = Viscous(NeoHooke(400.0), (Branch(NeoHooke(300.0), 1.0), Maxwell(NeoHooke(300.0), 600.0)))
CASES = [
    *[("triangles", k) for k in (2, 3, 4, 6)],
    *[("quadrilaterals", k) for k in (1, 2, 3, 4)],
    *[("tetrahedra", k) for k in (1, 2, 3, 4)],
    *[("hexahedra", k) for k in (1, 2, 3)],
]


def loaded(shape, k):
    """A body after a step of its own, in the next one."""
    if shape in ("triangles", "quadrilaterals"):
        mesh = MakeStructured2DMesh(
            quads=shape == "quadrilaterals", nx=2, ny=1, mapping=lambda x, y: (SIDE * x, SIDE * y)
        )
    else:
        scaled = dict(mapping=lambda x, y, z: (SIDE * x, SIDE * y, SIDE * z))
        mesh = MakeStructured3DMesh(hexes=shape == "hexahedra", nx=2, ny=1, nz=1, **scaled)
    element = f"P{k}" if k == 1 else f"P{k}/P{k - 1}"
    body = Problem(mesh, {".*": Material(LAW, 2e4)}, {"bottom": 0}, element=element)
    rng = np.random.default_rng(k)
    size = np.where(body.is_u, 4e-4 / k**2, 20.0) * (body.weights > 0)
    before, x, dx = (size * rng.standard_normal(body.fes.ndof) for _ in range(3))
    body.begin(0.5)
    body.residual(before)
    body.finish()
    body.begin(0.3)
    return body, x, dx


@pytest.mark.parametrize("shape, k", CASES)
def test_forces_and_tangent_belong_to_the_energy(shape, k):
    body, x, dx = loaded(shape, k)

    def energy(y):
        body.residual(y)
        return body.form.Energy(body.gfu.vec)

    r = body.residual(x)[0]
    assert np.all(np.abs(taylor(energy, r, x, dx, first=1e-2) - 2) < 0.1)
    body.residual(x)
    body.tissue.stiffen()
    body.form.AssembleLinearization(body.gfu.vec)
    direction, product = body.gfu.vec.CreateVector(), body.gfu.vec.CreateVector()
    direction.FV().NumPy()[:] = dx
    product.data = body.form.mat * direction
    slope = product.FV().NumPy() * (body.weights > 0)
    assert np.all(np.abs(taylor(lambda y: body.residual(y)[0], lambda _: slope, x, dx, first=1e-2) - 2) < 0.1)
