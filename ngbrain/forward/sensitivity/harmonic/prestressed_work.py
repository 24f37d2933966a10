"""Virtual work of waves in a body that is deformed already, by symbols: A v tested, and its derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property
from typing import TypeAlias

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.forward.contact.rigid import offsets
from ngbrain.forward.harmonic.factors import sparse
from ngbrain.forward.sensitivity.harmonic.slopes import complexified
from ngbrain.forward.sensitivity.parameter_blocks import Block, Nodes
from ngbrain.forward.solid.problem import Problem
from ngbrain.forward.solid.virtual_work import Motion, Seen, Terms, Work, slope, vector
from ngbrain.materials.base import Deformation, Value, density

Array = np.ndarray
Slopes: TypeAlias = tuple[Callable[[], Array], list[Callable[[], Array]]]
"""What gives the derivatives of an integral by the state, and by each block of θ."""
Pair: TypeAlias = Callable[[Motion], tuple[Motion, Motion]]
"""From a part of the wave to what is tested with what: where loads follow the body, it matters which of two is which."""


class WaveWork:
    """Re(A v) of a wave v = c + i d, tested, as integrals of real fields; Im(A v) is Re(A (-i v)).

    With them the derivatives of Re(λᵀ A v), at the body's state, by the state and by θ, and those of its change Re(λᵀ A' v) along
    the ways of both that `aim` was last given.
    """

    def __init__(self, body: Problem, blocks: Iterable[Block], loss: Value, rho: Value) -> None:
        self._body, self._blocks, self._loss, self._rho = body, list(blocks), loss, rho
        fes = body.fes
        self._work, self._squared = Work(body), ngs.Parameter(0.0)
        self._c, self._d, self._adjoint, self._change = (ngs.GridFunction(fes) for _ in range(4))
        self._trial, self._test = fes.TnT()
        layout = body.layout
        spaces = [complexified(part) for part in ([fes] if layout.single else fes.components[: 1 + layout.pressure])]
        if layout.offset:
            spaces.append(offsets(body.mesh, body.contacts, body.element.order, complex=True))
        if layout.cavities:
            spaces += [complexified(part) for part in fes.components[layout.count - layout.cavities :]]
        same = spaces[0] if len(spaces) == 1 else ngs.FESpace(spaces)
        u, v = (part if len(spaces) == 1 else part[0] for part in same.TnT())
        pattern = u[0] * v[0] * ngs.dx
        if layout.offset:
            pattern += u[0] * v[0] * ngs.ds
        self.pattern = ngs.BilinearForm(pattern).Assemble().mat
        """A complex matrix with the entries' places."""

    def matrices(self) -> Callable[[float], Array]:
        """From ω (rad/s) to the entries of A at the body's state, in the order of `pattern`."""
        still, moving, lossy = (np.array(form().AsVector().FV().NumPy()) for form in self._forms)
        return lambda omega: still - omega**2 * moving + 1j * lossy

    @cached_property
    def _forms(self) -> list[Callable[[], ngs.BaseMatrix]]:
        state, test, work = self._trial, self._test, self._work
        parts = (work(state, test), work.of(self._kinetic, state, test), work.of(self._lossy, state, test))
        return [_matrix(self._body, each) for each in parts]

    def sensitivity(self, omega: float, v: Array) -> tuple[sp.csr_array, sp.csr_array]:
        """∂(A v)/∂u₀ (ndof, ndof) and ∂(A v)/∂θ (ndof, size)."""
        by_state, by_theta = [], []
        for part in (v, -1j * v):
            self._put(omega, part)
            by_state.append(sparse(self._by_state()))
            by_theta.append(sp.csr_array(sp.hstack([columns() for columns in self._columns])))
        return by_state[0] + 1j * by_state[1], by_theta[0] + 1j * by_theta[1]

    def slopes(self, omega: float, v: Array, adjoint: Array) -> tuple[Array, Array]:
        """∂ Re(λᵀ A v)/∂u₀ (ndof,) and ∂ Re(λᵀ A v)/∂θ (size,)."""
        return self._summed(self._slopes, omega, v, adjoint)

    def aim(self, state: Array, direction: Array) -> None:
        """Ways of the state (ndof,) and of θ (size,)."""
        self._change.vec.FV().NumPy()[:] = state
        for block, way in zip(
            self._blocks, np.split(direction, np.cumsum([b.size for b in self._blocks])), strict=False
        ):
            block.turn(way)

    def turned(self, omega: float, v: Array) -> Array:
        """A' v (ndof,)."""
        found = self._complex(self._turned_product, omega, v)
        return self._and_nodes(found, lambda: self._complex(self._product, omega, v))

    def turned_back(self, omega: float, adjoint: Array) -> Array:
        """A'ᵀ λ (ndof,)."""
        found = self._complex(self._turned_transposed, omega, adjoint)
        return self._and_nodes(found, lambda: self._complex(self._transposed, omega, adjoint))

    def turned_slopes(self, omega: float, v: Array, adjoint: Array) -> tuple[Array, Array]:
        """∂ Re(λᵀ A' v)/∂u₀ (ndof,) and ∂ Re(λᵀ A' v)/∂θ (size,)."""
        found = np.concatenate(self._summed(self._turned_slopes, omega, v, adjoint))
        found = self._and_nodes(found, lambda: np.concatenate(self.slopes(omega, v, adjoint)))
        return found[: self._body.fes.ndof], found[self._body.fes.ndof :]

    def _and_nodes(self, found: Array, of: Callable[[], Array]) -> Array:
        """A change along all other ways, and that of what it is the change of along node positions'."""
        return sum((block.change(of) for block in self._blocks if isinstance(block, Nodes)), found)

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
        """From what gives Re(A v)."""
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
        return _matrix(self._body, self._real(self._trial, _tested(self._test)))

    @cached_property
    def _columns(self) -> list[Callable[[], sp.csr_array]]:
        parts = self._real(self._body.gfu, _tested(self._test))
        return [block.columns(self._body.fes, parts) for block in self._blocks]

    @cached_property
    def _slopes(self) -> Slopes:
        return self._slopes_of(lambda state: self._real(state, _tested(self._adjoint)))

    @cached_property
    def _turned_slopes(self) -> Slopes:
        return self._slopes_of(lambda state: self._turn(state, _tested(self._adjoint)))

    @cached_property
    def _product(self) -> Callable[[], Array]:
        return vector(self._body.fes, self._real(self._body.gfu, _tested(self._test)))

    @cached_property
    def _transposed(self) -> Callable[[], Array]:
        return vector(self._body.fes, self._real(self._body.gfu, lambda part: (part, self._test)))

    @cached_property
    def _turned_product(self) -> Callable[[], Array]:
        return vector(self._body.fes, self._turn(self._body.gfu, _tested(self._test)))

    @cached_property
    def _turned_transposed(self) -> Callable[[], Array]:
        test = self._test
        return vector(self._body.fes, self._turn(self._body.gfu, lambda part: (part, test)))

    def _slopes_of(self, functional: Callable[[Motion], Terms]) -> Slopes:
        parts = functional(self._body.gfu)
        by_theta = [block.slope(parts, self._body.mesh) for block in self._blocks]
        return slope(self._body, functional(self._trial)), by_theta

    def _turn(self, state: Motion, pair: Pair) -> Terms:
        """The change of `_real` along the ways of the state and of θ."""
        parts, others = self._real(state, pair), (block for block in self._blocks if not isinstance(block, Nodes))
        return self._real(state, pair, self._change) + [term for block in others for term in block.along(parts)]

    def _real(self, state: Motion, pair: Pair, *along: Motion) -> Terms:
        """Re(A v) tested with a virtual motion, and for each motion more its derivative along it."""
        stored = self._work(state, *pair(self._c), *along)
        kinetic = self._work.of(self._kinetic, state, *pair(self._c), *along)
        lossy = self._work.of(self._lossy, state, *pair(self._d), *along)
        return stored + [term.times(-self._squared) for term in kinetic] + [term.times(-1) for term in lossy]

    def _kinetic(self, at: Seen) -> ngs.comp.SumOfIntegrals:
        return at.kinematics.weight() * self._rho / 2 * ngs.InnerProduct(at.u, at.u) * at.inside(".*")

    def _lossy(self, at: Seen) -> ngs.comp.SumOfIntegrals:
        body, deformation = self._body, Deformation.of(at.F)
        first, *rest = (
            at.kinematics.weight()
            * self._loss
            * density(m.elastic, deformation)
            * ngs.dx(definedon=body.mesh.Materials(pattern), intrules=body.tissue.rules)
            for pattern, m in body.materials.items()
        )
        return sum(rest, first)


def _tested(virtual: Motion) -> Pair:
    return lambda part: (virtual, part)


def _matrix(body: Problem, parts: Terms) -> Callable[[], ngs.BaseMatrix]:
    """How terms with trial functions as the state, and test functions, change with the state: the matrix at the body's."""
    form = ngs.BilinearForm(body.fes)
    for part in parts:
        form += part.integral
    if body.layout.offset:  # the same places for all of them, whether they act on walls or not
        u, v = (body.layout.fields(of).u for of in body.fes.TnT())
        form += ngs.Parameter(0.0) * u[0] * v[0] * ngs.ds

    def assembled() -> ngs.BaseMatrix:
        form.AssembleLinearization(body.gfu.vec)
        return form.mat

    return assembled
