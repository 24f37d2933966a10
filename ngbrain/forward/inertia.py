"""Inertia: how the generalised-α method steps, and what it adds to the energy of a step, as a load."""

from __future__ import annotations

from dataclasses import dataclass

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.loads import Place, Terms
from ngbrain.materials.base import Value

Array = np.ndarray


@dataclass(frozen=True)
class Pace:
    """How unknowns u move after a step of length `dt` (s).

    velocity      v
    acceleration  ü, that of the forces there
    average       a, what the scheme goes on from: ü near t + (α_m - α_f) dt
    """

    velocity: np.ndarray
    acceleration: np.ndarray
    average: np.ndarray
    dt: float


@dataclass(frozen=True)
class GeneralizedAlpha:
    """Steps of M ü + F(u) = 0 that are implicit, of second order, and damp what they do not resolve.

    radius   ρ_∞ in [0, 1]: factor a step on motions much faster than it. 1 keeps them (and, where all is linear, the energy:
             the trapezoidal rule), 0 ends them at once; what a step resolves is hardly damped by any of them

        (1 - α_m) a' + α_m a = (1 - α_f) ü' + α_f ü ,   M ü' = -F(u') ,
        u' = u + Δt v + Δt² ((½ - β) a + β a') ,         v' = v + Δt ((1 - γ) a + γ a')

    with a prime at the end of the step, α_m = (2ρ_∞ - 1)/(ρ_∞ + 1), α_f = ρ_∞/(ρ_∞ + 1), γ = ½ - α_m + α_f, β = (½ + γ)²/4. Forces
    are averaged, not the states they belong to, so F(u') + c M (u' - û) = 0: an energy of F keeps being one. Before a step of
    another length than the last, a goes to ü + (a - ü) Δt/Δt_last, so that the order stays. Raises `InputError` for another radius.

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

    def begin(self, u: np.ndarray, pace: Pace, dt: float) -> Step:
        """A step of `dt` seconds from u."""
        if pace.dt:
            average = pace.acceleration + (pace.average - pace.acceleration) * (dt / pace.dt)
            pace = Pace(pace.velocity, pace.acceleration, average, dt)
        return Step(self, u, pace, dt)


@dataclass(frozen=True)
class Step:
    """A step from u; it ends where F(u') + c M (u' - û) = 0."""

    scheme: GeneralizedAlpha
    u: np.ndarray
    pace: Pace
    dt: float

    @property
    def target(self) -> np.ndarray:
        """û, where u goes if nothing pulls at the end of the step."""
        s, pace = self.scheme, self.pace
        late = (s.alpha_m * pace.average - s.alpha_f * pace.acceleration) / (1 - s.alpha_m)
        return self._drift() - s.beta * self.dt**2 * late

    def end(self, u: np.ndarray) -> Pace:
        """The pace at its end u."""
        s, average = self.scheme, self._average(u)
        velocity = self.pace.velocity + self.dt * ((1 - s.gamma) * self.pace.average + s.gamma * average)
        return Pace(velocity, s.weight(self.dt) * (u - self.target), average, self.dt)

    def error(self, u: np.ndarray) -> np.ndarray:
        """Δt² (β + (α_m - α_f)/2 - 1/6) (a' - a), by how much the step misses where exact accelerations lead, but for Δt⁴.

        Source, for Newmark's method, where α_m = α_f: Zienkiewicz and Xie 1991, 10.1002/eqe.4290200907.
        """
        s = self.scheme
        return self.dt**2 * (s.beta + (s.alpha_m - s.alpha_f) / 2 - 1 / 6) * (self._average(u) - self.pace.average)

    def _drift(self) -> np.ndarray:
        return self.u + self.dt * self.pace.velocity + self.dt**2 * (0.5 - self.scheme.beta) * self.pace.average

    def _average(self, u: np.ndarray) -> np.ndarray:
        return (u - self._drift()) / (self.scheme.beta * self.dt**2)


class Inertia:
    """The mass of a `Relaxing` body, at rest before its first step: c/2 ∫ ρ |u - û|² dV in each (`GeneralizedAlpha`).

    density   kg/m³, a number or a CoefficientFunction
    scheme    how a step goes; by default motions that are much faster than a step end at once, as a boundary that sets off at a
              speed lets nodes ring with any other

    One for each body. Forces on a boundary that is moved include what it takes to speed up its nodes.

    >>> from ngbrain.forward.material import Material
    >>> from ngbrain.forward.relaxing import Relaxing
    >>> from ngbrain.materials import NeoHooke
    >>> from ngbrain.mesh import block
    >>> cube, tissue = block((0.1, 0.1, 0.1), 0.1), {".*": Material(NeoHooke(1e3), 1e5)}
    >>> body = Relaxing(cube, tissue, {"bottom": (1e-4, 0, 0)}, [Inertia(1000.0)], form="P2")
    >>> pull = body.run([0, 0.01, 0.02], [0, 1, 1], lambda t: body.force("bottom")[0])
    >>> bool(pull[0] > 0)  # which without mass takes no force
    True
    """

    def __init__(self, density: Value, scheme: GeneralizedAlpha | None = None) -> None:
        self.density, self.scheme = density, scheme or GeneralizedAlpha(0.0)
        self._weight = ngs.Parameter(0.0)
        self._target: ngs.GridFunction | None = None
        self._pace: Pace | None = None

    def energy(self, at: Place) -> Terms:
        """What a step adds (J)."""
        if self._target is None:
            self._target = ngs.GridFunction(ngs.VectorH1(at.mesh, order=at.order))
        way = at.u - self._target
        density = self._weight / 2 * self.density * ngs.InnerProduct(way, way)
        return at.kinematics.weight() * density * at.inside(".*")

    def begin(self, u: Array, dt: float) -> None:
        """A step of `dt` seconds from displacements u (m)."""
        still = np.zeros_like(u)
        self._step = self.scheme.begin(u, self._pace or Pace(still, still, still, 0.0), dt)
        self._weight.Set(self.scheme.weight(dt))
        assert self._target is not None
        self._target.vec.FV().NumPy()[:] = self._step.target

    def finish(self, u: Array) -> None:
        """It ended at displacements u (m)."""
        self._pace = self._step.end(u)
