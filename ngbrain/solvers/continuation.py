"""Load stepping: adaptive load factors with a predictor, step cuts, and loose tolerances on the way."""

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
"""Tolerances of intermediate states; only the last one needs the given ones."""
SMALLEST = 1e-3
"""Smallest step of the load factor."""
EASY = 8
"""Newton iterations up to which the next step is doubled."""
COLLAPSED = 0.1
"""det F below which a failed step is not tried again with smaller ones."""
STILL = 1e-10
"""Weighted correction below which an unloaded state is in equilibrium."""
PROBE = 1e-4
"""Fraction of a step for the difference quotient of the residual with respect to the load factor."""


NEAR = 4
"""Factorisations allowed from a state that is near the equilibrium."""
PARTS = (1.0, 0.9, 0.75)
"""Fractions of such a state and of the load: the first one without inverted points is the start."""


class Path(System, Protocol):
    """A system under a load that grows with a factor t from 0 to 1."""

    def load(self, x: Array, t: float) -> Array:
        """Set the load factor.

        Parameters
        ----------
        x : array (n,)
            State.
        t : float
            Load factor.

        Returns
        -------
        array (n,)
            The state with the prescribed values at t.
        """

    def step(self, newton: Newton, x: Array, t: float, goal: float, guess: Array) -> tuple[Array, NewtonRecord]:
        """Solve for the equilibrium at the next load factor.

        Parameters
        ----------
        newton : Newton
            Settings.
        x : array (n,)
            Equilibrium at t.
        t, goal : float
            Load factors at the step's start and end.
        guess : array (n,)
            Initial guess.

        Returns
        -------
        x : array (n,)
            Equilibrium at `goal`.
        record : NewtonRecord
        """


def follow(
    path: Path,
    newton: Newton,
    x: Array,
    steps: int = 1,
    callback: Callable[[float, Array], None] | None = None,
    begin: float = 0.0,
) -> tuple[Array, PathRecord]:
    """Follow the equilibrium path from load factor `begin` to 1.

    The first predictor is the tangent dx/dt = x̄' - K⁻¹ (dR/dt + K x̄') with x̄ the prescribed values, later ones are secants.
    Guesses with det F ≤ min_det are rejected before any solve. A load that changes nothing leaves x unchanged, as residual and
    reactions are both round-off there.

    Parameters
    ----------
    path : Path
        The system.
    newton : Newton
        Settings; tolerances are relaxed before the last step.
    x : array (n,)
        Equilibrium at `begin`.
    steps : int
        Load steps if all succeed; steps that fail are halved.
    callback : callable, optional
        Called with load factor and state after each step.
    begin : float
        Load factor at the start.

    Returns
    -------
    x : array (n,)
        Last equilibrium reached.
    record : PathRecord
    """
    record, t, dt = PathRecord(), begin, 1 / steps
    if not begin and _load_has_no_effect(path, newton, x, record):
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
    """Equilibrium at load factor 1 from an approximate state, such as one of a coarser body.

    Where x is inverted at some points, a fraction of x at that fraction of the load is the start.

    Parameters
    ----------
    path : Path
        The system.
    newton : Newton
        Settings.
    x : array (n,)
        State near the equilibrium.
    steps : int
        Load steps for what remains.
    callback : callable, optional
        As in `follow`.

    Returns
    -------
    tuple of array (n,) and PathRecord, or None
        None where Newton's method does not converge.
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
    """One load step: the reason for failure, if any, and the state."""
    try:
        if before:
            guess = x + (goal - t) / (t - before[1]) * (x - before[0])
        else:
            guess = x + _tangent_predictor(path, newton, x, t, goal, record)
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


def _load_has_no_effect(path: Path, newton: Newton, x: Array, record: PathRecord) -> bool:
    """Whether x is in equilibrium and the whole load changes neither prescribed values nor residual, to the last bit."""
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


def _tangent_predictor(path: Path, newton: Newton, x: Array, t: float, goal: float, record: PathRecord) -> Array:
    """Tangent predictor from t to `goal`; the residual's derivative is a difference quotient."""
    r = path.residual(path.load(x, t))[0]
    near = t + PROBE * (goal - t)
    lifted = path.load(x, near)
    rate = (path.residual(lifted)[0] - r) / PROBE
    if newton.inverse is None:
        # Factorise for this right-hand side: the residual r is zero here, and an old factor would seem accurate for it.
        newton.inverse = path.factorise(path.load(x, t), rate)
        record.work.factorisations += 1
    record.work.residuals += 2
    record.work.solves += 1
    return (lifted - x) / PROBE - newton.inverse(rate)
