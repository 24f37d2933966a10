"""What a property is made of: one field over all tissue, or one for each label."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from ngsolve import CoefficientFunction
from scipy.spatial import KDTree

from ngbrain.errors import InputError
from ngbrain.inverse.discretise import Discretisation, in_elements, on_lattice
from ngbrain.inverse.labels import by_label, shares
from ngbrain.inverse.lattice import Lattice
from ngbrain.io.waves import WaveData

Array = np.ndarray


class Composition(Protocol):
    """Fields of a property, by names of their own."""

    def fields(self, quantity: str) -> tuple[str, ...]:
        """Names of the fields of a quantity."""

    def function(self, values: Mapping[str, CoefficientFunction]) -> CoefficientFunction:
        """The quantity from its fields' values, in integrals over elements."""

    def at_points(self, values: Mapping[str, Array]) -> Array:
        """The same at the points of the data that count, (n,) from (n,) each."""


class Whole:
    """One field.

    >>> Whole().fields("storage")
    ('storage',)
    """

    def fields(self, quantity: str) -> tuple[str, ...]:
        """The quantity itself."""
        return (quantity,)

    def function(self, values: Mapping[str, CoefficientFunction]) -> CoefficientFunction:
        """The only one."""
        (only,) = values.values()
        return only

    def at_points(self, values: Mapping[str, Array]) -> Array:
        """The only one."""
        (only,) = values.values()
        return only


class ByLabel:
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
        self._shares = shares(elements.mesh, elements.degree, lambda x: numbers[tree.query(x)[1]], names)

    def __reduce__(self) -> tuple[Any, ...]:
        """As what it is made from, so that other processes make the same one."""
        return ByLabel, self._made_from

    def fields(self, quantity: str) -> tuple[str, ...]:
        """Quantity and label, `storage 3`."""
        return tuple(f"{quantity} {label}" for label in self.labels)

    def function(self, values: Mapping[str, CoefficientFunction]) -> CoefficientFunction:
        """That of the label."""
        return by_label(self._shares, dict(zip(self._shares, values.values(), strict=True)))

    def at_points(self, values: Mapping[str, Array]) -> Array:
        """That of the point's own label."""
        found = np.empty(len(self._own))
        for label, each in zip(self.labels, values.values(), strict=True):
            found[self._own == label] = each[self._own == label]
        return found


def elements_in_space(data: WaveData, labelled: bool) -> Discretisation:
    """Those of `in_elements`, with labels for fields of first order: labels have the jumps, what is left varies slowly."""
    return _with(in_elements(data), labelled)


def elements_on(data: WaveData, cells: Lattice, labelled: bool) -> Discretisation:
    """The same of a lattice."""
    return _with(on_lattice(data, cells), labelled)


def _with(elements: Discretisation, labelled: bool) -> Discretisation:
    return replace(elements, fields=1) if labelled else elements


def composed(data: WaveData, elements: Discretisation, labelled: bool) -> Composition:
    """A field for each label or one for all; `InputError` where there are no labels."""
    return ByLabel(data, elements) if labelled else Whole()
