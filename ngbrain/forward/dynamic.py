"""A body with mass: the generalised-α method as one more energy in each time step, a parabola around where inertia leads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import ngsolve as ngs
import numpy as np
from ngsolve import CoefficientFunction

from ngbrain.forward.body import LENGTH_SCALE, Body
from ngbrain.forward.contact import Touch
from ngbrain.forward.friction import Friction
from ngbrain.forward.inertia import GeneralizedAlpha, Pace
from ngbrain.forward.material import Material
from ngbrain.forward.patterns import check_regions
from ngbrain.materials.base import Value, positive

INSTANT = 1e-9
"""Time (s) in which no tissue relaxes."""


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
