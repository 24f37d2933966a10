"""What is read off a body under a blade after every step: force, area, pressure, opening, balances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np

from ngbrain.forward.contact.rigid import SURFACE_ORDER, Contact, current_normal_area
from ngbrain.forward.solid.problem import Problem
from ngbrain.scene.operation import FACED
from ngbrain.surgery.blades import Blade, patch

PATCH_MARGIN = 1e-3
"""The pressure patch stays this far (m) inside the face's edges; its last part, from the tip, has a pressure of its own,"""
CENTRE = FACED / 2
"""and so has its middle: what of it is within this distance (m) of its centroid, both on the unloaded wall."""


@dataclass(frozen=True)
class Row:
    """One line of a run's record; SI units."""

    t: float
    advance: float
    opening: float
    force: float
    net_reaction: float
    area: float
    pressure: float
    tip_pressure: float
    centre_pressure: float
    gap: float
    depth: float
    min_det_F: float  # noqa: N815
    balance: float
    blade_work: float
    contact_energy: float
    tissue_work: float
    tissue_work_size: float
    friction_work: float


class Observer:
    """Evaluates a `Row` of what blades do to walls, and holds the running work.

    Of several blades area is the sum, pressures are of all their patches together, opening and advance the sum of their ways,
    force and net reaction the mean.

    Pressure is the normal force on the fixed patch of wall under the face over the patch's current area, tip pressure
    the same over its last 5 mm, centre pressure within 2.5 mm of its middle. Gap is the smallest of any point, negative
    inside a blade; depth is how far tissue is inside where it presses, the mean ∫ p d / ∫ p. Force is what a blade feels
    along the push. The net reaction is the tissue's own nodal force on the wall along the push, from the equilibrium
    residual without the contact term; `balance` is |blades + supports| / |blade| (0 without a force). Blade work is
    ∫ `Contact.driving` d(advance), and what friction adds; it goes into the contact energy, which the penalty stores, into
    friction and the tissue work ∫∫ P:Ḟ. The size of that, Σ |∫ P:ΔF| over steps, is at most ∫∫ |P:Ḟ|, so that a balance
    relative to it is not flattered.
    """

    def __init__(self, body: Problem, blades: Mapping[str, Blade], fixed: str) -> None:
        self.body = body
        self._faces = [Face(body, blade, wall) for wall, blade in blades.items()]
        displacement = body.fes.components[0]
        self._on_fixed = _mask(displacement, fixed)
        self._forces = np.zeros(displacement.ndof)
        self._u = np.zeros(displacement.ndof)
        self._advance = self._driving = 0.0
        self.blade_work = self.tissue_work = self.tissue_work_size = self.friction_work = 0.0

    def __call__(self, t: float, advance: float, min_det: float) -> Row:
        """The body as it stands at time t with the blades at `advance` (m)."""
        seen = [face() for face in self._faces]
        opening, area, *pressures, driving, pressed, sunk = np.sum(seen, axis=0)
        tissue, contact = self.body.tissue_forces(), self.body.contact_forces()
        reaction = float(np.mean([face.push[face.nodes] @ tissue[face.nodes] for face in self._faces]))
        felt = [-float(face.push[face.nodes] @ contact[face.nodes]) for face in self._faces]
        force = max(0.0, float(np.mean(felt)))
        push = self._faces[0].push
        supports = float(push[self._on_fixed] @ (tissue + contact)[self._on_fixed])
        left = abs(supports - push @ contact)
        self._add_work(tissue, driving + self.body.friction_driving(), advance)
        patch, tip, centre = (f / a for f, a in np.reshape(pressures, (3, 2)))
        return Row(
            t,
            advance,
            opening,
            force,
            reaction,
            area,
            patch,
            tip,
            centre,
            self.body.min_gap(),
            sunk / pressed if pressed else 0.0,
            min_det,
            left / force if force else 0.0,
            self.blade_work,
            self.body.contact_energy(),
            self.tissue_work,
            self.tissue_work_size,
            self.friction_work,
        )

    def checkpoint(self) -> dict[str, object]:
        """The running work and the state it is measured from."""
        works = ("blade_work", "tissue_work", "tissue_work_size", "friction_work")
        names = ("_u", "_forces", "_advance", "_driving", *works)
        return {name.lstrip("_"): getattr(self, name) for name in names}

    def restore(self, saved: dict[str, object]) -> None:
        """Go on from a checkpoint."""
        for name, value in saved.items():
            setattr(self, name if hasattr(self, name) else f"_{name}", value)

    def _add_work(self, tissue: np.ndarray, driving: float, advance: float) -> None:
        u = np.array(self.body.u.vec.FV().NumPy())
        step = float((tissue + self._forces) @ (u - self._u)) / 2
        self.tissue_work += step
        self.tissue_work_size += abs(step)
        self.friction_work += self.body.friction_work()
        self.blade_work += (driving + self._driving) / 2 * (advance - self._advance)
        self._u, self._forces, self._advance, self._driving = u, tissue, advance, driving


class Face:
    """A wall under a blade, and what is integrated over it.

    push     unit vector of the blade's way at every displacement unknown; nodes: those of the wall
    """

    def __init__(self, body: Problem, blade: Blade, wall: str) -> None:
        self.mesh, self._wall = body.mesh, body.mesh.Boundaries(wall)
        (contact,) = [c for c in body.contacts if isinstance(c, Contact) and c.wall == wall]
        u = body.u
        push = ngs.CF(tuple(map(float, blade.cleft.across)))
        pressure = contact.pressure(u, body.offset)
        area = ngs.Norm(current_normal_area(u))
        whole, tip = patch(blade, PATCH_MARGIN), patch(blade, PATCH_MARGIN, FACED)
        x = ngs.CF((ngs.x, ngs.y, ngs.z))
        size, *middle = self._integrate(ngs.CF((whole, whole * x)))
        off = x - ngs.CF(tuple(moment / size for moment in middle))
        centre = whole * ngs.IfPos(CENTRE**2 - ngs.InnerProduct(off, off), 1, 0)
        parts = [part * value for part in (whole, tip, centre) for value in (pressure, area)]
        moved = whole * ngs.InnerProduct(u, push) / size
        # One pass over the wall for all of them.
        driving, depth = contact.driving(u, body.offset), pressure * -contact.gap(u)
        self._integrals = ngs.CF((moved, ngs.IfPos(pressure, area, 0), *parts, driving, pressure, depth)).Compile()
        displacement = body.fes.components[0]
        self.push, self.nodes = _nodal(displacement, push), _mask(displacement, wall)

    def __call__(self) -> np.ndarray:
        """Way of the patch (m), area in touch (m²), force (N) and area of patch, tip and centre; ∂energy/∂way; ∫ p, ∫ p d."""
        return np.array(self._integrate(self._integrals))

    def _integrate(self, values: ngs.CoefficientFunction) -> tuple[float, ...]:
        return tuple(ngs.Integrate(values, self.mesh, definedon=self._wall, order=SURFACE_ORDER))


def _nodal(space: ngs.FESpace, field: ngs.CoefficientFunction) -> np.ndarray:
    gfu = ngs.GridFunction(space)
    gfu.Set(field)
    return np.array(gfu.vec.FV().NumPy())


def _mask(space: ngs.FESpace, boundary: str) -> np.ndarray:
    return np.fromiter(space.GetDofs(space.mesh.Boundaries(boundary)), bool, space.ndof)


def swept_volume(body: Problem, boundary: str) -> float:
    """Volume (m³) that a boundary sweeps outwards, ∫∫ u · cof(1 + s∇u) N ds dS over 0 ≤ s ≤ 1; Simpson is exact in s."""
    grad, normal = ngs.Grad(body.u), ngs.specialcf.normal(3)
    stages = [(0.0, 1 / 6), (0.5, 4 / 6), (1.0, 1 / 6)]
    rate = sum(w * ngs.InnerProduct(body.u, ngs.Cof(ngs.Id(3) + s * grad) * normal) for s, w in stages)
    return float(ngs.Integrate(rate * ngs.ds(boundary, bonus_intorder=6), body.mesh))


def volume_change(body: Problem, region: str) -> float:
    """∫ (J - 1) dV over a region (m³)."""
    change = ngs.Det(ngs.Id(3) + ngs.Grad(body.u)) - 1
    return float(ngs.Integrate(change * ngs.dx(definedon=body.mesh.Materials(region), bonus_intorder=6), body.mesh))
