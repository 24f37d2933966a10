"""Blocks that a plate of given force presses, and cavities and sides under pressure, as models of what they are made of."""

import ngsolve as ngs
import numpy as np
from combinations import Body
from friction_blocks import SIDE, Sliding, law_of, mesh_of

from ngbrain.adjoint.check import taylor
from ngbrain.forward.common.kinematics import Axisymmetric
from ngbrain.forward.common.loads import CavityVolume, PressureLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.force_control import PrescribedForce
from ngbrain.forward.contact.friction import Friction
from ngbrain.forward.contact.rigid import RigidContact
from ngbrain.forward.observables import Displacements, Force, Functional
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.forward.solid.inertia import Inertia
from ngbrain.forward.solid.problem import Problem

GRID = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 8.0)
SIZES = {
    "mu": 1e3, "g": 0.5, "tau": 3.0, "force": 1.0, "penalty": 1e7, "lift": 1e-5, "friction": 0.3, "rho": 1e5, "push": 20.0,
}  # fmt: skip
HELD = (0.0, 1.0, 2.0, 8.0), (0.0, 1.0, 1.0, 1.0)
AGAIN = (0.0, 0.5, 1.0, 2.0, 3.0, 8.0), (0.0, 1.0, 0.0, 0.0, 1.0, 1.0)
"""Let go and pressed once more, in parts of the force."""
BENT = Functional(lambda at: ngs.InnerProduct(at.u, at.u) * at.dx(".*"), name="mean square displacement")


def numbers(law, used):
    unused = {"elastic": {"g", "tau"}, "Maxwell": {"g"}}.get(law, set())
    return {name: ngs.Parameter(SIZES[name]) for name in used if name not in unused}


def material(law, p):
    return {".*": Material(law_of(law, {"g": 0.5} | p), 2e4)}


def forced(
    kind="plane strain", law="Prony", rubs=False, mass=False, pushed=False, share=0.9, program=HELD, n=2, seen=(), along=0.5
):  # fmt: skip
    """A plate of given force, a little oblique; parameters are those of `SIZES` that the body is made of."""
    mesh = mesh_of(kind, n)
    last, extra = mesh.dim - 1, {"friction": rubs, "rho": mass, "push": pushed}
    p = numbers(law, [name for name in SIZES if extra.get(name, True)])
    p["force"].Set({"space": 0.02, "axisymmetric": 0.1}.get(kind, SIZES["force"]))
    times, parts = program
    given = PrescribedForce(times, [p["force"] if part else 0.0 for part in parts], away=-1e-3, nudge=1e-6)
    oblique = p["lift"] * (1 + (0 if kind == "axisymmetric" else ngs.x / SIDE))
    plate = RigidContact(
        "top", lambda x: SIDE - given.parameter + oblique - x[last], p["penalty"], 2e-5, share, given.parameter
    )
    contacts = [plate]
    if rubs:
        aside = ngs.CF((1.0, *(0.0,) * last))
        contacts.append(Friction(plate, p["friction"], 5e-5, (lambda x, way: along * way * aside) if along else None))
    loads = [Inertia(p["rho"])] if mass else []
    loads += [PressureLoad("right", p["push"])] if pushed else []
    supports = {"bottom": 0} | ({"left": (0, None)} if kind == "axisymmetric" else {})
    body = Problem(
        mesh, material(law, p), supports, loads, [*contacts, given],
        element="Q2/Q1" if kind == "quadrilaterals" else "P2/P1",
        kinematics=Axisymmetric() if kind == "axisymmetric" else None,
    )  # fmt: skip
    way = Functional(lambda at: given.parameter * at.dx(".*"), name="way")
    asked = list(seen) or [Force("bottom"), Displacements([[SIDE / 2, *(0.7 * SIDE,) * last]]), BENT, way]
    return RunModel(body, given, GRID, p, asked)


def inflated(kind, element="P2/P1", law="Prony", rubs=False, cavity=True):
    """A cavity of given volume, or none, under a plate, with a pressure that follows at a side."""
    of = Body(kind, {"cavity of given volume"} if cavity else set())
    p, plate = numbers(law, ["mu", "g", "tau", "push", "penalty", *["friction"] * rubs]), Sliding(1e-3, 1e-3)
    last = of.dim - 1
    contacts = [
        RigidContact(of.top, lambda x: of.height - plate.down - x[last], p["penalty"], 2e-5, travel=plate.along)
    ]
    if rubs:
        aside = ngs.CF((1.0, *(0.0,) * last))
        contacts.append(Friction(contacts[0], p["friction"], 5e-5, lambda x, way: way * aside))
    loads, seen = [PressureLoad(of.right, p["push"])], [Force("foot" if cavity else "bottom"), BENT]
    if cavity:
        p["growth"] = ngs.Parameter(of.growth)
        loads.append(CavityVolume("inner", 1e3 * p["growth"] * plate.down))
        seen.append(Functional(lambda at: at.cavities[0] * at.dx(".*"), name="pressure of the cavity"))
    body = Problem(of.mesh, material(law, p), of.supports, loads, contacts, element=element, kinematics=of.kinematics)
    return RunModel(body, plate, GRID, p, seen)


def weighed(of, rng):
    """Of all data, those of an observable over its largest; and their sum at any θ."""
    data = of.evaluate(of.theta).data
    largest = np.concatenate([np.full(at.stop - at.start, np.abs(data[:, at]).max()) for at in of.observation_slices])
    w = rng.normal(size=data.shape) / largest
    return w, lambda theta: float(np.sum(w * of.evaluate(theta).data))


def checked(of, rng, first=5e-3):
    """Rates of the gradient and of second derivatives along a direction of all parameters; how far J and Jᵀ are apart."""
    start = of.theta.copy()
    w, value = weighed(of, rng)
    a, b = start * rng.uniform(0.3, 1, (2, of.size)) * rng.choice([-1, 1], (2, of.size))
    there = of.evaluate(start)
    gradient = there.gradient(w)
    apart = abs(np.sum(w * there._products(a[None])[0]) / (gradient @ a) - 1)
    along_a, along_b = there.hvp(w, a), there.hvp(w, b)
    uneven = abs(along_a @ b - along_b @ a) / (np.abs(along_a * b).sum() + np.abs(along_b * a).sum())
    rates = taylor(value, gradient, start, a, first=first, steps=2)
    twice = taylor(
        lambda t: of.evaluate(t).gradient(w) * start, lambda d: of.evaluate(start).hvp(w, d) * start, start, a, first=first, steps=2
    )  # fmt: skip
    return rates, twice, apart, uneven
