"""Heads to operate on: the idealised head of ellipsoids and heads from T1 scans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import ngsolve as ngs
import numpy as np

from ngbrain.forward.common.interpolation import quadrature_field, quadrature_points
from ngbrain.image import Scan, Volume, mni152, read_scan
from ngbrain.image.labelling import label_tissues, template_affine
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.label_schemes import TISSUES
from ngbrain.image.read.property_maps import read_map
from ngbrain.image.segment.tissue_classes import NAMES, VENTRICLE, WHITE
from ngbrain.look import BriefText
from ngbrain.mesh import Cleft, Sizes, idealised_head, smallest_angles
from ngbrain.mesh.geometry import primitives
from ngbrain.mesh.routes.craniotomy import find_cleft
from ngbrain.mesh.routes.heads import GREY_MATTER, WHITE_MATTER, open_head_of_tissues
from ngbrain.mesh.routes.registry import find_route
from ngbrain.mesh.surface.head_outlines import BRAIN, VENTRICLES, Outlines, outlines
from ngbrain.scene import Geometry, Scene
from ngbrain.scene.operation import Openable

FIBRES = "fibres, and "
"""Part of the list of limitations that is dropped if a tissue has fibres."""
PART = "."
"""Separator between a region's name and the number of one of its parts."""


class Head(Openable, Protocol):
    """Interface of a head before the cleft is opened.

    Attributes
    ----------
    stiffness : Volume or None
        Measured map of shear moduli in the head's space, NaN without a measurement.
    """

    stiffness: Volume | None

    @property
    def left_out(self) -> str:
        """Limitations of the model of the head, in words."""

    def open_cleft(self, cleft: Cleft, craniotomy: float, sizes: Sizes) -> ngs.Mesh:
        """Mesh the head with an open cleft.

        Parameters
        ----------
        cleft : Cleft
        craniotomy : float
            Diameter (m) of the craniotomy.
        sizes : Sizes
            Element sizes (m).

        Returns
        -------
        ngs.Mesh
            With its regions and the boundaries `skull`, `craniotomy` and those of the cleft.
        """

    def mixtures(self, mesh: ngs.Mesh, order: int) -> dict[str, dict[str, Any]]:
        """Volume fractions of the tissues in each region.

        Parameters
        ----------
        mesh : ngs.Mesh
            Regions of a split mesh (`split_region`) have the name of the original region and a number.
        order : int
            Order of the elements whose quadrature points are used.

        Returns
        -------
        dict
            Region → tissue → fraction: 1, or a field that is 0 or 1 at the quadrature points.
        """

    def describe(self, mesh: ngs.Mesh) -> dict[str, Any]:
        """Description of the head for `result.json`."""

    def pictures(self) -> dict[str, np.ndarray]:
        """Images for the report: T1, labels and their position; empty without a scan."""


class IdealisedHead(primitives.Ellipsoids):
    """The idealised head of ellipsoids, see `ngbrain.mesh.idealised_head`."""

    left_out = "pia, dura, vessels and the sulci of the cortex; the head is an idealised shape"
    stiffness: Volume | None = None
    open_cleft = staticmethod(idealised_head)

    def mixtures(self, mesh: ngs.Mesh, order: int) -> dict[str, dict[str, Any]]:
        """Every region is one tissue.

        Parameters
        ----------
        mesh : ngs.Mesh
        order : int

        Returns
        -------
        dict
            Region → tissue → 1.
        """
        return {name: {name: 1.0} for name in mesh.GetMaterials()}

    def describe(self, mesh: ngs.Mesh) -> dict[str, Any]:
        """The source of the geometry."""
        return {"source": "idealised head of ellipsoids"}

    def pictures(self) -> dict[str, np.ndarray]:
        """No images."""
        return {}


@dataclass(eq=False, repr=False)
class ScannedHead(BriefText):
    """A head from a T1 scan: tissue labels, and smooth outlines of the brain and its ventricles.

    Parameters
    ----------
    scan : Scan
    labels : Volume
        Tissue labels (`ngbrain.image.segment.tissue_classes`).
    stiffness : Volume, optional
        Map of shear moduli in the head's space.
    route : str
        Meshing route (`ngbrain.mesh.routes.registry`).
    """

    scan: Scan
    labels: Volume
    outlines: Outlines = field(init=False)
    stiffness: Volume | None = None
    route: str = "hull"

    def __post_init__(self) -> None:
        self.outlines = outlines(LabelMap(self.labels, TISSUES))

    @classmethod
    def from_scan(cls, scan: Scan, route: str = "hull") -> ScannedHead:
        """From a T1 scan of a whole head or of a brain (`label_tissues`); raises `InputError` for other images.

        Parameters
        ----------
        scan : Scan
        route : str
            Meshing route.

        Returns
        -------
        ScannedHead
        """
        return cls(scan, label_tissues(scan).volume, route=route)

    @property
    def left_out(self) -> str:
        """Limitations of the model, in words."""
        way = find_route(self.route)
        inside, more = ("", f"{way.left_out}; ") if way.conforms else (" inside the hull", "")
        return (
            f"pia, dura, vessels and the sulci of the cortex: sulcal fluid{inside} takes grey matter's law; {more}"
            f"{FIBRES}differences between parts of grey and of white matter"
        )

    def point(self, voxel: Sequence[float]) -> np.ndarray:
        """Centre (m) of a voxel of the file, with indices from 0."""
        return np.asarray((self.scan.file_affine @ [*voxel, 1.0])[:3])

    def cleft_to(
        self,
        target: np.ndarray,
        opening: float = 4e-3,
        width: float = 12e-3,
        approach: np.ndarray | None = None,
        across: np.ndarray | None = None,
    ) -> Cleft:
        """The cleft to a target in tissue.

        Parameters
        ----------
        target : (3,) array
            Centre (m) of the cleft's floor.
        opening, width : float
            Distance between the walls and width along them (m).
        approach : (3,) array, optional
            Direction from the target outwards; by default the shortest way to the surface.
        across : (3,) array, optional
            Direction from wall to wall.

        Returns
        -------
        Cleft
        """
        target = np.asarray(target, float)
        shape = self.outlines
        return find_cleft(shape.brain, shape.ventricles, target, opening, width, approach, across)

    def open_cleft(self, cleft: Cleft, craniotomy: float, sizes: Sizes) -> ngs.Mesh:
        """The mesh with an open cleft, from the cache or made by the head's route.

        Parameters
        ----------
        cleft : Cleft
        craniotomy : float
            Diameter (m).
        sizes : Sizes
            Element sizes (m).

        Returns
        -------
        ngs.Mesh

        Raises
        ------
        InputError
            The route opens no cleft, or it fails.
        """
        return open_head_of_tissues(self.labels, cleft, craniotomy, self.route, sizes).mesh()

    def mixtures(self, mesh: ngs.Mesh, order: int) -> dict[str, dict[str, Any]]:
        """Regions that are tissues, or grey and white matter by the nearest voxel; other tissue, mainly sulcal fluid, counts as
        grey matter.

        Parameters
        ----------
        mesh : ngs.Mesh
        order : int
            Order of the elements.

        Returns
        -------
        dict
            Region → tissue → fraction.
        """
        names = mesh.GetMaterials()
        parts: dict[str, dict[str, Any]] = {name: {name: 1.0} for name in (GREY_MATTER, WHITE_MATTER, VENTRICLES)}
        if any(name.partition(PART)[0] == BRAIN for name in names):
            parts[BRAIN] = self._tissues_of_points(mesh, order)
        return {name: parts[name.partition(PART)[0]] for name in names}

    def _tissues_of_points(self, mesh: ngs.Mesh, order: int) -> dict[str, Any]:
        """Grey and white matter at the quadrature points."""
        space, points = quadrature_points(mesh, order - 1)
        found = self.labels.interpolate(points, order=0)
        return {
            GREY_MATTER: quadrature_field(space, found != WHITE),
            WHITE_MATTER: quadrature_field(space, found == WHITE),
        }

    def describe(self, mesh: ngs.Mesh) -> dict[str, Any]:
        """The source, volumes (ml) of labels and mesh, and the smallest dihedral angle (degrees)."""
        ml = 1e6 * self.labels.voxel_volume
        counts = np.bincount(self.labels.data.ravel(), minlength=len(NAMES)) * ml
        names = dict(zip(NAMES, counts.tolist(), strict=True))
        return {
            "source": self.scan.source,
            "label_volumes_ml": {name: value for name, value in names.items() if name != "outside"},
            "label_brain_ml": float(counts[1:].sum() - counts[VENTRICLE]),
            "min_dihedral_deg": float(smallest_angles(_corners(mesh)).min()),
        }

    def pictures(self) -> dict[str, np.ndarray]:
        """The T1 in 256 grey levels, the labels, and the position of their first voxel (m)."""
        t1, spacing = self.scan.volume.data, self.labels.spacing[0]
        low, high = t1.min(), np.quantile(t1[self.labels.data > 0], 0.999)
        steps = (255 * ((t1 - low) / (high - low)).clip(0, 1)).astype(np.uint8)
        place = {"origin_m": self.labels.affine[:3, 3], "spacing_m": np.asarray(spacing)}
        return {"t1": steps, "labels": self.labels.data, **place}


def tissue_elements(mesh: ngs.Mesh, region: str, shares: dict[str, Any]) -> dict[str, np.ndarray]:
    """Elements of a region in which each tissue has a quadrature point.

    Parameters
    ----------
    mesh : ngs.Mesh
    region : str
    shares : dict
        Tissue → fraction, 1 or a field at the quadrature points.

    Returns
    -------
    dict of (ne,) bool array
        By tissue.
    """
    inside = _indices(mesh) == mesh.GetMaterials().index(region) + 1
    found = {}
    for name, share in shares.items():
        is_field = isinstance(share, ngs.GridFunction)
        found[name] = inside & (share.vec.FV().NumPy().reshape(mesh.ne, -1) > 0.5).any(axis=1) if is_field else inside
    return found


def split_region(mesh: ngs.Mesh, region: str, groups: Sequence[np.ndarray]) -> ngs.Mesh:
    """Split a region of a mesh by groups of elements, so that every part needs the energies of its own groups only.

    Parameters
    ----------
    mesh : ngs.Mesh
    region : str
    groups : sequence of (ne,) bool array
        Elements that are in the same groups form one part. Elements in all groups keep the region's name.

    Returns
    -------
    ngs.Mesh
    """
    made, own = mesh.ngmesh.Copy(), mesh.GetMaterials().index(region) + 1
    kinds = np.sum([np.where(group, 1 << i, 0) for i, group in enumerate(groups)], axis=0)
    inside = _indices(mesh) == own
    numbers = {(1 << len(groups)) - 1: own}
    for kind in np.unique(kinds[inside]).tolist():
        if kind not in numbers:
            numbers[kind] = len(mesh.GetMaterials()) + len(numbers)
            made.SetMaterial(numbers[kind], f"{region}{PART}{kind}")
    for element, kind, mine in zip(made.Elements3D(), kinds.tolist(), inside.tolist(), strict=True):
        if mine:
            element.index = numbers[kind]
    return ngs.Mesh(made)


def _indices(mesh: ngs.Mesh) -> np.ndarray:
    """Region number of every element, from 1 on."""
    return np.asarray(mesh.ngmesh.Elements3D().NumPy()["index"])


def load_head(geometry: Geometry, route: str = "hull") -> Head:
    """The head of a scene's geometry.

    Parameters
    ----------
    geometry : Geometry
    route : str
        Meshing route of a scanned head (`Scene.mesh.meshing_route`).

    Returns
    -------
    Head

    Raises
    ------
    InputError
        The scan cannot be used.
    """
    if geometry.kind == "idealised":
        return IdealisedHead()
    scan = mni152() if geometry.kind == "mni152" else read_scan(str(geometry.image))
    head = ScannedHead.from_scan(scan, route)
    return replace(head, stiffness=_stiffness(geometry, scan)) if geometry.stiffness_map else head


def _stiffness(geometry: Geometry, scan: Scan) -> Volume:
    """The scene's stiffness map in the head's space."""
    found = read_map(str(geometry.stiffness_map), "shear moduli or shear stiffness")
    if geometry.kind == "mni152" or geometry.stiffness_map_space == "head":
        return found
    return Volume(found.data, template_affine(scan) @ found.affine)


def _corners(mesh: ngs.Mesh) -> np.ndarray:
    """Corners (n, 4, 3) of the tetrahedra (m)."""
    return np.asarray(mesh.ngmesh.Coordinates()[mesh.ngmesh.Elements3D().NumPy()["nodes"][:, :4] - 1])


def transfer_scene(scene: Scene, image: str) -> Scene:
    """Transfer a scene on the MNI152 head to the corresponding target in another scan, by registration of the template.

    Parameters
    ----------
    scene : Scene
    image : str
        Path of the T1 scan.

    Returns
    -------
    Scene
    """
    cleft = scene.operated
    space = "mni152" if scene.geometry.stiffness_map else None
    geometry = replace(scene.geometry, kind="scan", image=image, stiffness_map_space=space)
    target = template_affine(read_scan(image)) @ [*(cleft.target or ()), 1.0]
    title = scene.title.replace("the MNI152 average brain", Path(image).name)
    return replace(scene, title=title, geometry=geometry, cleft=replace(cleft, target=tuple(target[:3].tolist())))
