"""Any law in a body: nodal forces, from derived stresses, are those of the body's own form of the energy."""

import ngsolve as ngs
import numpy as np
import pytest

from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import (
    Branch,
    Compressible,
    Fung,
    Guccione,
    HolzapfelGasserOgden,
    LinearElastic,
    NeoHooke,
    SaintVenant,
    TransverselyIsotropic,
    UnsplitNeoHooke,
    Viscous,
)
from ngbrain.mesh import block

MESH = block((0.02, 0.02, 0.02), 0.02)


def field():
    """Fibres along z that turn towards x, as a GridFunction."""
    fibre = ngs.GridFunction(ngs.VectorL2(MESH, order=1))
    fibre.Set(ngs.CF((40 * ngs.z, 0.3, 1)))
    return fibre


class Mine:
    """A user's law: all it has is an energy, here of single entries of C̄."""

    def energy(self, C):
        return 500.0 * (ngs.Trace(C) - 3) + 800.0 * C[0, 1] ** 2 + 300.0 * C[1, 2] * C[0, 2]


LAWS = {
    "fibre field": lambda: HolzapfelGasserOgden(500.0, 2e3, 5.0, 0.1, field()) + NeoHooke(100.0),
    "two families": lambda: HolzapfelGasserOgden(500.0, 2e3, 5.0, 0.0, [field(), (1, 1, 0)]),
    "transversely isotropic": lambda: TransverselyIsotropic(500.0, 1.0, 0.5, field()),
    "linear": lambda: LinearElastic(500.0, 100.0),
    "Saint-Venant": lambda: SaintVenant(500.0, 100.0),
    "unsplit": lambda: UnsplitNeoHooke(500.0),
    "Fung": lambda: Fung(100.0, np.diag([20.0, 20.0, 20.0, 10.0, 10.0, 10.0])),
    "Guccione": lambda: Guccione(100.0, 20.0, 5.0, 10.0, field()),
    "of J": lambda: NeoHooke(500.0) + Compressible(5e3),
    "a user's": Mine,
    "a user's that relaxes": lambda: Viscous(NeoHooke(100.0), (Branch(Mine(), 2.0),)),
    "fibres that relax": lambda: Viscous(
        NeoHooke(100.0), (Branch(HolzapfelGasserOgden(1.0, 2e3, 5.0, 0, field()), 2.0),)
    ),
}


@pytest.fixture
def moved(rng):
    """A body of a law, in a state with fibres both stretched and pressed."""

    def make(law):
        body = Problem(MESH, {"tissue": Material(law, 1.5e4)}, {"bottom": 0}, element="P2/P1", history=True)
        body.history.begin(1.0)
        size = np.where(body.is_u, 5e-4, 50.0)
        body.x = size * rng.uniform(-1, 1, body.fes.ndof) * (body.weights > 0)
        return body

    return make


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_forces_are_those_of_the_form(law, moved):
    body = moved(law())
    if body.history.n_branches:
        body.history.finish()  # a stress to remember
        body.history.begin(0.5)
    forces = body.residual(body.x)[0]
    wanted = body.gfu.vec.CreateVector()
    body.form.Apply(body.gfu.vec, wanted)
    of_form = wanted.FV().NumPy() * (body.weights > 0)
    assert np.abs(of_form).max() > 1e-6
    assert forces == pytest.approx(of_form, abs=1e-10 * np.abs(of_form).max())


def test_a_branch_remembers_a_symmetric_stress_of_any_law():
    C = np.array([[1.1, 0.1, 0.05], [0.1, 0.95, -0.1], [0.05, -0.1, 1.0]])
    C /= np.linalg.det(C) ** (1 / 3)
    at = MESH(0.001, 0.001, 0.001)
    S = np.array(Branch(Mine(), 1.0).stress(ngs.CF(tuple(C.ravel()), dims=(3, 3)))(at)).reshape(3, 3)
    by_C = np.diag([500.0] * 3)
    by_C[0, 1] = by_C[1, 0] = 800.0 * C[0, 1]
    by_C[1, 2] = by_C[2, 1] = 150.0 * C[0, 2]
    by_C[0, 2] = by_C[2, 0] = 150.0 * C[1, 2]
    wanted = 2 * by_C - 2 * np.sum(by_C * C) / 3 * np.linalg.inv(C)
    assert pytest.approx(wanted, rel=1e-10) == S
