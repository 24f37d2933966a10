# ruff: noqa: RUF009  (what the calls in class bodies return is a dataclasses.field)
"""The body of a scene and its element sizes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, replace
from typing import TYPE_CHECKING

from ngbrain.mesh.routes.registry import ROUTES, openable_routes
from ngbrain.schema.document import Section
from ngbrain.schema.fields import choice, integer, number, path, registry_name

if TYPE_CHECKING:
    from ngbrain.scene import Scene

SCANNED = ("mni152", "scan")
"""Kinds of geometry that are heads of labels."""
HEADS = ("idealised", *SCANNED)
"""Kinds of geometry that are heads."""


@dataclass(frozen=True, kw_only=True)
class Geometry(Section):
    """The body that is loaded or operated on.

    Parameters
    ----------
    kind
        block: a box of tissue on the plane z = 0, centred at x = y = 0, of the region "tissue", with the
        boundaries left, right (x), front, back (y), bottom, top (z); idealised: a head of ellipsoids; mni152: the average brain
        distributed with nilearn; scan: the head of a T1 image (both, under loads, of the regions grey, white and ventricles,
        with the boundary skull); mesh: a volume mesh with named regions and boundaries.
    image
        Path of the T1 image (NIfTI) of a scan.
    file
        Path of a mesh (.vol, .vol.gz).
    unit
        Unit of the file's coordinates.
    size
        Edge lengths of the block along x, y and z (m).
    plate
        Sides along x and y (m) of a rectangle in the middle of the block's top, boundary "plate".
    lesion_radius
        Radius of a spherical lesion in the block, region "lesion".
    lesion_centre
        Centre of the lesion.
    slot
        Width between its walls (x) and depth (m) of a cut through the block's whole top, boundaries "wall_minus", "wall_plus".
    stiffness_map
        Path of a volume of shear moduli or shear stiffness in any unit, of a head: its ratio to the mean over each tissue
        multiplies that tissue's moduli.
    stiffness_map_space
        head: coordinates of the head; mni152: coordinates of the template, which is registered to the head.
    """

    kind: str = choice("kind", MISSING, ["block", *HEADS, "mesh"])
    image: str | None = path("image", None, "the path of a T1 image (NIfTI)")
    file: str | None = path("file", None, "the path of a mesh (.vol, .vol.gz)", (".vol", ".vol.gz"))
    unit: str | None = choice("unit", None, ["m", "mm"])
    size: tuple[float, float, float] | None = number("size_mm", None, size=3)
    plate: tuple[float, float] | None = number("plate_mm", None, size=2)
    lesion_radius: float | None = number("lesion_radius_mm", None)
    lesion_centre: tuple[float, float, float] | None = number("lesion_centre_mm", None, signed=True, size=3)
    slot: tuple[float, float] | None = number("slot_mm", None, size=2)
    stiffness_map: str | None = path("stiffness_map", None, "the path of a NIfTI file, or of a ZIP archive of one")
    stiffness_map_space: str | None = choice("stiffness_map_space", None, ["head", "mni152"])

    @property
    def is_head(self) -> bool:
        """Whether it is a head."""
        return self.kind in HEADS

    @property
    def sides(self) -> tuple[float, float, float]:
        """Size of a block along x, y and z (m); 0 for other geometries."""
        return self.size or (0.0, 0.0, 0.0)

    @property
    def centre(self) -> tuple[float, float, float]:
        """Centre of the lesion (m)."""
        return self.lesion_centre or (0.0, 0.0, 0.0)

    def _check(self, path: str, scene: Scene) -> None:
        for name, kind in (("image", "scan"), ("file", "mesh"), ("unit", "mesh"), ("size", "block")):
            wanted = f"a value for kind = {kind!r}, and no other kind"
            self._need((self.kind == kind) == (getattr(self, name) is not None), path, name, wanted)
        for name in ("plate", "lesion_radius", "lesion_centre", "slot"):
            fits = self.kind == "block" or getattr(self, name) is None
            self._need(fits, path, name, "this key left out: only a block has it")
        wanted = "this key left out: a head under loads does not have it yet; a [[tissue]] has shear_modulus_map"
        self._need(scene.cleft is not None or self.stiffness_map is None, path, "stiffness_map", wanted)
        mapped, space = self.stiffness_map is not None, self.stiffness_map_space is not None
        wanted = "this key left out: only the head of a person has a measured map"
        self._need(not mapped or self.kind in SCANNED, path, "stiffness_map", wanted)
        wanted = "head or mni152, to go with geometry.stiffness_map" if mapped else "this key only with a map"
        self._need(
            space if mapped and self.kind == "scan" else mapped or not space, path, "stiffness_map_space", wanted
        )
        if self.size:
            self._check_block(path, *self.size)

    def _check_block(self, path: str, x: float, y: float, z: float) -> None:
        plate, slot = self.plate or (0.0, 0.0), self.slot or (0.0, 0.0)
        self._need(plate[0] < x and plate[1] < y, path, "plate", f"less than the block's {1e3 * x:g} by {1e3 * y:g}")
        self._need(not (self.plate and self.slot), path, "slot", "this key or plate_mm, not both: they share the top")
        self._need(slot[0] < x / 2 and slot[1] < z, path, "slot", f"less than half of {1e3 * x:g}, and {1e3 * z:g}")
        wanted = "a place to go with lesion_radius_mm, and only with it"
        self._need((self.lesion_radius is None) == (self.lesion_centre is None), path, "lesion_centre", wanted)
        if self.lesion_radius and self.lesion_centre:
            r, (a, b, c) = self.lesion_radius, self.lesion_centre
            inside = abs(a) + r < x / 2 and abs(b) + r < y / 2 and r < c < z - r
            self._need(inside, path, "lesion_radius", "a ball inside the block, around lesion_centre_mm")


SIZES = ("largest", "wall", "craniotomy")
"""The element sizes of a mesh."""


@dataclass(frozen=True, kw_only=True)
class MeshSize(Section):
    """Element sizes, polynomial order and meshing route.

    Parameters
    ----------
    largest
        Size (m) of the elements away from the site; for a block or an idealised head under loads, in the coarsest mesh.
    wall
        Size on the walls of a cleft.
    craniotomy
        Size under the craniotomy.
    order
        Polynomial degree of the displacement; with model selection by tolerances it is selected too.
    route
        How the labels of a scan become tetrahedra. hull (the default): smooth surfaces of brain and ventricles, with the tissue of
        the label at each point; lattice, conforming: elements that follow the surfaces between tissues, as far as their sizes
        allow; or a route that is registered in `ngbrain.mesh.routes.registry`.
    """

    KEY = "mesh"

    largest: float = number("max_size_mm", 24e-3, least=0.5)
    wall: float = number("wall_size_mm", 3e-3, least=0.2)
    craniotomy: float = number("craniotomy_size_mm", 8e-3, least=0.5)
    order: int = integer("order", 2, 2, 4)
    route: str | None = registry_name("route", None, ROUTES)

    @property
    def meshing_route(self) -> str:
        """The meshing route of a scanned head."""
        return self.route or "hull"

    def with_scale(self, factor: float) -> MeshSize:
        """All element sizes multiplied by a factor.

        >>> MeshSize(wall=3e-3).with_scale(2.0).wall
        0.006
        """
        return replace(self, **{name: factor * getattr(self, name) for name in SIZES})

    def with_minimum(self, sizes: Mapping[str, float]) -> MeshSize:
        """No element size below those of the same name (m).

        >>> MeshSize(wall=3e-3, largest=24e-3).with_minimum({"wall": 4e-3, "largest": 14e-3})
        MeshSize(largest=0.024, wall=0.004, craniotomy=0.008, order=2, route=None)
        """
        return replace(self, **{name: max(size, getattr(self, name)) for name, size in sizes.items()})

    def _check(self, path: str, scene: Scene) -> None:
        scanned = scene.geometry.kind in SCANNED
        wanted = "this key left out: only a head of labels, geometry.kind mni152 or scan, is meshed by another route"
        self._need(scanned or self.route is None, path, "route", wanted)
        if scene.cleft is None:
            return
        wanted = f"a route that opens a cleft: {', '.join(openable_routes())}"
        self._need(self.meshing_route in openable_routes(), path, "route", wanted)
        self._need(
            self.craniotomy >= self.wall, path, "craniotomy", f"at least {self.toml_value('wall'):g}, mesh.wall_size_mm"
        )
        wanted = f"at least {self.toml_value('craniotomy'):g}, mesh.craniotomy_size_mm"
        self._need(self.largest >= self.craniotomy, path, "largest", wanted)
        self._need(self.largest >= 2e-3, path, "largest", "at least 2")
