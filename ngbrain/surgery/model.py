"""From a scene to what is computed: mesh, cleft, blade, and a transient run for any protocol."""

from __future__ import annotations

from dataclasses import dataclass, replace

import ngsolve as ngs

from ngbrain.forward.body import Body, Material
from ngbrain.forward.contact import Contact
from ngbrain.forward.transient import StepControl, Transient
from ngbrain.materials import Viscous, after
from ngbrain.mesh import Cleft, Sizes, idealised_head
from ngbrain.scene import Protocol as SceneProtocol
from ngbrain.scene import Scene
from ngbrain.surgery.blades import Spatula
from ngbrain.surgery.protocols import Drive, Protocol, continuous, intermittent, staged

WALL = "wall_plus"
"""The wall that the blade pushes."""
PENALTY = 500.0
"""Contact stiffness in initial shear moduli per opening: a pressure of ten moduli goes 2 % of the opening deep."""
SOFTNESS = 0.02
"""Penetration up to which the contact pressure sets in softly, in openings."""
MADE_UP = 0.95
"""Share of the mean penetration that the blade stands further out: the wall goes where the blade should have put it."""
STABILISING_TIME = 0.3
"""Viscosity over initial shear modulus (s): small beside a ramp of ten seconds, it adds 2 % to the fast demo's peak."""
POINTWISE = 0.2
"""Barrier against collapse at single points (`Material.pointwise`), in initial shear moduli,"""
NEARLY_INCOMPRESSIBLE = 100.0
"""for tissues of at least this bulk over shear modulus; J of others may go far from 1.

Without it J falls to 0.45 at corners of the cleft and the pressure is 12 % too low. Elastic opening of the fast demo's
head, second order: 157 mmHg with 4 mm elements, 163 with 3 mm, 160 with 2.5 mm; third order within 25 and 40 mm of the
cleft, 4 mm: 154. Neo-Hooke, 1 mm opening, 4 mm elements: 3.9 mmHg against 3.8 of third order (3.8 without barrier).
"""
TISSUE = "^(?!ventricle).*"
"""Regions that strain and volumes are counted over: all but the ventricles."""


@dataclass
class Model:
    """A scene's geometry, made once and used by every run.

    mesh    NGSolve mesh; cleft, blade: where and what pushes
    """

    scene: Scene
    mesh: ngs.Mesh
    cleft: Cleft
    blade: Spatula

    @classmethod
    def of(cls, scene: Scene) -> Model:
        """Make the mesh; raises `InputError` for a target outside the tissue."""
        where = scene.cleft
        cleft = where.slot()
        sizes = Sizes(scene.body.site, scene.body.near, scene.body.far)
        mesh = idealised_head(cleft, where.craniotomy, sizes)
        tool = scene.blade
        return cls(scene, mesh, cleft, Spatula(cleft, tool.width, tool.edge_radius, tool.tip, tool.thickness))

    def materials(self) -> dict[str, Material]:
        """Region pattern → law of shape and bulk modulus."""
        found = {}
        for tissue in self.scene.tissues:
            mu = tissue.initial_modulus
            barrier = POINTWISE * mu if tissue.bulk_ratio >= NEARLY_INCOMPRESSIBLE else 0.0
            found[tissue.region] = Material(tissue.law(), tissue.bulk, STABILISING_TIME * mu, barrier)
        return found

    def elastic(self, seconds: float) -> dict[str, Material]:
        """The elastic laws that one step of `seconds` from rest amounts to."""
        return {
            region: replace(m, law=after(m.law, seconds), viscosity=0.0) if isinstance(m.law, Viscous) else m
            for region, m in self.materials().items()
        }

    def run(
        self,
        protocol: Protocol,
        control: StepControl | None = None,
        materials: dict[str, Material] | None = None,
        order: int | None = None,
    ) -> Transient:
        """A transient run of a protocol, at rest; other steps, materials or order than the scene's on request."""
        scene, drive = self.scene, Drive(protocol)
        opening = scene.retraction.opening
        stiffest = max(tissue.initial_modulus for tissue in scene.tissues)
        contact = Contact(
            WALL, self.blade.distance(drive.parameter), PENALTY * stiffest / opening, SOFTNESS * opening, MADE_UP
        )
        materials, order = materials or self.materials(), order or scene.body.order
        body = Body(self.mesh, materials, scene.support.fixed, [contact], order, stiffest)
        control = control or StepControl(scene.steps.contact, dt_max=scene.steps.longest)
        return Transient(body, drive, control, penetration_limit=scene.body.site / 2)

    @staticmethod
    def program(scene: Scene, asked: SceneProtocol) -> Protocol:
        """The blade's program that a scene's protocol asks for."""
        r = scene.retraction
        if asked.kind == "continuous":
            return continuous(r.opening, r.ramp, r.elapsed, asked.name)
        if asked.kind == "intermittent":
            return intermittent(r.opening, r.ramp, r.elapsed, asked.hold, asked.rest, asked.name)
        if asked.kind == "staged":
            return staged(r.opening, r.ramp, r.elapsed, asked.stages, asked.rest, asked.name)
        return Protocol(asked.name, tuple(asked.times), tuple(asked.opening))

    def ramp(self, name: str) -> Protocol:
        """The first opening alone."""
        r = self.scene.retraction
        return Protocol(name, (0.0, r.ramp), (0.0, r.opening))
