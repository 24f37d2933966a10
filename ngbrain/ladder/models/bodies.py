"""The problems of a scene's models: materials, supports, loads, elements."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from functools import cached_property
from weakref import WeakKeyDictionary

import ngsolve as ngs
import numpy as np

from ngbrain.errors import InputError
from ngbrain.forward.common.dirichlet import Support
from ngbrain.forward.common.loads import Load, PressureLoad, RigidFace, TractionLoad
from ngbrain.forward.common.material import Material
from ngbrain.forward.common.rigid_motions import check_held
from ngbrain.forward.contact.friction import Friction
from ngbrain.forward.contact.parameters import FILM
from ngbrain.forward.contact.rigid import SlidingSupport, WallContact
from ngbrain.forward.solid.inertia import Inertia
from ngbrain.forward.solid.problem import Problem
from ngbrain.image.read.fibre_directions import read_fibre_directions
from ngbrain.image.read.volume import Volume
from ngbrain.ladder.adaptivity import SHARE, element_contributions, mark_elements
from ngbrain.ladder.levels import MeshLevel, Model
from ngbrain.ladder.models import motions
from ngbrain.ladder.models.contacts import make_contact, travel_distance
from ngbrain.ladder.models.geometry import CUT, Meshes, region_of_interest
from ngbrain.ladder.models.gravity import gravity_loads
from ngbrain.ladder.models.laws import form_of, relaxed_law
from ngbrain.ladder.models.motions import PrescribedMotion
from ngbrain.ladder.models.property_maps import fibre_field, interpolate_map, read_modulus_map, region_median
from ngbrain.ladder.models.section import not_in_section
from ngbrain.ladder.quantities import (
    Asked,
    BodyState,
    Question,
    check_questions,
    direction_in_mesh,
    mesh_components,
)
from ngbrain.ladder.singular_edges import find_singular_edges
from ngbrain.materials import Viscous
from ngbrain.materials.base import Law, Value
from ngbrain.materials.families import hereditary_form, instantaneous_law, scale, stiffen
from ngbrain.materials.fibre import Fibre
from ngbrain.scene import DisplacementBC, Scene, Tissue

Array = np.ndarray
SMALL = 1e-4
"""Load factor at which strains are small enough to be linear to four digits."""
FIRM = 3e3
"""Penalty stiffness of a rigid face, in moduli over its size: the pressure is about twice the displacement, in the same units."""


class SceneBodies:
    """A scene's meshes, and its problems for any model.

    Parameters
    ----------
    scene : Scene
    questions : sequence of Question
        Observables in addition to the scene's quantities.
    """

    def __init__(self, scene: Scene, questions: Sequence[Question] = ()) -> None:
        self.scene, part = scene, region_of_interest(scene.geometry)
        self.init_arguments = (scene, tuple(questions))
        """Arguments with which another process rebuilds it."""
        self.questions: tuple[Asked, ...] = (*scene.quantities, *questions)
        check_questions(self.questions, scene, questions)
        size, route = scene.mesh.largest, scene.mesh.meshing_route
        self._meshes = {"whole": Meshes(scene.geometry, size, route)} | ({"near": Meshes(part, size)} if part else {})
        self._cut = dict[tuple[str, bool, int], ngs.Mesh]()
        self._maps = dict[str, Volume]()
        self._courses = WeakKeyDictionary[Problem, PrescribedMotion]()

    def mesh(self, model: Model) -> ngs.Mesh:
        """The mesh of a model; `InputError` for the section of a scene that does not lie in it."""
        extent, plane = model.get("extent", "whole"), model.get("space") == "plane"
        if plane and (beyond := not_in_section(self.scene, self.init_arguments[1])):
            raise InputError("space", "'plane'", f"'solid': {beyond}")
        mesh = MeshLevel(model["mesh"])
        level = mesh.halvings
        if not mesh.is_partial:
            return self._meshes[extent].mesh(level, plane)
        key = extent, plane, level
        if key not in self._cut:
            self._cut[key] = self._meshes[extent].refine_elements(
                level, plane, mark_elements(self.left_out(*key), SHARE[3 - plane])
            )
        return self._cut[key]

    def left_out(self, extent: str, plane: bool, level: int) -> Array:
        """Contribution of each element to the error of the linear elastic body, see `adaptivity`.

        Parameters
        ----------
        extent : str
            "near" or "whole".
        plane : bool
            Whether it is the section.
        level : int
            Number of uniform refinements.

        Returns
        -------
        (ne,) array
        """
        time = "relaxed" if any(tissue.law().branches for tissue in self.scene.tissues) else "instantaneous"
        place = {"extent": extent, "space": "plane" if plane else "solid", "mesh": str(level)}
        model = {**place, "strain": "linear", "time": time, "fibres": "all", "order": "1"}
        body, rich = (self.static({**model, "order": order}, self.time("end")) for order in ("1", "2"))
        return element_contributions(self.state(model, body, linear_state(body)), rich, self.questions)

    @property
    def nested(self) -> bool:
        """Whether elements are unions of those of the next finer mesh."""
        return self.scene.geometry.kind != "idealised"

    @cached_property
    def singular_edges(self) -> list[str]:
        """Warnings on forces that diverge at edges."""
        return find_singular_edges(self.scene, self._meshes["whole"].mesh(0, plane=False))

    @cached_property
    def sides(self) -> tuple[float, ...]:
        """Size of the body along each axis (m)."""
        points = [vertex.point for vertex in self._meshes["whole"].mesh(0, plane=False).vertices]
        return tuple(np.ptp(points, axis=0).tolist())

    @property
    def longest(self) -> float:
        """The body's longest side (m)."""
        return max(self.sides)

    @cached_property
    def largest(self) -> str:
        """The region with the largest volume."""
        mesh = self._meshes["whole"].mesh(0, plane=False)
        volumes = {name: ngs.Integrate(ngs.CF(1) * ngs.dx(name), mesh) for name in sorted(set(mesh.GetMaterials()))}
        return max(volumes, key=lambda name: volumes[name])

    def tissue(self, region: str, model: Model) -> Tissue:
        """The tissue of a region; with one tissue for all regions, that with the largest volume.

        Parameters
        ----------
        region : str
        model : mapping of str

        Returns
        -------
        Tissue

        Raises
        ------
        InputError
            No tissue, or several, for the region.
        """
        found = [tissue for tissue in self.scene.tissues if re.fullmatch(tissue.region, region)]
        if not found:
            raise InputError("tissue", f"none for region {region!r}", "one whose region matches it")
        if len(found) > 1:
            one, other = (self.scene.tissues.index(each) + 1 for each in found[:2])
            what = f"{found[1].region!r}, which has region {region!r} as tissue#{one} ({found[0].region!r}) does"
            raise InputError(f"tissue#{other}.region", what, "patterns of which one matches a region")
        if model.get("tissue") == "one":
            return self.tissue(self.largest, {})
        return found[0]

    def factor(self, region: str, model: Model) -> Value:
        """Factor of the moduli of a region's tissue: its map relative to them, or the map's median over the region.

        Parameters
        ----------
        region : str
        model : mapping of str

        Returns
        -------
        float or CoefficientFunction
        """
        if model.get("tissue") == "one":
            return self.factor(self.largest, {**model, "tissue": "each"})
        tissue = self.tissue(region, {})
        if tissue.shear_modulus_map is None:
            return 1.0
        if tissue.shear_modulus_map not in self._maps:
            self._maps[tissue.shear_modulus_map] = read_modulus_map(tissue.shear_modulus_map)
        if model.get("tissue") == "map":
            return interpolate_map(self._maps[tissue.shear_modulus_map], self.mesh(model)) / tissue.initial_modulus
        mesh = self._meshes["whole"].mesh(0, plane=False)
        return (
            region_median(interpolate_map(self._maps[tissue.shear_modulus_map], mesh), region) / tissue.initial_modulus
        )

    def _fibre(self, tissue: Tissue, mesh: ngs.Mesh, region: str) -> Fibre:
        """Fibre direction in a region, constant or a field."""
        if tissue.fibre is not None:
            return direction_in_mesh(tissue.fibre, mesh.dim == 2)
        directions = read_fibre_directions(str(tissue.fibre_map), str(tissue.fibre_map_convention))
        return fibre_field(directions, mesh, np.array([each.mat == region for each in mesh.Elements()]))

    def _face(self, mesh: ngs.Mesh, bc: DisplacementBC) -> RigidFace:
        """A rigid face that pushes a boundary; `InputError` where it would push from within the body."""
        by = mesh_components(tuple(float(each) for each in bc.value), mesh.dim == 2)  # type: ignore[arg-type]
        area, outward = (
            ngs.Integrate(value * ngs.ds(bc.boundary), mesh)
            for value in (ngs.CF(1), ngs.InnerProduct(ngs.CF(by), ngs.specialcf.normal(mesh.dim)))
        )
        if outward > -0.1 * area * math.hypot(*by):
            raise InputError(
                "displacement_bc.value_mm", bc.toml_value("value"), "into the body, of a frictionless face"
            )
        modulus = self.factor(self.largest, {}) * self.tissue(self.largest, {}).initial_modulus
        return RigidFace(bc.boundary, by, float(FIRM * modulus / area ** (1 / (mesh.dim - 1))))

    @cached_property
    def crossing(self) -> float:
        """Transit time (s) of a shear wave along the longest side, in the largest region."""
        most = self.tissue(self.largest, {})
        modulus = self.factor(self.largest, {}) * most.initial_modulus
        return float(self.longest * math.sqrt(most.rho / modulus))

    def static(self, model: Model, t: float) -> Problem:
        """The elastic problem of a model at time t, with the relaxed moduli of that time if the model has them.

        Parameters
        ----------
        model : mapping of str
        t : float
            Time (s).

        Returns
        -------
        Problem
        """
        return self._driven(model, t, lambda part: (part * t, part))

    def relaxing(self, model: Model, t: float) -> Problem:
        """The transient problem of a model with viscoelasticity or inertia.

        Parameters
        ----------
        model : mapping of str
        t : float
            Time (s) of the moduli where the model is elastic but relaxed.

        Returns
        -------
        Problem
        """
        return self._driven(model, t, lambda moment: (moment, min(moment / self.scene.time.ramp, 1.0)))

    def course(self, body: Problem) -> PrescribedMotion:
        """The prescribed motion of one of its problems over time; for problems at rest, times are proportional to the load."""
        return self._courses[body]

    def _driven(self, model: Model, t: float, moment: Callable[[float], tuple[float, float]]) -> Problem:
        course = PrescribedMotion(moment, model.get("space") == "plane")
        body = Problem(*self._parts(model, self._law(model, t), course), element=form_of(model))
        self._courses[body] = course
        return course.drive(body)

    def _law(self, model: Model, t: float) -> Callable[[Viscous, Value], Law | Viscous]:
        """From a tissue's law and the factor of its moduli to the law of the model."""
        level, ramp = model.get("time", "instantaneous"), self.scene.time.ramp
        laws: dict[str, Callable[[Viscous, Value], Law | Viscous]] = {
            "instantaneous": lambda law, factor: scale(instantaneous_law(law), factor),
            "relaxed": lambda law, factor: scale(relaxed_law(law, ramp, t), factor),
            "prony": lambda law, factor: stiffen(hereditary_form(law), factor),
            "flowing": stiffen,
        }
        return laws[level]

    def state(self, model: Model, body: Problem, x: Array) -> BodyState:
        """The state of a model's body for evaluating quantities.

        Parameters
        ----------
        model : mapping of str
        body : Problem
        x : (ndof,) array
            Its unknowns.

        Returns
        -------
        BodyState
        """
        linear = model["strain"] == "linear"
        return BodyState(body, x, SMALL if linear else 1.0, linear, self.thickness_of(model))

    def thickness_of(self, model: Model) -> float:
        """Thickness (m) of a section: that of the loaded part; 1 for a body in space."""
        geometry = self.scene.geometry
        if model.get("space") != "plane":
            return 1.0
        return geometry.plate[1] if geometry.plate else geometry.sides[1]

    def time(self, when: str) -> float:
        """Time (s) of a question."""
        time = self.scene.time
        return time.ramp if when == "ramp" else time.end

    def _parts(
        self, model: Model, law: Callable[[Viscous, Value], Law | Viscous], course: PrescribedMotion
    ) -> tuple[ngs.Mesh, dict[str, Material], dict[str, Support], list[Load | Inertia], list[WallContact | Friction]]:
        mesh, scene = self.mesh(model), self.scene
        plane, names = mesh.dim == 2, set(mesh.GetBoundaries())
        materials, weights = {}, {}
        for region in sorted(set(mesh.GetMaterials())):
            tissue, factor = self.tissue(region, model), self.factor(region, model)
            own = tissue.law()
            if tissue.fibre_stiffness is not None and model.get("fibres") == "all":
                own = tissue.with_fibres(own, self._fibre(tissue, mesh, region))
            materials[region], weights[region] = (
                Material(law(own, factor), factor * tissue.bulk, swelling=tissue.swelling),
                tissue.rho,
            )
        motions.check(self.scene, self._meshes["whole"].mesh(0, plane=False), self.sides)
        motions.check_apart(self.scene, names)
        supports: dict[str, Support] = {}
        loads: list[Load | Inertia] = [
            *(TractionLoad(traction.boundary, course.vector(traction.value)) for traction in scene.tractions),
            *(PressureLoad(pressure.boundary, course.value(pressure.value)) for pressure in scene.pressures),
        ]
        sliding = list[DisplacementBC]()
        for bc in scene.displacement_bcs:
            if not any(re.fullmatch(bc.boundary, name) for name in names):
                if plane:  # the faces in front and behind
                    continue
                raise InputError("displacement_bc.boundary", repr(bc.boundary), f"one of {', '.join(sorted(names))}")
            if bc.contact == "frictionless" and model.get("contact") == "all":
                loads.append(self._face(mesh, bc))
                continue
            if bc.contact == "sliding" and model.get("contact") == "all":
                sliding.append(bc)
                continue
            supports[bc.boundary] = course.support(bc)
        if model.get("extent") == "near":
            supports |= {name: 0 for name in CUT if name in names}
        density = mesh.MaterialCF(weights)
        if model.get("inertia") == "all":
            loads.append(Inertia(density))
        loads += gravity_loads(scene, mesh, density)
        stiffest = max(self.tissue(region, model).initial_modulus for region in materials)
        touches: list[WallContact | Friction] = [
            SlidingSupport.on(mesh, bc.boundary, FILM * stiffest) for bc in sliding
        ]
        touches += [
            each
            for body in scene.contacts
            for each in make_contact(
                body,
                course,
                stiffest,
                travel_distance(body, scene.time.end, self.longest),
                model.get("friction") == "all",
            )
        ]
        return mesh, materials, supports, loads, touches


def linear_state(body: Problem) -> Array:
    """Solution of the linear problem: the first Newton step from rest under a small load."""
    if not any(isinstance(each, SlidingSupport) for each in body.contacts):
        check_held(body.supports, body.loads, body.kinematics, "xyz" if body.mesh.dim == 3 else "xz")
    rest = np.zeros(body.fes.ndof)
    step = body.factorise(body.load(rest, 0.0), rest)
    lifted = body.load(rest, SMALL)
    return lifted - step(body.residual(lifted)[0])
