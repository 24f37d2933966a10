"""Interface of a quantity derived from a model's data."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from ngbrain.errors import InputError

Array = np.ndarray


class DerivedQuantity(ABC):
    """Real numbers T(d) derived from a model's data d.

    Attributes
    ----------
    name : str
        Name for reports.
    """

    name: str

    @abstractmethod
    def value(self, data: Array) -> Array:
        """The quantity T(d), real."""

    @abstractmethod
    def jvp(self, data: Array, change: Array) -> Array:
        """Jacobian-vector product T' δd.

        Parameters
        ----------
        data : array
            Data d of the model.
        change : array
            Direction δd, of the shape of `data`.

        Returns
        -------
        array
            Of the shape of `value`.
        """

    @abstractmethod
    def vjp(self, data: Array, w: Array) -> Array:
        """Vector-Jacobian product T'ᵀ w, such that Re Σ conj(T'ᵀw) · δd = w · T' δd.

        Parameters
        ----------
        data : array
            Data d of the model.
        w : array
            Weights, of the shape of `value`.

        Returns
        -------
        array
            Of the shape of `data`.
        """

    def vjp_derivative(self, data: Array, w: Array, change: Array) -> Array:
        """Derivative of `vjp` with respect to the data, in a direction.

        Parameters
        ----------
        data : array
            Data d of the model.
        w : array
            Weights, of the shape of `value`.
        change : array
            Direction δd.

        Returns
        -------
        array
            Of the shape of `data`.

        Raises
        ------
        InputError
            For a quantity without second derivatives.
        """
        raise InputError(type(self).__name__, "asked for second derivatives", "a quantity that has them")
