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
"""A correction of the way is judged against (m)."""
SHARE = 0.01
"""Of a correction's size that the way has: as much as all displacements where a hundredth of the body follows."""
NOTHING = 1e-9
"""Share of the largest force below which a force counts as none."""
CLOSE = 1e-6
"""How near (m) a rigid body without force stays to the tissue,"""
NEARLY = 1e-8
"""and how well (m) it keeps that."""
APPROACHES = 100
"""Steps of its way there, at most; each is as long as the gap allows."""
LANDINGS = 5
"""Ways that a rigid body of given force is led to the tissue by; each as long as the gap that is left."""


class PrescribedForce:
    """Rigid bodies whose force is given over time: a `Motion`, and one of a `Problem`'s contacts beside those that it moves.

    Its `travel` is in newtons, and the rigid bodies are where the solution puts them. Several that share the way share the work,
    too: the force is the derivative of all their energies by it.

    Parameters
    ----------
    times, force : sequence
        s, and N (≥ 0), straight in between; forces are numbers or `ngs.Parameter`s.
    away : float
        Where (m, on the way) the rigid bodies touch nothing, whatever the tissue does.
    nudge : float
        How far (m) beyond a gap they go to feel the tissue.
    limit : float
        Way (m) beyond which a run ends, with a `ContactError`.

    Attributes
    ----------
    parameter : ngs.Parameter
        Their way (m), the `RigidContact.way` of the contacts that they are made of.
    force : float
        What they are to feel now (N).
    held : float or None
        Where they stand whatever the force; None while they press.

    Examples
    --------
    >>> from ngbrain.forward import RigidContact, Material, Problem, StepControl, TimeStepper
    >>> from ngbrain.materials import NeoHooke, Prony
    >>> from ngbrain.mesh import block
    >>> press = PrescribedForce((0.0, 4.0, 60.0), (0.0, 1e-3, 1e-3), away=-1e-3, nudge=1e-6)
    >>> plate = RigidContact("top", lambda x: 0.02 - press.parameter - x[2], 1e9, 1e-7, way=press.parameter)
    >>> tissue, cube = {"tissue": Material(Prony(NeoHooke(1000.0), g=[0.5], tau=[5.0]), 1e6)}, block((0.02, 0.02, 0.02), 0.02)
    >>> body = Problem(cube, tissue, {"bottom": 0}, contacts=[plate, press], element="P2/P1")
    >>> run, way = TimeStepper(body, press, StepControl(1.0), 1e-3), {}
    >>> run.run(lambda body, at, record: way.update({at.t: press.parameter.Get()}))
    >>> way[60.0] > 1.5 * way[4.0], f"{body.tool.reaction_force():.6f} N"
    (True, '0.001000 N')
    """

    def __init__(
        self, times: Sequence[float], force: Sequence[Force], away: float, nudge: float, limit: float = np.inf
    ) -> None:
        self._times, self._made = np.array(times, float), tuple(force)
        self.events = tuple(float(t) for t in times[1:])
        self.away, self.nudge, self.limit = away, nudge, limit
        self.parameter = ngs.Parameter(0.0)
        self.force = 0.0
        self.held: float | None = None

    def prescribed_force(self, t: float) -> float:
        """Prescribed force (N) at time t (s); 0 where it is negligible."""
        forces = np.array([each.Get() if isinstance(each, ngs.Parameter) else each for each in self._made], float)
        force = float(np.interp(t, self._times, forces))
        return force if force > NOTHING * forces.max() else 0.0

    def gradient(self, t: float, parameter: object) -> float:
        """Derivative of the prescribed force with respect to a parameter of it.

        Parameters
        ----------
        t : float
            Time (s).
        parameter : ngsolve.Parameter
            One of those that `force` is made of.

        Returns
        -------
        float
        """
        return (
            float(np.interp(t, self._times, [float(each is parameter) for each in self._made]))
            if self.prescribed_force(t)
            else 0.0
        )

    def set(self, t: float) -> None:
        """Prescribe the force of time t; without one the rigid body is held away from the tissue."""
        self.force = self.prescribed_force(t)
        self.held = None if self.force else self.away

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
    given : PrescribedForce
    layout : Layout
    gfu : GridFunction
        Current unknowns.
    contacts : sequence
        Contacts of the problem; those count whose `way` is that of `given`.
    friction : FrictionTerm
        Friction of the problem.
    kinematics : SolidKinematics
    min_gap : callable
        Distance (m) of the nearest rigid body from the tissue.
    """

    weight = SHARE / LENGTH_SCALE**2
    """By which a correction of the way is judged (1/m²)."""

    def __init__(
        self,
        given: PrescribedForce,
        layout: Layout,
        gfu: ngs.GridFunction,
        contacts: Sequence[WallContact],
        friction: FrictionTerm,
        kinematics: SolidKinematics,
        min_gap: Callable[[], float],
    ) -> None:
        self.given, self._gfu, self._min_gap, self.pace = given, gfu, min_gap, np.zeros(2)
        at, self._vec = layout.fields(gfu.space.TrialFunction()), gfu.vec.CreateVector()
        self._felt, self._stiffness = (ngs.BilinearForm(gfu.space, symmetric=True) for _ in range(2))
        for contact in contacts:
            if isinstance(contact, RigidContact) and contact.way is given.parameter:
                driving = kinematics.weight() * contact.driving(at.u, at.offset)
                self._felt += ngs.Variation(driving.Compile() * contact.measure())
                self._stiffness += ngs.Variation(driving.Diff(given.parameter).Compile() * contact.measure())
        friction.join_driving(self._felt, self._stiffness, given.parameter)

    @property
    def way(self) -> float:
        """How far (m) they have gone."""
        return float(self.given.parameter.Get())

    @way.setter
    def way(self, way: float) -> None:
        """Put them there; those that are held stay."""
        self.given.parameter.Set(way if self.given.held is None else self.given.held)

    def hold_at(self, way: float) -> None:
        """Hold bodies without force at a travel (m)."""
        if self.given.held is not None:
            self.given.held = way

    def reaction_force(self) -> float:
        """Reaction force (N) of the tissue along the travel."""
        return float(self._felt.Energy(self._gfu.vec))

    def force_residual(self) -> float:
        """Residual (N) of the force's equation; 0 where the bodies are held."""
        return 0.0 if self.given.held is not None else self.reaction_force() - self.given.force

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
        self._felt.Apply(self._gfu.vec, self._vec)
        column = self._vec.FV().NumPy() * free
        follows = inner(column)
        stiffness = float(self._stiffness.Energy(self._gfu.vec)) - float(column @ follows)

        def solve(r: Array) -> Array:
            y = inner(r[:-1])
            if self.given.held is not None:
                return np.append(y, 0.0)
            if not stiffness > 0:
                raise Breakdown(f"the force does not grow with the way ({stiffness:.1e} N/m)")
            way = (r[-1] - column @ y) / stiffness
            return np.append(y - way * follows, way)

        return solve

    def rest(self) -> None:
        """Without a speed of the way."""
        self.pace = np.zeros(2)

    def begin(self, dt: float) -> None:
        """Begin a time step of `dt` seconds."""
        self._started = np.array([self.way, dt])

    def error(self, free: Array) -> float:
        """By how much the way bends within the step that now ends: its mean distance from the chord, relative to the way.

        The history takes all paths for straight, and a step of creep is not.
        """
        rate, dt = self._pace()
        before, last = self.pace
        if not last or self.given.held is not None:
            return 0.0
        return float(abs(dt**2 / 12 * (rate - before) / ((dt + last) / 2) / self.way))

    def _pace(self) -> Array:
        """Mean speed (m/s) of the step that now ends, and its length (s)."""
        start, dt = self._started
        return np.array([(self.way - start) / dt, dt])

    def finish(self) -> None:
        """End the step begun; rigid bodies that are held away come back until they are just clear."""
        self.pace = self._pace() if self.given.held is None else np.zeros(2)
        if self.given.held is not None:
            self.approach(CLOSE)
            self.given.held = self.way

    def approach(self, gap: float) -> None:
        """Move the rigid bodies, which are clear of the tissue, towards it until a gap (m) is left."""
        for _ in range(APPROACHES):
            left = self._min_gap() - gap
            if left < NEARLY:
                break
            self.given.parameter.Set(self.way + left)  # a distance changes by no more than the way

    def establish_contact(
        self, start: Array, solve: Callable[[Array], tuple[Array, bool]], stand: Callable[[Array], None]
    ) -> Array:
        """Initial guess with the rigid bodies brought into contact: only there does the force depend on the travel.

        Tissue that other loads move may recede meanwhile.

        Parameters
        ----------
        start : array (n + 1,)
            Unknowns to start from.
        solve : callable
            From unknowns, equilibrium with the travel held, and whether it converged.
        stand : callable
            Puts the problem to some unknowns.

        Returns
        -------
        array (n + 1,)
            `start` where no contact was found.
        """
        given, away, guess = self.given, False, start
        stand(start)
        for _ in range(LANDINGS):
            given.held = self.way + max(self._min_gap(), 0.0) + given.nudge
            guess, found = solve(np.append(guess[:-1], given.held))
            if not found and not away:  # what other loads do is found without it first
                given.held, away = given.away, True
                guess, found = solve(np.append(start[:-1], given.held))
            stand(guess)
            if not found or self._min_gap() < 0:
                break
        given.held = None
        return guess if found else start

    @property
    def internal(self) -> Mapping[str, Any]:
        """Speed of the way in the last step."""
        return {"way_pace": self.pace}

    @internal.setter
    def internal(self, saved: Mapping[str, Any]) -> None:
        self.pace = saved["way_pace"]
