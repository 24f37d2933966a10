"""What a property is made of: one field over all tissue, or one for each label."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from ngsolve import CoefficientFunction
from scipy.spatial import KDTree

from ngbrain.errors import InputError
from ngbrain.inverse.problem.discretisation import Discretisation, discretise, lattice_discretisation
from ngbrain.inverse.problem.label_shares import combine_labels, label_shares
from ngbrain.inverse.problem.voxel_lattice import VoxelLattice
from ngbrain.io.waves import WaveData

Array = np.ndarray


@dataclass(frozen=True)
class PropertyField:
    """A field that is looked for: a quantity over all tissue, or in one label of the data.

    >>> PropertyField("storage").name, PropertyField("storage", 3).name
    ('storage', 'storage 3')
    """

    quantity: str
    label: int | None = None

    @property
    def name(self) -> str:
        """In models, files and reports."""
        return self.quantity if self.label is None else f"{self.quantity} {self.label}"

    def mask(self, labels: Array | None) -> Array | bool:
        """At which points it is: where the labels are its own, or everywhere."""
        if self.label is None:
            return True
        assert labels is not None  # fields of labels have seen to it
        return np.asarray(labels == self.label)


def property_fields(quantities: Iterable[str], labels: Array | None) -> dict[str, PropertyField]:
    """Name → field, of all that quantities may be made of.

    >>> list(property_fields(["storage"], np.array([1, 3, 3])))
    ['storage', 'storage 1', 'storage 3']
    """
    known = [None, *([] if labels is None else np.unique(labels).tolist())]
    found = (PropertyField(quantity, label) for quantity in quantities for label in known)
    return {each.name: each for each in found}


class Composition(Protocol):
    """The fields that a property is made of."""

    def fields(self, quantity: str) -> tuple[PropertyField, ...]:
        """Of a quantity."""

    def function(self, values: Mapping[str, CoefficientFunction]) -> CoefficientFunction:
        """The quantity from its fields' values, in integrals over elements."""

    def point_values(self, values: Mapping[str, Array]) -> Array:
        """The same at the points of the data that count, (n,) from (n,) each."""


class SingleField:
    """One field.

    >>> [field.name for field in SingleField().fields("storage")]
    ['storage']
    """

    def fields(self, quantity: str) -> tuple[PropertyField, ...]:
        """The quantity itself."""
        return (PropertyField(quantity),)

    def function(self, values: Mapping[str, CoefficientFunction]) -> CoefficientFunction:
        """The only one."""
        (only,) = values.values()
        return only

    def point_values(self, values: Mapping[str, Array]) -> Array:
        """The only one."""
        (only,) = values.values()
        return only


class FieldPerLabel:
    """A field for each label of the data, free to jump where labels meet; elsewhere the nearest point's label counts.

    Raises `InputError` for data without labels.
    """

    def __init__(self, data: WaveData, elements: Discretisation) -> None:
        if data.labels is None:
            raise InputError("labels", "not given", "a whole number for each point, or one field for all")
        self._made_from = data, elements
        counts = elements.inside & data.mask
        self._own = data.labels[counts]
        self.labels, numbers = np.unique(self._own, return_inverse=True)
        tree, names = KDTree(data.points[counts]), [str(label) for label in self.labels]
        self._shares = label_shares(elements.mesh, elements.degree, lambda x: numbers[tree.query(x)[1]], names)

    def __reduce__(self) -> tuple[Any, ...]:
        """As what it is made from, so that other processes make the same one."""
        return FieldPerLabel, self._made_from

    def fields(self, quantity: str) -> tuple[PropertyField, ...]:
        """One for each label."""
        return tuple(PropertyField(quantity, label) for label in self.labels.tolist())

    def function(self, values: Mapping[str, CoefficientFunction]) -> CoefficientFunction:
        """That of the label."""
        return combine_labels(self._shares, dict(zip(self._shares, values.values(), strict=True)))

    def point_values(self, values: Mapping[str, Array]) -> Array:
        """That of the point's own label."""
        found = np.empty(len(self._own))
        for label, each in zip(self.labels, values.values(), strict=True):
            found[self._own == label] = each[self._own == label]
        return found


def discretise_volume(data: WaveData, labelled: bool) -> Discretisation:
    """Those of `discretise`, with labels for fields of first order: labels have the jumps, what is left varies slowly."""
    return _with(discretise(data), labelled)


def discretise_lattice(data: WaveData, cells: VoxelLattice, labelled: bool) -> Discretisation:
    """The same of a lattice."""
    return _with(lattice_discretisation(data, cells), labelled)


def _with(elements: Discretisation, labelled: bool) -> Discretisation:
    return replace(elements, field_order=1) if labelled else elements


def build_composition(data: WaveData, elements: Discretisation, labelled: bool) -> Composition:
    """A field for each label or one for all; `InputError` where there are no labels."""
    return FieldPerLabel(data, elements) if labelled else SingleField()
