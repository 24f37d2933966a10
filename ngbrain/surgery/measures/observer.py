"""Quantities recorded after every step of a retraction: force, area, pressure, opening, work balances."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np

from ngbrain.forward.contact.rigid import SURFACE_ORDER, RigidContact
from ngbrain.forward.observables import Force, Functional, Observable
from ngbrain.forward.observables.patches import (
    ContactArea,
    ContactForce,
    DrivingForce,
    Patch,
    PatchDisplacement,
    mean_depth,
    patch_pressure,
)
from ngbrain.forward.observables.wall import WallPass
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import FieldState
from ngbrain.scene.operation import FACED
from ngbrain.surgery.measures.sampling import TissuePart, tissue_percentiles
from ngbrain.surgery.tools.base import RigidTool, patch

PATCH_MARGIN = 1e-3
"""Distance (m) of the pressure patch from the edges of the tool's face."""
CENTRE = FACED / 2
"""The centre pressure is over points within this distance (m) of the patch's centroid on the unloaded wall."""


UNITS = {
    "t": "s",
    **dict.fromkeys(("advance", "opening", "gap", "depth"), "m"),
    **dict.fromkeys(("force", "net_reaction"), "N"),
    "area": "m2",
    **dict.fromkeys(("pressure", "tip_pressure", "centre_pressure"), "Pa"),
    **dict.fromkeys(("blade_work", "contact_energy", "tissue_work", "tissue_work_size", "friction_work"), "J"),
}
"""Units of the columns of a `StepRecord`; the others are numbers."""


@dataclass(frozen=True)
class StepRecord:
    """Record of one step of a run, in SI units.

    Parameters
    ----------
    t : float
        Time (s).
    advance, opening : float
        Advance of the blades and opening of the cleft (m).
    force, net_reaction : float
        Force (N) of the blade, and net reaction (N) of the tissue.
    area : float
        Contact area (m²).
    pressure, tip_pressure, centre_pressure : float
        Pressure (Pa) on the face, at its tip, at its centre.
    gap, depth : float
        Smallest gap, negative for penetration, and mean penetration (m).
    min_det_F : float
        Smallest determinant of the deformation gradient.
    balance : float
        Relative force imbalance.
    blade_work, contact_energy, tissue_work, tissue_work_size, friction_work : float
        Work and energy (J), see `Observer`.
    """

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
    """Evaluates the `StepRecord` of a step: `retraction_observables` in one pass over each wall, and the accumulated work.

    For several blades the area is the sum, pressures are averaged over all patches, opening and advance are the sums of their
    motions, force and net reaction the mean.

    The pressure is the normal force on the fixed patch of wall under the face, divided by the patch's current area; the tip
    pressure is the same over its last 5 mm, the centre pressure within 2.5 mm of its centre. The gap is the smallest of all
    points, negative for penetration; the depth is the mean penetration in contact, ∫ p d / ∫ p. The force is that on the blade
    along its motion, of contact and friction. The net reaction is the tissue's own nodal force on the wall in that direction, from
    the equilibrium residual without the contact term; `balance` is |blades + supports| / |blade| (0 without a force). The blade's
    work is ∫ `RigidContact.driving_force` d(advance) plus the contribution of friction; it is converted to the contact energy
    stored by the penalty, to friction and to the tissue work ∫∫ P:Ḟ. The size of the latter, Σ |∫ P:ΔF| over steps, is at most
    ∫∫ |P:Ḟ|, so that a relative balance is not too optimistic.

    Parameters
    ----------
    body : Problem
    blades : mapping of RigidTool
        By wall.
    fixed : str
        Pattern of the fixed boundaries.
    """

    def __init__(self, body: Problem, blades: Mapping[str, RigidTool], fixed: str) -> None:
        self.body, self.asked = body, retraction_observables(body, blades)
        """Columns of a `StepRecord` that are of any problem with these contacts, as `Observable`s by name."""
        contacts, reaction = _contacts_by_wall(body, blades), self.asked["net_reaction"]
        driving = DrivingForce([Patch(each) for each in contacts.values()])
        on_walls = {name: each for name, each in self.asked.items() if each is not reaction} | {"driving": driving}
        self._names, self._pass = list(on_walls), WallPass(body, list(on_walls.values()))
        assert isinstance(reaction, Force)
        self._reaction = reaction.on(body)
        displacement = body.fes.components[0]
        pushes = {wall: _nodal(displacement, ngs.CF(_across(blade))) for wall, blade in blades.items()}
        self._push = next(iter(pushes.values()))
        self._along = sum(push * _mask(displacement, wall) for wall, push in pushes.items()) / len(pushes)
        self._on_fixed = _mask(displacement, fixed)
        # Work counts from here: gravity, fluid and swelling may have done some before.
        self._forces, self._u = np.array(body.tissue_forces()), np.array(body.u.vec.FV().NumPy())
        self._energy = body.contact_energy()
        self._advance = self._driving = 0.0
        self.blade_work = self.tissue_work = self.tissue_work_size = self.friction_work = 0.0

    def __call__(self, t: float, advance: float, min_det: float) -> StepRecord:
        """Record of the present state at time t (s) with the blades at `advance` (m)."""
        seen = dict(zip(self._names, self._pass().tolist(), strict=True))
        tissue, contact = self.body.tissue_forces(), self.body.contact_forces()
        driving = seen.pop("driving") + self.body.friction_driving_force()
        seen["force"] = max(0.0, seen["force"] - float(self._along @ self.body.friction_forces()))
        supports = float(self._push[self._on_fixed] @ (tissue + contact)[self._on_fixed])
        left = abs(supports - self._push @ contact)
        self._add_work(tissue, driving, advance)
        return StepRecord(
            t=t,
            advance=advance,
            net_reaction=float(self._reaction.value(tissue)[0]),
            gap=self.body.min_gap(),
            min_det_F=min_det,
            balance=left / seen["force"] if seen["force"] else 0.0,
            blade_work=self.blade_work,
            contact_energy=self.body.contact_energy() - self._energy,
            tissue_work=self.tissue_work,
            tissue_work_size=self.tissue_work_size,
            friction_work=self.friction_work,
            **seen,
        )

    def checkpoint(self) -> dict[str, object]:
        """The accumulated work and the state that it refers to."""
        works = ("blade_work", "tissue_work", "tissue_work_size", "friction_work")
        names = ("_u", "_forces", "_energy", "_advance", "_driving", *works)
        return {name.lstrip("_"): getattr(self, name) for name in names}

    def restore(self, saved: dict[str, object]) -> None:
        """Restore from a checkpoint."""
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


def retraction_observables(
    body: Problem, blades: Mapping[str, RigidTool], parts: Mapping[str, TissuePart] | None = None
) -> dict[str, Observable]:
    """Observables of a body under blades, by column of a `StepRecord`: data of a run's model, or questions of a model ladder.

    Parameters
    ----------
    body : Problem
        With a `RigidContact` on each wall.
    blades : mapping of RigidTool
        Wall → what presses it.
    parts : mapping of TissuePart, optional
        Tissues that count, as of `RetractionModel.parts`; adds `mps_p50` to `oss_p99`, see `sampling.tissue_percentiles`.

    Returns
    -------
    dict of Observable
        `opening`, `area`, `force` (without friction), `pressure`, `tip_pressure`, `centre_pressure`, `depth`, `net_reaction`; all
        except the area have a gradient.
    """
    contacts = _contacts_by_wall(body, blades)
    across = [_across(blade) for blade in blades.values()]

    def patches(name: str, where: Callable[[RigidContact, RigidTool], ngs.CoefficientFunction]) -> list[Patch]:
        return [
            Patch(contacts[wall], where(contacts[wall], each), f"{name} on {wall}") for wall, each in blades.items()
        ]

    whole = [Patch(each) for each in contacts.values()]
    under = patches("the blade's face", lambda _, blade: patch(blade, PATCH_MARGIN))
    tip = patches("the blade's tip", lambda _, blade: patch(blade, PATCH_MARGIN, FACED))
    centre = patches("the middle of the blade's face", lambda contact, blade: _centre(body, contact, blade))
    motion = body.mesh.BoundaryCF(
        {wall: ngs.CF(_across(blade)) / len(blades) for wall, blade in blades.items()}, default=ngs.CF((0.0, 0.0, 0.0))
    )
    return {
        "opening": PatchDisplacement(under, across),
        "area": ContactArea(whole),
        "pressure": patch_pressure(under),
        "tip_pressure": patch_pressure(tip),
        "centre_pressure": patch_pressure(centre),
        "depth": mean_depth(whole),
        "force": ContactForce(whole, across),
        "net_reaction": Force("|".join(blades), motions=[motion]),
        **(tissue_percentiles(next(iter(blades.values())).cleft, parts) if parts else {}),
    }


def _contacts_by_wall(body: Problem, blades: Mapping[str, RigidTool]) -> dict[str, RigidContact]:
    """Wall → its contact."""
    contacts = {each.wall: each for each in body.contacts if isinstance(each, RigidContact)}
    return {wall: contacts[wall] for wall in blades}


def _across(blade: RigidTool) -> tuple[float, ...]:
    return tuple(map(float, blade.cleft.across))


def _centre(body: Problem, contact: RigidContact, blade: RigidTool) -> ngs.CoefficientFunction:
    """1 at the centre of a blade's patch, 0 elsewhere."""
    x, where = ngs.CF((ngs.x, ngs.y, ngs.z)), patch(blade, PATCH_MARGIN)
    on = body.mesh.Boundaries(contact.wall)
    size, *middle = ngs.Integrate(ngs.CF((where, where * x)), body.mesh, definedon=on, order=SURFACE_ORDER)
    off = x - ngs.CF(tuple(moment / size for moment in middle))
    return where * ngs.IfPos(CENTRE**2 - ngs.InnerProduct(off, off), 1, 0)


def _nodal(space: ngs.FESpace, field: ngs.CoefficientFunction) -> np.ndarray:
    gfu = ngs.GridFunction(space)
    gfu.Set(field)
    return np.array(gfu.vec.FV().NumPy())


def _mask(space: ngs.FESpace, boundary: str) -> np.ndarray:
    return np.fromiter(space.GetDofs(space.mesh.Boundaries(boundary)), bool, space.ndof)


def swept_volume(boundary: str) -> Functional:
    """Volume (m³) swept outwards by a boundary, ∫∫ u · cof(1 + s∇u) N ds dS over 0 ≤ s ≤ 1; Simpson's rule is exact in s."""

    def swept(at: FieldState) -> ngs.comp.SumOfIntegrals:
        stages = [(0.0, 1 / 6), (0.5, 4 / 6), (1.0, 1 / 6)]
        normal = ngs.specialcf.normal(3)
        rate = sum(w * ngs.InnerProduct(at.u, ngs.Cof(ngs.Id(3) + s * at.along) * normal) for s, w in stages)
        return rate * ngs.ds(boundary, bonus_intorder=6)

    return Functional(swept, name=f"volume swept by {boundary}", unit="m³")


def volume_change(region: str) -> Functional:
    """Volume change ∫ (J - 1) dV of a region (m³)."""

    def change(at: FieldState) -> ngs.comp.SumOfIntegrals:
        return (ngs.Det(at.F) - 1) * ngs.dx(definedon=at.mesh.Materials(region), bonus_intorder=6)

    return Functional(change, name=f"change of the volume of {region}", unit="m³")
