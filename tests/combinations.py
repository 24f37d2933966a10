"""Every ingredient of a `Problem` with every controller, on every kind of mesh: what works, and what is refused in one line.

python tests/combinations.py     writes the table of the guide's page `tutorials/guide/combinations.md`
"""

from __future__ import annotations

import re
from pathlib import Path

import ngsolve as ngs
import numpy as np
from ngsolve.meshes import MakeStructured2DMesh, MakeStructured3DMesh

from ngbrain.errors import InputError
from ngbrain.forward.common.kinematics import Axisymmetric
from ngbrain.forward.common.loads import CavityVolume, Pressure, RigidFace, Spring, Traction, Weight
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.force_control import GivenForce
from ngbrain.forward.contact.friction import Friction
from ngbrain.forward.contact.rigid import Closing, Contact, Sliding
from ngbrain.forward.sensitivity.readings import Force
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.forward.solid.inertia import Inertia
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics.load_path import LoadPath
from ngbrain.forward.transient.step_control import StepControl
from ngbrain.forward.transient.time_stepper import LoadHistory, TimeStepper, run_load_history
from ngbrain.materials import Maxwell, NeoHooke, Prony, Viscous

SIDE, GAP, MU, BULK = 0.02, 0.004, 1e3, 2e4
PAGE = Path(__file__).parents[1] / "tutorials" / "guide" / "combinations.md"
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

    def __init__(self, dim: int, down: float = 8e-4, along: float = 4e-4) -> None:
        self.times, self.events, self.dim = (0.0, 1.0, 2.0), (1.0, 2.0), dim
        self.down, self.along, self._ways = ngs.Parameter(0.0), ngs.Parameter(0.0), ((0, down, down), (0, 0, along))

    def set(self, t: float) -> None:
        """Put it where it is."""
        for way, values in zip((self.down, self.along), self._ways, strict=True):
            way.Set(float(np.interp(t, self.times, values)))

    def travel(self, start: float, end: float) -> float:
        """Both ways together (m)."""
        return float(sum(np.interp(end, self.times, w) - np.interp(start, self.times, w) for w in self._ways))

    def contact(self, share: float, way: ngs.Parameter | None = None) -> Contact:
        """With the top."""
        down = way or self.down
        return Contact("top", lambda x: SIDE - down - x[self.dim - 1], 1e7, 1e-5, share, way=way or self.along)


def up(dim: int, value: float) -> tuple[float, ...]:
    """A vector along the last axis."""
    return (0.0,) * (dim - 1) + (value,)


TISSUES = {
    "elastic": NeoHooke(MU),
    "hereditary": Prony(NeoHooke(MU), [0.5], [1.0]),
    "Maxwell": Viscous(NeoHooke(MU / 2), (Maxwell(NeoHooke(MU / 2), MU),)),
}
INGREDIENTS = (
    "hereditary branches", "Maxwell branches", "displacements alone", "discontinuous pressures", "traction", "weight",
    "follower pressure", "cavity of given volume", "springs", "rigid face", "contact by penalty", "contact with offset",
    "sliding wall", "walls that close", "friction", "inertia", "tool of given force",
)  # fmt: skip
CONTROLLERS = ("load path", "load history", "moving tool", "differentiated run")
RIGID = ("contact by penalty", "contact with offset", "friction", "walls that close", "tool of given force")


def attempt(kind: str, ingredient: str, controller: str) -> str:
    """`WORKS`, the one line that refuses it, or "—" where there is nothing to try."""
    tooled = ingredient in RIGID
    if ingredient == "tool of given force" and controller in ("load path", "load history"):
        return "—"  # it has a force over time, which a moving tool stands for here
    if ingredient == "cavity of given volume" and kind == "space, hexahedra":
        return "—"  # there is no mesh of such a body here
    try:
        check(kind, ingredient, controller, tooled)
    except InputError as error:
        return str(error)
    return WORKS


def check(kind: str, ingredient: str, controller: str, tooled: bool) -> None:
    """Run it, and hold what supports, loads and contacts exert to adding up to nothing along the last axis."""
    if ingredient == "cavity of given volume":
        cavity(kind, controller)
        return
    closing = ingredient == "walls that close"
    mesh = mesh_of(kind, closing)
    dim = mesh.dim
    law = {"hereditary branches": "hereditary", "Maxwell branches": "Maxwell"}.get(ingredient, "elastic")
    if controller == "differentiated run" and law == "elastic":
        law = "hereditary"
    element = {
        "displacements alone": "P2",
        "discontinuous pressures": "P4/L2(2)" if "hex" not in kind else "P3/L2(1)",
    }.get(ingredient, "P2/P1")
    kinematics = Axisymmetric() if kind.startswith("axi") else None
    axis = {"left": (0, None)} if kinematics else {}
    loads = {
        "traction": [Traction("right" if not closing else "side", up(dim, 20.0))],
        "weight": [Weight(up(dim, -2e3))],
        "follower pressure": [Pressure("right", 20.0)],
        "springs": [Spring("right", 1e4)],
        "rigid face": [RigidFace("right", (-2e-4,) + (0.0,) * (dim - 1), 1e7)],
        "inertia": [Inertia(1000.0)],
    }.get(ingredient, [])
    tool, press = Tool(dim), GivenForce((0.0, 1.0, 2.0), (0.0, 2e-3, 2e-3), away=-1e-3, nudge=1e-6)
    contacts: list = []
    supports = {"bottom": 0, **axis}
    moving = controller in ("moving tool", "differentiated run")
    if ingredient in ("contact by penalty", "friction", "contact with offset") or (moving and not closing):
        forced = ingredient == "tool of given force"
        share = 0.9 if ingredient in ("contact with offset", "tool of given force") else 0.0
        contacts.append(tool.contact(share, press.parameter if forced else None))
    if ingredient == "friction":
        contacts.append(Friction(contacts[0], 0.3, 2e-4, lambda x: ngs.CF((1.0,) + (0.0,) * (dim - 1))))
    if ingredient == "sliding wall":
        contacts.append(Sliding.on(mesh, "right", 1e7))
    if closing:
        contacts.append(Closing("lower", "upper", 1e6, 1e-5, SIDE / 10))
        supports["top"] = up(dim, -1e-3)
        if kinematics:
            supports["left"] = (0, None)
    elif (not contacts or ingredient == "sliding wall") and not moving:
        supports["top"] = (None,) * (dim - 1) + (-4e-4,)
    material = {".*": Material(TISSUES[law], BULK)}
    options = {"element": element, "kinematics": kinematics}
    if ingredient == "tool of given force":
        contacts.append(press)
    problem = Problem(mesh, material, supports, loads, contacts, **options)
    if controller == "load path":
        LoadPath(problem, tool).solve()
    elif controller == "load history":
        tool.set(0.0)
        if tooled and not closing:
            tool.set(1.0)
        run_load_history(problem, [0.0, 0.5, 1.0, 2.0], [0.0, 0.5, 1.0, 1.0], lambda t: None)
    elif ingredient == "tool of given force":
        if controller == "differentiated run":
            RunModel(problem, press, [0.0, 1.0, 2.0], {"none": ngs.Parameter(0.0)}, [Force("top", up(dim, 1.0))])
        TimeStepper(problem, press, StepControl(0.5), 1e-3).run(lambda *_: None)
    elif controller == "moving tool":
        history = LoadHistory([0.0, 1.0, 2.0], [0.0, 1.0, 1.0]) if closing else None
        TimeStepper(problem, tool, StepControl(0.5), 1e-3, loads=history).run(lambda *_: None)
    else:
        if closing:
            problem.load(problem.x, 1.0)
        of = RunModel(
            problem, tool, [0.0, 0.5, 1.0, 2.0], {"none": ngs.Parameter(0.0)}, [Force("bottom", up(dim, 1.0))]
        )
        there = of.at(of.theta)
        assert np.all(np.isfinite(there.gradient(np.ones_like(there.data))))
        return
    balance(problem)


def cavity(kind: str, controller: str) -> None:
    """A quarter of a thick ring, or an eighth of a thick ball, around a cavity that grows by a twentieth; a plate may press it."""
    kinematics, planes = (Axisymmetric() if kind.startswith("axi") else None), {"foot": (None, 0), "axis": (0, None)}
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
        growth = 4 / 3 * np.pi * SIDE**3 / 8 / 20
    else:
        mesh = MakeStructured2DMesh(
            quads="quad" in kind, nx=2, ny=4,
            mapping=lambda x, y: (SIDE * (1 + x) * np.cos(np.pi / 2 * y), SIDE * (1 + x) * np.sin(np.pi / 2 * y)),
        )  # fmt: skip
        for old, new in (("left", "inner"), ("right", "outer"), ("bottom", "foot"), ("top", "axis")):
            for i, name in enumerate(mesh.GetBoundaries()):
                if name == old:
                    mesh.ngmesh.SetBCName(i, new)
        growth = (2 / 3 * np.pi * SIDE**3 if kinematics else np.pi / 4 * SIDE**2) / 20
    tool, last = Tool(mesh.dim), mesh.dim - 1
    moving = controller in ("moving tool", "differentiated run")
    plate = Contact("outer", lambda x: 2 * SIDE - tool.down - x[last], 1e7, 1e-5, 0.0, tool.along)
    law = TISSUES["hereditary" if controller == "differentiated run" else "elastic"]
    problem = Problem(
        mesh, {".*": Material(law, BULK)}, planes, [CavityVolume("inner", growth)], [plate] if moving else [],
        element="P2/P1", kinematics=kinematics,
    )  # fmt: skip
    volume = problem.volume("inner")
    if controller == "load path":
        LoadPath(problem).solve()
    elif controller == "load history":
        run_load_history(problem, [0.0, 0.5, 1.0, 2.0], [0.0, 0.5, 1.0, 1.0], lambda t: None)
    elif controller == "moving tool":
        loads = LoadHistory([0.0, 1.0, 2.0], [0.0, 1.0, 1.0])
        TimeStepper(problem, tool, StepControl(0.5), 1e-3, loads=loads).run(lambda *_: None)
    else:
        RunModel(problem, tool, [0.0, 1.0, 2.0], {"none": ngs.Parameter(0.0)}, [Force("foot", up(mesh.dim, 1.0))])
        return
    assert abs(problem.volume("inner") - volume - growth) < 1e-6 * growth


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
    assert np.linalg.norm(r) < 1e-4 * max(reactions, 1e-12)


def outcomes(meshes: tuple[str, ...] = MESHES) -> dict[tuple[str, str, str], str]:
    """Of all combinations."""
    return {
        (ingredient, controller, kind): attempt(kind, ingredient, controller)
        for ingredient in INGREDIENTS
        for controller in CONTROLLERS
        for kind in meshes
    }


def table(found: dict[tuple[str, str, str], str]) -> str:
    """A row for each ingredient, a column for each controller; a cell says on how many kinds of mesh it works."""
    notes: list[str] = []
    rows = [f"| | {' | '.join(CONTROLLERS)} |", "|---" * (len(CONTROLLERS) + 1) + "|"]
    for ingredient in INGREDIENTS:
        cells = []
        for controller in CONTROLLERS:
            of = {kind: said for kind in MESHES if (said := found[ingredient, controller, kind]) != "—"}
            refused = {kind: said for kind, said in of.items() if said != WORKS}
            if not of:
                cells.append("—")
            elif not refused:
                cells.append("yes")
            else:
                said = next(iter(refused.values()))
                if said not in notes:
                    notes.append(said)
                where = "" if len(refused) == len(of) else f" ({', '.join(kind for kind in of if kind not in refused)})"
                cells.append(f"{'refused' if not where else 'yes' + where} [{notes.index(said) + 1}]")
        rows.append(f"| {ingredient} | {' | '.join(cells)} |")
    return "\n".join([*rows, "", *(f"{i}. ``{said}``" for i, said in enumerate(notes, 1))])


if __name__ == "__main__":
    text = PAGE.read_text()
    begin, end = "<!-- table -->\n", "\n<!-- end of table -->"
    PAGE.write_text(re.sub(f"{begin}.*{end}", lambda _: f"{begin}{table(outcomes())}{end}", text, flags=re.DOTALL))
