"""The fields of a property: one for all tissue, or one for each label."""

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
    """An unknown field: a property in all tissue, or in one label of the data.

    Parameters
    ----------
    quantity : str
        Name of the property.
    label : int, optional
        The label; None for all tissue.

    Examples
    --------
    >>> PropertyField("storage").name, PropertyField("storage", 3).name
    ('storage', 'storage 3')
    """

    quantity: str
    label: int | None = None

    @property
    def name(self) -> str:
        """Name in models, files and reports."""
        return self.quantity if self.label is None else f"{self.quantity} {self.label}"

    def mask(self, labels: Array | None) -> Array | bool:
        """Points where the field is defined: those of its label, or all."""
        if self.label is None:
            return True
        assert labels is not None  # fields of labels exist only with labels
        return np.asarray(labels == self.label)


def property_fields(quantities: Iterable[str], labels: Array | None) -> dict[str, PropertyField]:
    """Return all fields that properties may be made of.

    Parameters
    ----------
    quantities : iterable of str
        Names of properties.
    labels : numpy.ndarray or None
        (n,) labels of the data.

    Returns
    -------
    dict of str to PropertyField
        Name → field.

    Examples
    --------
    >>> list(property_fields(["storage"], np.array([1, 3, 3])))
    ['storage', 'storage 1', 'storage 3']
    """
    known = [None, *([] if labels is None else np.unique(labels).tolist())]
    found = (PropertyField(quantity, label) for quantity in quantities for label in known)
    return {each.name: each for each in found}


class Composition(Protocol):
    """How a property is composed of fields."""

    def fields(self, quantity: str) -> tuple[PropertyField, ...]:
        """Return the fields of a property."""

    def function(self, values: Mapping[str, CoefficientFunction]) -> CoefficientFunction:
        """Return the property from the values of its fields, for integrals over elements."""

    def point_values(self, values: Mapping[str, Array]) -> Array:
        """Return the property (n,) at the included points of the data, from the values (n,) of each field."""


class SingleField:
    """One field for all tissue.

    Examples
    --------
    >>> [field.name for field in SingleField().fields("storage")]
    ['storage']
    """

    def fields(self, quantity: str) -> tuple[PropertyField, ...]:
        """Return the one field."""
        return (PropertyField(quantity),)

    def function(self, values: Mapping[str, CoefficientFunction]) -> CoefficientFunction:
        """Return the one value."""
        (only,) = values.values()
        return only

    def point_values(self, values: Mapping[str, Array]) -> Array:
        """Return the one value."""
        (only,) = values.values()
        return only


class FieldPerLabel:
    """A field for each label of the data, which may jump where labels meet. Elsewhere the label of the nearest point counts.

    Parameters
    ----------
    data : WaveData
        Data with labels.
    elements : Discretisation
        Their elements.

    Raises
    ------
    InputError
        The data have no labels.
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
        """Pickle the arguments, so that other processes build the same composition."""
        return FieldPerLabel, self._made_from

    def fields(self, quantity: str) -> tuple[PropertyField, ...]:
        """Return one field for each label."""
        return tuple(PropertyField(quantity, label) for label in self.labels.tolist())

    def function(self, values: Mapping[str, CoefficientFunction]) -> CoefficientFunction:
        """Return Σ s_l G_l."""
        return combine_labels(self._shares, dict(zip(self._shares, values.values(), strict=True)))

    def point_values(self, values: Mapping[str, Array]) -> Array:
        """Return the value of each point's own label."""
        found = np.empty(len(self._own))
        for label, each in zip(self.labels, values.values(), strict=True):
            found[self._own == label] = each[self._own == label]
        return found


def discretise_volume(data: WaveData, labelled: bool) -> Discretisation:
    """Build elements over the points of data in space (see `discretise`).

    Parameters
    ----------
    data : WaveData
        Data in space.
    labelled : bool
        Whether each label has fields of its own. These are of first order: labels account for the jumps, so that the rest
        varies slowly.

    Returns
    -------
    Discretisation
        The elements.
    """
    return _with_field_order(discretise(data), labelled)


def discretise_lattice(data: WaveData, cells: VoxelLattice, labelled: bool) -> Discretisation:
    """Build the elements of a voxel lattice.

    Parameters
    ----------
    data : WaveData
        Data whose points lie in the lattice.
    cells : VoxelLattice
        The cells.
    labelled : bool
        As for `discretise_volume`.

    Returns
    -------
    Discretisation
        The elements.
    """
    return _with_field_order(lattice_discretisation(data, cells), labelled)


def _with_field_order(elements: Discretisation, labelled: bool) -> Discretisation:
    return replace(elements, field_order=1) if labelled else elements


def build_composition(data: WaveData, elements: Discretisation, labelled: bool) -> Composition:
    """Return the composition of properties from fields.

    Parameters
    ----------
    data : WaveData
        The data.
    elements : Discretisation
        Their elements.
    labelled : bool
        One field for each label, or one for all tissue.

    Returns
    -------
    Composition
        The composition.

    Raises
    ------
    InputError
        Labels are asked for, and the data have none.
    """
    return FieldPerLabel(data, elements) if labelled else SingleField()
