"""Small bodies in equilibrium, of any law whose parameters are fields or numbers, as models."""

from dataclasses import dataclass
from typing import Any

import ngsolve as ngs
import numpy as np
from statics import square

from ngbrain.adjoint.check import dot, taylor
from ngbrain.forward.common.material import Material
from ngbrain.forward.observables import Displacements, Force, Functional
from ngbrain.forward.sensitivity.static_model import LoadCase, StaticModel
from ngbrain.forward.solid.advance import newton_for
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import (
    Compressible,
    Demiray,
    Fung,
    Gent,
    Guccione,
    HolzapfelGasserOgden,
    LinearElastic,
    MooneyRivlin,
    NeoHooke,
    Ogden,
    Polynomial,
    SaintVenant,
    Scaled,
    Shearing,
    Sum,
    TransverselyIsotropic,
    UnsplitNeoHooke,
    Yeoh,
)

SIDE = 0.1


class Mine:
    """A user's law: what soft tissue of the liver may be."""

    def __init__(self, stiffness, hardening):
        self.stiffness, self.hardening = stiffness, hardening

    def energy(self, C):
        shape = ngs.Trace(C) - 3
        return self.stiffness * (shape + self.hardening * shape**2 + ngs.sqrt(1 + shape) - 1)


@dataclass(frozen=True)
class Plate:
    """A rigid plate above, at a height, that is not gone through: a user's load, of an energy and nothing else."""

    height: Any
    stiffness: Any

    def energy(self, at):
        depth = at.kinematics.position(at.u)[1] - self.height
        return self.stiffness * ngs.IfPos(depth, depth**3, 0.0) * at.ds("top")


def along(angle):
    """A fibre at an angle to x in the plane, rising a little."""
    return ngs.CF((ngs.cos(angle), ngs.sin(angle), 0.2))


def _strained(along, across, between, shear):
    """Fung's matrix; in plane strain nothing tells of the entries out of the plane."""
    rows = np.diag([0.0, 0.0, 20.0, 10.0, 10.0, 0.0]).astype(object)
    rows[0, 0], rows[1, 1], rows[5, 5], rows[0, 1], rows[1, 0] = along, across, shear, between, between
    return rows


LAWS = {
    NeoHooke: lambda p: NeoHooke(p("mu", 1e3)),
    UnsplitNeoHooke: lambda p: UnsplitNeoHooke(p("mu", 1e3)),
    MooneyRivlin: lambda p: MooneyRivlin(p("c10", 300.0), p("c01", 200.0)),
    Polynomial: lambda p: Polynomial({(1, 0): p("c10", 300.0), (0, 1): p("c01", 200.0), (1, 1): p("c11", 150.0)}),
    Yeoh: lambda p: Yeoh(p("c1", 500.0), p("c2", 200.0), p("c3", 100.0)),
    Gent: lambda p: Gent(p("mu", 1e3), p("jm", 2.0)),
    Demiray: lambda p: Demiray(p("mu", 1e3), p("b", 3.0)),
    Ogden: lambda p: Ogden([p("mu1", 700.0), p("mu2", 300.0)], [p("alpha1", -6.0), p("alpha2", 3.0)]),
    HolzapfelGasserOgden: lambda p: HolzapfelGasserOgden(
        p("mu", 700.0), p("k1", 900.0), p("k2", 4.0), p("kappa", 0.05), along(p("angle", 0.4))
    ),
    Fung: lambda p: Fung(
        p("c", 100.0), _strained(p("along", 20.0), p("across", 15.0), p("between", 4.0), p("shear", 10.0))
    ),
    Guccione: lambda p: Guccione(p("c", 200.0), p("bf", 16.0), p("bt", 8.0), p("bfs", 10.0), along(p("angle", 0.4))),
    LinearElastic: lambda p: LinearElastic(p("mu", 1e3), p("lam", 500.0)),
    SaintVenant: lambda p: SaintVenant(p("mu", 1e3), p("lam", 500.0)),
    Shearing: lambda p: Shearing(p("mu", 1e3)),
    TransverselyIsotropic: lambda p: TransverselyIsotropic(
        p("mu", 1e3), p("zeta", 0.8), p("phi", 0.5), along(p("angle", 0.4))
    ),
    Compressible: lambda p: NeoHooke(1e3) + Compressible(p("volume", 2e3)),
    Scaled: lambda p: Scaled(Ogden(1.0, -3.0), p("factor", 1e3)),
    Sum: lambda p: NeoHooke(p("mu", 500.0)) + Demiray(p("mu2", 500.0), 2.0),
    Mine: lambda p: Mine(p("stiffness", 500.0), p("hardening", 0.5)),
}


def field(mesh, value, space=None):
    """Around a value, by a fifth more or less."""
    made = ngs.GridFunction(space or ngs.H1(mesh, order=1))
    made.Set(value * (1 + 0.2 * ngs.sin(60 * ngs.x) * ngs.cos(50 * ngs.y + 1)))
    return made


def seen(dim=2):
    """Displacements at two points, the force on the bottom, and an integral that is none of the energy's."""
    points = SIDE * np.array([[0.31, 0.52, 0.4], [0.7, 0.83, 0.6]])[:, :dim]
    swelling = Functional(lambda at: (ngs.Det(at.F) - 1) ** 2 * ngs.InnerProduct(at.u, at.u) * at.dx(".*"))
    return [Displacements(points), Force("bottom"), swelling]


def model(law=NeoHooke, kind="field", form="P2", mesh=None):
    """A square (or another mesh) pressed and sheared, of a law all of whose parameters are of a kind."""
    mesh, parameters = mesh or square(2, size=SIDE), {}

    def parameter(name, value):
        parameters[name] = ngs.Parameter(value) if kind == "number" else field(mesh, value)
        return parameters[name]

    bulk = parameter("bulk", 4e3 if "/" not in str(form) else 5e4)
    down = {"bottom": 0, "top": (0.006, *[0.002] * (mesh.dim - 2), -0.012)}
    body = Problem(mesh, {".*": Material(LAWS[law](parameter), bulk)}, down, element=form)
    return StaticModel([LoadCase(body, seen(mesh.dim))], parameters, tight(body))


def tight(body):
    """Newton's method to round-off."""
    return newton_for(body, rtol=1e-12, xtol=1e-12)


def directions(of, rng):
    """One for each block, of the block's size."""
    theta = of.theta
    for name, block in of.blocks.items():
        direction = np.zeros(of.size)
        direction[block] = rng.uniform(-1, 1, block.stop - block.start) * max(np.abs(theta[block]).max(), 1e-3)
        yield name, direction


def weights(there, rng):
    """At random, so that all data count."""
    return rng.normal(size=len(there.data)) / unit(there)


def unit(there):
    """Of the data, each about as large as its observation."""
    parts = [part for case in there.model.split(there.data) for part in case]
    return np.concatenate([np.abs(part) + 0.1 * np.abs(part).max() for part in parts])


def pulled_both_ways(of, there, w):
    """Jᵀw, by matrices and by forms the same."""
    pulled, driven = there.vjp(w), there.gradient(w)
    scale = np.concatenate([np.full(b.stop - b.start, np.abs(pulled[b]).max()) for b in of.blocks.values()])
    assert np.abs((pulled - driven) / scale).max() < 1e-10
    return pulled


def verify(of, rng, first=1e-2):
    """J has rates of 2 along each block, Jᵀ by matrices is its transpose and the same as by forms."""
    theta = of.theta
    there = of.evaluate(theta)
    w = weights(there, rng)
    pulled = pulled_both_ways(of, there, w)
    sizes = unit(there)
    for name, direction in directions(of, rng):
        change = there.jvp(direction)
        assert dot(change, pulled, direction, w) < 1e-10, name
        rates = taylor(lambda t: of.evaluate(t).data / sizes, lambda _: change / sizes, theta, direction, 2, first)  # noqa: B023
        assert np.all((rates > 1.9) & (rates < 2.1)), (name, rates)
