"""Derivatives of runs drawn at random: three ingredients or more together, in the plane, axisymmetric and in space."""

import ngsolve as ngs
import numpy as np
import pytest
from rubbing import SIDE, Sliding, law_of, mesh_of

from ngbrain.adjoint.check import taylor
from ngbrain.forward.common.kinematics import Axisymmetric
from ngbrain.forward.common.loads import Spring, Traction, Weight
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.friction import Friction
from ngbrain.forward.contact.rigid import Contact
from ngbrain.forward.contact.rigid import Sliding as Film
from ngbrain.forward.observables import Displacements, Force, Functional
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.forward.solid.inertia import Inertia
from ngbrain.forward.solid.problem import Problem

GRID = (0.0, 0.5, 1.0, 1.5, 2.5, 3.0, 8.0)
KINDS = ("plane strain", "quadrilaterals", "axisymmetric", "space")
LOADS = ("traction", "weight", "springs", "film")


def drawn(seed):
    """A run, what it is made of, and its parameters' sizes."""
    rng = np.random.default_rng(seed)
    kind = KINDS[rng.integers(4)]
    law = ("Prony", "Maxwell", "elastic")[rng.integers(3)]
    allowed = [load for load in LOADS if kind != "axisymmetric" or load != "film"]
    loads = set(rng.choice(allowed, size=rng.integers(1, 4), replace=False))
    rubs, share = bool(rng.integers(2)), float(rng.choice([0.0, 0.9]))
    mesh = mesh_of(kind, 1 if kind == "space" else 2)
    last, plate = mesh.dim - 1, Sliding(1e-3, 1e-3)
    sizes = {"mu": 1e3, "penalty": 1e7, "way": 1.0, "lift": 1e-5}
    sizes |= {"Prony": {"g": 0.5, "tau": 3.0}, "Maxwell": {"tau": 3.0}, "elastic": {}}[law]
    sizes |= {"friction": 0.3} if rubs else {}
    sizes |= {"rho": 1e6} if rng.integers(3) == 0 else {}  # so heavy that a second is short
    sizes |= {name: {"traction": 20.0, "weight": 8e3, "springs": 2e4, "film": 1e5}[name] for name in loads}
    p = {name: ngs.Parameter(size) for name, size in sizes.items()}
    material = Material(law_of(law, p | {"g": p.get("g", 0.5)}), 2e4)
    top = lambda x: SIDE - p["way"] * plate.down + p["lift"] - x[last]  # noqa: E731
    contacts = [Contact("top", top, p["penalty"], 2e-5, share, way=plate.along)]
    across, down = (1.0, *(0.0,) * last), (*(0.0,) * last, -1.0)
    if rubs:
        contacts.append(Friction(contacts[0], p["friction"], 5e-5, lambda x, way: way * ngs.CF(across)))
    acting = [Inertia(p["rho"])] if "rho" in p else []
    if "traction" in loads:
        acting.append(Traction("right", tuple(p["traction"] * c for c in across)))
    if "weight" in loads:
        acting.append(Weight(tuple(p["weight"] * c for c in down)))
    if "springs" in loads:
        acting.append(Spring("right", p["springs"]))
    if "film" in loads:
        contacts.append(Film.on(mesh, "left", p["film"]))
    supports = {"bottom": 0} | ({"left": (0, None)} if kind == "axisymmetric" else {})
    body = Problem(
        mesh, {".*": material}, supports, acting, contacts, element="Q2/Q1" if kind == "quadrilaterals" else "P2/P1",
        kinematics=Axisymmetric() if kind == "axisymmetric" else None,
    )  # fmt: skip
    bent = Functional(lambda at: ngs.InnerProduct(at.u, at.u) * at.inside(".*"), name="mean square displacement")
    seen = [Force("bottom"), bent, Displacements([[SIDE / 2, *(0.7 * SIDE,) * last]])]
    made = ", ".join([kind, law, f"offset {share:g}", *["friction"] * rubs, *["mass"] * ("rho" in p), *sorted(loads)])
    return RunModel(body, plate, GRID, p, seen), made, np.array(list(sizes.values()))


def check(seed):
    of, made, sizes = drawn(seed)
    rng = np.random.default_rng(1000 + seed)
    start, there = of.theta.copy(), of.at(of.theta)
    whole = np.abs(there.data).max(axis=0)
    w = rng.normal(size=there.data.shape) / (whole + 1e-2 * whole.max())
    gradient = there.gradient(w)

    def value(theta):
        return float(np.sum(w * of.at(theta).data))

    direction = sizes * rng.uniform(-1, 1, size=len(sizes))
    pushed = of.at(start).push(direction)
    assert np.sum(w * pushed) == pytest.approx(gradient @ direction, rel=1e-6), made
    rates = taylor(value, gradient, start, direction, first=1e-3, steps=3)
    print(f"{seed}: {made}: rates {rates.round(2)}")
    if np.any(np.abs(rates[:2] - 2) < 0.1):
        return True
    # A point that begins to touch or to slide on the way is a kink: what is left is then small all the same.
    ends = [value(start + h * direction) for h in (1e-4, -1e-4)]
    slopes = [(ends[0] - value(start)) / 1e-4, (value(start) - ends[1]) / 1e-4]
    print(f"    at a kink: {slopes}, {gradient @ direction}")
    assert slopes == pytest.approx([gradient @ direction] * 2, rel=1e-2), made
    return False


@pytest.mark.parametrize("seed", range(4))
def test_a_few(seed):
    check(seed)


@pytest.mark.slow
def test_thirty_and_few_of_them_at_a_kink():
    smooth = [check(seed) for seed in range(4, 34)]
    assert sum(smooth) >= 25
