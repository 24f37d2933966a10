"""A body with mass: the generalised-α method as one more energy in each time step, a parabola around where inertia leads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.errors import InputError
from ngbrain.forward.body import LENGTH_SCALE, Body
from ngbrain.forward.contact import Touch
from ngbrain.forward.friction import Friction
from ngbrain.forward.material import Material
from ngbrain.forward.patterns import check_regions
from ngbrain.materials.base import Value, positive

INSTANT = 1e-9
"""Time (s) in which no tissue relaxes."""


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


class DynamicBody(Body):
    """A `Body` with mass: its energy in a time step is the quasi-static one + c/2 ∫ ρ |u - û|² (`GeneralizedAlpha`).

    density    region pattern → ρ (kg/m³) at rest, a number or a CoefficientFunction
    scheme     how a step goes
    amplitude  displacement (m) that a step's error from inertia is judged against, by `ErrorControl`

    and what a `Body` takes. It is at rest until `start` sets it moving; a `Transient` moves it. Pressures hold the volume at the
    end of a step. Swinging that steps resolve goes on as long as the tissue lets it, and keeps steps short: ρ_∞ = 0 lets them grow
    soonest. Far from small strains no ρ_∞ bounds the energy; 1 gains it first. Raises `InputError` for regions with two densities
    or none, and what `Body` raises.

    >>> from ngbrain.materials import NeoHooke
    >>> from ngbrain.mesh import block
    >>> cube = block((0.1, 0.1, 0.1), 0.1)
    >>> tissue = {".*": Material(NeoHooke(1e3), 1e6)}
    >>> body = DynamicBody(cube, tissue, "bottom", density={".*": 1000.0}, scheme=GeneralizedAlpha(0.8))
    >>> body.start((0.01 * ngs.z, 0, 0))
    >>> body.kinetic_energy()
    1.6666...e-07
    """

    def __init__(
        self,
        mesh: ngs.Mesh,
        materials: dict[str, Material],
        fixed: str,
        contacts: Sequence[Touch | Friction] = (),
        order: int = 2,
        modulus: float = 1e3,
        *,
        density: Mapping[str, Value],
        scheme: GeneralizedAlpha,
        amplitude: float = LENGTH_SCALE,
    ) -> None:
        super().__init__(mesh, materials, fixed, contacts, order, modulus)
        check_regions(mesh, density, "density")
        self.density = mesh.MaterialCF({name: positive(rho, f"density of {name}") for name, rho in density.items()})
        self.scheme, self.amplitude = scheme, positive(amplitude, "amplitude")
        space = self.fes.components[0]
        self._weight, self._target, self._moved = ngs.Parameter(0.0), ngs.GridFunction(space), ngs.GridFunction(space)
        self.form += self._inertia()
        self._n = space.ndof
        u, v = space.TnT()
        self._mass = ngs.BilinearForm(self.density * ngs.InnerProduct(u, v) * ngs.dx, symmetric=True).Assemble().mat
        still = np.zeros(self._n)
        self.pace = Pace(still, still, still, 0.0)

    def _inertia(self) -> ngs.comp.SumOfIntegrals:
        way = self.fes.TrialFunction()[0] - self._target
        return ngs.Variation(0.5 * self._weight * self.density * ngs.InnerProduct(way, way) * ngs.dx)

    def focus(self, elements: np.ndarray) -> None:
        """The same as a body's; c changes in all elements."""
        super().focus(elements)
        assert self._tangent.part is not None
        self._tangent.part += self._inertia()

    def start(self, velocity: Sequence[Value] | CoefficientFunction) -> None:
        """Set the present state moving at a velocity (m/s), with the acceleration that its forces give it.

        Pressures have to be there already if the state is loaded: they are taken as they are.
        """
        field, answer = self._moved, self._moved.vec.CreateVector()
        field.Set(velocity if isinstance(velocity, CoefficientFunction) else ngs.CF(tuple(velocity)))
        v = field.vec.FV().NumPy() * self._free[: self._n]
        super().begin(INSTANT)
        field.vec.FV().NumPy()[:] = -self.tissue_forces() - self.contact_forces()
        answer.data = self._mass.Inverse(ngs.BitArray(self._free[: self._n] > 0), inverse="sparsecholesky") * field.vec
        a = answer.FV().NumPy().copy()
        self.pace = Pace(v, a, a, 0.0)

    def kinetic_energy(self) -> float:
        """∫ ρ/2 |v|² (J)."""
        v = self.pace.velocity
        return float(v @ self._momentum(v)) / 2

    # A time step.

    def begin(self, dt: float) -> None:
        """Begin a time step of `dt` seconds from the present state."""
        super().begin(dt)
        self._step = self.scheme.begin(self._displacement(), self.pace, dt)
        self._weight.Set(self.scheme.weight(dt))
        self._target.vec.FV().NumPy()[:] = self._step.target

    def residual(self, x: np.ndarray) -> tuple[np.ndarray, float]:
        """The body's residual and c M (u - û); reactions are those of the forces without inertia."""
        r, reactions = super().residual(x)
        way = x[: self._n] - self._target.vec.FV().NumPy()
        r[: self._n] += self._weight.Get() * self._momentum(way) * self._free[: self._n]
        return r, reactions

    def finish(self) -> None:
        """End the step begun at the state that now stands."""
        super().finish()
        end, free = self._step.end(self._displacement()), self._free[: self._n]
        self.pace = Pace(free * end.velocity, free * end.acceleration, free * end.average, end.dt)

    def path_error(self) -> float:
        """Largest error of a displacement in the step that now ends, over `amplitude`."""
        error = self._step.error(self._displacement()) * self._free[: self._n]
        return float(np.max(np.abs(error))) / self.amplitude

    def freeze(self, x: np.ndarray, energy: dict[str, Any]) -> None:
        """Go back to a state x and what the tangent was made of there."""
        super().freeze(x, energy)
        self._weight.Set(self.scheme.weight(energy["dt"]))

    def _displacement(self) -> np.ndarray:
        return self.gfu.vec.FV().NumPy()[: self._n].copy()

    def _momentum(self, velocity: np.ndarray) -> np.ndarray:
        """M v."""
        self._moved.vec.FV().NumPy()[:] = velocity
        product = self._moved.vec.CreateVector()
        product.data = self._mass * self._moved.vec
        return product.FV().NumPy()

    # Restart.

    @property
    def memory(self) -> dict[str, Any]:
        """All that decides the steps to come besides the state."""
        return {**super().memory, "pace": dict(self.pace.__dict__)}

    @memory.setter
    def memory(self, saved: dict[str, Any]) -> None:
        self.history.memory = self.friction.memory = saved
        self.pace = Pace(**saved["pace"])
