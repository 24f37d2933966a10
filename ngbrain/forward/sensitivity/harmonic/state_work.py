"""Virtual work of small waves about a body's static equilibrium in symbolic form: A v tested, and its derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property
from typing import TypeAlias

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.forward.harmonic.about_state import AboutState, derivative_by_state
from ngbrain.forward.sensitivity.node_positions import NodePositions
from ngbrain.forward.sensitivity.parameter_blocks import ParameterBlock
from ngbrain.forward.solid.virtual_work import Motion, Terms, slope, vector
from ngbrain.solvers.matrices import to_scipy

Array = np.ndarray
Slopes: TypeAlias = tuple[Callable[[], Array], list[Callable[[], Array]]]
"""Assemblers of the derivatives of an integral with respect to the state and to each block of θ."""
Pair: TypeAlias = Callable[[Motion], tuple[Motion, Motion]]
"""From a part of the wave to the pair of test and trial motions; with follower loads their order matters."""


class StateWork:
    """Re(A v) of a wave v = c + i d, tested, as integrals of real fields; Im(A v) is Re(A (-i v)).

    It gives derivatives of Re(λᵀ A v) at the body's state with respect to state and θ, and those of Re(λᵀ A' v), with A'
    the derivative along the directions of both last set by `set_direction`.

    Parameters
    ----------
    about : AboutState
        Waves about the state.
    blocks : iterable of ParameterBlock
        Blocks of θ.
    """

    def __init__(self, about: AboutState, blocks: Iterable[ParameterBlock]) -> None:
        self._about, self._body, self._blocks = about, about.body, list(blocks)
        fes = about.body.fes
        self._work, self._squared = about.work, ngs.Parameter(0.0)
        self._c, self._d, self._adjoint, self._change = (ngs.GridFunction(fes) for _ in range(4))
        self._trial, self._test = fes.TnT()

    def sensitivity(self, omega: float, v: Array) -> tuple[sp.csr_array, sp.csr_array]:
        """Derivatives of A v with respect to state and θ.

        Parameters
        ----------
        omega : float
            Angular frequency (rad/s).
        v : array (ndof,)
            A wave, complex.

        Returns
        -------
        by_state : csr_array (ndof, ndof)
        by_theta : csr_array (ndof, size)
        """
        by_state, by_theta = [], []
        for part in (v, -1j * v):
            self._put(omega, part)
            by_state.append(to_scipy(self._by_state()))
            by_theta.append(sp.csr_array(sp.hstack([columns() for columns in self._columns])))
        return by_state[0] + 1j * by_state[1], by_theta[0] + 1j * by_theta[1]

    def gradient(self, omega: float, v: Array, adjoint: Array) -> tuple[Array, Array]:
        """Gradient of Re(λᵀ A v) with respect to state and θ.

        Parameters
        ----------
        omega : float
            Angular frequency (rad/s).
        v, adjoint : array (ndof,)
            The wave, and λ.

        Returns
        -------
        by_state : array (ndof,)
        by_theta : array (size,)
        """
        return self._summed(self._slopes, omega, v, adjoint)

    def set_direction(self, state: Array, direction: Array) -> None:
        """Set the directions of A'.

        Parameters
        ----------
        state : array (ndof,)
            Change of the state.
        direction : array (size,)
            δθ.
        """
        self._change.vec.FV().NumPy()[:] = state
        for block, way in zip(
            self._blocks, np.split(direction, np.cumsum([b.size for b in self._blocks])), strict=False
        ):
            block.set_direction(way)

    def apply_derivative(self, omega: float, v: Array) -> Array:
        """A' v.

        Parameters
        ----------
        omega : float
            Angular frequency (rad/s).
        v : array (ndof,)
            The wave.

        Returns
        -------
        array (ndof,)
        """
        found = self._complex(self._derivative_product, omega, v)
        return self._and_nodes(found, lambda: self._complex(self._product, omega, v))

    def apply_derivative_transpose(self, omega: float, adjoint: Array) -> Array:
        """A'ᵀ λ.

        Parameters
        ----------
        omega : float
            Angular frequency (rad/s).
        adjoint : array (ndof,)
            λ.

        Returns
        -------
        array (ndof,)
        """
        found = self._complex(self._derivative_transposed, omega, adjoint)
        return self._and_nodes(found, lambda: self._complex(self._transposed, omega, adjoint))

    def gradient_derivative(self, omega: float, v: Array, adjoint: Array) -> tuple[Array, Array]:
        """Gradient of Re(λᵀ A' v) with respect to state and θ.

        Parameters
        ----------
        omega : float
            Angular frequency (rad/s).
        v, adjoint : array (ndof,)
            The wave, and λ.

        Returns
        -------
        by_state : array (ndof,)
        by_theta : array (size,)
        """
        found = np.concatenate(self._summed(self._gradient_derivatives, omega, v, adjoint))
        found = self._and_nodes(found, lambda: np.concatenate(self.gradient(omega, v, adjoint)))
        return found[: self._body.fes.ndof], found[self._body.fes.ndof :]

    def _and_nodes(self, found: Array, of: Callable[[], Array]) -> Array:
        """Add the finite-difference derivative along node positions."""
        return sum((block.finite_difference(of) for block in self._blocks if isinstance(block, NodePositions)), found)

    def _summed(self, slopes: Slopes, omega: float, v: Array, adjoint: Array) -> tuple[Array, Array]:
        """Of Re λ · Re(A v) and -Im λ · Im(A v)."""
        by_state, by_theta = slopes
        found = []
        for part, tested in ((v, adjoint.real), (-1j * v, -adjoint.imag)):
            self._put(omega, part)
            self._adjoint.vec.FV().NumPy()[:] = tested
            found.append((by_state(), np.concatenate([slope() for slope in by_theta])))
        return found[0][0] + found[1][0], found[0][1] + found[1][1]

    def _complex(self, product: Callable[[], Array], omega: float, v: Array) -> Array:
        """Complex product from a function that gives Re(A v)."""
        parts = []
        for part in (v, -1j * v):
            self._put(omega, part)
            parts.append(product())
        return parts[0] + 1j * parts[1]

    def _put(self, omega: float, v: Array) -> None:
        self._squared.Set(omega**2)
        self._c.vec.FV().NumPy()[:], self._d.vec.FV().NumPy()[:] = v.real, v.imag

    @cached_property
    def _by_state(self) -> Callable[[], ngs.BaseMatrix]:
        return derivative_by_state(self._body, self._real(self._trial, _tested(self._test)))

    @cached_property
    def _columns(self) -> list[Callable[[], sp.csr_array]]:
        parts = self._real(self._body.gfu, _tested(self._test))
        return [block.jacobian(self._body.fes, parts) for block in self._blocks]

    @cached_property
    def _slopes(self) -> Slopes:
        return self._slopes_of(lambda state: self._real(state, _tested(self._adjoint)))

    @cached_property
    def _gradient_derivatives(self) -> Slopes:
        return self._slopes_of(lambda state: self._turn(state, _tested(self._adjoint)))

    @cached_property
    def _product(self) -> Callable[[], Array]:
        return vector(self._body.fes, self._real(self._body.gfu, _tested(self._test)))

    @cached_property
    def _transposed(self) -> Callable[[], Array]:
        return vector(self._body.fes, self._real(self._body.gfu, lambda part: (part, self._test)))

    @cached_property
    def _derivative_product(self) -> Callable[[], Array]:
        return vector(self._body.fes, self._turn(self._body.gfu, _tested(self._test)))

    @cached_property
    def _derivative_transposed(self) -> Callable[[], Array]:
        test = self._test
        return vector(self._body.fes, self._turn(self._body.gfu, lambda part: (part, test)))

    def _slopes_of(self, functional: Callable[[Motion], Terms]) -> Slopes:
        parts = functional(self._body.gfu)
        by_theta = [block.gradient(parts, self._body.mesh) for block in self._blocks]
        return slope(self._body, functional(self._trial)), by_theta

    def _turn(self, state: Motion, pair: Pair) -> Terms:
        """Derivative of `_real` along the directions of state and θ."""
        parts, others = (
            self._real(state, pair),
            (block for block in self._blocks if not isinstance(block, NodePositions)),
        )
        return self._real(state, pair, self._change) + [
            term for block in others for term in block.directional_derivative(parts)
        ]

    def _real(self, state: Motion, pair: Pair, *along: Motion) -> Terms:
        """Re(A v) tested with a virtual motion, or its derivative along further motions."""
        stored = self._work(state, *pair(self._c), *along)
        kinetic = self._work.functional(self._about.kinetic, state, *pair(self._c), *along)
        lossy = self._work.functional(self._about.lossy, state, *pair(self._d), *along)
        return stored + [term.times(-self._squared) for term in kinetic] + [term.times(-1) for term in lossy]


def _tested(virtual: Motion) -> Pair:
    return lambda part: (virtual, part)
