"""Betti numbers of the regions of a label map, and removal of islands and holes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy import ndimage

from ngbrain.errors import InputError
from ngbrain.image.read.label_map import LabelMap
from ngbrain.image.read.volume import Volume

_ISLAND = 30  # voxels
_HOLE = 1000  # voxels: a larger enclosed hole is a cavity, as of a resection
_ROUNDS = 5
_FACES, _CORNERS = (ndimage.generate_binary_structure(3, rank) for rank in (1, 3))


@dataclass(frozen=True)
class Topology:
    """Betti numbers of a region.

    Parameters
    ----------
    pieces : int
        β₀: connected components.
    tunnels : int
        β₁: handles, the sum of the genera of all bounding surfaces; 0 for balls and hollow balls.
    cavities : int
        β₂: enclosed holes.
    """

    pieces: int
    tunnels: int
    cavities: int

    @property
    def euler(self) -> int:
        """Euler characteristic χ = pieces - tunnels + cavities."""
        return self.pieces - self.tunnels + self.cavities

    @classmethod
    def from_mask(cls, mask: np.ndarray, neighbours: int = 6) -> Topology:
        """Betti numbers of a mask (nx, ny, nz), its voxels connected by faces (6) or by faces, edges and corners (26).

        Components and cavities are counted; the outside has the complementary connectivity (26 or 6). Tunnels follow from χ = Σ
        (-1)^k · number of cells of dimension k: of the closed cubes for 26 neighbours, of the complex whose vertices are the
        voxel centres for 6 (Kong & Rosenfeld 1989, doi:10.1016/0734-189X(89)90147-3).

        Raises
        ------
        InputError
            The number of neighbours is neither 6 nor 26.

        Examples
        --------
        >>> ring = np.ones((3, 3, 1), bool)
        >>> ring[1, 1] = False
        >>> Topology.from_mask(ring)
        Topology(pieces=1, tunnels=1, cavities=0)
        """
        if neighbours not in (6, 26):
            raise InputError("neighbours", neighbours, "6 or 26")
        inside = np.pad(mask.astype(bool), 1)
        by, other = (_FACES, _CORNERS) if neighbours == 6 else (_CORNERS, _FACES)
        pieces = ndimage.label(inside, by)[1]
        cavities = ndimage.label(~inside, other)[1] - 1
        return cls(pieces, pieces + cavities - _euler(inside, neighbours), cavities)


def _euler(inside: np.ndarray, neighbours: int) -> int:
    """Euler characteristic of a mask that does not touch the faces of its array."""
    total = 0
    meet = np.logical_and if neighbours == 6 else np.logical_or
    for count in range(4):
        for axes in combinations(range(3), count):
            cells = inside
            for axis in axes:  # the cells between voxels adjacent along these axes
                size = cells.shape[axis]
                cells = meet(cells.take(range(size - 1), axis), cells.take(range(1, size), axis))
            total += (-1) ** (count if neighbours == 6 else 3 - count) * int(np.count_nonzero(cells))
    return total


@dataclass(frozen=True)
class LabelCleaning:
    """Changes made by `clean_labels`.

    Parameters
    ----------
    moved : int
        Number of relabelled voxels.
    before, after : dict of Topology
        Region → its topology by 6 neighbours, before and after.
    """

    moved: int
    before: dict[str, Topology]
    after: dict[str, Topology]


def clean_labels(labels: LabelMap, island: int = _ISLAND) -> tuple[LabelMap, LabelCleaning]:
    """Remove small islands and holes from a label map.

    Connected components of a region (by faces) of less than `island` voxels take the label of most of their neighbours, the
    outside only if there is no other. So do enclosed holes of less than 1000 voxels; larger ones are cavities. This is repeated
    until nothing changes, at most 5 times. Tunnels are counted but not closed: the folded cortex has many at 1 mm.

    Parameters
    ----------
    labels : LabelMap
        The label map.
    island : int, optional
        Minimum size (voxels) of a component.

    Returns
    -------
    labels : LabelMap
        The cleaned map.
    report : LabelCleaning
        The changes.

    Examples
    --------
    >>> data = np.zeros((9, 9, 9), np.uint8)
    >>> data[1:8, 1:8, 1:8] = 1
    >>> data[3, 3, 3], data[5, 5, 5] = 2, 0
    >>> clean, report = clean_labels(LabelMap(Volume(data, np.diag([1e-3, 1e-3, 1e-3, 1])), {1: "grey", 2: "white"}))
    >>> report.moved, report.before["grey"].cavities, report.after["grey"], int(clean.volume.data[3, 3, 3])
    (2, 2, Topology(pieces=1, tunnels=0, cavities=0), 1)
    """
    old = labels.volume.data
    box = (ndimage.find_objects((old != 0).astype(np.uint8)) or [tuple(slice(0, n) for n in old.shape)])[0]
    new = np.ascontiguousarray(
        np.pad(old[box], 1)
    )  # a margin, so that all voxels have neighbours; files are in Fortran order
    for _ in range(_ROUNDS):
        before = new.copy()
        _fill_holes(new)
        for label in np.setdiff1d(np.unique(new), [0]):
            remove_islands(new, int(label), island, out=True)
        if np.array_equal(new, before):
            break
    whole = np.zeros(old.shape, old.dtype)
    whole[box] = new[1:-1, 1:-1, 1:-1]
    found = LabelMap(Volume(whole, labels.volume.affine), labels.names)
    moved = int(np.count_nonzero(found.volume.data != old))
    return found, LabelCleaning(moved, topologies(labels), topologies(found))


def topologies(labels: LabelMap, neighbours: int = 6) -> dict[str, Topology]:
    """Topology of every region.

    Parameters
    ----------
    labels : LabelMap
        The label map.
    neighbours : int, optional
        6 or 26, see `Topology.from_mask`.

    Returns
    -------
    dict of Topology
        By region.
    """
    numbered = labels.region_numbers()
    boxes = ndimage.find_objects(numbered, len(labels.regions))  # None: all cut away
    return {
        name: Topology(0, 0, 0) if box is None else Topology.from_mask(numbered[box] == number, neighbours)
        for number, (name, box) in enumerate(zip(labels.regions, boxes, strict=True), 1)
    }


def remove_islands(labels: np.ndarray, label: int, island: int = _ISLAND, out: bool = False) -> None:
    """Relabel small components of a label by the majority of their neighbours, in place.

    Parameters
    ----------
    labels : numpy.ndarray
        (nx, ny, nz), contiguous, 0 on its faces; modified.
    label : int
        The label.
    island : int, optional
        Components of fewer voxels are relabelled.
    out : bool, optional
        Whether a component with no other label around becomes outside (0); otherwise it is kept.

    Examples
    --------
    >>> row = np.pad(np.array([[[1, 2, 1, 1]]], np.uint8), 1)
    >>> remove_islands(row, 2)
    >>> row[1, 1].tolist()
    [0, 1, 1, 1, 1, 0]
    """
    (box,) = ndimage.find_objects(labels == label, 1)
    if box is None:
        return
    box = tuple(slice(side.start - 1, side.stop + 1) for side in box)
    part = np.ascontiguousarray(labels[box])
    pieces, count = ndimage.label(part == label)
    small = np.bincount(pieces.ravel(), minlength=count + 1) < island
    small[0] = False
    _relabel_by_majority(part, pieces, small, 0 if out else label)
    labels[box] = part


def _fill_holes(labels: np.ndarray) -> None:
    """Fill small enclosed holes by the majority label of their neighbours."""
    pieces, count = ndimage.label(labels == 0, _CORNERS)
    closed = np.bincount(pieces.ravel(), minlength=count + 1) < _HOLE
    closed[[0, pieces[0, 0, 0]]] = False
    _relabel_by_majority(labels, pieces, closed, 0)


def _relabel_by_majority(labels: np.ndarray, pieces: np.ndarray, which: np.ndarray, alone: int) -> None:
    """Relabel numbered components by the majority of their neighbours, or as `alone` if these are all outside."""
    at = np.flatnonzero(which[pieces])
    piece = pieces.ravel()[at]
    votes = np.zeros((len(which), int(labels.max()) + 1), int)
    for axis in range(3):
        for way in (-1, 1):
            beside = at + way * labels.strides[axis] // labels.itemsize
            other = pieces.ravel()[beside] != piece
            np.add.at(votes, (piece[other], labels.ravel()[beside[other]]), 1)
    votes[:, 0] = 0
    labels.ravel()[at] = np.where(votes.any(axis=1), votes.argmax(axis=1), alone)[piece]
