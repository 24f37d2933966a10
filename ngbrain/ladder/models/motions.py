"""Prescribed displacements and loads over time: formulas of position and time, rotations, and proportional loads.

A `Problem` multiplies prescribed values by its load factor, which grows with the loads. Values that follow a formula of time, and
rotations, are divided by that growth, so that the product is the value of the formula.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.common.dirichlet import Support
from ngbrain.forward.solid.problem import Problem
from ngbrain.materials.base import Value
from ngbrain.scene import DisplacementBC, Scene
from ngbrain.scene.conditions import Given, depends_on_time, evaluate_at

FIELDS: Mapping[str, Callable[..., Any]] = {
    **{name: getattr(ngs, name) for name in ("sin", "cos", "tan", "exp", "log", "sqrt")},
    "abs": lambda x: ngs.IfPos(x, x, -x),
    "tanh": lambda x: 1 - 2 / (1 + ngs.exp(2 * x)),
    "min": lambda x, y: ngs.IfPos(x - y, y, x),
    "max": lambda x, y: ngs.IfPos(x - y, x, y),
}
"""Functions of formulas, for coefficient functions."""
BEGUN = 1e-9
"""Load factor from which loads count as applied."""
LONG, SAMPLES, MOMENTS = 0.2, 2001, 21
"""Assumed side (m) of a body that is no block; number of times at which motions are sampled, and at which they are checked."""
GOLDEN = (5**0.5 - 1) / 2
INSTANT = 1e-7
"""Fraction of the total time for a finite-difference speed; there may be many periods between samples."""
MOST = 5000
"""Largest number of time steps of a motion."""


class PrescribedMotion:
    """Prescribed displacements and loads of a body, a `Motion` of the time stepper.

    Parameters
    ----------
    moment : callable
        From the control variable, such as a load factor, to the time (s) and the growth of the loads.
    plane : bool
        Whether the body is the section y = 0.
    """

    events = ()

    def __init__(self, moment: Callable[[float], tuple[float, float]], plane: bool) -> None:
        self._moment, self.plane, self._moves = moment, plane, False
        self.time, self.growth = ngs.Parameter(0.0), ngs.Parameter(1.0)
        self._problem: Problem | None = None
        self.set(1.0)

    @property
    def axes(self) -> tuple[int, ...]:
        """Space axes of the body."""
        return (0, 2) if self.plane else (0, 1, 2)

    @property
    def place(self) -> tuple[Any, Any, Any]:
        """Coordinates at rest, as fields."""
        return (ngs.x, ngs.CF(0.0), ngs.y) if self.plane else (ngs.x, ngs.y, ngs.z)

    def support(self, bc: DisplacementBC) -> Support:
        """Prescribed components of a condition at full load."""
        parts: list[Any] = list(bc.value)
        if not bc.is_even:
            self._moves |= bc.has_course
            parts = [each / self.growth for each in bc.displacement(self.place, self.time, self.growth, FIELDS)]
        parts = [part if axis in bc.components else None for axis, part in zip("xyz", parts, strict=True)]
        return tuple(parts[i] for i in self.axes)

    def value(self, given: Given) -> Value:
        """Value of a load at full size."""
        found = evaluate_at(given, self.place, self.time, FIELDS)
        return found / self.growth if depends_on_time(given) else found

    def vector(self, given: tuple[Given, ...]) -> tuple[Value, ...]:
        """Components of a load that the body has."""
        parts = [self.value(each) for each in given]
        return tuple(parts[i] for i in self.axes)

    def drive(self, problem: Problem) -> Problem:
        """Connect to a problem with these supports and loads, in its final state."""
        self._problem = problem
        self.set(1.0)
        return problem

    def set(self, t: float) -> None:
        """Apply the values at t."""
        time, growth = self._moment(t)
        self.time.Set(time)
        self.growth.Set(max(growth, BEGUN))
        if self._moves and self._problem is not None:
            self._problem.prescribed = self._problem.supports.coefficients(self._problem.u.space)[0]
        if self._problem is not None and not np.isfinite(self._problem.prescribed).all():
            raise InputError(
                "displacement_bc.value_mm", "not finite at some node", "finite values all over the boundary"
            )

    def travel(self, start: float, end: float) -> float:
        """Advance of a rigid body, which it does not have.

        Parameters
        ----------
        start, end : float

        Returns
        -------
        float
            0.
        """
        return 0.0


def characteristic_time(scene: Scene, until: float) -> float:
    """Shortest time in which a time-dependent value would reach its maximum at its largest rate.

    Parameters
    ----------
    scene : Scene
    until : float
        End (s).

    Returns
    -------
    float
        In s; infinite without time-dependent values.
    """
    sides = np.array(scene.geometry.sides if scene.geometry.kind == "block" else (LONG,) * 3)
    corners = np.array([(a, b, c) for a in (-0.5, 0.5) for b in (-0.5, 0.5) for c in (0, 1)]) * sides
    place = list(np.vstack([corners, [(0, 0, sides[2] / 2)]]).T[:, :, None])
    times = until * (np.arange(SAMPLES) * GOLDEN % 1)  # uniform ones sample a periodic motion at the same phase

    def courses(t: np.ndarray) -> list[Any]:
        found = [bc.displacement(place, t, 1.0) for bc in scene.displacement_bcs if bc.is_timed]
        found += [
            [evaluate_at(each, place, t) for each in load.value if depends_on_time(each)] for load in scene.tractions
        ]
        found += [[evaluate_at(load.value, place, t)] for load in scene.pressures if depends_on_time(load.value)]
        found += [list(body.displacement(t, 1.0)) for body in scene.contacts if body.is_timed]
        return [part for course in found for part in course]

    least = np.inf
    with np.errstate(all="ignore"):
        for now, then in zip(courses(times), courses(times + INSTANT * until), strict=True):
            speed = np.abs(then - now).max() / (INSTANT * until)
            if speed > 0:
                least = min(least, float(np.abs(now).max() / speed))
    return least


def time_steps(scene: Scene, until: float, share: int, longest: float) -> np.ndarray:
    """Equal time steps in the ramp and in the hold.

    Parameters
    ----------
    scene : Scene
    until : float
        End (s).
    share : int
        Number of steps per characteristic time.
    longest : float
        Longest step (s).

    Returns
    -------
    (n,) array
        Times (s), one of them at the end of the ramp.

    Raises
    ------
    InputError
        More than `MOST` steps.
    """
    ramp = scene.time.ramp
    longest = min(longest, min(ramp, characteristic_time(scene, until)) / share)
    if until / longest > MOST:
        raise InputError(
            "time.end_s", until, f"at most {MOST * longest:.3g}, which takes {MOST} steps of a motion this fast"
        )
    grow = np.linspace(0, ramp, math.ceil(ramp / longest) + 1)
    if until <= ramp * (1 + 1e-9):
        return grow
    return np.concatenate([grow, np.linspace(ramp, until, math.ceil((until - ramp) / longest) + 1)[1:]])


def check(scene: Scene, mesh: ngs.Mesh, sides: tuple[float, ...]) -> None:
    """Refuse values that are not finite on their boundary, displacements larger than the body, and motions that do not start at
    rest.

    Parameters
    ----------
    scene : Scene
    mesh : ngs.Mesh
    sides : tuple of float
        Size (m) of the body.

    Raises
    ------
    InputError
        It names the key.
    """
    names = sorted(set(mesh.GetBoundaries()))
    times = np.linspace(0, scene.time.end, MOMENTS)
    growth = np.minimum(times / scene.time.ramp, 1)
    for i, bc in enumerate(scene.displacement_bcs, 1):
        place = _vertices(mesh, bc.boundary, names)
        with np.errstate(all="ignore"):
            moved = [np.broadcast_to(u, (len(place[0]), MOMENTS)) for u in bc.displacement(place, times, growth)]
        key = f"displacement_bc#{i}.{'value_mm' if bc.rotation is None else 'rotation_deg'}"
        shown = bc.toml_value("value" if bc.rotation is None else "rotation")
        if not all(np.isfinite(u).all() for u in moved):
            raise InputError(key, shown, f"finite values all over {bc.boundary!r}, at every time")
        if any(np.abs(u[:, 0]).max(initial=0) > 1e-9 for u in moved):
            raise InputError(key, shown, "a formula of t that is 0 at t = 0, as the body starts at rest")
        if bc.rotation is None and not all(
            np.abs(u).max(initial=0) < side for u, side in zip(moved, sides, strict=True)
        ):
            wanted = f"less than the body, {' x '.join(f'{1e3 * s:.4g}' for s in sides)} mm"
            raise InputError(key, shown, wanted)
    for i, body in enumerate(scene.contacts, 1):
        with np.errstate(all="ignore"):
            parts = [np.broadcast_to(part, MOMENTS) for part in body.displacement(times, growth)]
        if not np.isfinite(parts).all():
            raise InputError(f"contact#{i}.travel_mm", body.toml_value("travel"), "finite values at every time")
        if any(abs(part[0]) > 1e-9 for part in parts):
            wanted = "formulas of t that are 0 at t = 0, as the body starts at rest"
            raise InputError(f"contact#{i}.travel_mm", body.toml_value("travel"), wanted)
        if body.boundary and not any(re.fullmatch(body.boundary, name) for name in names):
            raise InputError(f"contact#{i}.boundary", repr(body.boundary), f"one of {', '.join(names)}")
    loads = [(f"traction#{i}", load) for i, load in enumerate(scene.tractions, 1)]
    loads += [(f"pressure#{i}", load) for i, load in enumerate(scene.pressures, 1)]  # type: ignore[misc]
    for name, load in loads:
        place = _vertices(mesh, load.boundary, names)
        for each in load.value if isinstance(load.value, tuple) else (load.value,):
            with np.errstate(all="ignore"):
                found = np.broadcast_to(evaluate_at(each, place, times), (len(place[0]), MOMENTS))
            if not np.isfinite(found).all():
                raise InputError(
                    f"{name}.value_Pa", load.toml_value("value"), f"finite values all over {load.boundary!r}"
                )
            if depends_on_time(each) and np.abs(found[:, 0]).max(initial=0) > 1e-9 * np.abs(found).max(initial=0):
                wanted = "a formula of t that is 0 at t = 0, as the body starts at rest"
                raise InputError(f"{name}.value_Pa", load.toml_value("value"), wanted)


def check_apart(scene: Scene, names: set[str]) -> None:
    """Refuse two conditions for the same component of a boundary.

    Parameters
    ----------
    scene : Scene
    names : set of str
        Boundaries of the mesh.

    Raises
    ------
    InputError
        It names both conditions.
    """
    for i, bc in enumerate(scene.displacement_bcs, 1):
        mine = {name for name in names if re.fullmatch(bc.boundary, name)}
        for j, other in enumerate(scene.displacement_bcs[: i - 1], 1):
            shared = mine & {name for name in names if re.fullmatch(other.boundary, name)}
            axes = [axis for axis in bc.components if axis in other.components]
            if shared and axes:
                found = (
                    f"{bc.boundary!r}, which displacement_bc#{j} ({other.boundary!r}) prescribes along {axes[0]} too"
                )
                raise InputError(f"displacement_bc#{i}.boundary", found, f"one condition for {min(shared)!r}")


def _vertices(mesh: ngs.Mesh, pattern: str, names: list[str]) -> list[np.ndarray]:
    """x, y and z (m) of a boundary's vertices, each (n, 1)."""
    if not any(re.fullmatch(pattern, name) for name in names):
        return [np.zeros((0, 1))] * 3
    numbers = sorted({vertex.nr for element in mesh.Boundaries(pattern).Elements() for vertex in element.vertices})
    return list(np.array([mesh.vertices[number].point for number in numbers]).T[:, :, None])
