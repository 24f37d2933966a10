"""Inputs moved in their last digits (`--perturb SEED`), as another processor or compiler rounds what follows from them.

What is moved: the points of meshes, time steps, loads and prescribed displacements. Only what enters the arithmetic is moved, not
what is merely stored and read again, such as the times of a schedule.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partialmethod
from typing import Any

import numpy as np
import pytest

DRAWN = 8
"""Last places within which a value moves: each is 1.1e-16 to 2.2e-16 of it."""
_BITS = np.int64(0x7FFFFFFFFFFFFFFF)
_GOLDEN, _FIRST, _SECOND = (np.uint64(n) for n in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB))


def moved(values: Any, seed: int, together: bool = False) -> np.ndarray:
    """Values, real or complex, with their last three bits drawn anew by the seed and their other bits.

    The same value always moves alike, and what has been moved once does not move again: copies stay copies, and a run that goes on
    from saved numbers goes on from the same ones. Zeros stay.

    together   draw by all values of a row: points of one plane leave it
    """
    values = np.array(values, complex if np.iscomplexobj(values) else float, order="C")
    numbers = np.atleast_1d(values).view(float)  # of the same memory
    bits = numbers.view(np.int64)
    size = bits & _BITS
    kept = (size + DRAWN // 2) // DRAWN * DRAWN
    keys = (kept | (bits & ~_BITS)).view(np.uint64)
    drawn = _mixed(keys + _mixed(np.full_like(keys, seed)))
    if together:
        row = drawn[..., :1] * 0
        for i in range(drawn.shape[-1]):
            row = _mixed(row + drawn[..., i : i + 1])
        drawn = _mixed(row + drawn)
    drawn = (drawn % np.uint64(DRAWN)).astype(np.int64) - DRAWN // 2
    move = np.isfinite(numbers) & (kept > 0)
    bits[move] += (kept + drawn - size)[move]
    return values


def _mixed(keys: np.ndarray) -> np.ndarray:
    """SplitMix64 (Steele, Lea and Flood 2014, 10.1145/2660193.2660195)."""
    keys = keys + _GOLDEN
    keys = (keys ^ (keys >> np.uint64(30))) * _FIRST
    keys = (keys ^ (keys >> np.uint64(27))) * _SECOND
    return keys ^ (keys >> np.uint64(31))


def perturb(seed: int) -> pytest.MonkeyPatch:
    """Move meshes, time steps and loads from now on, in worker processes too, until the `undo` of what is returned."""
    import ngsolve as ngs
    from netgen import meshing

    from ngbrain.forward.contact.force_control import PrescribedForce
    from ngbrain.forward.harmonic.problem import HarmonicProblem
    from ngbrain.forward.solid.inertia import GeneralizedAlpha
    from ngbrain.forward.solid.internal_variables import History
    from ngbrain.forward.solid.problem import Problem
    from ngbrain.forward.transient.time_stepper import TimeStepper
    from ngbrain.materials.lab.relaxing import _TimeMarch
    from ngbrain.parallel import processes
    from ngbrain.surgery.protocols import ToolMotion

    patch = pytest.MonkeyPatch()

    def one(value: float) -> float:
        return float(moved(value, seed))

    def make(self: ngs.Mesh, original: Callable[..., None], *args: Any) -> None:
        for mesh in args:
            if isinstance(mesh, meshing.Mesh) and len(mesh.Points()):
                points = mesh.Coordinates()
                points[:] = moved(points, seed, together=True)
        original(self, *args)

    def load(body: Problem, original: Callable[..., Any], x: np.ndarray, t: float) -> np.ndarray:
        x = original(body, x, t)
        body.factor.Set(one(t))
        given = np.flatnonzero(body.fixed)
        x[given] = moved(x[given], seed)
        return x

    def answer(self: Any, original: Callable[..., Any], *args: Any) -> Any:
        found = original(self, *args)
        return moved(found, seed) if np.ndim(found) else one(found)

    def last(self: Any, original: Callable[..., Any], *args: Any) -> Any:
        return original(self, *args[:-1], one(args[-1]))

    for owner, names, by in (
        (ngs.Mesh, ["__init__"], make),
        (Problem, ["load"], load),
        (HarmonicProblem, ["_prescribed", "load_vector"], answer),
        (TimeStepper, ["_propose"], answer),
        (ToolMotion, ["value"], answer),
        (PrescribedForce, ["prescribed_force"], answer),
        (History, ["begin"], last),
        (GeneralizedAlpha, ["begin", "weight"], last),
        (_TimeMarch, ["begin"], last),
    ):
        for name in names:
            patch.setattr(owner, name, partialmethod(by, getattr(owner, name)))
    begin = processes.START.replace(
        "from ngbrain.parallel.worker",
        f"import perturbation; perturbation.perturb({seed}); from ngbrain.parallel.worker",
    )
    patch.setattr(processes, "START", begin)
    return patch
