"""Work of twenty small problems, counted: a change that makes a solver take more iterations or factorisations is seen.

`work_counts.json` holds the counts; `python tests/verification/test_work_counts.py` writes them anew after a change that is meant
to alter them. A count may differ by one, or by a twentieth where it is large: versions of NGSolve and BLAS move a last iteration.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ngsolve as ngs
import numpy as np
import pytest
from ngsolve.meshes import MakeStructured2DMesh

import ngbrain as nb
from ngbrain.datasets import SHIPPED
from ngbrain.errors import StabilityWarning
from ngbrain.forward import (
    Axisymmetric,
    BodyForce,
    ErrorControl,
    Force,
    Friction,
    GeneralizedAlpha,
    Inertia,
    LoadCase,
    RigidContact,
    StaticModel,
    StepControl,
)
from ngbrain.io import WaveData
from ngbrain.ladder import search_models
from ngbrain.materials import Branch, Maxwell, NeoHooke, Ogden, Viscous
from ngbrain.mesh import block
from ngbrain.solvers import Newton

Counts = dict[str, float]
RECORD = Path(__file__).with_name("work_counts.json")
CASES: dict[str, Callable[[], Counts]] = {}
SIDE = 0.02
BRAIN = Ogden(700.0, -15.0)
HEREDITARY = Viscous(Ogden(300.0, -12.0), (Branch(BRAIN, 3.0),))
FLOWING = Viscous(Ogden(300.0, -12.0), (Maxwell(BRAIN, 2100.0),))
PRESS = ((0.0, 2.0, 6.0, 8.0), (0.0, 2e-3, 2e-3, -1e-3))


def case(function: Callable[[], Counts]) -> Callable[[], Counts]:
    CASES[function.__name__] = function
    return function


def square(n: int = 6) -> ngs.Mesh:
    return MakeStructured2DMesh(quads=False, nx=n, ny=n, mapping=lambda x, y: (SIDE * x, SIDE * y))


def cube(maxh: float = 0.01) -> ngs.Mesh:
    return block((SIDE,) * 3, maxh)


def solved(problem: nb.Problem, steps: int = 1) -> Counts:
    record = nb.LoadPath(problem).solve(steps=steps)
    assert record.converged
    return record.statistics


@case
def small_strain() -> Counts:
    tissue = {".*": nb.Material(NeoHooke(1e3), 1e4)}
    return solved(nb.Problem(square(), tissue, {"bottom": 0, "top": (1e-5, 0)}, element="P2"))


@case
def compressed_by_a_quarter() -> Counts:
    tissue = {".*": nb.Material(BRAIN, 1e5)}
    return solved(nb.Problem(square(), tissue, {"bottom": 0, "top": (0, -0.25 * SIDE)}, element="P3/P2"), 4)


@case
def sheared_in_space() -> Counts:
    tissue = {".*": nb.Material(BRAIN, 1e6)}
    return solved(nb.Problem(cube(), tissue, {"bottom": 0, "top": (0.3 * SIDE, 0, 0)}, element="P2/P1"), 2)


@case
def third_order_in_space() -> Counts:
    tissue = {".*": nb.Material(NeoHooke(1e3), 1e6)}
    return solved(nb.Problem(cube(), tissue, {"bottom": 0, "top": (0, 0, -0.1 * SIDE)}, element="P3/P2"))


@case
def iterative_solver() -> Counts:
    tissue = {".*": nb.Material(NeoHooke(1e3), 5e3)}
    body = nb.Problem(cube(0.006), tissue, {"bottom": 0, "top": (0, 0, -2e-3)}, element="P2", solver="cg-bddc")
    return solved(body)


@case
def iterative_solver_with_pressure() -> Counts:
    tissue = {".*": nb.Material(NeoHooke(1e3), 1e6)}
    return solved(nb.Problem(cube(), tissue, {"bottom": 0, "top": (0, 0, -1e-3)}, element="P2/P1", solver="minres-amg"))


@case
def round_body() -> Counts:
    tissue = {".*": nb.Material(BRAIN, 1e5)}
    supports = {"left": (0, None), "bottom": (None, 0), "top": (0, -0.15 * SIDE)}
    return solved(nb.Problem(square(), tissue, supports, element="P2/P1", kinematics=Axisymmetric()), 2)


@case
def steps_that_are_halved() -> Counts:
    tissue = {".*": nb.Material(BRAIN, 1e4)}
    body = nb.Problem(square(8), tissue, {"bottom": 0, "top": (0.6 * SIDE, -0.1 * SIDE)}, element="P2/P1")
    with pytest.warns(StabilityWarning):
        return solved(body)


@case
def own_weight() -> Counts:
    tissue, weight = {".*": nb.Material(NeoHooke(500.0), 5e5)}, [BodyForce((0, 0, -9.81e3))]
    return solved(nb.Problem(cube(), tissue, {"bottom": 0}, weight, element="P2/P1"), 2)


def indented(friction: float | None = None) -> Counts:
    def ball(x: Any) -> Any:
        return ngs.Norm(x - ngs.CF((0.01, 0.01, 0.0282 + (1 - way) * 2e-3))) - 0.01

    way = ngs.Parameter(0.0)
    contact = RigidContact("top", ball, 1e7, 1e-4, 0.5, way)
    contacts = [contact] if friction is None else [contact, Friction(contact, friction, 1e-4)]
    body = nb.Problem(
        cube(), {".*": nb.Material(NeoHooke(1e3), 1e4)}, {"bottom": 0}, contacts=contacts, element="P2/P1"
    )
    work: Counts = {"iterations": 0, "factorisations": 0}
    newton, x = Newton(), body.x
    for share in (0.25, 0.5, 0.75, 1.0):
        way.Set(share)
        body.begin(1.0)
        x, record = newton.solve(body, x)
        assert record.converged
        for name in work:
            work[name] += record.statistics[name]
    return work


@case
def ball_on_a_block() -> Counts:
    return indented()


@case
def ball_on_a_block_with_friction() -> Counts:
    return indented(0.3)


class Plate:
    """A plate above the top that goes down and up again, straight in between."""

    def __init__(self) -> None:
        self.events, self.depth = PRESS[0][1:], ngs.Parameter(0.0)

    def set(self, t: float) -> None:
        self.depth.Set(np.interp(t, *PRESS))

    def travel(self, start: float, end: float) -> float:
        return float(np.interp(end, *PRESS) - np.interp(start, *PRESS))

    def contact(self) -> RigidContact:
        return RigidContact("top", lambda x: SIDE - self.depth - x[2], 1e8, 1e-8)


def run(law: Any, control: StepControl, **options: Any) -> Counts:
    plate = Plate()
    body = nb.Problem(
        cube(),
        {".*": nb.Material(law, 1e5)},
        {"bottom": 0},
        contacts=[plate.contact()],
        element="P2/P1",
        **options,
    )
    stepper = nb.TimeStepper(body, plate, control, 1e-3)
    stepper.run(lambda *_: None)
    at = stepper.progress
    return {
        "steps": at.steps,
        "rejected": at.rejected,
        "iterations": at.newton,
        "factorisations": at.work.factorisations,
    }


@case
def pressed_and_released_hereditary() -> Counts:
    return run(HEREDITARY, StepControl(1.0, dt_max=2.0))


@case
def pressed_and_released_maxwell() -> Counts:
    return run(FLOWING, StepControl(1.0, dt_max=2.0))


@case
def steps_by_their_error() -> Counts:
    return run(HEREDITARY, ErrorControl(1e-3, touch=0.1, longest=4.0))


@case
def swinging() -> Counts:
    mass = Inertia({".*": 1e3}, GeneralizedAlpha(0.8))
    shear = ngs.Parameter(1.0)
    body = nb.Problem(
        cube(SIDE),
        {".*": nb.Material(NeoHooke(1e3), 1e5)},
        {"bottom": 0},
        [mass, BodyForce((5e3 * shear, 0, 0))],
        element="P2/P1",
    )
    stepper = nb.TimeStepper(body, Idle(), StepControl(2e-3, dt_max=2e-3), 1e-3)
    stepper.run(lambda *_: None, until=0.02)
    at = stepper.progress
    return {"steps": at.steps, "iterations": at.newton, "factorisations": at.work.factorisations}


class Idle:
    """No rigid body moves."""

    events = (0.02,)

    def set(self, t: float) -> None: ...

    def travel(self, start: float, end: float) -> float:
        return 0.0


def counted(model: Any) -> Counts:
    return {name: n for name, n in vars(model.solves).items() if n}


def stiffness_of_a_square() -> tuple[StaticModel, np.ndarray]:
    mu, alpha = ngs.Parameter(1e3), ngs.Parameter(-10.0)
    bodies = [
        nb.Problem(
            square(4), {".*": nb.Material(Ogden(mu, alpha), 1e5)}, {"bottom": 0, "top": (0, -d)}, element="P2/P1"
        )
        for d in (1e-3, 3e-3)
    ]
    model = StaticModel([LoadCase(body, [Force("top")]) for body in bodies], {"mu": mu, "alpha": alpha})
    measured = model.evaluate(model.theta).data.copy()
    mu.Set(2.5e3), alpha.Set(-4.0)
    return model, measured


@case
def derivatives_of_first_and_second_order() -> Counts:
    model, measured = stiffness_of_a_square()
    there = model.evaluate(model.theta)
    there.gradient(there.data - measured)
    there.hvp(np.ones_like(measured), np.ones_like(model.theta))
    return counted(model)


@case
def two_constants_from_forces() -> Counts:
    model, measured = stiffness_of_a_square()
    found = nb.estimate(model, measured, 0.01)
    assert found.converged
    return {"iterations": len(found.history), **counted(model)}


def plane_waves(across: int, motion: str) -> WaveData:
    """Shear waves that pass through a square, and 3 % of noise."""
    line, modulus = (np.arange(across) + 0.5) * 2.5e-3, 2e3 + 7e2j
    points = np.column_stack([part.ravel() for part in np.meshgrid(line, line)])
    k = 2 * np.pi * 60 * np.sqrt(1e3 / modulus)
    waves = 1e-5 * np.exp(-1j * k * points)
    waves += 2e-7 * np.random.default_rng(1).normal(size=(2, *waves.shape)).T.copy().view(complex)[..., 0].T
    known = {"motion": motion, "noise": 0.03}
    if motion == "in_plane":
        return WaveData(points, waves[None, :, ::-1], [60.0], 1e3, "isotropic", "viscoelastic", bulk=2.2e9, **known)
    return WaveData(points, waves.T[..., None], [60.0, 60.0], 1e3, "isotropic", "viscoelastic", **known)


@case
def waves_in_the_plane() -> Counts:
    return nb.invert(plane_waves(10, "in_plane"), regulariser="smooth").statistics


@case
def motion_through_a_slice() -> Counts:
    return nb.invert(plane_waves(14, "anti_plane"), regulariser="smooth").statistics


@case
def cheapest_model_of_a_plate() -> Counts:
    found = search_models(nb.Scene.from_toml(SHIPPED / "plate.toml"))
    return {"rungs": len(found.history), "unknowns": found.chosen.ndof}


@pytest.mark.parametrize("name", CASES)
def test_the_work_is_what_it_was(name: str) -> None:
    kept = json.loads(RECORD.read_text())[name]
    now = {count: float(n) for count, n in CASES[name]().items()}
    off = {count: (kept.get(count), n) for count, n in now.items() if abs(n - kept.get(count, -9)) > max(1, n / 20)}
    assert now.keys() == kept.keys() and not off, off


def test_every_record_has_its_case() -> None:
    assert json.loads(RECORD.read_text()).keys() == CASES.keys() and len(CASES) == 20


if __name__ == "__main__":
    nb.set_threads(1)
    RECORD.write_text(json.dumps({name: run_case() for name, run_case in CASES.items()}, indent=1) + "\n")
