"""Every ingredient of a `Problem` with every controller, on every kind of mesh: what works, and what is refused in one line.

python tests/combinations.py     writes the table of the guide's page `tutorials/guide/reference/combinations.md`
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import ngsolve as ngs
import numpy as np
from ngsolve.meshes import MakeStructured2DMesh, MakeStructured3DMesh

from ngbrain.errors import InputError
from ngbrain.forward.common.kinematics import Axisymmetric
from ngbrain.forward.common.loads import BodyForce, CavityVolume, PressureLoad, RigidFace, Spring, TractionLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.force_control import PrescribedForce
from ngbrain.forward.contact.friction import Friction
from ngbrain.forward.contact.rigid import RigidContact, SelfContact, SlidingSupport
from ngbrain.forward.observables import Force
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.forward.solid.inertia import Inertia
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.forward.transient.step_control import StepControl
from ngbrain.forward.transient.time_stepper import LoadHistory, TimeStepper, run_load_history
from ngbrain.materials import Branch, Maxwell, NeoHooke, Viscous

SIDE, GAP, MU, BULK = 0.02, 0.004, 1e3, 2e4
PAGE = Path(__file__).parents[1] / "tutorials" / "guide" / "reference" / "combinations.md"
MESHES = ("plane strain, triangles", "plane strain, quadrilaterals", "axisymmetric, triangles", "axisymmetric, quadrilaterals",
          "space, tetrahedra", "space, hexahedra")  # fmt: skip
WORKS = "works"


def mesh_of(kind: str, slit: bool = False) -> ngs.Mesh:
    """A square or cube of `SIDE`; with a slit two halves that face each other across a gap."""
    n = 2
    if kind.startswith("space"):
        made = MakeStructured3DMesh(
            hexes="hex" in kind, nx=n, ny=n, nz=n, mapping=lambda x, y, z: (SIDE * x, SIDE * y, SIDE * z)
        )
    else:
        made = MakeStructured2DMesh(quads="quad" in kind, nx=n, ny=n, mapping=lambda x, y: (SIDE * x, SIDE * y))
    return made if not slit else slitted(kind)


def slitted(kind: str) -> ngs.Mesh:
    """Two blocks one above the other, glued to nothing: `lower` and `upper` faces with a gap of a fiftieth of the side."""
    from netgen.occ import Box, Glue, OCCGeometry, Rectangle, X, Y, Z

    gap = SIDE / 50
    if kind.startswith("space"):
        low, high = Box((0, 0, 0), (SIDE, SIDE, SIDE / 2)), Box((0, 0, SIDE / 2 + gap), (SIDE, SIDE, SIDE + gap))
        for each, bottom, top in ((low, "bottom", "lower"), (high, "upper", "top")):
            each.faces.name = "side"
            each.faces.Min(Z).name, each.faces.Max(Z).name = bottom, top
        return ngs.Mesh(OCCGeometry(Glue([low, high])).GenerateMesh(maxh=SIDE))
    low, high = Rectangle(SIDE, SIDE / 2).Face(), Rectangle(SIDE, SIDE / 2).Face().Move((0, SIDE / 2 + gap, 0))
    for each, bottom, top in ((low, "bottom", "lower"), (high, "upper", "top")):
        each.edges.name = "side"
        each.edges.Min(X).name = "left"
        each.edges.Min(Y).name, each.edges.Max(Y).name = bottom, top
    return ngs.Mesh(OCCGeometry(Glue([low, high]), dim=2).GenerateMesh(maxh=SIDE / 2))


class Tool:
    """A rigid plate above the top that goes down and then along: a motion of rigid bodies."""

    def __init__(self, dim: int, height: float = SIDE, down: float = 8e-4, along: float = 4e-4) -> None:
        self.times, self.events, self.dim, self.height = (0.0, 1.0, 2.0), (1.0, 2.0), dim, height
        self.down, self.along, self._ways = ngs.Parameter(0.0), ngs.Parameter(0.0), ((0, down, down), (0, 0, along))

    def set(self, t: float) -> None:
        """Put it where it is."""
        for way, values in zip((self.down, self.along), self._ways, strict=True):
            way.Set(float(np.interp(t, self.times, values)))

    def travel(self, start: float, end: float) -> float:
        """Both ways together (m)."""
        return float(sum(np.interp(end, self.times, w) - np.interp(start, self.times, w) for w in self._ways))

    def contact(self, wall: str, share: float, way: ngs.Parameter | None = None) -> RigidContact:
        """With a wall."""
        down = way or self.down
        return RigidContact(
            wall, lambda x: self.height - down - x[self.dim - 1], 1e7, 1e-5, share, travel=way or self.along
        )


def up(dim: int, value: float) -> tuple[float, ...]:
    """A vector along the last axis."""
    return (0.0,) * (dim - 1) + (value,)


INGREDIENTS = (
    "hereditary branches", "Maxwell branches", "displacements alone", "discontinuous pressures", "traction", "weight",
    "follower pressure", "cavity of given volume", "springs", "rigid face", "contact by penalty", "contact with offset",
    "sliding wall", "walls that close", "friction", "inertia", "tool of given force",
)  # fmt: skip
CONTROLLERS = ("load path", "load history", "moving tool", "differentiated run")
RIGID = ("contact by penalty", "contact with offset", "friction", "walls that close", "tool of given force")
INSTEAD = (
    {"displacements alone", "discontinuous pressures"}, {"contact by penalty", "contact with offset"},
    {"contact by penalty", "tool of given force"}, {"cavity of given volume", "walls that close"},
)  # fmt: skip
"""Ingredients that are in one another's place."""


def attempt(kind: str, ingredient: str, controller: str) -> str:
    """`WORKS`, the one line that refuses it, or "—" where there is nothing to try."""
    if ingredient == "tool of given force" and controller in ("load path", "load history"):
        return "—"  # it has a force over time, which a moving tool stands for here
    return tried(kind, {ingredient}, controller)


def together(kind: str, one: str, other: str) -> str:
    """The same of two ingredients, with a moving tool."""
    return "—" if one == other or {one, other} in INSTEAD else tried(kind, {one, other}, "moving tool")


def tried(kind: str, ingredients: set[str], controller: str) -> str:
    """Run it, and hold what supports, loads and contacts exert to adding up to nothing along the last axis."""
    if "cavity of given volume" in ingredients and kind == "space, hexahedra":
        return "—"  # there is no mesh of such a body here
    try:
        run(kind, ingredients, controller)
    except InputError as error:
        return str(error)
    return WORKS


class Body:
    """Meshes, their walls, and what holds them: a block, two halves with a slit between, or a part of a thick ring or ball."""

    def __init__(self, kind: str, ingredients: set[str]) -> None:
        self.mesh_kind = kind
        self.kinematics = Axisymmetric() if kind.startswith("axi") else None
        self.growth, self.top, self.right, self.bottom, self.height = 0.0, "top", "right", "bottom", SIDE
        axis = {"left": (0, None)} if self.kinematics else {}
        if "cavity of given volume" in ingredients:
            self.mesh, planes, self.growth = hollow(kind)
            self.top = self.right = "outer"
            self.bottom, self.height = "foot", 2 * SIDE
            self.supports: dict = planes
        else:
            self.mesh = mesh_of(kind, "walls that close" in ingredients)
            self.supports = {"bottom": 0, **axis}
        if "walls that close" in ingredients:
            self.right, self.height = "side", SIDE * 1.02
        self.dim = self.mesh.dim


def run(kind: str, ingredients: set[str], controller: str) -> None:
    """One scene of some ingredients, driven by a controller."""
    closing, moving = "walls that close" in ingredients, controller in ("moving tool", "differentiated run")
    body, given = Body(kind, ingredients), PrescribedForce((0.0, 1.0, 2.0), (0.0, 2e-3, 2e-3), away=-1e-3, nudge=1e-6)
    dim, forced = body.dim, "tool of given force" in ingredients
    tool = Tool(dim, body.height)
    loads = [load for name, load in loads_of(body).items() if name in ingredients]
    contacts: list = []
    plated = bool(ingredients & {"contact by penalty", "contact with offset", "friction", "tool of given force"})
    if plated or (moving and not closing):
        share = 0.9 if ingredients & {"contact with offset", "tool of given force"} else 0.0
        contacts.append(tool.contact(body.top, share, given.parameter if forced else None))
    if "friction" in ingredients:
        contacts.append(Friction(contacts[0], 0.3, 2e-4, lambda x, way: way * ngs.CF((1.0,) + (0.0,) * (dim - 1))))
    if "sliding wall" in ingredients:
        contacts.append(SlidingSupport.on(body.mesh, body.right if body.right != body.top else "axis", 1e7))
    supports = dict(body.supports)
    if "sliding wall" in ingredients:
        supports.pop("axis", None)
    if closing:
        contacts.append(SelfContact("lower", "upper", 1e6, 1e-5, SIDE / 10))
        if not plated:
            supports["top"] = up(dim, -1e-3)
        elif "springs" not in ingredients:
            loads.append(Spring("side", 1e4))  # nothing else holds the half between the plate and the slit
    elif (not contacts or ingredients == {"sliding wall"}) and not moving and not body.growth:
        supports["top"] = (None,) * (dim - 1) + (-4e-4,)
    if forced:
        contacts.append(given)
    law = tissue(ingredients, relaxing=controller == "differentiated run")
    element = "P2" if "displacements alone" in ingredients else "P2/P1"
    if "discontinuous pressures" in ingredients:
        hexes = any(each.type is ngs.HEX for each in body.mesh.Elements())
        element = "P3/L2(1)" if hexes else "P4/L2(2)"
    options = {"element": element, "kinematics": body.kinematics}
    problem = Problem(body.mesh, {".*": Material(law, BULK)}, supports, loads, contacts, **options)
    volume = problem.volume("inner") if body.growth else 0.0
    drive(problem, controller, tool, given if forced else None, closing and not plated, bool(ingredients & set(RIGID)))
    if controller == "differentiated run":
        return
    if body.growth:
        assert abs(problem.volume("inner") - volume - body.growth) < 1e-6 * body.growth
    else:
        balance(problem)


def tissue(ingredients: set[str], relaxing: bool) -> Any:
    """A law with the branches asked for; with a hereditary one if it has to relax."""
    hereditary, flowing = "hereditary branches" in ingredients, "Maxwell branches" in ingredients
    if not (hereditary or flowing or relaxing):
        return NeoHooke(MU)
    branches = [Branch(NeoHooke(MU / 2), 1.0)] if hereditary or not flowing else []
    more = [Maxwell(NeoHooke(MU / 2), MU)] if flowing else []
    return Viscous(NeoHooke(MU / 2), (*branches, *more))


def loads_of(body: Body) -> dict[str, Any]:
    """By ingredient."""
    right, dim = body.right, body.dim
    return {
        "traction": TractionLoad(right, up(dim, 20.0)),
        "weight": BodyForce(up(dim, -2e3)),
        "follower pressure": PressureLoad(right, 20.0),
        "cavity of given volume": CavityVolume("inner", body.growth),
        "springs": Spring(right, 1e4),
        "rigid face": RigidFace(right, (-2e-4,) + (0.0,) * (dim - 1), 1e7),
        "inertia": Inertia(1000.0),
    }


def drive(
    problem: Problem, controller: str, tool: Tool, given: PrescribedForce | None, loaded: bool, tooled: bool
) -> None:
    """To the end; `loaded`: boundary conditions grow while a tool moves."""
    if controller == "load path":
        LoadPath(problem, tool).solve()
    elif controller == "load history":
        tool.set(1.0 if tooled and not loaded else 0.0)
        run_load_history(problem, [0.0, 0.5, 1.0, 2.0], [0.0, 0.5, 1.0, 1.0], lambda t: None)
    elif controller == "moving tool":
        grows = loaded or any(isinstance(load, CavityVolume) for load in problem.loads)
        history = LoadHistory([0.0, 1.0, 2.0], [0.0, 1.0, 1.0]) if grows else None
        TimeStepper(problem, given or tool, StepControl(0.5), 1e-3, loads=history).run(lambda *_: None)
    else:
        if loaded:
            problem.load(problem.x, 1.0)
        last, times = problem.mesh.dim - 1, [0.0, 0.5, 1.0, 2.0]
        wall = "bottom" if "bottom" in problem.mesh.GetBoundaries() else "foot"
        seen = [Force(wall, up(last + 1, 1.0))]
        of = RunModel(problem, given or tool, times, {"none": ngs.Parameter(0.0)}, seen)
        there = of.evaluate(of.theta)
        assert np.all(np.isfinite(there.gradient(np.ones_like(there.data))))


def hollow(kind: str) -> tuple[ngs.Mesh, dict, float]:
    """A quarter of a thick ring, or an eighth of a thick ball, what holds it, and a twentieth of its cavity."""
    if kind.startswith("space"):
        from netgen.occ import Box, OCCGeometry, Pnt, Sphere, X, Y, Z

        ball = (Sphere(Pnt(0, 0, 0), 2 * SIDE) - Sphere(Pnt(0, 0, 0), SIDE)) * Box((0, 0, 0), (3 * SIDE,) * 3)
        ball.faces.name = "outer"
        for axis, name in ((X, "axis"), (Y, "side"), (Z, "foot")):
            ball.faces.Min(axis).name = name
        for face in ball.faces:
            if face.name == "outer" and face.center.x < 0.8 * SIDE:
                face.name = "inner"
        mesh = ngs.Mesh(OCCGeometry(ball).GenerateMesh(maxh=SIDE)).Curve(2)
        planes = {"foot": (None, None, 0), "axis": (0, None, None), "side": (None, 0, None)}
        return mesh, planes, 4 / 3 * np.pi * SIDE**3 / 8 / 20
    mesh = MakeStructured2DMesh(
        quads="quad" in kind, nx=2, ny=4,
        mapping=lambda x, y: (SIDE * (1 + x) * np.cos(np.pi / 2 * y), SIDE * (1 + x) * np.sin(np.pi / 2 * y)),
    )  # fmt: skip
    for old, new in (("left", "inner"), ("right", "outer"), ("bottom", "foot"), ("top", "axis")):
        for i, name in enumerate(mesh.GetBoundaries()):
            if name == old:
                mesh.ngmesh.SetBCName(i, new)
    ring = 2 / 3 * np.pi * SIDE**3 if kind.startswith("axi") else np.pi / 4 * SIDE**2
    return mesh, {"foot": (None, 0), "axis": (0, None)}, ring / 20


def balance(problem: Problem) -> None:
    """The tissue's forces along the last axis are in balance by themselves; free unknowns have none left over."""
    forces = problem.tissue_forces()
    span = problem.u.space.Range(problem.mesh.dim - 1)
    size = np.abs(forces).sum()
    assert size > 0
    up = ngs.GridFunction(problem.u.space)
    up.Set(ngs.CF((0.0,) * (problem.mesh.dim - 1) + (1.0,)))
    lifted = up.vec.FV().NumPy()
    assert abs(lifted @ forces) < 1e-6 * size and span.stop > span.start
    r, reactions = problem.residual(problem.x)
    assert np.linalg.norm(r) < 1e-4 * max(reactions, 1e-3 * size)  # springs may bear all, and supports nothing


def outcomes(meshes: tuple[str, ...] = MESHES) -> dict[tuple[str, str, str], str]:
    """Of every ingredient with every controller."""
    return {
        (ingredient, controller, kind): attempt(kind, ingredient, controller)
        for ingredient in INGREDIENTS
        for controller in CONTROLLERS
        for kind in meshes
    }


def pairs(meshes: tuple[str, ...] = MESHES) -> dict[tuple[str, str, str], str]:
    """Of every two ingredients, with a moving tool."""
    found = {}
    for i, one in enumerate(INGREDIENTS):
        for other in INGREDIENTS[i:]:
            for kind in meshes:
                found[one, other, kind] = found[other, one, kind] = together(kind, one, other)
    return found


def table(found: dict[tuple[str, str, str], str], columns: tuple[str, ...] = CONTROLLERS) -> str:
    """A row for each ingredient; a cell says on which kinds of mesh it works, and what refuses it."""
    notes: list[str] = []
    heads = columns if columns == CONTROLLERS else tuple(str(i) for i, _ in enumerate(columns, 1))
    rows = [f"| | {' | '.join(heads)} |", "|---" * (len(columns) + 1) + "|"]
    for number, ingredient in enumerate(INGREDIENTS, 1):
        cells = [cell(found, ingredient, column, notes) for column in columns]
        rows.append(f"| {ingredient if columns == CONTROLLERS else f'{number} {ingredient}'} | {' | '.join(cells)} |")
    return "\n".join([*rows, "", *(f"{i}. ``{said}``" for i, said in enumerate(notes, 1))])


def cell(found: dict[tuple[str, str, str], str], ingredient: str, column: str, notes: list[str]) -> str:
    """Of a table; what refuses is added to the notes."""
    of = {kind: said for kind in MESHES if (said := found.get((ingredient, column, kind), "—")) != "—"}
    refused = {kind: said for kind, said in of.items() if said != WORKS}
    if not refused:
        return "yes" if of else "—"
    said = next(iter(refused.values()))
    if said not in notes:
        notes.append(said)
    where = "" if len(refused) == len(of) else f" ({', '.join(kind for kind in of if kind not in refused)})"
    return f"{'refused' if not where else 'yes' + where} [{notes.index(said) + 1}]"


if __name__ == "__main__":
    text = PAGE.read_text()
    for name, made in (("table", table(outcomes())), ("pairs", table(pairs(), INGREDIENTS))):
        begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
        put = f"{begin}\n{made}\n{end}"
        text = re.sub(f"{begin}.*?{end}", lambda _, put=put: put, text, flags=re.DOTALL)
    PAGE.write_text(text)
