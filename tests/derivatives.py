"""Every parameter of every term: derivatives of an equilibrium and of a run, once and twice, by Taylor rates.

python tests/derivatives.py     writes the table of the guide's page `tutorials/guide/reference/combinations.md`
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import ngsolve as ngs
import numpy as np
from combinations import PAGE, SIDE, WORKS, Body, mesh_of, slitted, up
from friction_blocks import Sliding

from ngbrain.errors import InputError
from ngbrain.forward.common.loads import (
    BodyForce,
    CavityPressure,
    CavityVolume,
    PressureLoad,
    RigidBody,
    RigidFace,
    Spring,
    TractionLoad,
)
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.force_control import PrescribedForce
from ngbrain.forward.contact.friction import Friction
from ngbrain.forward.contact.rigid import RigidContact, SelfContact
from ngbrain.forward.contact.rigid import SlidingSupport as Film
from ngbrain.forward.observables import Force, Functional
from ngbrain.forward.sensitivity.node_positions import NodePositions
from ngbrain.forward.sensitivity.parameter_blocks import PrescribedDisplacement
from ngbrain.forward.sensitivity.static_model import LoadCase, StaticModel
from ngbrain.forward.sensitivity.transient.run_model import RunModel
from ngbrain.forward.solid.inertia import Inertia
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials import Branch, Maxwell, NeoHooke, Viscous

MESHES = ("plane strain, triangles", "axisymmetric, quadrilaterals", "space, tetrahedra")
GRID = (0.0, 0.5, 1.0, 1.5, 3.0)
COLUMNS = ("equilibrium", "equilibrium, twice", "run", "run, twice")
FIRST, RATES = 2e-2, 6
BENT = Functional(lambda at: ngs.InnerProduct(at.u, at.u) * at.dx(".*"), name="mean square displacement")

ROWS: dict[tuple[str, str], float] = {
    ("tissue", "shear modulus, a field"): 1e3, ("tissue", "bulk modulus"): 2e4,
    ("hereditary branch", "modulus"): 500.0, ("hereditary branch", "relaxation time"): 1.0,
    ("Maxwell branch", "modulus"): 500.0, ("Maxwell branch", "viscosity"): 1e3,
    ("traction", "value"): 20.0, ("weight", "value"): 2e3, ("follower pressure", "value"): 20.0,
    ("pressure of a cavity", "value"): 20.0, ("cavity of given volume", "volume"): 1.0, ("springs", "stiffness"): 1e4,
    ("rigid face", "stiffness"): 1e6, ("rigid body", "stiffness"): 1e6, ("rigid body", "place"): 2e-4,
    ("contact by penalty", "penalty"): 1e7, ("contact by penalty", "softness"): 1e-4, ("contact by penalty", "travel"): 1.0,
    ("contact with offset", "penalty"): 1e7, ("contact with offset", "shape"): 1e-4,
    ("sliding wall", "stiffness"): 1e6, ("walls that close", "penalty"): 1e6, ("friction", "coefficient"): 0.3,
    ("friction", "slip"): 5e-5, ("inertia", "density"): 1e5, ("tool of given force", "force"): 0.5,
    ("supports", "prescribed value"): 1.0, ("mesh", "node positions"): 1.0,
}  # fmt: skip
TOUCHED = ("contact by penalty", "contact with offset", "friction", "tool of given force")
THROUGH_TIME = ("hereditary branch", "Maxwell branch", "friction", "inertia", "tool of given force")
"""Terms that an equilibrium has not."""


class Scene:
    """A body with one term more, and one of what that is made of as parameter, all else numbers."""

    def __init__(self, kind: str, term: str, what: str, running: bool) -> None:
        hollow = term in ("pressure of a cavity", "cavity of given volume")
        self.of, self.term, self.what = Body(kind, {"cavity of given volume"} if hollow else set()), term, what
        self.dim, self.running, self.plate = self.of.dim, running, Sliding(1e-3, 1e-3)
        if term == "walls that close":
            self.of.mesh, self.of.right, self.of.height = slitted(kind), "side", SIDE * 1.02
        if term == "mesh":
            self.of.mesh = mesh_of(kind)
        self.parameter: Any = ngs.Parameter(ROWS[term, what])
        if what.endswith("a field"):
            self.parameter = ngs.GridFunction(ngs.H1(self.of.mesh, order=1))
            self.parameter.Set(ROWS[term, what] * (1 + 10 * ngs.x))
        if term == "mesh":
            self.parameter = NodePositions(self.of.mesh)
        self.motion: Any = self.plate

    def of_term(self, term: str, what: str, value: float) -> Any:
        """The parameter, or a number in its place."""
        return self.parameter if (term, what) == (self.term, self.what) else value

    def problem(self) -> Problem:
        """With a plate that presses, or that is where it pressed to, wherever nothing else does."""
        of, supports = self.of, dict(self.of.supports)
        contacts = self.contacts()
        loads = self.loads()
        if self.term == "supports":
            supports["left"] = (-2e-4, *(None,) * (self.dim - 1)) if not of.kinematics else (0, None)
            supports["bottom"] = up(self.dim, 2e-4)
        law = Viscous(NeoHooke(self.of_term("tissue", "shear modulus, a field", 1e3)), self.branches())
        material = Material(law if self.running else law.equilibrium, self.of_term("tissue", "bulk modulus", 2e4))
        element = "Q2/Q1" if "quad" in of.mesh_kind else "P2/P1"
        return Problem(of.mesh, {".*": material}, supports, loads, contacts, element, of.kinematics)

    def branches(self) -> tuple[Any, ...]:
        """A hereditary one, or the one that is asked for."""
        if self.term == "Maxwell branch":
            made = (
                self.of_term("Maxwell branch", what, value) for what, value in (("modulus", 500.0), ("viscosity", 1e3))
            )
            modulus, viscosity = made
            return (Maxwell(NeoHooke(modulus), viscosity),)
        modulus = self.of_term("hereditary branch", "modulus", 500.0)
        return (Branch(NeoHooke(modulus), self.of_term("hereditary branch", "relaxation time", 1.0)),)

    def loads(self) -> list[Any]:
        """Of the term, or none."""
        of, dim, value = self.of, self.dim, self.parameter
        aside = (1.0, *(0.0,) * (dim - 1))
        made: dict[str, Callable[[], Any]] = {
            "traction": lambda: TractionLoad(of.right, tuple(value * c for c in aside)),
            "weight": lambda: BodyForce(tuple(value * c for c in up(dim, -1.0))),
            "follower pressure": lambda: PressureLoad(of.right, value),
            "pressure of a cavity": lambda: CavityPressure("inner", value),
            "cavity of given volume": lambda: CavityVolume("inner", of.growth * value),
            "springs": lambda: Spring(of.right, value),
            "rigid face": lambda: RigidFace(of.right, tuple(-2e-4 * c for c in aside), value),
            "rigid body": self.rigid_body,
            "inertia": lambda: Inertia(value),
        }
        return [made[self.term]()] if self.term in made else []

    def rigid_body(self) -> RigidBody:
        """A face that is deep in the right side."""
        place, stiffness = self.of_term("rigid body", "place", 2e-4), self.of_term("rigid body", "stiffness", 1e6)
        across = int(self.dim == 3)  # where the right side is
        return RigidBody(self.of.right, lambda x, t: SIDE - t * place - x[across], stiffness, 1e-5)

    def contacts(self) -> list[Any]:
        """The plate, and what goes with it."""
        of, last, term, down = self.of, self.dim - 1, self.term, self.plate.down
        if term == "tool of given force":
            force = self.parameter
            force.Set({"space": 0.02, "axisymmetric": 0.05}.get(of.mesh_kind.split(",")[0], 0.5))
            self.motion = PrescribedForce((0.0, 1.0, 8.0), (0.0, force, force), away=-1e-3, nudge=1e-5)
            down = self.motion.parameter
        name = "contact with offset" if term == "contact with offset" else "contact by penalty"
        way, lift = self.of_term(name, "travel", 1.0), self.of_term(name, "shape", 1e-4)
        penalty, softness = self.of_term(name, "penalty", 1e7), self.of_term(name, "softness", 1e-4)
        share = 0.9 if term in ("contact with offset", "tool of given force") else 0.0
        along = self.motion.parameter if term == "tool of given force" else self.plate.along
        plate = RigidContact(
            of.top, lambda x: of.height - way * down + lift * ngs.x / SIDE - x[last], penalty, softness, share, along
        )
        found: list[Any] = [plate]
        if term == "friction":
            coefficient, slip = self.of_term(term, "coefficient", 0.3), self.of_term(term, "slip", 5e-5)
            found.append(Friction(plate, coefficient, slip, lambda x, way: way * ngs.CF((1.0, *(0.0,) * last))))
        if term == "sliding wall":
            found.append(Film.on(of.mesh, of.right, self.parameter))
        if term == "walls that close":
            found.append(SelfContact("lower", "upper", self.parameter, 1e-5, SIDE / 10))
        return [*found, self.motion] if term == "tool of given force" else found

    def models(self) -> Any:
        """The model whose derivatives are asked."""
        problem = self.problem()
        block = PrescribedDisplacement(problem, "bottom") if self.term == "supports" else self.parameter
        foot = "foot" if self.of.growth else "bottom"
        asked = [BENT] if self.term == "mesh" and self.running else [Force(foot), BENT]
        if self.term == "mesh":
            asked = [Force(foot)]
        if self.running:
            return RunModel(problem, self.motion, GRID, {self.what: block}, asked)
        self.motion.set(1.0)
        return StaticModel([LoadCase(problem, asked)], {self.what: block})


def attempt(kind: str, term: str, what: str, column: str) -> str:
    """`WORKS`, the one line that refuses it, or "—" where there is nothing to try."""
    running, twice = column.startswith("run"), column.endswith("twice")
    if (not running and term in THROUGH_TIME) or (term == "sliding wall" and kind.startswith("axi")):
        return "—"
    scene = None
    try:
        scene = Scene(kind, term, what, running)
        rates = rates_of(scene.models(), twice)
    except InputError as error:
        return str(error)
    finally:
        if term == "mesh" and scene is not None:
            scene.of.mesh.UnsetDeformation()
    near = np.abs(rates - 2) < 0.1
    assert np.any(near[1:] & near[:-1]), (kind, term, what, column, rates)
    return WORKS


def rates_of(model: Any, twice: bool) -> np.ndarray:
    """Of what is left of a derivative over a grid of steps; 2 where nothing is."""
    rng, start = np.random.default_rng(5), model.theta.copy()
    there = model.evaluate(start)
    largest = np.concatenate(
        [np.full(at.stop - at.start, np.abs(there.data[..., at]).max()) for at in model.observation_slices]
    )
    w = rng.uniform(0.5, 1, size=there.data.shape) / largest
    way = np.abs(start).max() or 5e-4  # of nodes a part of an element
    direction = way * rng.uniform(0.3, 1, size=len(start))
    if twice:
        slope, found = lambda t: model.evaluate(t).gradient(w) * way, there.hvp(w, direction) * way
        size = np.linalg.norm(there.gradient(w) * way)
    else:
        slope, found = (
            lambda t: np.array([np.sum(w * model.evaluate(t).data)]),
            np.array([there.gradient(w) @ direction]),
        )
        size = 1.0
    first, steps = slope(start), FIRST * 0.5 ** np.arange(RATES + 1)
    left = np.array([np.linalg.norm(slope(start + h * direction) - first - h * found) for h in steps])
    assert np.linalg.norm(found) > 1e-12 * size or np.all(left < 1e-9 * size), (found, left)
    with np.errstate(divide="ignore", invalid="ignore"):
        rates = np.log2(left[:-1] / left[1:])
    nothing = left < 1e-8 * np.linalg.norm(found) * steps  # what is linear leaves nothing
    return np.where(nothing[1:], 2.0, rates)


def outcomes(meshes: tuple[str, ...] = MESHES) -> dict[tuple[str, str, str, str], str]:
    """Of every parameter of every term in every column."""
    return {(*row, column, kind): attempt(kind, *row, column) for row in ROWS for column in COLUMNS for kind in meshes}


def table(found: dict[tuple[str, str, str, str], str]) -> str:
    """A row for each parameter of each term."""
    notes: list[str] = []
    lines = [f"| term | by | {' | '.join(COLUMNS)} |", "|---" * (len(COLUMNS) + 2) + "|"]
    for term, what in ROWS:
        cells = []
        for column in COLUMNS:
            said = {found[term, what, column, kind] for kind in MESHES if (term, what, column, kind) in found} - {"—"}
            refused = sorted(said - {WORKS})
            notes += [each for each in refused if each not in notes]
            marks = "".join(f" [{notes.index(each) + 1}]" for each in refused)
            cells.append(
                "—" if not said else "yes" if not refused else ("refused" if WORKS not in said else "yes, but") + marks
            )
        lines.append(f"| {term} | {what} | {' | '.join(cells)} |")
    return "\n".join([*lines, "", *(f"{i}. ``{said}``" for i, said in enumerate(notes, 1))])


if __name__ == "__main__":
    begin, end = "<!-- derivatives -->", "<!-- end of derivatives -->"
    made = f"{begin}\n{table(outcomes())}\n{end}"
    PAGE.write_text(re.sub(f"{begin}.*?{end}", lambda _: made, PAGE.read_text(), flags=re.DOTALL))
