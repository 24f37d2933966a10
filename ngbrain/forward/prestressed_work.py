"""Virtual work of waves in a body that is deformed already, by symbols: A v tested, and its derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.forward.factors import sparse
from ngbrain.forward.implicit_blocks import Block
from ngbrain.forward.implicit_work import Motion, Seen, Terms, Work, slope
from ngbrain.forward.slopes import complexified
from ngbrain.forward.static import Static
from ngbrain.materials.base import Deformation, Value, density

Array = np.ndarray


class WaveWork:
    """Re(A v) of a wave v = c + i d, tested, as integrals of real fields; Im(A v) is Re(A (-i v)).

    With them the derivatives of Re(λᵀ A v), at the body's state, by the state and by θ.
    """

    def __init__(self, body: Static, blocks: Iterable[Block], loss: Value, rho: Value) -> None:
        self._body, self._blocks, self._loss, self._rho = body, list(blocks), loss, rho
        fes = body.fes
        self._work, self._squared = Work(body), ngs.Parameter(0.0)
        self._c, self._d, self._adjoint = (ngs.GridFunction(fes) for _ in range(3))
        self._trial, self._test = fes.TnT()
        spaces = [complexified(part) for part in ([fes] if body.u is body.gfu else fes.components)]
        same = spaces[0] if len(spaces) == 1 else ngs.FESpace(spaces)
        u, v = (part if len(spaces) == 1 else part[0] for part in same.TnT())
        self.pattern = ngs.BilinearForm(u[0] * v[0] * ngs.dx).Assemble().mat
        """A complex matrix with the entries' places."""

    def matrices(self) -> Callable[[float], Array]:
        """From ω (rad/s) to the entries of A at the body's state, in the order of `pattern`."""
        still, moving, lossy = (np.array(form().AsVector().FV().NumPy()) for form in self._forms)
        return lambda omega: still - omega**2 * moving + 1j * lossy

    @cached_property
    def _forms(self) -> list[Callable[[], ngs.BaseMatrix]]:
        state, test, work = self._trial, self._test, self._work
        parts = (work(state, test), work.of(self._kinetic, state, test), work.of(self._lossy, state, test))
        return [_slopes(self._body, each) for each in parts]

    def sensitivity(self, omega: float, v: Array) -> tuple[sp.csr_array, sp.csr_array]:
        """∂(A v)/∂u₀ (ndof, ndof) and ∂(A v)/∂θ (ndof, size)."""
        by_state, by_theta = [], []
        for part in (v, -1j * v):
            self._put(omega, part)
            by_state.append(sparse(self._turned()))
            by_theta.append(sp.csr_array(sp.hstack([columns() for columns in self._columns])))
        return by_state[0] + 1j * by_state[1], by_theta[0] + 1j * by_theta[1]

    def slopes(self, omega: float, v: Array, adjoint: Array) -> tuple[Array, Array]:
        """∂ Re(λᵀ A v)/∂u₀ (ndof,) and ∂ Re(λᵀ A v)/∂θ (size,)."""
        by_state, by_theta = [], []
        for part, tested in ((v, adjoint.real), (-1j * v, -adjoint.imag)):
            self._put(omega, part)
            self._adjoint.vec.FV().NumPy()[:] = tested
            by_state.append(self._by_state())
            by_theta.append(np.concatenate([slope() for slope in self._by_theta]))
        return by_state[0] + by_state[1], by_theta[0] + by_theta[1]

    def _put(self, omega: float, v: Array) -> None:
        self._squared.Set(omega**2)
        self._c.vec.FV().NumPy()[:], self._d.vec.FV().NumPy()[:] = v.real, v.imag

    @cached_property
    def _turned(self) -> Callable[[], ngs.BaseMatrix]:
        return _slopes(self._body, self._real(self._trial, self._test))

    @cached_property
    def _columns(self) -> list[Callable[[], sp.csr_array]]:
        parts = self._real(self._body.gfu, self._test)
        return [block.columns(self._body.fes, parts) for block in self._blocks]

    @cached_property
    def _by_state(self) -> Callable[[], Array]:
        return slope(self._body, self._real(self._trial, self._adjoint))

    @cached_property
    def _by_theta(self) -> list[Callable[[], Array]]:
        parts = self._real(self._body.gfu, self._adjoint)
        return [block.slope(parts, self._body.mesh) for block in self._blocks]

    def _real(self, state: Motion, virtual: Motion) -> Terms:
        """Re(A v) tested with a virtual motion."""
        stored = self._work(state, virtual, self._c)
        kinetic = self._work.of(self._kinetic, state, virtual, self._c)
        lossy = self._work.of(self._lossy, state, virtual, self._d)
        return stored + [term.times(-self._squared) for term in kinetic] + [term.times(-1) for term in lossy]

    def _kinetic(self, at: Seen) -> ngs.comp.SumOfIntegrals:
        return at.kinematics.weight() * self._rho / 2 * ngs.InnerProduct(at.u, at.u) * at.inside(".*")

    def _lossy(self, at: Seen) -> ngs.comp.SumOfIntegrals:
        body, deformation = self._body, Deformation.of(at.F)
        first, *rest = (
            at.kinematics.weight()
            * self._loss
            * density(m.elastic, deformation)
            * ngs.dx(definedon=body.mesh.Materials(pattern), intrules=body.rules)
            for pattern, m in body.materials.items()
        )
        return sum(rest, first)


def _slopes(body: Static, parts: Terms) -> Callable[[], ngs.BaseMatrix]:
    """How terms with trial functions as the state, and test functions, change with the state: the matrix at the body's."""
    form = ngs.BilinearForm(body.fes)
    for part in parts:
        form += part.integral

    def assembled() -> ngs.BaseMatrix:
        form.AssembleLinearization(body.gfu.vec)
        return form.mat

    return assembled
