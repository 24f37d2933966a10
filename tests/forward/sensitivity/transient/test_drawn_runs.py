"""Derivatives of runs drawn at random: three ingredients or more together, in the plane, axisymmetric and in space."""

import ngsolve as ngs
import numpy as np
import pytest
from friction_blocks import SIDE, Sliding, law_of, mesh_of

from ngbrain.adjoint.check import taylor
from ngbrain.forward.common.kinematics import Axisymmetric
from ngbrain.forward.common.loads import BodyForce, PressureLoad, Spring, TractionLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.force_control import PrescribedForce
from ngbrain.forward.contact.friction import Friction
from ngbrain.forward.contact.rigid import RigidContact, surface_rules
from ngbrain.forward.contact.rigid import SlidingSupport as Film
from ngbrain.forward.observables import Displacements, Force, Functional, Ratio, region_volume
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.forward.solid.inertia import Inertia
from ngbrain.forward.solid.problem import Problem

GRID = (0.0, 0.5, 1.0, 1.5, 2.5, 3.0, 8.0)
KINDS = ("plane strain", "quadrilaterals", "axisymmetric", "space")
LOADS = ("traction", "weight", "springs", "film", "pressure")
FORCE = {"axisymmetric": 0.05, "space": 0.02}
"""Of a tool (N; in the plane N/m: 0.5)."""
FIRST, NEAREST = 4e-3, 2e-4
"""Parts of all parameters by which they are moved: as far as no point's contact changes, and no less."""


def drawn(seed):
    """A run, what it is made of, and its parameters' sizes."""
    rng = np.random.default_rng(seed)
    kind = KINDS[rng.integers(4)]
    law = ("Prony", "Maxwell", "elastic")[rng.integers(3)]
    allowed = [load for load in LOADS if kind != "axisymmetric" or load != "film"]
    loads = set(rng.choice(allowed, size=rng.integers(1, 4), replace=False))
    rubs, share, forced, heavy = bool(rng.integers(2)), float(rng.choice([0.0, 0.9])), *(rng.integers(3, size=2) == 0)
    wide = kind != "space" and law != "Maxwell" and rng.integers(4) == 0
    element = ("Q2/L2(1)" if kind == "quadrilaterals" else "P4/L2(2)") if wide else "P2/P1"
    mesh = mesh_of(kind, 1 if kind == "space" else 2)
    last, plate = mesh.dim - 1, Sliding(1e-3, 1e-3)
    sizes = {"mu": 1e3, "penalty": 1e7, "lift": 1e-5} | ({"force": FORCE.get(kind, 0.5)} if forced else {"way": 1.0})
    sizes |= {"Prony": {"g": 0.5, "tau": 3.0}, "Maxwell": {"tau": 3.0}, "elastic": {}}[law]
    sizes |= {"friction": 0.3} if rubs else {}
    sizes |= {"rho": 1e6} if heavy else {}  # so heavy that a second is short
    weights = {"traction": 20.0, "weight": 8e3, "springs": 2e4, "film": 1e5, "pressure": 20.0}
    sizes |= {name: weights[name] for name in LOADS if name in loads}
    p = {name: ngs.Parameter(size) for name, size in sizes.items()}
    material = Material(law_of(law, p | {"g": p.get("g", 0.5)}), 2e4)
    across, down = (1.0, *(0.0,) * last), (*(0.0,) * last, -1.0)
    if forced:
        motion = PrescribedForce((0.0, 1.0, 8.0), (0.0, p["force"], p["force"]), away=-1e-3, nudge=1e-5)
        deep, way = motion.parameter, motion.parameter
    else:
        motion, deep, way = plate, p["way"] * plate.down, plate.along
    contacts = [RigidContact("top", lambda x: SIDE - deep + p["lift"] - x[last], p["penalty"], 2e-5, share, travel=way)]
    if rubs:
        contacts.append(Friction(contacts[0], p["friction"], 5e-5, lambda x, way: way * ngs.CF(across)))
    acting = [Inertia(p["rho"])] if heavy else []
    if "traction" in loads:
        acting.append(TractionLoad("right", tuple(p["traction"] * c for c in across)))
    if "weight" in loads:
        acting.append(BodyForce(tuple(p["weight"] * c for c in down)))
    if "springs" in loads:
        acting.append(Spring("right", p["springs"]))
    if "film" in loads:
        contacts.append(Film.on(mesh, "left", p["film"]))
    if "pressure" in loads:
        acting.append(PressureLoad("right", p["pressure"]))
    if forced:
        contacts.append(motion)
    supports = {"bottom": 0} | ({"left": (0, None)} if kind == "axisymmetric" else {})
    body = Problem(
        mesh, {".*": material}, supports, acting, contacts,
        element=element.replace("P2/P1", "Q2/Q1") if kind == "quadrilaterals" else element,
        kinematics=Axisymmetric() if kind == "axisymmetric" else None,
    )  # fmt: skip
    bent = Functional(lambda at: ngs.InnerProduct(at.u, at.u) * at.dx(".*"), name="mean square displacement")
    seen = [Force("bottom"), Ratio(bent, region_volume()), Displacements([[SIDE / 2, *(0.7 * SIDE,) * last]])]
    extra = {"friction": rubs, "mass": heavy, "given force": forced, element: wide}
    made = ", ".join(
        [kind, law, f"offset {share:g}", *(name for name, there in extra.items() if there), *sorted(loads)]
    )
    return RunModel(body, motion, GRID, p, seen), made, np.array([of.Get() for of in p.values()])


def touching(of):
    """Which points of walls touch, and how deep, and which slide, at the end of every step."""
    found, body = [], of.body
    for _ in of.replay.forwards():
        for contact in (each for each in body.contacts if isinstance(each, RigidContact)):
            points = body.mesh.MapToAllElements(surface_rules(body.mesh), body.mesh.Boundaries(contact.wall))
            depth = body.offset - contact.gap(body.u)
            found.append(ngs.IfPos(depth, ngs.IfPos(depth - contact.softness, 2.0, 1.0), 0.0)(points).ravel())
        for rub in body.friction.walls:
            slip = np.linalg.norm(rub.end()[0].reshape(body.mesh.dim, -1), axis=0)
            found.append(slip > rub.friction.slip * (1 - 1e-9))
    return np.concatenate(found)


def check(seed):
    of, made, sizes = drawn(seed)
    rng = np.random.default_rng(1000 + seed)
    start, there = of.theta.copy(), of.evaluate(of.theta)
    whole = np.concatenate(
        [np.full(at.stop - at.start, np.abs(there.data[:, at]).max()) for at in of.observation_slices]
    )
    w = rng.normal(size=there.data.shape) / whole
    gradient, contact = there.gradient(w), touching(of)

    def value(theta):
        return float(np.sum(w * of.evaluate(theta).data))

    direction = sizes * rng.uniform(-1, 1, size=len(sizes))
    pushed = of.evaluate(start).jvp(direction)
    assert np.sum(w * pushed) == pytest.approx(gradient @ direction, rel=1e-6), made
    first = FIRST
    while first > NEAREST and any(
        (of.evaluate(start + s * direction), np.any(touching(of) != contact))[1] for s in (-first, first)
    ):
        first /= 2
    if first > NEAREST:
        there = of.evaluate(start)
        twice, other = there.hvp(w, direction), sizes * rng.uniform(-1, 1, size=len(sizes))
        assert there.hvp(w, other) @ direction == pytest.approx(
            twice @ other, rel=1e-6, abs=1e-9 * np.abs(twice) @ sizes
        )
        slope = lambda t: of.evaluate(t).gradient(w) * sizes  # noqa: E731
        rates = taylor(value, gradient, start, direction, first=first, steps=2)
        again = taylor(slope, lambda d: twice * sizes, start, direction, first=first, steps=2)
        print(f"{seed}: {made}: {first:.0e}: rates {rates.round(2)} {again.round(2)}")
        assert abs(rates[-1] - 2) < 0.1 and abs(again[-1] - 2) < 0.1, made
        return True
    # A point that begins to touch or to slide on the way is a kink: what is left is then small all the same.
    ends = [value(start + h * direction) for h in (NEAREST, -NEAREST)]
    slopes = [(ends[0] - value(start)) / NEAREST, (value(start) - ends[1]) / NEAREST]
    print(f"{seed}: {made}: at a kink: {slopes}, {gradient @ direction}")
    assert slopes == pytest.approx([gradient @ direction] * 2, rel=1e-2), made
    return False


@pytest.mark.parametrize("seed", range(4))
def test_a_few(seed):
    check(seed)


@pytest.mark.slow
def test_thirty_and_few_of_them_at_a_kink():
    smooth = [check(seed) for seed in range(4, 34)]
    assert sum(smooth) >= 25
