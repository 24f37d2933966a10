"""A displacement without divergence and the weight that makes it, in a square held all round: pressure 0 at any ν."""

import ngsolve as ngs
from statics import square

from ngbrain.forward.common.elements import ElementPair
from ngbrain.forward.common.loads import BodyForce
from ngbrain.forward.common.material import Material
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.materials import LinearElastic
from ngbrain.solvers.newton import Newton

STIFF = 0.499999
AMPLITUDE = 1e-7
"""So small that the change of volume in the equation of the pressure is linear; errors are given for 1."""
ALONE = 1e-3
"""Of displacements alone, whose law can be linear itself; they need the digits."""

_psi = ngs.sin(ngs.pi * ngs.x) ** 2 * ngs.sin(ngs.pi * ngs.y) ** 2
EXACT = (_psi.Diff(ngs.y), -_psi.Diff(ngs.x))
GRADIENT = ngs.CF(tuple(c.Diff(s) for c in EXACT for s in (ngs.x, ngs.y)), dims=(2, 2))
WEIGHT = -ngs.CF(tuple(c.Diff(ngs.x).Diff(ngs.x) + c.Diff(ngs.y).Diff(ngs.y) for c in EXACT))


def moved(n, form, nu):
    """The body in equilibrium, μ = 1, on n × n squares cut in two."""
    lam = 2 * nu / (1 - 2 * nu)
    alone = isinstance(form, str) and ElementPair.named(form).pressure is None
    material = Material(LinearElastic(1.0, lam), 0.0) if alone else Material(LinearElastic(1.0), lam)
    weight = BodyForce(((ALONE if alone else AMPLITUDE) * WEIGHT).Compile())
    body = Problem(square(n), {".*": material}, {".*": 0}, [weight], element=form)
    LoadPath(body).solve(newton=Newton(rtol=1e-6, xtol=1e-7))
    return body


def error(body):
    """Of the gradient in L2, relative."""
    apart = ngs.Grad(body.u) / (ALONE if body.p is None else AMPLITUDE) - GRADIENT
    squares = (ngs.InnerProduct(e, e) for e in (apart, GRADIENT))
    found, whole = (ngs.Integrate(e.Compile(), body.mesh, order=12) for e in squares)
    return (found / whole) ** 0.5


def pressure(body):
    """Of the pressure in L2; 0 would be right."""
    return ngs.Integrate(body.p**2, body.mesh, order=12) ** 0.5 / AMPLITUDE
