"""Small relaxing blocks that a plate presses, as models of what their parameters do to forces and displacements over time."""

from functools import cache

import ngsolve as ngs
import numpy as np
from netgen.occ import Box, Glue, OCCGeometry, Z

from ngbrain.forward.common.loads import BodyForce, Spring, TractionLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.rigid import RigidContact, SlidingSupport
from ngbrain.forward.observables import Displacements, Force
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import Branch, Maxwell, NeoHooke, Ogden, Prony, Viscous
from ngbrain.mesh import block
from ngbrain.surgery.protocols import Drive, ToolMotion

SIDE = 0.02
GRID = (0.0, 1.0, 2.5, 4.0, 9.0, 40.0)
HOLD = ToolMotion("hold", (0.0, 4.0, 40.0), (0.0, 2e-3, 2e-3))
LIFT = ToolMotion("lift", (0.0, 2.5, 4.0, 40.0), (0.0, 2e-3, -1e-3, -1e-3))
SEEN = (
    Force("top", (0, 0, 1)),
    Force("bottom", (1.0, 0.0, 1.0)),
    Displacements([[0.013, 0.01, 0.015], [0.005, 0.01, 0.01]]),
)


@cache
def two_layers():
    low, high = Box((0, 0, 0), (SIDE, SIDE, SIDE / 2)), Box((0, 0, SIDE / 2), (SIDE, SIDE, SIDE))
    low.mat("low"), high.mat("high")
    low.faces.Min(Z).name, high.faces.Max(Z).name = "bottom", "top"
    return ngs.Mesh(OCCGeometry(Glue([low, high])).GenerateMesh(maxh=SIDE))


def field(mesh, value, space=None):
    """A field that varies by a fifth."""
    made = ngs.GridFunction(space or ngs.H1(mesh, order=1))
    made.Set(value * (1 + 0.2 * ngs.sin(90 * ngs.x) * ngs.cos(70 * ngs.z)))
    return made


def plate(drive, share=0.0):
    return RigidContact("top", lambda x: SIDE - drive.parameter - x[2], 1e8, 2e-5, share)


def pressed(share=0.0):
    """Contacts by a drive."""
    return lambda drive: [plate(drive, share)]


def numbers(**values):
    return {name: ngs.Parameter(value) for name, value in values.items()}


def prony():
    mesh = block((SIDE,) * 3, SIDE)
    p = {"mu": field(mesh, 1000.0), "alpha": field(mesh, -12.0), **numbers(g=0.4, tau=3.0, slow=50.0, bulk=1.5e6)}
    law = Prony(Ogden(p["mu"], p["alpha"]), [p["g"], 0.2], [p["tau"], p["slow"]])
    return mesh, {"tissue": Material(law, p["bulk"])}, p, HOLD, pressed()


def layers():
    mesh = two_layers()
    p = {"tau": field(mesh, 3.0, ngs.L2(mesh, order=0)), **numbers(rest=300.0, first=700.0, second=400.0, stiff=900.0)}
    soft = Viscous(
        NeoHooke(p["rest"]), (Branch(NeoHooke(p["first"]), p["tau"]), Branch(Ogden(p["second"], -9.0), 60.0))
    )
    stiff = Viscous(NeoHooke(500.0), (Branch(NeoHooke(p["stiff"]), 10.0),))
    return mesh, {"low": Material(soft, 1e6), "high": Material(stiff, 1e6)}, p, HOLD, pressed(0.9)


def maxwell():
    mesh = two_layers()
    p = {"eta": field(mesh, 2100.0), **numbers(spring=700.0, alpha=-15.0, other=1e5, rest=300.0, tau=2.0)}
    both = Maxwell(Ogden(p["spring"], p["alpha"]), p["eta"]), Maxwell(NeoHooke(500.0), p["other"])
    soft = Viscous(Ogden(p["rest"], -12.0), (*both, Branch(NeoHooke(400.0), p["tau"])))
    stiff = Viscous(NeoHooke(500.0), (Maxwell(NeoHooke(900.0), p["eta"]),))
    return mesh, {"low": Material(soft, 1e6), "high": Material(stiff, 1e6)}, p, HOLD, pressed()


def lifted():
    return *prony()[:3], LIFT, pressed()


def elastic():
    p = numbers(mu=1000.0)
    return block((SIDE,) * 3, SIDE), {"tissue": Material(NeoHooke(p["mu"]), 1e6)}, p, HOLD, pressed()


def relaxing():
    p = numbers(mu=1000.0, g=0.5, tau=3.0)
    law = Prony(NeoHooke(p["mu"]), [p["g"]], [p["tau"]])
    return block((SIDE,) * 3, SIDE), {"tissue": Material(law, 1e6)}, p, HOLD, pressed()


def touched():
    """What rigid bodies are made of, too: a factor of the plate's way, its shape and penalty, a film's stiffness."""
    mesh, materials, p, protocol, _ = relaxing()
    p |= {"rise": field(mesh, 2e-4), **numbers(way=1.1, penalty=1e8, film=2e5)}

    def contacts(drive):
        distance = lambda x: SIDE - p["way"] * drive.parameter - p["rise"] - x[2]  # noqa: E731
        film = SlidingSupport.on(mesh, "left", p["film"])
        return [RigidContact("top", distance, p["penalty"], 2e-5, 0.9), film]

    return mesh, materials, p, protocol, contacts


def loaded():
    """Pulled aside by a force that grows with a plate's way, the plate stuck on; heavy."""
    mesh, materials, p, protocol, _ = relaxing()
    p |= {"heavy": field(mesh, 9e3), **numbers(way=1.1, pull=5e5, stuck=1e6)}

    def acts(drive):
        at = drive.parameter
        plate = Spring("top", p["stuck"], (0.2 * at, 0.0, -p["way"] * at))
        return [TractionLoad("right", (p["pull"] * at, 0.0, 0.0)), BodyForce((0.0, -p["heavy"], 0.0)), plate]

    return mesh, materials, p, protocol, acts


def flowing():
    p = numbers(rest=400.0, spring=600.0, eta=1800.0)
    law = Viscous(NeoHooke(p["rest"]), (Maxwell(NeoHooke(p["spring"]), p["eta"]),))
    return block((SIDE,) * 3, SIDE), {"tissue": Material(law, 1e6)}, p, HOLD, pressed()


KINDS = {
    "Prony": prony,
    "layers": layers,
    "Maxwell": maxwell,
    "lifted": lifted,
    "elastic": elastic,
    "touched": touched,
    "loaded": loaded,
}
PLAIN = {"relaxing": relaxing, "flowing": flowing}


def model(kind="relaxing", grid=GRID, **options):
    mesh, materials, parameters, protocol, contacts = (KINDS | PLAIN)[kind]()
    drive = Drive(protocol)
    acts = contacts(drive)
    on_walls = [each for each in acts if isinstance(each, (RigidContact, SlidingSupport))]
    body = Problem(
        mesh,
        materials,
        {"bottom": 0},
        [each for each in acts if each not in on_walls],
        contacts=on_walls,
        element="P2/P1",
    )
    return RunModel(body, drive, grid, parameters, SEEN, **options)


def directions(of, rng):
    """One for each parameter, of its size."""
    theta = of.theta
    for name, block_ in of.blocks.items():
        direction = np.zeros(of.size)
        direction[block_] = rng.normal(size=block_.stop - block_.start) * np.abs(theta[block_]).max()
        yield name, direction


def weights(data, rng):
    """Of the data, so that forces and displacements count alike."""
    return rng.normal(size=data.shape) / np.abs(data).max(axis=0)
