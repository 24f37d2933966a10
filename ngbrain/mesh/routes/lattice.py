"""A lattice of tetrahedra snapped onto the interfaces of labels: no surfaces are made, and any labels will do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.look import BriefText
from ngbrain.mesh.geometry.sizing import SizeField, sample_sizes
from ngbrain.mesh.improve.guarded_moves import apply_guarded_moves
from ngbrain.mesh.improve.octree import MOST, PER_CUBE, body_centred_lattice
from ngbrain.mesh.improve.snapped_lattice import FACES, SnappedLattice, scales, slope_across
from ngbrain.mesh.improve.snapping import cut_edges, snap_targets
from ngbrain.mesh.labels.indicators import SMOOTHING, Indicators
from ngbrain.mesh.labels.volume_fractions import VolumeFractions
from ngbrain.mesh.labels.volume_zones import Zones
from ngbrain.mesh.tet_mesh import Elements

ROUNDS, MORE = 4, 2
"""Rounds of moves onto interfaces after the first snapping along lattice edges; and the largest number of further rounds while
a region's volume is off by more than `OFF`.
"""
OFF = 0.01
"""Relative volume error allowed; a few large elements change sides in each round."""
SHIFT = 0.2
"""Largest shift of interfaces for the regions' volumes, as a part of the largest element size."""
CUT = 5.0
"""Length of edges, in widths of an interface (smoothing and voxels), above which they are not cut: finer folds are not resolved."""
_FINE = (0.5, 0.9)  # parts of the largest size between which elements leave the refined zone


@dataclass(frozen=True, eq=False, repr=False)
class Lattice(BriefText):
    """A mesh and the number of its snapped interface vertices.

    Parameters
    ----------
    elements : Elements
        The mesh.
    snapped : int
        Number of vertices on their interface.
    rejected : int
        Number of vertices that stayed off it, because a tetrahedron would have become too flat.
    """

    elements: Elements
    snapped: int
    rejected: int


def lattice(labels: LabelMap, size: SizeField, smoothing: float = SMOOTHING) -> Lattice:
    """Mesh all regions of a label map by a snapped lattice of tetrahedra, with the labels' volumes.

    The lattice is an octree of cubes (`octree.body_centred_lattice`). Vertices close to where an edge changes region are snapped
    onto the interface. Edges that still cross one are split there, unless they are longer than `CUT` times the blur of
    interfaces. Each tetrahedron gets the region with the largest mean volume fraction. Then, for a few rounds, interface
    vertices move to where the two volume fractions are equal, and their neighbours to the centre of their neighbourhood. No move
    or split leads to a dihedral angle below `guarded_moves.ANGLE` or a radius ratio below `guarded_moves.RATIO`.

    Missing volumes are restored by a bounded bias b_k of the volume fractions, s_k + b_k h/h_max. It acts where elements are
    large, as their errors do. In a graded mesh, the refined part has biases of its own (`volume_zones`). Parts of regions
    thinner than elements are lost or fragmented.

    Boundaries are `outer_<region>` and `<a>_<b>`, in the order of `labels.regions`; triangles point out of the region named
    first, and out of `<region>` for the outer ones.

    Parameters
    ----------
    labels : LabelMap
        The labels.
    size : SizeField
        Element size (m): the edge h of the lattice's cubes is `size` times 0.7 to 1.4. There are 12 tetrahedra in h³, with
        edges of h and 0.87 h.
    smoothing : float
        Standard deviation (m) of the Gaussian that smooths the voxel steps (`Indicators`).

    Returns
    -------
    Lattice
        The mesh.

    Raises
    ------
    InputError
        Every label is 0, sizes are not positive, or more than `MOST` tetrahedra or none of a region would result.

    References
    ----------
    Snapping: Labelle & Shewchuk (2007), doi:10.1145/1276377.1276448. Several materials: Bronson, Levine & Whitaker (2014),
    doi:10.1109/TVCG.2013.115.

    Examples
    --------
    >>> from ngbrain.image.read.volume import Volume
    >>> ball = np.linalg.norm(np.indices((24, 24, 24)) - 11.5, axis=0) < 10
    >>> labels = LabelMap(Volume(ball.astype(int), np.diag([1e-3, 1e-3, 1e-3, 1])), {1: "grey"})
    >>> made = lattice(labels, lambda points: np.full(len(points), 4e-3)).elements
    >>> made.boundaries, bool(abs(made.volumes().sum() / 1e-9 / ball.sum() - 1) < 0.02)
    (('outer_grey',), True)
    """
    low, high, finest = _extent(labels, size)
    zones = Zones.of(labels, size, _fine)
    indicators = Indicators.of(labels, smoothing).correct_volumes(zones)
    fractions = VolumeFractions.of(indicators.fractions, indicators.affine)
    points, tets = body_centred_lattice(low, high, size, finest, lambda points: fractions(points).argmax(axis=1) > 0)
    if not len(tets):
        raise InputError("size", "so large that no point of the lattice is inside", "smaller elements")
    # Voxel averaging and linear interpolation each widen an interface as a Gaussian of the same variance would.
    width = float(np.sqrt(smoothing**2 + (labels.volume.spacing**2).mean() / 4))
    scale = scales(points, tets)
    points, _ = apply_guarded_moves(points, tets, snap_targets(points, tets, fractions, slope_across(width)))
    points, tets, scale = cut_edges(points, tets, fractions, scale, CUT * width)
    net = SnappedLattice(points, tets, fractions, width, scale, zones.weights)
    most = SHIFT * float(net.scale.max()) * net.slope
    region = net.balance(zones.target_volumes, most)
    for done in range(ROUNDS + MORE):
        if done >= ROUNDS and net.volume_errors(region, zones.target_volumes.sum(axis=0)).max() < OFF:
            break
        net.points, _ = apply_guarded_moves(net.points, net.tets, net.target_positions(region))
        region = net.balance(zones.target_volumes, most)
    if len(lost := np.setdiff1d(np.arange(1, fractions.count), region)):
        raise InputError("size", f"so large that {labels.regions[lost[0] - 1]} has no element", "smaller sizes there")
    settled = net.is_on_interface(region)
    return Lattice(_elements(net, region, labels.regions), int(settled.sum()), int((~settled).sum()))


def _fine(h: np.ndarray, smallest: float, largest: float) -> np.ndarray:
    """1 where elements are small, 0 where they are about as large as the largest."""
    begin, end = _FINE
    return ((end - h / largest) / (end - begin)).clip(0, 1)


def _extent(labels: LabelMap, size: SizeField) -> tuple[np.ndarray, np.ndarray, float]:
    """Corners (3,), (3,) of a box around the labels, and the smallest element size in it, all in m."""
    finest = float(sample_sizes(labels, size, PER_CUBE, MOST).min())
    inside = np.argwhere(labels.volume.data != 0)
    first, last = inside.min(axis=0) - 0.5, inside.max(axis=0) + 0.5
    corners = labels.volume.to_world(first + (last - first) * np.array(list(np.ndindex(2, 2, 2))))
    return corners.min(axis=0), corners.max(axis=0), finest


def _elements(net: SnappedLattice, region: np.ndarray, names: tuple[str, ...]) -> Elements:
    """The mesh without the tetrahedra outside."""
    t, k, other = net.interface_faces(region)
    triangles, flip = net.tets[t[:, None], FACES[k]], region[t] == 0
    triangles[flip] = triangles[flip][:, [0, 2, 1]]
    pairs, boundary = np.unique(np.sort(np.stack([region[t], other], axis=1), axis=1), axis=0, return_inverse=True)
    within = region > 0
    used, tets = np.unique(net.tets[within], return_inverse=True)
    return Elements(
        net.points[used],
        tets.reshape(-1, 4).astype(np.int32),
        (region[within] - 1).astype(np.int32),
        np.searchsorted(used, triangles).astype(np.int32),
        boundary.ravel().astype(np.int32),
        names,
        tuple(f"{'outer' if not i else names[i - 1]}_{names[j - 1]}" for i, j in pairs.tolist()),
    )
