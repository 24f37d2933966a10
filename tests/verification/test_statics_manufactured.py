"""A finite deformation made up, and the load that makes it: errors against order and mesh.

u = (A sin πx sin πy, 2A x (1 - x) sin πy), A = 0.1, and p = sin 2x cos y on the unit square in plane strain, K/μ = 10; P of
them by hand, and a law of volume that is at rest where ln J is what the two say.
"""

from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
import pytest
from finite_strain import orders
from statics import square, tight

from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.materials import UnsplitNeoHooke, squared_log

BULK, A = 10.0, 0.1
x, y = ngs.x, ngs.y
EXACT = A * ngs.CF((ngs.sin(ngs.pi * x) * ngs.sin(ngs.pi * y), 2 * x * (1 - x) * ngs.sin(ngs.pi * y)))
SLOPE = ngs.CF(tuple(EXACT[i].Diff(s) for i in range(2) for s in (x, y)), dims=(2, 2))
F = ngs.Id(2) + SLOPE
PRESSURE = ngs.sin(2 * x) * ngs.cos(y)
REST = ngs.log(ngs.Det(F)) - PRESSURE / BULK
STRESS = F - ngs.Inv(F).trans + PRESSURE * ngs.Inv(F).trans


class Swollen(Material):
    """A material whose law of volume is one of J / J₀."""

    def volumetric_energy(self, J, p):
        return super().volumetric_energy(J / ngs.exp(REST), p)


@dataclass(frozen=True)
class Source:
    """The load of a nominal stress, in weak form: no second derivatives."""

    def energy(self, at):
        work = ngs.InnerProduct(STRESS, ngs.Grad(at.u))
        return -at.factor * work.Compile() * ngs.dx(bonus_intorder=6)


def errors(form, n):
    """In L2 of u, of its gradient, and of p where there is one."""
    material = {".*": Swollen(UnsplitNeoHooke(1.0), BULK, change=squared_log)}
    body = Problem(square(n), material, {".*": 0}, [Source()], element=form, bonus=4)
    LoadPath(body).solve(newton=tight())
    apart = [body.u - EXACT, ngs.Grad(body.u) - SLOPE] + ([] if body.p is None else [body.p - PRESSURE])
    return [ngs.Integrate(ngs.InnerProduct(e, e).Compile(), body.mesh, order=12) ** 0.5 for e in apart]


# Orders of u, its gradient and p; errors of the last two at n = 16 that another implementation of the same found.
FORMS = {
    "P2": ((2.9, 1.9), (1.03e-3,)),
    "P3": ((3.9, 2.9), (2.35e-5,)),
    "P2/P1": ((2.9, 1.9, 1.9), (9.31e-4, 3.93e-4)),
    "P3/P2": ((3.9, 2.9, 2.9), (2.27e-5, 9.28e-6)),
    # Pressures two orders below cost one order of displacements.
    "P4/L2(2)": ((3.9, 2.9, 2.9), ()),
}


@pytest.mark.parametrize("form", FORMS)
def test_rates(form):
    least, wanted = FORMS[form]
    found = np.array([errors(form, n) for n in (8, 16)])
    rates = orders(found)[0]
    print(form, found[1], rates)
    assert np.all(rates > least), rates
    assert found[1, 1 : 1 + len(wanted)] == pytest.approx(wanted, rel=0.05)
