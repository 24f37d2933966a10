"""A multigrid preconditioner for displacements of any order: patches around vertices, and smoothed aggregation below.

One cycle solves exactly on the star of every vertex in turn, then for the vertex functions by pyamg, then on the stars
again in reverse. A star sees the divergence-free functions around its vertex, which point smoothing does not: at K/μ = 50
order 2 takes 25 iterations instead of 80.

Sources: Schöberl, Melenk, Pechstein, Zaglmayr, Additive Schwarz preconditioning for p-version triangular and tetrahedral
finite elements (2008), 10.1093/imanum/drl046; Vaněk, Mandel, Brezina, Algebraic multigrid by smoothed aggregation (1996).
"""

from __future__ import annotations

import ngsolve as ngs
import numpy as np
import pyamg
import scipy.sparse as sp

from ngbrain.errors import InputError

Array = np.ndarray

COARSEST = 50
"""Aggregates below which a level is solved directly."""
BELOW = 3
"""Cycles of pyamg in one of ours. They cost little; at K/μ = 50 and 75 000 unknowns 1, 3 and 5 of them make 35, 23 and 22
iterations, and an exact solution 20."""


class Patches:
    """What the cycle needs of a space: the free unknowns around every vertex, those at vertices, and rigid motions there.

    space    a VectorH1, whose unknowns come first
    free     which unknowns are to be solved for
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
    """Symmetric V-cycle for the displacements, the first unknowns of an assembled matrix: the others stay zero in it."""

    def __init__(self, matrix: ngs.BaseMatrix, patches: Patches) -> None:
        self._matrix, self._vertices, self._free = matrix, patches.vertices, ~patches.fixed
        self._smoother = matrix.CreateBlockSmoother(patches.stars, parallel=True)
        self._x, self._r, self._left = (matrix.CreateColVector() for _ in range(3))
        self._block = _vertex_block(matrix, patches)
        self._coarse = _aggregated(self._block, patches).aspreconditioner(cycle="V")

    def __call__(self, r: Array) -> Array:
        """Br."""
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
    """The matrix of the vertex functions, node by node; a fixed unknown keeps a diagonal only."""
    values, columns, rows = (np.asarray(part) for part in matrix.CSR())
    whole = sp.csr_array((values, columns, rows), shape=matrix.shape)
    block = whole[patches.vertices][:, patches.vertices]
    keep = sp.diags_array((~patches.fixed).astype(float))
    held = sp.diags_array(np.where(patches.fixed, np.abs(block.diagonal()).max(), 0.0))
    dim = patches.rigid.shape[1] // 3 + 1
    return sp.bsr_array(keep @ block @ keep + held, blocksize=(dim, dim))


def _aggregated(block: sp.bsr_array, patches: Patches) -> pyamg.MultilevelSolver:
    sweep = ("block_gauss_seidel", {"sweep": "symmetric"})
    return pyamg.smoothed_aggregation_solver(
        sp.bsr_matrix(block), patches.rigid, symmetry="symmetric", strength=None, max_coarse=COARSEST,
        presmoother=sweep, postsmoother=sweep, improve_candidates=None,
    )  # fmt: skip


def _rigid(points: Array) -> Array:
    """Translations and rotations at points (n, dim), as columns over dim·n unknowns, node by node."""
    n, dim = points.shape
    x = points - points.mean(axis=0)
    x = x / np.abs(x).max()
    turns = [(i, j) for i in range(dim) for j in range(i)]
    modes = np.zeros((n, dim, dim + len(turns)))
    modes[:, range(dim), range(dim)] = 1
    for k, (i, j) in enumerate(turns, dim):
        modes[:, i, k], modes[:, j, k] = x[:, j], -x[:, i]
    return modes.reshape(n * dim, -1)
