"""Load stepping to equilibrium: boundary conditions and loads grow with a factor from 0 to 1."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ngbrain.errors import CollapseWarning, InputError, SolverError, StabilityWarning, solver_error
from ngbrain.forward.common.element_choice import COMPRESSIBLE
from ngbrain.forward.common.rigid_motions import check_held
from ngbrain.forward.common.state import State
from ngbrain.forward.contact.motion import Motion
from ngbrain.forward.solid.advance import LoadHistory, LoadProgram, advance, newton_for
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.statics import stability
from ngbrain.solvers import continuation, linear
from ngbrain.solvers.newton import Newton
from ngbrain.solvers.record import NewtonRecord, PathRecord
from ngbrain.threads import threads as using

GUARD = 0.05
"""Barrier against collapse at single points, in shear moduli, that is added where a solve without it fails."""


class LoadPath:
    """Load path from rest to load factor 1, in as few steps as possible; a barrier is added if single points collapse.

    Parameters
    ----------
    problem : Problem
        A problem of elastic tissue without inertia.
    motion : Motion, optional
        Motion of the rigid bodies in its contacts, with the load factor as time; without it they are at rest.

    Raises
    ------
    InputError
        For viscoelastic tissue, which needs a `TimeStepper`.

    Examples
    --------
    >>> from ngbrain.forward.common.material import Material
    >>> from ngbrain.materials import NeoHooke
    >>> from ngbrain.mesh import block
    >>> tissue = {".*": Material(NeoHooke(1e3), 1e5)}
    >>> body = Problem(block((0.1, 0.1, 0.1), 0.1), tissue, {"bottom": 0, "top": (0, 0, -0.01)}, element="P2/P1")
    >>> LoadPath(body).solve().factor
    1.0
    """

    def __init__(self, problem: Problem, motion: Motion | None = None) -> None:
        if any(material.viscous.branches for material in problem.materials.values()):
            raise InputError(
                "materials", "a viscoelastic law", "elastic ones, such as its `equilibrium`, or a TimeStepper"
            )
        if problem.inertia is not None:
            raise InputError("loads", "with Inertia", "none for equilibrium, or a TimeStepper")
        self.problem, self.program = problem, LoadProgram(problem, motion, LoadHistory((0.0, 1.0), (0.0, 1.0)))
        self.residual, self.factorise, self.min_det = problem.residual, problem.factorise, problem.min_det

    def solve(
        self,
        steps: int = 1,
        newton: Newton | None = None,
        callback: Callable[[float], None] | None = None,
        threads: int | None = None,
        start: np.ndarray | None = None,
        eigenvalues: bool = False,
    ) -> PathRecord:
        """Equilibrium at load factor 1 from rest, in `steps` load steps, and more where one fails.

        Parameters
        ----------
        steps : int
            Load steps to try first.
        newton : Newton, optional
            Settings; `newton_for` gives those that the element needs.
        callback : callable, optional
            Called with the load factor after every step.
        threads : int, optional
            Number of threads for this solve; None leaves NGSolve's setting unchanged.
        start : array (ndof,), optional
            Initial guess for the state at load factor 1, such as that of a coarser mesh; if it fails, the path starts from
            rest.
        eigenvalues : bool
            Whether the tangent's smallest eigenvalue is computed after every load step (`PathRecord.eigenvalues`): a change of
            sign is a bifurcation, such as buckling, beyond which the computed branch is unstable. One direct factorisation
            each.

        Returns
        -------
        PathRecord
            Record of the solve; the problem is left at the last equilibrium reached.

        Raises
        ------
        InputError
            For a body with a free rigid motion.
        InvertedElementError, ConvergenceError
            When load steps become too short; the exception has the `result`.
        """
        body = self.problem
        if not body.contacts:
            check_held(body.supports, body.loads, body.kinematics)
        newton = newton or newton_for(body)
        if start is not None:
            body.reset()
        signs: list[tuple[float, float]] = []

        def reached(t: float, x: np.ndarray) -> None:
            if eigenvalues:
                body.x = x
                signs.append((t, stability.smallest_eigenvalue(body)[0]))
                body.invalidate_tangent()
            if callback:
                callback(t)

        with using(threads):
            near = None if start is None else continuation.resume(self, newton, start, steps, reached)
            x, record = near or self.follow(replace(newton), steps, reached)
            if not record.converged and record.min_det_F < continuation.COLLAPSED and body.ratio > COMPRESSIBLE:
                x, record = self._guarded(newton, steps, reached, record)
        body.x = x
        record.eigenvalues = signs
        record.seconds, record.ndof = dict(body.clock.seconds), body.fes.ndof
        record.element, record.solver = body.choice["element"], f"{body.solver}: {body.choice['solver']}"
        if not record.converged:
            raise self._error(record)
        if record.min_det_F < continuation.COLLAPSED and body.ratio > COMPRESSIBLE:
            found = f"det F is {record.min_det_F:.2g} at a point though K/μ is {body.ratio:.3g}"
            said = f"{found}: the mesh is too coarse there, or the body folds"
            record.warnings.append(said)
            warnings.warn(said, CollapseWarning, stacklevel=2)
        with using(threads):
            self._check_stability(record)
        return record

    def _check_stability(self, record: PathRecord) -> None:
        """Check the stability of a strongly compressed body; warns if it is unstable, or if its free surface creases."""
        body = self.problem
        record.pressed, record.creased = stability.compressed_fraction(body), stability.creased_surface_fraction(body)
        if max(record.pressed, record.creased) <= stability.SHARE:
            return
        said = f"stability was not checked, as {body.solver} cannot"
        if body.solver in linear.DIRECT:
            record.smallest_eigenvalue = stability.smallest_eigenvalue(body)[0]
            sign = "positive: stable" if record.smallest_eigenvalue > 0 else "negative: not stable"
            said = f"the tangent's smallest eigenvalue is {record.smallest_eigenvalue:.3g} Pa/m², {sign}"
        if record.smallest_eigenvalue < 0 or record.creased > stability.SHARE:
            by = f"compressed by more than {1 - stability.CREASE:.0%}"
            found = f"{record.pressed:.0%} of the body and {record.creased:.0%} of its free surface are {by}; {said}"
            doubt = "at such compression surfaces crease, and the position and depth of creases depend on the mesh"
            record.warnings.append(f"{found}; {doubt}")
            warnings.warn(record.warnings[-1], StabilityWarning, stacklevel=3)

    # Interface of a path for `continuation`.

    @property
    def weights(self) -> np.ndarray:
        """Weights of the problem."""
        return self.problem.weights

    def load(self, x: np.ndarray, t: float) -> np.ndarray:
        """Unknowns with what is prescribed at a load factor; moves rigid bodies.

        Parameters
        ----------
        x : array (n,)
            Unknowns.
        t : float
            Load factor.

        Returns
        -------
        array (n,)
        """
        return self.program.prescribe(x, t)

    def step(
        self, newton: Newton, x: np.ndarray, t: float, goal: float, guess: np.ndarray
    ) -> tuple[np.ndarray, NewtonRecord]:
        """Load step from one equilibrium to another.

        Parameters
        ----------
        newton : Newton
        x : array (n,)
            Equilibrium at `t`.
        t, goal : float
            Load factors.
        guess : array (n,)
            Initial guess at `goal`.

        Returns
        -------
        x : array (n,)
        record : NewtonRecord
        """
        start = State(t, x, self.problem.state(t).internal)
        made = advance(self.problem, start, goal - t, self.program, lambda: newton.solve(self.problem, guess))
        return made.state.x, made.record

    def follow(
        self, newton: Newton, steps: int = 1, callback: Callable[[float, np.ndarray], None] | None = None
    ) -> tuple[np.ndarray, PathRecord]:
        """Follow the path from rest towards load factor 1; does not raise.

        Parameters
        ----------
        newton : Newton
            Settings; keeps the last factorisation.
        steps : int
            Load steps to try first.
        callback : callable, optional
            Called with load factor and unknowns after every step.

        Returns
        -------
        x : array (n,)
        record : PathRecord
        """
        self.problem.reset()
        newton.inverse, newton.largest = None, 0.0
        return continuation.follow(self, newton, np.zeros(len(self.problem.weights)), steps, callback)

    def _guarded(
        self, newton: Newton, steps: int, callback: Callable[[float, np.ndarray], None], before: PathRecord
    ) -> tuple[np.ndarray, PathRecord]:
        """`follow` with an added `barrier` against collapse at single points; the barrier is kept."""
        body = self.problem
        kappa = GUARD * body.modulus
        body.with_materials({p: replace(m, pointwise=m.pointwise or kappa) for p, m in body.materials.items()})
        x, record = self.follow(replace(newton), steps, callback)
        record.guard = f"a barrier of {kappa:.3g} Pa against collapse: without it det F fell to {before.min_det_F:.2g}"
        record.cuts, record.tried = record.cuts + before.cuts, record.tried + before.tried
        record.work += before.work
        if record.converged:
            record.warnings.append(f"{body.element} on this mesh needed {record.guard}")
            warnings.warn(record.warnings[-1], CollapseWarning, stacklevel=3)
        return x, record

    def _error(self, record: PathRecord) -> SolverError:
        advice = f"try a finer or graded mesh, another element than {self.problem.element}, or a smaller load"
        return solver_error(f"{record.reason}; {advice}", record.status, record)
