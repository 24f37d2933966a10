"""Rigid bodies whose force is given: how far they have gone is one more unknown, and its equation is the force's.

With the energy Π(x, s) of a body's unknowns x and a rigid body's way s, the force that the rigid body feels is ∂Π/∂s, so that

    ∂Π/∂x = 0 ,   ∂Π/∂s = f(t)

are the equations of Π - f s, and their tangent is symmetric: the body's own K, bordered by ∂²Π/∂x∂s. It is solved by what K's
factorisation does, and one more back-substitution for each. Where nothing is touched nothing depends on s: a rigid
body of no force is taken away, and one that is to press again is first led to touch.

Source: Keller 1977, bordered systems, in Applications of Bifurcation Theory, Academic Press, 359-384.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import ngsolve as ngs
import numpy as np

from ngbrain.errors import Breakdown, ContactError, InputError
from ngbrain.forward.contact.rigid import Contact
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.tangent import Solve
from ngbrain.forward.transient.step_control import Control
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.solvers.newton import Newton
from ngbrain.solvers.record import NewtonRecord

LENGTH_SCALE = 1e-3
"""A correction of the way is judged against (m)."""
NOTHING = 1e-9
"""Share of the largest force below which a force counts as none."""
CLOSE = 1e-6
"""How near (m) a rigid body without force stays to the tissue,"""
NEARLY = 1e-8
"""and how well (m) it keeps that."""
APPROACHES = 100
"""Steps of its way there, at most; each is as long as the gap allows."""
SHARE = 0.01
"""Of a correction's size that the way has: as much as all displacements where a hundredth of the body follows."""


class Press:
    """A force over time as a `Motion`: `travel` is in newtons, and the rigid body is where the solution puts it.

    times, force   s, and N (≥ 0) straight in between
    away           where (m, on the way) the rigid body touches nothing, whatever the tissue does
    nudge          how far (m) beyond a gap it goes to feel the tissue

    parameter  its way (m), `Contact.way`; force: what it is to feel now (N)
    held       where it stands whatever the force; None while it presses
    """

    def __init__(self, times: Sequence[float], force: Sequence[float], away: float, nudge: float) -> None:
        self._times, self._force = np.array(times, float), np.array(force, float)
        self.events = tuple(float(t) for t in times[1:])
        self.away, self.nudge = away, nudge
        self.parameter = ngs.Parameter(0.0)
        self.force = 0.0
        self.held: float | None = None

    def at(self, t: float) -> float:
        """Force (N) at time t (s); 0 where it is next to nothing."""
        force = float(np.interp(t, self._times, self._force))
        return force if force > NOTHING * self._force.max() else 0.0

    def set(self, t: float) -> None:
        """Ask for the force of time t; without one the rigid body is held away."""
        self.force = self.at(t)
        self.held = None if self.force else self.away

    def travel(self, start: float, end: float) -> float:
        """Change of the force (N) between two times."""
        return self.at(end) - self.at(start)


class PressedBody(Problem):
    """A `Problem` with the way of a rigid body as its last unknown, whose equation is that of the force that `press` asks for.

    press   moves the contacts whose `way` is its own; the rest is what a `Problem` takes

    Several rigid bodies that share the way share the work, too: the force is the derivative of all their energies by it.
    Raises `InputError` for friction, and what `Problem` raises.
    """

    def __init__(self, mesh: ngs.Mesh, *args: Any, press: Press, **options: Any) -> None:
        self.press = press
        super().__init__(mesh, *args, **options)
        if self.friction.frictions:
            raise InputError("contacts", "with friction", "none: a given force is of contact alone")
        self.pace = np.zeros(2)
        at, weight = self.layout.fields(self.fes.TrialFunction()), self.kinematics.weight()
        self._felt, self._stiffness = (ngs.BilinearForm(self.fes, symmetric=True) for _ in range(2))
        for contact in self.contacts:
            if isinstance(contact, Contact) and contact.way is press.parameter:
                driving = weight * contact.driving(at.u, at.offset)
                self._felt += ngs.Variation(driving.Compile() * contact.measure())
                self._stiffness += ngs.Variation(driving.Diff(press.parameter).Compile() * contact.measure())

    @property
    def state(self) -> np.ndarray:
        """All unknowns and the way as one array, a copy."""
        return np.append(self.gfu.vec.FV().NumPy(), self.press.parameter.Get())

    @state.setter
    def state(self, x: np.ndarray) -> None:
        self.gfu.vec.FV().NumPy()[:] = x[:-1]
        self.press.parameter.Set(x[-1] if self.press.held is None else self.press.held)

    def felt(self) -> float:
        """Force (N) along the way at the current state."""
        return float(self._felt.Energy(self.gfu.vec))

    def residual(self, x: np.ndarray) -> tuple[np.ndarray, float]:
        """The body's residual, and what the force misses; 0 where the rigid body is held."""
        r, reactions = super().residual(x)
        return np.append(r, 0.0 if self.press.held is not None else self.felt() - self.press.force), reactions

    def factorise(self, x: np.ndarray, r: np.ndarray | None = None) -> Solve:
        """Solver with the bordered tangent at x; see `Problem.factorise`."""
        solve = super().factorise(x, r)
        return solve if self.partial else self._bordered(solve)

    def refactorise(self, x: np.ndarray, r: np.ndarray | None = None) -> Solve | None:
        """Solver with the bordered tangent, renewed in part; see `Problem.refactorise`."""
        solve = super().refactorise(x, None if r is None else r[:-1])
        return solve and self._bordered(solve)

    def _bordered(self, inner: Solve) -> Solve:
        """With the border of where the tangent was made: of a stiff contact they cancel each other but for a hundredth."""
        self._felt.Apply(self.gfu.vec, self._vec)
        column = self._vec.FV().NumPy() * self._free
        follows = inner(column)
        stiffness = float(self._stiffness.Energy(self.gfu.vec)) - float(column @ follows)

        def solve(r: np.ndarray) -> np.ndarray:
            y = inner(r[:-1])
            if self.press.held is not None:
                return np.append(y, 0.0)
            if not stiffness > 0:
                raise Breakdown(f"the force does not grow with the way ({stiffness:.1e} N/m)")
            way = (r[-1] - column @ y) / stiffness
            return np.append(y - way * follows, way)

        return solve

    def begin(self, dt: float) -> None:
        """Begin a time step of `dt` seconds from the present state; it ends with `finish`."""
        super().begin(dt)
        self._started = np.array([self.press.parameter.Get(), dt])

    def path_error(self) -> float:
        """By how much the way bends within the step that now ends: its mean distance from the chord, relative to the way.

        The history takes all paths for straight, and a step of creep is not.
        """
        rate, dt = self._pace()
        before, last = self.pace
        if not last or self.press.held is not None:
            return 0.0
        return float(abs(dt**2 / 12 * (rate - before) / ((dt + last) / 2) / self.press.parameter.Get()))

    def _pace(self) -> np.ndarray:
        """Mean speed (m/s) of the step that now ends, and its length (s)."""
        start, dt = self._started
        return np.array([(self.press.parameter.Get() - start) / dt, dt])

    def finish(self) -> None:
        """End the step begun; a rigid body that is held away comes back until it is just clear."""
        super().finish()
        self.pace = self._pace() if self.press.held is None else np.zeros(2)
        if self.press.held is not None:
            self.approach(CLOSE)
            self.press.held = self.press.parameter.Get()
            self.tissue.stays_at(self.state)

    @property
    def memory(self) -> dict[str, Any]:
        """All that decides the steps to come besides the state."""
        return {**super().memory, "way_pace": self.pace}

    @memory.setter
    def memory(self, saved: dict[str, Any]) -> None:
        self.history.memory = saved
        self.pace = np.array(saved["way_pace"])

    def approach(self, gap: float) -> None:
        """Move the rigid body, which is clear of the tissue, towards it until a gap (m) is left."""
        way = self.press.parameter
        for _ in range(APPROACHES):
            left = self.min_gap() - gap
            if left < NEARLY:
                break
            way.Set(way.Get() + left)  # a distance changes by no more than the way


class Pressing(TimeStepper):
    """Time stepping of a `PressedBody`: a `TimeStepper` whose follow and drift are per newton of its motion.

    limit   way (m) beyond which the run ends

    Raises `ContactError` where the force takes the rigid body beyond the limit; and what `TimeStepper` raises.

    >>> from ngbrain.forward.common.material import Material
    >>> from ngbrain.forward.transient.step_control import StepControl
    >>> from ngbrain.materials import NeoHooke, Prony
    >>> from ngbrain.mesh import block
    >>> press = Press((0.0, 4.0, 60.0), (0.0, 1e-3, 1e-3), away=-1e-3, nudge=1e-6)
    >>> plate = Contact("top", lambda x: 0.02 - press.parameter - x[2], 1e9, 1e-7, way=press.parameter)
    >>> tissue = {"tissue": Material(Prony(NeoHooke(1000.0), g=[0.5], tau=[5.0]), 1e6)}
    >>> body = PressedBody(block((0.02, 0.02, 0.02), 0.02), tissue, {"bottom": 0}, contacts=[plate], element="P2/P1", press=press)
    >>> run, way = Pressing(body, StepControl(1.0), 1e-3), {}
    >>> run.run(lambda body, at, record: way.update({at.t: press.parameter.Get()}))
    >>> way[60.0] > 1.5 * way[4.0], f"{body.felt():.6f} N"
    (True, '0.001000 N')
    """

    problem: PressedBody
    motion: Press

    def __init__(
        self,
        problem: PressedBody,
        control: Control,
        penetration_limit: float,
        newton: Newton | None = None,
        limit: float = np.inf,
    ) -> None:
        super().__init__(problem, problem.press, control, penetration_limit, newton)
        self.limit, self.motion.held = limit, problem.press.parameter.Get()

    @property
    def weights(self) -> np.ndarray:
        """The body's weights, and the way's."""
        return np.append(self.problem.weights, SHARE / LENGTH_SCALE**2)

    def _stand(self, x: np.ndarray) -> None:
        """Go to a state of the present time; a rigid body without force stays just clear."""
        self._set(self.progress.t)
        if self.motion.held is not None:
            self.motion.held = x[-1]
        self.problem.state = x

    def _up_to_touch(self, dt: float) -> float:
        """A rigid body that is asked for a force is there at once."""
        touch, t = self.control.touch, self.progress.t
        return min(dt, touch) if self.motion.travel(t, t + touch) > 0 else dt

    def _guess(self, start: np.ndarray, dt: float, tries: int) -> np.ndarray:
        """The same as for a given way; a rigid body that does not touch is first led to where it does."""
        if self.progress.touching or not self.motion.force:
            return super()._guess(start, dt, tries)
        self.problem.state = start
        self.motion.held = start[-1] + max(self.problem.min_gap(), 0.0) + self.motion.nudge
        guess, record = self.newton.solve(self, np.append(start[:-1], self.motion.held))
        self.motion.held, self.newton.inverse = None, None  # a tangent of before the touch knows nothing of it
        self.progress.work += record.work
        self.progress.newton += record.iterations
        return guess if record.converged else start

    def _attempt(self, start: np.ndarray, dt: float, tries: int) -> tuple[NewtonRecord, Breakdown | None]:
        record, failed = super()._attempt(start, dt, tries)
        if failed is None and self.problem.state[-1] > self.limit:
            way, t, force = self.problem.state[-1], self.progress.t + dt, self.motion.force
            self._stand(start)
            raise ContactError(
                f"a force of {force:.3g} N at t = {t:.3f} s takes the blade {1e3 * way:.2f} mm far, beyond the limit of "
                f"{1e3 * self.limit:.4g} mm; try a smaller force"
            )
        return record, failed
