"""Inertia: generalised-α time integration, and its contribution to the energy of a step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.forward.common.kinematics import SolidKinematics
from ngbrain.forward.common.regions import check_regions
from ngbrain.forward.common.state import Term
from ngbrain.forward.common.unknowns import Layout
from ngbrain.look import BriefText
from ngbrain.materials.base import Value, check_positive

Array = np.ndarray


@dataclass(frozen=True, repr=False)
class MotionRates(BriefText):
    """Velocity and accelerations after a step.

    Parameters
    ----------
    velocity : array (n,)
        v (m/s).
    acceleration : array (n,)
        ü (m/s²), from the forces there.
    average : array (n,)
        a (m/s²), the scheme's averaged acceleration: ü near t + (α_m - α_f) dt.
    dt : float
        Length of the step (s).
    """

    velocity: np.ndarray
    acceleration: np.ndarray
    average: np.ndarray
    dt: float


@dataclass(frozen=True)
class GeneralizedAlpha:
    """Implicit second-order time integration of M ü + F(u) = 0 with damping of unresolved motions.

    radius   ρ_∞ in [0, 1]: factor per step on motions much faster than the step. 1 keeps them (and, in linear problems, the
             energy: the trapezoidal rule), 0 damps them within one step; resolved motions are hardly damped by any of them

        (1 - α_m) a' + α_m a = (1 - α_f) ü' + α_f ü ,   M ü' = -F(u') ,
        u' = u + Δt v + Δt² ((½ - β) a + β a') ,         v' = v + Δt ((1 - γ) a + γ a')

    with a prime at the end of the step, α_m = (2ρ_∞ - 1)/(ρ_∞ + 1), α_f = ρ_∞/(ρ_∞ + 1), γ = ½ - α_m + α_f, β = (½ + γ)²/4. Forces
    are averaged, not states, so that F(u') + c M (u' - û) = 0 is the gradient of an energy if F is. Before a step of another
    length than the last, a becomes ü + (a - ü) Δt/Δt_last, which keeps the order. Raises `InputError` for another radius.

    Sources: Chung and Hulbert 1993, 10.1115/1.2900803; with ü kept beside a, for constrained systems, Arnold and Brüls 2007,
    10.1007/s11044-007-9084-0.

    >>> scheme = GeneralizedAlpha(1.0)
    >>> scheme.alpha_m, scheme.alpha_f, scheme.beta, scheme.gamma
    (0.5, 0.5, 0.25, 0.5)
    """

    radius: float

    def __post_init__(self) -> None:
        if not (isinstance(self.radius, (int, float)) and 0 <= self.radius <= 1):
            raise InputError("GeneralizedAlpha.radius", self.radius, "a spectral radius in [0, 1]")

    @property
    def alpha_m(self) -> float:
        """Weight of the old acceleration."""
        return (2 * self.radius - 1) / (self.radius + 1)

    @property
    def alpha_f(self) -> float:
        """Weight of the old forces."""
        return self.radius / (self.radius + 1)

    @property
    def gamma(self) -> float:
        """Newmark's γ."""
        return 0.5 - self.alpha_m + self.alpha_f

    @property
    def beta(self) -> float:
        """Newmark's β."""
        return (0.5 + self.gamma) ** 2 / 4

    def weight(self, dt: float) -> float:
        """c (1/s²)."""
        return (1 - self.alpha_m) / ((1 - self.alpha_f) * self.beta * dt**2)

    def begin(self, u: np.ndarray, pace: MotionRates, dt: float) -> GeneralizedAlphaStep:
        """Begin a time step.

        Parameters
        ----------
        u : array (n,)
            Displacement (m) at its start.
        pace : MotionRates
            Velocity and accelerations there.
        dt : float
            Length (s).

        Returns
        -------
        GeneralizedAlphaStep
        """
        if pace.dt:
            average = pace.acceleration + (pace.average - pace.acceleration) * (dt / pace.dt)
            pace = MotionRates(pace.velocity, pace.acceleration, average, dt)
        return GeneralizedAlphaStep(self, u, pace, dt)


@dataclass(frozen=True, repr=False)
class GeneralizedAlphaStep(BriefText):
    """A time step from u; it ends where F(u') + c M (u' - û) = 0.

    Parameters
    ----------
    scheme : GeneralizedAlpha
    u : array (n,)
        Displacement (m) at the start.
    pace : MotionRates
        Velocity and accelerations at the start.
    dt : float
        Length (s).
    """

    scheme: GeneralizedAlpha
    u: np.ndarray
    pace: MotionRates
    dt: float

    @property
    def target(self) -> np.ndarray:
        """û, the displacement at the end of the step without forces there."""
        s, pace = self.scheme, self.pace
        late = (s.alpha_m * pace.average - s.alpha_f * pace.acceleration) / (1 - s.alpha_m)
        return self._drift() - s.beta * self.dt**2 * late

    def end(self, u: np.ndarray) -> MotionRates:
        """Velocity and accelerations at the end displacement u."""
        s, average = self.scheme, self._average(u)
        velocity = self.pace.velocity + self.dt * ((1 - s.gamma) * self.pace.average + s.gamma * average)
        return MotionRates(velocity, s.weight(self.dt) * (u - self.target), average, self.dt)

    def error(self, u: np.ndarray) -> np.ndarray:
        """Δt² (β + (α_m - α_f)/2 - 1/6) (a' - a), the local error of the displacement, up to Δt⁴.

        Source, for Newmark's method, where α_m = α_f: Zienkiewicz and Xie 1991, 10.1002/eqe.4290200907.
        """
        s = self.scheme
        return self.dt**2 * (s.beta + (s.alpha_m - s.alpha_f) / 2 - 1 / 6) * (self._average(u) - self.pace.average)

    def _drift(self) -> np.ndarray:
        return self.u + self.dt * self.pace.velocity + self.dt**2 * (0.5 - self.scheme.beta) * self.pace.average

    def _average(self, u: np.ndarray) -> np.ndarray:
        return (u - self._drift()) / (self.scheme.beta * self.dt**2)


@dataclass(frozen=True)
class Inertia:
    """Mass of a body for a `TimeStepper`: adds c/2 ∫ ρ |u - û|² dV to the energy of each step (`GeneralizedAlpha`).

    At most one for each body, which starts at rest unless `Problem.start` sets a velocity. Pressures enforce the volume at the
    end of a step. Resolved oscillations decay by the tissue's damping alone, and keep steps short; steps grow soonest with
    ρ_∞ = 0. At large strains no ρ_∞ bounds the energy; it grows earliest with ρ_∞ = 1. Forces on a moving boundary include the
    inertia of its nodes.

    Parameters
    ----------
    density : float, CoefficientFunction or dict
        ρ (kg/m³) at rest, or region pattern → density.
    scheme : GeneralizedAlpha
        Time integration. By default ρ_∞ = 0: with any other, a boundary that starts with a velocity makes nodes oscillate.
    amplitude : float
        Displacement (m) relative to which `ErrorControl` judges the error from inertia.

    Examples
    --------
    >>> import ngsolve as ngs
    >>> from ngbrain.forward.common.material import Material
    >>> from ngbrain.forward.solid.problem import Problem
    >>> from ngbrain.materials import NeoHooke
    >>> from ngbrain.mesh import block
    >>> cube, tissue = block((0.1, 0.1, 0.1), 0.1), {".*": Material(NeoHooke(1e3), 1e6)}
    >>> body = Problem(cube, tissue, {"bottom": 0}, [Inertia(1000.0, GeneralizedAlpha(0.8))], element="P2/P1")
    >>> body.start((0.01 * ngs.z, 0, 0))
    >>> body.kinetic_energy()
    1.6666...e-07
    """

    density: Value | Mapping[str, Value]
    scheme: GeneralizedAlpha = GeneralizedAlpha(0.0)
    amplitude: float = 1e-3

    def __post_init__(self) -> None:
        check_positive(self.amplitude, "amplitude")


class InertiaTerm(Term):
    """Inertia term of a problem in the current time step.

    Parameters
    ----------
    layout : Layout
    gfu : GridFunction
        Current unknowns.
    masses : sequence of Inertia
        Exactly one.
    kinematics : SolidKinematics
    order : int
        Order of the displacements.

    Raises
    ------
    InputError
        For several masses, and a density that is not positive.
    """

    instant = 1e-9
    """Time (s) much shorter than any relaxation time."""

    def __init__(
        self, layout: Layout, gfu: ngs.GridFunction, masses: Sequence[Inertia], kinematics: SolidKinematics, order: int
    ) -> None:
        if len(masses) > 1:
            raise InputError("loads", f"with {len(masses)} Inertia", "one for each body")
        mass, mesh, space = masses[0], gfu.space.mesh, layout.fields(gfu).u.space
        density = mass.density
        if isinstance(density, Mapping):
            check_regions(mesh, density, "density")
            density = mesh.MaterialCF(
                {name: check_positive(rho, f"density of {name}") for name, rho in density.items()}
            )
        self.scheme, self.amplitude, self._layout, self._gfu, self._n = (
            mass.scheme,
            mass.amplitude,
            layout,
            gfu,
            space.ndof,
        )
        shapes = (ngs.TRIG, ngs.QUAD, ngs.TET, ngs.HEX, ngs.PRISM, ngs.PYRAMID)
        self._measure = ngs.dx(intrules={shape: ngs.IntegrationRule(shape, 2 * order) for shape in shapes})
        self._density = kinematics.weight() * density
        self._weight, self._target, self._moved = ngs.Parameter(0.0), ngs.GridFunction(space), ngs.GridFunction(space)
        u, v = space.TnT()
        self._form = ngs.BilinearForm(self._density * ngs.InnerProduct(u, v) * self._measure, symmetric=True)
        self.dt, self.stretch = 0.0, 1.0
        self.update_density()
        self.reset()

    def update_density(self) -> None:
        """Update the mass matrix after a change of density."""
        self._mass = self._form.Assemble().mat

    def join(self, form: ngs.BilinearForm) -> None:
        """Add the energy of a step to a form of the problem."""
        way = self._layout.fields(form.space.TrialFunction()).u - self._target
        form += ngs.Variation(0.5 * self._weight * self._density * ngs.InnerProduct(way, way) * self._measure)

    def work(
        self, u: CoefficientFunction, motion: CoefficientFunction
    ) -> tuple[CoefficientFunction, ngs.comp.DifferentialSymbol]:
        """Virtual work of c M (u - û).

        Parameters
        ----------
        u, motion : CoefficientFunction
            Displacement (m) and virtual displacement.

        Returns
        -------
        density : CoefficientFunction
        measure : DifferentialSymbol
        """
        return self.mass_work(u - self._target, motion)

    def mass_work(
        self, way: CoefficientFunction, motion: CoefficientFunction
    ) -> tuple[CoefficientFunction, ngs.comp.DifferentialSymbol]:
        """Virtual work of c M times a displacement.

        Parameters
        ----------
        way, motion : CoefficientFunction
            Displacement (m) and virtual displacement.

        Returns
        -------
        density : CoefficientFunction
        measure : DifferentialSymbol
        """
        return self._weight * self._density * ngs.InnerProduct(way, motion), self._measure

    def start(self, velocity: Sequence[Value] | CoefficientFunction, forces: Array, free: Array) -> None:
        """Set the initial velocity, with the acceleration that nodal forces give.

        Parameters
        ----------
        velocity : vector
            In m/s.
        forces : array (n,)
            Nodal forces (N).
        free : array (n,)
            1 for free unknowns, else 0.
        """
        free, field, answer = free[: self._n], self._moved, self._moved.vec.CreateVector()
        field.Set(velocity if isinstance(velocity, CoefficientFunction) else ngs.CF(tuple(velocity)))
        v = field.vec.FV().NumPy() * free
        field.vec.FV().NumPy()[:] = forces
        answer.data = self._mass.Inverse(ngs.BitArray((free > 0).tolist()), inverse="sparsecholesky") * field.vec
        a = answer.FV().NumPy().copy()
        self.pace = MotionRates(v, a, a, 0.0)

    def energy(self) -> float:
        """∫ ρ/2 |v|² (J)."""
        v = self.pace.velocity
        return float(v @ self.times(v)) / 2

    def reset(self) -> None:
        """Reset velocity and accelerations to zero."""
        still = np.zeros(self._n)
        self.pace = MotionRates(still, still, still, 0.0)

    def begin(self, dt: float) -> None:
        """Begin a time step of `dt` seconds from the present state.

        `stretch` is its length over that of the last step, which scales the average acceleration; 1 for a first step.
        """
        self.dt, self.stretch = dt, dt / self.pace.dt if self.pace.dt else 1.0
        self._step = self.scheme.begin(self._displacement(), self.pace, dt)
        self._weight.Set(self.scheme.weight(dt))
        self._target.vec.FV().NumPy()[:] = self._step.target

    def forces(self) -> Array:
        """c M (u - û), one for each displacement unknown."""
        return self._weight.Get() * self.times(self._displacement() - self._target.vec.FV().NumPy())

    def finish(self) -> None:
        """End the step at the current state."""
        self.pace = self._step.end(self._displacement())

    def error(self, free: Array) -> float:
        """Largest error of a free displacement in the step that ends now, over `amplitude`."""
        error = self._step.error(self._displacement()) * free[: self._n]
        return float(np.max(np.abs(error))) / self.amplitude

    def _displacement(self) -> Array:
        return np.array(self._gfu.vec.FV().NumPy()[: self._n])

    def times(self, velocity: Array) -> Array:
        """M v."""
        self._moved.vec.FV().NumPy()[:] = velocity
        product = self._moved.vec.CreateVector()
        product.data = self._mass * self._moved.vec
        return np.array(product.FV().NumPy())

    @property
    def internal(self) -> Mapping[str, Any]:
        """Velocity and accelerations."""
        return {"pace": dict(self.pace.__dict__)}

    @internal.setter
    def internal(self, saved: Mapping[str, Any]) -> None:
        self.pace = MotionRates(**saved["pace"])

    @property
    def frozen(self) -> Mapping[str, Any]:
        """The weight of the mass in the step's energy."""
        return {"mass_weight": float(self._weight.Get())}

    @frozen.setter
    def frozen(self, saved: Mapping[str, Any]) -> None:
        self._weight.Set(saved["mass_weight"])
