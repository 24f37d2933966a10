"""Load steps chosen as they go: a secant predictor, cuts where a step fails, loose tolerances on the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np

from ngbrain.errors import Breakdown
from ngbrain.result import Status
from ngbrain.solvers.newton import Array, Newton, System
from ngbrain.solvers.record import NewtonRecord, PathRecord

LOOSE = 1e-3
"""Relative residual and correction at which a state on the way is left: only the last one is asked for."""
SMALLEST = 1e-3
"""Step of the load factor below which a path is given up."""
EASY = 8
"""Newton iterations up to which the next step is twice as long."""
COLLAPSED = 0.1
"""det F below which a state that cannot be left by the next step is not worth smaller ones."""
STILL = 1e-10
"""Weighted correction below which a state that nothing acts on is in equilibrium."""
PROBE = 1e-4
"""Part of a step over which the residual's derivative by the load factor is taken."""


NEAR = 4
"""Factorisations that a state which is said to be near the equilibrium may take."""
PARTS = (1.0, 0.9, 0.75)
"""Of such a state and of the load: the first one without inverted points is begun at."""


class Path(System, Protocol):
    """A system under a load that grows with a factor t from 0 to 1."""

    def load(self, x: Array, t: float) -> Array:
        """Set the load factor; the state x with what is prescribed at t put in."""

    def step(self, newton: Newton, x: Array, t: float, goal: float, guess: Array) -> tuple[Array, NewtonRecord]:
        """The equilibrium at t = `goal` from x at t, where it is looked for from a guess; with Newton's record."""


def follow(
    path: Path,
    newton: Newton,
    x: Array,
    steps: int = 1,
    callback: Callable[[float, Array], None] | None = None,
    begin: float = 0.0,
) -> tuple[Array, PathRecord]:
    """From equilibrium x at t = `begin` to the one at t = 1, in `steps` steps if they succeed and in as many as it takes if not.

    The first guess goes along the tangent dx/dt = x̄' - K⁻¹ (dR/dt + K x̄'), x̄ what is prescribed; later ones along the
    secant. Guesses with det F ≤ min_det are cut before any work is done. Returns the last equilibrium reached.
    A load that changes nothing leaves x where it is: there residual and reactions are both round-off, and no end to be seen.
    """
    record, t, dt = PathRecord(), begin, 1 / steps
    if not begin and _idle(path, newton, x, record):
        t = 1.0
        record.history.append((t, NewtonRecord(status=Status.CONVERGED, min_det_F=path.min_det(x))))
        if callback:
            callback(t, x)
    before: tuple[Array, float] | None = None
    while t < 1:
        dt = min(dt, 1 - t) if 1 - t - dt > 1e-9 else 1 - t
        goal = t + dt
        settings = newton if goal >= 1 else replace(newton, rtol=max(newton.rtol, LOOSE), xtol=max(newton.xtol, LOOSE))
        settings.inverse, settings.largest = newton.inverse, newton.largest
        failed, state = _step(path, settings, x, t, goal, before, record)
        newton.inverse, newton.largest = settings.inverse, settings.largest
        if failed is None:
            before, x, t = (x, t), state, goal
            if record.history[-1][1].iterations <= EASY:
                dt = min(1 / steps, 2 * dt)
            if callback:
                callback(t, x)
            continue
        record.cuts.append(f"t = {goal:.4g}: {failed}")
        dt /= 2
        if dt < SMALLEST / steps or record.min_det_F < COLLAPSED:
            record.reason = f"load factor {t:.4g} was reached, {goal:.4g} was not: {failed}"
            record.status = failed.status
            break
    record.factor = t
    if t >= 1:
        record.status = Status.CONVERGED
    path.load(x, t)
    return x, record


def resume(
    path: Path, newton: Newton, x: Array, steps: int = 1, callback: Callable[[float, Array], None] | None = None
) -> tuple[Array, PathRecord] | None:
    """The equilibrium at t = 1 from a state x near it, as far as it may be taken; None where Newton's method does not arrive.

    Where x is inverted, as a coarser body's may be at points that this one did not look at, a part of it at that part of the load
    is what is left of the way.
    """
    allowed = (part for part in PARTS if path.min_det(path.load(part * x, part)) > newton.min_det)
    part = next(allowed, None)
    if part is None:
        return None
    settings = replace(newton, inverse=None, largest=0.0, max_factorisations=NEAR)
    state, found = settings.solve(path, path.load(part * x, part))
    if not found.converged:
        return None
    state, record = follow(path, settings, state, steps, callback, begin=part)
    if not record.converged:
        return None
    record.history.insert(0, (part, found))
    record.tried += found.iterations
    record.work += found.work
    return state, record


def _step(
    path: Path,
    newton: Newton,
    x: Array,
    t: float,
    goal: float,
    before: tuple[Array, float] | None,
    record: PathRecord,
) -> tuple[Breakdown | None, Array]:
    """One step; why it failed, and the state."""
    try:
        if before:
            guess = x + (goal - t) / (t - before[1]) * (x - before[0])
        else:
            guess = x + _along(path, newton, x, t, goal, record)
        guess = path.load(guess, goal)
        det = path.min_det(guess)
        if not det > newton.min_det:
            return Breakdown(f"the guess is inverted (smallest det F {det:.3g})", Status.INVERTED), x
    except Breakdown as error:
        newton.inverse = None
        return error, x
    state, found = path.step(newton, x, t, goal, guess)
    record.work += found.work
    record.tried += found.iterations
    if not found.converged:
        return Breakdown(found.reason, found.status), x
    record.history.append((goal, found))
    return None, state


def _idle(path: Path, newton: Newton, x: Array, record: PathRecord) -> bool:
    """Whether the whole load changes neither what is prescribed nor the residual, to the last bit, and x is in equilibrium."""
    if not np.array_equal(path.load(x, 1.0), x):
        return False
    record.work.residuals += 2
    try:
        loaded = path.residual(x)[0]
        r = path.residual(path.load(x, 0.0))[0]
        if not np.array_equal(r, loaded):
            return False
        newton.inverse = path.factorise(path.load(x, 1.0), r)
    except FloatingPointError:
        return False
    record.work.factorisations += 1
    record.work.solves += 1
    return bool(np.sqrt(path.weights @ newton.inverse(r) ** 2) <= STILL)


def _along(path: Path, newton: Newton, x: Array, t: float, goal: float, record: PathRecord) -> Array:
    """Change of an equilibrium from t to `goal` along its tangent; the residual's derivative is a difference quotient."""
    r = path.residual(path.load(x, t))[0]
    near = t + PROBE * (goal - t)
    lifted = path.load(x, near)
    rate = (path.residual(lifted)[0] - r) / PROBE
    if newton.inverse is None:
        # For the right-hand side that it is to solve: r vanishes here, and an old factor would seem good for it.
        newton.inverse = path.factorise(path.load(x, t), rate)
        record.work.factorisations += 1
    record.work.residuals += 2
    record.work.solves += 1
    return (lifted - x) / PROBE - newton.inverse(rate)
