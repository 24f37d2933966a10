"""A block that hangs under its weight, seen at its nodes, and ways to its shape without weight."""

from __future__ import annotations

from collections.abc import Callable

import ngsolve as ngs
import numpy as np
import scipy.sparse as sp
from ngsolve.meshes import MakeStructured2DMesh, MakeStructured3DMesh

from ngbrain.adjoint import Reduced
from ngbrain.forward import BodyForce, Displacements, LoadCase, Material, NodePositions, Positions, Problem, StaticModel
from ngbrain.inverse import (
    DiscrepancyPrinciple,
    LeastSquares,
    OptimisationResult,
    ParameterFields,
    QuadraticRegulariser,
    ScaledTransform,
    Unknown,
    levenberg_marquardt,
    smooth,
)
from ngbrain.materials import NeoHooke

Array = np.ndarray
SIDE, NOISE = 0.1, 0.01


def meshed(n: int, dim: int = 2) -> ngs.Mesh:
    """A square or a cube."""
    if dim == 2:
        return MakeStructured2DMesh(quads=False, nx=n, ny=n, mapping=lambda x, y: (SIDE * x, SIDE * y))
    return MakeStructured3DMesh(hexes=False, nx=n, ny=n, nz=n, mapping=lambda x, y, z: (SIDE * x, SIDE * y, SIDE * z))


def vertices(mesh: ngs.Mesh) -> Array:
    """(n, dim)."""
    return np.array([vertex.point for vertex in mesh.vertices])


def rms(vectors: Array) -> float:
    """Of their lengths."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))


def bulged(x: Array, y: Array) -> Array:
    """Where points of a square are in the block without weight."""
    aside = 0.1 * (x - SIDE / 2) * np.sin(np.pi * (1 - y / SIDE)) + 0.08 * (SIDE - y) * (x / SIDE) ** 2
    return np.stack([x + aside, y - 0.15 * (SIDE - y) * np.sin(np.pi * x / SIDE)], axis=-1)


class Hanging:
    """The block, seen at the vertices of a mesh; and ways to its shape without weight, all as (vertices, 2) m."""

    def __init__(self, cells: int, fine: int, seed: int = 0, noise: float = NOISE) -> None:
        self.square = vertices(meshed(cells))
        self.mesh, simulation = meshed(cells), meshed(fine)
        known, nodes = self._model(simulation, "P3/P2"), vertices(simulation)
        seen = known.evaluate((bulged(*nodes.T) - nodes).T.ravel()).data.reshape(-1, 2)
        self.truth = bulged(*self.square.T)
        self.moved = rms(seen - self.truth)
        self.sigma = noise * self.moved / np.sqrt(2)
        self.seen = seen + self.sigma * np.random.default_rng(seed).normal(size=seen.shape)
        self.model = self._model(self.mesh, "P2/P1")
        self._free = np.tile(self.square[:, 1] < SIDE * (1 - 1e-9), 2)

    def _model(self, mesh: ngs.Mesh, form: str) -> Positions:
        nodes = NodePositions(mesh)
        tissue = {".*": Material(NeoHooke(600.0), 3e4)}
        body = Problem(mesh, tissue, {"top": 0}, [BodyForce((0, -9810.0))], element=form)
        model = StaticModel([LoadCase(body, [Displacements(self.square)])], {"nodes": nodes}, steps=4)
        return Positions(model, "nodes", self.square)

    def error(self, shape: Array) -> float:
        """Of a shape without weight."""
        return rms(shape - self.truth) / self.moved

    def loaded(self, shape: Array) -> Array:
        """Where its vertices hang."""
        return self.model.evaluate(np.where(self._free, (shape - self.square).T.ravel(), 0.0)).data.reshape(-1, 2)

    def taken_back(self) -> Array:
        """The seen shape less what its weight would move it."""
        self.model.model.forget()
        return self.seen - (self.loaded(self.seen) - self.seen)

    def fixed_point(self, rounds: int = 15) -> tuple[Array, float]:
        """What is missed is added to the shape, again and again; and the last change (m)."""
        self.model.model.forget()
        shape, missed = self.square, self.seen
        for _ in range(rounds):
            missed = self.seen - self.loaded(shape)
            shape = shape + missed
        return shape, rms(missed)

    def found(
        self, search: Callable[..., OptimisationResult] = levenberg_marquardt
    ) -> tuple[Array, OptimisationResult]:
        """By the derivatives."""
        self.model.model.forget()
        inner, nodes = self.model.model, self.model.model.parts["nodes"]
        basis = sp.eye_array(inner.size, format="csr")[:, np.flatnonzero(self._free)]
        fields = ParameterFields(
            np.zeros(inner.size), inner.blocks, {"nodes": Unknown(0.0, ScaledTransform(SIDE), basis)}
        )
        assert isinstance(nodes, NodePositions)
        smoothed = smooth(nodes.shift.space, 0.0).matrix(np.zeros(inner.size))
        drawn = QuadraticRegulariser(sp.csr_array(basis.T @ smoothed @ basis), fields.start)
        misfit = LeastSquares(self.seen.ravel(), np.full(self.seen.size, self.sigma))
        reduced = Reduced(self.model, misfit, fields, {"nodes": drawn}, {"nodes": 10.0})
        found = search(reduced, fields.start, DiscrepancyPrinciple())
        return self.square + fields.theta(found.x).reshape(2, -1).T, found
