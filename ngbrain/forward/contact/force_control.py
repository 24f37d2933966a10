"""Force-controlled rigid bodies: their travel is an additional unknown, determined by the prescribed force.

With the energy Π(x, s) of a body's unknowns x and a rigid body's travel s, the force on the rigid body is ∂Π/∂s, so that

    ∂Π/∂x = 0 ,   ∂Π/∂s = f(t)

are the equations of Π - f s, and their tangent is symmetric: the body's own K, bordered by ∂²Π/∂x∂s. The bordered system is solved
with K's factorisation and one more back-substitution for each body. Without contact nothing depends on s: a rigid body without
force is moved away, and one that is to press again is first brought into contact.

Source: Keller 1977, bordered systems, in Applications of Bifurcation Theory, Academic Press, 359-384.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import ngsolve as ngs
import numpy as np

from ngbrain.errors import Breakdown
from ngbrain.forward.common.kinematics import SolidKinematics
from ngbrain.forward.common.state import Term
from ngbrain.forward.common.unknowns import Layout
from ngbrain.forward.contact.friction import FrictionTerm
from ngbrain.forward.contact.rigid import RigidContact, WallContact

Array = np.ndarray
Solve = Callable[[Array], Array]
Force: TypeAlias = float | ngs.Parameter
"""A force (N)."""
LENGTH_SCALE = 1e-3
"""Length (m) relative to which a correction of the travel is measured."""
SHARE = 0.01
"""Weight of the travel in the size of a correction: equal to that of all displacements if a hundredth of the body follows."""
NOTHING = 1e-9
"""Fraction of the largest force below which a force counts as zero."""
CLOSE = 1e-6
"""Gap (m) between the tissue and a rigid body without force,"""
NEARLY = 1e-8
"""and its tolerance (m)."""
APPROACHES = 100
"""Maximum number of steps of an approach; each is as long as the gap."""
LANDINGS = 5
"""Maximum number of attempts to bring a rigid body into contact; each moves it by the remaining gap."""


class PrescribedForce:
    """Rigid bodies under a prescribed force over time: a `Motion`, and one of the `contacts` of a `Problem`.

    `travel` gives a change of force (N); the bodies' own travel is part of the solution. Contacts that share the travel share the
    force: it is the derivative of their total energy with respect to the travel.

    Parameters
    ----------
    times, force : sequence
        Times (s) and forces (N, ≥ 0), linear in between; forces are numbers or `ngs.Parameter`s.
    away : float
        Travel (m) at which the rigid bodies are always clear of the tissue.
    nudge : float
        Depth (m) beyond the gap to which the bodies are moved to establish contact.
    limit : float
        Travel (m) above which a run ends with a `ContactError`.

    Attributes
    ----------
    parameter : ngs.Parameter
        Travel (m) of the bodies: the `RigidContact.travel` of their contacts.
    force : float
        Currently prescribed force (N).
    fixed_travel : float or None
        Fixed travel (m) of bodies without force; None under force control.

    Examples
    --------
    >>> from ngbrain.forward import RigidContact, Material, Problem, StepControl, TimeStepper
    >>> from ngbrain.materials import NeoHooke, Prony
    >>> from ngbrain.mesh import block
    >>> press = PrescribedForce((0.0, 4.0, 60.0), (0.0, 1e-3, 1e-3), away=-1e-3, nudge=1e-6)
    >>> plate = RigidContact("top", lambda x: 0.02 - press.parameter - x[2], 1e9, 1e-7, travel=press.parameter)
    >>> tissue, cube = {"tissue": Material(Prony(NeoHooke(1000.0), g=[0.5], tau=[5.0]), 1e6)}, block((0.02, 0.02, 0.02), 0.02)
    >>> body = Problem(cube, tissue, {"bottom": 0}, contacts=[plate, press], element="P2/P1")
    >>> run, travel = TimeStepper(body, press, StepControl(1.0), 1e-3), {}
    >>> run.run(lambda body, at, record: travel.update({at.t: press.parameter.Get()}))
    >>> travel[60.0] > 1.5 * travel[4.0], f"{body.tool.reaction_force():.6f} N"
    (True, '0.001000 N')
    """

    def __init__(
        self, times: Sequence[float], force: Sequence[Force], away: float, nudge: float, limit: float = np.inf
    ) -> None:
        self._times, self._forces = np.array(times, float), tuple(force)
        self.events = tuple(float(t) for t in times[1:])
        self.away, self.nudge, self.limit = away, nudge, limit
        self.parameter = ngs.Parameter(0.0)
        self.force = 0.0
        self.fixed_travel: float | None = None

    def prescribed_force(self, t: float) -> float:
        """Prescribed force (N) at time t (s); 0 where it is negligible."""
        forces = np.array([each.Get() if isinstance(each, ngs.Parameter) else each for each in self._forces], float)
        force = float(np.interp(t, self._times, forces))
        return force if force > NOTHING * forces.max() else 0.0

    def gradient(self, t: float, parameter: object) -> float:
        """Derivative of the prescribed force with respect to a parameter of it.

        Parameters
        ----------
        t : float
            Time (s).
        parameter : ngsolve.Parameter
            A parameter among the forces.

        Returns
        -------
        float
        """
        return (
            float(np.interp(t, self._times, [float(each is parameter) for each in self._forces]))
            if self.prescribed_force(t)
            else 0.0
        )

    def set(self, t: float) -> None:
        """Prescribe the force of time t; without a force the rigid body is held clear of the tissue."""
        self.force = self.prescribed_force(t)
        self.fixed_travel = None if self.force else self.away

    def travel(self, start: float, end: float) -> float:
        """Change of the force between two times.

        Parameters
        ----------
        start, end : float
            Times (s).

        Returns
        -------
        float
            In newtons.
        """
        return self.prescribed_force(end) - self.prescribed_force(start)


class ForceControlledTool(Term):
    """Force-controlled rigid bodies of a problem in the current time step; their travel is the problem's last unknown.

    Parameters
    ----------
    prescribed : PrescribedForce
    layout : Layout
    gfu : GridFunction
        Current unknowns.
    contacts : sequence
        Contacts of the problem; those with the travel of `prescribed` are force-controlled.
    friction : FrictionTerm
        Friction of the problem.
    kinematics : SolidKinematics
    min_gap : callable
        Distance (m) of the nearest rigid body from the tissue.
    """

    weight = SHARE / LENGTH_SCALE**2
    """Weight of a correction of the travel (1/m²)."""

    def __init__(
        self,
        prescribed: PrescribedForce,
        layout: Layout,
        gfu: ngs.GridFunction,
        contacts: Sequence[WallContact],
        friction: FrictionTerm,
        kinematics: SolidKinematics,
        min_gap: Callable[[], float],
    ) -> None:
        self.prescribed, self._gfu, self._min_gap, self.pace = prescribed, gfu, min_gap, np.zeros(2)
        at, self._vec = layout.fields(gfu.space.TrialFunction()), gfu.vec.CreateVector()
        self._reaction, self._stiffness = (ngs.BilinearForm(gfu.space, symmetric=True) for _ in range(2))
        for contact in contacts:
            if isinstance(contact, RigidContact) and contact.travel is prescribed.parameter:
                driving = kinematics.weight() * contact.driving_force(at.u, at.offset)
                self._reaction += ngs.Variation(driving.Compile() * contact.measure())
                self._stiffness += ngs.Variation(driving.Diff(prescribed.parameter).Compile() * contact.measure())
        friction.join_driving_force(self._reaction, self._stiffness, prescribed.parameter)

    @property
    def travel(self) -> float:
        """Travel (m) of the bodies."""
        return float(self.prescribed.parameter.Get())

    @travel.setter
    def travel(self, travel: float) -> None:
        """Set the travel; that of held bodies is fixed."""
        self.prescribed.parameter.Set(travel if self.prescribed.fixed_travel is None else self.prescribed.fixed_travel)

    def hold_at(self, travel: float) -> None:
        """Hold bodies without force at a travel (m)."""
        if self.prescribed.fixed_travel is not None:
            self.prescribed.fixed_travel = travel

    def reaction_force(self) -> float:
        """Reaction force (N) of the tissue along the travel."""
        return float(self._reaction.Energy(self._gfu.vec))

    def force_residual(self) -> float:
        """Residual (N) of the force balance; 0 for held bodies."""
        return 0.0 if self.prescribed.fixed_travel is not None else self.reaction_force() - self.prescribed.force

    def bordered_solver(self, inner: Solve, free: Array) -> Solve:
        """Solver of the bordered tangent, from a solver of the body's own tangent.

        Border and tangent must belong to the same state: with stiff contact their contributions cancel to about a hundredth.

        Parameters
        ----------
        inner : callable
            Solver of the body's tangent.
        free : array (n,)
            1 for free unknowns, else 0.

        Returns
        -------
        callable
            Solver for the unknowns and the travel.
        """
        self._reaction.Apply(self._gfu.vec, self._vec)
        column = self._vec.FV().NumPy() * free
        follows = inner(column)
        stiffness = float(self._stiffness.Energy(self._gfu.vec)) - float(column @ follows)

        def solve(r: Array) -> Array:
            y = inner(r[:-1])
            if self.prescribed.fixed_travel is not None:
                return np.append(y, 0.0)
            if not stiffness > 0:
                raise Breakdown(f"the contact force does not increase with the travel ({stiffness:.1e} N/m)")
            travel = (r[-1] - column @ y) / stiffness
            return np.append(y - travel * follows, travel)

        return solve

    def reset(self) -> None:
        """Reset the speed to zero."""
        self.pace = np.zeros(2)

    def begin(self, dt: float) -> None:
        """Begin a time step of `dt` seconds."""
        self._started = np.array([self.travel, dt])

    def error(self, free: Array) -> float:
        """Curvature error of the step that ends now: mean distance of the travel from its chord, relative to the travel.

        The internal variables assume a linear path within a step; in creep the path is curved.
        """
        rate, dt = self._pace()
        before, last = self.pace
        if not last or self.prescribed.fixed_travel is not None:
            return 0.0
        return float(abs(dt**2 / 12 * (rate - before) / ((dt + last) / 2) / self.travel))

    def _pace(self) -> Array:
        """Mean speed (m/s) in the step that ends now, and its length (s)."""
        start, dt = self._started
        return np.array([(self.travel - start) / dt, dt])

    def finish(self) -> None:
        """End the step; held bodies return until they are just clear of the tissue."""
        self.pace = self._pace() if self.prescribed.fixed_travel is None else np.zeros(2)
        if self.prescribed.fixed_travel is not None:
            self.approach(CLOSE)
            self.prescribed.fixed_travel = self.travel

    def approach(self, gap: float) -> None:
        """Move the rigid bodies, which are clear of the tissue, towards it until a gap (m) is left."""
        for _ in range(APPROACHES):
            left = self._min_gap() - gap
            if left < NEARLY:
                break
            self.prescribed.parameter.Set(self.travel + left)  # a distance changes by at most the travel

    def establish_contact(
        self, start: Array, solve: Callable[[Array], tuple[Array, bool]], set_unknowns: Callable[[Array], None]
    ) -> Array:
        """Initial guess with the rigid bodies brought into contact: only there does the force depend on the travel.

        Tissue that other loads move may recede meanwhile.

        Parameters
        ----------
        start : array (n + 1,)
            Unknowns to start from.
        solve : callable
            From unknowns to the equilibrium at fixed travel, and whether it converged.
        set_unknowns : callable
            Sets the unknowns of the problem.

        Returns
        -------
        array (n + 1,)
            `start` where no contact was found.
        """
        prescribed, away, guess = self.prescribed, False, start
        set_unknowns(start)
        for _ in range(LANDINGS):
            prescribed.fixed_travel = self.travel + max(self._min_gap(), 0.0) + prescribed.nudge
            guess, found = solve(np.append(guess[:-1], prescribed.fixed_travel))
            if not found and not away:  # first the equilibrium under the other loads alone
                prescribed.fixed_travel, away = prescribed.away, True
                guess, found = solve(np.append(start[:-1], prescribed.fixed_travel))
            set_unknowns(guess)
            if not found or self._min_gap() < 0:
                break
        prescribed.fixed_travel = None
        return guess if found else start

    @property
    def internal(self) -> Mapping[str, Any]:
        """Speed of the travel in the last step, and its length."""
        return {"way_pace": self.pace}

    @internal.setter
    def internal(self, saved: Mapping[str, Any]) -> None:
        self.pace = saved["way_pace"]
