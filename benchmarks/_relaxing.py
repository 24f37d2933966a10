"""Problem tissue pressed by a plate: our stepping, and what one would write in plain NGSolve."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import ngsolve as ngs
import numpy as np
from ngsolve.solvers import Newton as NgsolveNewton

from ngbrain.adjoint import TimeCurve
from ngbrain.errors import SolverError
from ngbrain.forward import Control, Material, Problem, RigidContact, StepControl, TimeStepper
from ngbrain.materials import Branch, Deformation, NeoHooke, Ogden, Viscous, step_factors
from ngbrain.mesh import block
from ngbrain.solvers import Newton
from ngbrain.surgery import Drive, ToolMotion
from ngbrain.tensors import isochoric

SIZE, BULK, PENALTY = (0.02, 0.02, 0.02), 1.5e6, 3e8
LAW = Viscous(Ogden(300.0, -12.0), (Branch(Ogden(700.0, -15.0), 2.3), Branch(NeoHooke(500.0), 500.0)))
Grid = tuple[int, float]
"""Order and size of the elements (m)."""
Rule = Callable[[float, float], tuple[float, float]]
"""Step and relaxation time (s) → e and β of H ← e H + β ΔS̄."""


@dataclass(frozen=True)
class Pressed:
    """A run: times (s), forces (N) and the number of unknowns."""

    t: np.ndarray
    force: np.ndarray
    ndof: int

    def dose(self, protocol: ToolMotion) -> float:
        """∫ force dt (N s) of a monotone cubic between events, which steps end on: holds are followed in few steps."""
        return float(TimeCurve(self.t, self.force, protocol.times).integral())


def contact(
    level: ngs.CoefficientFunction, penalty: float = PENALTY, share: float = 0.0, softness: float = 2e-5
) -> RigidContact:
    """The plate: a half space above the block, `level` below the unloaded top."""
    return RigidContact("top", lambda x: SIZE[2] - level - x[2], penalty, softness, share)


def ours(
    control: Control,
    protocol: ToolMotion,
    grid: Grid,
    keep: float = 0.7,
    plate: Callable[[ngs.CoefficientFunction], RigidContact] = contact,
) -> Pressed:
    """Our stepping; `keep` 0 renews the factorisation every iteration."""
    order, maxh = grid
    drive = Drive(protocol)
    body = Problem(
        block(SIZE, maxh),
        {"tissue": Material(LAW, BULK)},
        {"bottom": 0},
        contacts=[plate(drive.parameter)],
        element=f"P{order}/P{order - 1}",
    )
    up = ngs.GridFunction(body.fes.components[0])
    up.Set(ngs.CF((0, 0, 1)))
    newton = Newton(max_contraction=keep, spare_iterations=round(9 * keep), max_factorisations=60)
    transient = TimeStepper(body, drive, control, 1e-3, newton)
    rows = [(0.0, 0.0)]

    def watch(b: Problem, at: object, record: object) -> None:
        rows.append((transient.progress.t, float(up.vec.FV().NumPy() @ b.contact_forces())))

    transient.run(watch)
    return Pressed(*np.array(rows).T, body.fes.ndof)


def chosen(dt: float) -> StepControl:
    """Steps of dt at most while the plate moves, and of 8 dt at most while it rests."""
    return StepControl(dt, dt_max=8 * dt)


def even(dt: float) -> StepControl:
    """All of dt."""
    return StepControl(dt, first=1.0, restart=1.0, growth=1.0, dt_max=dt)


def exponential(dt: float, tau: float) -> tuple[float, float]:
    """The exact solution for S̄ linear in time."""
    e, beta = step_factors(dt, np.array([tau]))
    return float(e[0]), float(beta[0])


def backward_euler(dt: float, tau: float) -> tuple[float, float]:
    """dH/dt = dS̄/dt - H/τ at the end of the step."""
    return 1 / (1 + dt / tau), 1 / (1 + dt / tau)


def crank_nicolson(dt: float, tau: float) -> tuple[float, float]:
    """dH/dt = dS̄/dt - H/τ in the mean of both ends."""
    half = dt / tau / 2
    return (1 - half) / (1 + half), 1 / (1 + half)


def plain(rule: Rule, times: np.ndarray, protocol: ToolMotion, grid: Grid) -> Pressed:
    """The peer: plain NGSolve, no line search, no cut-back, a new factorisation every iteration; order 1 is without a pressure."""
    order, maxh = grid
    mesh = block(SIZE, maxh)
    displacements = ngs.VectorH1(mesh, order=order, dirichlet="bottom")
    fes = displacements * ngs.H1(mesh, order=order - 1) if order > 1 else displacements
    gfu, level = ngs.GridFunction(fes), ngs.Parameter(0.0)
    u, p = fes.TrialFunction() if order > 1 else (fes.TrialFunction(), None)
    tensors = ngs.MatrixValued(ngs.L2(mesh, order=order), 3)
    pulls, over, old = ([ngs.GridFunction(tensors) for _ in LAW.branches] for _ in range(3))
    shares = [ngs.Parameter(1.0) for _ in LAW.branches]
    F = ngs.Id(3) + ngs.Grad(u)
    C = isochoric(F.trans * F)
    energy = LAW.density(Deformation.from_stretch(C), shares)
    energy += BULK / 2 * (ngs.Det(F) - 1) ** 2 if p is None else p * (ngs.Det(F) - 1) - p * p / (2 * BULK)
    energy += sum(0.5 * ngs.InnerProduct(pull, C) for pull in pulls)
    form = ngs.BilinearForm(fes)
    form += ngs.Variation(energy.Compile() * ngs.dx)
    plate = contact(level)
    form += ngs.Variation(plate.energy(u).Compile() * plate.measure())
    state = gfu.components[0] if order > 1 else gfu
    F = ngs.Id(3) + ngs.Grad(state)
    stresses = [branch.stress(isochoric(F.trans * F)).Compile() for branch in LAW.hereditary_branches]
    forces = [0.0]
    for before, now in pairwise(times):
        level.Set(protocol.value(now))
        factors = [rule(now - before, branch.tau) for branch in LAW.hereditary_branches]
        for (e, beta), share, pull, h, s in zip(factors, shares, pulls, over, old, strict=True):
            share.Set(beta)
            pull.vec.data = e * h.vec - beta * s.vec
        failed, _ = NgsolveNewton(form, gfu, freedofs=fes.FreeDofs(), maxit=30, maxerr=1e-9, printing=False)
        if failed or not np.all(np.isfinite(gfu.vec.FV().NumPy())):
            raise SolverError(f"no convergence at t = {now:g} s")
        for (e, beta), h, s, stress in zip(factors, over, old, stresses, strict=True):
            new = ngs.GridFunction(tensors)
            new.Set(stress)
            h.vec.data = e * h.vec + beta * new.vec - beta * s.vec
            s.vec.data = new.vec
        forces.append(ngs.Integrate(plate.pressure(state) * plate.measure(), mesh))
    return Pressed(np.asarray(times), np.array(forces), fes.ndof)


def evenly(dt: float, protocol: ToolMotion) -> np.ndarray:
    """Times (s) of even steps, and events."""
    return np.union1d(dt * np.arange(round(protocol.times[-1] / dt) + 1), protocol.times)
