# ruff: noqa: RUF009  (what the calls in class bodies return is a dataclasses.field)
"""The parts of an operation: cleft, tool, patient."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING
from typing import Protocol as Interface

import numpy as np

from ngbrain.errors import InputError
from ngbrain.mesh.geometry.cleft import Cleft
from ngbrain.schema.document import Section
from ngbrain.schema.fields import choice, number, path

if TYPE_CHECKING:
    from ngbrain.scene import Scene

WIDEST = 80e-3
"""Largest diameter (m) of a craniotomy; under a wider one the surface of the brain is too curved."""
NARROWEST = 4e-3
"""Smallest width (m) of a blade on whose face a pressure can be evaluated, away from its edges."""
KINDS = ["spatula", "two spatulas", "plate", "tube", "ball", "surface"]
SURFACES = (".stl", ".ply", ".obj", ".off")
FACED = 5e-3
"""Height (m) of the wall above a blade's tip over which the tip pressure is evaluated."""


class Openable(Interface):
    """Interface of a head, as far as a scene needs it; see `ngbrain.surgery.head_models`."""

    def point(self, voxel: Sequence[float]) -> np.ndarray:
        """Position (m) of a voxel of the scan's file, with indices from 0."""

    def cleft_to(
        self,
        target: np.ndarray,
        opening: float = ...,
        width: float = ...,
        approach: np.ndarray | None = None,
        across: np.ndarray | None = None,
    ) -> Cleft:
        """The cleft from the surface to a target.

        Parameters
        ----------
        target : (3,) array
            Centre (m) of the cleft's floor.
        opening, width : float
            Distance between the walls and width along them (m).
        approach : (3,) array, optional
            Direction outwards; by default the shortest route.
        across : (3,) array, optional
            Direction from wall to wall.

        Returns
        -------
        Cleft
        """


@dataclass(frozen=True, kw_only=True)
class CleftSpec(Section):
    """The cleft that is opened: a slot with plane walls from the brain's surface to a target (lengths in m).

    Parameters
    ----------
    target
        Centre of its floor, in the coordinates of the scan.
    voxel
        In place of that: the centre of its floor as a voxel of the scan's file, counted from 0.
    width
        Along the walls.
    gap
        Between the walls before retraction.
    craniotomy_diameter
        Of the hole in the skull.
    trajectory
        Direction from the target outwards; the shortest route by default.
    wall_normal
        Direction from wall to wall, in which the tool pushes; left to right by default.
    """

    KEY = "cleft"

    target: tuple[float, float, float] | None = number("target_mm", None, signed=True, size=3)
    voxel: tuple[float, float, float] | None = number("target_voxel", None, signed=True, size=3)
    width: float = number("width_mm", 12e-3)
    gap: float = number("gap_mm", 4e-3, least=0.1)
    craniotomy_diameter: float = number("craniotomy_diameter_mm", 40e-3)
    trajectory: tuple[float, float, float] | None = number("trajectory", None, signed=True, size=3)
    wall_normal: tuple[float, float, float] | None = number("wall_normal", None, signed=True, size=3)

    def _check(self, path: str, scene: Scene) -> None:
        diagonal = math.hypot(self.width, self.gap)
        wanted = f"at least 2 more than {1e3 * diagonal:.4g}, the diagonal of cleft.width_mm by cleft.gap_mm"
        self._need(self.craniotomy_diameter >= diagonal + 2e-3, path, "craniotomy_diameter", wanted)
        self._need(self.craniotomy_diameter <= WIDEST, path, "craniotomy_diameter", f"at most {1e3 * WIDEST:g}")
        for name in ("trajectory", "wall_normal"):
            largest = max(map(abs, getattr(self, name) or (1,)))
            self._need(1e-3 <= largest <= 1e3, path, name, "a direction: not all 0, and none beyond 1000")
        wanted = "a length in mm in each of 3 places, or cleft.target_voxel; not both"
        self._need((self.target is None) != (self.voxel is None), path, "target", wanted)
        of_scan = scene.geometry.kind != "idealised"
        self._need(of_scan or self.voxel is None, path, "voxel", "cleft.target_mm: the idealised head has no voxels")
        self._need(max(map(abs, self.target or (0,))) < 1, path, "target", "a point inside the brain")
        wanted = "a direction: the target is at the centre of the brain, cleft.target_mm = [0, 0, 0], so no route is shortest"
        self._need(of_scan or self.trajectory or any(self.target or ()), path, "trajectory", wanted)

    def slot(self, head: Openable) -> Cleft:
        """The cleft in a head; raises `InputError` where it does not fit."""
        directions = [None if way is None else np.array(way) for way in (self.trajectory, self.wall_normal)]
        target = head.point(self.voxel) if self.voxel else np.array(self.target)
        return head.cleft_to(target, self.gap, self.width, *directions)

    def wall(self, head: Openable) -> float:
        """Height (m) of the pushed wall, from floor to surface, at its centre."""
        slot = self.slot(head)
        try:
            return head.cleft_to(slot.target + slot.opening / 2 * slot.across, approach=slot.out).depth
        except InputError:
            wanted = "so small that the walls begin in tissue, as cleft.target_mm does"
            raise InputError("cleft.gap_mm", self.toml_value("gap"), wanted) from None


@dataclass(frozen=True, kw_only=True)
class Tool(Section):
    """The retractor that opens the cleft (lengths in m).

    Parameters
    ----------
    kind
        spatula: pushes one wall; two spatulas: push both walls, half of the travel each; plate: a spatula that ends below the
        surface; tube: expands between both walls; ball: pushes one wall; surface: your own closed surface, that of `file`.
    travel
        Its displacement from first contact with the wall.
    width
        Along the walls; of a tube, the width of the wall over which pressure is evaluated; of a ball, its diameter.
    edge_radius
        Rounding of its edges and its tip.
    tip_clearance
        Height of its tip above the cleft's floor.
    thickness
        Front to back.
    tip_width
        Of a spatula that widens from its tip to the surface.
    face_radius
        Of a spatula's face that bulges towards the tissue.
    height
        Of a plate, from its tip to its upper edge.
    file
        Path of a closed surface (.stl, .ply, .obj, .off) in mm: x is the direction in which the tool pushes, y along the wall,
        z out of the cleft. Its foremost point is placed at the unloaded wall, its lowest at `tip_clearance`; edges are rounded
        by about half a millimetre.
    friction
        Coefficient of Coulomb friction between tool and tissue.
    """

    kind: str = choice("kind", "spatula", KINDS)
    travel: float = number("travel_mm", 5e-3, least=0.01)
    width: float = number("width_mm", 10e-3)
    edge_radius: float = number("edge_radius_mm", 2e-3, least=1.0)
    tip_clearance: float = number("tip_clearance_mm", 4e-3)
    thickness: float = number("thickness_mm", 4e-3)
    tip_width: float | None = number("tip_width_mm", None)
    face_radius: float | None = number("face_radius_mm", None)
    height: float | None = number("height_mm", None)
    file: str | None = path("file", None, "the path of a closed surface (.stl, .ply, .obj, .off)", SURFACES)
    friction: float = number("friction", 0.0, least=0.0)

    def _check(self, path: str, scene: Scene) -> None:
        cleft, own = scene.operated, {"plate": "height", "surface": "file"}.get(self.kind)
        for name, kind in (("height", "plate"), ("file", "surface")):
            wanted = f"a value for kind = {kind!r}, and no other kind"
            self._need((name == own) == (getattr(self, name) is not None), path, name, wanted)
        self._need(
            self.friction <= 1, path, "friction", "at most 1: the largest tangential force over the normal force"
        )
        if self.kind == "surface":  # its sizes are the file's
            return
        wanted = f"at most {cleft.toml_value('width'):g}, cleft.width_mm: not a tool wider than the cleft"
        self._need(self.width <= cleft.width, path, "width", wanted)
        if self.kind == "ball":
            wanted = f"at most {cleft.toml_value('gap'):g}, cleft.gap_mm: not a ball that does not fit into the cleft"
            self._need(self.width <= cleft.gap, path, "width", wanted)
            self._need(self.width >= NARROWEST, path, "width", f"at least {1e3 * NARROWEST:g}")
            for name in ("tip_width", "face_radius"):
                self._need(getattr(self, name) is None, path, name, "this key left out: a ball has no face")
            return
        wanted = f"at most {cleft.toml_value('gap'):g}, cleft.gap_mm: not a tool thicker than the cleft"
        self._need(self.thickness <= cleft.gap, path, "thickness", wanted)
        least = f"at least {1e3 * NARROWEST:g}, and twice tool.edge_radius_mm = {self.toml_value('edge_radius'):g}"
        self._need(self.width >= max(NARROWEST, 2 * self.edge_radius), path, "width", least)
        if self.kind == "tube":
            self._check_tube(path, scene)
            return
        fits = self.tip_width is None or max(NARROWEST, 2 * self.edge_radius) <= self.tip_width <= self.width
        self._need(fits, path, "tip_width", f"{least}, and at most {self.toml_value('width'):g}, tool.width_mm")
        tall = self.height is None or self.height >= max(FACED, 2 * self.edge_radius)
        least = f"at least {1e3 * FACED:g}, and twice tool.edge_radius_mm = {self.toml_value('edge_radius'):g}"
        self._need(tall, path, "height", least)

    def _check_tube(self, path: str, scene: Scene) -> None:
        for name in ("tip_width", "face_radius"):
            self._need(getattr(self, name) is None, path, name, "this key left out: a tube has no face")
        cleft = scene.operated
        wanted = f"at most {cleft.toml_value('gap') / 2:g}, half of cleft.gap_mm: the tube's radius at first"
        self._need(self.edge_radius <= cleft.gap / 2, path, "edge_radius", wanted)
        widest = f"a spatula: a tube of {1e3 * (cleft.gap + self.travel):g} mm, cleft.gap_mm and tool.travel_mm"
        wanted = f"{widest} together, does not fit into cleft.width_mm = {cleft.toml_value('width'):g}"
        self._need(cleft.gap + self.travel <= cleft.width, path, "kind", wanted)

    def _check_wall(self, path: str, wall: float) -> None:
        faced = min(FACED, self.width) if self.kind == "ball" else FACED
        wanted = f"{1e3 * faced:g} or more below {1e3 * wall:.4g}, the height of the wall over cleft.target_mm"
        self._need(self.tip_clearance + faced <= wall, path, "tip_clearance", wanted)
        wanted = f"at most {1e3 * wall:.4g}, the height of the wall over cleft.target_mm"
        self._need(self.travel <= wall, path, "travel", wanted)
        wanted = f"at least {1e3 * wall:.4g}, the height of the wall over cleft.target_mm"
        self._need(self.face_radius is None or self.face_radius >= wall, path, "face_radius", wanted)


@dataclass(frozen=True, kw_only=True)
class Patient(Section):
    """Pressures of the patient (mmHg). Without them perfusion is not evaluated.

    Parameters
    ----------
    mean_arterial_pressure
        Mean arterial pressure in the brain.
    intracranial_pressure
        Taken as 0 where it is not given.
    """

    mean_arterial_pressure: float | None = number("mean_arterial_pressure_mmHg", None)
    intracranial_pressure: float | None = number("intracranial_pressure_mmHg", None, least=0.0)

    def _check(self, path: str, scene: Scene) -> None:
        arterial, intracranial = self.mean_arterial_pressure, self.intracranial_pressure
        self._need(
            arterial is None or 20 <= arterial <= 300, path, "mean_arterial_pressure", "a pressure of 20 to 300 mmHg"
        )
        self._need(
            intracranial is None or arterial is not None,
            path,
            "intracranial_pressure",
            "a value only with patient.mean_arterial_pressure_mmHg",
        )
        wanted = f"less than patient.mean_arterial_pressure_mmHg, {arterial or 0:g}"
        self._need(intracranial is None or intracranial < (arterial or 0), path, "intracranial_pressure", wanted)
