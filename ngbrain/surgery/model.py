"""The finite element model of an operation: mesh, cleft, tools and tissues, and transient problems for any protocol."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError, nearest
from ngbrain.forward.common.loads import Load
from ngbrain.forward.common.material import Material
from ngbrain.forward.contact.force_control import PrescribedForce
from ngbrain.forward.contact.friction import Friction, Moves
from ngbrain.forward.contact.parameters import FILM, OFFSET_SHARE, PENALTY, SLIP, SOFTNESS
from ngbrain.forward.contact.rigid import RigidContact, SelfContact, SlidingSupport, WallContact
from ngbrain.forward.solid.advance import LoadHistory, newton_for
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.transient.step_control import Control, ErrorControl, PrescribedSteps
from ngbrain.forward.transient.time_stepper import TimeStepper
from ngbrain.image.read.fibre_directions import read_fibre_directions
from ngbrain.image.read.property_maps import read_map
from ngbrain.image.read.volume import Volume
from ngbrain.ladder.models.gravity import gravity_loads, mean_value
from ngbrain.ladder.models.property_maps import fibre_field
from ngbrain.look import BriefText
from ngbrain.materials import Law, Viscous, mix
from ngbrain.materials.base import Value
from ngbrain.materials.families import group_by_family, law_after, stiffen
from ngbrain.materials.viscous import viscous
from ngbrain.mesh import Cleft, Sizes
from ngbrain.mesh.tet_mesh import centres
from ngbrain.scene import Protocol, Scene, Tissue
from ngbrain.surgery import relative_stiffness
from ngbrain.surgery.head_models import Head, load_head, split_region, tissue_elements
from ngbrain.surgery.measures.sampling import UNKNOWN, TissuePart
from ngbrain.surgery.protocols import (
    ForceProtocol,
    ToolMotion,
    continuous_retraction,
    intermittent_retraction,
    staged_retraction,
)
from ngbrain.surgery.relative_stiffness import Mixtures
from ngbrain.surgery.tools import WALLS, make_tools
from ngbrain.surgery.tools.base import RigidTool
from ngbrain.units import gf

POINTWISE = 0.2
"""Penalty against local volume collapse (`Material.pointwise`), in initial shear moduli."""
NEARLY_INCOMPRESSIBLE = 100.0
"""Ratio of bulk to shear modulus from which on the penalty against collapse is used.

Without it J falls to 0.45 at corners of the cleft and the pressure is 12 % too low. Elastic opening of the fast idealised head,
second order: 157 mmHg with 4 mm elements, 163 with 3 mm, 160 with 2.5 mm; third order within 25 and 40 mm of the cleft, 4 mm: 154.
Neo-Hooke, 1 mm opening, 4 mm elements: 3.9 mmHg against 3.8 of third order (3.8 without the penalty).
"""
BALANCED = 1e-5
"""Relative residual at the end of a step: a hundredth of the errors of time steps and mesh, for a third fewer iterations."""
FIRST, SHORTEST = 0.1, 0.01
"""First time step after touch and after an event, relative to the longest step while the blade moves; and the shortest step,
relative to the first, at which a run gives up.
"""
FURTHEST = 0.25 * (1 + 1e-6)
"""Largest advance of the blade in a step, relative to the opening; half of it during release. The small excess over a quarter keeps
round-off from splitting a step.

A coarse head opened and released by 2 mm in 2 s has its work in balance to 0.2 %; with steps of any advance, to 4 %.
"""
SETTLED, APPLIED, RAMP, HELD = 600.0, 60.0, 4, 5
"""Time (s) before the operation in which the head settles under gravity, fluid and swelling; part of it in which they are applied;
steps of that part, and of the rest. A brain has settled ten minutes after its head is turned (Zappalà et al., ISMRM 2019, 3838).
"""
AWAY, APPROACHES = 10e-3, 4
"""Distance (m) of a tool from its wall while the head settles, and corrections of its position until it touches."""
FOCUS = 28e-3
"""Within this distance (m) of the cleft's walls the tangent is updated more often than elsewhere."""
TISSUE = "^(?!ventricle).*"
"""Regions over which strain and volumes are evaluated: all except the ventricles."""

Laws = Callable[[Tissue, Viscous], Law | Viscous]
"""From a tissue and its law, with fibres, to the law that a problem uses."""
SOME_FIBRE = (1.0, 0.0, 0.0)
"""Fibre direction where the direction does not matter."""


@dataclass(repr=False)
class RetractionModel(BriefText):
    """The geometry of a scene, made once and used by every run.

    Parameters
    ----------
    scene : Scene
    head : Head
        The head before the cleft is opened.
    mesh : ngs.Mesh
        The head with its cleft and craniotomy.
    cleft : Cleft
        Position and size of the cleft.
    blades : mapping of RigidTool
        Wall of the cleft → the tool that pushes it.
    """

    scene: Scene
    head: Head
    mesh: ngs.Mesh
    cleft: Cleft
    blades: Mapping[str, RigidTool]

    @classmethod
    def from_scene(cls, scene: Scene, head: Head | None = None) -> RetractionModel:
        """Read the head (unless it is given) and make the mesh; raises `InputError` for a head or cleft that cannot be used."""
        head = head or load_head(scene.geometry, scene.mesh.meshing_route)
        scene.check_on(head)
        where = scene.operated
        cleft = where.slot(head)
        mesh = head.open_cleft(
            cleft, where.craniotomy_diameter, Sizes(scene.mesh.wall, scene.mesh.craniotomy, scene.mesh.largest)
        )
        made = cls(scene, head, mesh, cleft, make_tools(scene.tool, cleft))
        made._divide()
        return made

    def _divide(self) -> None:
        """Split regions that contain tissues with several families of laws, by the families that occur in their elements."""
        mixtures = self.head.mixtures(self.mesh, self.scene.mesh.order)
        tissues = self._tissues([name for shares in mixtures.values() for name in shares])
        for region, shares in mixtures.items():
            where = tissue_elements(self.mesh, region, shares)
            laws = {name: tissues[name].with_fibres(tissues[name].law(), SOME_FIBRE) for name in shares}
            groups = group_by_family(laws)
            if len(groups) > 1:
                masks = [np.any([where[name] for name in group], axis=0) for group in groups]
                self.mesh = split_region(self.mesh, region, masks)

    def materials(self, order: int | None = None) -> dict[str, Material]:
        """Materials by region of the mesh, for elements of an order (by default the scene's)."""
        return self._materials(lambda _, law: law, order)

    def elastic_materials(self, seconds: float, order: int | None = None) -> dict[str, Material]:
        """Elastic materials with the stiffness that a single step from rest has at small strain.

        Parameters
        ----------
        seconds : float
            Length (s) of the step.
        order : int, optional
            Order of the elements; by default the scene's.

        Returns
        -------
        dict of Material
            By region of the mesh.
        """
        return self._materials(lambda _, law: law_after(law, seconds), order)

    def scaled_materials(self, factors: Mapping[str, Value]) -> dict[str, Material]:
        """Materials with the moduli and viscosities of some tissues (by their `region`) times a factor; bulk moduli stay."""
        known = [tissue.region for tissue in self.scene.tissues]
        if unknown := [name for name in factors if name not in known]:
            raise InputError("tissue", repr(unknown[0]), nearest(unknown[0], known))
        return self._materials(lambda tissue, law: stiffen(law, factors.get(tissue.region, 1.0)))

    def materials_from_laws(self, law: Laws) -> dict[str, Material]:
        """Materials by region, with another law for each tissue: a function of the tissue and its law; bulk moduli stay."""
        return self._materials(law)

    def _materials(self, law: Laws, order: int | None = None) -> dict[str, Material]:
        order = order or self.scene.mesh.order
        mixtures = self.head.mixtures(self.mesh, order)
        tissues = self._tissues([name for shares in mixtures.values() for name in shares])
        ratio = dict[str, ngs.GridFunction]()
        for volume, mapped in self._maps(mixtures):
            ratio |= relative_stiffness.stiffness_ratio_fields(volume, self.mesh, mapped, order - 1)
        materials = {}
        for region, shares in mixtures.items():
            found = {name: where for name, where in tissue_elements(self.mesh, region, shares).items() if where.any()}
            laws = {name: law(tissues[name], self._with_fibres(tissues[name], where)) for name, where in found.items()}
            laws |= {name: stiffen(viscous(laws[name]), ratio[name]) for name in found if name in ratio}
            materials[region] = _mix_materials([(tissues[name], laws[name], shares[name]) for name in found])
        return materials

    def _with_fibres(self, tissue: Tissue, where: np.ndarray) -> Viscous:
        """A tissue's law with its fibre directions in the marked elements."""
        if tissue.fibre_map is None:
            return tissue.with_fibres(tissue.law(), tissue.fibre or SOME_FIBRE)
        directions = read_fibre_directions(tissue.fibre_map, str(tissue.fibre_map_convention))
        return tissue.with_fibres(tissue.law(), fibre_field(directions, self.mesh, where))

    def stiffness_map(self) -> dict[str, dict[str, float]]:
        """Spread of the measured stiffness ratio in each tissue (`relative_stiffness.summary`); empty without maps."""
        order, found = self.scene.mesh.order, dict[str, dict[str, float]]()
        for volume, mixtures in self._maps(self.head.mixtures(self.mesh, order)):
            found |= relative_stiffness.summary(volume, self.mesh, mixtures, order - 1)
        return found

    def _maps(self, mixtures: Mixtures) -> Iterator[tuple[Volume, Mixtures]]:
        """Stiffness maps of the head and of single tissues, each with the tissues that it scales."""
        if self.head.stiffness is not None:
            yield self.head.stiffness, _without_ventricles(mixtures)
        for tissue in self.scene.tissues:
            if tissue.shear_modulus_map is not None:
                yield _read_moduli(tissue.shear_modulus_map), _fractions(tissue, mixtures)

    @cached_property
    def tissues(self) -> tuple[Tissue, ...]:
        """The scene's tissues; a tissue with a modulus map is scaled to the mean of its map."""
        if not any(tissue.shear_modulus_map for tissue in self.scene.tissues):
            return self.scene.tissues
        order, found = self.scene.mesh.order, []
        mixtures = self.head.mixtures(self.mesh, order)
        for tissue in self.scene.tissues:
            mine = _fractions(tissue, mixtures)
            if tissue.shear_modulus_map is not None and mine:
                mean = relative_stiffness.mean_modulus(
                    _read_moduli(tissue.shear_modulus_map), self.mesh, mine, order - 1
                )
                tissue = tissue.with_scale(mean / tissue.initial_modulus)
            found.append(tissue)
        return tuple(found)

    def _tissues(self, names: list[str]) -> dict[str, Tissue]:
        """Tissue name → the scene's tissue; every name needs one tissue, and every pattern must match a name."""
        found: dict[str, Tissue] = {}
        for i, tissue in enumerate(self.tissues, 1):
            mine = [name for name in names if re.fullmatch(tissue.region, name)]
            if not mine:
                raise InputError("tissue region", repr(tissue.region), nearest(tissue.region, set(names)))
            if twice := sorted({name for name in mine if name in found}):
                other = found[twice[0]]
                has = f"tissue#{self.tissues.index(other) + 1} ({other.region!r})"
                raise InputError(
                    f"tissue#{i}.region", repr(tissue.region), f"a pattern without {', '.join(twice)}, which {has} has"
                )
            found |= dict.fromkeys(mine, tissue)
        if bare := sorted(set(names) - set(found)):
            raise InputError("tissue", f"not given for {', '.join(bare)}", "a tissue for every region of the head")
        return found

    def tissue(self, name: str) -> Tissue:
        """The scene's tissue of a tissue name."""
        return next(tissue for tissue in self.tissues if re.fullmatch(tissue.region, name))

    def parts(self, order: int | None = None) -> dict[str, TissuePart]:
        """Tissue name → the part over which strain, stress and volumes are evaluated, for elements of an order (the scene's)."""
        mixtures = self.head.mixtures(self.mesh, order or self.scene.mesh.order)
        counted = _without_ventricles(mixtures)
        tissues = self._tissues([name for shares in mixtures.values() for name in shares])
        parts = {}
        for name in {name: None for shares in counted.values() for name in shares}:
            where = {region: shares.get(name, 0.0) for region, shares in counted.items()}
            tissue, of = tissues[name], self.mesh.MaterialCF(where, default=0.0)
            fitted = tissue.published.principal_stretch if tissue.published else UNKNOWN
            parts[name] = TissuePart(of, fitted, tissue.initial_modulus)
        return parts

    def run(
        self,
        protocol: ToolMotion | ForceProtocol,
        control: Control | None = None,
        materials: dict[str, Material] | None = None,
        order: int | None = None,
    ) -> TimeStepper:
        """A transient problem of a protocol, at rest.

        Parameters
        ----------
        protocol : ToolMotion or ForceProtocol
            A force-controlled blade may advance as far as the scene's opening.
        control : Control, optional
            Time-step control; by default the scene's.
        materials : dict of Material, optional
            By region; by default the scene's.
        order : int, optional
            Order of the elements; by default the scene's.

        Returns
        -------
        TimeStepper
        """
        scene, opening = self.scene, self.scene.tool.travel
        drive = protocol.drive(opening) if isinstance(protocol, ForceProtocol) else protocol.drive()
        stiffest = max(tissue.initial_modulus for tissue in self.tissues)
        hard, soft = PENALTY * stiffest / opening, SOFTNESS * opening
        starts = [ngs.Parameter(0.0) for _ in self.blades]
        contacts = [
            RigidContact(
                wall,
                blade.distance(
                    drive.parameter / len(self.blades) + start
                    if scene.is_preloaded
                    else drive.parameter / len(self.blades)
                ),
                hard,
                soft,
                OFFSET_SHARE,
                travel=drive.parameter,
            )
            for (wall, blade), start in zip(self.blades.items(), starts, strict=True)
        ]
        rubs = [
            Friction(contact, scene.tool.friction, SLIP * opening, _shared_motion(blade, len(self.blades)))
            for contact, blade in zip(contacts, self.blades.values(), strict=True)
            if scene.tool.friction
        ]
        slides = self.sliding
        films = [SlidingSupport.on(self.mesh, slides, FILM * stiffest)] if slides else []
        meeting = SelfContact(*WALLS, hard, soft, 1.5 * self.cleft.opening)
        order = order or scene.mesh.order
        materials = materials or self.materials(order)
        touches: list[WallContact | Friction | PrescribedForce] = [*contacts, *rubs, *films, meeting]
        if isinstance(drive, PrescribedForce):
            touches.append(drive)
        fixed = {self.fixed: 0} if self.fixed else {}
        parts = (self.mesh, materials, fixed, self.gravity_loads(order), touches, f"P{order}/P{order - 1}")
        near = self.cleft.distance_to_walls(centres(self.mesh)) < FOCUS
        body = Problem(*parts)
        if scene.is_preloaded:
            settle(body, starts, drive if isinstance(drive, PrescribedForce) else None)
        body.focus(near)
        newton = newton_for(body, rtol=BALANCED)
        return TimeStepper(body, drive, control or self.control(), scene.mesh.wall / 2, newton)

    def check_rest(self) -> None:
        """Raise `InputError` for a head that is loaded before the tool touches it: derivatives of a run begin at rest."""
        if self.scene.is_preloaded:
            found = "gravity" if self.scene.gravity is not None else "tissue.swelling_percent"
            raise InputError(found, "given", "a scene without gravity and swelling, for derivatives of its run")

    def gravity_loads(self, order: int) -> list[Load]:
        """Gravity and the fluid of the scene, for elements of an order."""
        if self.scene.gravity is None:
            return []
        mixtures = self.head.mixtures(self.mesh, order)
        tissues = self._tissues([name for shares in mixtures.values() for name in shares])
        densities = {
            region: mean_value(self.mesh, order - 1, [(share, tissues[name].rho) for name, share in shares.items()])
            for region, shares in mixtures.items()
        }
        return gravity_loads(self.scene, self.mesh, self.mesh.MaterialCF(densities))

    @property
    def fixed(self) -> str:
        """Pattern of the fixed boundaries."""
        return self._boundaries("bonded")

    @property
    def sliding(self) -> str:
        """Pattern of the boundaries that slide along a fixed surface."""
        return self._boundaries("sliding")

    def _boundaries(self, contact: str) -> str:
        """Boundaries with a kind of condition; `InputError` for a pattern without boundary, and for two conditions on one."""
        names, kinds = sorted(set(self.mesh.GetBoundaries())), dict[str, str]()
        owners = dict[str, int]()
        for i, bc in enumerate(self.scene.displacement_bcs, 1):
            mine = [name for name in names if re.fullmatch(bc.boundary, name)]
            if not mine:
                raise InputError(f"displacement_bc#{i}.boundary", repr(bc.boundary), nearest(bc.boundary, names))
            if pushed := [name for name in mine if name in self.blades]:
                wanted = f"a pattern without {', '.join(pushed)}, which the tool pushes"
                raise InputError(f"displacement_bc#{i}.boundary", repr(bc.boundary), wanted)
            if twice := [name for name in mine if name in kinds]:
                wanted = f"one condition for {twice[0]!r}, which has displacement_bc#{owners[twice[0]]}"
                raise InputError(f"displacement_bc#{i}.boundary", repr(bc.boundary), wanted)
            owners |= dict.fromkeys(mine, i)
            kinds |= dict.fromkeys(mine, bc.contact)
        return "|".join(name for name, kind in kinds.items() if kind == contact)

    def control(self) -> Control:
        """Time-step control of the scene."""
        time = self.scene.time
        touch = min(FIRST * time.max_step_contact, time.max_step_hold)
        way = FURTHEST * self.scene.tool.travel
        return ErrorControl(
            time.step_tolerance, touch, time.max_step_hold, SHORTEST * touch, time.max_step_contact, way
        )

    @staticmethod
    def program(scene: Scene, asked: Protocol) -> ToolMotion | ForceProtocol:
        """The tool motion or force that a scene's protocol describes.

        Parameters
        ----------
        scene : Scene
        asked : scene.Protocol

        Returns
        -------
        ToolMotion or ForceProtocol
        """
        travel, time = scene.tool.travel, scene.time
        if asked.kind == "continuous":
            return continuous_retraction(travel, time.ramp, time.end, asked.name)
        if asked.kind == "intermittent":
            return intermittent_retraction(travel, time.ramp, time.end, asked.hold, asked.rest, asked.name)
        if asked.kind == "staged":
            return staged_retraction(travel, time.ramp, time.end, asked.stages, asked.rest, asked.name)
        if asked.kind == "force":
            times, force = asked.times or (0.0, time.ramp, time.end), tuple(map(gf, asked.force_gf))
            return ForceProtocol(asked.name, times, force if asked.times else (0.0, *force, *force))
        return ToolMotion(asked.name, tuple(asked.times), tuple(asked.travel))

    def ramp(self, name: str) -> ToolMotion:
        """The first opening alone."""
        return ToolMotion(name, (0.0, self.scene.time.ramp), (0.0, self.scene.tool.travel))

    def hold(self, name: str) -> ToolMotion:
        """The first opening, held to the end."""
        time = self.scene.time
        return continuous_retraction(self.scene.tool.travel, time.ramp, time.end, name)


def settle(body: Problem, starts: Sequence[ngs.Parameter], force: PrescribedForce | None = None) -> None:
    """Apply the loads of a head at rest, and let its tissue relax until t = 0; then bring the tools into touch with their walls.

    Parameters
    ----------
    body : Problem
        At rest.
    starts : sequence of ngsolve.Parameter
        Position (m) of each tool before it advances, from where it touches the wall at rest.
    force : PrescribedForce, optional
        The motion of a force-controlled tool, among its contacts.
    """
    for start in starts:
        start.Set(-AWAY)
    held = -np.geomspace(SETTLED - 1.3 * APPLIED, 1, HELD)
    times = np.concatenate([np.linspace(-SETTLED, -SETTLED + APPLIED, RAMP + 1), held, [0]])
    loads = LoadHistory(times, np.clip((times + SETTLED) / APPLIED, 0, 1))
    newton = newton_for(body, rtol=BALANCED)
    stepper = TimeStepper(body, force, PrescribedSteps(times), newton=newton, loads=loads)
    stepper.run(lambda *_: None, until=0.0)
    for start, gaps in zip(starts, body.gaps, strict=True):
        start.Set(0.0)
        for _ in range(APPROACHES):
            start.Set(start.Get() + float(np.min(gaps())))


def _shared_motion(blade: RigidTool, sharing: int) -> Moves:
    """Motion of a tool's surface when several tools share the advance."""
    return lambda x, way: blade.moves(x, way / sharing)


def _fractions(tissue: Tissue, mixtures: Mixtures) -> dict[str, dict[str, Value]]:
    """A tissue's fraction of the regions that contain it."""
    found = {
        region: {name: share for name, share in shares.items() if re.fullmatch(tissue.region, name)}
        for region, shares in mixtures.items()
    }
    return {region: shares for region, shares in found.items() if shares}


def _read_moduli(path: str) -> Volume:
    return read_map(path, "shear moduli (Pa)")


def _without_ventricles(mixtures: Mixtures) -> dict[str, Mapping[str, Value]]:
    """Fractions without the ventricles."""
    return {region: shares for region, shares in mixtures.items() if re.fullmatch(TISSUE, region)}


def _mix_materials(shares: list[tuple[Tissue, Law | Viscous, Value]]) -> Material:
    """One material for the tissues of a region with their laws; fractions are 0 or 1 at quadrature points."""
    if len(shares) == 1:
        ((tissue, law, _),) = shares
        return Material(law, tissue.bulk, _barrier(tissue), swelling=tissue.swelling)
    bulk, barrier, swelling = (
        sum(share * value(tissue) for tissue, _, share in shares)
        for value in (lambda t: t.bulk, _barrier, lambda t: t.swelling)
    )
    swells = any(tissue.swelling for tissue, _, _ in shares)
    law = mix([(law, share) for _, law, share in shares])
    return Material(law, bulk, barrier, swelling=swelling if swells else 0.0)


def _barrier(tissue: Tissue) -> float:
    return POINTWISE * tissue.initial_modulus if tissue.volume_ratio >= NEARLY_INCOMPRESSIBLE else 0.0
