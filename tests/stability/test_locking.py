"""Stiff volume and slender bodies. Naive: linear displacements lock. Ours: errors that see neither K/μ nor slenderness.

Volume: a flow without divergence on 16 × 16 squares cut in two, from ν = 0.3 to 0.499999. The error (H1) of P1 grows from
16 % to 100 %, that of P2 sevenfold and more, that of P2/P1 and P3/P2 not at all.
Slenderness: a cantilever a hundred times as long as deep, one layer of elements. P1 bends to less than a tenth of what it
should, P2 to within 2 %.
"""

import ngsolve as ngs
import pytest
from flow import STIFF, error, moved
from ngsolve.meshes import MakeStructured2DMesh

from ngbrain.forward.common.loads import TractionLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.materials import LinearElastic
from ngbrain.solvers.newton import Newton


def ratio(form):
    """Error at ν = 0.499999 over that at 0.3, and the latter."""
    soft, stiff = (error(moved(16, form, nu)) for nu in (0.3, STIFF))
    print(form, soft, stiff, stiff / soft)
    return stiff / soft, soft


def test_naive_linear_displacements_lose_everything():
    grown, soft = ratio("P1")
    assert grown > 5 and soft == pytest.approx(0.162, rel=0.02)


def test_naive_quadratic_displacements_lose_an_order():
    grown, soft = ratio("P2")
    assert grown > 5 and soft == pytest.approx(1.15e-2, rel=0.02)


@pytest.mark.parametrize(("form", "size"), [("P2/P1", 1.139e-2), ("P3/P2", 5.43e-4)])
def test_ours_does_not_see_the_bulk_modulus(form, size):
    grown, soft = ratio(form)
    assert grown < 1.01 and soft == pytest.approx(size, rel=0.01)


def tip(form, quads):
    """Deflection of a cantilever's tip in plane strain over Timoshenko's."""
    mu, nu, length, load = 1e3, 0.3, 100.0, 1e-7
    mesh = MakeStructured2DMesh(quads=quads, nx=16, ny=1, mapping=lambda x, y: (length * x, y - 0.5))
    material = {".*": Material(LinearElastic(mu), 2 * mu * nu / (1 - 2 * nu))}
    body = Problem(mesh, material, {"left": 0}, [TractionLoad("right", (0, load))], element=form)
    LoadPath(body).solve(newton=Newton(rtol=1e-6, xtol=1e-7))
    E, v = 2 * mu * (1 + nu) / (1 - nu**2), nu / (1 - nu)
    wanted = 2 * load / E * (2 * length**3 + (4 + 5 * v) * length / 4)
    found = ngs.Integrate(body.u[1], mesh, ngs.BND, definedon=mesh.Boundaries("right")) / wanted
    print(form, "quads" if quads else "triangles", found)
    return found


@pytest.mark.parametrize("quads", [False, True])
def test_naive_linear_displacements_do_not_bend(quads):
    assert 0 < tip("P1", quads) < 0.1


@pytest.mark.parametrize("quads", [False, True])
@pytest.mark.parametrize("form", ["P2", "P3", "P2/P1"])
def test_ours_bends(form, quads):
    assert 0.98 < tip(form, quads) < 1.01
