"""Bodies without pressure unknowns: a pulled cube with free sides is the homogeneous state that has no stress on them."""

import ngsolve as ngs
import numpy as np
import pytest
from ngsolve.solvers import Newton
from states import stress

from ngbrain.materials import Compressible, Deformation, HolzapfelGasserOgden, NeoHooke, SaintVenant, density, quadratic
from ngbrain.mesh import block
from ngbrain.tensors import deformation_gradient

LAWS = {
    "Neo-Hooke": NeoHooke(1.3) + Compressible(7.0),
    "fibres": HolzapfelGasserOgden(1.3, 0.7, 2.0, 0.1, (1, 0, 0)) + Compressible(7.0),
    "two families": HolzapfelGasserOgden(1.3, 0.7, 2.0, 0.0, [(1, 1, 0), (1, -1, 0)]) + Compressible(7.0, quadratic),
    "Saint-Venant": SaintVenant(1.3, 2.0),
}


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_pulled_cube(law):
    mesh = block((1.0, 1.0, 1.0), 1.0)
    fes = ngs.VectorH1(mesh, order=2, dirichletx="left|right", dirichlety="front", dirichletz="bottom")
    u, state = fes.TrialFunction(), ngs.GridFunction(fes)
    form = ngs.BilinearForm(fes, symmetric=True)
    form += ngs.Variation(density(law, Deformation.from_gradient(deformation_gradient(u))).Compile() * ngs.dx)
    state.components[0].Set(0.2 * ngs.x, definedon=mesh.Boundaries("left|right"))
    failed, steps = Newton(form, state, printing=False, maxerr=1e-12)
    assert failed == 0 and steps < 10
    F = np.array(ngs.Integrate(ngs.Grad(state), mesh)).reshape(3, 3) + np.eye(3)
    mid = np.array(deformation_gradient(state)(mesh(0.3, 0.6, 0.2))).reshape(3, 3)
    assert mid == pytest.approx(F, abs=1e-10) and F[0, 0] == pytest.approx(1.2, rel=1e-12)
    P = stress(law, F)[0]
    assert P[0, 0] > 0.5 and np.abs(P - np.diag([P[0, 0], 0, 0])).max() < 1e-10
