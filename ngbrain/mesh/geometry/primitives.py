"""Shapes made by Open CASCADE: a block and an idealised head, with named regions and boundaries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import netgen.meshing as meshing
import netgen.occ as occ
import ngsolve as ngs
import numpy as np
import scipy

from ngbrain.arguments import number, numbers
from ngbrain.errors import InputError, nearest
from ngbrain.mesh.geometry.cleft import Cleft, frame
from ngbrain.mesh.geometry.curved_elements import curve
from ngbrain.units import check_count, check_lengths

SEMI_AXES = np.array([0.066, 0.084, 0.060])
"""Semi-axes (m) of the idealised brain, an ellipsoid of 1.39 l: left-right, front-back, height."""
CORTEX_THICKNESS = 0.008
"""Thickness (m) of the mantle that stands for the folded cortex."""
VENTRICLE_CENTRE = np.array([0.014, 0.0, 0.006])
VENTRICLE_SEMI_AXES = np.array([0.009, 0.021, 0.010])
FREE_MARGIN = 0.5
"""Scale of the ellipsoid, relative to the brain's axes, at which the falx ends."""
TENTORIUM_HEIGHT = -0.020
"""Height z (m) of the tentorium, a horizontal plane; the falx stands on it."""
NOTCH_CENTRE, NOTCH_RADIUS = -0.020, 0.020
"""The tentorium lies behind this y (m), but for half a disc of this radius around the brain stem."""
SHEETS = ("falx", "tentorium")
NEAR_DEPTH = 0.016
"""Depth (m) of the refined zone under the craniotomy."""
MOST_LOST = 0.01
"""Largest part of the brain's volume that the elements may miss."""
TOUCH = 1e-6
"""Distance (m) from a ventricle below which a slot opens it."""


@dataclass(frozen=True)
class Sizes:
    """Element sizes of the idealised head (m).

    Parameters
    ----------
    site : float
        On the cleft.
    near : float
        Under the craniotomy.
    far : float
        Elsewhere.
    grading : float
        Netgen's grading: growth of the element size with distance.
    """

    site: float = 2e-3
    near: float = 6e-3
    far: float = 20e-3
    grading: float = 0.7

    def __post_init__(self) -> None:
        for name in ("site", "near", "far"):
            check_lengths(f"Sizes.{name}", getattr(self, name))
        wanted = "how fast elements may grow, more than 0 and at most 1"
        number("Sizes.grading", self.grading, lambda grading: 0 < grading <= 1, wanted)


def block(size: tuple[float, float, float] = (0.06, 0.06, 0.04), maxh: float = 0.01) -> ngs.Mesh:
    """A box with one corner at the origin: region `tissue`, boundaries `left`/`right` (x), `front`/`back` (y), `bottom`/`top` (z).

    Parameters
    ----------
    size : tuple of float
        Edge lengths (m).
    maxh : float
        Element size (m).

    Returns
    -------
    ngsolve.Mesh
        The mesh.

    Examples
    --------
    >>> mesh = block(maxh=0.02)
    >>> sorted(set(mesh.GetBoundaries()))
    ['back', 'bottom', 'front', 'left', 'right', 'top']
    """
    check_lengths("block.size", size, 3)
    check_lengths("block.maxh", maxh)
    check_count("block.maxh", maxh, float(np.prod(size)))
    box = occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(*map(float, size)))
    box.mat("tissue")
    for axis, low, high in ((occ.X, "left", "right"), (occ.Y, "front", "back"), (occ.Z, "bottom", "top")):
        box.faces.Min(axis).name, box.faces.Max(axis).name = low, high
    return ngs.Mesh(_mesh(box, maxh, 0.3))


def cleft_to(
    target: np.ndarray,
    opening: float = 4e-3,
    width: float = 12e-3,
    approach: np.ndarray | None = None,
    across: np.ndarray | None = None,
) -> Cleft:
    """A cleft from the idealised brain's surface to a target.

    Parameters
    ----------
    target : ndarray, shape (3,)
        Centre of the cleft's floor (m).
    opening : float
        Distance between the walls (m).
    width : float
        Extent along the walls (m).
    approach : ndarray, shape (3,), optional
        Direction outwards; None: the shortest path to the surface.
    across : ndarray, shape (3,), optional
        Direction from wall to wall; None: left to right.

    Returns
    -------
    Cleft
        The cleft.

    Raises
    ------
    InputError
        The target lies outside the brain or in a ventricle.
    """
    target = numbers("cleft.target_mm", target, (3,), "three finite coordinates")
    check_lengths("opening", opening)
    check_lengths("width", width)
    if np.sum((target / SEMI_AXES) ** 2) >= 1:
        raise InputError(
            "cleft.target_mm", _mm(target), "a point inside the brain, which is an ellipsoid of half axes 66, 84, 60 mm"
        )
    mirrored = target * np.array([np.sign(target[0]) or 1.0, 1, 1])
    if np.sum(((mirrored - VENTRICLE_CENTRE) / VENTRICLE_SEMI_AXES) ** 2) <= 1:
        raise InputError("cleft.target_mm", _mm(target), "a point in tissue, not in a ventricle")
    out, across = frame(_direction_out(target) if approach is None else approach, across)
    # |(target + s out)/axes| = 1, the positive root
    a, b = np.sum((out / SEMI_AXES) ** 2), np.sum(out * target / SEMI_AXES**2)
    c = np.sum((target / SEMI_AXES) ** 2) - 1
    depth = float((-b + np.sqrt(b * b - a * c)) / a)
    return Cleft(target, out, across, depth, opening, width)


class Ellipsoids:
    """The idealised head before it is opened, with the interface of a scene's head."""

    cleft_to = staticmethod(cleft_to)

    def point(self, voxel: Sequence[float]) -> np.ndarray:
        """Not available: an idealised head has no voxels."""
        raise InputError("cleft.target_voxel", list(voxel), "cleft.target_mm: the idealised head has no voxels")


def _mm(point: np.ndarray) -> str:
    return "(" + ", ".join(f"{1e3 * c:.1f}" for c in point) + ") mm"


def _direction_out(target: np.ndarray) -> np.ndarray:
    """Direction from a point to the nearest point of the brain's surface: x = target / (1 + λ/axes²) on the ellipsoid."""
    squared = SEMI_AXES**2

    def outside(shift: float) -> float:
        return float(np.sum((target * SEMI_AXES / (squared + shift)) ** 2) - 1)

    lowest = -float(np.min(squared))
    shift = (
        scipy.optimize.brentq(outside, lowest * (1 - 1e-9), 0.0, xtol=1e-16)
        if outside(lowest * (1 - 1e-9)) > 0
        else lowest * (1 - 1e-9)
    )
    return target * squared / (squared + shift) - target


def idealised_head(
    cleft: Cleft | None = None, craniotomy: float = 40e-3, sizes: Sizes | None = None, sheets: Sequence[str] = ()
) -> ngs.Mesh:
    """A smooth idealised brain, with or without a cleft, in second-order curved elements, none of them folded (see `curve`).

    Regions are `cortex`, `white`, `ventricle_left` and `ventricle_right`; boundaries are `skull` (the surface) and
    `ventricle_wall`. With a cleft there are also `craniotomy` (a disc around it) and the cleft's own boundaries (see
    `Cleft`). The mesh is already curved: do not call its `Curve`.

    Parameters
    ----------
    cleft : Cleft, optional
        From `cleft_to`; None for the intact head.
    craniotomy : float
        Diameter of the craniotomy (m).
    sizes : Sizes, optional
        Element sizes.
    sheets : sequence of str
        "falx", "tentorium" or both: faces inside the brain, boundaries of that name. The falx is the part of the midsagittal
        plane outside an ellipsoid of half the brain's axes and above the tentorium. The tentorium is the horizontal plane
        20 mm below the centre, behind the notch for the brain stem. A cleft cuts through them.

    Returns
    -------
    ngsolve.Mesh
        The mesh.

    Raises
    ------
    InputError
        Sizes are too large, the cleft opens a ventricle, or a sheet has another name.

    Examples
    --------
    >>> mesh = idealised_head(sizes=Sizes(far=0.018, grading=0.5))
    >>> sorted(set(mesh.GetMaterials()))
    ['cortex', 'ventricle_left', 'ventricle_right', 'white']
    """
    sizes = sizes or Sizes()
    if unknown := sorted(set(sheets) - set(SHEETS)):
        raise InputError("sheets", repr(unknown[0]), nearest(unknown[0], SHEETS))
    brain, inner = _ellipsoid(np.zeros(3), SEMI_AXES), _ellipsoid(np.zeros(3), SEMI_AXES - CORTEX_THICKNESS)
    brain.faces.name = "skull"
    left = _ellipsoid(VENTRICLE_CENTRE * [-1, 1, 1], VENTRICLE_SEMI_AXES)
    right = _ellipsoid(VENTRICLE_CENTRE, VENTRICLE_SEMI_AXES)
    for ventricle, name in ((left, "ventricle_left"), (right, "ventricle_right")):
        ventricle.faces.name = "ventricle_wall"
        ventricle.mat(name)
        if cleft is not None and _slot(cleft).Distance(ventricle) < TOUCH:
            wanted = "a target, approach and size of the cleft that spare the ventricles"
            raise InputError("cleft.target_mm", _mm(cleft.target), wanted)
    tissues = {"cortex": brain - inner, "white": inner - left - right}
    parts = []
    for name, tissue in tissues.items():
        pieces = [tissue] if cleft is None else _open_tissue(tissue, cleft, craniotomy, sizes)
        for piece in pieces:
            piece.mat(name)
        parts += pieces
    dura = [_sheet(name, brain) for name in SHEETS if name in sheets]
    dura = [sheet if cleft is None else _subtract(sheet, _slot(cleft)) for sheet in dura]
    whole = occ.Glue([*parts, left, right, *dura])
    for face in whole.faces:
        if cleft is not None and face.name == "skull" and _under(face, cleft, craniotomy):
            face.name = "craniotomy"
        elif face.name is None:
            face.name = "inside"
    try:
        straight = _mesh(whole, sizes.far, sizes.grading)
        curve(straight)
        mesh = ngs.Mesh(straight)
        solid = sum(part.mass for part in whole.solids)  # the mass of the whole is wrong where faces lie inside solids
        lost = 1 - ngs.Integrate(ngs.CF(1), mesh) / solid
        if abs(lost) > MOST_LOST:
            raise InputError("mesh sizes", f"such that {100 * lost:.1f} % of the brain is cut off", "smaller elements")
    except InputError as error:
        wanted = "less, or smaller mesh.craniotomy_size_mm or mesh.wall_size_mm"
        raise InputError("mesh.max_size_mm", f"{1e3 * sizes.far:g}, {error.value}", wanted) from error
    return mesh


def _sheet(name: str, brain: occ.Solid) -> occ.TopoDS_Shape:
    below = occ.Box(occ.Pnt(-1, -1, -1), occ.Pnt(1, 1, TENTORIUM_HEIGHT))
    if name == "falx":
        plane = occ.WorkPlane(occ.Axes((0, 0, 0), occ.X, occ.Y)).RectangleC(1, 1).Face()
        sheet = plane * brain - _ellipsoid(np.zeros(3), FREE_MARGIN * SEMI_AXES) - below
    else:
        plane = occ.WorkPlane(occ.Axes((0, 0, TENTORIUM_HEIGHT), occ.Z, occ.X)).RectangleC(1, 1).Face()
        before = occ.Box(occ.Pnt(-1, NOTCH_CENTRE, -1), occ.Pnt(1, 1, 1))
        sheet = plane * brain - before - occ.Cylinder(occ.Pnt(0, NOTCH_CENTRE, -1), occ.Z, r=NOTCH_RADIUS, h=2)
    sheet.faces.name = name
    return sheet


def _subtract(sheet: occ.TopoDS_Shape, slot: occ.Solid) -> occ.TopoDS_Shape:
    name, rest = sheet.faces[0].name, sheet - slot
    rest.faces.name = name
    return rest


def _open_tissue(tissue: occ.TopoDS_Shape, cleft: Cleft, craniotomy: float, sizes: Sizes) -> list[occ.TopoDS_Shape]:
    """A tissue without the slot, split into the zone under the craniotomy and the rest."""
    slot = _slot(cleft)
    for face in slot.faces:
        face.name, face.maxh = _cleft_face(cleft, face), sizes.site
    zone = _plane(cleft, cleft.entry - NEAR_DEPTH * cleft.out).Circle(craniotomy / 2).Face().Extrude(NEAR_DEPTH + 0.03)
    near = tissue * zone - slot
    near.maxh = sizes.near
    return [tissue - zone - slot, near]


def _slot(cleft: Cleft) -> occ.Solid:
    return _plane(cleft, cleft.target).RectangleC(cleft.opening, cleft.width).Face().Extrude(cleft.depth + 0.02)


def _cleft_face(cleft: Cleft, face: occ.Face) -> str:
    a, b, height = cleft.coordinates(np.array([[face.center.x, face.center.y, face.center.z]]))[0]
    if abs(a) > 0.49 * cleft.opening:
        return "wall_plus" if a > 0 else "wall_minus"
    if abs(b) > 0.49 * cleft.width:
        return "end_plus" if b > 0 else "end_minus"
    return "floor" if height < cleft.depth / 2 else "lid"


def _under(face: occ.Face, cleft: Cleft, craniotomy: float) -> bool:
    a, b, height = cleft.coordinates(np.array([[face.center.x, face.center.y, face.center.z]]))[0]
    return bool(np.hypot(a, b) < craniotomy / 4 and abs(height - cleft.depth) < NEAR_DEPTH)


def _plane(cleft: Cleft, origin: np.ndarray) -> occ.WorkPlane:
    return occ.WorkPlane(occ.Axes(tuple(map(float, origin)), occ.Vec(*cleft.out), occ.Vec(*cleft.across)))


def _ellipsoid(centre: np.ndarray, semi_axes: np.ndarray) -> occ.Solid:
    # Made at the origin and moved: an Axes with an offset displaces the scaled surface.
    shape = occ.Ellipsoid(occ.Axes((0, 0, 0), occ.X, occ.Y), *map(float, semi_axes))
    return shape.Move(occ.Vec(*map(float, centre)))


def _mesh(shape: occ.TopoDS_Shape, maxh: float, grading: float) -> meshing.Mesh:
    # One thread and a fixed order of work: the same shape gives the same mesh, bit for bit.
    geometry = occ.OCCGeometry(shape)
    try:
        return geometry.GenerateMesh(maxh=maxh, grading=grading, curvaturesafety=1.0, parallel_meshing=False)
    except Exception as error:  # Netgen raises exceptions of several types
        raise InputError("mesh sizes", f"such that Netgen gives up ({error})", "smaller elements") from error
