"""A multigrid preconditioner for displacements of any order: vertex patches and smoothed aggregation.

One cycle solves exactly on the star of every vertex in turn, then for the vertex functions by pyamg, then on the stars
in reverse order. A star contains the divergence-free functions around its vertex, which point smoothing misses: at K/μ = 50,
order 2 takes 25 iterations instead of 80.

References
----------
Schöberl, Melenk, Pechstein, Zaglmayr 2008, https://doi.org/10.1093/imanum/drl046 (additive Schwarz preconditioning for the
p-version); Vaněk, Mandel, Brezina 1996 (algebraic multigrid by smoothed aggregation).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp

from ngbrain.errors import InputError

if TYPE_CHECKING:
    import pyamg

Array = np.ndarray

COARSEST = 50
"""Aggregates up to which a level is solved directly."""
BELOW = 3
"""Cycles of pyamg in each cycle. They are cheap: at K/μ = 50 and 75 000 unknowns, 1, 3 and 5 of them give 35, 23 and 22
iterations, an exact solve 20."""


class Patches:
    """Vertex patches of a space: the free degrees of freedom around each vertex, those at vertices, and rigid motions there.

    Parameters
    ----------
    space : FESpace
        A VectorH1 space, whose degrees of freedom come first.
    free : array of bool (ndof,)
        Degrees of freedom to solve for.

    Raises
    ------
    InputError
        For a space that is not VectorH1.
    """

    def __init__(self, space: ngs.FESpace, free: Array) -> None:
        if space.type != "VectorH1":
            raise InputError("form.space", space.type or space.name, "a VectorH1 space of displacements for amg")
        scalars, mesh = space.components, space.mesh
        starts = [space.Range(i).start for i in range(mesh.dim)]
        around: list[list[int]] = [[] for _ in range(mesh.nv)]
        at = np.full(mesh.nv, -1)
        for vertex in mesh.vertices:
            for dof in scalars[0].GetDofNrs(vertex):
                at[vertex.nr] = dof
                around[vertex.nr].append(dof)
        for kind in (ngs.EDGE, ngs.FACE, ngs.CELL)[: mesh.dim]:
            for node in mesh.nodes(kind):
                dofs = scalars[0].GetDofNrs(node)
                if dofs:
                    for vertex in node.vertices:
                        around[vertex.nr].extend(dofs)
        patches = ([start + dof for start in starts for dof in star if free[start + dof]] for star in around)
        self.stars = [patch for patch in patches if patch]
        points = np.array([vertex.point for vertex in mesh.vertices])[at >= 0]
        at = at[at >= 0]
        self.vertices = np.add.outer(at, starts).ravel()
        self.fixed = ~free[self.vertices]
        self.rigid = _rigid(points)
        self.rigid[self.fixed] = 0


class Cycle:
    """Symmetric V-cycle for the displacements, which are the first degrees of freedom of a matrix; the others stay zero.

    Parameters
    ----------
    matrix : BaseMatrix
        Assembled matrix.
    patches : Patches
        Patches of its space.
    """

    def __init__(self, matrix: ngs.BaseMatrix, patches: Patches) -> None:
        self._matrix, self._vertices, self._free = matrix, patches.vertices, ~patches.fixed
        self._smoother = matrix.CreateBlockSmoother(patches.stars, parallel=True)
        self._x, self._r, self._left = (matrix.CreateColVector() for _ in range(3))
        self._block = _vertex_block(matrix, patches)
        self._coarse = _aggregated(self._block, patches).aspreconditioner(cycle="V")

    def __call__(self, r: Array) -> Array:
        """Apply the cycle to a residual."""
        x, left = self._x, self._left
        self._r[:] = 0
        self._r.FV().NumPy()[: len(r)] = r
        x[:] = 0
        self._smoother.Smooth(x, self._r)
        left.data = self._r - self._matrix * x
        x.FV().NumPy()[self._vertices] += self._below(left.FV().NumPy()[self._vertices])
        self._smoother.SmoothBack(x, self._r)
        return x.FV().NumPy()[: len(r)].copy()

    def _below(self, r: Array) -> Array:
        r = r * self._free
        x = self._coarse @ r
        for _ in range(BELOW - 1):
            x += self._coarse @ (r - self._block @ x)
        return x * self._free


def _vertex_block(matrix: ngs.BaseMatrix, patches: Patches) -> sp.bsr_array:
    """Matrix of the vertex functions, node by node; of a fixed degree of freedom only the diagonal."""
    values, columns, rows = (np.asarray(part) for part in matrix.CSR())
    whole = sp.csr_array((values, columns, rows), shape=matrix.shape)
    block = whole[patches.vertices][:, patches.vertices]
    keep = sp.diags_array((~patches.fixed).astype(float))
    held = sp.diags_array(np.where(patches.fixed, np.abs(block.diagonal()).max(), 0.0))
    dim = patches.rigid.shape[1] // 3 + 1
    return sp.bsr_array(keep @ block @ keep + held, blocksize=(dim, dim))


def _aggregated(block: sp.bsr_array, patches: Patches) -> pyamg.MultilevelSolver:
    import pyamg  # slow to import

    sweep = ("block_gauss_seidel", {"sweep": "symmetric"})
    return pyamg.smoothed_aggregation_solver(
        sp.bsr_matrix(block), patches.rigid, symmetry="symmetric", strength=None, max_coarse=COARSEST,
        presmoother=sweep, postsmoother=sweep, improve_candidates=None,
    )  # fmt: skip


def _rigid(points: Array) -> Array:
    """Translations and rotations at points (n, dim), as columns over dim·n degrees of freedom, node by node."""
    n, dim = points.shape
    x = points - points.mean(axis=0)
    x = x / np.abs(x).max()
    turns = [(i, j) for i in range(dim) for j in range(i)]
    modes = np.zeros((n, dim, dim + len(turns)))
    modes[:, range(dim), range(dim)] = 1
    for k, (i, j) in enumerate(turns, dim):
        modes[:, i, k], modes[:, j, k] = x[:, j], -x[:, i]
    return modes.reshape(n * dim, -1)
